"""The Laplace approximation: a t mixture at the optima."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.map_fit import MapResult, coordinate_bounds
from pbrdf_bayes.inference.mixture import Mixture
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_STEP = 1e-5
_RELEVANT_NATS = 12.0
_MAX_SD = 3.0
_FALL = 2.0
_REACHES = np.geomspace(1e-7, 1.0, 71)
"""Steps at which the density is looked at, in units of the standard deviation."""


def laplace_mixture(posterior: Posterior, optima: MapResult) -> Mixture:
    """One t component for each relevant optimum, shaped by the Hessian of the log-density in z."""
    low, high = coordinate_bounds(posterior)
    best = optima.best.log_posterior
    centres, factors, log_weights = [], [], []
    for optimum in optima.optima:
        if best - optimum.log_posterior > _RELEVANT_NATS:
            continue
        z = np.clip(posterior.to_coordinates(optimum.x[None, :])[0], low, high)
        factor = np.linalg.cholesky(_covariance(posterior, z, low, high))
        centres.append(z)
        factors.append(factor)
        value = posterior.log_prob_coordinates(z[None, :])[0]
        log_weights.append(value + np.log(np.diag(factor)).sum())
    weights = np.exp(np.array(log_weights) - np.max(log_weights))
    weights = np.maximum(weights / weights.sum(), 0.02)
    return Mixture(np.array(centres), np.array(factors), weights / weights.sum())


def _covariance(posterior: Posterior, z: Array, low: Array, high: Array) -> Array:
    """Inverse of the negative Hessian, no wider than the prior in any direction.

    The Hessian comes from central differences of the analytic gradient. Half the width of the
    support limits the standard deviation: a proposal must fall inside it. So does the density along
    each axis: that of k, where k is 0, is flat at its end and steep close by.
    """
    n = z.size
    inner = np.clip(z, low + 2.0 * _STEP, high - 2.0 * _STEP)
    points = np.concatenate([inner + _STEP * np.eye(n), inner - _STEP * np.eye(n)])
    _, slopes = posterior.gradient_coordinates(points)
    hessian = (slopes[:n] - slopes[n:]) / (2.0 * _STEP)
    widest = np.minimum(0.5 * (high - low), _MAX_SD)
    scaled = -0.5 * (hessian + hessian.T) * np.outer(widest, widest)
    eigenvalues, vectors = np.linalg.eigh(scaled)
    axes = widest[:, None] * vectors
    precisions = np.maximum(eigenvalues, 1.0)
    for i in range(n):
        sd = 1.0 / sqrt(precisions[i])
        limited = _limited(posterior, z, vectors[:, i], sd, widest, low, high)
        if limited < sd:
            precisions[i] = limited**-2
    return np.asarray((axes / precisions) @ axes.T)


def _limited(
    posterior: Posterior, z: Array, vector: Array, sd: float, widest: Array, low: Array,
    high: Array,
) -> float:  # fmt: skip
    """Standard deviation along an axis, or less: at it the density has to be within `_FALL` nats.

    In units of ``widest``, as the unit vector of the axis is; the side on which the density falls
    less counts. Steps end at the support; a side on which they are cut to less than half, as that
    of k below 0, tells nothing.
    """
    steps = sd * _REACHES
    both = np.concatenate([steps, -steps])
    points = np.clip(z + both[:, None] * (widest * vector), low, high)
    moved = np.linalg.norm((points - z) / widest, axis=1)
    tells = moved >= 0.5 * np.abs(both)
    fall = posterior.log_prob_coordinates(z[None, :])[0] - posterior.log_prob_coordinates(points)
    near = (tells & (fall < _FALL)).reshape(2, -1).any(axis=0)
    if near[-1] or not tells[[steps.size - 1, -1]].any():
        return sd
    return float(steps[near].max(initial=steps[0]) / sqrt(2.0 * _FALL))
