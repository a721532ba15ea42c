"""The law of a BRDF reading: its mean, its noise, and what it shares with others.

For the reading a of scan j in group g (the scans of one angle of incidence, plane and
polarisation), with model BRDF f and instrument floor b (noise-equivalent BRDF):

    y_a = ln(reading) = 1/2 ln(f_a^2 + b^2) + h_a [ c_j + d_g(theta_r,a) + sum_m z_m S_ma ] + e_a
    h_a = f_a^2/(f_a^2 + b^2),   e_a ~ N(0, s_q^2 + u_a^2 + b^2/(f_a^2 + b^2))
    c_j ~ N(0, u_cal^2),   d_g a Matérn process,   z_m ~ N(0, 1)

s_q is the inferred relative noise of polarisation q, u_a what the laboratory states for the reading
and S_ma the sensitivity of ln f_a to the systematic error m times its standard uncertainty. Gain,
discrepancy and errors are those of the BRDF: h_a is how much of them is left beside the floor, to
first order. It counts as `LEAST_SHARE` where it is less.

Over h_a a reading is one of the sum in brackets, with noise of variance v_a/h_a^2: that is how the
likelihoods take it. Two other kinds of noise stand on the same mean, h_a and v_a: Student's t of
scale sqrt(v_a), and a reading at or below the floor, of which only that is known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log

Array = NDArray[np.float64]

LEAST_SHARE = 1e-6
"""Smallest h: nothing of the BRDF is left there."""
_MOST_RISE = -float(np.log(LEAST_SHARE))
_FAINTEST, _BRIGHTEST = -300.0, 300.0
_TINY = 1e-280


class Law(NamedTuple):
    """Mean of ln(reading), h and variance of the noise of readings, arrays of one shape."""

    mean: Array
    share: Array
    variance: Array


@compiled(inline=True)
def beside_floor(log_f: float, floor2: float) -> tuple[float, float, float, float]:
    """Mean of ln(reading), f^2/(f^2 + b^2), b^2/(f^2 + b^2) and -ln h, at ln f and b^2 > 0."""
    bright = min(max(log_f, _FAINTEST), _BRIGHTEST)
    ratio = floor2 * exp(-2.0 * bright)
    share = 1.0 / (1.0 + ratio)
    rise = log(1.0 + ratio)
    return bright + 0.5 * rise, share, ratio * share, min(rise, _MOST_RISE)


@compiled()
def _fill_law(log_f: Array, floor2: float, mean: Array, share: Array, variance: Array) -> None:
    for i in range(log_f.size):
        mean[i], above, variance[i], _ = beside_floor(log_f[i], floor2)
        share[i] = max(above, LEAST_SHARE)


@compiled()
def fill_scaled(
    y: Array, log_f: Array, stated2: Array, s2: float, floor2: float, residual: Array, above: Array,
    extra: Array, rise: Array,
) -> None:  # fmt: skip
    """Residuals over h and variances over h^2 of rows beside a floor.

    Parameters
    ----------
    y, log_f : ndarray, shape (n_rows,)
        ln of readings and of the model.
    stated2 : ndarray, shape (n_rows,)
        u^2 of each row.
    s2, floor2 : float
        s_q^2 and b^2 > 0.
    residual, above, extra, rise : ndarray, shape (n_rows,)
        Receive (y - mean)/h, f^2/(f^2 + b^2), v/h^2 - s_q^2 and -ln h.
    """
    for i in range(y.size):
        mean, share, of_floor, rise[i] = beside_floor(log_f[i], floor2)
        over = 1.0 / max(share, LEAST_SHARE)
        above[i] = share
        residual[i] = (y[i] - mean) * over
        extra[i] = (s2 + stated2[i] + of_floor) * over * over - s2


@compiled()
def slopes_by_log_f(
    s2: float, residual: Array, above: Array, extra: Array, censored: NDArray[np.bool_],
    by_mean: Array, by_variance: Array,
) -> float:  # fmt: skip
    """Chain rule from rows over h to ln f and s_q^2.

    Parameters
    ----------
    s2 : float
        s_q^2.
    residual, above, extra : ndarray, shape (n_rows,)
        From `fill_scaled`; without a floor ``above`` is 1.
    censored : ndarray of bool, shape (n_rows,)
    by_mean, by_variance : ndarray, shape (n_rows,)
        Slopes of the log-likelihood by mean and variance of the row over h. The first are replaced
        by those by ln f.

    Returns
    -------
    float
        The slope by s_q^2.
    """
    by_s2 = 0.0
    for i in range(by_mean.size):
        h, below = max(above[i], LEAST_SHARE), 1.0 - above[i]
        by_v = by_variance[i]
        by_s2 += by_v / (h * h)
        by_h = 2.0 * residual[i] * by_mean[i] - 4.0 * by_v * (s2 + extra[i])
        by_h -= 0.0 if censored[i] else 2.0
        by_h *= below if above[i] > LEAST_SHARE else 0.0
        by_mean[i] = above[i] / h * (by_mean[i] - 2.0 * by_v * below / h) + by_h
    return by_s2


def reading_law(brdf: ArrayLike, floor: float, white: Array | float = 0.0) -> Law:
    """Mean, h and variance of ln(reading).

    Parameters
    ----------
    brdf : array_like
        Model BRDF f [sr^-1].
    floor : float
        Noise-equivalent BRDF b [sr^-1].
    white : ndarray or float
        s_q^2 + u_a^2 [1], of a shape that broadcasts to that of ``brdf``.

    Returns
    -------
    Law

    Examples
    --------
    >>> mean, share, variance = reading_law([1.0, 0.0], 1.0, 0.01)
    >>> mean.round(3).tolist(), share.round(3).tolist(), variance.round(3).tolist()
    ([0.347, 0.0], [0.5, 0.0], [0.51, 1.01])
    """
    log_f = np.log(np.maximum(np.asarray(brdf, dtype=np.float64), _TINY))
    mean, share, variance = log_f.copy(), np.ones(log_f.shape), np.zeros(log_f.shape)
    if floor > 0.0:
        parts = (part.reshape(-1) for part in (mean, share, variance))
        _fill_law(np.ascontiguousarray(log_f).reshape(-1), floor * floor, *parts)
    return Law(mean, share, variance + white)


def draw_readings(law: Law, effect: Array | float, normal: Array) -> Array:
    """Ln of readings with the sum in brackets ``effect`` and noise of ``normal`` sd."""
    return np.asarray(law.mean + law.share * effect + np.sqrt(law.variance) * normal)
