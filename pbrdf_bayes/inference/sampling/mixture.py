"""Mixtures of multivariate t densities: the proposals of importance sampling and of the sampler."""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma, log, pi

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DOF = 6.0
_SMALLEST_WEIGHT = 0.02
_EM_STEPS = 25
_FITTED_POINTS = 6_000
_SHRINKAGE = 0.02
_DEFENSIVE_SHARE = 0.15
_DEFENSIVE_WIDTH = 2.0


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
        return np.asarray(self.centres[component] + moved * stretch)

    def component_log_densities(self, z: Array) -> Array:
        """Natural log of weight times density of each component, shape (n_components, n_sets)."""
        return self.log_densities_at(self.distances(z))

    def log_densities_at(self, distances: Array) -> Array:
        """The same from squared distances of this mixture, shape (n_components, n_sets)."""
        n_par = self.centres.shape[1]
        norm = lgamma(0.5 * (_DOF + n_par)) - lgamma(0.5 * _DOF) - 0.5 * n_par * log(_DOF * pi)
        logdet = np.log(np.diagonal(self.factors, axis1=1, axis2=2)).sum(axis=1)
        level = np.log(self.weights) + norm - logdet
        tails = 0.5 * (_DOF + n_par) * np.log1p(distances / _DOF)
        return np.asarray(level[:, None] - tails)

    def distances(self, z: Array) -> Array:
        """Squared Mahalanobis distances to the components, shape (n_components, n_sets)."""
        inverse = np.linalg.inv(self.factors)
        moved = (inverse @ self.centres[:, :, None])[:, :, 0]
        found = np.empty((len(self.centres), len(z)))
        for row, factor, centre in zip(found, inverse, moved, strict=True):  # fits in the cache
            whitened = z @ factor.T
            whitened -= centre
            np.einsum("ij,ij->i", whitened, whitened, out=row)
        return found

    def log_density(self, z: Array) -> Array:
        """Natural log of the density, shape (n_sets,)."""
        return np.asarray(np.logaddexp.reduce(self.component_log_densities(z), axis=0))

    def widened(self, factor: float) -> Mixture:
        """The same centres with scales multiplied by ``factor``."""
        return Mixture(self.centres, factor * self.factors, self.weights)

    def joined(self, other: Mixture, share: float) -> Mixture:
        """Itself with all components of another, which have equal parts of ``share``."""
        n_other = len(other.weights)
        return Mixture(
            np.concatenate([self.centres, other.centres]),
            np.concatenate([self.factors, other.factors]),
            np.concatenate([(1.0 - share) * self.weights, np.full(n_other, share / n_other)]),
        )


def fit_mixture(z: Array, weights: Array, n_components: int, rng: np.random.Generator) -> Mixture:
    """Fit t components to weighted points by expectation-maximisation.

    Parameters
    ----------
    z : ndarray, shape (n_points, n_par)
    weights : ndarray, shape (n_points,)
        Normalised importance weights.
    n_components : int
    rng : numpy.random.Generator
        Chooses the first centres, far from each other (k-means++).

    Returns
    -------
    Mixture
        Covariances are shrunk a little towards the overall one, so that none degenerates; one
        component more, wider than all points, keeps the tails covered.
    """
    mean = weights @ z
    overall = _covariance(z - mean, weights)
    if len(z) > _FITTED_POINTS:
        chosen = resample(weights, _FITTED_POINTS, rng)
        z, weights = z[chosen], np.full(_FITTED_POINTS, 1.0 / _FITTED_POINTS)
    whitened = np.linalg.solve(np.linalg.cholesky(overall), (z - mean).T).T
    centres = z[_spread_out(whitened, weights, n_components, rng)]
    mixture = Mixture(
        centres,
        np.tile(np.linalg.cholesky(overall / n_components), (len(centres), 1, 1)),
        np.full(len(centres), 1.0 / len(centres)),
    )
    for _ in range(_EM_STEPS):
        mixture = _em_step(mixture, z, weights, overall)
    wide = _DEFENSIVE_WIDTH * np.linalg.cholesky(overall)
    return Mixture(
        np.concatenate([mixture.centres, mean[None]]),
        np.concatenate([mixture.factors, wide[None]]),
        np.append((1.0 - _DEFENSIVE_SHARE) * mixture.weights, _DEFENSIVE_SHARE),
    )


def resample(weights: Array, size: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices drawn by normalised weights, by even steps from a random start, shape (size,)."""
    steps = (rng.random() + np.arange(size)) / size
    return np.minimum(np.searchsorted(np.cumsum(weights), steps), weights.size - 1)


def _em_step(mixture: Mixture, z: Array, weights: Array, overall: Array) -> Mixture:
    """One step; the latent scale of each t component downweights its far points."""
    distances = mixture.distances(z)
    log_parts = mixture.log_densities_at(distances)
    share = np.exp(log_parts - np.logaddexp.reduce(log_parts, axis=0)) * weights
    centres, factors, totals = [], [], []
    n_par = z.shape[1]
    precisions = (_DOF + n_par) / (_DOF + distances)
    deviations, room = np.empty(
        (2, *z.shape)
    )  # fresh memory at every turn costs more than the sums
    for row, precision in zip(share, precisions, strict=True):
        total = row.sum()
        if total < 1e-4:
            continue
        new = (row * precision) @ z / (row @ precision)
        np.subtract(z, new, out=deviations)
        spread = _covariance(deviations, row * precision / total, room)
        factors.append(np.linalg.cholesky((1.0 - _SHRINKAGE) * spread + _SHRINKAGE * overall))
        centres.append(new)
        totals.append(total)
    shares = np.maximum(np.array(totals) / np.sum(totals), _SMALLEST_WEIGHT)
    return Mixture(np.array(centres), np.array(factors), shares / shares.sum())


def _covariance(deviations: Array, weights: Array, room: Array | None = None) -> Array:
    """Weighted covariance; ``room``, of the shape of the deviations, is written over."""
    n_par = deviations.shape[1]
    matrix = np.multiply(deviations, weights[:, None], out=room).T @ deviations
    return np.asarray(matrix + 1e-12 * np.trace(matrix) / n_par * np.eye(n_par))


def _spread_out(
    z: Array, weights: Array, n_components: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Indices of centres: each drawn by weight times squared distance to those before it.

    Fewer than asked for where all the weight is on the centres already.
    """
    chosen = [int(rng.choice(len(z), p=weights))]
    distance = np.full(len(z), np.inf)
    for _ in range(n_components - 1):
        distance = np.minimum(distance, np.sum((z - z[chosen[-1]]) ** 2, axis=1))
        p = weights * distance
        if not p.sum() > 0.0:
            break
        chosen.append(int(rng.choice(len(z), p=p / p.sum())))
    return np.array(chosen)
