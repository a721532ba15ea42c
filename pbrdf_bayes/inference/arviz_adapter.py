"""The one place that talks to ArviZ, whose two generations (Python 3.11, 3.12+) differ elsewhere.

Arrays are (n_chains, n_draws, n_par); an ensemble is a group of chains (its walkers).
"""

from __future__ import annotations

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TAIL = (0.05, 0.95)
_POWERS = (0.99, 1.01)
_FLAT = 1e-9


def ess_bulk(draws: Array) -> Array:
    """Bulk effective sample size of each parameter, shape (n_par,)."""
    found = np.asarray(array_stats.ess(draws, chain_axis=0, draw_axis=1, method="bulk"))
    return np.where(_is_fixed(draws), draws[..., 0].size, found)


def ess_tail(draws: Array) -> Array:
    """Effective sample size of the 5 % and 95 % quantiles, the smaller one, shape (n_par,)."""
    found = array_stats.ess(draws, chain_axis=0, draw_axis=1, method="tail", prob=_TAIL)
    return np.where(_is_fixed(draws), draws[..., 0].size, np.asarray(found))


def ess_of_mean(values: Array) -> float:
    """Effective sample size of the mean of one quantity, shape (n_chains, n_draws)."""
    return float(array_stats.ess(values, chain_axis=0, draw_axis=1, method="mean"))


def mcse_mean(draws: Array) -> Array:
    """Monte Carlo standard error of the mean of each parameter, shape (n_par,)."""
    found = np.asarray(array_stats.mcse(draws, chain_axis=0, draw_axis=1, method="mean"))
    return np.where(_is_fixed(draws), 0.0, found)


def rhat_between(draws: Array, ensemble: NDArray[np.int64]) -> Array:
    """Nested R-hat between ensembles, shape (n_par,): Margossian et al., doi:10.1214/24-BA1453.

    Walkers of one ensemble talk to each other: agreement among them is no evidence. ``ensemble``,
    shape (n_chains,), says which walkers form one.
    """
    is_fixed = _is_fixed(draws)
    return np.array(
        [
            1.0
            if is_fixed[i]
            else array_stats.rhat_nested(
                draws[:, :, i], superchain_ids=ensemble, chain_axis=0, draw_axis=1
            )
            for i in range(draws.shape[2])
        ]
    )


def _is_fixed(draws: Array) -> NDArray[np.bool_]:
    """Parameters that all draws agree upon: there is nothing to be uncertain about."""
    return np.asarray(np.ptp(draws, axis=(0, 1)) == 0.0)


def pareto_smooth(log_weights: Array) -> tuple[Array, float]:
    """Pareto-smoothed normalised log weights and k-hat (Vehtari et al. 2024, JMLR 25(72))."""
    # psislw takes log-likelihoods, as leave-one-out does, and negates them
    smoothed, k_hat = array_stats.psislw(-log_weights)
    return np.asarray(smoothed), float(k_hat)


def power_scaling(draws: Array, log_component: Array) -> Array:
    """Sensitivity of each parameter to a power of prior or likelihood, shape (n_par,).

    Kallioinen et al. 2024, doi:10.1007/s11222-023-10366-5: change of the marginal (cumulative
    Jensen-Shannon distance) for each doubling of the power, at 1.

    Parameters
    ----------
    draws : ndarray, shape (n_chains, n_draws, n_par)
    log_component : ndarray, shape (n_chains, n_draws)
        Logarithm of what is raised to a power.
    """
    if np.ptp(log_component) < _FLAT:
        return np.zeros(draws.shape[2])
    lower, upper = (
        np.exp(array_stats.power_scale_lw(log_component, alpha=power, axis=(0, 1)))
        for power in _POWERS
    )
    return np.array(
        [
            array_stats.power_scale_sense(
                draws[:, :, i], lower, upper, *_POWERS, chain_axis=0, draw_axis=1
            )
            for i in range(draws.shape[2])
        ]
    )
