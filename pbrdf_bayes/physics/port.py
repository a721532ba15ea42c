"""Directions inside a circular port about the specular direction, with weights.

The light scattered into the cone of half angle psi about the specular direction, of unit
irradiance, is the integral of the BRDF over the part of the disk of direction cosines

    alpha sin(theta_i) + gamma cos(theta_i) >= cos(psi),   gamma = sqrt(1 - alpha^2 - beta^2),

since cos(theta_r) d omega = d alpha d beta. For given alpha it reaches up to

    beta^2 <= 1 - alpha^2 - max(0, (cos(psi) - alpha sin(theta_i)) / cos(theta_i))^2.

Lobes are Lorentzians of alpha and of beta about the specular direction: both are mapped by a sinh,
which spreads nodes over all scales between the width of the lobe and the port. At the rim the range
of beta goes to zero like a square root; the sine takes that away. A port that reaches
below the horizon has a kink of that range where the cone meets it: a panel ends there.
"""

from __future__ import annotations

from itertools import pairwise
from math import asinh, cos, pi, sin

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WIDEST, _NARROWEST = 0.5, 1e-4


def port_nodes(
    theta_i: float, half_angle: float, width: float, *, n_alpha: int = 40, n_beta: int = 24
) -> tuple[Array, Array, Array]:
    """Nodes and weights of the integral of a BRDF over the light inside a specular port.

    Parameters
    ----------
    theta_i : float
        Angle of incidence [rad], below pi/2.
    half_angle : float
        Of the cone about the specular direction [rad]; what is below the horizon does not count.
    width : float
        A tenth of the roughness, or less: lobes narrow towards grazing incidence [1].
    n_alpha, n_beta : int
        Nodes on either side of the specular direction and across. The defaults give 2e-6 of the
        DHR at rho0 = 1e-3 and 1e-10 above 0.05 (``tests/physics/test_port.py``).

    Returns
    -------
    tuple of ndarray, each of shape (n_nodes,)
        theta_r and phi_r [rad], weights [sr]: the sum of weight times BRDF is a reflectance [1].
        Nodes have beta >= 0 and count for both halves.
    """
    centre, scale = sin(theta_i), min(max(width, _NARROWEST), _WIDEST)
    low, high = sin(theta_i - half_angle), sin(min(theta_i + half_angle, 0.5 * pi))
    horizon = cos(half_angle) / centre if theta_i + half_angle > 0.5 * pi else np.inf
    alphas, weights = [], []
    for side, end in ((-1.0, low), (1.0, high)):
        far, kink = side * (end - centre), side * (horizon - centre)
        stops = [0.0, kink, far] if 0.0 < kink < far else [0.0, far]
        for near, until in pairwise(stops):
            distance, weight = _panel(near, until, scale, n_alpha, rim=until == far)
            alphas.append(centre + side * distance)
            weights.append(weight)
    alpha, of_alpha = np.concatenate(alphas), np.concatenate(weights)
    least = np.maximum((cos(half_angle) - alpha * centre) / cos(theta_i), 0.0)
    rim = np.sqrt(np.maximum(1.0 - alpha**2 - least**2, 0.0))
    u, of_u = _unit_nodes(n_beta)
    stretch = np.arcsinh(rim / scale)[:, None]
    beta = scale * np.sinh(stretch * u)
    weight = 2.0 * of_alpha[:, None] * of_u * scale * stretch * np.cosh(stretch * u)
    sine = np.minimum(np.hypot(alpha[:, None], beta), 1.0)
    return np.arcsin(sine).ravel(), np.arctan2(beta, alpha[:, None]).ravel(), weight.ravel()


def _panel(near: float, far: float, scale: float, n: int, *, rim: bool) -> tuple[Array, Array]:
    """Distances from the centre and weights between two distances; sine-graded towards a rim."""
    v, weight = _unit_nodes(n)
    if rim:
        v, weight = np.sin(0.5 * pi * v), weight * 0.5 * pi * np.cos(0.5 * pi * v)
    a, b = asinh(near / scale), asinh(far / scale)
    t = a + (b - a) * v
    return scale * np.sinh(t), weight * (b - a) * scale * np.cosh(t)


def _unit_nodes(n: int) -> tuple[Array, Array]:
    node, weight = np.polynomial.legendre.leggauss(n)
    return 0.5 * (node + 1.0), 0.5 * weight
