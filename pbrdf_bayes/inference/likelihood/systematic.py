"""Systematic errors that the scans share, marginalised beside their covariance.

With K the covariance of the rows over h, block by block from noise, gains and discrepancies, r
their residuals and the rows of S the sensitivities to errors z ~ N(0, I) (`readings.observation`):

    -2 ln L = r'K^-1 r - v'(I + G)^-1 v + ln|K| + ln|I + G| + n ln 2 pi
    v = S K^-1 r,   G = S K^-1 S',   E(z|y) = (I + G)^-1 v,   cov(z|y) = (I + G)^-1

after Bridle et al., MNRAS 335, 1193 (2002), arXiv:astro-ph/0112114. The likelihoods send the rows
of S through their filters beside r and add up v and G. With L L' = I + G

    (K + S'S)^-1 = K^-1 - K^-1 T'T K^-1,   T = L^-1 S,   (K + S'S)^-1 r = K^-1 (r - T'L^-1 v),

so that slopes follow from those without errors, of r - T'L^-1 v = r - S'E(z|y), and from T.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.brdf import sum_of
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]


@compiled()
def marginalise(v: Array, g: Array) -> float:
    """What the errors add to the log-likelihood: (v'(I + G)^-1 v - ln|I + G|)/2.

    L^-1 v = L'E(z|y) replaces ``v`` (n_errors,) and L the lower triangle of ``g``
    (n_errors, n_errors), of which only that is read. Rows that are not normal may have negative
    precisions: where I + G is not positive, far from any optimum, the errors count as none.
    """
    value = 0.0
    for j in range(v.size):
        for i in range(j + 1):
            total = g[j, i] + (1.0 if i == j else 0.0)
            for h in range(i):
                total -= g[i, h] * g[j, h]
            if i == j and not total > 0.0:
                v[:] = 0.0
                return 0.0
            g[j, i] = sqrt(total) if i == j else total / g[i, i]
        for i in range(j):
            v[j] -= g[j, i] * v[i]
        v[j] /= g[j, j]
        value += 0.5 * v[j] * v[j] - log(g[j, j])
    return value


@compiled()
def marginalise_about(v: Array, g: Array, z: Array) -> float:
    """`marginalise` where ``v`` and ``g`` are those of the residuals r - S'z.

    E(z|y) replaces ``z`` (n_errors,), its change ``v``.
    """
    value = 0.0
    for j in range(v.size):
        value -= 0.5 * z[j] * z[j]
        v[j] -= z[j]
    value += marginalise(v, g)
    for j in range(v.size - 1, -1, -1):
        for i in range(j + 1, v.size):
            v[j] -= g[i, j] * v[i]
        v[j] = v[j] / g[j, j] if v[j] != 0.0 else 0.0
        z[j] += v[j]
    return value


@compiled()
def _add_multiple(to: Array, factor: float, of: Array) -> None:
    for i in range(to.size):
        to[i] += factor * of[i]


@compiled()
def rotate(s: Array, g: Array) -> None:
    """T = L^-1 S in place of ``s`` (n_errors, n), L as `marginalise` leaves it in ``g``."""
    for j in range(s.shape[0]):
        for h in range(j):
            _add_multiple(s[j], -g[j, h], s[h])
        over = 1.0 / g[j, j]
        for i in range(s.shape[1]):
            s[j, i] *= over


@compiled(reassociate=True)
def _weigh(values: Array, precision: Array, out: Array) -> float:
    """Values times precisions into ``out``, and their sum."""
    total = 0.0
    for i in range(values.size):
        out[i] = values[i] * precision[i]
        total += out[i]
    return total


@compiled(reassociate=True)
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled()
def add_independent_scan(
    residual: Array, precision: Array, u_cal2: float, s: Array, first: int, work: Array, v: Array,
    g: Array,
) -> None:  # fmt: skip
    """Add a scan of independent rows and one gain to ``v`` and to the lower triangle of ``g``.

    ``residual`` and ``precision`` have the shape (n_rows,); ``s`` (n_errors, n_all) holds those of
    all rows, the scan's from ``first`` on. ``work`` is (>= n_errors + 1, >= n_rows).
    """
    m, n = s.shape[0], residual.size
    sums = np.empty(m + 1)
    sums[m] = _weigh(residual, precision, work[m, :n])
    for j in range(m):
        sums[j] = _weigh(s[j, first : first + n], precision, work[j, :n])
    shrunk = u_cal2 / (1.0 + u_cal2 * sum_of(precision))
    for j in range(m):
        own = s[j, first : first + n]
        v[j] += _dot(own, work[m, :n]) - shrunk * sums[j] * sums[m]
        for h in range(j + 1):
            g[j, h] += _dot(own, work[h, :n]) - shrunk * sums[j] * sums[h]


@compiled()
def independent_slopes(
    residual: Array, precision: Array, u_cal2: float, t: Array, first: int, z: Array, work: Array,
    by_mean: Array, by_variance: Array,
) -> None:  # fmt: skip
    """Slopes of such a scan by mean and variance of its rows.

    ``t`` (n_errors, n_all) holds T and ``z`` L'E(z|y); the rest is as for `add_independent_scan`.
    """
    n, left, weighted = residual.size, work[0, : residual.size], work[1, : residual.size]
    left[:] = residual
    for j in range(t.shape[0]):
        _add_multiple(left, -z[j], t[j, first : first + n])
    shrunk = u_cal2 / (1.0 + u_cal2 * sum_of(precision))
    total = shrunk * _weigh(left, precision, by_mean)
    for i in range(n):
        p = precision[i]
        by_mean[i] -= total * p
        by_variance[i] = 0.5 * (by_mean[i] * by_mean[i] - p + p * p * shrunk)
    for j in range(t.shape[0]):
        total = shrunk * _weigh(t[j, first : first + n], precision, weighted)
        for i in range(n):
            u = weighted[i] - total * precision[i]
            by_variance[i] += 0.5 * u * u
