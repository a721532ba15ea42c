"""Scans with an instrument floor, stated uncertainties or censored readings: their likelihood.

The law is that of `inference.likelihood.iid`. The gain of a scan is marginalised in closed
form beside the readings above the floor, and over Gauss-Hermite nodes beside censored ones.
"""

from __future__ import annotations

from math import erfc, pi, sqrt
from math import log as scalar_log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.physics.brdf import sum_of
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.normalisation.plain import SLOPES

Array = NDArray[np.float64]

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


class Scratch(NamedTuple):
    """Scratch of one evaluation, allocated once for many; one element a row."""

    log_f: Array
    slopes: Array
    """Slopes of the log-likelihood by ln f."""
    residual: Array
    precision: Array
    f2: Array
    share: Array
    """Of each node of the gain."""


@compiled()
def allocate_scratch(n_rows: int) -> Scratch:
    """Scratch for scans of up to n_rows rows in all."""
    rows = np.empty((5, n_rows))
    return Scratch(rows[0], rows[1], rows[2], rows[3], rows[4], np.empty(_GAIN_NODES.size))


@compiled()
def cut_scratch(work: Scratch, a: int, b: int) -> Scratch:
    """The part that belongs to the rows a to b."""
    return Scratch(
        work.log_f[a:b], work.slopes[a:b], work.residual[a:b], work.precision[a:b], work.f2[a:b],
        work.share,
    )  # fmt: skip


@compiled()
def _compare_with_floor(
    y: Array, log_f: Array, u2: Array, censored: NDArray[np.bool_],
    s2: float, floor2: float, work: Scratch,
) -> None:  # fmt: skip
    """Residuals y - 1/2 ln(f^2 + b^2), their precisions 1/v without the gain, and f^2.

    The precision of a censored reading is zero.
    """
    residual, precision, f2 = work.residual, work.precision, work.f2
    for i in range(y.size):
        f2[i] = exp(2.0 * min(max(log_f[i], -300.0), 300.0))
        with_floor = f2[i] + floor2
        residual[i] = y[i] - 0.5 * log(with_floor)
        found = with_floor / ((s2 + u2[i]) * with_floor + floor2)
        precision[i] = 0.0 if censored[i] else found


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
def _variance(f2: float, u2: float, s_rel: float, floor2: float) -> tuple[float, float]:
    """Variance of ln(reading) without the gain, and d mean / d ln f."""
    above = f2 / (f2 + floor2)
    return s_rel * s_rel + u2 + floor2 / (f2 + floor2), above


@compiled()
def _censored_nodes(
    u2: Array, censored: NDArray[np.bool_], s_rel: float, rows: Rows,
    gain: float, gain_sd: float, work: Scratch, share: Array,
) -> float:  # fmt: skip
    """Log-probability of all censored readings, the gain ~ N(gain, gain_sd^2) integrated out.

    Gauss-Hermite quadrature; the posterior shares of its nodes go into ``share``, of which there
    is only one where the gain is known.
    """
    for k in range(share.size):
        known = share.size == 1
        node = gain if known else gain + gain_sd * _GAIN_NODES[k]
        share[k] = 0.0 if known else _GAIN_LOG_WEIGHTS[k]
        for i in range(u2.size):
            if censored[i]:
                v, _ = _variance(work.f2[i], u2[i], s_rel, rows.floor2)
                share[k] += log_normal_cdf((work.residual[i] - node) / sqrt(v))
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
    censored: NDArray[np.bool_], floor2: float, gain: float, shrunk: float,
    by_gain: float, by_spread: float, work: Scratch,
) -> float:  # fmt: skip
    """Slopes by ln f of the readings above the floor; returns the sum of those by the variance.

    ``by_gain`` and ``by_spread`` are the slopes of the censored readings by the mean of the gain
    and by half its variance.
    """
    residual, precision, f2, out = work.residual, work.precision, work.f2, work.slopes
    total = 0.0
    for i in range(residual.size):
        above = f2[i] / (f2[i] + floor2)
        away = (residual[i] - gain) * precision[i]
        by_residual = by_gain * shrunk * precision[i] - away
        by_v = 0.5 * (away * away - precision[i])
        by_v += precision[i] * (
            precision[i] * shrunk * (0.5 + 0.5 * by_spread) - by_gain * shrunk * away
        )
        total += by_v
        slope = -above * (by_residual + 2.0 * by_v * (1.0 - above))
        out[i] = out[i] if censored[i] else slope
    return total


@compiled()
def scan_with_floor(
    y: Array, log_f: Array, u2: Array, censored: NDArray[np.bool_],
    s_rel: float, rows: Rows, n_series: int, work: Scratch,
) -> tuple[float, float]:  # fmt: skip
    """A scan with a floor, stated uncertainties or censored readings.

    Returns the log-likelihood and, where ``n_series`` is SLOPES, its slope by s_rel; the slopes by
    ln f then go into ``work.slopes``.
    """
    _compare_with_floor(y, log_f, u2, censored, s_rel * s_rel, rows.floor2, work)
    weights, total, chi2 = _weighted_moments(work.residual, work.precision)
    n_censored = 0
    for i in range(censored.size):
        n_censored += censored[i]
    shrunk = rows.u_cal2 / (1.0 + rows.u_cal2 * weights)  # posterior variance of the gain
    gain = total * shrunk
    gain_sd = sqrt(shrunk)
    value = -0.5 * ((y.size - n_censored) * _LN_2PI - _sum_of_logs(work.precision, work.slopes))
    value -= 0.5 * (chi2 - total * gain + np.log1p(rows.u_cal2 * weights))
    by_gain = 0.0
    by_gain_sd = 0.0
    by_variance = 0.0
    if n_censored:
        share = work.share[: _GAIN_NODES.size if shrunk > 0.0 else 1]
        value += _censored_nodes(u2, censored, s_rel, rows, gain, gain_sd, work, share)
        for i in range(y.size):
            if n_series != SLOPES or not censored[i]:
                continue
            v, above = _variance(work.f2[i], u2[i], s_rel, rows.floor2)
            by_residual = 0.0
            by_v = 0.0
            for k in range(share.size):
                node = _GAIN_NODES[k] if share.size > 1 else 0.0
                z = (work.residual[i] - gain - gain_sd * node) / sqrt(v)
                hazard = share[k] * np.exp(-0.5 * z * z - 0.5 * _LN_2PI - log_normal_cdf(z))
                by_residual += hazard / sqrt(v)
                by_v -= 0.5 * hazard * z / v
                by_gain_sd -= hazard * node / sqrt(v)
            by_gain -= by_residual
            by_variance += by_v
            work.slopes[i] = -by_residual * above - 2.0 * by_v * above * (1.0 - above)
    if n_series == SLOPES:
        by_variance += _observed_slopes(
            censored, rows.floor2, gain, shrunk, by_gain, by_gain_sd * gain_sd, work
        )
    return value, 2.0 * s_rel * by_variance
