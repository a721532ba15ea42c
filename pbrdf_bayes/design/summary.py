"""What a design calculation found, as plain values for a file, a page and the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes import __version__
from pbrdf_bayes.design.batches import Batch
from pbrdf_bayes.design.candidates import Candidate, distinct_labels
from pbrdf_bayes.design.for_goals import GoalRanking
from pbrdf_bayes.design.nested import LOCAL, NESTED
from pbrdf_bayes.design.run import DesignResult
from pbrdf_bayes.design.words import recommend

Array = NDArray[np.float64]
Labels = Mapping[Candidate, str]

SCHEMA_VERSION = 1


def summarise_design(result: DesignResult, run: Mapping[str, Any] | None) -> dict[str, Any]:
    """A design as plain values, see ``pbrdf_bayes/io/design.schema.json``.

    Parameters
    ----------
    result : DesignResult
    run : mapping or None
        Summary of the run that the beliefs come from; None before any reading.

    Returns
    -------
    dict
        ``candidates`` holds the largest gain first; those that only the linear estimate screened
        come after all others, with None for what was not computed.
    """
    labels = dict(zip(result.candidates, distinct_labels(result.candidates), strict=True))
    choices = result.choices
    found: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "run": None if run is None else _run(run),
        "about": list(result.about),
        "sd_before": dict(zip(result.quantities, map(float, result.sd_before), strict=True)),
        "n_candidates": len(result.candidates),
        "n_evaluated": len(result.evaluated),
        "candidates": [*_evaluated(result, labels), *_screened(result, labels)],
        "batch": _batch(result.batch, labels) | {"budget_minutes": _or_none(choices.minutes)},
        "pairs": None,
        "goals": [_goal(aim, result, labels) for aim in result.goals],
        "choices": {
            "n_outer": choices.n_outer, "n_inner": choices.n_inner,
            "n_nuisance": choices.n_nuisance, "batch": choices.most,
            "minutes": _or_none(choices.minutes),
        },
        "p_best_readings": result.by_gain.n_readings,
        "instrument": {
            "noise": result.config.noise, "brdf_scale": result.config.brdf_scale,
            "u_brdf_cal": result.config.u_brdf_cal, "u_dhr_cal": result.config.u_dhr_cal,
            "scans_of_prior": result.scans_of_prior,
        },
        "seed": choices.seed,
    }  # fmt: skip
    if result.pairs is not None:
        pairs = result.pairs
        found["pairs"] = {
            "best": _batch(pairs.best, labels), "greedy": _batch(pairs.greedy, labels),
            "gap_nats": pairs.gap, "gap_se": pairs.gap_se, "n_compared": pairs.n_compared,
            "method": pairs.method,
        }  # fmt: skip
    found["recommendation"] = "\n".join(recommend(found))
    return found


def _run(summary: Mapping[str, Any]) -> dict[str, Any]:
    keys = ("sample", "wavelength_um", "created_utc", "status", "verdict", "seed")
    return {key: summary[key] for key in keys} | {
        "applicability": (summary.get("applicability") or {}).get("verdict")
    }


def _evaluated(result: DesignResult, labels: Labels) -> list[dict[str, Any]]:
    by_gain, by_minute = result.by_gain, result.by_minute
    rows = []
    for i in np.argsort(-by_gain.value, kind="stable"):
        done = result.evaluated[i]
        gain, minutes, at = done.gain, done.candidate.minutes, result.chosen[i]
        ratios = zip(result.quantities, *done.spread.sd_ratio(), strict=True)
        rows.append(
            describe(done.candidate, labels[done.candidate])
            | {
                "eig_nats": gain.eig,
                "eig_se": gain.se,
                "eig_low": gain.low,
                "eig_high": gain.high,
                "eig_method": gain.method,
                "local_nats": done.local_nats,
                "ess": gain.ess,
                "eig_per_minute": gain.eig / minutes,
                "eig_per_minute_se": gain.se / minutes,
                "linear_nats": float(result.linear[at]),
                "linear_se": float(result.linear_se[at]),
                "p_best": float(by_gain.p_best[i]),
                "p_best_per_minute": float(by_minute.p_best[i]),
                "tied": bool(by_gain.tied[i]),
                "tied_per_minute": bool(by_minute.tied[i]),
                "pareto": bool(by_gain.pareto[i]),
                "repeat": bool(result.repeats[i]),
                "sd_method": LOCAL if done.local_spread else NESTED,
                "sd_ratio": {
                    name: {"ratio": float(ratio), "se": float(se)} for name, ratio, se in ratios
                },
            }
        )
    return rows


_NOT_COMPUTED = (
    "eig_nats", "eig_se", "eig_low", "eig_high", "eig_method", "local_nats", "ess",
    "eig_per_minute", "eig_per_minute_se", "p_best", "p_best_per_minute", "tied",
    "tied_per_minute", "pareto", "repeat", "sd_method", "sd_ratio",
)  # fmt: skip


def _screened(result: DesignResult, labels: Labels) -> list[dict[str, Any]]:
    left = np.setdiff1d(np.arange(len(result.candidates)), result.chosen)
    left = left[np.argsort(-result.linear[left], kind="stable")]
    return [
        describe(result.candidates[i], labels[result.candidates[i]])
        | dict.fromkeys(_NOT_COMPUTED)
        | {"linear_nats": float(result.linear[i]), "linear_se": float(result.linear_se[i])}
        for i in left
    ]


def describe(candidate: Candidate, label: str) -> dict[str, Any]:
    """Plain values of a candidate; the range of a scan, whose step is None where it varies."""
    angles = np.array(candidate.theta_r_deg)
    steps = np.diff(angles)
    even = steps.size > 0 and bool(np.allclose(steps, steps[0], rtol=0.0, atol=1e-5))
    step = (angles[-1] - angles[0]) / steps.size if even else None
    return {
        "label": label,
        "quantity": candidate.quantity,
        "polarization": candidate.polarization,
        "theta_i_deg": candidate.theta_i_deg,
        "theta_r_lo_deg": float(angles.min()) if angles.size else None,
        "theta_r_hi_deg": float(angles.max()) if angles.size else None,
        "theta_r_step_deg": None if step is None else float(round(step, 6)),
        "port_deg": candidate.port_deg or None,
        "n_readings": candidate.n_readings,
        "minutes": candidate.minutes,
    }


def _batch(batch: Batch, labels: Labels) -> dict[str, Any]:
    rows: list[dict[str, Any]] = []
    spent = 0.0
    for member, gain, (added, added_se) in zip(
        batch.members, batch.gains, batch.added, strict=True
    ):
        spent += member.candidate.minutes
        rows.append(
            describe(member.candidate, labels[member.candidate])
            | {
                "cumulative_minutes": spent,
                "cumulative_nats": gain.eig,
                "cumulative_se": gain.se,
                "added_nats": added,
                "added_se": added_se,
                "method": gain.method,
            }
        )
    last = batch.gains[-1] if batch.gains else None
    return {
        "members": rows,
        "eig_nats": batch.eig,
        "eig_se": 0.0 if last is None else last.se,
        "eig_low": max((gain.low for gain in batch.gains), default=0.0),  # more never tells less
        "eig_high": 0.0 if last is None else last.high,
        "minutes": batch.minutes,
        "method": NESTED if last is None else last.method,
    }


def _goal(aim: GoalRanking, result: DesignResult, labels: Labels) -> dict[str, Any]:
    """Candidates by what they do for one prediction, the best first."""
    rows = []
    for i in np.argsort(aim.left, kind="stable"):
        done = result.evaluated[i]
        candidate, minutes = done.candidate, done.candidate.minutes
        reduction, se = 1.0 - float(aim.left[i]), float(aim.left_se[i])
        left = float(np.sqrt(aim.left[i]))
        rows.append(
            {
                "label": labels[candidate], "quantity": candidate.quantity, "minutes": minutes,
                "reduction": reduction, "reduction_se": se,
                "reduction_per_minute": reduction / minutes,
                "reduction_per_minute_se": se / minutes,
                "sd_ratio": left,
                "sd_ratio_se": 0.5 * se / max(left, 1e-12),
                "p_best": float(aim.by_measurement.p_best[i]),
                "p_best_per_minute": float(aim.by_minute.p_best[i]),
                "tied": bool(aim.by_measurement.tied[i]),
                "tied_per_minute": bool(aim.by_minute.tied[i]),
                "pareto": bool(aim.by_measurement.pareto[i]),
                "method": LOCAL if done.local_spread else NESTED,
                "theta_i_deg": candidate.theta_i_deg, "polarization": candidate.polarization,
                "port_deg": candidate.port_deg or None,
            }
        )  # fmt: skip
    return {
        "name": aim.name,
        "sd_before": float(result.sd_before[result.quantities.index(aim.name)]),
        "p_best_readings": aim.by_measurement.n_readings,
        "candidates": rows,
    }


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
