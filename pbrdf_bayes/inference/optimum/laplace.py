"""The Laplace approximation: a t mixture at the optima."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.optimum.map_fit import MapResult, coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.mixture import Mixture

Array = NDArray[np.float64]

_STEP = 1e-5
_RELEVANT_NATS = 12.0
_MAX_SD = 3.0
_FALL = 2.0
_REACHES = np.geomspace(1e-7, 1.0, 71)
"""Steps at which the density along an axis is looked at, in units of its standard deviation."""


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
    along = _Axes(posterior, z, widest, low, high)
    for i in np.flatnonzero(along.too_long(vectors / np.sqrt(precisions))):
        sd = 1.0 / sqrt(precisions[i])
        reach = along.reach(sd * vectors[:, i])
        precisions[i] = (sd * reach / sqrt(2.0 * _FALL)) ** -2
    return np.asarray((axes / precisions) @ axes.T)


@dataclass(frozen=True, eq=False)
class _Axes:
    """How the density falls along axes through z, in units of ``widest``.

    Steps end at the support; a side on which they are cut to less than half, as that of k below 0,
    tells nothing. The side on which the density falls less counts.
    """

    posterior: Posterior
    z: Array
    widest: Array
    low: Array
    high: Array

    def too_long(self, axes: Array) -> NDArray[np.bool_]:
        """Whether the density at the end of each column is more than `_FALL` nats lower."""
        tells, near = self._look(axes.T)
        return np.asarray(tells.any(axis=0) & ~near.any(axis=0))

    def reach(self, axis: Array) -> float:
        """Share of the axis at which it still is within that."""
        _, near = self._look(_REACHES[:, None] * axis)
        return float(_REACHES[near.any(axis=0)].max(initial=_REACHES[0]))

    def _look(self, steps: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether steps (n_steps, n_par) tell, and are near enough: (2, n_steps), a side each."""
        both = np.concatenate([steps, -steps])
        points = np.clip(self.z + both * self.widest, self.low, self.high)
        moved = np.linalg.norm((points - self.z) / self.widest, axis=1)
        tells = moved >= 0.5 * np.linalg.norm(both, axis=1)
        value = self.posterior.log_prob_coordinates(np.concatenate([self.z[None], points]))
        near = tells & (value[0] - value[1:] < _FALL)
        return tells.reshape(2, -1), near.reshape(2, -1)
