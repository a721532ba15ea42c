"""Several measurements together: the best next ones under a budget of minutes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np

from pbrdf_bayes.design.evaluate import Evaluated, Stage, hemispherical_table
from pbrdf_bayes.design.nested import LEAST_DRAWS, Gain, PairTable, difference, expected_gain

_MOST_PAIRS = 150
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
    minutes : float
    cut_short : bool
        More would fit, but too few draws are left to tell what to add.
    """

    members: tuple[Evaluated, ...]
    gains: tuple[Gain, ...]
    minutes: float
    cut_short: bool = False

    @property
    def eig(self) -> float:
        """Of all together [nat]."""
        return self.gains[-1].eig if self.gains else 0.0


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


def joint_table(stage: Stage, members: Sequence[Evaluated]) -> PairTable:
    """Of all members, of different geometries.

    Given all parameters these are independent, but for DHR and DDR of one polarisation, which share
    a gain. Scans of one geometry would share the discrepancy as well.
    """
    tables = [m.table for m in members if m.reading is None and m.table is not None]
    for q in "spu":
        readings = [m.reading for m in members if m.reading is not None]
        here = [r for r in readings if r.polarization == q]
        if here:
            tables.append(hemispherical_table(stage, here))
    return reduce(add, tables)


def joint_gain(stage: Stage, members: Sequence[Evaluated]) -> Gain:
    """Expected information gain of measurements taken together."""
    return expected_gain(joint_table(stage, members))


def greedy_batch(
    stage: Stage, candidates: Sequence[Evaluated], *, minutes: float, most: int
) -> Batch:
    """Add the candidate that adds most, as long as the budget lasts.

    Every geometry is taken at most once, whatever its minutes and the range of the scan: readings
    of one geometry share the discrepancy of the model, and a second one adds little. Once by what
    it adds and once by what it adds for each minute; the better of both is taken.
    Where gains diminish that is never worse than half of 1 - 1/e of the optimum (Krause and
    Guestrin, CMU-CALD-05-103, 2005).

    Parameters
    ----------
    stage : Stage
    candidates : sequence of Evaluated
        Those without tables count only where so much is to be gained that no sum of gains could be
        told: the one with the largest gain is then taken alone.
    minutes : float
        Budget [min]; infinity for none.
    most : int
        Measurements at most.

    Returns
    -------
    Batch
        Empty where nothing fits, or nothing adds.
    """
    fit = [c for c in candidates if c.candidate.minutes <= minutes + _ROUNDING]
    first = max(fit, key=lambda c: c.gain.eig, default=None)
    if first is not None and first.gain.ess < LEAST_DRAWS and first.gain.eig > 0.0:
        return Batch((first,), (first.gain,), first.candidate.minutes, cut_short=most > 1)
    found = [_greedy(stage, fit, minutes, most, per_minute=flag) for flag in (False, True)]
    return max(found, key=lambda batch: batch.eig)


def _greedy(
    stage: Stage, candidates: Sequence[Evaluated], minutes: float, most: int, *, per_minute: bool
) -> Batch:
    batch = Batch((), (), 0.0)
    left = [c for c in candidates if c.table is not None]
    while len(batch.members) < most:
        room = minutes - batch.minutes
        left = [c for c in left if c.candidate.minutes <= room + _ROUNDING]
        every = [(c, joint_gain(stage, [*batch.members, c])) for c in left]
        options = [option for option in every if option[1].ess >= LEAST_DRAWS]
        if not options:
            batch = replace(batch, cut_short=bool(every))
            break

        def added(option: tuple[Evaluated, Gain], before: float = batch.eig) -> float:
            gain = option[1].eig - before
            return gain / option[0].candidate.minutes if per_minute else gain

        best, gain = max(options, key=added)
        more, error = difference(gain, batch.gains[-1] if batch.gains else None)
        if more <= error:
            break
        batch = Batch((*batch.members, best), (*batch.gains, gain),
                      batch.minutes + best.candidate.minutes)  # fmt: skip
        left = [c for c in left if c.candidate.geometry != best.candidate.geometry]
    return batch


def best_pair(stage: Stage, candidates: Sequence[Evaluated], *, minutes: float) -> Pairs | None:
    """Compare all pairs of the most promising candidates, of two geometries each.

    None where no pair fits the budget, or too few draws are left to tell what pairs give.

    Parameters
    ----------
    stage : Stage
    candidates : sequence of Evaluated
        With their tables.
    minutes : float
        Budget of the pair [min].
    """
    ordered = sorted((c for c in candidates if c.table is not None), key=lambda c: -c.gain.eig)
    pairs = [
        pair for pair in combinations(ordered, 2)
        if sum(c.candidate.minutes for c in pair) <= minutes + _ROUNDING
        and pair[0].candidate.geometry != pair[1].candidate.geometry
    ]  # fmt: skip
    pairs.sort(key=lambda pair: -sum(c.gain.eig for c in pair))
    pairs = pairs[:_MOST_PAIRS]
    greedy = _greedy(stage, candidates, minutes, 2, per_minute=False)
    if not pairs or len(greedy.members) < 2:
        return None
    gains = [joint_gain(stage, pair) for pair in pairs]
    told = [k for k, gain in enumerate(gains) if gain.ess >= LEAST_DRAWS]
    if not told:
        return None
    pairs, gains = [pairs[k] for k in told], [gains[k] for k in told]
    i = int(np.argmax([g.eig for g in gains]))
    alone = joint_gain(stage, pairs[i][:1])
    best = Batch(pairs[i], (alone, gains[i]), sum(c.candidate.minutes for c in pairs[i]))
    if best.eig < greedy.eig:
        best = greedy
    gap, error = difference(best.gains[-1], greedy.gains[-1])
    return Pairs(best, greedy, gap, error, len(pairs))
