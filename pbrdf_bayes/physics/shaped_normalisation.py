"""The normalisation integral of Eq. (4) for the lobes of `pbrdf_bayes.physics.shaped_lobes`.

It is done as in `pbrdf_bayes.physics.normalisation`: I_q = integral of A_q(alpha) C_q'(cos t)
d alpha, alpha = sin t, C the cumulative integral of B, s and p on the same nodes. What differs:

Centres. The places near which an integrand varies fast, each with a width: theta_i, where A has its
peak, and t = +-pi/2, where C has that of B; with the geometric mean also the Brewster angle a = Re
atan(m) at t = +-a for A and at t = +-(pi/2 - a) for C: sqrt(F_p) has branch points at the
distance b = |Im atan(m)|, for k = 0 a kink. Halfway between neighbouring centres, and at the kink
of |t| at t = 0, the interval is split; each part is stretched by t = centre + width sinh v around
its own centre. No width is more than the distance of another centre and its width together.

Widths. Around theta_i and +-pi/2 they are `stretch` times the half widths of the peak: the
poles of a Cauchy peak, at 1/sqrt(2^(1/nu) - 1) half widths, are then at v = +-i pi/2 for any nu,
as those of the Lorentzian. Gaussian and Voigt peaks are entire but grow doubly exponentially off
the real axis.

C is expanded in Chebyshev polynomials piece by piece, C(v) = C(v0) + (v - v0) series(v), the
first piece from C = 0 on keeps the relative accuracy which grazing angles need.

Orders follow from the distance of the nearest pole in v as in `normalisation`. That distance was
calibrated for each kind of shape (``tests/physics/test_shaped_lobes.py``): `pole_distance`.
"""

from __future__ import annotations

from math import asinh, atan2, ceil, log1p, log10, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, half_sincos, log
from pbrdf_bayes.physics.fresnel import Surface, transmittances
from pbrdf_bayes.physics.line_shapes import CAUCHY, GAUSSIAN, VOIGT, LineShape
from pbrdf_bayes.physics.normalisation import (
    MATRICES,
    MATRIX_START,
    MAX_ORDER,
    NODES,
    ORDER_STEP,
    POINTS,
    WEIGHTS,
    Incidence,
    panel_split,
)
from pbrdf_bayes.physics.shaped_lobes import GEOMETRIC_MEAN, Lobe, shaped_log_lobes

Array = NDArray[np.float64]

MAX_SHAPED_NODES = 8192
MAX_PIECES = 64
PIECE_LENGTH = 2.2
LOWEST = -700.0


class ShapedWorkspace(NamedTuple):
    """Scratch arrays of one evaluation, allocated once for many."""

    nodes: Array
    """(7, MAX_SHAPED_NODES): x, c, offset, h of each node, its weight, pi/2 - |t|, v."""
    lobes: Array
    """(2, MAX_SHAPED_NODES): lobes of s and p at the nodes."""
    pieces: Array
    """(6, MAX_PIECES): where a piece of C ends, its centre, width, v0, length, and a spare row."""
    coefficients: Array
    """(2, MAX_PIECES, MAX_ORDER + 1): C at the beginning of a piece, then its series."""
    centres: Array
    """(3, 16): place, width, and the width after comparison with the other centres."""


@compiled()
def shaped_workspace() -> ShapedWorkspace:
    """Allocate the scratch arrays."""
    return ShapedWorkspace(
        np.empty((7, MAX_SHAPED_NODES)),
        np.empty((2, MAX_SHAPED_NODES)),
        np.empty((6, MAX_PIECES)),
        np.empty((2, MAX_PIECES, MAX_ORDER + 1)),
        np.empty((3, 16)),
    )


class Cumulative(NamedTuple):
    """C_q(b), the integral of B_q over [-b, b], in pieces; lives in the workspace it came from."""

    n_pieces: int
    order: int
    pieces: Array
    coefficients: Array


@compiled()
def stretch(shape: LineShape) -> float:
    """Width of the stretching in half widths of the peak."""
    if shape.code == CAUCHY:
        return min(1.0 / sqrt(shape.curvature), 2.0)
    if shape.code == GAUSSIAN:
        return 1.5
    return 1.0


@compiled()
def pole_distance(shaped: Lobe, surf: Surface) -> float:
    """Distance in v of the nearest pole that the orders of all rules are made for."""
    return 0.9


@compiled()
def brewster(surf: Surface) -> tuple[float, float]:
    """Re and |Im| of atan(m), the angle [rad] at which r_p vanishes."""
    n, k = surf.n, surf.k
    below = n * n + (1.0 - k) * (1.0 - k)
    return 0.5 * atan2(2.0 * n, 1.0 - n * n - k * k), 0.25 * log1p(4.0 * k / max(below, 1e-300))


# ----------------------------------------------------------------------------------- centres


@compiled()
def _add_centre(place: float, width: float, n: int, ws: ShapedWorkspace) -> int:
    """Insert a centre so that places ascend; returns their number."""
    i = n
    while i > 0 and ws.centres[0, i - 1] > place:
        ws.centres[0, i] = ws.centres[0, i - 1]
        ws.centres[1, i] = ws.centres[1, i - 1]
        i -= 1
    ws.centres[0, i] = place
    ws.centres[1, i] = width
    return n + 1


@compiled()
def _compare_widths(n: int, ws: ShapedWorkspace) -> None:
    """Widths, none more than the distance of another centre and its width together."""
    place, width = ws.centres[0], ws.centres[1]
    for i in range(n):
        smallest = width[i]
        for j in range(n):
            smallest = min(smallest, abs(place[i] - place[j]) + width[j])
        ws.centres[2, i] = smallest


@compiled()
def _branch_width(width: float, peak: float, digits: float) -> float:
    """The distance of a branch point; what is so close that it is a kink needs no stretching."""
    return width if width > peak * 10.0 ** (-0.5 * digits - 1.0) else 1.0


# -------------------------------------------------------------------------------- cumulative


@compiled()
def _series_order(length: float, digits: float, pole: float) -> int:
    y = 2.0 * pole / max(length, 1.0)
    order = ceil((digits + 2.0) / log10(y + sqrt(1.0 + y * y))) + 1
    order = ORDER_STEP * ((order + ORDER_STEP - 1) // ORDER_STEP)
    return min(max(order, 2 * ORDER_STEP), MAX_ORDER)


@compiled()
def _cut_pieces(surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace) -> int:
    """Pieces of s in [0, pi/2]; returns their number."""
    width = surf.rho0 * stretch(shaped.shape)
    n = _add_centre(0.0, width, 0, ws)
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        angle, branch = brewster(surf)
        n = _add_centre(angle, _branch_width(branch, width, digits), n, ws)
    _compare_widths(n, ws)
    at = 0
    for i in range(n):
        place, width = ws.centres[0, i], ws.centres[2, i]
        if i > 0:
            at = _add_pieces(0.5 * (place + ws.centres[0, i - 1]), place, place, width, at, ws)
        end = 0.5 * (place + ws.centres[0, i + 1]) if i + 1 < n else 0.5 * pi
        at = _add_pieces(place, end, place, width, at, ws)
    return at


@compiled()
def _add_pieces(
    start: float, end: float, centre: float, width: float, at: int, ws: ShapedWorkspace
) -> int:
    """Pieces of [start, end] stretched around ``centre`` from index ``at`` on."""
    if end <= start:
        return at
    v0, v1 = asinh((start - centre) / width), asinh((end - centre) / width)
    n = max(ceil((v1 - v0) / PIECE_LENGTH), 1)
    step = (v1 - v0) / n
    for j in range(n):
        after = v0 + (j + 1) * step
        ws.pieces[0, at] = end if j == n - 1 else centre + width * np.sinh(after)
        ws.pieces[1, at] = centre
        ws.pieces[2, at] = width
        ws.pieces[3, at] = v0 + j * step
        ws.pieces[4, at] = step
        at += 1
    return at


@compiled()
def shaped_cumulative(
    surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace
) -> Cumulative:
    """C of s and p for every angle of incidence to ``digits`` correct digits."""
    n = _cut_pieces(surf, shaped, digits, ws)
    longest = 0.0
    for i in range(n):
        longest = max(longest, ws.pieces[4, i])
    m = _series_order(longest, digits, pole_distance(shaped, surf))
    first = ORDER_STEP * (m // ORDER_STEP - 1) * (m // ORDER_STEP) // 2
    before_s = before_p = 0.0
    for i in range(n):
        ws.coefficients[0, i, 0] = before_s
        ws.coefficients[1, i, 0] = before_p
        _place_transverse_nodes(i, first, m, ws)
        _fill_lobes(m, surf, shaped, ws)
        _antiderivative(m, ws.lobes[0], ws.coefficients[0, i])
        _antiderivative(m, ws.lobes[1], ws.coefficients[1, i])
        for j in range(1, m + 1):
            before_s += ws.coefficients[0, i, j]
            before_p += ws.coefficients[1, i, j]
    return Cumulative(n, m, ws.pieces, ws.coefficients)


@compiled()
def _place_transverse_nodes(piece: int, first: int, m: int, ws: ShapedWorkspace) -> None:
    """Geometry and weights of the nodes beta = sin s of one piece."""
    centre, width = ws.pieces[1, piece], ws.pieces[2, piece]
    v0, length = ws.pieces[3, piece], ws.pieces[4, piece]
    for i in range(m):
        e = exp(v0 + length * POINTS[first + i])
        inverse = 1.0 / e
        s = min(centre + 0.5 * width * (e - inverse), 0.5 * pi)
        sine_half, cosine_half = half_sincos(s)
        beta = 2.0 * sine_half * cosine_half
        cos_s = max((cosine_half - sine_half) * (cosine_half + sine_half), 0.0)
        x = 0.5 * beta
        ws.nodes[0, i] = x
        ws.nodes[1, i] = sqrt((1.0 - x) * (1.0 + x))
        ws.nodes[2, i] = beta
        ws.nodes[3, i] = cosine_half * cosine_half * cosine_half * cosine_half
        ws.nodes[4, i] = length * width * (e + inverse) * cos_s


@compiled()
def _fill_lobes(n: int, surf: Surface, shaped: Lobe, ws: ShapedWorkspace) -> None:
    """Lobes of s and p at the nodes times the weights."""
    for i in range(n):
        log_s, log_p = shaped_log_lobes(
            ws.nodes[0, i], ws.nodes[1, i], ws.nodes[2, i], ws.nodes[3, i], surf, shaped
        )
        ws.lobes[0, i] = ws.nodes[4, i] * exp(max(log_s, LOWEST))
        ws.lobes[1, i] = ws.nodes[4, i] * exp(max(log_p, LOWEST))


@compiled(reassociate=True)
def _antiderivative(m: int, samples: Array, out: Array) -> None:
    """Coefficients of (C - C(v0)) / place from the samples, into ``out[1:]``."""
    start = MATRIX_START[m // ORDER_STEP - 1]
    for j in range(m):
        row = MATRICES[start + j * m : start + (j + 1) * m]
        total = 0.0
        for i in range(m):
            total += row[i] * samples[i]
        out[1 + j] = total


@compiled()
def cumulative_at(s: float, found: Cumulative) -> tuple[float, float]:
    """C_s and C_p at b = sin s, s in [0, pi/2]."""
    i = 0
    while i < found.n_pieces - 1 and s > found.pieces[0, i]:
        i += 1
    v = asinh((s - found.pieces[1, i]) / found.pieces[2, i])
    place = (v - found.pieces[3, i]) / found.pieces[4, i]
    y = 4.0 * place - 2.0
    a_s = b_s = a_p = b_p = 0.0
    series_s, series_p = found.coefficients[0, i], found.coefficients[1, i]
    for j in range(found.order, 1, -1):
        a_s, b_s = series_s[j] + y * a_s - b_s, a_s
        a_p, b_p = series_p[j] + y * a_p - b_p, a_p
    return (
        series_s[0] + place * (series_s[1] + 0.5 * y * a_s - b_s),
        series_p[0] + place * (series_p[1] + 0.5 * y * a_p - b_p),
    )


# ------------------------------------------------------------------------------------- norms


@compiled()
def _peak_width(inc: Incidence, surf: Surface, narrowing: float) -> float:
    """Half width [rad] of the narrower of the two peaks of A."""
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    return surf.rho0 * (min(t_s, t_p) / surf.transmittance0) ** narrowing


@compiled()
def _find_centres(
    inc: Incidence, surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace
) -> int:
    """Centres of the integral over t; returns their number."""
    half_pi, scale = 0.5 * pi, stretch(shaped.shape)
    rim = surf.rho0 * scale
    peak = min(rim, inc.grazing, scale * _peak_width(inc, surf, shaped.narrowing))
    n = _add_centre(-half_pi, rim, 0, ws)
    n = _add_centre(half_pi, rim, n, ws)
    n = _add_centre(inc.theta, peak, n, ws)
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        angle, branch = brewster(surf)
        branch = _branch_width(branch, peak, digits)
        n = _add_centre(-angle, branch, n, ws)
        n = _add_centre(angle, branch, n, ws)
        n = _add_centre(angle - half_pi, branch, n, ws)
        n = _add_centre(half_pi - angle, branch, n, ws)
    _compare_widths(n, ws)
    ws.centres[2, 0] = ws.centres[2, n - 1] = rim  # one-sided
    return n


@compiled()
def _lay_nodes(
    start: float, end: float, centre: float, width: float, digits: float, pole: float,
    at: int, inc: Incidence, ws: ShapedWorkspace,
) -> int:  # fmt: skip
    """Nodes of [start, end] as distances from theta_i and from pi/2, split at t = 0."""
    if start < 0.0 < end:
        at = _lay_nodes_within(start, 0.0, centre, width, digits, pole, at, inc, ws)
        return _lay_nodes_within(0.0, end, centre, width, digits, pole, at, inc, ws)
    return _lay_nodes_within(start, end, centre, width, digits, pole, at, inc, ws)


@compiled()
def _lay_nodes_within(
    start: float, end: float, centre: float, width: float, digits: float, pole: float,
    at: int, inc: Incidence, ws: ShapedWorkspace,
) -> int:  # fmt: skip
    if end <= start:
        return at
    v0, v1 = asinh((start - centre) / width), asinh((end - centre) / width)
    n_panels, p = panel_split(v1 - v0, digits, pole)
    step = (v1 - v0) / n_panels
    first = p * (p - 1) // 2
    above = inc.grazing if centre == inc.theta else 0.5 * pi - centre
    beyond = centre - inc.theta if abs(centre) < 0.5 * pi else inc.grazing
    if centre <= -0.5 * pi:
        above, beyond = pi, inc.grazing - pi
    for j in range(n_panels):
        for i in range(p):
            e = exp(v0 + step * (j + NODES[first + i]))
            inverse = 1.0 / e
            delta = 0.5 * width * (e - inverse)
            ws.nodes[4, at] = 0.5 * step * WEIGHTS[first + i] * width * (e + inverse)
            ws.nodes[5, at] = above - delta
            ws.nodes[6, at] = beyond + delta
            at += 1
    return at


@compiled()
def _place_nodes(
    inc: Incidence, surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace
) -> int:
    """Geometry and weights of all nodes; returns their number."""
    pole = pole_distance(shaped, surf)
    n_centres = _find_centres(inc, surf, shaped, digits, ws)
    n = 0
    for i in range(n_centres):
        place, width = ws.centres[0, i], ws.centres[2, i]
        if i > 0:
            start = 0.5 * (place + ws.centres[0, i - 1])
            n = _lay_nodes(start, place, place, width, digits, pole, n, inc, ws)
        if i + 1 < n_centres:
            end = 0.5 * (place + ws.centres[0, i + 1])
            n = _lay_nodes(place, end, place, width, digits, pole, n, inc, ws)
    _fill_geometry(n, inc, ws)
    return n


@compiled()
def _fill_geometry(n: int, inc: Incidence, ws: ShapedWorkspace) -> None:
    """x, c, offset, h of the nodes from pi/2 - t and t - theta_i, without cancellation."""
    for i in range(n):
        from_grazing, from_peak = ws.nodes[5, i], ws.nodes[6, i]
        both = from_grazing + inc.grazing  # pi - (t + theta_i)
        short = both <= 0.5 * pi
        a, b = half_sincos(both if short else pi - both)
        cos_mean, sin_mean = (a, b) if short else (b, a)
        sin_half, cos_half = half_sincos(from_peak)
        g, k = half_sincos(from_grazing)
        ws.nodes[0, i] = sin_mean * cos_half
        ws.nodes[1, i] = sqrt(cos_mean * cos_mean + sin_mean * sin_mean * sin_half * sin_half)
        ws.nodes[2, i] = 2.0 * cos_mean * sin_half
        ws.nodes[3, i] = cos_mean * cos_mean * cos_half * cos_half
        ws.nodes[4, i] *= max(2.0 * g * k, 0.0)
        ws.nodes[5, i] = max(min(from_grazing, pi - from_grazing), 0.0)


@compiled()
def shaped_integrals(
    inc: Incidence, surf: Surface, shaped: Lobe, found: Cumulative, digits: float,
    ws: ShapedWorkspace,
) -> tuple[float, float]:  # fmt: skip
    """I_s and I_p at one angle of incidence; ``found`` is of `shaped_cumulative` with ``ws``."""
    n = _place_nodes(inc, surf, shaped, digits, ws)
    _fill_lobes(n, surf, shaped, ws)
    norm_s = norm_p = 0.0
    for i in range(n):
        c_s, c_p = cumulative_at(ws.nodes[5, i], found)
        norm_s += ws.lobes[0, i] * c_p
        norm_p += ws.lobes[1, i] * c_s
    if inc.theta == 0.0:  # alpha and beta, and with them s and p, change places
        norm_s = norm_p = 0.5 * (norm_s + norm_p)
    return norm_s, norm_p
