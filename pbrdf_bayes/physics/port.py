"""Directions inside a circular port about the specular direction, with weights.

The light scattered into the cone of half angle psi about the specular direction, of unit
irradiance, is the integral of the BRDF over the part of the disk of direction cosines

    alpha sin(theta_i) + gamma cos(theta_i) >= cos(psi),   gamma = sqrt(1 - alpha^2 - beta^2),

since cos(theta_r) d omega = d alpha d beta. For given alpha = sin t it reaches up to

    beta^2 <= cos^2 t - max(0, (cos(psi) - sin(t) sin(theta_i)) / cos(theta_i))^2.

Lobes peak at t = theta_i and beta = 0: both variables are stretched around the peak by a sinh,
which spreads nodes over all scales between the width of the lobe and the port, in panels with as
many Gauss nodes as the digits ask for. At the rim the range of beta goes to zero like the square
root of the distance, which is the variable there. A port that reaches below the horizon has a kink
of that range where the cone meets it, a panel ends there; at the horizon the range goes to zero.
"""

from __future__ import annotations

from itertools import pairwise
from math import asin, asinh, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.normalisation.plain import incidence
from pbrdf_bayes.physics.normalisation.quadrature import panel_split
from pbrdf_bayes.physics.normalisation.shaped import peak_width

Array = NDArray[np.float64]

_POLE = 1.2
_NARROWEST = 1e-9


def port_nodes(
    theta_i: float, half_angle: float, *, width: float, rho0: float, digits: float = 8.0
) -> tuple[Array, Array, Array]:
    """Nodes and weights of the integral of a BRDF over the light inside a specular port.

    Parameters
    ----------
    theta_i : float
        Angle of incidence [rad], below pi/2.
    half_angle : float
        Of the cone about the specular direction [rad]; what is below the horizon does not count.
    width : float
        Half width of the narrowest lobe along theta_r, rho_q(alpha_i) of Eq. (5) [rad].
    rho0 : float
        Half width of the narrowest lobe across [1]. Wider lobes are integrated as well.
    digits : float
        Correct decimal digits, relative to the DHR (``tests/model/test_ddr.py``).

    Returns
    -------
    tuple of ndarray, each of shape (n_nodes,)
        theta_r and phi_r [rad], weights [sr]: the sum of weight times BRDF is a reflectance [1].
        Nodes have beta >= 0 and count for both halves.
    """
    scale = max(min(width, 0.5 * pi - theta_i), _NARROWEST)
    horizon = 0.5 * pi - theta_i
    meets = cos(half_angle) / sin(theta_i) if half_angle > horizon else 1.0
    kink = asin(meets) - theta_i if meets < 1.0 else half_angle
    sides = [
        (side, [0.0, side * kink, end] if 0.0 < side * kink < end else [0.0, end])
        for side, end in ((-1.0, half_angle), (1.0, min(half_angle, horizon)))
    ]
    parts = []
    for side, stops in sides:
        for near, until in pairwise(stops):
            middle = 0.5 * (near + until) if until == stops[-1] else until
            parts.append(_peak_panel(near, middle, scale, digits, side))
            if until == half_angle:
                steep = 2.0 * cos(theta_i + side * until) * sin(until) / cos(theta_i)
                layer = rho0 / sqrt(max(steep, rho0))
                parts.append(_rim_panel(middle, until, layer, digits, side))
            elif until == horizon:
                parts.append(_horizon_panel(middle, until, rho0, digits))
    delta, of_t = (np.concatenate(part) for part in zip(*parts, strict=True))
    t = theta_i + delta
    alpha, cosine = np.sin(t), np.maximum(np.cos(t), 0.0)
    least = np.maximum((cos(half_angle) - alpha * sin(theta_i)) / cos(theta_i), 0.0)
    rim = np.sqrt(np.maximum((cosine - least) * (cosine + least), 0.0))
    stretch = np.arcsinh(rim / rho0)[:, None]
    u, of_u = _nodes(float(stretch.max()), digits)
    beta = rho0 * np.sinh(stretch * u)
    weight = 2.0 * (of_t * cosine)[:, None] * of_u * rho0 * stretch * np.cosh(stretch * u)
    sine = np.minimum(np.hypot(alpha[:, None], beta), 1.0)
    return np.arcsin(sine).ravel(), np.arctan2(beta, alpha[:, None]).ravel(), weight.ravel()


@compiled()
def lobe_widths(x: Array, theta_i: float, narrowing: Array) -> Array:
    """Half width [rad] of the narrower of the lobes of s and p along theta_r.

    rho_q(alpha_i) of Eq. (5) for parameter sets of shape (n_sets, 4), at theta_i [rad], with the
    exponent ``narrowing`` of shape (n_sets,); returns shape (n_sets,).
    """
    inc = incidence(theta_i)
    widths = np.empty(x.shape[0])
    for i in range(widths.size):
        surf = surface(x[i, 0], x[i, 1], x[i, 2], x[i, 3])
        widths[i] = peak_width(inc, surf, narrowing[i])
    return widths


def _peak_panel(
    near: float, far: float, scale: float, digits: float, side: float
) -> tuple[Array, Array]:
    """Signed distances from the peak and weights between two distances, stretched around it."""
    a, b = asinh(near / scale), asinh(far / scale)
    v, weight = _nodes(b - a, digits)
    u = a + (b - a) * v
    return side * scale * np.sinh(u), weight * (b - a) * scale * np.cosh(u)


def _rim_panel(
    near: float, rim: float, scale: float, digits: float, side: float
) -> tuple[Array, Array]:
    """The same up to a rim, stretched in the root of the distance from it, scale sinh u.

    ``scale`` is where the range of beta is as wide as the lobe.
    """
    length = asinh(sqrt(rim - near) / scale)
    v, weight = _nodes(length, digits)
    root = scale * np.sinh(length * v)
    return side * (rim - root**2), weight * length * 2.0 * root * scale * np.cosh(length * v)


def _horizon_panel(near: float, horizon: float, scale: float, digits: float) -> tuple[Array, Array]:
    """The same up to the horizon, where the range of beta goes to zero: stretched around it."""
    length = asinh((horizon - near) / scale)
    v, weight = _nodes(length, digits)
    return horizon - scale * np.sinh(length * v), weight * length * scale * np.cosh(length * v)


def _nodes(length: float, digits: float) -> tuple[Array, Array]:
    """Gauss nodes and weights on [0, 1] for an integrand that is stretched over ``length``."""
    n_panels, order = panel_split(length, digits, _POLE)
    node, weight = np.polynomial.legendre.leggauss(order)
    v = (np.arange(n_panels)[:, None] + 0.5 * (node + 1.0)) / n_panels
    return v.ravel(), np.tile(0.5 * weight / n_panels, n_panels)
