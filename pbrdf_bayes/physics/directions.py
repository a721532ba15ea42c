"""Directions as the model needs them: mean sines, cosines, differences, without cancellation."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]


class Directions(NamedTuple):
    """Pairs of an incidence and a scattering direction, one array element each.

    ``x`` is (alpha + alpha_i)/2 and ``c`` its cosine; ``offset`` is alpha - alpha_i; ``h`` is
    (cos theta_i + sqrt(1 - alpha^2))^2 / 4. ``beta_*`` are the same for beta and zero incidence.
    """

    x: Array
    c: Array
    offset: Array
    h: Array
    beta_x: Array
    beta_c: Array
    beta_offset: Array
    beta_h: Array


def prepare_directions(theta_i: Array, theta_r: Array, phi_r: Array) -> Directions:
    """Precompute what the parameters do not enter.

    Parameters
    ----------
    theta_i, theta_r, phi_r : ndarray, shape (n,)
        Angles [rad]; ``theta_r`` is signed, ``phi_r`` = 0 is the plane of incidence.

    Returns
    -------
    Directions
        Arrays of shape (n,), with full relative accuracy towards grazing and at the specular peak.
    """
    out = np.empty((8, theta_i.size))
    fill_directions(theta_i, theta_r, phi_r, out)
    return Directions(*out)


@compiled()
def fill_directions(theta_i: Array, theta_r: Array, phi_r: Array, out: Array) -> None:
    """The fields of `Directions` as the rows of ``out``, shape (8, n)."""
    t_i = phi = sin_i = cos_i = shortfall_i = sin_phi = cos_phi = out_of_line = 0.0
    for i in range(theta_i.size):
        if i == 0 or theta_i[i] != t_i:  # a scan has one of each
            t_i = theta_i[i]
            sin_i, cos_i, shortfall_i = sin(t_i), cos(t_i), _one_minus_sine(t_i)
        if i == 0 or phi_r[i] != phi:
            phi = phi_r[i]
            sin_phi, cos_phi = sin(phi), cos(phi)
            out_of_line = 2.0 * sin(0.5 * phi) ** 2  # 1 - cos(phi_r)
        t_r, sin_r = theta_r[i], sin(theta_r[i])
        beta = sin_r * sin_phi
        alpha = sin_r * cos_phi
        shortfall = max(_one_minus_sine(t_r) + sin_r * out_of_line, 0.0)  # 1 - alpha
        root_alpha = abs(cos(t_r)) if out_of_line == 0.0 else _root(shortfall, 1.0 + alpha)
        offset = 2.0 * cos(0.5 * (t_r + t_i)) * sin(0.5 * (t_r - t_i)) - sin_r * out_of_line
        mean_shortfall = 0.5 * (shortfall + shortfall_i)
        x = 0.5 * (alpha + sin_i)
        root_beta = _root(1.0 - beta, 1.0 + beta)
        out[0, i] = x
        out[1, i] = _root(mean_shortfall, 1.0 + x)
        out[2, i] = offset
        out[3, i] = 0.25 * (cos_i + root_alpha) ** 2
        out[4, i] = 0.5 * beta
        out[5, i] = _root(1.0 - 0.5 * beta, 1.0 + 0.5 * beta)
        out[6, i] = beta
        out[7, i] = 0.25 * (1.0 + root_beta) ** 2


@compiled(inline=True)
def _one_minus_sine(theta: float) -> float:
    """1 - sin(theta) without cancellation: 2 sin^2((pi/2 - theta)/2)."""
    half = sin(0.25 * pi - 0.5 * theta)
    return 2.0 * half * half


@compiled(inline=True)
def _root(a: float, b: float) -> float:
    return sqrt(max(a, 0.0) * max(b, 0.0))
