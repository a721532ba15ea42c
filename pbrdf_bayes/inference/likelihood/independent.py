"""A scan of independent rows of different variances, some censored: its likelihood.

Rows are those of `readings.observation` over h. The gain of the scan is marginalised in closed form
beside the readings above the floor, and over Gauss-Hermite nodes beside censored ones.
"""

from __future__ import annotations

from math import erfc, pi, sqrt
from math import log as scalar_log

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.brdf import sum_of
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import log

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LN_2PI = scalar_log(2.0 * pi)
_GAIN_NODES, _GAIN_WEIGHTS = np.polynomial.hermite_e.hermegauss(24)
_GAIN_LOG_WEIGHTS = np.log(_GAIN_WEIGHTS / np.sqrt(2.0 * np.pi))


@compiled()
def log_normal_cdf(z: float) -> float:
    """Ln Phi(z), without underflow for z down to -1e150."""
    if z > -20.0:
        return scalar_log(0.5 * erfc(-z / sqrt(2.0)))
    z2 = 1.0 / (z * z)
    series = 1.0 - z2 * (1.0 - 3.0 * z2 * (1.0 - 5.0 * z2 * (1.0 - 7.0 * z2)))
    return -0.5 * z * z - 0.5 * _LN_2PI - scalar_log(-z) + scalar_log(series)


@compiled(reassociate=True)
def _weighted_moments(residual: Array, precision: Array) -> tuple[float, float, float]:
    """Sums of the weights, of the weighted residuals and of their squares."""
    weights = 0.0
    total = 0.0
    chi2 = 0.0
    for i in range(residual.size):
        weighted = precision[i] * residual[i]
        weights += precision[i]
        total += weighted
        chi2 += weighted * residual[i]
    return weights, total, chi2


@compiled()
def _sum_of_logs(values: Array, work: Array) -> float:
    """Sum of the logarithms of the values that are not zero, one logarithm for four of them."""
    n = values.size // 4
    v0, v1, v2, v3 = values[:n], values[n : 2 * n], values[2 * n : 3 * n], values[3 * n : 4 * n]
    logs = work[:n]
    for i in range(n):
        left = (v0[i] if v0[i] > 0.0 else 1.0) * (v1[i] if v1[i] > 0.0 else 1.0)
        right = (v2[i] if v2[i] > 0.0 else 1.0) * (v3[i] if v3[i] > 0.0 else 1.0)
        logs[i] = log(left * right)
    total = sum_of(logs)
    for i in range(4 * n, values.size):
        total += log(values[i] if values[i] > 0.0 else 1.0)
    return total


@compiled()
def _censored_nodes(
    residual: Array, precision: Array, censored: Flags, gain: float, gain_sd: float, share: Array
) -> float:
    """Log-probability of all censored readings, the gain ~ N(gain, gain_sd^2) integrated out.

    Gauss-Hermite quadrature; the posterior shares of its nodes go into ``share``, of which there
    is only one where the gain is known.
    """
    for k in range(share.size):
        known = share.size == 1
        node = gain if known else gain + gain_sd * _GAIN_NODES[k]
        share[k] = 0.0 if known else _GAIN_LOG_WEIGHTS[k]
        for i in range(residual.size):
            if censored[i]:
                share[k] += log_normal_cdf((residual[i] - node) * sqrt(precision[i]))
    largest = share.max()
    total = 0.0
    for k in range(share.size):
        share[k] = np.exp(share[k] - largest)
        total += share[k]
    for k in range(share.size):
        share[k] /= total
    result: float = largest + scalar_log(total)
    return result


@compiled(reassociate=True)
def _observed_slopes(
    residual: Array, precision: Array, gain: float, shrunk: float, by_gain: float, by_spread: float,
    censored: Flags, by_mean: Array, by_variance: Array,
) -> None:  # fmt: skip
    """Slopes by means and variances of rows that are not censored.

    ``by_gain`` and ``by_spread`` are the slopes of the censored readings by the mean of the gain
    and by half its variance.
    """
    for i in range(residual.size):
        p = precision[i]
        away = (residual[i] - gain) * p
        slope = away - by_gain * shrunk * p
        by_v = 0.5 * (away * away - p)
        by_v += p * (p * shrunk * (0.5 + 0.5 * by_spread) - by_gain * shrunk * away)
        by_mean[i] = by_mean[i] if censored[i] else slope
        by_variance[i] = by_variance[i] if censored[i] else by_v


@compiled()
def independent_scan(
    residual: Array, extra: Array, censored: Flags, s2: float, u_cal2: float, slopes: bool,
    work: Array, by_mean: Array, by_variance: Array,
) -> float:  # fmt: skip
    """Log-likelihood of a scan, but for the sum of -ln h.

    Parameters
    ----------
    residual, extra : ndarray, shape (n_rows,)
        Residuals and variances beyond ``s2`` of the rows, over h and h^2.
    censored : ndarray of bool, shape (n_rows,)
        Their residual is that of the limit.
    s2 : float
        s_q^2.
    u_cal2 : float
        Variance of the gain.
    slopes : bool
        Fill ``by_mean`` and ``by_variance``, of shape (n_rows,), with the slopes by mean and
        variance of each row.
    work : ndarray, shape (2, >= n_rows)
        Scratch; the precisions of rows that are not censored, 0 of others, are left in the second.

    Returns
    -------
    float
    """
    n = residual.size
    precision, seen = work[0, :n], work[1, :n]
    n_censored = 0
    for i in range(residual.size):
        precision[i] = 1.0 / (s2 + extra[i])
        seen[i] = 0.0 if censored[i] else precision[i]
        n_censored += censored[i]
    weights, total, chi2 = _weighted_moments(residual, seen)
    shrunk = u_cal2 / (1.0 + u_cal2 * weights)  # posterior variance of the gain
    gain = total * shrunk
    gain_sd = sqrt(shrunk)
    value: float = -0.5 * (chi2 - total * gain + np.log1p(u_cal2 * weights))
    by_gain = 0.0
    by_gain_sd = 0.0
    if n_censored:
        share = np.empty(_GAIN_NODES.size if shrunk > 0.0 else 1)
        value += _censored_nodes(residual, precision, censored, gain, gain_sd, share)
    if n_censored and slopes:
        for i in range(residual.size):
            if not censored[i]:
                continue
            root = sqrt(precision[i])
            by_mean[i] = 0.0
            by_variance[i] = 0.0
            for k in range(share.size):
                node = _GAIN_NODES[k] if share.size > 1 else 0.0
                z = (residual[i] - gain - gain_sd * node) * root
                hazard = share[k] * np.exp(-0.5 * z * z - 0.5 * _LN_2PI - log_normal_cdf(z))
                by_mean[i] -= hazard * root
                by_variance[i] -= 0.5 * hazard * z * precision[i]
                by_gain_sd -= hazard * node * root
            by_gain += by_mean[i]
    if slopes:
        spread = by_gain_sd * gain_sd
        _observed_slopes(
            residual, seen, gain, shrunk, by_gain, spread, censored, by_mean, by_variance
        )
    n_seen = n - n_censored
    value -= 0.5 * (n_seen * _LN_2PI - _sum_of_logs(seen, precision))
    return value
