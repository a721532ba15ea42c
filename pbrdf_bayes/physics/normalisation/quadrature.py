"""Gauss rules and Chebyshev expansions of every order, and which order a tolerance needs.

Orders. A panel of length U in u has its nearest pole at z = -1 + i pi/U in the variable of the
interval [-1, 1]; a Gauss rule of p nodes converges like r^(-2p), a Chebyshev expansion of degree
p like r^(-p), with r = |z + sqrt(z^2 - 1)| (Trefethen, Approximation Theory and Approximation
Practice, chapters 8 and 19). `panel_split` and `expansion_order` invert that; the factors in
front were calibrated over the domain (``tests/physics/test_accuracy.py``). The orders depend on
the tolerance and the parameters, never on data.
"""

from __future__ import annotations

from math import ceil, log10, pi, sqrt

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]

MAX_ORDER = 96
"""Largest Gauss rule and Chebyshev degree tabulated."""
ORDER_STEP = 4
PANEL_LENGTH = 2.2
SPARE_DIGITS = 1.0
SHORT_PANEL = 1.0
SHORT_EXPANSION = 1.8


def _gauss_tables() -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on [0, 1]: the rule of order p starts at p (p - 1) / 2."""
    rules = [np.polynomial.legendre.leggauss(p) for p in range(1, MAX_ORDER + 1)]
    nodes = np.concatenate([0.5 * (1.0 + x) for x, _ in rules])
    return nodes, np.concatenate([0.5 * w for _, w in rules])


def _expansion_tables() -> tuple[Array, Array, NDArray[np.int64]]:
    """Chebyshev points on [0, 1] and matrices from samples there to C(u)/u in coefficients.

    One block for each order that is a multiple of ``ORDER_STEP``. C is the antiderivative that is
    zero at u = 0; divided by u it keeps its relative accuracy there, which grazing angles need.
    """
    points, matrices, starts = [], [], [0]
    for m in range(ORDER_STEP, MAX_ORDER + 1, ORDER_STEP):
        angle = pi * (np.arange(m) + 0.5) / m
        points.append(0.5 * (1.0 + np.cos(angle)))
        degree = np.arange(m)[:, None]
        series = np.cos(degree * angle) * (2.0 / m)
        series[0] *= 0.5
        integrals = [0.5 * chebyshev.chebint(column, lbnd=-1.0) for column in series.T]
        quotients = [chebyshev.chebdiv(integral, [0.5, 0.5])[0] for integral in integrals]
        matrices.append(np.stack(quotients, axis=1).ravel())
        starts.append(starts[-1] + matrices[-1].size)
    return np.concatenate(points), np.concatenate(matrices), np.array(starts)


_NODES, _WEIGHTS = _gauss_tables()
POINTS, _MATRICES, _MATRIX_START = _expansion_tables()


@compiled()
def panel_split(length: float, digits: float, pole: float) -> tuple[int, int]:
    """Sub-panels, and Gauss nodes in each, for a panel of this length with poles that far away."""
    n_panels = max(ceil(length / PANEL_LENGTH), 1)
    y = 2.0 * pole / max(length / n_panels, SHORT_PANEL)
    order = ceil((digits + SPARE_DIGITS) / (2.0 * log10(y + sqrt(1.0 + y * y))))
    return n_panels, min(max(order, 2), MAX_ORDER)


@compiled()
def expansion_order(length: float, digits: float) -> int:
    """Chebyshev degree of C for this length in u and this many correct digits."""
    y = pi / max(length, SHORT_EXPANSION)
    # z = -1 + i y; sqrt(z^2 - 1) = sqrt(-y^2 - 2 i y) on the branch that enlarges |z|
    modulus = sqrt(y * y * y * y + 4.0 * y * y)
    re = sqrt(0.5 * (modulus - y * y)) + 1.0
    im = sqrt(0.5 * (modulus + y * y)) + y
    order = ceil((digits + 2.0) / (0.5 * log10(re * re + im * im))) + 1
    order = ORDER_STEP * ((order + ORDER_STEP - 1) // ORDER_STEP)
    return min(max(order, 2 * ORDER_STEP), MAX_ORDER)


@compiled(inline=True)
def lay_panels(
    v0: float, v1: float, digits: float, pole: float, at: int, v_row: Array, weight_row: Array
) -> int:
    """Gauss nodes of [v0, v1] and their weights from index ``at`` on; returns where they end."""
    if v1 > v0:
        n_panels, p = panel_split(v1 - v0, digits, pole)
        step = (v1 - v0) / n_panels
        first = p * (p - 1) // 2
        for j in range(n_panels):
            for i in range(p):
                v_row[at + i] = v0 + step * (j + _NODES[first + i])
                weight_row[at + i] = step * _WEIGHTS[first + i]
            at += p
    return at


@compiled()
def first_point(m: int) -> int:
    """Where the Chebyshev points of this order begin in `POINTS`."""
    step = m // ORDER_STEP
    return ORDER_STEP * (step - 1) * step // 2


@compiled(reassociate=True)
def antiderivative(m: int, samples: Array, out: Array) -> None:
    """Chebyshev coefficients of C(u)/u on [0, 1], into ``out``, from samples at the points."""
    start = _MATRIX_START[m // ORDER_STEP - 1]
    for j in range(m):
        row = _MATRICES[start + j * m : start + (j + 1) * m]
        total = 0.0
        for i in range(m):
            total += row[i] * samples[i]
        out[j] = total


@compiled(inline=True)
def sum_expansion(coefficients: Array, m: int, y: Array, b1: Array, b2: Array) -> None:
    """A Chebyshev series at all nodes by Clenshaw's recurrence, into ``b1``; m is even.

    Four degrees a pass over the nodes; ``y`` is twice the argument.
    """
    for i in range(y.size):
        b1[i] = 0.0
        b2[i] = 0.0
    for j in range(m - 4, -1, -4):
        c0, c1 = coefficients[j], coefficients[j + 1]
        c2, c3 = coefficients[j + 2], coefficients[j + 3]
        for i in range(y.size):
            odd = c3 + y[i] * b1[i] - b2[i]
            even = c2 + y[i] * odd - b1[i]
            b2[i] = c1 + y[i] * even - odd
            b1[i] = c0 + y[i] * b2[i] - even
    for i in range(y.size):
        b1[i] -= 0.5 * y[i] * b2[i]
