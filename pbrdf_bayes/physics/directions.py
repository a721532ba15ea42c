"""Directions as the model needs them: mean sines, cosines, differences, without cancellation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    out_of_line = 2.0 * np.sin(0.5 * phi_r) ** 2  # 1 - cos(phi_r)
    beta = np.sin(theta_r) * np.sin(phi_r)
    alpha = np.sin(theta_r) * np.cos(phi_r)
    shortfall = _one_minus_sine(theta_r) + np.sin(theta_r) * out_of_line  # 1 - alpha
    root_alpha = np.where(
        out_of_line == 0.0, np.abs(np.cos(theta_r)), _root(np.maximum(shortfall, 0.0), 1.0 + alpha)
    )
    offset = (
        2.0 * np.cos(0.5 * (theta_r + theta_i)) * np.sin(0.5 * (theta_r - theta_i))
        - np.sin(theta_r) * out_of_line
    )
    mean_shortfall = 0.5 * (np.maximum(shortfall, 0.0) + _one_minus_sine(theta_i))
    x = 0.5 * (alpha + np.sin(theta_i))
    root_beta = _root(1.0 - beta, 1.0 + beta)
    return Directions(
        x=x,
        c=_root(mean_shortfall, 1.0 + x),
        offset=offset,
        h=0.25 * (np.cos(theta_i) + root_alpha) ** 2,
        beta_x=0.5 * beta,
        beta_c=_root(1.0 - 0.5 * beta, 1.0 + 0.5 * beta),
        beta_offset=beta,
        beta_h=0.25 * (1.0 + root_beta) ** 2,
    )


def _one_minus_sine(theta: Array) -> Array:
    """1 - sin(theta) without cancellation: 2 sin^2((pi/2 - theta)/2)."""
    return 2.0 * np.sin(0.25 * np.pi - 0.5 * theta) ** 2


def _root(a: Array, b: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(a, 0.0) * np.maximum(b, 0.0)))
