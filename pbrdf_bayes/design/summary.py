"""What a design calculation found, as plain values for a file, a page and the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes import __version__
from pbrdf_bayes.design.batches import Batch
from pbrdf_bayes.design.candidates import Candidate, distinct_labels
from pbrdf_bayes.design.nested import LOCAL, NESTED
from pbrdf_bayes.design.ranking import GoalRanking
from pbrdf_bayes.design.run import DesignResult
from pbrdf_bayes.design.words import recommend
from pbrdf_bayes.records import design as records
from pbrdf_bayes.records.design import (
    BatchPlan,
    CandidateGain,
    Choices,
    Design,
    DesignRun,
    GoalCandidate,
    Instrument,
    Member,
    Pairs,
    Plan,
    Ratio,
)
from pbrdf_bayes.records.values import plain

Array = NDArray[np.float64]
Labels = Mapping[Candidate, str]


def summarise_design(result: DesignResult, run: Mapping[str, Any] | None) -> dict[str, Any]:
    """A design as plain values of `pbrdf_bayes.records.design.Design`.

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
    choices, config, pairs = result.choices, result.config, result.pairs
    found = Design(
        version=__version__,
        run=None if run is None else _run(run),
        about=tuple(result.about),
        sd_before=dict(zip(result.quantities, result.sd_before, strict=True)),
        n_candidates=len(result.candidates),
        n_evaluated=len(result.evaluated),
        candidates=(*_evaluated(result, labels), *_screened(result, labels)),
        batch=BatchPlan(**_plan(result.batch, labels), budget_minutes=_or_none(choices.minutes)),
        pairs=None if pairs is None else Pairs(
            best=Plan(**_plan(pairs.best, labels)), greedy=Plan(**_plan(pairs.greedy, labels)),
            gap_nats=pairs.gap, gap_se=pairs.gap_se, n_compared=pairs.n_compared,
            method=pairs.method,
        ),
        goals=tuple(_goal(aim, result, labels) for aim in result.goals),
        choices=Choices(
            n_outer=choices.n_outer, n_inner=choices.n_inner, n_nuisance=choices.n_nuisance,
            batch=choices.most, minutes=_or_none(choices.minutes),
        ),
        p_best_readings=result.by_gain.n_readings,
        instrument=Instrument(
            noise=config.noise, brdf_scale=config.brdf_scale, u_brdf_cal=config.u_brdf_cal,
            u_dhr_cal=config.u_dhr_cal, scans_of_prior=result.scans_of_prior,
        ),
        seed=choices.seed,
        recommendation="",
    )  # fmt: skip
    content: dict[str, Any] = plain(found)
    return content | {"recommendation": "\n".join(recommend(content))}


def _run(summary: Mapping[str, Any]) -> DesignRun:
    keys = ("sample", "wavelength_um", "created_utc", "status", "verdict", "seed")
    applicability = (summary.get("applicability") or {}).get("verdict")
    return DesignRun(**{key: summary[key] for key in keys}, applicability=applicability)


def _evaluated(result: DesignResult, labels: Labels) -> list[CandidateGain]:
    by_gain, by_minute = result.by_gain, result.by_minute
    rows = []
    for i in np.argsort(-by_gain.value, kind="stable"):
        done = result.evaluated[i]
        gain, minutes, at = done.gain, done.candidate.minutes, result.chosen[i]
        ratios = zip(result.quantities, *done.spread.sd_ratio(), strict=True)
        rows.append(
            CandidateGain(
                **_geometry(done.candidate, labels),
                eig_nats=gain.eig, eig_se=gain.se, eig_low=gain.low, eig_high=gain.high,
                eig_method=gain.method, local_nats=done.local_nats, ess=gain.ess,
                eig_per_minute=gain.eig / minutes, eig_per_minute_se=gain.se / minutes,
                linear_nats=result.linear[at], linear_se=result.linear_se[at],
                p_best=by_gain.p_best[i], p_best_per_minute=by_minute.p_best[i],
                tied=by_gain.tied[i], tied_per_minute=by_minute.tied[i],
                pareto=by_gain.pareto[i], repeat=result.repeats[i],
                sd_method=LOCAL if done.local_spread else NESTED,
                sd_ratio={name: Ratio(ratio, se) for name, ratio, se in ratios},
            )
        )  # fmt: skip
    return rows


def _screened(result: DesignResult, labels: Labels) -> list[CandidateGain]:
    left = np.setdiff1d(np.arange(len(result.candidates)), result.chosen)
    left = left[np.argsort(-result.linear[left], kind="stable")]
    return [
        CandidateGain(
            **_geometry(result.candidates[i], labels),
            linear_nats=result.linear[i], linear_se=result.linear_se[i],
        )
        for i in left
    ]  # fmt: skip


def _geometry(candidate: Candidate, labels: Labels) -> dict[str, Any]:
    """Fields of `Geometry`; the range of a scan, whose step is None where it varies."""
    angles = np.array(candidate.theta_r_deg)
    steps = np.diff(angles)
    even = steps.size > 0 and bool(np.allclose(steps, steps[0], rtol=0.0, atol=1e-5))
    step = (angles[-1] - angles[0]) / steps.size if even else None
    return {
        "label": labels[candidate],
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


def _plan(batch: Batch, labels: Labels) -> dict[str, Any]:
    """Fields of `Plan`."""
    members = [m.candidate for m in batch.members]
    spent = np.cumsum([candidate.minutes for candidate in members])
    rows = zip(members, spent, batch.gains, batch.added, strict=True)
    last = batch.gains[-1] if batch.gains else None
    return {
        "members": tuple(
            Member(
                **_geometry(candidate, labels), cumulative_minutes=minutes,
                cumulative_nats=gain.eig, cumulative_se=gain.se, added_nats=added,
                added_se=added_se, method=gain.method,
            )
            for candidate, minutes, gain, (added, added_se) in rows
        ),
        "eig_nats": batch.eig,
        "eig_se": 0.0 if last is None else last.se,
        "eig_low": max((gain.low for gain in batch.gains), default=0.0),  # more never tells less
        "eig_high": 0.0 if last is None else last.high,
        "minutes": batch.minutes,
        "method": NESTED if last is None else last.method,
    }  # fmt: skip


def _goal(aim: GoalRanking, result: DesignResult, labels: Labels) -> records.GoalRanking:
    """Candidates by what they do for one prediction, the best first."""
    rows = []
    for i in np.argsort(aim.left, kind="stable"):
        done = result.evaluated[i]
        candidate, minutes = done.candidate, done.candidate.minutes
        reduction, se = 1.0 - aim.left[i], aim.left_se[i]
        left = np.sqrt(aim.left[i])
        rows.append(
            GoalCandidate(
                label=labels[candidate], quantity=candidate.quantity, minutes=minutes,
                reduction=reduction, reduction_se=se, reduction_per_minute=reduction / minutes,
                reduction_per_minute_se=se / minutes, sd_ratio=left,
                sd_ratio_se=0.5 * se / max(left, 1e-12), p_best=aim.by_measurement.p_best[i],
                p_best_per_minute=aim.by_minute.p_best[i], tied=aim.by_measurement.tied[i],
                tied_per_minute=aim.by_minute.tied[i], pareto=aim.by_measurement.pareto[i],
                method=LOCAL if done.local_spread else NESTED, theta_i_deg=candidate.theta_i_deg,
                polarization=candidate.polarization, port_deg=candidate.port_deg or None,
            )
        )  # fmt: skip
    return records.GoalRanking(
        name=aim.name, sd_before=result.sd_before[result.quantities.index(aim.name)],
        p_best_readings=aim.by_measurement.n_readings, candidates=tuple(rows),
    )  # fmt: skip


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
