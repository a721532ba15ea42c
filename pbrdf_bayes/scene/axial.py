"""Angles modulo 180 deg, as the angle of linear polarisation is: quantiles, and mirror images.

Such angles have no smallest one, so that a band of them needs a place to be cut open. Here that is
opposite to their mean axis, half the argument of the mean of exp(2 i angle): the quantiles are
those of the deviations from it, each in [-90, 90) deg. The median lies in (-90, 90] deg; the ends
of the band are on their own side of it, and may therefore lie outside that range.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALF_TURN_DEG = 180.0
_DECIMALS = 10


def axial_quantiles(angles_deg: Array, quantiles: Sequence[float]) -> Array:
    """Quantiles over the first axis as the last one; for one set of angles that set.

    Parameters
    ----------
    angles_deg : ndarray, shape (n_sets, ...)
        Modulo 180 [deg].
    quantiles : sequence of float
        Increasing, 0.5 among them.

    Returns
    -------
    ndarray, shape (..., n_quantiles)
        Increasing [deg]; NaN where one of the angles is not defined.

    Examples
    --------
    >>> angles = np.array([[80.0], [88.0], [89.0], [-89.0], [-80.0]])
    >>> print(axial_quantiles(angles, (0.0, 0.5, 1.0)))
    [[ 80.  89. 100.]]
    """
    if len(angles_deg) == 1:
        return with_median_in_range(angles_deg[0][..., None], 0)
    axis = np.rad2deg(0.5 * np.angle(np.mean(np.exp(2j * np.deg2rad(angles_deg)), axis=0)))
    apart = np.mod(angles_deg - axis + 0.5 * HALF_TURN_DEG, HALF_TURN_DEG) - 0.5 * HALF_TURN_DEG
    found = axis + np.quantile(apart, quantiles, axis=0)
    return with_median_in_range(np.moveaxis(found, 0, -1), list(quantiles).index(0.5))


def with_median_in_range(bands_deg: Array, middle: int) -> Array:
    """Bands (..., n_quantiles) moved by multiples of 180 deg, their medians into (-90, 90]."""
    found = np.round(bands_deg, _DECIMALS)  # rounding does not make -90 of 90
    turns = np.ceil((found[..., middle] - 0.5 * HALF_TURN_DEG) / HALF_TURN_DEG)
    return np.asarray(found - HALF_TURN_DEG * turns[..., None])


def mirrored(bands_deg: Array, middle: int) -> Array:
    """Bands of the angles with the other sign."""
    return with_median_in_range(-bands_deg[..., ::-1], middle)
