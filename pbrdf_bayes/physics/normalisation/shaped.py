"""The normalisation integral of Eq. (4) for the lobes of `pbrdf_bayes.physics.lobes.shaped`.

It is done as in `pbrdf_bayes.physics.normalisation.plain`: I_q = integral of A_q(alpha) C_q'(cos t)
d alpha, alpha = sin t, C the cumulative integral of B, s and p on the same nodes. What differs:

The interval is split between its centres and stretched around each of them:
`pbrdf_bayes.physics.normalisation.centres` says where they are, and has the rule for the orders.

C is expanded in Chebyshev polynomials piece by piece, C(v) = C(v0) + (v - v0) series(v), the
first piece from C = 0 on keeps the relative accuracy which grazing angles need.
"""

from __future__ import annotations

from math import asinh, ceil, log10, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, half_sincos, log
from pbrdf_bayes.physics.fresnel import Surface, transmittances
from pbrdf_bayes.physics.lobes.line_shapes import stretch
from pbrdf_bayes.physics.lobes.shaped import (
    GEOMETRIC_MEAN,
    LOWEST,
    Lobe,
    Places,
    fill_shaped_lobes,
)
from pbrdf_bayes.physics.normalisation.centres import (
    add_centre,
    branch_width,
    brewster,
    compare_widths,
    grazing_branch,
    pole_distance,
)
from pbrdf_bayes.physics.normalisation.plain import Incidence
from pbrdf_bayes.physics.normalisation.quadrature import (
    MAX_ORDER,
    ORDER_STEP,
    POINTS,
    antiderivative,
    first_point,
    lay_panels,
    sum_expansion,
)

Array = NDArray[np.float64]

MAX_SHAPED_NODES = 8192
MAX_PIECES = 64
PIECE_LENGTH = 2.2


class ShapedWorkspace(NamedTuple):
    """Scratch arrays of one evaluation, allocated once for many."""

    nodes: Array
    """(7, MAX_SHAPED_NODES): x, c, offset, h of each node, its weight, pi/2 - |t|, scratch."""
    lobes: Array
    """(4, MAX_SHAPED_NODES): lobes of s and p at the nodes; scratch for their widths."""
    sums: Array
    """(4, MAX_SHAPED_NODES): C of s and p at the nodes; scratch of the recurrence."""
    pieces: Array
    """(5, MAX_PIECES): where a piece of C ends, its centre, width, v0 and length."""
    coefficients: Array
    """(2, MAX_PIECES, MAX_ORDER + 1): C at the beginning of a piece, then its series."""
    centres: Array
    """(3, 16): place, width, and the width after comparison with the other centres."""


@compiled()
def shaped_workspace() -> ShapedWorkspace:
    """Allocate the scratch arrays."""
    return ShapedWorkspace(
        np.empty((7, MAX_SHAPED_NODES)),
        np.empty((4, MAX_SHAPED_NODES)),
        np.empty((4, MAX_SHAPED_NODES)),
        np.empty((5, MAX_PIECES)),
        np.empty((2, MAX_PIECES, MAX_ORDER + 1)),
        np.empty((3, 16)),
    )


class Cumulative(NamedTuple):
    """C_q(b), the integral of B_q over [-b, b], in pieces; lives in the workspace it came from."""

    n_pieces: int
    order: int
    pieces: Array
    coefficients: Array


# -------------------------------------------------------------------------------- cumulative


@compiled()
def _series_order(length: float, digits: float, pole: float) -> int:
    y = 2.0 * pole / max(length, 1.0)
    order = ceil((digits + 1.0) / log10(y + sqrt(1.0 + y * y))) + 1
    order = ORDER_STEP * ((order + ORDER_STEP - 1) // ORDER_STEP)
    return min(max(order, 2 * ORDER_STEP), MAX_ORDER)


@compiled()
def _cut_pieces(surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace) -> int:
    """Pieces of s in [0, pi/2]; returns their number."""
    width = surf.rho0 * stretch(shaped.shape)
    n = add_centre(0.0, width, 0, ws.centres)
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        angle, branch = brewster(surf)
        n = add_centre(angle, branch_width(branch, width, digits), n, ws.centres)
        n = add_centre(0.5 * pi, grazing_branch(surf), n, ws.centres)
    compare_widths(n, ws.centres)
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
    m = _series_order(longest, digits, pole_distance(shaped))
    before_s = before_p = 0.0
    for i in range(n):
        ws.coefficients[0, i, 0] = before_s
        ws.coefficients[1, i, 0] = before_p
        _place_transverse_nodes(i, first_point(m), m, ws)
        _fill_lobes(m, 0.0, 1.0, surf, shaped, ws)
        antiderivative(m, ws.lobes[0], ws.coefficients[0, i, 1:])
        antiderivative(m, ws.lobes[1], ws.coefficients[1, i, 1:])
        for j in range(1, m + 1):
            before_s += ws.coefficients[0, i, j]
            before_p += ws.coefficients[1, i, j]
    return Cumulative(n, m, ws.pieces, ws.coefficients)


@compiled()
def _place_transverse_nodes(piece: int, first: int, m: int, ws: ShapedWorkspace) -> None:
    """Geometry and weights of the nodes beta = sin s of one piece."""
    centre, width = ws.pieces[1, piece], ws.pieces[2, piece]
    v0, length = ws.pieces[3, piece], ws.pieces[4, piece]
    x_row, c_row, offset_row = ws.nodes[0][:m], ws.nodes[1][:m], ws.nodes[2][:m]
    h_row, weight_row, point = ws.nodes[3][:m], ws.nodes[4][:m], POINTS[first : first + m]
    for i in range(x_row.size):
        e = exp(v0 + length * point[i])
        inverse = 1.0 / e
        s = min(centre + 0.5 * width * (e - inverse), 0.5 * pi)
        sine_half, cosine_half = half_sincos(s)
        beta = 2.0 * sine_half * cosine_half
        cos_s = max((cosine_half - sine_half) * (cosine_half + sine_half), 0.0)
        x = 0.5 * beta
        x_row[i] = x
        c_row[i] = sqrt((1.0 - x) * (1.0 + x))
        offset_row[i] = beta
        h_row[i] = cosine_half * cosine_half * cosine_half * cosine_half
        weight_row[i] = length * width * (e + inverse) * cos_s


@compiled()
def _fill_lobes(
    n: int, sine_i: float, cosine_i: float, surf: Surface, shaped: Lobe, ws: ShapedWorkspace
) -> None:
    """Lobes of s and p at the nodes times the weights."""
    at = Places(ws.nodes[0][:n], ws.nodes[1][:n], ws.nodes[2][:n], ws.nodes[3][:n], ws.nodes[4][:n])
    fill_shaped_lobes(
        at, sine_i, cosine_i, surf, shaped, LOWEST,
        ws.lobes[2][:n], ws.lobes[3][:n], ws.lobes[0][:n], ws.lobes[1][:n],
    )  # fmt: skip


@compiled()
def _sum_cumulative(n: int, found: Cumulative, ws: ShapedWorkspace) -> None:
    """C of s and p at the nodes: runs of nodes within one piece at a time."""
    s = ws.nodes[5]
    first, piece = 0, 0
    while first < n:
        while piece < found.n_pieces - 1 and s[first] > found.pieces[0, piece]:
            piece += 1
        while piece > 0 and s[first] <= found.pieces[0, piece - 1]:
            piece -= 1
        low = found.pieces[0, piece - 1] if piece > 0 else -1.0
        high = found.pieces[0, piece] if piece < found.n_pieces - 1 else pi
        last = first + 1
        while last < n and low < s[last] <= high:
            last += 1
        _sum_piece(first, last, piece, found, ws)
        first = last


@compiled()
def _sum_piece(a: int, b: int, piece: int, found: Cumulative, ws: ShapedWorkspace) -> None:
    """C of s and p at the nodes a..b, all of them within one piece."""
    centre, inverse = found.pieces[1, piece], 1.0 / found.pieces[2, piece]
    v0, per_length = found.pieces[3, piece], 1.0 / found.pieces[4, piece]
    s, place = ws.nodes[5][a:b], ws.nodes[6][a:b]
    y, scratch = ws.sums[2][a:b], ws.sums[3][a:b]
    for i in range(s.size):
        distance = (s[i] - centre) * inverse
        v = log(abs(distance) + sqrt(distance * distance + 1.0))
        place[i] = ((v if distance >= 0.0 else -v) - v0) * per_length
        y[i] = 4.0 * place[i] - 2.0
    for q in range(2):
        series, out = found.coefficients[q, piece], ws.sums[q][a:b]
        sum_expansion(series[1:], found.order, y, out, scratch)
        for i in range(s.size):
            out[i] = series[0] + place[i] * out[i]


# ------------------------------------------------------------------------------------- norms


@compiled()
def peak_width(inc: Incidence, surf: Surface, narrowing: float) -> float:
    """Half width [rad] of the narrower of the two peaks of A."""
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    width: float = surf.rho0 * (min(t_s, t_p) / surf.transmittance0) ** narrowing
    return width


@compiled()
def _find_centres(
    inc: Incidence, surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace
) -> int:
    """Centres of the integral over t; returns their number."""
    half_pi, scale = 0.5 * pi, stretch(shaped.shape)
    rim = min(surf.rho0 * scale, inc.grazing)
    peak = min(rim, scale * peak_width(inc, surf, shaped.narrowing))
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        rim = min(rim, grazing_branch(surf))
    n = add_centre(-half_pi, rim, 0, ws.centres)
    n = add_centre(half_pi, rim, n, ws.centres)
    n = add_centre(inc.theta, peak, n, ws.centres)
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        angle, branch = brewster(surf)
        branch = branch_width(branch, peak, digits)
        n = add_centre(-angle, branch, n, ws.centres)
        n = add_centre(angle, branch, n, ws.centres)
        n = add_centre(angle - half_pi, branch, n, ws.centres)
        n = add_centre(half_pi - angle, branch, n, ws.centres)
        n = add_centre(0.0, grazing_branch(surf), n, ws.centres)
    compare_widths(n, ws.centres)
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
    last = lay_panels(v0, v1, digits, pole, at, ws.nodes[6], ws.nodes[4])
    above = inc.grazing if centre == inc.theta else 0.5 * pi - centre
    beyond = centre - inc.theta if abs(centre) < 0.5 * pi else inc.grazing
    if centre <= -0.5 * pi:
        above, beyond = pi, inc.grazing - pi
    weight, grazing, v = ws.nodes[4][at:last], ws.nodes[5][at:last], ws.nodes[6][at:last]
    for i in range(v.size):
        e = exp(v[i])
        inverse = 1.0 / e
        delta = 0.5 * width * (e - inverse)
        weight[i] *= 0.5 * width * (e + inverse)
        grazing[i] = above - delta
        v[i] = beyond + delta
    return last


@compiled()
def _place_nodes(
    inc: Incidence, surf: Surface, shaped: Lobe, digits: float, ws: ShapedWorkspace
) -> int:
    """Geometry and weights of all nodes; returns their number."""
    pole = pole_distance(shaped)
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
    x_row, c_row, offset_row = ws.nodes[0][:n], ws.nodes[1][:n], ws.nodes[2][:n]
    h_row, weight_row, grazing = ws.nodes[3][:n], ws.nodes[4][:n], ws.nodes[5][:n]
    peak = ws.nodes[6][:n]
    for i in range(x_row.size):
        both = grazing[i] + inc.grazing  # pi - (t + theta_i)
        short = both <= 0.5 * pi
        a, b = half_sincos(both if short else pi - both)
        cos_mean, sin_mean = (a if short else b), (b if short else a)
        sin_half, cos_half = half_sincos(peak[i])
        sin_grazing, cos_grazing = half_sincos(grazing[i])
        x_row[i] = sin_mean * cos_half
        root = cos_mean * cos_half
        c_row[i] = sqrt(cos_mean * cos_mean + sin_mean * sin_mean * sin_half * sin_half)
        offset_row[i] = 2.0 * cos_mean * sin_half
        h_row[i] = root * root
        weight_row[i] *= max(2.0 * sin_grazing * cos_grazing, 0.0)
        grazing[i] = max(min(grazing[i], pi - grazing[i]), 0.0)


@compiled(reassociate=True)
def _dot(a: Array, b: Array, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += a[i] * b[i]
    return total


@compiled()
def shaped_integrals(
    inc: Incidence, surf: Surface, shaped: Lobe, found: Cumulative, digits: float,
    ws: ShapedWorkspace,
) -> tuple[float, float]:  # fmt: skip
    """I_s and I_p of Eq. (4) at one angle; ``found`` is of `shaped_cumulative` with ``ws``."""
    n = _place_nodes(inc, surf, shaped, digits, ws)
    _fill_lobes(n, inc.sine, inc.cosine, surf, shaped, ws)
    _sum_cumulative(n, found, ws)
    norm_s = _dot(ws.lobes[0], ws.sums[1], n)
    norm_p = _dot(ws.lobes[1], ws.sums[0], n)
    if inc.theta == 0.0:  # alpha and beta, and with them s and p, change places
        norm_s = norm_p = 0.5 * (norm_s + norm_p)
    return norm_s, norm_p
