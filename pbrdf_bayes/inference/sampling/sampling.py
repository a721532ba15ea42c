"""Posterior draws by emcee: independent seeded ensembles, stopped by agreement between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import ceil

import emcee
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference import arviz_adapter
from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.rejected import Rejected
from pbrdf_bayes.inference.sampling.ensembles import (
    Checkpoint,
    Moves,
    SamplerState,
    begin,
    walk_to,
)
from pbrdf_bayes.inference.sampling.importance import (
    FITTING_SHARE,
    OPTIMA_SHARE,
    ImportanceDraws,
    adapt_mixture,
    agrees_with,
    importance_sample,
    refine_mixture,
)
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture
from pbrdf_bayes.inference.sampling.moves import choose_moves
from pbrdf_bayes.inference.sampling.tempered import tempered_particles

Array = NDArray[np.float64]

RHAT_LIMIT = 1.01
AUTOCORRELATION_TIMES = 50.0
_FEWEST_STEPS = 100
_GROWTH = 3
_FEWEST_WALKERS = 3
"""Per parameter: the density of half of them must not be flat in any direction."""
_BURN_TIMES = 8.0
_OVERDISPERSION = 2.0
_KEPT_DRAWS = 20_000
_PSIS_PROPOSALS = 8_000
_PSIS_DRAWS = 4_000
_PSIS_CHAINS = 4
_TEMPERED_COMPONENTS = 10
_ATTEMPTS = 2
_AGREED_SHARE = 0.05
"""Effective share of the proposals that is enough where particles from the prior confirm them."""


@dataclass(frozen=True)
class Progress:
    """What the progress bar shows after each round."""

    n_steps: int
    ess: float
    ess_target: int
    rhat: float
    seconds: float
    seconds_left: float


@dataclass(frozen=True, eq=False)
class Draws:
    """Posterior draws and how they were made.

    Attributes
    ----------
    x : ndarray, shape (n_chains, n_draws, n_par)
        Parameters in physical units; a chain is a walker.
    log_prob : ndarray, shape (n_chains, n_draws)
        Log-density in the sampling coordinates.
    ensemble : ndarray of int, shape (n_chains,)
        Which independent ensemble a chain belongs to.
    acceptance : ndarray, shape (n_chains,)
    ess_bulk, ess_tail, rhat, mcse_mean : ndarray, shape (n_par,)
        From all steps after burn-in, before thinning.
    method : {"emcee", "psis"}
    converged : bool
    n_steps, n_burn, thin : int
    autocorrelation_time : float
        Largest of the parameters [steps]; NaN for independent draws.
    k_hat : float
        Pareto shape of the importance weights where they were tried, else NaN.
    n_evaluations : int
        Likelihood evaluations.
    moves : str
    rejected : Rejected
        Points at which the model gave no finite density.
    """

    x: Array
    log_prob: Array
    ensemble: NDArray[np.int64]
    acceptance: Array
    ess_bulk: Array
    ess_tail: Array
    rhat: Array
    mcse_mean: Array
    method: str
    converged: bool
    n_steps: int
    n_burn: int
    thin: int
    autocorrelation_time: float
    k_hat: float
    n_evaluations: int
    moves: str
    rejected: Rejected = field(default_factory=Rejected)

    @property
    def flat(self) -> Array:
        """All draws, shape (n_chains * n_draws, n_par)."""
        return self.x.reshape(-1, self.x.shape[2])


def sample_posterior(
    posterior: Posterior,
    mixture: Mixture,
    config: RunConfig,
    *,
    method: str,
    seed: int,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
    least_share: float = FITTING_SHARE,
) -> Draws:
    """Draw from the posterior, the fast way where it can be trusted.

    Parameters
    ----------
    posterior : Posterior
    mixture : Mixture
        Laplace approximation, from which the proposals are adapted.
    config : RunConfig
    method : {"psis", "emcee"}
        ``psis`` falls through to ``emcee`` when its Pareto shape or sample size is not good enough.
    seed : int
        The draws are a function of it, whether or not the walk was interrupted.
    progress : callable, optional
    checkpoint : Checkpoint, optional
        A state to go on from, and who is handed the states that are reached.
    least_share : float
        Effective share of the proposals from which ``psis`` is good enough here.

    Returns
    -------
    Draws
        ``converged`` is False when the budget of steps ran out first.
    """
    checkpoint = checkpoint or Checkpoint()
    state = checkpoint.found
    with threadpool_limits(limits=1, user_api="blas"):
        if state is None:
            proposal = _find_proposal(posterior, mixture, config, seed, least_share)
            if method == "psis" and proposal.usable:
                return _from_importance(posterior, proposal.quick)
            state = _start_ensembles(posterior, proposal, config, seed)
        return _run_ensembles(posterior, state, config, progress, checkpoint)


@dataclass(frozen=True, eq=False)
class _Proposal:
    """A mixture that covers the posterior, how well, and whether its draws may be used."""

    mixture: Mixture
    quick: ImportanceDraws
    usable: bool


def _find_proposal(
    posterior: Posterior, laplace: Mixture, config: RunConfig, seed: int, least_share: float
) -> _Proposal:
    """The mixture adapted from the optima or, where that is poor, fitted to tempered particles.

    That one keeps the components of several optima: particles may have left a mode too soon.
    """
    mixture = adapt_mixture(posterior, laplace, seed=seed)
    quick = _try_importance(posterior, mixture, seed)
    if quick.usable(config.ess_target, least_share):
        return _Proposal(mixture, quick, True)
    particles = tempered_particles(posterior, seed=seed, threads=config.threads)
    rng = np.random.default_rng([seed, 9])
    even = np.full(len(particles), 1.0 / len(particles))
    mixture = fit_mixture(particles, even, _TEMPERED_COMPONENTS, rng)
    for attempt in range(_ATTEMPTS):
        mixture = refine_mixture(posterior, mixture, particles, seed=seed + attempt)
        if len(laplace.weights) > 1:
            mixture = mixture.joined(laplace, OPTIMA_SHARE)
        quick = _try_importance(posterior, mixture, seed)
        share = min(least_share, _AGREED_SHARE) if agrees_with(quick, particles) else least_share
        if quick.usable(config.ess_target, share):
            return _Proposal(mixture, quick, True)
    return _Proposal(mixture, quick, False)


def _try_importance(posterior: Posterior, mixture: Mixture, seed: int) -> ImportanceDraws:
    return importance_sample(
        posterior, mixture, n_proposals=_PSIS_PROPOSALS, n_draws=_PSIS_DRAWS, seed=seed
    )


def _from_importance(posterior: Posterior, quick: ImportanceDraws) -> Draws:
    """Independent draws in the same record as the chains."""
    z, log_prob = quick.z, quick.log_prob
    x = posterior.from_coordinates(z).reshape(_PSIS_CHAINS, -1, posterior.n_par)
    ensemble = np.arange(_PSIS_CHAINS)
    # resampling adds its own scatter to that of the weighted draws
    ess = np.full(posterior.n_par, 1.0 / (1.0 / quick.ess + 1.0 / len(z)))
    return Draws(
        x=x, log_prob=log_prob.reshape(_PSIS_CHAINS, -1), ensemble=ensemble,
        acceptance=np.ones(_PSIS_CHAINS), ess_bulk=ess, ess_tail=ess,
        rhat=arviz_adapter.rhat_between(x, ensemble), mcse_mean=x.std(axis=(0, 1)) / np.sqrt(ess),
        method="psis", converged=True, n_steps=x.shape[1], n_burn=0, thin=1,
        autocorrelation_time=np.nan, k_hat=quick.k_hat,
        n_evaluations=quick.n_evaluations,
        moves="importance resampling from an adapted t mixture", rejected=quick.rejected,
    )  # fmt: skip


def _start_ensembles(
    posterior: Posterior, proposal: _Proposal, config: RunConfig, seed: int
) -> SamplerState:
    """Over-dispersed walkers of every ensemble."""
    seeds = _ensemble_seeds(config, seed)
    n_walkers = max(config.n_walkers, 2 * ceil(_FEWEST_WALKERS * posterior.free.size / 2))
    starts = [start_walkers(posterior, proposal.mixture, n_walkers, s) for s in seeds]
    return begin(starts, seeds, proposal.mixture, proposal.quick, rejected=proposal.quick.rejected)


def _ensemble_seeds(config: RunConfig, seed: int) -> list[int]:
    return [int(s) for s in np.random.SeedSequence(seed).generate_state(config.n_ensembles)]


def _run_ensembles(
    posterior: Posterior, state: SamplerState, config: RunConfig,
    progress: Callable[[Progress], None] | None, checkpoint: Checkpoint,
) -> Draws:  # fmt: skip
    """Advance all ensembles in rounds until two rounds in a row pass."""

    def moves() -> Moves:
        return choose_moves(state.mixture, state.quick)[0]

    draws = None
    while state.n_passed < 2 and state.n_checked < config.max_steps:
        round_steps = max(_FEWEST_STEPS, state.n_checked // _GROWTH)
        end = min(state.n_checked + round_steps, config.max_steps)
        state = walk_to(posterior, state, moves, end, threads=config.threads, checkpoint=checkpoint)
        draws = _summarise(posterior, state)
        n_passed = state.n_passed + 1 if _converged(draws, config) else 0
        state = replace(state, n_checked=state.n_steps, n_passed=n_passed)
        checkpoint.keep(state, False)
        if progress is not None:
            progress(_progress(draws, config, state.seconds))
    checkpoint.keep(state, True)
    return _thin(draws or _summarise(posterior, state), converged=state.n_passed >= 2)


def start_walkers(posterior: Posterior, mixture: Mixture, n_walkers: int, seed: int) -> Array:
    """Over-dispersed walkers in z with finite density, shape (n_walkers, n_par)."""
    rng = np.random.default_rng([seed, 2])
    low, high = coordinate_bounds(posterior)
    wide = mixture.widened(_OVERDISPERSION)
    kept = np.zeros((0, low.size))
    for _ in range(100):
        z = wide.sample(rng, 4 * n_walkers)
        # a walker beyond a bound is folded back, so that ridges along a bound are populated
        z = np.where(z < low, 2.0 * low - z, np.where(z > high, 2.0 * high - z, z))
        z = z[np.all((z > low) & (z < high), axis=1)]
        z = z[np.isfinite(posterior.log_prob_coordinates(z))]
        kept = np.concatenate([kept, z])
        if len(kept) >= n_walkers:
            return kept[:n_walkers]
    fill = posterior.sample_prior(rng, n_walkers - len(kept))
    return np.concatenate([kept, posterior.to_coordinates(fill)])


def _summarise(posterior: Posterior, state: SamplerState) -> Draws:
    """Diagnostics of all steps after burn-in."""
    n_ensembles, n_walkers = state.starts.shape[:2]
    chains = state.z.swapaxes(1, 2).reshape(n_ensembles * n_walkers, -1, posterior.free.size)
    log_prob = state.log_prob.swapaxes(1, 2).reshape(len(chains), -1)
    n_steps = chains.shape[1]
    ensemble = np.repeat(np.arange(n_ensembles), n_walkers)
    tau = _autocorrelation_time(chains[:, n_steps // 4 :], ensemble)
    n_burn = min(int(max(_BURN_TIMES * tau, n_steps // 5)), n_steps // 2)
    z = chains[:, n_burn:]
    x = posterior.from_coordinates(z)
    # the walkers of one ensemble move together a little: the smaller of two estimates counts
    by_tau = z.shape[0] * z.shape[1] / tau
    return Draws(
        x=x, log_prob=log_prob[:, n_burn:], ensemble=ensemble,
        acceptance=state.accepted.ravel() / n_steps,
        ess_bulk=np.minimum(arviz_adapter.ess_bulk(x), by_tau),
        ess_tail=np.minimum(arviz_adapter.ess_tail(x), by_tau),
        rhat=arviz_adapter.rhat_between(x, ensemble), mcse_mean=arviz_adapter.mcse_mean(x),
        method="emcee", converged=False, n_steps=n_steps, n_burn=n_burn, thin=1,
        autocorrelation_time=tau, k_hat=state.quick.k_hat, n_evaluations=n_steps * len(chains),
        moves=choose_moves(state.mixture, state.quick)[1], rejected=state.rejected,
    )  # fmt: skip


def _autocorrelation_time(z: Array, ensemble: NDArray[np.int64]) -> float:
    """Largest integrated autocorrelation time over parameters and ensembles [steps]."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a walker that never moved
        times = [
            emcee.autocorr.integrated_time(z[ensemble == e].swapaxes(0, 1), tol=0, quiet=True)
            for e in np.unique(ensemble)
        ]
    tau = np.mean(times, axis=0)
    return max(float(tau.max()), 1.0) if np.isfinite(tau).all() else float(z.shape[1])


def _converged(draws: Draws, config: RunConfig) -> bool:
    ess = min(draws.ess_bulk.min(), draws.ess_tail.min())
    kept_steps = draws.x.shape[1]
    return bool(
        ess >= config.ess_target
        and draws.rhat.max() < RHAT_LIMIT
        and kept_steps >= AUTOCORRELATION_TIMES * draws.autocorrelation_time
    )


def _progress(draws: Draws, config: RunConfig, seconds: float) -> Progress:
    ess = float(min(draws.ess_bulk.min(), draws.ess_tail.min()))
    kept = draws.x.shape[1]
    steps_wanted = max(
        kept * config.ess_target / max(ess, 1.0),
        AUTOCORRELATION_TIMES * draws.autocorrelation_time,
    )
    left = max(steps_wanted - kept, 0.0) / draws.n_steps * seconds
    return Progress(draws.n_steps, ess, config.ess_target, float(draws.rhat.max()), seconds, left)


def _thin(draws: Draws, *, converged: bool) -> Draws:
    """Keep at most about 20 000 evenly spaced draws."""
    n_chains, n_steps, _ = draws.x.shape
    thin = max(1, n_chains * n_steps // _KEPT_DRAWS)
    changed = {
        "x": draws.x[:, ::thin],
        "log_prob": draws.log_prob[:, ::thin],
        "thin": thin,
        "converged": converged,
    }
    return Draws(**{**draws.__dict__, **changed})
