"""Importance sampling with a mixture that adapts to the posterior, and its own health check."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import log10

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.arviz_adapter import pareto_smooth
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.rejected import Rejected, rejected_among
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture, resample
from pbrdf_bayes.verdict import K_HAT_LIMIT

Array = NDArray[np.float64]

_ROUNDS = 8
_ROUND_SIZE = 2_000
_GOOD_SHARE = 0.5
FITTING_SHARE = 0.4
_COMPONENTS = 6
_FIRST_WIDENING = 1.5
_FEWEST_EFFECTIVE = 25.0
OPTIMA_SHARE = 0.1
_REFINEMENTS = 2
_REFINING_SIZE = 8_000
_REFINED_COMPONENTS = 12
_PARTICLE_SHARE = 0.3
_ALIKE_MEANS = 0.5
"""Standard deviations."""
_ALIKE_WIDTHS = 0.6, 1.6


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
    rejected : Rejected
        Proposals at which the model gave no finite density.
    """

    z: Array
    log_prob: Array
    k_hat: float
    ess: float
    n_evaluations: int
    rejected: Rejected = field(default_factory=Rejected)

    def usable(self, ess_target: float, least_share: float = FITTING_SHARE) -> bool:
        """k-hat below min(1 - 1/log10 S, 0.7), and enough effective draws.

        Enough is the target and two fifths of the proposals: where a mixture fits worse than that,
        as on the arms of a banana, the smoothing of the weights was seen to cut variances by 13 %
        at a k-hat of 0.3 (test_laplace.py). Where a width wrong by a few per cent
        does no harm a smaller share will do.
        """
        share = self.ess / self.n_evaluations
        good = self.k_hat < k_hat_limit(self.n_evaluations) and share >= least_share
        return good and self.ess >= ess_target


def k_hat_limit(n_draws: int) -> float:
    """Largest Pareto shape at which importance sampling with n_draws is reliable."""
    return min(1.0 - 1.0 / log10(max(n_draws, 11)), K_HAT_LIMIT)


def adapt_mixture(
    posterior: Posterior, start: Mixture, *, seed: int, good_share: float = _GOOD_SHARE
) -> Mixture:
    """Fit the mixture to the posterior by rounds of importance sampling.

    All rounds so far are weighed against the mixture of their proposals (Cornuet et al. 2012,
    doi:10.1111/j.1467-9469.2011.00756.x) and refitted, until a good share of the draws is
    effective. While few are, the weights are tempered, so that no single point takes over.

    With several components at the start, one for each optimum, all of them stay in every proposal
    with a tenth of the draws: a fit that lost a mode would never meet it again, and its weights
    would look good.

    Parameters
    ----------
    posterior : Posterior
    start : Mixture
        In the coordinates z, e.g. from `laplace_mixture`.
    seed : int
    good_share : float
        Effective over proposed draws at which it ends, in (0, 1).

    Returns
    -------
    Mixture
    """
    rng = np.random.default_rng([seed, 8])
    proposals, points, values = [start.widened(_FIRST_WIDENING)], [], []
    n_components = max(_COMPONENTS, len(start.weights) + 1)
    for _ in range(_ROUNDS):
        z = proposals[-1].sample(rng, _ROUND_SIZE)
        points.append(z)
        values.append(posterior.log_prob_coordinates(z))
        every = np.concatenate(points)
        density = np.logaddexp.reduce([q.log_density(every) for q in proposals], axis=0)
        log_weights = np.concatenate(values) - density
        if effective_size(log_weights[-_ROUND_SIZE:]) > good_share * _ROUND_SIZE:
            break
        if not np.isfinite(log_weights).any():
            return start
        inside = np.isfinite(log_weights)
        weights, _ = tempered_weights(log_weights[inside], _FEWEST_EFFECTIVE * every.shape[1])
        fitted = fit_mixture(every[inside], weights, n_components, rng)
        lone = len(start.weights) == 1
        proposals.append(fitted if lone else fitted.joined(proposals[0], OPTIMA_SHARE))
    return proposals[-1]


def refine_mixture(posterior: Posterior, start: Mixture, particles: Array, *, seed: int) -> Mixture:
    """Fit the mixture anew to weighted draws of itself, beside particles of the posterior.

    The particles stay in every fit with a share of the weight, so that no arm of the posterior is
    lost which the proposals have not met yet.

    Parameters
    ----------
    posterior : Posterior
    start : Mixture
        Fitted to the particles.
    particles : ndarray, shape (n_particles, n_free)
        Coordinates z.
    seed : int

    Returns
    -------
    Mixture
    """
    rng = np.random.default_rng([seed, 10])
    mixture = start
    kept = np.full(len(particles), _PARTICLE_SHARE / len(particles))
    for _ in range(_REFINEMENTS):
        z = mixture.sample(rng, _REFINING_SIZE)
        log_prob = posterior.log_prob_coordinates(z)
        inside = np.isfinite(log_prob)
        if not inside.any():
            return start
        log_weights = log_prob[inside] - mixture.log_density(z[inside])
        weights, _ = tempered_weights(log_weights, _FEWEST_EFFECTIVE * z.shape[1])
        both = np.concatenate([(1.0 - _PARTICLE_SHARE) * weights, kept])
        points = np.concatenate([z[inside], particles])
        mixture = fit_mixture(points, both, _REFINED_COMPONENTS, rng)
    return mixture


def agrees_with(draws: ImportanceDraws, particles: Array) -> bool:
    """Tell whether draws and particles have alike means and widths.

    Weights look good where a proposal misses an arm of the posterior; particles that came from the
    prior have met it.
    """
    if not len(draws.z):
        return False
    sd = particles.std(axis=0)
    apart = np.abs(draws.z.mean(axis=0) - particles.mean(axis=0)) / sd
    ratio = draws.z.std(axis=0) / sd
    low, high = _ALIKE_WIDTHS
    return bool((apart < _ALIKE_MEANS).all() and (ratio > low).all() and (ratio < high).all())


def effective_size(log_weights: Array, power: float = 1.0) -> float:
    """Effective number of draws with weights raised to a power; those of -inf count nothing."""
    finite = log_weights[np.isfinite(log_weights)]
    if not finite.size:
        return 0.0
    weights = np.exp(power * (finite - finite.max()))
    return float(weights.sum() ** 2 / np.sum(weights**2))


def tempered_weights(log_weights: Array, fewest: float) -> tuple[Array, float]:
    """Normalised weights to the largest power that leaves enough effective points, and the power.

    Parameters
    ----------
    log_weights : ndarray, shape (n,)
        Finite.
    fewest : float
        Effective points that a fit needs.
    """
    power = 1.0
    while power > 1e-3 and effective_size(log_weights, power) < fewest:
        power *= 0.8
    weights = np.exp(power * (log_weights - log_weights.max()))
    return np.asarray(weights / weights.sum()), power


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
    rejected = rejected_among(posterior, posterior.from_coordinates(z), log_prob)
    log_weights = np.where(inside, log_prob - mixture.log_density(z), -np.inf)
    if inside.sum() < _ROUND_SIZE // 20:
        return ImportanceDraws(z[:0], log_prob[:0], np.inf, 0.0, n_proposals, rejected)
    smoothed, k_hat = pareto_smooth(log_weights[inside])
    weights = np.exp(smoothed - np.max(smoothed))
    weights /= weights.sum()
    chosen = rng.permutation(np.flatnonzero(inside)[resample(weights, n_draws, rng)])
    ess = float(1.0 / np.sum(weights**2))
    return ImportanceDraws(z[chosen], log_prob[chosen], k_hat, ess, n_proposals, rejected)
