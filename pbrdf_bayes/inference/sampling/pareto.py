"""Pareto-smoothed importance weights of many readings at once.

The same numbers as ArviZ gives reading by reading (test_leave_one_out.py), some
hundred times faster: a measurement has thousands of readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]

_SPREAD = 3.0
_PRIOR_DRAWS = 10.0
_PRIOR_K = 0.5
_CHUNK = 1_000_000
_NOTHING = 10.0 * np.finfo(np.float64).eps


def smooth_weights(log_weights: Array) -> tuple[Array, Array]:
    """Replace the largest weights of each row by quantiles of a Pareto law fitted to them.

    Vehtari, Simpson, Gelman, Yao and Gabry 2024, JMLR 25(72). The number of weights in the tail is
    that for independent draws.

    Parameters
    ----------
    log_weights : ndarray, shape (n_rows, n_draws)

    Returns
    -------
    tuple of ndarray, shapes (n_rows, n_draws) and (n_rows,)
        Normalised log weights and the shape k-hat of each row, -inf where all weights of the tail
        are equal.

    Examples
    --------
    >>> smooth_weights(np.zeros((1, 100)))[1].tolist()
    [-inf]
    """
    n_rows, n_draws = log_weights.shape
    n_tail = int(3.0 * n_draws**0.5 if n_draws > 225 else n_draws / 5)
    smoothed = log_weights - log_weights.max(axis=1, keepdims=True)
    k_hat = np.full(n_rows, -np.inf)
    order = np.argsort(smoothed, axis=1)[:, n_draws - n_tail - 1 :]
    tails = np.take_along_axis(smoothed, order, axis=1)
    uneven = np.flatnonzero(tails[:, -1] > tails[:, 1])
    size = max(1, _CHUNK // (n_tail * _grid_size(n_tail)))
    for start in range(0, uneven.size, size):
        rows = uneven[start : start + size]
        cutoff = np.exp(tails[rows, :1])
        k_hat[rows], fitted = _fit_tail(np.exp(tails[rows, 1:]) - cutoff)
        with np.errstate(invalid="ignore"):  # a tail without a fit stays as it is
            values = np.minimum(np.log(fitted + cutoff), tails[rows, -1:])
        values = np.where(np.isfinite(values), values, tails[rows, 1:])
        smoothed[rows[:, None], order[rows, 1:]] = values
    return smoothed - logsumexp(smoothed, axis=1, keepdims=True), k_hat


def _grid_size(n: int) -> int:
    return 30 + int(n**0.5)


def _fit_tail(excess: Array) -> tuple[Array, Array]:
    """Shape of each row of ascending excesses, and the quantiles of the law fitted to it.

    Zhang and Stephens 2009, doi:10.1198/tech.2009.08017, with a weak prior of k about 1/2.
    """
    n = excess.shape[1]
    m = _grid_size(n)
    first = excess[:, int(n / 4 + 0.5) - 1]
    first = np.where(first > 0.0, first, np.finfo(np.float64).tiny ** 0.5)
    grid = (1.0 - np.sqrt(m / (np.arange(1, m + 1) - 0.5)))[None, :] / (_SPREAD * first[:, None])
    grid = grid + 1.0 / excess[:, -1:]
    shape = np.mean(np.log1p(-grid[:, :, None] * excess[:, None, :]), axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):  # a grid point at zero has no weight
        profile = n * (np.log(-grid / shape) - shape - 1.0)
    profile = np.where(np.isfinite(profile), profile, -np.inf)
    weights = np.exp(profile - logsumexp(profile, axis=1, keepdims=True))
    weights = np.where(weights >= _NOTHING, weights, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    b = np.sum(grid * weights, axis=1, keepdims=True)
    k = np.mean(np.log1p(-b * excess), axis=1, keepdims=True)
    scale = -k / b
    k = (n * k + _PRIOR_DRAWS * _PRIOR_K) / (n + _PRIOR_DRAWS)
    rank = -np.log1p(-(np.arange(n) + 0.5) / n)
    safe = np.where(k == 0.0, 1.0, k)
    quantile = np.where(k == 0.0, rank, np.expm1(safe * rank) / safe)
    return k[:, 0], scale * quantile


def leave_one_out(log_density: Array) -> tuple[Array, Array, Array, Array]:
    """Score readings with their own density taken out of the weights of the draws.

    Vehtari, Gelman and Gabry 2017, doi:10.1007/s11222-016-9696-4.

    Parameters
    ----------
    log_density : ndarray, shape (n_readings, n_draws)
        Of each reading given the others, at each draw.

    Returns
    -------
    tuple of ndarray
        Log predictive density of each reading given the others, its Pareto k-hat and effective
        number of parameters, each of shape (n_readings,); normalised log weights of the draws with
        that reading left out, shape (n_readings, n_draws).
    """
    log_weights, k_hat = smooth_weights(-log_density)
    elpd = logsumexp(log_weights + log_density, axis=1)
    every = logsumexp(log_density, axis=1) - np.log(log_density.shape[1])
    return np.asarray(elpd), k_hat, np.asarray(every - elpd), log_weights
