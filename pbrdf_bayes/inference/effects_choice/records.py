"""What a choice of effects came to: the candidates, and which one was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Scored:
    """A candidate and how it predicts.

    Attributes
    ----------
    name : str
        Effects and line shape in words.
    effects : tuple of str
    line_shape : str
    n_free : int
        Parameters of the model that are not fixed.
    rms_dex, held_out_dex : float
        Of the readings fitted, and of those left out, root mean square over the cases.
    mean_held_out_dex : float
        Mean over the cases of the rms of the readings left out.
    score, difference, u_difference : float
        Mean ln rms of what was left out; that of the best candidate subtracted, with the standard
        error of the paired difference.
    at_bound : tuple of str
        Parameters on a bound that is not their null value.
    microseconds : float
        Of one likelihood evaluation.
    chosen : bool
    """

    name: str
    effects: tuple[str, ...]
    line_shape: str
    n_free: int
    rms_dex: float
    held_out_dex: float
    mean_held_out_dex: float
    score: float
    difference: float
    u_difference: float
    at_bound: tuple[str, ...]
    microseconds: float
    chosen: bool


@dataclass(frozen=True)
class EffectsChoice:
    """All candidates, the smallest first, and which one was taken.

    ``caution`` is what is to be said where too few cases could be left out; ``held_out`` the rms
    [dex] of what the chosen one predicts of readings left out, by the kind of what was left out;
    ``symbols`` those of the parameters that candidates have on their bounds.
    """

    candidates: tuple[Scored, ...]
    cases: tuple[str, ...]
    statement: str
    caution: str
    held_out: Mapping[str, float] = field(default_factory=dict)
    symbols: Mapping[str, str] = field(default_factory=dict)
