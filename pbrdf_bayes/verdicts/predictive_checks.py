"""Verdicts on predictions: readings and scans left out, and what the prior has to say in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut
from pbrdf_bayes.inference.sampling.power_scaling import PriorSensitivity
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import Influential, ScanPit
from pbrdf_bayes.verdict import (
    COVERAGE_WARN,
    DISPLACED,
    FAIL,
    FALSE_ALARM,
    INFLUENCE_WARN,
    MISFIT_FAIL_DEX,
    MISFIT_WARN_DEX,
    PASS,
    PIT_DISTANCE,
    SENSITIVE,
    SURPRISE_LIMIT,
    WARN,
    grade,
)
from pbrdf_bayes.verdicts.applicability import NOT_KNOWN, Repeatability
from pbrdf_bayes.words import counted, judged, say

_LISTED = 3
_CLEAR = 4.0
_FAMILIES = {"angle": "holdout_angles", "polarization": "holdout_polarization"}


def judge_readings(
    found: LeaveOneOut, repeatability: Repeatability = NOT_KNOWN
) -> tuple[Check, ...]:
    """Influence of single readings, readings at odds, the PIT of scans."""
    verdicts = [_influence(found)]
    if found.farthest:
        verdicts.append(_outliers(found))
    if found.scans:
        verdicts.append(_pit(found.scans, repeatability))
    return tuple(verdicts)


def _influence(found: LeaveOneOut) -> Check:
    worst = found.most_influential[0]
    verdict = PASS if worst.k_hat <= INFLUENCE_WARN else WARN
    many, influential = found.n_influential, ""
    if many and verdict == PASS:
        readings = f"{counted(many, 'reading')} {'has' if many == 1 else 'have'}"
        influential = say("loo.influential", readings=readings, limit=found.k_hat_limit)
    dominant = [r for r in found.most_influential if r.k_hat > INFLUENCE_WARN][:_LISTED]
    return judged(
        "loo", worst.k_hat, INFLUENCE_WARN, verdict, lines=_lines(dominant), n=found.n_readings,
        elpd=found.elpd, u_elpd=found.u_elpd, p_loo=found.p_loo, place=_place(worst),
        places="; ".join(map(_place, dominant)), influential=influential,
    )  # fmt: skip


def _outliers(found: LeaveOneOut) -> Check:
    """Two-sided, shared by all readings."""
    z = found.pointwise.z[np.isfinite(found.pointwise.z)]
    limit = float(-ndtri(0.5 * FALSE_ALARM / z.size))
    beyond = int(np.sum(np.abs(z) > limit))
    worst, far = found.farthest[0], [r for r in found.farthest if abs(r.z) > limit][:_LISTED]
    listed = [say("outliers.one", place=_place(r), z=r.z) for r in far]
    listed += ["others"] * (beyond > len(far))
    said = say("outliers.found", n=beyond, all=z.size, listed="; ".join(listed))
    return judged(
        "outliers", abs(worst.z), limit, WARN if beyond else PASS, place=_place(worst), z=worst.z,
        statement=said if beyond else "", lines=_lines(far),
    )  # fmt: skip


def _place(reading: Influential) -> str:
    return say(
        "place.line" if reading.row else "place", label=reading.label, angle=reading.angle_deg,
        row=reading.row,
    )  # fmt: skip


def _lines(readings: Sequence[Influential]) -> list[int]:
    return [r.row for r in readings if r.row]


def _pit(scans: Sequence[ScanPit], repeatability: Repeatability) -> Check:
    """Kolmogorov-Smirnov scan by scan, the probability of a false alarm shared by the scans."""
    n = len(scans)
    bad = [s for s in scans if n * s.p_value < FALSE_ALARM and s.distance > PIT_DISTANCE]
    bad.sort(key=lambda s: s.p_value)
    smallest = min(s.p_value for s in (bad or scans))
    value = min(n * smallest, 1.0) if bad else max(min(n * smallest, 1.0), FALSE_ALARM)
    listed = [
        say("pit.one", label=s.label, departure=say(f"pit.{_departure(s)}", mean=s.mean, sd=s.sd))
        for s in bad[:_LISTED]
    ]
    listed += ["others"] * (len(bad) > _LISTED)
    kinds = [_departure(s) for s in bad]
    if kinds == ["narrow"] * n:
        kinds = ["all_narrow"]
    said = say("pit.found", n=len(bad), all=n, listed="; ".join(listed))
    return judged(
        "pit", value, FALSE_ALARM, WARN if bad else PASS, n=n, statement=said if bad else "",
        advice=" ".join(dict.fromkeys(_remedy(kind, repeatability) for kind in kinds)),
        scans=[s.label for s in bad],
    )  # fmt: skip


def _departure(scan: ScanPit) -> str:
    """Kind of what is wrong with the residuals of a scan."""
    bias = abs(scan.mean) * scan.n**0.5
    spread = abs(scan.sd - 1.0) * (2.0 * scan.n) ** 0.5
    if max(bias, spread) < _CLEAR:
        return "shape"
    if bias >= spread:
        return "biased"
    return "wide" if scan.sd > 1.0 else "narrow"


def _remedy(kind: str, repeatability: Repeatability) -> str:
    if kind.endswith("narrow") and repeatability.stated_beyond_scatter:
        kind = "stated"
    return say(f"pit.{kind}.advice", stated=repeatability.dex, found=repeatability.neighbours_dex)


def judge_holdout(found: Holdout) -> str:
    """Verdict on one prediction of scans that were left out.

    A miss that the band announces, or that is no larger than what the prediction itself leads to
    expect, is a lack of information, not a failure of the model.
    """
    covered = found.coverage_90 >= COVERAGE_WARN[0] - 0.1
    announced = covered and found.rms_dex < 0.5 * found.width_dex
    if announced or found.surprise <= SURPRISE_LIMIT:
        return PASS
    verdict = grade(found.rms_dex, MISFIT_WARN_DEX, MISFIT_FAIL_DEX)
    return WARN if verdict == PASS and not covered else verdict


def judge_recipe(found: Holdout) -> Check:
    """The prediction of the paper's recipe."""
    return judged(
        "holdout", found.rms_dex, MISFIT_FAIL_DEX, judge_holdout(found), statement=found.statement
    )


def judge_families(cases: Sequence[Holdout]) -> tuple[Check, ...]:
    """One verdict over the angles left out, one over the polarisations: that of the worst case."""
    families = {code: [c for c in cases if c.kind == kind] for kind, code in _FAMILIES.items()}
    return tuple(_family(code, found) for code, found in families.items() if found)


def _family(code: str, cases: Sequence[Holdout]) -> Check:
    order = [PASS, WARN, FAIL]
    worst = max(
        cases, key=lambda c: (order.index(judge_holdout(c)), float(np.nan_to_num(c.rms_dex)))
    )
    said = say(
        "holdout.worst", name=worst.name, rms=worst.rms_dex, percent=100.0 * worst.coverage_90,
        width=worst.width_dex,
    )  # fmt: skip
    missed = ", ".join(c.name for c in cases if judge_holdout(c) != PASS)
    return judged(
        code, worst.rms_dex, MISFIT_FAIL_DEX, judge_holdout(worst), n=len(cases), worst=said,
        missed=missed,
    )  # fmt: skip


def judge_prior(found: PriorSensitivity) -> Check:
    """Whether the prior decides a physical parameter, or pulls against the readings."""
    rows = list(
        zip(
            found.names, found.prior.tolist(), found.likelihood.tolist(),
            found.displacement.tolist(), strict=True,
        )
    )  # fmt: skip
    sensitive = [row for row in rows if row[1] > SENSITIVE]
    kinds: dict[str, list[str]] = {"dominated": [], "pulled": [], "shared": []}
    for name, _, likelihood, away in sensitive:
        pulled = "pulled" if abs(away) > DISPLACED else "shared"
        kinds["dominated" if likelihood <= SENSITIVE else pulled].append(name)
    advice = [
        say(f"prior_sensitivity.{kind}", names=", ".join(names))
        for kind, names in kinds.items()
        if names
    ]
    listed = [say("prior_sensitivity.one", name=n, prior=p, readings=q) for n, p, q, _ in sensitive]
    name, prior, likelihood, _ = max(rows, key=lambda row: row[1])
    said = say("prior_sensitivity.found", listed=", ".join(listed))
    return judged(
        "prior_sensitivity", prior, SENSITIVE, WARN if sensitive else PASS, name=name,
        readings=likelihood, statement=said if sensitive else "", advice=" ".join(advice),
    )  # fmt: skip
