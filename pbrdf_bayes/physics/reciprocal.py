"""A reciprocal normalisation in place of Eq. (4): one factor for each direction, symmetric.

    f_q(alpha_i; alpha, beta) = sigma_N0 g_q(alpha_i) A_q(alpha; alpha_i) B_q'(beta) g_q(|alpha|)

A_q is symmetric in its two angles, so that f is reciprocal in the plane of incidence whatever g is.
The DHR of Eq. (2) at every angle of incidence determines g: with C as in `normalisation`,

    g_q(alpha_i) integral of A_q(alpha; alpha_i) g_q(|alpha|) C_q'(sqrt(1 - alpha^2)) d alpha
        = F_q(alpha_i),                                             alpha from -1 to 1,

solved by g <- sqrt(g F / K g). Out of plane A_q B_q' itself is not reciprocal, and no factor makes
it so; g depends on alpha alone there because the integral then separates.

Unknowns. The distance from grazing, gamma = pi/2 - theta, is cut into panels that halve towards
grazing, where g goes to zero like sqrt(cos(theta)); g / sqrt(cos(theta)) is a polynomial on each,
known at Gauss points. Near a Brewster zero of F_q, where g has one, too, panels are halved until
the equation holds between the points. Elsewhere g = F / K g, with K g interpolated: it is smooth
and has no zero, so that g keeps its relative accuracy where F has one.

Quadrature. The integral at one angle has its own panels: those of g and, around the peak, distances
that double from the half width of the lobe on. A Gauss rule on each has every pole of the integrand
at least about a panel's length away, for lobes of any width. The share of what is closer to grazing
than `NEAREST` falls like the power 7/2 of that distance.
"""

from __future__ import annotations

from math import asinh, pi
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from pbrdf_bayes.physics.directions import Directions
from pbrdf_bayes.physics.fresnel import Surface, reflectances, surface, transmittances
from pbrdf_bayes.physics.normalisation.plain import VALUES, expand_cumulative, fill_lobes, workspace
from pbrdf_bayes.physics.normalisation.quadrature import expansion_order

Array = NDArray[np.float64]

ORDER = 16
HALVINGS = 30
NEAREST = 0.5 * pi * 0.5 ** (HALVINGS - 5)
"""Distance from grazing [rad] below which g follows its limiting law, sqrt(cos(theta))."""
MAX_PANELS = 100
_DIGITS = 12.5
_MAX_STEPS = 400
_STEP_TOLERANCE = 1e-13
_PROBES = np.array([0.02, 0.35, 0.65, 0.98])


def _points() -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(ORDER)
    return 0.5 * (1.0 + x), 0.5 * w


_X, _W = _points()
_BARYCENTRIC = 1.0 / np.prod(4.0 * (_X[:, None] - _X) + np.eye(ORDER), axis=1)


class Scale(NamedTuple):
    """The factor g of s and p for one surface, sigma_N0 left out."""

    surf: Surface
    cumulative: Array
    """(2, m): Chebyshev coefficients of C_s/u and C_p/u in u = asinh(gamma/rho0)."""
    edges: Array
    """(n_panels + 1,): distances from grazing [rad]."""
    smooth: Array
    """(2, n_panels, ORDER): g / sqrt(cos(theta)) at the points of the panels."""
    below: Array
    """(2, n_panels, ORDER): K g sqrt(cos(theta)) there."""
    error: float
    """Largest relative deviation from the equation between the points: of K g, and of g where it
    stands for the largest on its panel."""


def solve_scale(n: float, k: float, rho0: float, tolerance: float) -> Scale:
    """The factor g, with panels halved until ``error`` is below the tolerance.

    Parameters
    ----------
    n, k, rho0 : float
        Of the model [1].
    tolerance : float
        Relative [1].

    Returns
    -------
    Scale
        With ``error`` above the tolerance where `MAX_PANELS` were not enough.
    """
    surf = surface(n, k, 1.0, rho0)
    edges = 0.5 * pi * 0.5 ** np.arange(HALVINGS, -1.0, -1.0)
    ones = np.ones((2, HALVINGS, ORDER))
    start = Scale(surf, _cumulative(surf), edges, ones, ones, np.inf)
    while True:
        found, errors = _probed(_iterated(start))
        bad = np.flatnonzero(errors > tolerance)
        if bad.size == 0 or found.edges.size + bad.size > MAX_PANELS + 1:
            return found
        middle = 0.5 * (found.edges[bad] + found.edges[bad + 1])
        start = _refined(found, np.sort(np.append(found.edges, middle)))


def scale_at(found: Scale, grazing: Array) -> Array:
    """The factors g_s and g_p, shape (2, n), at distances from grazing [rad], shape (n,).

    Zero at grazing itself.
    """
    near = np.maximum(grazing, NEAREST)
    below = _interpolated(found.edges, found.below, near)
    return _fresnel(found.surf, near) / below * np.sqrt(np.sin(grazing))


def shape(directions: Directions, surf: Surface) -> Array:
    """A_q B_q' of Eq. (3) for q = s, p, shape (2, n)."""
    geometry = np.stack(directions)
    along, across = np.empty((2, geometry.shape[1])), np.empty((2, geometry.shape[1]))
    fill_lobes(geometry, 0, 0, geometry.shape[1], surf, along)
    fill_lobes(geometry, 4, 0, geometry.shape[1], surf, across)
    return along * across[::-1]


def _cumulative(surf: Surface) -> Array:
    scratch = workspace()
    order = expansion_order(asinh(0.5 * pi / surf.rho0), _DIGITS)
    expand_cumulative(surf, order, VALUES, scratch)
    return scratch.coefficients[:VALUES, :order].copy()


def _fresnel(surf: Surface, grazing: Array) -> Array:
    """F_s and F_p, shape (2, n)."""
    angles = zip(np.cos(grazing).tolist(), np.sin(grazing).tolist(), strict=True)
    return np.array([reflectances(x, c, surf) for x, c in angles]).reshape(-1, 2).T


def _iterated(start: Scale) -> Scale:
    """Repeat g <- sqrt(g F / K g) until it stands."""
    panels = start.smooth.shape
    points = _on_panels(start.edges, _X)
    root = np.sqrt(np.sin(points))
    matrix = _matrix(start, points)
    wanted = _fresnel(start.surf, points)
    smooth = below = start.smooth.reshape(2, -1)
    for _ in range(_MAX_STEPS):
        before = smooth
        below = root * np.matmul(matrix, before[:, :, None])[:, :, 0]
        smooth = np.sqrt(before * wanted / below)
        change = np.abs(smooth - before).reshape(panels)
        if np.max(change / smooth.reshape(panels).max(axis=-1, keepdims=True)) < _STEP_TOLERANCE:
            break
    return start._replace(smooth=smooth.reshape(panels), below=below.reshape(panels))


def _probed(found: Scale) -> tuple[Scale, Array]:
    """With ``error``; and the errors of all panels, 0 for those nearest to grazing."""
    probes = _on_panels(found.edges, _PROBES)
    matrix = _matrix(found, probes)
    below = np.sqrt(np.sin(probes)) * np.einsum("qnj,qj->qn", matrix, found.smooth.reshape(2, -1))
    off_below = np.abs(_interpolated(found.edges, found.below, probes) / below - 1.0)
    smooth = _fresnel(found.surf, probes) / below
    off = np.abs(_interpolated(found.edges, found.smooth, probes) - smooth)
    by_panel = (2, -1, _PROBES.size)
    errors = np.maximum(
        off_below.reshape(by_panel),
        off.reshape(by_panel) / found.smooth.max(axis=-1, keepdims=True),
    ).max(axis=(0, 2))
    errors = np.where(found.edges[:-1] < NEAREST, 0.0, errors)
    return found._replace(error=float(errors.max())), errors


def _refined(found: Scale, edges: Array) -> Scale:
    """The same on other panels, a start for the next iteration."""
    points = _on_panels(edges, _X)
    smooth = scale_at(found, points) / np.sqrt(np.sin(points))
    floor = found.smooth.min(axis=(1, 2))[:, None]
    kept = np.maximum(smooth, floor).reshape(2, -1, ORDER)
    return found._replace(edges=edges, smooth=kept)


def _on_panels(edges: Array, places: Array) -> Array:
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * places).ravel())


def _interpolated(edges: Array, values: Array, grazing: Array) -> Array:
    """Values (2, n_panels, ORDER) between the points, shape (2, n)."""
    panel, place = _located(edges, grazing)
    return np.asarray(np.einsum("qno,no->qn", values[:, panel], _lagrange(place)))


def _located(edges: Array, grazing: Array) -> tuple[NDArray[np.int64], Array]:
    """Panel of each distance, and its place in it, in [0, 1]."""
    panel = np.clip(np.searchsorted(edges, grazing, side="right") - 1, 0, edges.size - 2)
    return panel, (grazing - edges[panel]) / (edges[panel + 1] - edges[panel])


def _lagrange(place: Array) -> Array:
    """Weights of the points of a panel at places in it, shape (n, ORDER)."""
    gap = place[:, None] - _X
    hit = gap == 0.0
    weights = _BARYCENTRIC / np.where(hit, 1.0, gap)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(np.where(hit.any(axis=1, keepdims=True), hit, weights))


def _matrix(found: Scale, grazing: Array) -> Array:
    """K g = matrix @ smooth at the distances: shape (2, n, n_panels * ORDER)."""
    out = np.empty((2, grazing.size, (found.edges.size - 1) * ORDER))
    for i, distance in enumerate(grazing.tolist()):
        out[:, i] = _matrix_row(found, distance)
    return out


def _matrix_row(found: Scale, grazing_i: float) -> Array:
    """Shape (2, n_panels * ORDER): integrals of A_q C_q' sqrt(cos) times Lagrange's polynomials."""
    low, high, side = _pieces(found, grazing_i)
    grazing = (low[:, None] + (high - low)[:, None] * _X).ravel()
    lobes = _lobes(found.surf, grazing_i, grazing, np.repeat(side, ORDER))
    u = np.arcsinh(grazing / found.surf.rho0) / asinh(0.5 * pi / found.surf.rho0)
    cumulative = u * chebyshev.chebval(2.0 * u - 1.0, found.cumulative.T)
    values = lobes * cumulative[::-1] * np.sin(grazing) ** 1.5
    values = values.reshape(2, -1, ORDER) * ((high - low)[:, None] * _W)
    panel, _ = _located(found.edges, 0.5 * (low + high))
    width = found.edges[panel + 1] - found.edges[panel]
    place = (grazing.reshape(-1, ORDER) - found.edges[panel, None]) / width[:, None]
    weights = _lagrange(place.ravel()).reshape(-1, ORDER, ORDER)
    blocks = np.einsum("qpo,pox->pqx", values, weights)
    out = np.zeros((found.edges.size - 1, 2, ORDER))
    np.add.at(out, panel, blocks)
    return out.transpose(1, 0, 2).reshape(2, -1)


def _pieces(found: Scale, grazing_i: float) -> tuple[Array, Array, Array]:
    """Ends of the pieces of the integral as distances from grazing; +1 forward, -1 backward."""
    surf = found.surf
    t_s, t_p = transmittances(np.cos(grazing_i), np.sin(grazing_i), surf)
    width = 0.5 * min(surf.rho0, grazing_i, 0.25 * surf.width * min(t_s, t_p))
    distances = np.append(0.0, width * 2.0 ** np.arange(np.ceil(np.log2(pi / width))))
    forward = _merged(found.edges, np.append(grazing_i - distances, grazing_i + distances))
    backward = _merged(found.edges, pi - grazing_i - distances)
    side = np.repeat([1.0, -1.0], [forward.size - 1, backward.size - 1])
    low = np.concatenate([forward[:-1], backward[:-1]])
    return low, np.concatenate([forward[1:], backward[1:]]), side


def _merged(edges: Array, more: Array) -> Array:
    return np.unique(np.append(edges, more[(more > edges[0]) & (more < edges[-1])]))


def _lobes(surf: Surface, grazing_i: float, grazing: Array, side: Array) -> Array:
    """A_s and A_p, shape (2, n), all differences without cancellation."""
    short_i, half = 2.0 * np.sin(0.5 * grazing_i) ** 2, 0.5 * grazing
    short = 2.0 * np.where(side > 0.0, np.sin(half), np.cos(half)) ** 2  # 1 - alpha
    x = 0.5 * (side * np.cos(grazing) + np.cos(grazing_i))
    forward = 2.0 * np.sin(0.5 * (grazing_i + grazing)) * np.sin(0.5 * (grazing_i - grazing))
    offset = np.where(side > 0.0, forward, -np.cos(grazing) - np.cos(grazing_i))
    h = 0.25 * (np.sin(grazing_i) + np.sin(grazing)) ** 2
    geometry = np.stack([x, np.sqrt(0.5 * (short + short_i) * (1.0 + x)), offset, h])
    out = np.empty((2, grazing.size))
    fill_lobes(geometry, 0, 0, grazing.size, surf, out)
    return out
