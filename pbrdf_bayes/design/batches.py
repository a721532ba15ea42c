"""Several measurements together: the best next ones under a budget of minutes.

The first one has its own gain. What each further one adds is the difference of the expected
log-determinants of the linear law: what measurements share is counted once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.candidates import are_alike
from pbrdf_bayes.design.evaluate import Evaluated, Stage
from pbrdf_bayes.design.linear import LinearLaw
from pbrdf_bayes.design.nested import LOCAL, Gain
from pbrdf_bayes.quantities import QUANTITIES

Array = NDArray[np.float64]

_MOST_PAIRS = 3000
_LEAST_ADDED = 0.01
"""What a measurement adds to a batch at least [nat]."""
_ROUNDING = 1e-9
"""Of minutes that are added up."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Measurements to take together.

    Attributes
    ----------
    members : tuple of Evaluated
        In the order in which they were added.
    gains : tuple of Gain
        Of the first, of the first two, and so on: with what they share counted once.
    added : tuple of tuple of float
        What each adds to those before it, and the standard error [nat].
    """

    members: tuple[Evaluated, ...] = ()
    gains: tuple[Gain, ...] = ()
    added: tuple[tuple[float, float], ...] = ()

    @property
    def minutes(self) -> float:
        """Of all members."""
        return sum(member.candidate.minutes for member in self.members)

    @property
    def eig(self) -> float:
        """Of all together [nat]."""
        return self.gains[-1].eig if self.gains else 0.0

    def adds(self, law: LinearLaw, member: Evaluated) -> Array:
        """What a measurement adds at each of the paints, shape (n_paints,) [nat]."""
        return law.gain([member.told], [m.told for m in self.members])

    def with_member(self, law: LinearLaw, member: Evaluated) -> Batch:
        """One more."""
        gain = member.gain
        more, error = gain.eig, gain.se
        if self.gains:
            before, terms = self.gains[-1], self.adds(law, member)
            more, error = _mean(terms)
            gain = replace(
                before, eig=before.eig + more, se=float(np.hypot(before.se, error)),
                low=before.low + more, high=before.high + more, terms=terms, inner=None,
                method=LOCAL,
            )  # fmt: skip
        return Batch((*self.members, member), (*self.gains, gain), (*self.added, (more, error)))


@dataclass(frozen=True, eq=False)
class Pairs:
    """The best pair of all, beside the greedy one.

    Attributes
    ----------
    best, greedy : Batch
    gap, gap_se : float
        How much the best pair gives beyond the greedy one [nat].
    n_compared : int
    """

    best: Batch
    greedy: Batch
    gap: float
    gap_se: float
    n_compared: int
    method: str = LOCAL


def greedy_batch(
    stage: Stage, law: LinearLaw, candidates: Sequence[Evaluated], *, minutes: float, most: int
) -> Batch:
    """Add the candidate that adds most, as long as the budget lasts.

    A scan is taken at most once at a geometry, whatever its minutes and its range, and none within
    `ALIKE_DEG` of it: such scans share the discrepancy of the model, and a second one adds little.
    A DHR or DDR reading may be taken again: it shares its gain only.
    Once by what a candidate adds and once by what it adds for each minute; the better of both is
    taken. Where gains diminish that is never worse than half of 1 - 1/e of the optimum (Krause and
    Guestrin, CMU-CALD-05-103, 2005).

    Parameters
    ----------
    stage : Stage
    law : LinearLaw
    candidates : sequence of Evaluated
    minutes : float
        Budget [min]; infinity for none.
    most : int
        Measurements at most.

    Returns
    -------
    Batch
        Empty where nothing fits, or nothing adds.
    """
    found = [
        _greedy(stage, law, candidates, minutes, most, per_minute=flag) for flag in (False, True)
    ]
    return max(found, key=lambda batch: batch.eig)


def _greedy(
    stage: Stage, law: LinearLaw, candidates: Sequence[Evaluated], minutes: float, most: int, *,
    per_minute: bool,
) -> Batch:  # fmt: skip
    batch = Batch()
    left = list(candidates)
    while len(batch.members) < most:
        room = minutes - batch.minutes
        left = [c for c in left if c.candidate.minutes <= room + _ROUNDING]
        if not left:
            break
        more = [float(batch.adds(law, c).mean()) if batch.members else c.gain.eig for c in left]
        price = [c.candidate.minutes if per_minute else 1.0 for c in left]
        i = int(np.argmax(np.divide(more, price)))
        least = _LEAST_ADDED if batch.members or left[i].gain.method == LOCAL else left[i].gain.se
        if more[i] <= least:
            break
        taken = left[i]
        batch = batch.with_member(law, taken)
        if not QUANTITIES[taken.candidate.quantity].hemispherical:
            left = [c for c in left if not _alike(stage, c, taken)]
    return batch


def _alike(stage: Stage, one: Evaluated, other: Evaluated) -> bool:
    b = stage.beliefs
    measured = b.posterior.measurement if b.measured else None
    return are_alike(one.candidate, other.candidate, measured)


def best_pair(
    stage: Stage, law: LinearLaw, candidates: Sequence[Evaluated], *, minutes: float
) -> Pairs | None:
    """Compare all pairs of two geometries each, those of the largest gains first.

    The gain of the best one is that of the greedy pair plus the difference to it. None where no
    pair fits the budget.

    Parameters
    ----------
    stage : Stage
    law : LinearLaw
    candidates : sequence of Evaluated
    minutes : float
        Budget of the pair [min].
    """
    plain = _greedy(stage, law, candidates, minutes, 2, per_minute=False)
    pairs = [
        pair for pair in combinations(sorted(candidates, key=lambda c: -c.gain.eig), 2)
        if sum(c.candidate.minutes for c in pair) <= minutes + _ROUNDING
        and not _alike(stage, *pair)
    ]  # fmt: skip
    pairs = sorted(pairs, key=lambda pair: -sum(c.gain.eig for c in pair))[:_MOST_PAIRS]
    if len(plain.members) < 2 or not pairs:
        return None
    together = np.array([law.gain([c.told for c in pair]) for pair in pairs])
    i = int(np.argmax(together.mean(axis=1)))
    gap, error = _mean(together[i] - law.gain([c.told for c in plain.members]))
    if gap <= 0.0:
        return Pairs(plain, plain, 0.0, 0.0, len(pairs))
    first, second = pairs[i]
    whole = plain.gains[-1]
    gain = replace(
        whole, eig=whole.eig + gap, se=float(np.hypot(whole.se, error)), low=whole.low + gap,
        high=whole.high + gap,
    )  # fmt: skip
    more = gain.eig - first.gain.eig, float(np.hypot(gain.se, first.gain.se))
    best = Batch((first, second), (first.gain, gain), ((first.gain.eig, first.gain.se), more))
    return Pairs(best, plain, gap, error, len(pairs))


def _mean(terms: Array) -> tuple[float, float]:
    return float(terms.mean()), float(terms.std(ddof=1) / np.sqrt(terms.size))
