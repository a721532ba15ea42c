"""Quantiles of a mixture of normal laws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Array = NDArray[np.float64]

_FARTHEST = 40.0
"""Standard deviations beyond which a normal law has nothing."""
_TOLERANCE = 1e-10


def mixture_quantiles(
    mean: Array, sd: Array, weight: Array, levels: Sequence[float]
) -> tuple[float, ...]:
    """Where the distribution function of the mixture has each of the levels.

    Parameters
    ----------
    mean, sd, weight : ndarray, shape (n_components,)
        Standard deviations above 0; the weights add up to 1.
    levels : sequence of float
        In (0, 1).

    Examples
    --------
    >>> low, median, high = mixture_quantiles(
    ...     np.array([-1.0, 1.0]), np.array([0.1, 0.1]), np.array([0.5, 0.5]), (0.25, 0.5, 0.75)
    ... )
    >>> round(low, 6), round(high, 6)
    (-1.0, 1.0)
    """
    ends = float((mean - _FARTHEST * sd).min()), float((mean + _FARTHEST * sd).max())
    typical = 1.0 / float(weight @ (1.0 / sd))

    def excess(x: float, level: float) -> float:
        return float(weight @ ndtr((x - mean) / sd) - level)

    return tuple(
        float(brentq(excess, *ends, args=(level,), xtol=_TOLERANCE * typical)) for level in levels
    )
