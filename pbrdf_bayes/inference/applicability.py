"""Whether the parameters may be read as properties of the material, or only describe the curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbrdf_bayes.inference.holdout import Holdout
from pbrdf_bayes.inference.parameters import PHYSICAL
from pbrdf_bayes.inference.verdicts import (
    BOUND_SHARE_WARN,
    FAIL,
    HELD_OUT_FAIL_DEX,
    PASS,
    WARN,
    Diagnostic,
    beside_noise,
    misfit_limit_dex,
)
from pbrdf_bayes.measurement import Measurement

APPLIES, DESCRIPTIVE, DOES_NOT_APPLY = "applies", "descriptive only", "does not apply"
_NOT_CONSTANTS = (
    "n and k are then not material constants, and their uncertainties are not valid as such."
)
_TRY_EFFECTS = (
    "Try what else the sample does: fit with --effects auto, and look at the residuals for the "
    "angle at which the misfit starts."
)
_LOOK = (
    "No effect that was tried explains the rest: look at the residuals for the angle at which the "
    "misfit starts."
)


@dataclass(frozen=True)
class Applicability:
    """Verdict on the model as a description of the material.

    Attributes
    ----------
    verdict : {"applies", "descriptive only", "does not apply"}
    reasons : tuple of str
        What speaks against it, with the numbers; empty where nothing does.
    statement, advice : str
    limit_dex : float
        Rms beyond which the model is descriptive only [dex].
    """

    verdict: str
    reasons: tuple[str, ...]
    statement: str
    advice: str
    limit_dex: float


def repeatability_dex(measurement: Measurement, white_noise_dex: float) -> float:
    """How well a reading repeats: the larger of white noise and stated scatter of repeats [dex].

    NaN where neither is known.
    """
    brdf = measurement.brdf
    stated = brdf.repeated & (brdf.value > 0.0) & np.isfinite(brdf.u_value)
    scatter = np.nan
    if stated.any():
        relative = brdf.u_value[stated] / brdf.value[stated]
        scatter = float(np.sqrt(np.mean(relative**2)) / np.log(10.0))
    return float(np.fmax(white_noise_dex, scatter))


def judge_applicability(
    *, best_rms_dex: float, repeatability: float, bound_share: Sequence[float],
    names: Sequence[str], holdouts: Sequence[Holdout], extended: bool = False,
) -> Applicability:  # fmt: skip
    """Apply the three criteria.

    Parameters
    ----------
    best_rms_dex : float
        Rms at the least-squares optimum [dex].
    repeatability : float
        See `repeatability_dex` [dex].
    bound_share : sequence of float
        Posterior probability at the bound of the parameters ``names``.
    names : sequence of str
    holdouts : sequence of Holdout
        All predictions of readings left out.
    extended : bool
        Effects were tried or are part of the model: the advice is not to try them again.

    Returns
    -------
    Applicability
        Readings left out predicted worse than 0.10 dex beside their noise, or one of the four
        parameters on its bound: the model does not apply. An rms of more than three times the
        repeatability: it is descriptive only.
    """
    wrong = [
        f"{name} is at the bound of its prior"
        for name, share in zip(names, bound_share, strict=True)
        if name in PHYSICAL and share > BOUND_SHARE_WARN
    ]
    for kind, words in (("angle", "angles"), ("polarization", "the other polarisation")):
        squares = [h.rms_dex**2 for h in holdouts if h.kind == kind and np.isfinite(h.rms_dex)]
        rms = float(np.sqrt(np.mean(squares))) if squares else 0.0
        if rms > beside_noise(HELD_OUT_FAIL_DEX, repeatability):
            wrong.append(f"{words} left out are predicted to {rms:.2f} dex only")
    limit = misfit_limit_dex(repeatability)
    loose = []
    if best_rms_dex > limit:
        loose.append(
            f"the rms is {best_rms_dex:.3f} dex where readings repeat to {repeatability:.3f} dex"
        )
    verdict = DOES_NOT_APPLY if wrong else DESCRIPTIVE if loose else APPLIES
    reasons = (*wrong, *loose)
    if not reasons:
        words = "Nothing speaks against the model for this material."
        return Applicability(verdict, (), words, "", limit)
    lead = "The model does not apply" if wrong else "The model is descriptive only"
    words = f"{lead}: {'; '.join(reasons)}. {_NOT_CONSTANTS}"
    return Applicability(verdict, reasons, words, _LOOK if extended else _TRY_EFFECTS, limit)


def applicability_diagnostic(found: Applicability, best_rms_dex: float) -> Diagnostic:
    """The verdict among the other ones."""
    verdict = {APPLIES: PASS, DESCRIPTIVE: WARN, DOES_NOT_APPLY: FAIL}[found.verdict]
    return Diagnostic(
        "applicability", "Applicability of the model", best_rms_dex, found.limit_dex, "dex",
        verdict, found.statement, found.advice,
    )  # fmt: skip
