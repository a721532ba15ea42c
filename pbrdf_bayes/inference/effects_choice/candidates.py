"""Which configurations are compared when effects are chosen, and how the choice is put in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pbrdf_bayes.config import SAMPLE_EFFECTS, RunConfig
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.words import say

_FEW_CASES = 2
_OTHER_SHAPES = ("gaussian", "voigt")


def grown(config: RunConfig) -> Iterator[RunConfig]:
    """Configurations with one effect of the sample, or the Cauchy line shape, more."""
    for name in SAMPLE_EFFECTS:
        effects = (*config.effects, name)
        if name not in config.effects and not {"lambert", "bulk"} <= set(effects):
            yield replace(config, effects=effects)
    if config.line_shape == "lorentzian":
        yield replace(config, line_shape="cauchy")


def alternatives(config: RunConfig) -> Iterator[RunConfig]:
    """The same with Lambertian in place of bulk scatter, or bulk in place of Lambertian."""
    swapped = {"lambert": "bulk", "bulk": "lambert"}
    if set(swapped) & set(config.effects):
        yield replace(config, effects=tuple(swapped.get(name, name) for name in config.effects))


def of_other_shapes(config: RunConfig) -> Iterator[RunConfig]:
    """The same with a Gaussian and with a Voigt line shape.

    The exponent of the Cauchy shape makes the wings of a lobe lighter or heavier than those of the
    Lorentzian, towards the Gaussian as it grows. Where that gains nothing the wings are
    Lorentzian as far as the readings tell, and the Gaussian and what lies between cannot gain
    either: they are worth their time only where the Cauchy shape has been found better.
    """
    for shape in _OTHER_SHAPES:
        yield replace(config, line_shape=shape)


def in_words(config: RunConfig) -> str:
    """What is added to the four parameters."""
    return " + ".join(config.additions) or "four parameters"


def nothing_left_out(measurement: Measurement) -> str:
    """Why there is no case."""
    if not measurement.scans:
        return "Without BRDF scans there is no curve to predict"
    return "BRDF scans are at one angle of incidence and of one polarisation only"


def caution(n_cases: int) -> str:
    """What is to be said of a choice made by so few cases; nothing where there are enough.

    Examples
    --------
    >>> caution(2)[:40]
    'The choice has almost no statistics behi'
    >>> caution(3)
    ''
    """
    if not n_cases:
        return say("effects.no_statistics")
    return say("effects.few", n=n_cases) if n_cases <= _FEW_CASES else ""
