"""Candidates ranked by what they do for one prediction, instead of for the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.evaluate import Evaluated
from pbrdf_bayes.design.nested import LEAST_DRAWS
from pbrdf_bayes.design.ranking import Ranking, rank

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GoalRanking:
    """Candidates by the share of the variance of a prediction that they are expected to take away.

    Attributes
    ----------
    name : str
    members : ndarray of int, shape (n,)
        Indices of the candidates that enough draws are left of.
    reduction, se : ndarray, shape (n,)
        1 - variance after over before, and its standard error.
    by_measurement, by_minute : Ranking
    """

    name: str
    members: NDArray[np.int64]
    reduction: Array
    se: Array
    by_measurement: Ranking
    by_minute: Ranking


def rank_for_goal(
    name: str, evaluated: Sequence[Evaluated], column: int, *, seed: int
) -> GoalRanking | None:
    """Rank candidates for one prediction; None where too few draws are left of every candidate.

    Parameters
    ----------
    name : str
    evaluated : sequence of Evaluated
    column : int
        Of the prediction among the quantities.
    seed : int
        Of the bootstrap.
    """
    members = np.array([i for i, e in enumerate(evaluated) if e.gain.ess >= LEAST_DRAWS], np.int64)
    if not members.size:
        return None
    spreads = [evaluated[i].spread for i in members]
    terms = np.array([1.0 - spread.terms[:, column] for spread in spreads])
    inner = np.array([-spread.inner[:, column] for spread in spreads])
    minutes = np.array([evaluated[i].candidate.minutes for i in members])
    se = np.sqrt(terms.var(axis=1, ddof=1) / terms.shape[1] + np.sum(inner**2, axis=1))
    one, other = (
        rank(terms, minutes, per_minute=flag, seed=seed, inner=inner) for flag in (False, True)
    )
    return GoalRanking(name, members, terms.mean(axis=1), se, one, other)
