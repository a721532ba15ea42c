"""Draft posterior: a t mixture at the optima, corrected by Pareto-smoothed importance sampling."""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma, log, log10, pi

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.arviz_adapter import pareto_smooth
from pbrdf_bayes.inference.map_fit import MapResult, coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_HESSIAN_STEP = 2e-4
_DOF = 6.0
_RELEVANT_NATS = 12.0
_MAX_SD = 3.0


@dataclass(frozen=True, eq=False)
class Mixture:
    """Multivariate t components in the coordinates z.

    Attributes
    ----------
    centres : ndarray, shape (n_components, n_par)
    factors : ndarray, shape (n_components, n_par, n_par)
        Lower Cholesky factors of the scale matrices.
    weights : ndarray, shape (n_components,)
    """

    centres: Array
    factors: Array
    weights: Array

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size, n_par)."""
        component = rng.choice(self.weights.size, size=size, p=self.weights)
        normal = rng.standard_normal((size, self.centres.shape[1]))
        stretch = np.sqrt(_DOF / rng.chisquare(_DOF, size))[:, None]
        moved = np.einsum("cij,cj->ci", self.factors[component], normal)
        return self.centres[component] + moved * stretch

    def log_density(self, z: Array) -> Array:
        """Natural log of the density, shape (n_sets,)."""
        n_par = z.shape[1]
        norm = lgamma(0.5 * (_DOF + n_par)) - lgamma(0.5 * _DOF) - 0.5 * n_par * log(_DOF * pi)
        parts = []
        for centre, factor, weight in zip(self.centres, self.factors, self.weights, strict=True):
            scaled = np.linalg.solve(factor, (z - centre).T)
            distance = np.sum(scaled**2, axis=0)
            parts.append(
                log(weight) + norm - np.log(np.diag(factor)).sum()
                - 0.5 * (_DOF + n_par) * np.log1p(distance / _DOF)
            )  # fmt: skip
        return np.asarray(np.logaddexp.reduce(parts, axis=0))


@dataclass(frozen=True, eq=False)
class ImportanceDraws:
    """Equally weighted draws by importance resampling, with the evidence that they can be used.

    Attributes
    ----------
    z : ndarray, shape (n_draws, n_par)
        Coordinates.
    log_prob : ndarray, shape (n_draws,)
    k_hat : float
        Pareto shape of the importance weights.
    ess : float
        Effective sample size of the weighted draws.
    n_evaluations : int
    """

    z: Array
    log_prob: Array
    k_hat: float
    ess: float
    n_evaluations: int

    def usable(self, ess_target: float) -> bool:
        """k-hat below min(1 - 1/log10 S, 0.7) and enough effective draws."""
        return self.k_hat < k_hat_limit(self.n_evaluations) and self.ess >= ess_target


def k_hat_limit(n_draws: int) -> float:
    """Largest Pareto shape at which importance sampling with n_draws is reliable."""
    return min(1.0 - 1.0 / log10(max(n_draws, 11)), 0.7)


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


def importance_sample(
    posterior: Posterior, mixture: Mixture, *, n_proposals: int, n_draws: int, seed: int
) -> ImportanceDraws:
    """Draw from the mixture, weigh by the posterior, smooth the weights, resample.

    Parameters
    ----------
    posterior : Posterior
    mixture : Mixture
    n_proposals, n_draws : int
        Proposals evaluated, and equally weighted draws returned.
    seed : int

    Returns
    -------
    ImportanceDraws
    """
    rng = np.random.default_rng([seed, 1])
    z = mixture.sample(rng, n_proposals)
    log_prob = posterior.log_prob_coordinates(z)
    inside = np.isfinite(log_prob)
    log_weights = np.where(inside, log_prob - mixture.log_density(z), -np.inf)
    if inside.sum() < 100:  # noqa: PLR2004
        return ImportanceDraws(z[:0], log_prob[:0], np.inf, 0.0, n_proposals)
    smoothed, k_hat = pareto_smooth(log_weights[inside])
    weights = np.exp(smoothed - np.max(smoothed))
    weights /= weights.sum()
    steps = (rng.random() + np.arange(n_draws)) / n_draws
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), steps), weights.size - 1)
    chosen = rng.permutation(np.flatnonzero(inside)[chosen])
    return ImportanceDraws(
        z[chosen], log_prob[chosen], k_hat, float(1.0 / np.sum(weights**2)), n_proposals
    )
