"""Verdicts on predictions: readings and scans left out, and what the prior has to say in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut
from pbrdf_bayes.inference.sampling.power_scaling import PriorSensitivity
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
    Diagnostic,
    grade,
)
from pbrdf_bayes.verdicts.applicability import NOT_KNOWN, Repeatability

_LISTED = 3
_CLEAR = 4.0
_PIT_ADVICE = {
    "shape": "Residuals that are not normal: look for outliers and for angles where the model "
    "bends otherwise than the readings.",
    "biased": "A biased scan: its scale or its alignment is off, or the model is there. Say how "
    "well the scale is known (u_brdf_cal), or leave it free (brdf_scale = 'relative').",
    "wide": "Residuals wider than the noise of their polarisation: intervals and bands are too "
    "narrow for that scan.",
    "narrow": "Residuals narrower than the noise of their polarisation: another scan inflates it.",
    "all narrow": "Residuals of every scan are narrower than the noise that is taken for them: the "
    "prior of that noise (s_rel) holds it up, or the readings were smoothed.",
}
_FAMILIES = {
    "angle": ("holdout_angles", "Prediction of angles left out", "angles of incidence", "others"),
    "polarization": (
        "holdout_polarization", "Prediction of the other polarisation", "polarisations", "other",
    ),
}  # fmt: skip


def judge_readings(
    found: LeaveOneOut, repeatability: Repeatability = NOT_KNOWN
) -> tuple[Diagnostic, ...]:
    """Influence of single readings, readings at odds, the PIT of scans."""
    verdicts = [_influence(found)]
    if found.farthest:
        verdicts.append(_outliers(found))
    if found.scans:
        verdicts.append(_pit(found.scans, repeatability))
    return tuple(verdicts)


def _influence(found: LeaveOneOut) -> Diagnostic:
    worst = found.most_influential[0]
    verdict = PASS if worst.k_hat <= INFLUENCE_WARN else WARN
    many = found.n_influential
    statement = (
        f"Each of {found.n_readings} readings predicted from all others: log density "
        f"{found.elpd:.0f} ± {found.u_elpd:.0f}, {found.p_loo:.1f} effective parameters; largest "
        f"Pareto k-hat {worst.k_hat:.2f}, of {_place(worst)}."
    )
    if many and verdict == PASS:
        have, own = ("has", "it was") if many == 1 else ("have", "they were")
        statement += (
            f" {many} {have} much weight in the posterior (k-hat above {found.k_hat_limit:.2f} "
            f"until {own} left out of a sample made for that)."
        )
    dominant = [r for r in found.most_influential if r.k_hat > INFLUENCE_WARN][:_LISTED]
    advice = (
        f"The posterior hangs on single readings: {'; '.join(map(_place, dominant))}. Measure them "
        "again, or flag them and compare the two fits."
        if verdict == WARN
        else ""
    )
    return Diagnostic(
        "loo", "Leave-one-out (Pareto k-hat)", worst.k_hat, INFLUENCE_WARN, "1", verdict,
        statement, advice,
    )  # fmt: skip


def _outliers(found: LeaveOneOut) -> Diagnostic:
    """Two-sided, shared by all readings."""
    z = found.pointwise.z[np.isfinite(found.pointwise.z)]
    limit = float(-ndtri(0.5 * FALSE_ALARM / z.size))
    beyond = int(np.sum(np.abs(z) > limit))
    worst = found.farthest[0]
    named = [f"{_place(r)}, {r.z:+.1f} sd" for r in found.farthest if abs(r.z) > limit][:_LISTED]
    statement = (
        f"{beyond} of {z.size} readings {'lies' if beyond == 1 else 'lie'} where all others would "
        f"not have them: {'; '.join(named)}{' and others' * (beyond > len(named))}."
        if beyond
        else f"The reading farthest from what all others predict is {_place(worst)}, "
        f"{worst.z:+.1f} standard deviations."
    )
    advice = (
        "Look at them in the laboratory's records: a slip, stray light, the detector's shadow. "
        "They widen the inferred noise and pull the parameters; flag what is wrong and fit again."
        if beyond
        else ""
    )
    return Diagnostic(
        "outliers", "Readings at odds with all others", abs(worst.z), limit, "sd",
        WARN if beyond else PASS, statement, advice,
    )  # fmt: skip


def _place(reading: Influential) -> str:
    line = f", line {reading.row}" if reading.row else ""
    return f"{reading.label} at {reading.angle_deg:g} deg{line}"


def _pit(scans: Sequence[ScanPit], repeatability: Repeatability) -> Diagnostic:
    """Kolmogorov-Smirnov scan by scan, the probability of a false alarm shared by the scans."""
    n = len(scans)
    bad = [s for s in scans if n * s.p_value < FALSE_ALARM and s.distance > PIT_DISTANCE]
    bad.sort(key=lambda s: s.p_value)
    smallest = min(s.p_value for s in (bad or scans))
    value = min(n * smallest, 1.0) if bad else max(min(n * smallest, 1.0), FALSE_ALARM)
    named = [f"scan {s.label}, {_departure(s)[0]}" for s in bad[:_LISTED]]
    statement = (
        f"In {len(bad)} of {n} scans the readings do not lie in what all others predict as chance "
        f"would have it: {'; '.join(named)}{' and others' * (len(bad) > _LISTED)}."
        if bad
        else f"In each of {n} scans the readings are spread over what all others predict as chance "
        "would have it."
    )
    kinds = [_departure(s)[1] for s in bad]
    if kinds == ["narrow"] * n:
        kinds = ["all narrow"]
    advice = " ".join(dict.fromkeys(_remedy(kind, repeatability) for kind in kinds))
    return Diagnostic(
        "pit", "Probability integral transform by scan (p-value)", value, FALSE_ALARM, "1",
        WARN if bad else PASS, statement, advice,
    )  # fmt: skip


def _departure(scan: ScanPit) -> tuple[str, str]:
    """What is wrong with the residuals of a scan, in words and as a kind of it."""
    bias = abs(scan.mean) * scan.n**0.5
    spread = abs(scan.sd - 1.0) * (2.0 * scan.n) ** 0.5
    if max(bias, spread) < _CLEAR:
        words, kind = "tails or skewness of the residuals", "shape"
    elif bias >= spread:
        words, kind = f"residuals biased (mean {scan.mean:+.1f} sd)", "biased"
    elif scan.sd > 1.0:
        words, kind = f"residuals too wide (sd {scan.sd:.1f})", "wide"
    else:
        words, kind = f"residuals too narrow (sd {scan.sd:.1f})", "narrow"
    return words, kind


def _remedy(kind: str, repeatability: Repeatability) -> str:
    """What to do about a kind of departure."""
    if kind.endswith("narrow") and repeatability.stated_beyond_scatter:
        return (
            f"The column sigma states {repeatability.dex:.3f} dex where neighbouring readings "
            f"scatter by {repeatability.neighbours_dex:.3f} dex. The likelihood takes sigma as "
            "noise of each reading by itself; what the readings of a scan share (the gain of a "
            "run, the scale) is none. State the scatter of single readings in sigma, and the "
            "shared part in u_brdf_cal, or leave the scale free (brdf_scale = 'relative')."
        )
    return _PIT_ADVICE[kind]


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


def judge_recipe(found: Holdout) -> Diagnostic:
    """The prediction of the paper's recipe."""
    verdict = judge_holdout(found)
    return Diagnostic(
        "holdout", "Prediction of scans not fitted", found.rms_dex, MISFIT_FAIL_DEX, "dex", verdict,
        found.statement,
        "" if verdict == PASS else "Curves at angles that were not measured are less certain than "
        "their bands say.",
    )  # fmt: skip


def judge_families(cases: Sequence[Holdout]) -> tuple[Diagnostic, ...]:
    """One verdict over the angles left out, one over the polarisations: that of the worst case."""
    families = {kind: [c for c in cases if c.kind == kind] for kind in _FAMILIES}
    return tuple(_family(kind, found) for kind, found in families.items() if found)


def _family(kind: str, cases: Sequence[Holdout]) -> Diagnostic:
    name, title, words, others = _FAMILIES[kind]
    order = [PASS, WARN, FAIL]
    worst = max(
        cases, key=lambda c: (order.index(judge_holdout(c)), float(np.nan_to_num(c.rms_dex)))
    )
    verdict = judge_holdout(worst)
    missed = [c.name for c in cases if judge_holdout(c) != PASS]
    statement = (
        f"{len(cases)} {words} predicted from the {others}: at worst {worst.name}, within "
        f"{worst.rms_dex:.3f} dex rms, {100 * worst.coverage_90:.0f} % of its readings inside the "
        f"90 % predictive band, which is {worst.width_dex:.3f} dex wide."
    )
    advice = {
        "angle": f"Not predicted as well as the bands say: {', '.join(missed)}. The model does not "
        "carry over between angles of incidence: curves at angles not measured are less certain "
        "than their bands.",
        "polarization": f"Not predicted as well as the bands say: {', '.join(missed)}. One set of "
        "n, k, σ_N0 and ρ_0 does not describe both polarisations: check the polariser and the "
        "scale of either, and do not quote n and k.",
    }[kind]
    return Diagnostic(
        name, title, worst.rms_dex, MISFIT_FAIL_DEX, "dex", verdict, statement,
        "" if verdict == PASS else advice,
    )  # fmt: skip


def judge_prior(found: PriorSensitivity) -> Diagnostic:
    """Whether the prior decides a physical parameter, or pulls against the readings."""
    rows = list(
        zip(
            found.names, found.prior.tolist(), found.likelihood.tolist(),
            found.displacement.tolist(), strict=True,
        )
    )  # fmt: skip
    sensitive = [row for row in rows if row[1] > SENSITIVE]
    dominated = [n for n, _, q, _ in sensitive if q <= SENSITIVE]
    pulled = [
        n
        for n, _, likelihood, away in sensitive
        if likelihood > SENSITIVE and abs(away) > DISPLACED
    ]
    shared = [n for n, *_ in sensitive if n not in dominated and n not in pulled]
    advice = []
    if dominated:
        advice.append(
            f"{', '.join(dominated)}: the prior decides, not the readings. Quote with the prior, "
            "or add readings that tell (both polarisations, DHR)."
        )
    if pulled:
        advice.append(
            f"{', '.join(pulled)}: prior and readings pull apart. Check the preset of priors "
            "against the material, and the readings against their scale."
        )
    if shared:
        advice.append(
            f"{', '.join(shared)}: prior and readings share the decision. Defend the prior, or fit "
            "with a wider one and compare."
        )
    name, prior, likelihood, _ = max(rows, key=lambda row: row[1])
    listed = [f"{n} ({p:.2f} against {q:.2f} to the readings)" for n, p, q, _ in sensitive]
    return Diagnostic(
        "prior_sensitivity", "Sensitivity to the prior (power scaling)", prior, SENSITIVE, "1",
        WARN if sensitive else PASS,
        f"Sensitive to the power of the prior: {', '.join(listed)}."
        if sensitive
        else f"No physical parameter is sensitive to the power of the prior: at most {prior:.3f} "
        f"({name}), against {likelihood:.2f} to that of the readings.",
        " ".join(advice),
    )  # fmt: skip
