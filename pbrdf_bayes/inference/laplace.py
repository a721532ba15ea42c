"""The Laplace approximation: a t mixture at the optima."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.map_fit import MapResult, coordinate_bounds
from pbrdf_bayes.inference.mixture import Mixture
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_STEP = 1e-5
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
    """Inverse of the negative Hessian, no wider than the prior in any direction.

    The Hessian comes from central differences of the analytic gradient. Where it says nothing, half
    the width of the support limits the standard deviation: a proposal must fall inside it.
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
    return np.asarray((axes / np.maximum(eigenvalues, 1.0)) @ axes.T)
