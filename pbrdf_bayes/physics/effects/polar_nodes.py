"""Polar angles of a hemisphere, close to each other where a peak looks back to the source."""

from __future__ import annotations

from math import asinh, cosh, pi, sinh

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]

_X, _W = np.polynomial.legendre.leggauss(24)
_NODE, _WEIGHT = 0.5 * (1.0 + _X), 0.5 * _W


@compiled()
def polar_nodes(theta_i: float, width: float) -> tuple[Array, Array]:
    """Gauss nodes of theta_r in [0, pi/2] [rad] and their weights, shape (48,) each.

    theta_r = theta_i -+ width sinh u on either side of the ring that holds the peak.
    """
    theta, weight = np.empty(2 * _NODE.size), np.empty(2 * _NODE.size)
    for side in range(2):
        sign = 2.0 * side - 1.0
        length = asinh((theta_i if side == 0 else 0.5 * pi - theta_i) / width)
        for i in range(_NODE.size):
            u = length * _NODE[i]
            theta[side * _NODE.size + i] = theta_i + sign * width * sinh(u)
            weight[side * _NODE.size + i] = _WEIGHT[i] * length * width * cosh(u)
    return theta, weight
