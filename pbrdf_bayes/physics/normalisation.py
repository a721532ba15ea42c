"""The normalisation integral of Eq. (4) by two one-dimensional quadratures.

The lobe product A_q(alpha) B_q'(beta) separates on the unit disk: with

    C_q'(b) = integral of B_q' over [-b, b]

the norm is I_q(alpha_i) = integral of A_q(alpha) C_q'(sqrt(1 - alpha^2)) d alpha over [-1, 1].
C serves every angle of incidence; s and p share the nodes.

Substitutions. alpha = sin t and beta = sin s remove the square-root ends; the argument of C is
then s = pi/2 - |t|. Both integrands have Lorentzian peaks of half width w, that is poles at
distance w from the real axis, at t = theta_i for A and at t = +-pi/2 (where s = 0) for C. Distance
= w sinh u from a peak puts its poles at u = +-i pi/2 whatever w is.

Panels. A is integrated over five panels, -pi/2 | -pi/4 | 0 | theta_i | middle | pi/2: t = 0 is
where |t| has its kink, and each remaining panel has one peak at one end, around which it is
stretched. C is expanded in Chebyshev polynomials of u.

Orders. A panel of length U in u has its nearest pole at z = -1 + i pi/U in the variable of the
interval [-1, 1]; a Gauss rule of p nodes converges like r^(-2p), a Chebyshev expansion of degree
p like r^(-p), with r = |z + sqrt(z^2 - 1)| (Trefethen, Approximation Theory and Approximation
Practice, chapters 8 and 19). `panel_order` and `expansion_order` invert that; the factors in
front were calibrated over the domain (``tests/physics/test_accuracy.py``). The orders depend on
the tolerance and the parameters, never on data.
"""

from __future__ import annotations

from math import asinh, ceil, log10, pi, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from pbrdf_bayes.physics.elementary import exp, half_sincos, log
from pbrdf_bayes.physics.fresnel import Surface, lobes, transmittances

Array = NDArray[np.float64]

MAX_ORDER = 96
"""Largest Gauss rule and Chebyshev degree tabulated."""
_ORDER_STEP = 4
MAX_NODES = 2048
PANEL_LENGTH = 2.2
POLE_DISTANCE = 1.2
POLE_DISTANCE_METAL = 0.9
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

    One block for each order that is a multiple of ``_ORDER_STEP``. C is the antiderivative that is
    zero at u = 0; divided by u it keeps its relative accuracy there, which grazing angles need.
    """
    points, matrices, starts = [], [], [0]
    for m in range(_ORDER_STEP, MAX_ORDER + 1, _ORDER_STEP):
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
_POINTS, _MATRICES, _MATRIX_START = _expansion_tables()


class Workspace(NamedTuple):
    """Scratch arrays of one evaluation, allocated once for many."""

    c_s: Array
    c_p: Array
    a_s: Array
    a_p: Array
    u: Array
    b: Array


@njit(cache=True)
def workspace() -> Workspace:
    """Allocate the scratch arrays."""
    return Workspace(
        np.empty(MAX_ORDER + 1),
        np.empty(MAX_ORDER + 1),
        np.empty(MAX_NODES),
        np.empty(MAX_NODES),
        np.empty(MAX_NODES),
        np.empty((4, MAX_NODES)),
    )


class Incidence(NamedTuple):
    """An angle of incidence: sine, cosine, angle and its distance from grazing [rad]."""

    sine: float
    cosine: float
    theta: float
    grazing: float


@njit(cache=True)
def incidence(theta_i: float) -> Incidence:
    """Sine, cosine and distance from grazing of ``theta_i`` [rad]."""
    return Incidence(np.sin(theta_i), np.cos(theta_i), theta_i, 0.5 * pi - theta_i)


@njit(cache=True, error_model="numpy")
def panel_split(length: float, digits: float, pole: float) -> tuple[int, int]:
    """Sub-panels, and Gauss nodes in each, for a panel of this length with poles that far away."""
    n_panels = max(ceil(length / PANEL_LENGTH), 1)
    y = 2.0 * pole / max(length / n_panels, SHORT_PANEL)
    order = ceil((digits + SPARE_DIGITS) / (2.0 * log10(y + sqrt(1.0 + y * y))))
    return n_panels, min(max(order, 2), MAX_ORDER)


@njit(cache=True, error_model="numpy")
def expansion_order(length: float, digits: float) -> int:
    """Chebyshev degree of C for this length in u and this many correct digits."""
    y = pi / max(length, SHORT_EXPANSION)
    # z = -1 + i y; sqrt(z^2 - 1) = sqrt(-y^2 - 2 i y) on the branch that enlarges |z|
    modulus = sqrt(y * y * y * y + 4.0 * y * y)
    re = sqrt(0.5 * (modulus - y * y)) + 1.0
    im = sqrt(0.5 * (modulus + y * y)) + y
    order = ceil((digits + 2.0) / (0.5 * log10(re * re + im * im))) + 1
    order = _ORDER_STEP * ((order + _ORDER_STEP - 1) // _ORDER_STEP)
    return min(max(order, 2 * _ORDER_STEP), MAX_ORDER)


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _antiderivative(m: int, ws: Workspace) -> None:
    """Chebyshev coefficients of C_s(u)/u and C_p(u)/u from the samples in ``ws.b``."""
    start = _MATRIX_START[m // _ORDER_STEP - 1]
    for j in range(m):
        sum_s = 0.0
        sum_p = 0.0
        for i in range(m):
            weight = _MATRICES[start + j * m + i]
            sum_s += weight * ws.b[0, i]
            sum_p += weight * ws.b[1, i]
        ws.c_s[j] = sum_s
        ws.c_p[j] = sum_p


@njit(cache=True, error_model="numpy")
def expand_cumulative(surf: Surface, m: int, ws: Workspace) -> float:
    """Chebyshev coefficients of C_s/u and C_p/u in u/length on [0, 1]; returns the length.

    beta = sin s, s = rho0 sinh u, u from 0 to asinh(pi / (2 rho0)).
    """
    length = asinh(0.5 * pi / surf.rho0)
    first = _ORDER_STEP * (m // _ORDER_STEP - 1) * (m // _ORDER_STEP) // 2
    for i in range(m):
        e = exp(length * _POINTS[first + i])
        s = 0.5 * surf.rho0 * (e - 1.0 / e)
        jacobian = 0.5 * surf.rho0 * (e + 1.0 / e)
        sine_half, cosine_half = half_sincos(min(s, 0.5 * pi))
        beta = 2.0 * sine_half * cosine_half
        cos_s = max((cosine_half - sine_half) * (cosine_half + sine_half), 0.0)
        x = 0.5 * beta
        c = sqrt((1.0 - x) * (1.0 + x))
        b_s, b_p = lobes(x, c, beta, cosine_half * cosine_half * cosine_half * cosine_half, surf)
        factor = 2.0 * length * jacobian * cos_s
        ws.b[0, i] = b_s * factor
        ws.b[1, i] = b_p * factor
    _antiderivative(m, ws)
    return length


@njit(cache=True, error_model="numpy")
def _peak_panel(
    inc: Incidence, width: float, forward: bool, v0: float, v1: float, p: int, at: int,
    surf: Surface, scale_u: float, ws: Workspace,
) -> None:  # fmt: skip
    """Nodes of a panel stretched around the peak: t = theta_i +- width sinh v, v in [v0, v1]."""
    first = p * (p - 1) // 2
    sign = 1.0 if forward else -1.0
    inverse_rho0 = 1.0 / surf.rho0
    for i in range(p):
        e = exp(v0 + (v1 - v0) * _NODES[first + i])
        delta = sign * 0.5 * width * (e - 1.0 / e)
        jacobian = 0.5 * width * (e + 1.0 / e) * (v1 - v0) * _WEIGHTS[first + i]
        sh, ch = half_sincos(delta)
        cos_t = inc.cosine * (1.0 - 2.0 * sh * sh) - inc.sine * 2.0 * sh * ch
        sin_t = inc.sine * (1.0 - 2.0 * sh * sh) + inc.cosine * 2.0 * sh * ch
        offset = 2.0 * sh * (inc.cosine * ch - inc.sine * sh)
        a_s, a_p = _lobe_at(inc, sin_t, cos_t, offset, surf)
        ws.a_s[at + i] = a_s * jacobian
        ws.a_p[at + i] = a_p * jacobian
        distance = min(inc.grazing - delta, inc.grazing + 2.0 * inc.theta + delta) * inverse_rho0
        ws.u[at + i] = scale_u * log(distance + sqrt(distance * distance + 1.0))


@njit(cache=True, error_model="numpy")
def _edge_panel(
    inc: Incidence, forward: bool, v0: float, v1: float, p: int, at: int,
    surf: Surface, scale_u: float, ws: Workspace,
) -> None:  # fmt: skip
    """Nodes of a panel stretched around grazing: |t| = pi/2 - rho0 sinh u, u in [v0, v1]."""
    first = p * (p - 1) // 2
    sign = 1.0 if forward else -1.0
    grazing_half, _ = half_sincos(inc.grazing)
    for i in range(p):
        u = v0 + (v1 - v0) * _NODES[first + i]
        e = exp(u)
        s = 0.5 * surf.rho0 * (e - 1.0 / e)
        jacobian = 0.5 * surf.rho0 * (e + 1.0 / e) * (v1 - v0) * _WEIGHTS[first + i]
        sh, ch = half_sincos(s)
        sin_t = sign * (1.0 - 2.0 * sh * sh)
        offset = 2.0 * (grazing_half - sh) * (grazing_half + sh) if forward else sin_t - inc.sine
        a_s, a_p = _lobe_at(inc, sin_t, 2.0 * sh * ch, offset, surf)
        ws.a_s[at + i] = a_s * jacobian
        ws.a_p[at + i] = a_p * jacobian
        ws.u[at + i] = scale_u * u


@njit(cache=True, error_model="numpy", inline="always")
def _lobe_at(
    inc: Incidence, sin_t: float, cos_t: float, offset: float, surf: Surface
) -> tuple[float, float]:
    """A_s and A_p at alpha = sin t, times d alpha / dt."""
    x = 0.5 * (inc.sine + sin_t)
    short_i = inc.cosine * inc.cosine / (1.0 + inc.sine)
    short = cos_t * cos_t / (1.0 + sin_t) if sin_t > 0.0 else 1.0 - sin_t
    c = sqrt(0.5 * (short + short_i) * (1.0 + x))
    h = 0.25 * (inc.cosine + cos_t) * (inc.cosine + cos_t)
    a_s, a_p = lobes(x, c, offset, h, surf)
    return a_s * cos_t, a_p * cos_t


@njit(cache=True, error_model="numpy")
def place_nodes(inc: Incidence, surf: Surface, digits: float, ws: Workspace) -> int:
    """Fill A and the argument of C at the nodes of all panels; returns their number."""
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    width = min(surf.rho0, inc.grazing, 0.25 * surf.width * min(t_s, t_p))
    pole = POLE_DISTANCE_METAL if surf.m2_re < 0.0 else POLE_DISTANCE
    scale_u = 1.0 / asinh(0.5 * pi / surf.rho0)
    at = 0
    for forward, s1 in ((False, 0.25 * pi), (True, 0.5 * inc.grazing)):
        length = asinh(s1 / surf.rho0)
        n_panels, p = panel_split(length, digits, pole)
        step = length / n_panels
        for j in range(n_panels):
            _edge_panel(inc, forward, j * step, (j + 1) * step, p, at, surf, scale_u, ws)
            at += p
    near = asinh(inc.theta / width)
    far = asinh((inc.theta + 0.25 * pi) / width)
    half = asinh(0.5 * inc.grazing / width)
    for forward, v0, v1 in ((False, near, far), (False, 0.0, near), (True, 0.0, half)):
        if v1 > v0:
            n_panels, p = panel_split(v1 - v0, digits, pole)
            step = (v1 - v0) / n_panels
            for j in range(n_panels):
                a = v0 + j * step
                _peak_panel(inc, width, forward, a, a + step, p, at, surf, scale_u, ws)
                at += p
    return at


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def integrate_lobes(n_nodes: int, m: int, ws: Workspace) -> tuple[float, float]:
    """I_s and I_p: A at the nodes times C there, by Clenshaw's recurrence over all nodes at once."""
    for i in range(n_nodes):
        ws.b[0, i] = 0.0
        ws.b[1, i] = 0.0
        ws.b[2, i] = 0.0
        ws.b[3, i] = 0.0
    for j in range(m - 1, 0, -1):
        c_s, c_p = ws.c_s[j], ws.c_p[j]
        for i in range(n_nodes):
            z2 = 4.0 * ws.u[i] - 2.0
            next_s = c_p + z2 * ws.b[0, i] - ws.b[1, i]
            next_p = c_s + z2 * ws.b[2, i] - ws.b[3, i]
            ws.b[1, i] = ws.b[0, i]
            ws.b[0, i] = next_s
            ws.b[3, i] = ws.b[2, i]
            ws.b[2, i] = next_p
    sum_s = 0.0
    sum_p = 0.0
    for i in range(n_nodes):
        z = 2.0 * ws.u[i] - 1.0
        sum_s += ws.a_s[i] * ws.u[i] * (ws.c_p[0] + z * ws.b[0, i] - ws.b[1, i])
        sum_p += ws.a_p[i] * ws.u[i] * (ws.c_s[0] + z * ws.b[2, i] - ws.b[3, i])
    return sum_s, sum_p


@njit(cache=True, error_model="numpy")
def normalisation_integrals(
    inc: Incidence, surf: Surface, digits: float, ws: Workspace
) -> tuple[float, float]:
    """I_s and I_p at one angle of incidence to ``digits`` correct digits."""
    m = expansion_order(asinh(0.5 * pi / surf.rho0), digits)
    expand_cumulative(surf, m, ws)
    return integrate_lobes(place_nodes(inc, surf, digits, ws), m, ws)
