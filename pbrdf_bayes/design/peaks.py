"""A normal law about the highest point of a density: where an adaptation starts.

Where a reading tells much, the draws from before it are so far off that no weighting of them finds
the place; climbing does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

Array = NDArray[np.float64]

_STEP = 1e-4
"""Of the slopes, in standard deviations before the reading."""
_MOST_STEPS = 150
_NOWHERE = 1e10
_SCALINGS = 8
_WEAKEST = 1e-3
"""Least curvature along a direction beside that along the axes."""


def peak_of(
    log_density: Callable[[Array], Array], start: Array, sd: Array
) -> tuple[Array, Array, int] | None:
    """Centre and covariance of the normal law like a density about its peak, and sets evaluated.

    Parameters
    ----------
    log_density : callable
        Of sets, shape (n, n_par); -inf where there is nothing.
    start : ndarray, shape (n_par,)
        Where to climb from.
    sd : ndarray, shape (n_par,)
        Scales of the parameters; the law is no wider than these.

    Returns
    -------
    tuple or None
        None where no curvature is found.

    Examples
    --------
    >>> width = np.array([0.01, 2.0])
    >>> def normal(z):
    ...     return -0.5 * np.sum((z / width) ** 2, axis=1)
    >>> centre, covariance, _ = peak_of(normal, np.ones(2), np.array([1.0, 10.0]))
    >>> bool(np.all(np.abs(centre / width) < 0.01)), np.sqrt(np.diag(covariance)).round(4).tolist()
    (True, [0.01, 2.0])
    """
    n = len(start)
    spent = 0

    def at(z: Array) -> Array:
        nonlocal spent
        spent += len(z)
        with np.errstate(divide="ignore"):  # a step to where the logarithm of nothing is taken
            values = log_density(z)
        return np.where(np.isfinite(values), values, -_NOWHERE)

    axes = np.eye(n)

    def climbed(v: Array) -> tuple[float, Array]:
        values = at(sd * np.concatenate([v[None], v + _STEP * axes, v - _STEP * axes]))
        return -float(values[0]), (values[1 + n :] - values[1 : 1 + n]) / (2.0 * _STEP)

    found = minimize(
        climbed, start / sd, jac=True, method="L-BFGS-B", options={"maxiter": _MOST_STEPS}
    )
    top, height = np.asarray(found.x), -float(found.fun)
    width = _widths(lambda v: at(sd * v), top, height)
    curvature = _curvature(lambda v: at(sd * v), top, height, width)
    if not np.isfinite(curvature).all():
        return None
    size, directions = np.linalg.eigh(curvature)
    inside = directions @ np.diag(1.0 / np.maximum(size, _WEAKEST)) @ directions.T
    scale = sd * width
    covariance = scale[:, None] * inside * scale
    much = np.maximum(np.sqrt(np.diag(covariance)) / sd, 1.0)
    return sd * top, covariance / much[:, None] / much, spent


def _widths(at: Callable[[Array], Array], top: Array, height: float) -> Array:
    """Steps along the axes over which the log-density falls by about one half."""
    width = np.full(top.size, 1e-2)
    for _ in range(_SCALINGS):
        moved = np.diag(width)
        fall = height - 0.5 * (at(top + moved) + at(top - moved))
        width = width * np.clip(np.sqrt(0.5 / np.maximum(fall, 1e-6)), 0.05, 10.0)
        width = np.minimum(width, 1.0)
    return width


def _curvature(at: Callable[[Array], Array], top: Array, height: float, width: Array) -> Array:
    """Second differences of minus the log-density in units of ``width``, shape (n, n)."""
    n = top.size
    ends = np.diag(width)
    rows, columns = np.triu_indices(n, 1)
    one, other = ends[rows], ends[columns]
    up, down = at(top + ends), at(top - ends)
    corners = [at(top + a * one + b * other) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    found = np.diag(2.0 * height - up - down)
    found[rows, columns] = -(corners[0] - corners[1] - corners[2] + corners[3]) / 4.0
    found[columns, rows] = found[rows, columns]
    return found
