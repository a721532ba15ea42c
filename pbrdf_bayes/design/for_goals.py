"""Candidates ranked by what they do for one prediction, instead of for the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.evaluate import Evaluated
from pbrdf_bayes.design.ranking import Ranking, rank

Array = NDArray[np.float64]


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
    name: str, evaluated: Sequence[Evaluated], column: int, *, seed: int
) -> GoalRanking:
    """Rank all candidates for one prediction.

    Parameters
    ----------
    name : str
    evaluated : sequence of Evaluated
        Where the local normal law tells the spread there are fewer paints: the first ones count.
    column : int
        Of the prediction among the quantities.
    seed : int
        Of the bootstrap.
    """
    spreads = [e.spread for e in evaluated]
    n = min(len(spread.terms) for spread in spreads)
    left = np.array([spread.terms[:, column].mean() for spread in spreads])
    inner = np.array([-spread.inner[:, column] for spread in spreads])
    terms = np.array([
        spread.terms[:n, column].mean() - spread.terms[:n, column] + 1.0 - mean
        for spread, mean in zip(spreads, left, strict=True)
    ])  # fmt: skip
    variance = [spread.terms[:, column].var(ddof=1) / len(spread.terms) for spread in spreads]
    se = np.sqrt(np.array(variance) + np.sum(inner**2, axis=1))
    minutes = np.array([e.candidate.minutes for e in evaluated])
    one, other = (
        rank(terms, minutes, per_minute=flag, seed=seed, inner=inner, se=se)
        for flag in (False, True)
    )
    return GoalRanking(name, left, se, one, other)
