"""The Laplace approximation: a t mixture at the optima."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.map_fit import MapResult, coordinate_bounds
from pbrdf_bayes.inference.mixture import Mixture
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_HESSIAN_STEP = 2e-4
_RELEVANT_NATS = 12.0
_MAX_SD = 3.0


def laplace_mixture(posterior: Posterior, optima: MapResult) -> Mixture:
    """One t component for each relevant optimum, shaped by the Hessian of the log-density in z."""
    low, high = coordinate_bounds(posterior)
    best = optima.best.log_posterior
    centres, factors, log_weights = [], [], []
    for optimum in optima.optima:
        if best - optimum.log_posterior > _RELEVANT_NATS:
            continue
        z = posterior.to_coordinates(optimum.x[None, :])[0]
        factor = np.linalg.cholesky(_covariance(posterior, z, low, high))
        centres.append(z)
        factors.append(factor)
        value = posterior.log_prob_coordinates(z[None, :])[0]
        log_weights.append(value + np.log(np.diag(factor)).sum())
    weights = np.exp(np.array(log_weights) - np.max(log_weights))
    weights = np.maximum(weights / weights.sum(), 0.02)
    return Mixture(np.array(centres), np.array(factors), weights / weights.sum())


def _covariance(posterior: Posterior, z: Array, low: Array, high: Array) -> Array:
    """Inverse of the negative Hessian, its eigenvalues limited so that it is always a covariance."""
    step = _HESSIAN_STEP
    inner = np.clip(z, low + 2.0 * step, high - 2.0 * step)
    n = z.size
    shifts = [inner]
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    for i, j in pairs:
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            point = inner.copy()
            point[i] += a * step
            point[j] += b * step
            shifts.append(point)
    values = posterior.log_prob_coordinates(np.array(shifts))[1:].reshape(-1, 4)
    curvature = np.zeros((n, n))
    for (i, j), (pp, pm, mp, mm) in zip(pairs, values, strict=True):
        curvature[i, j] = curvature[j, i] = -(pp - pm - mp + mm) / (4.0 * step * step)
    curvature = np.where(np.isfinite(curvature), curvature, 0.0)
    eigenvalues, vectors = np.linalg.eigh(curvature)
    limited = np.maximum(eigenvalues, 1.0 / _MAX_SD**2)
    return np.asarray((vectors / limited) @ vectors.T)
