"""Which configurations are compared when effects are chosen, and how the choice is put in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.effects_table import (
    ALTERNATIVES,
    LINE_SHAPES,
    SAMPLE_EFFECTS,
    alternatives_in,
)
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.words import say

_FEW_CASES = 2
_PAPER_SHAPE = next(iter(LINE_SHAPES))


def grown(config: RunConfig) -> Iterator[RunConfig]:
    """Configurations with one effect of the sample, or another line shape, more."""
    for name in SAMPLE_EFFECTS:
        effects = (*config.effects, name)
        if name not in config.effects and alternatives_in(effects) is None:
            yield replace(config, effects=effects)
    if config.line_shape == _PAPER_SHAPE:
        for shape in LINE_SHAPES.values():
            if shape.name != _PAPER_SHAPE and not shape.after:
                yield replace(config, line_shape=shape.name)


def alternatives(config: RunConfig) -> Iterator[RunConfig]:
    """The same with an effect in place of its alternative: Lambertian for bulk, or bulk for it."""
    for pair in ALTERNATIVES.items():
        swapped = dict([pair, pair[::-1]])
        if set(swapped) & set(config.effects):
            yield replace(config, effects=tuple(swapped.get(name, name) for name in config.effects))


def of_other_shapes(config: RunConfig) -> Iterator[RunConfig]:
    """The same with the line shapes that come after its own: Gaussian and Voigt after Cauchy.

    The exponent of the Cauchy shape makes the wings of a lobe lighter or heavier than those of the
    Lorentzian, towards the Gaussian as it grows. Where that gains nothing the wings are
    Lorentzian as far as the readings tell, and the Gaussian and what lies between cannot gain
    either: they are worth their time only where the Cauchy shape has been found better.
    """
    for shape in LINE_SHAPES.values():
        if shape.after == config.line_shape:
            yield replace(config, line_shape=shape.name)


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
