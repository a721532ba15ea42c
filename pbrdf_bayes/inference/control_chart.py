"""Control chart for individual values of a parameter over samples, in their order.

With the moving range MR_i = abs(x_i - x_(i-1)) and its mean, the scatter from sample to sample is
estimated by MR / d2, d2 = 2 / sqrt(pi) = 1.128 for ranges of two, and

    limits of the chart:          centre +- 3 MR / d2
    limits for sample i:          centre +- 3 sqrt(sigma_b^2 + u_i^2)
    sigma_b^2 = max(0, (MR / d2)^2 - mean u^2)

where u_i is the standard uncertainty of sample i. The second pair is wider for a sample that is
known less well; with equal uncertainties it is the first, or wider where the uncertainties alone
exceed what the ranges show.

References
----------
W. A. Shewhart, Economic Control of Quality of Manufactured Product (1931); ISO 7870-2:2013,
control charts for individuals with moving ranges.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

D2 = 2.0 / sqrt(pi)
"""Mean range of two values of a normal law, in standard deviations."""
FEWEST_SAMPLES = 4
PROVISIONAL_BELOW = 20
"""Limits from fewer samples are provisional."""


@dataclass(frozen=True, eq=False)
class ControlChart:
    """Centre and limits.

    Attributes
    ----------
    centre, low, high : float
        Of the chart.
    sigma_between : float
        Scatter of the samples without that of their uncertainties.
    sample_low, sample_high : ndarray, shape (n_samples,)
        Limits for each sample, its uncertainty included.
    beyond : ndarray of bool, shape (n_samples,)
        The sample lies beyond its limits.
    """

    centre: float
    low: float
    high: float
    sigma_between: float
    sample_low: Array
    sample_high: Array
    beyond: NDArray[np.bool_]


def draw_limits(
    values: ArrayLike, uncertainties: ArrayLike, counted: ArrayLike
) -> ControlChart | None:
    """Limits from the samples that are counted, for all of them; None where those are too few.

    Parameters
    ----------
    values, uncertainties : array_like, shape (n_samples,)
        In the order of the samples.
    counted : array_like of bool, shape (n_samples,)
        Samples that centre and limits are made from.

    Examples
    --------
    >>> chart = draw_limits([1.0, 2.0, 1.0, 2.0], [0.0] * 4, [True] * 4)
    >>> round(chart.centre, 3), round(chart.high, 3)
    (1.5, 4.159)
    """
    x, u = (np.asarray(v, dtype=np.float64) for v in (values, uncertainties))
    used = np.asarray(counted, dtype=bool)
    if used.sum() < FEWEST_SAMPLES:
        return None
    centre = float(x[used].mean())
    sigma = float(np.abs(np.diff(x[used])).mean() / D2)
    between2 = max(0.0, sigma**2 - float(np.mean(u[used] ** 2)))
    reach = 3.0 * np.sqrt(between2 + u**2)
    return ControlChart(
        centre, centre - 3.0 * sigma, centre + 3.0 * sigma, sqrt(between2),
        centre - reach, centre + reach, np.abs(x - centre) > reach,
    )  # fmt: skip
