"""Which candidate is best, how sure that is, and which cannot be told apart from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.nested import LOCAL, Gain, Spread

Array = NDArray[np.float64]

_N_MEANS = 4000
_HELD = 0.95
"""Chance that candidates as good as the best one are all among those not told apart from it."""
_CLEAR = 2.0
"""Standard errors beyond which a mean is no chance of the calculation."""
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Ranking:
    """Candidates by one utility.

    Attributes
    ----------
    value : ndarray, shape (n_candidates,)
    p_best : ndarray, shape (n_candidates,)
        Chance to be the best, given the simulated readings.
    tied : ndarray of bool, shape (n_candidates,)
        Cannot be told apart from the best: the paired difference to it is below 2 standard errors,
        or one that as many equal candidates would show, with a chance of 95 % that all of these
        are held (3.7 for 24 of them); or brackets overlap.
    pareto : ndarray of bool, shape (n_candidates,)
        More than 2 standard errors above 0, and no other one gives as much in fewer minutes, or
        more in as many.
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
    reach: Array | None = None, se: Array | None = None,
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
    se : ndarray, shape (n_candidates,), optional
        Standard error of each mean, where it rests on more than ``terms``.

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
    drawn = _drawn_errors(utility, moved, seed)
    covariance = np.cov(utility).reshape(len(value), -1) / n + moved @ moved.T
    behind = value[best] - value - below[best] - above
    tied = _not_told_apart(behind, best, drawn, covariance)
    if np.any((below + above)[tied] > 0.0):
        p_best = tied / tied.sum()
    else:
        first = (value[:, None] + drawn).argmax(axis=0)
        p_best = np.bincount(first, minlength=len(value)) / _N_MEANS
    mean = terms.mean(axis=1)
    error = np.sqrt(np.diag(covariance)) / each if se is None else se
    front = pareto_front(np.where(mean > _CLEAR * error, mean, 0.0), minutes)
    return Ranking(value, p_best, tied, front, n)


def rank_gains(gains: Sequence[Gain], minutes: Array, *, per_minute: bool, seed: int) -> Ranking:
    """Rank gains by the paints that all share, about the mean of each: the linear law has fewer.

    Of the local normal approximation the bracket says little.
    """
    return rank(
        _shared([g.terms for g in gains], [g.eig for g in gains]), minutes,
        per_minute=per_minute, seed=seed, inner=_side_by_side([g.inner for g in gains]),
        reach=np.array([
            (g.eig - g.low, g.high - g.eig) if g.wide and g.method != LOCAL else (0.0, 0.0)
            for g in gains
        ]),
        se=np.array([g.se for g in gains]),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class GoalRanking:
    """Candidates by the share of the variance of a prediction that they are expected to take away.

    Attributes
    ----------
    name : str
    left, left_se : ndarray, shape (n_candidates,)
        Variance after over before, and its standard error.
    by_measurement, by_minute : Ranking
    """

    name: str
    left: Array
    left_se: Array
    by_measurement: Ranking
    by_minute: Ranking


def rank_for_goal(
    name: str, spreads: Sequence[Spread], minutes: Array, column: int, *, seed: int
) -> GoalRanking:
    """Rank all candidates for one prediction.

    Parameters
    ----------
    name : str
    spreads : sequence of Spread
    minutes : ndarray, shape (n_candidates,)
    column : int
        Of the prediction among the quantities.
    seed : int
        Of the bootstrap.
    """
    left = np.array([spread.terms[:, column].mean() for spread in spreads])
    inner = _side_by_side([-spread.inner[:, column] for spread in spreads])
    variance = [spread.terms[:, column].var(ddof=1) / len(spread.terms) for spread in spreads]
    se = np.sqrt(np.array(variance) + np.sum(inner**2, axis=1))
    one, other = (
        rank(
            _shared([-spread.terms[:, column] for spread in spreads], 1.0 - left), minutes,
            per_minute=flag, seed=seed, inner=inner, se=se,
        )
        for flag in (False, True)
    )  # fmt: skip
    return GoalRanking(name, left, se, one, other)


def _shared(terms: Sequence[Array], means: Sequence[float] | Array) -> Array:
    """Terms of the paints that all candidates share, moved to the means over all of each."""
    n = min(t.size for t in terms)
    return np.array([t[:n] - t[:n].mean() + mean for t, mean in zip(terms, means, strict=True)])


def _side_by_side(moves: Sequence[Array | None]) -> Array:
    """How much inner draws move the candidates, (n_candidates, n_inner); 0 where there are none."""
    n = max((m.size for m in moves if m is not None), default=1)
    return np.array([np.zeros(n) if m is None or m.size < n else m for m in moves])


def _drawn_errors(utility: Array, moved: Array, seed: int) -> Array:
    """Errors of the means, (n_candidates, n): Student's t of the readings, normal of inner draws.

    With n readings of unknown covariance the means have a multivariate t law of n - 1 degrees of
    freedom about those found.
    """
    n = utility.shape[1]
    rng = np.random.default_rng([seed, 40])
    away = utility - utility.mean(axis=1, keepdims=True)
    scale = 1.0 / np.sqrt(n * rng.chisquare(n - 1, _N_MEANS))
    size, axes = np.linalg.eigh(moved @ moved.T)
    luck = axes * np.sqrt(np.maximum(size, 0.0))
    of_readings = away @ rng.standard_normal((n, _N_MEANS)) * scale
    return np.asarray(of_readings + luck @ rng.standard_normal((len(utility), _N_MEANS)))


def _not_told_apart(behind: Array, best: int, drawn: Array, covariance: Array) -> NDArray[np.bool_]:
    """Candidates no further behind the best than equal ones are behind the best of these.

    The best of many equal candidates is ahead by luck. Those within 2 standard errors of the
    difference to it are a start; if they are equal, their largest difference tells how far behind
    a further one may be; and so on, until none is added.
    """
    variance = np.diag(covariance)
    error = np.sqrt(np.maximum(variance[:, None] + variance - 2.0 * covariance, 0.0))
    limit, n_before = _CLEAR, 0
    while True:
        tied = behind <= limit * error[best] + _ROUNDING
        if tied.sum() == n_before:
            return np.asarray(tied)
        n_before = tied.sum()
        at = np.flatnonzero(tied)
        first = at[drawn[at].argmax(axis=0)]
        away = drawn[first, np.arange(first.size)] - drawn[at]
        scale = error[at[:, None], first]
        ratio = np.where(scale > _ROUNDING, away / np.maximum(scale, _ROUNDING), 0.0)
        limit = max(limit, float(np.quantile(ratio.max(axis=0), _HELD)))


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
