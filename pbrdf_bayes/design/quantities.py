"""What a measurement sharpens: parameters and goals at the draws, and goals screened cheaply."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.evaluate import Stage
from pbrdf_bayes.design.fisher import Told
from pbrdf_bayes.design.goals import Goal, values_of
from pbrdf_bayes.design.local import LocalLaw, Slopes, local_spread

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Quantities:
    """Parameters and goals at the draws; a scan has several columns, which count together.

    ``variance`` is that of each column before the measurement, ``groups`` the columns of each name.
    """

    names: tuple[str, ...]
    own: Array
    inner: Array
    variance: Array
    groups: tuple[NDArray[np.int64], ...]

    @property
    def sd(self) -> Array:
        """Standard deviation of each name before the measurement."""
        return np.array([np.sqrt(self.variance[at].mean()) for at in self.groups])


def quantities_of(stage: Stage, goals: Sequence[Goal]) -> Quantities:
    """Parameters that the information is about, then goals, at the draws of a stage."""
    own, columns = values_of(stage.beliefs, goals, stage.outer.x)
    inner, _ = values_of(stage.beliefs, goals, stage.inner.x)
    names = tuple(dict.fromkeys(columns))
    return Quantities(
        names, own, inner, np.concatenate([own, inner]).var(axis=0, ddof=1),
        tuple(np.flatnonzero(np.array(columns) == name) for name in names),
    )  # fmt: skip


def taken_from_goals(
    law: LocalLaw, told: Sequence[Told], slopes: Slopes, quantities: Quantities, n_about: int
) -> Array:
    """Share of the variance of each goal that a candidate takes away, (n_candidates, n_goals).

    By the local normal law: the tier that screens goals, as the linear estimate does the gain.
    """
    if len(quantities.names) == n_about:
        return np.zeros((len(told), 0))
    q = quantities
    spreads = (local_spread(law, one, slopes, 1).merged(q.groups, q.variance) for one in told)
    return np.array([1.0 - spread.terms[:, n_about:].mean(axis=0) for spread in spreads])
