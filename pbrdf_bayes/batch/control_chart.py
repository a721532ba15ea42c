"""Control chart for individual values of a parameter over samples, in their order.

With the moving range MR_i = abs(x_i - x_(i-1)) and its mean, the scatter from sample to sample is
estimated by MR / d2, d2 = 2 / sqrt(pi) = 1.128 for ranges of two, and

    limits of the chart:     centre +- 3 MR / d2
    sigma_b^2 = max(0, (MR / d2)^2 - mean u^2)

where u_i is the standard uncertainty of sample i. A sample is held against the m others, so that it
does not widen the limits that it is compared with:

    limits for sample i:     centre' +- t s
    s^2 = sigma_b'^2 + u_i^2 + max((MR' / d2)^2, mean' u^2) / m

where ' leaves sample i out, and t is the quantile of Student's law that leaves out as much as three
standard deviations do of a normal law, with the degrees of freedom that the ranges have, more where
s^2 is u_i^2 for the most part. The sample that lies furthest beyond is taken out, and the rest is
compared again, until none lies beyond or a third is out. Centre and limits of the chart are those
of the samples left.

References
----------
W. A. Shewhart, Economic Control of Quality of Manufactured Product (1931); ISO 7870-2:2013,
control charts for individuals with moving ranges. Degrees of freedom: the variance of the mean of
moving ranges of a normal law, by the correlation of the absolute values of two normal variates
(Nabeya, 1951).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

Array = NDArray[np.float64]

D2 = 2.0 / sqrt(pi)
"""Mean range of two values of a normal law, in standard deviations."""
FEWEST_SAMPLES = 4
PROVISIONAL_BELOW = 20
"""Limits from fewer samples are provisional."""
_MOST_OUT = 1.0 / 3.0
_INSIDE = float(ndtr(3.0))
_VARIANCE = (pi - 2.0) / 2.0
"""Of one range over the square of its mean."""
_CORRELATION = (sqrt(0.75) + 0.5 * asin(0.5) - 1.0) / (pi / 2.0 - 1.0)
"""Of two ranges that share a sample."""


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
        Limits for each sample, made from the others, its uncertainty included.
    beyond : ndarray of bool, shape (n_samples,)
        The sample lies beyond its limits; those of the chart are made without it.
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
        Samples that centre and limits are made from, but for those that lie beyond.

    Examples
    --------
    >>> chart = draw_limits([1.0, 2.0, 1.0, 2.0], [0.0] * 4, [True] * 4)
    >>> round(chart.centre, 3), round(chart.high, 3)
    (1.5, 4.159)
    """
    x, u = (np.asarray(v, dtype=np.float64) for v in (values, uncertainties))
    kept = np.flatnonzero(np.asarray(counted, dtype=bool))
    if kept.size < FEWEST_SAMPLES:
        return None
    fewest = max(FEWEST_SAMPLES, kept.size - int(_MOST_OUT * kept.size))
    while True:
        low, high = _limits(x, u, kept)
        excess = np.abs(x - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-300)
        worst = int(np.argmax(excess[kept]))
        if kept.size <= fewest or excess[kept[worst]] <= 1.0:
            break
        kept = np.delete(kept, worst)
    centre, sigma = float(x[kept].mean()), float(np.abs(np.diff(x[kept])).mean() / D2)
    between2 = max(0.0, sigma**2 - float(np.mean(u[kept] ** 2)))
    return ControlChart(
        centre, centre - 3.0 * sigma, centre + 3.0 * sigma, sqrt(between2), low, high, excess > 1.0
    )


def _limits(x: Array, u: Array, kept: NDArray[np.int64]) -> tuple[Array, Array]:
    """Limits of every sample from those that are kept, itself left out."""
    n, y, v = kept.size, x[kept], u[kept] ** 2
    ranges = np.abs(np.diff(y))
    m, n_ranges = np.full(x.size, n), np.full(x.size, n - 1)
    centre = np.full(x.size, y.mean())
    mean_range = np.full(x.size, ranges.mean())
    mean_v = np.full(x.size, v.mean())
    m[kept], n_ranges[kept] = n - 1, n - 2
    centre[kept] = (y.sum() - y) / (n - 1)
    mean_v[kept] = (v.sum() - v) / (n - 1)
    # without a sample its two ranges go, and one over the gap comes
    gone = np.concatenate([[0.0], ranges]) + np.concatenate([ranges, [0.0]])
    gap = np.concatenate([[0.0], np.abs(y[2:] - y[:-2]), [0.0]])
    mean_range[kept] = (ranges.sum() - gone + gap) / (n - 2)

    freedom = _degrees_of_freedom(n_ranges)
    scatter = (mean_range / D2 * (1.0 - 0.25 / freedom)) ** 2  # not that of the mean of its root
    wide = np.maximum(0.0, scatter - mean_v) + u**2 + np.maximum(scatter, mean_v) / m
    # Welch and Satterthwaite: only the scatter is estimated, which may be small by chance
    estimated = np.maximum(np.maximum(scatter, 0.5 * mean_v), 1e-300)
    freedom = np.minimum(freedom * np.maximum(1.0, wide / estimated) ** 2, 1e9)
    reach = stdtrit(freedom, _INSIDE) * np.sqrt(wide)
    return centre - reach, centre + reach


def _degrees_of_freedom(n_ranges: NDArray[np.int64]) -> Array:
    """Those of the law of chi with the relative variance of the mean range."""
    variance = _VARIANCE / n_ranges * (1.0 + 2.0 * _CORRELATION * (n_ranges - 1) / n_ranges)
    return np.asarray(0.5 / variance)
