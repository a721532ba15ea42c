"""Which candidate is best, how sure that is, and which cannot be told apart from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]

_N_MEANS = 4000
_CLEAR = 0.9772
"""Quantile of Student's t beyond which brackets that do not overlap are apart."""
_HELD = 0.95
"""Chance that the best one is in the set of those not told apart."""


@dataclass(frozen=True, eq=False)
class Ranking:
    """Candidates by one utility.

    Attributes
    ----------
    value : ndarray, shape (n_candidates,)
    p_best : ndarray, shape (n_candidates,)
        Chance to be the best, given the simulated readings.
    tied : ndarray of bool, shape (n_candidates,)
        Cannot be told apart from the best: the fewest that hold the best one with a chance of 95 %,
        the one with the largest value among them; or those whose brackets overlap.
    pareto : ndarray of bool, shape (n_candidates,)
        No other one gives as much in fewer minutes, or more in as many.
    n_readings : int
        Simulated readings that the comparison rests on.
    """

    value: Array
    p_best: Array
    tied: NDArray[np.bool_]
    pareto: NDArray[np.bool_]
    n_readings: int


def rank(
    terms: Array, minutes: Array, *, per_minute: bool, seed: int, inner: Array | None = None,
    reach: Array | None = None,
) -> Ranking:  # fmt: skip
    """Rank candidates by their mean contributions.

    Parameters
    ----------
    terms : ndarray, shape (n_candidates, n_outer)
        Contributions of the same simulated paints to every candidate.
    minutes : ndarray, shape (n_candidates,)
    per_minute : bool
        Utility for each minute instead of each measurement.
    seed : int
        Of the bootstrap.
    inner : ndarray, shape (n_candidates, n_inner), optional
        How much each inner draw moves the mean.
    reach : ndarray, shape (n_candidates, 2), optional
        How far the truth may lie below and above the mean where a bracket is wide, else 0. Where
        brackets of the best ones overlap nothing is known of their order: they share ``p_best``
        evenly.

    Returns
    -------
    Ranking
    """
    each = 1.0 / minutes if per_minute else np.ones(len(minutes))
    utility = terms * each[:, None]
    value = utility.mean(axis=1)
    n = utility.shape[1]
    moved = np.zeros((len(value), 1)) if inner is None else inner * each[:, None]
    below, above = np.zeros((2, len(value))) if reach is None else (reach * each[:, None]).T
    best = int(np.argmax(value))
    away = utility[best] - utility
    error = np.sqrt(away.var(axis=1, ddof=1) / n + np.sum((moved[best] - moved) ** 2, axis=1))
    tied = away.mean(axis=1) - below[best] - above <= float(stdtrit(n - 1, _CLEAR)) * error
    tied[best] = True
    if np.any((below + above)[tied] > 0.0):
        p_best = tied / tied.sum()
    else:
        p_best = _chance_to_be_best(utility, moved, seed)
        order = np.argsort(-p_best, kind="stable")
        before = np.cumsum(p_best[order]) - p_best[order]
        tied = np.zeros(len(value), dtype=bool)
        tied[order[before < _HELD]] = True
        tied[best] = True
    return Ranking(value, p_best, tied, pareto_front(terms.mean(axis=1), minutes), n)


def _chance_to_be_best(utility: Array, moved: Array, seed: int) -> Array:
    """By draws of the means: Student's t of the readings, normal of the luck of inner draws.

    With n readings of unknown covariance the means have a multivariate t law of n - 1 degrees of
    freedom about those found.
    """
    n = utility.shape[1]
    rng = np.random.default_rng([seed, 40])
    away = utility - utility.mean(axis=1, keepdims=True)
    scale = 1.0 / np.sqrt(n * rng.chisquare(n - 1, _N_MEANS))
    size, axes = np.linalg.eigh(moved @ moved.T)
    luck = axes * np.sqrt(np.maximum(size, 0.0))
    means = utility.mean(axis=1)[:, None] + away @ rng.standard_normal((n, _N_MEANS)) * scale
    means = means + luck @ rng.standard_normal((len(utility), _N_MEANS))
    return np.bincount(means.argmax(axis=0), minlength=len(utility)) / _N_MEANS


def pareto_front(gain: Array, minutes: Array) -> NDArray[np.bool_]:
    """Candidates that no other one beats in gain and minutes, shape (n_candidates,).

    Examples
    --------
    >>> pareto_front(np.array([1.0, 0.5, 0.4]), np.array([10.0, 5.0, 6.0])).tolist()
    [True, True, False]
    """
    order = np.lexsort((-gain, minutes))
    front = np.zeros(gain.size, dtype=bool)
    most = 0.0
    for i in order:
        if gain[i] > most:
            front[i], most = True, float(gain[i])
    return front


def span_of_angles(angles: Sequence[float], grid: Sequence[float]) -> str:
    """Angles that are neighbours in ``grid`` as a range, others with commas.

    Examples
    --------
    >>> span_of_angles([60, 55, 65, 80], range(0, 90, 5)), span_of_angles([10, 15], [10, 15])
    ('55 to 65° and 80°', '10 and 15°')
    """
    wanted, runs = set(angles), list[list[float]]()
    previous = None
    for angle in sorted({*grid, *angles}):
        if angle in wanted:
            if previous not in wanted:
                runs.append([])
            runs[-1].append(angle)
        previous = angle
    words = [
        f"{run[0]:g} {'to' if len(run) > 2 else 'and'} {run[-1]:g}°" if len(run) > 1
        else f"{run[0]:g}°"
        for run in runs
    ]  # fmt: skip
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else words[0]
