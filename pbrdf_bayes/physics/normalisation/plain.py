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

Rules, expansions and their orders are those of `pbrdf_bayes.physics.normalisation.quadrature`.
"""

from __future__ import annotations

from math import asinh, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, half_sincos, log, log_ratio
from pbrdf_bayes.physics.fresnel import (
    TINIEST,
    Surface,
    lobe_fractions,
    lobe_slopes,
    lobes,
    transmittances,
)
from pbrdf_bayes.physics.normalisation.quadrature import (
    MAX_ORDER,
    POINTS,
    antiderivative,
    expansion_order,
    first_point,
    lay_panels,
    sum_expansion,
)

Array = NDArray[np.float64]

MAX_NODES = 2048
LANES = 4
"""Nodes come in multiples of this, so that no loop over them has a remainder done one by one."""
POLE_DISTANCE = 1.2
POLE_DISTANCE_METAL = 0.9
POLE_DISTANCE_DENSE = 1.0
DENSE = 6.0
"""Re(m^2) from which Brewster's angle crowds the poles towards grazing."""


VALUES, SLOPES = 2, 8
"""Series carried along: A_s, A_p, or with them the six derivatives of `LobeSlopes`."""


class Workspace(NamedTuple):
    """Scratch arrays of one evaluation, allocated once for many."""

    nodes: Array
    """(6, MAX_NODES): x, c, offset, h of each node, its weight, and its u / length."""
    lobes: Array
    """(SLOPES, MAX_NODES): the series at the nodes."""
    coefficients: Array
    """(SLOPES, MAX_ORDER): Chebyshev coefficients of C/u for the series of B."""
    recurrence: Array
    """(2, MAX_NODES): scratch of the sums of Chebyshev polynomials."""
    sums: Array
    """(SLOPES, MAX_NODES): C/u at the nodes."""


@compiled()
def workspace() -> Workspace:
    """Allocate the scratch arrays."""
    return Workspace(
        np.empty((6, MAX_NODES)),
        np.empty((SLOPES, MAX_NODES)),
        np.empty((SLOPES, MAX_ORDER)),
        np.empty((2, MAX_NODES)),
        np.empty((SLOPES, MAX_NODES)),
    )


class Incidence(NamedTuple):
    """An angle of incidence: sine, cosine, angle and its distance from grazing [rad]."""

    sine: float
    cosine: float
    theta: float
    grazing: float


@compiled()
def incidence(theta_i: float) -> Incidence:
    """Sine, cosine and distance from grazing of ``theta_i`` [rad]."""
    return Incidence(np.sin(theta_i), np.cos(theta_i), theta_i, 0.5 * pi - theta_i)


@compiled()
def fill_lobes(geometry: Array, first: int, a: int, b: int, surf: Surface, out: Array) -> None:
    """Lobes of s and p at the columns a..b of ``out``; x, c, offset, h from row ``first`` on.

    Rows are cut to contiguous one-dimensional arrays first: the compiler vectorises no other loop.
    """
    x, c = geometry[first][a:b], geometry[first + 1][a:b]
    offset, h = geometry[first + 2][a:b], geometry[first + 3][a:b]
    lobe_s, lobe_p = out[0][a:b], out[1][a:b]
    for i in range(x.size):
        lobe_s[i], lobe_p[i] = lobes(x[i], c[i], offset[i], h[i], surf)


@compiled()
def fill_log_lobes(
    geometry: Array, first: int, a: int, b: int, surf: Surface,
    add_s: float, add_p: float, lowest: float, work: Array, out: Array,
) -> None:  # fmt: skip
    """Logarithms of the lobes plus ``add_s`` and ``add_p``; -700 or less for a lobe of zero.

    Arguments as for `fill_lobes`; results are at least ``lowest``, rows 2 to 4 of ``work`` are
    scratch. Three loops take less time than one, which would run out of registers.
    """
    x, c = geometry[first][a:b], geometry[first + 1][a:b]
    offset, h = geometry[first + 2][a:b], geometry[first + 3][a:b]
    above_p, below_s, below_p = work[2][a:b], work[3][a:b], work[4][a:b]
    log_s, log_p = out[0][a:b], out[1][a:b]
    if surf.m2_re >= 1.0:
        for i in range(x.size):
            t = lobe_fractions(x[i], c[i], offset[i], h[i], surf, True)
            below_s[i], above_p[i], below_p[i] = t.below_s, t.above_p, t.below_p
    else:
        for i in range(x.size):
            t = lobe_fractions(x[i], c[i], offset[i], h[i], surf, False)
            below_s[i], above_p[i], below_p[i] = t.below_s, t.above_p, t.below_p
    for i in range(x.size):
        log_s[i] = max(add_s + log_ratio(surf.contrast, below_s[i]), lowest)
    for i in range(x.size):
        log_p[i] = max(add_p + log_ratio(max(above_p[i], TINIEST), below_p[i]), lowest)


@compiled()
def fill_slopes(geometry: Array, first: int, a: int, b: int, surf: Surface, out: Array) -> None:
    """The eight fields of `LobeSlopes`, arguments as for `fill_lobes`."""
    x, c = geometry[first][a:b], geometry[first + 1][a:b]
    offset, h = geometry[first + 2][a:b], geometry[first + 3][a:b]
    r0, r1, r2, r3 = out[0][a:b], out[1][a:b], out[2][a:b], out[3][a:b]
    r4, r5, r6, r7 = out[4][a:b], out[5][a:b], out[6][a:b], out[7][a:b]
    for i in range(x.size):
        t = lobe_slopes(x[i], c[i], offset[i], h[i], surf)
        r0[i], r1[i], r2[i], r3[i] = t.s, t.p, t.s_re, t.s_im
        r4[i], r5[i], r6[i], r7[i] = t.s_width, t.p_re, t.p_im, t.p_width


@compiled()
def _fill_series(n: int, n_series: int, surf: Surface, ws: Workspace) -> None:
    """The series at the nodes times the weights: lobes, and derivatives of the lobes themselves."""
    if n_series == VALUES:
        fill_lobes(ws.nodes, 0, 0, n, surf, ws.lobes)
    else:
        fill_slopes(ws.nodes, 0, 0, n, surf, ws.lobes)
    _scale_row(ws.lobes[0], ws.nodes[4], n)
    _scale_row(ws.lobes[1], ws.nodes[4], n)
    for j in range(2, n_series):
        _scale_row(ws.lobes[j], ws.lobes[0 if j < 5 else 1], n)


@compiled(inline=True)
def _scale_row(row: Array, factor: Array, n: int) -> None:
    for i in range(n):
        row[i] *= factor[i]


@compiled()
def _place_cumulative_nodes(length: float, first: int, m: int, rho0: float, ws: Workspace) -> None:
    """Geometry and weights of the nodes beta = sin s, s = rho0 sinh u, u from 0 to ``length``."""
    x_row, c_row, offset_row = ws.nodes[0][:m], ws.nodes[1][:m], ws.nodes[2][:m]
    h_row, weight_row, point = ws.nodes[3][:m], ws.nodes[4][:m], POINTS[first : first + m]
    half_rho0 = 0.5 * rho0
    for i in range(x_row.size):
        e = exp(length * point[i])
        inverse = 1.0 / e
        sine_half, cosine_half = half_sincos(min(half_rho0 * (e - inverse), 0.5 * pi))
        beta = 2.0 * sine_half * cosine_half
        cos_s = max((cosine_half - sine_half) * (cosine_half + sine_half), 0.0)
        x = 0.5 * beta
        cosine_half2 = cosine_half * cosine_half
        x_row[i] = x
        c_row[i] = sqrt((1.0 - x) * (1.0 + x))
        offset_row[i] = beta
        h_row[i] = cosine_half2 * cosine_half2
        weight_row[i] = 2.0 * length * half_rho0 * (e + inverse) * cos_s


@compiled()
def expand_cumulative(surf: Surface, m: int, n_series: int, ws: Workspace) -> None:
    """Chebyshev coefficients of C/u in u/length on [0, 1], for every series of B."""
    _place_cumulative_nodes(asinh(0.5 * pi / surf.rho0), first_point(m), m, surf.rho0, ws)
    _fill_series(m, n_series, surf, ws)
    for q in range(n_series):
        antiderivative(m, ws.lobes[q], ws.coefficients[q])


@compiled()
def place_nodes(inc: Incidence, surf: Surface, digits: float, ws: Workspace) -> int:
    """Geometry and weights of the nodes of all panels; returns their number.

    Nodes are laid at t = theta_i + width sinh v, then around both grazing directions at
    t = -+pi/2 + rho0 sinh v. All cosines and differences of sines come without cancellation.
    """
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    width = min(surf.rho0, inc.grazing, 0.25 * surf.width * min(t_s, t_p))
    rho0 = surf.rho0
    pole = POLE_DISTANCE
    if surf.m2_re < 0.0:
        pole = POLE_DISTANCE_METAL
    elif surf.m2_re > DENSE:
        pole = POLE_DISTANCE_DENSE
    near = asinh(inc.theta / width)
    far = asinh((inc.theta + 0.25 * pi) / width)
    x_row, c_row, offset_row = ws.nodes[0], ws.nodes[1], ws.nodes[2]
    h_row, weight_row, u_row = ws.nodes[3], ws.nodes[4], ws.nodes[5]
    peak = lay_panels(-far, -near, digits, pole, 0, u_row, weight_row)
    peak = lay_panels(-near, 0.0, digits, pole, peak, u_row, weight_row)
    middle = asinh(0.5 * inc.grazing / width)
    peak = lay_panels(0.0, middle, digits, pole, peak, u_row, weight_row)
    quarter = asinh(0.25 * pi / rho0)
    backward = lay_panels(0.0, quarter, digits, pole, peak, u_row, weight_row)
    middle = asinh(0.5 * inc.grazing / rho0)
    n = lay_panels(-middle, 0.0, digits, pole, backward, u_row, weight_row)
    while n % LANES:
        u_row[n] = weight_row[n] = 0.0
        n += 1
    inverse_rho0 = 1.0 / rho0
    scale_u = 1.0 / asinh(0.5 * pi * inverse_rho0)
    short_i = inc.cosine * inc.cosine / (1.0 + inc.sine)  # 1 - sin(theta_i)
    for i in range(n):
        at_peak = i < peak
        edge = -1.0 if i < backward else 1.0
        sine = inc.sine if at_peak else edge
        cosine = inc.cosine if at_peak else 0.0
        short = short_i if at_peak else 1.0 - edge
        beyond = 0.0 if at_peak else short_i - short
        above = inc.grazing if at_peak else 0.5 * pi * (1.0 - edge)
        e = exp(u_row[i])
        inverse = 1.0 / e
        half_width = 0.5 * width if at_peak else 0.5 * rho0
        delta = half_width * (e - inverse)
        sh, ch = half_sincos(delta)
        rise = 2.0 * sh * (cosine * ch - sine * sh)  # sin t - sine
        cos_t = cosine * (1.0 - 2.0 * sh * sh) - sine * (2.0 * sh * ch)
        x = 0.5 * (inc.sine + sine + rise)
        x_row[i] = x
        c_row[i] = sqrt(0.5 * (short - rise + short_i) * (1.0 + x))
        offset_row[i] = beyond + rise
        h_row[i] = 0.25 * (inc.cosine + cos_t) * (inc.cosine + cos_t)
        weight_row[i] *= half_width * (e + inverse) * cos_t
        distance = min(above - delta, pi - above + delta) * inverse_rho0
        u_row[i] = scale_u * log(distance + sqrt(distance * distance + 1.0))
    return n


@compiled()
def _sum_expansions(n: int, m: int, n_series: int, ws: Workspace) -> None:
    """C/u of every series at the nodes."""
    u, y, b2 = ws.nodes[5][:n], ws.recurrence[0][:n], ws.recurrence[1][:n]
    for i in range(y.size):
        y[i] = 4.0 * u[i] - 2.0
    for q in range(n_series):
        sum_expansion(ws.coefficients[q], m, y, ws.sums[q][:n], b2)


@compiled(reassociate=True)
def _dot(a: Array, b: Array, u: Array, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += a[i] * b[i] * u[i]
    return total


@compiled()
def integrals(
    inc: Incidence, surf: Surface, digits: float, m: int, n_series: int, ws: Workspace
) -> tuple[float, float, int]:
    """I_s, I_p of Eq. (4) at one angle, and the nodes; `expand_cumulative` comes before."""
    n = place_nodes(inc, surf, digits, ws)
    _fill_series(n, n_series, surf, ws)
    _sum_expansions(n, m, n_series, ws)
    u = ws.nodes[5]
    norm_s = _dot(ws.lobes[0], ws.sums[1], u, n)
    norm_p = _dot(ws.lobes[1], ws.sums[0], u, n)
    if inc.theta == 0.0:  # alpha and beta, and with them s and p, change places
        norm_s = norm_p = 0.5 * (norm_s + norm_p)
    return norm_s, norm_p, n


@compiled()
def integral_slopes(inc: Incidence, n: int, ws: Workspace, out: Array) -> None:
    """Derivatives of I_s, I_p (contrast fixed) by Re(m^2), -Im(m^2), width: after `integrals`.

    ``out`` has shape (6,): three for s, three for p. The nodes move with the parameters, the
    integral does not depend on where they are.
    """
    u = ws.nodes[5]
    for j in range(3):
        out[j] = _dot(ws.lobes[2 + j], ws.sums[1], u, n) + _dot(ws.lobes[0], ws.sums[5 + j], u, n)
        out[3 + j] = _dot(ws.lobes[5 + j], ws.sums[0], u, n) + _dot(
            ws.lobes[1], ws.sums[2 + j], u, n
        )
        if inc.theta == 0.0:
            out[j] = out[3 + j] = 0.5 * (out[j] + out[3 + j])


@compiled()
def normalisation_integrals(
    inc: Incidence, surf: Surface, digits: float, ws: Workspace
) -> tuple[float, float]:
    """I_s and I_p at one angle of incidence to ``digits`` correct digits."""
    m = expansion_order(asinh(0.5 * pi / surf.rho0), digits)
    expand_cumulative(surf, m, VALUES, ws)
    norm_s, norm_p, _ = integrals(inc, surf, digits, m, VALUES, ws)
    return norm_s, norm_p
