"""Whether the parameters may be read as properties of the material, or only describe the curves."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.residuals import weight_beside_floor
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.records.summary import Applicability
from pbrdf_bayes.verdict import (
    CONTRACTION_WARN,
    FAIL,
    HELD_OUT_FAIL_DEX,
    PASS,
    WARN,
    Diagnostic,
    beside_noise,
    misfit_limit_dex,
)

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
class Repeatability:
    """How well a reading repeats [dex], NaN where that is not known, and where it is known from.

    ``neighbours_dex`` is the scatter of neighbouring readings alone [dex].
    """

    dex: float
    words: str
    neighbours_dex: float = np.nan

    @property
    def stated_beyond_scatter(self) -> bool:
        """The stated sigma is clearly larger than what neighbouring readings scatter by."""
        return self.words == STATED and self.dex > _CLEARLY * self.neighbours_dex


NOT_KNOWN = Repeatability(np.nan, "not known")
_BRIGHT_NOISE = 0.1
"""Relative noise beside which the floor's part counts."""
_CLEARLY = 1.5
STATED = "stated by the column sigma"
INFERRED = "inferred from the scatter of neighbouring readings"


def find_repeatability(
    measurement: Measurement, white_noise_dex: float, brdf_floor: float = 0.0
) -> Repeatability:
    """The larger of what the column sigma states and the white noise between neighbours.

    Parameters
    ----------
    measurement : Measurement
        ``u_value`` of its rows is sigma, that of the mean where ``n_repeats`` was given.
    white_noise_dex : float
        See `pbrdf_bayes.inference.prediction.residuals.white_noise_dex` [dex].
    brdf_floor : float
        Readings that come near it count less [sr^-1].

    Returns
    -------
    Repeatability
        Stated: rms of sigma/value/ln(10) over the rows that state one. Repeated scans that differ
        by a gain or by their ends are told by that column alone: their mean is smooth.
    """
    brdf = measurement.brdf
    stated = (brdf.value > brdf_floor) & np.isfinite(brdf.u_value)
    if not stated.any():
        if not np.isfinite(white_noise_dex):
            return NOT_KNOWN
        return Repeatability(white_noise_dex, INFERRED, white_noise_dex)
    relative = brdf.u_value[stated] / brdf.value[stated]
    weight = weight_beside_floor(brdf.value[stated], brdf_floor, _BRIGHT_NOISE)
    scatter = float(np.sqrt(np.average(relative**2, weights=weight)) / np.log(10.0))
    if scatter < white_noise_dex:
        words = f"{INFERRED}, more than is {STATED}"
        return Repeatability(white_noise_dex, words, white_noise_dex)
    return Repeatability(scatter, STATED, white_noise_dex)


def held_out_rms(holdouts: Sequence[Holdout]) -> dict[str, float]:
    """Rms [dex] over the predictions of each kind."""
    squares: dict[str, list[float]] = {}
    for one in holdouts:
        if np.isfinite(one.rms_dex):
            squares.setdefault(one.kind, []).append(one.rms_dex**2)
    return {kind: float(np.sqrt(np.mean(found))) for kind, found in squares.items()}


def list_assumed(
    specs: Sequence[ParameterSpec], given: Collection[str], told: Mapping[str, float]
) -> tuple[str, ...]:
    """Which of the four parameters were assumed rather than measured, in sentences.

    Parameters
    ----------
    specs : sequence of ParameterSpec
    given : collection of str
        Parameters whose prior the configuration gives.
    told : mapping of str to float
        Share of the prior variance that the readings explain, of the parameters that are not fixed.
    """
    found = []
    for spec in specs:
        if spec.name not in PHYSICAL:
            continue
        if spec.is_fixed:
            found.append(f"{spec.name} = {spec.prior.mean:g} was assumed, not measured.")
        elif spec.name in given and told[spec.name] < CONTRACTION_WARN:
            found.append(
                f"{spec.name} was assumed by its prior, {spec.prior.describe()}, "
                "rather than measured."
            )
    return tuple(found)


def list_only_bounded(null_at: Collection[str]) -> tuple[str, ...]:
    """What the best fit has at the end of what is possible, in sentences.

    Parameters
    ----------
    null_at : collection of str
        Parameters that an optimum has at their null value, of those that the readings identify.
    """
    bounded = "k is 0 at the best fit: the readings tell how large it is at most, and no value."
    return (bounded,) * ("k" in null_at)


def judge_applicability(
    *, best_rms_dex: float, repeatability: Repeatability, at_bound: Collection[str],
    held_out: Mapping[str, float], untested: str = "", assumed: Sequence[str] = (),
    extended: bool = False,
) -> Applicability:  # fmt: skip
    """Apply the three criteria.

    Parameters
    ----------
    best_rms_dex : float
        Rms at the least-squares optimum [dex].
    repeatability : Repeatability
        See `find_repeatability`.
    at_bound : collection of str
        Parameters that are pressed against the bound of their prior.
    held_out : mapping of str to float
        Rms of readings left out, by the kind of what was left out, "angle" or "polarization" [dex].
    untested : str
        Why no angle was left out, or how to have that done, where none was.
    assumed : sequence of str
        Sentences on what was assumed or bounded from above only, see `list_assumed` and
        `list_only_bounded`.
    extended : bool
        Effects were tried or are part of the model: the advice is not to try them again.

    Returns
    -------
    Applicability
        Readings left out predicted worse than 0.10 dex beside their noise, or one of the four
        parameters on its bound: the model does not apply. An rms of more than three times the
        repeatability: it is descriptive only.
    """
    wrong = [f"{name} is at the bound of its prior" for name in PHYSICAL if name in at_bound]
    for kind, words in (("angle", "angles"), ("polarization", "the other polarisation")):
        rms = held_out.get(kind, 0.0)
        if rms > beside_noise(HELD_OUT_FAIL_DEX, repeatability.dex):
            wrong.append(f"{words} left out are predicted to {rms:.2f} dex only")
    caveats = list(assumed)
    if "angle" in held_out:
        tested = f"angles left out are predicted to {held_out['angle']:.3f} dex"
    else:
        tested = f"not tested: prediction of angles left out{untested}"
        caveats.insert(0, f"N{tested[1:]}.")
    limit = misfit_limit_dex(repeatability.dex)
    loose = []
    if best_rms_dex > limit:
        loose.append(
            f"the rms is {best_rms_dex:.3f} dex where readings repeat to {repeatability.dex:.3f} "
            f"dex ({repeatability.words})"
        )
    basis = (limit, repeatability.dex, repeatability.words, tested, tuple(caveats))
    verdict = DOES_NOT_APPLY if wrong else DESCRIPTIVE if loose else APPLIES
    reasons = (*wrong, *loose)
    if not reasons:
        words = " ".join(["Nothing speaks against the model for this material.", *caveats])
        return Applicability(verdict, (), words, "", *basis)
    lead = "The model does not apply" if wrong else "The model is descriptive only"
    words = " ".join([f"{lead}: {'; '.join(reasons)}. {_NOT_CONSTANTS}", *caveats])
    return Applicability(verdict, reasons, words, _LOOK if extended else _TRY_EFFECTS, *basis)


def applicability_diagnostic(found: Applicability, best_rms_dex: float) -> Diagnostic:
    """The verdict among the other ones."""
    verdict = {APPLIES: PASS, DESCRIPTIVE: WARN, DOES_NOT_APPLY: FAIL}[found.verdict]
    return Diagnostic(
        "applicability", "Applicability of the model", best_rms_dex, found.limit_dex, "dex",
        verdict, found.statement, found.advice,
    )  # fmt: skip
