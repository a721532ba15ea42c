"""Whether the parameters may be read as properties of the material, or only describe the curves."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.residuals import weight_beside_floor
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import Applicability
from pbrdf_bayes.verdict import (
    CONTRACTION_WARN,
    FAIL,
    HELD_OUT_FAIL_DEX,
    PASS,
    SURPRISE_LIMIT,
    WARN,
    beside_noise,
    misfit_limit_dex,
)
from pbrdf_bayes.words import judged, say

APPLIES, DESCRIPTIVE, DOES_NOT_APPLY = "applies", "descriptive only", "does not apply"


@dataclass(frozen=True)
class Repeatability:
    """How well a reading repeats.

    Attributes
    ----------
    dex : float
        NaN where that is not known [dex].
    source : {"stated", "inferred", "above_stated", "unknown"}
        Stated by the column sigma; inferred from neighbouring readings; the same, and more than is
        stated.
    neighbours_dex : float
        Scatter of neighbouring readings alone [dex].
    """

    dex: float
    source: str
    neighbours_dex: float = np.nan

    @property
    def words(self) -> str:
        """The source in words."""
        return say(f"repeats.{self.source}")

    @property
    def stated_beyond_scatter(self) -> bool:
        """The stated sigma is clearly larger than what neighbouring readings scatter by."""
        return self.source == "stated" and self.dex > _CLEARLY * self.neighbours_dex


NOT_KNOWN = Repeatability(np.nan, "unknown")
_BRIGHT_NOISE = 0.1
"""Relative noise beside which the floor's part counts."""
_CLEARLY = 1.5


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
        return Repeatability(white_noise_dex, "inferred", white_noise_dex)
    relative = brdf.u_value[stated] / brdf.value[stated]
    weight = weight_beside_floor(brdf.value[stated], brdf_floor, _BRIGHT_NOISE)
    scatter = float(np.sqrt(np.average(relative**2, weights=weight)) / np.log(10.0))
    if scatter < white_noise_dex:
        return Repeatability(white_noise_dex, "above_stated", white_noise_dex)
    return Repeatability(scatter, "stated", white_noise_dex)


def held_out_rms(holdouts: Sequence[Holdout]) -> dict[str, float]:
    """Rms [dex] over the predictions of each kind."""
    return _pooled((one.kind, one.rms_dex) for one in holdouts)


def expected_rms(holdouts: Sequence[Holdout]) -> dict[str, float]:
    """Rms [dex] that the predictions of each kind lead to expect, with the margin of surprise."""
    return _pooled((one.kind, SURPRISE_LIMIT * one.expected_dex) for one in holdouts)


def _pooled(found: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Root of the mean square by kind, of the finite ones."""
    squares: dict[str, list[float]] = {}
    for kind, rms in found:
        if np.isfinite(rms):
            squares.setdefault(kind, []).append(rms**2)
    return {kind: float(np.sqrt(np.mean(values))) for kind, values in squares.items()}


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
            found.append(say("assumed.fixed", name=spec.name, value=spec.prior.mean))
        elif spec.name in given and told[spec.name] < CONTRACTION_WARN:
            prior = spec.prior.describe()
            found.append(say("assumed.prior", name=spec.name, prior=prior))
    return tuple(found)


def list_only_bounded(null_at: Collection[str]) -> tuple[str, ...]:
    """What the best fit has at the end of what is possible, in sentences.

    Parameters
    ----------
    null_at : collection of str
        Parameters that an optimum has at their null value, of those that the readings identify.
    """
    return (say("assumed.k_bounded"),) * ("k" in null_at)


def judge_applicability(
    *, best_rms_dex: float, repeatability: Repeatability, at_bound: Collection[str],
    held_out: Mapping[str, float], expected: Mapping[str, float] | None = None,
    untested: str = "", assumed: Sequence[str] = (),
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
    expected : mapping of str to float, optional
        Rms up to which the predictions themselves lead to expect it, see `expected_rms` [dex]:
        few readings predict others badly, whatever the model.
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
        Readings left out predicted worse than 0.10 dex beside their noise and worse than the
        predictions lead to expect, or one of the four
        parameters on its bound: the model does not apply. An rms of more than three times the
        repeatability: it is descriptive only.
    """
    wrong = [say("applicability.bound", name=name) for name in PHYSICAL if name in at_bound]
    limit = beside_noise(HELD_OUT_FAIL_DEX, repeatability.dex)
    wrong += [
        say(f"applicability.{kind}", rms=held_out[kind])
        for kind in ("angle", "polarization")
        if held_out.get(kind, 0.0) > max(limit, (expected or {}).get(kind, 0.0))
    ]
    caveats = tuple(assumed)
    if "angle" in held_out:
        tested = say("applicability.tested", rms=held_out["angle"])
    else:
        tested = say("applicability.untested", why=untested)
        caveats = (f"{tested[0].upper()}{tested[1:]}.", *caveats)
    limit, loose = misfit_limit_dex(repeatability.dex), []
    if best_rms_dex > limit:
        dex, source = repeatability.dex, repeatability.words
        loose = [say("applicability.loose", rms=best_rms_dex, dex=dex, source=source)]
    reasons, verdict, key = (*wrong, *loose), APPLIES, "applies"
    if reasons:
        verdict, key = (DOES_NOT_APPLY, "fails") if wrong else (DESCRIPTIVE, "descriptive")
    said = say(f"applicability.{key}", reasons="; ".join(reasons))
    remedy = say("applicability.tried" if extended else "applicability.try_effects")
    return Applicability(
        verdict, reasons, " ".join([said, *caveats]), remedy if reasons else "", limit,
        repeatability.dex, repeatability.words, tested, caveats,
    )  # fmt: skip


def applicability_diagnostic(found: Applicability, best_rms_dex: float) -> Check:
    """The verdict among the other ones."""
    verdict = {APPLIES: PASS, DESCRIPTIVE: WARN, DOES_NOT_APPLY: FAIL}[found.verdict]
    return judged(
        "applicability", best_rms_dex, found.limit_dex, verdict, statement=found.statement,
        advice=found.advice,
    )  # fmt: skip
