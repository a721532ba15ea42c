"""Several measurements together: the best next ones under a budget of minutes.

As long as enough draws explain the simulated readings of all measurements together, what the next
one adds comes from these. From there on it is the difference of the expected log-determinants of
the local normal law (`pbrdf_bayes.design.local`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.candidates import are_alike
from pbrdf_bayes.design.evaluate import (
    Evaluated,
    Stage,
    hemispherical_table,
    read_hemispherical,
)
from pbrdf_bayes.design.fisher import Told
from pbrdf_bayes.design.local import LocalLaw, local_law
from pbrdf_bayes.design.nested import (
    LEAST_DRAWS,
    LOCAL,
    NESTED,
    Gain,
    PairTable,
    difference,
    expected_gain,
)
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

_MOST_SIMULATED = 4
"""Measurements whose simulated readings are weighed together."""
_MOST_PAIRS, _MOST_LOCAL_PAIRS = 150, 3000
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

    def with_member(self, member: Evaluated, gain: Gain, added: tuple[float, float]) -> Batch:
        """One more."""
        return Batch((*self.members, member), (*self.gains, gain), (*self.added, added))


@dataclass(frozen=True, eq=False)
class Pairs:
    """The best pair of all, beside the greedy one.

    Attributes
    ----------
    best, greedy : Batch
    gap, gap_se : float
        How much the best pair gives beyond the greedy one [nat].
    n_compared : int
    method : {"nested", "local"}
        How pairs were compared.
    """

    best: Batch
    greedy: Batch
    gap: float
    gap_se: float
    n_compared: int
    method: str = NESTED


def joint_table(stage: Stage, members: Sequence[Evaluated]) -> PairTable:
    """Of all members: scans of different geometries, and any DHR and DDR.

    Given all parameters these are independent, but for DHR and DDR of one polarisation, which share
    a gain. Scans that are alike would share the discrepancy as well.
    """
    tables = [m.table for m in members if m.reading is None and m.table is not None]
    for q in POLARIZATIONS:
        readings = [m.reading for m in members if m.reading is not None]
        here = [r for r in readings if r.polarization == q]
        if here:
            tables.append(hemispherical_table(stage, here))
    return reduce(add, tables)


def joint_gain(stage: Stage, members: Sequence[Evaluated]) -> Gain:
    """Expected information gain of measurements taken together."""
    return expected_gain(joint_table(stage, members))


def greedy_batch(
    stage: Stage, candidates: Sequence[Evaluated], *, minutes: float, most: int,
    law: LocalLaw | None = None,
) -> Batch:  # fmt: skip
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
    candidates : sequence of Evaluated
        Those without tables count where the local normal law tells what is added.
    minutes : float
        Budget [min]; infinity for none.
    most : int
        Measurements at most.
    law : LocalLaw, optional
        `local_law` of the stage, where it is there already.

    Returns
    -------
    Batch
        Empty where nothing fits, or nothing adds.
    """
    here = law or local_law(stage)
    found = [
        _greedy(stage, here, candidates, minutes, most, per_minute=flag) for flag in (False, True)
    ]
    return max(found, key=lambda batch: batch.eig)


def _greedy(
    stage: Stage, law: LocalLaw, candidates: Sequence[Evaluated], minutes: float, most: int, *,
    per_minute: bool,
) -> Batch:  # fmt: skip
    batch = Batch()
    left = list(candidates)
    local = False
    while len(batch.members) < most:
        room = minutes - batch.minutes
        left = [c for c in left if c.candidate.minutes <= room + _ROUNDING]
        options = [] if local else _simulated(stage, batch, left)
        if not options:
            local = bool(batch.members)
            options = _by_local_law(law, batch, left) if local else _alone(left)
        if not options:
            break

        def utility(option: tuple[Evaluated, Gain, tuple[float, float]]) -> float:
            added = option[2][0]
            return added / option[0].candidate.minutes if per_minute else added

        best, gain, (more, error) = max(options, key=utility)
        if more <= (_LEAST_ADDED if gain.method == LOCAL else error):
            break
        batch = batch.with_member(best, gain, (more, error))
        left = _without(left, best, again=len(batch.members), stage=stage)
    return batch


def _simulated(
    stage: Stage, batch: Batch, left: Sequence[Evaluated]
) -> list[tuple[Evaluated, Gain, tuple[float, float]]]:
    """What each adds by simulated readings; nothing where these leave too few draws of one."""
    before = batch.gains[-1] if batch.gains else None
    if len(batch.members) >= _MOST_SIMULATED or any(m.table is None for m in batch.members):
        return []
    if before is None and any(c.gain.ess < LEAST_DRAWS for c in left):
        return []
    if before is not None and before.method != NESTED:
        return []
    every = [(c, joint_gain(stage, [*batch.members, c])) for c in left if c.table is not None]
    if any(gain.ess < LEAST_DRAWS for _, gain in every):
        return []
    return [(c, gain, difference(gain, before)) for c, gain in every]


def _alone(left: Sequence[Evaluated]) -> list[tuple[Evaluated, Gain, tuple[float, float]]]:
    """The first one by its own gain, whatever tier that is of."""
    return [(c, c.gain, (c.gain.eig, c.gain.se)) for c in left]


def _by_local_law(
    law: LocalLaw, batch: Batch, left: Sequence[Evaluated]
) -> list[tuple[Evaluated, Gain, tuple[float, float]]]:
    """What each adds by the local normal law, on top of the gain so far."""
    before = batch.gains[-1]
    taken = _told(batch.members)
    start = law.entropy(taken)
    found = []
    for c in left:
        if c.told is None:
            continue
        terms = start - law.entropy([*taken, c.told])
        more, error = _mean(terms)
        gain = Gain(
            eig=before.eig + more, se=float(np.hypot(before.se, error)), low=before.low + more,
            high=before.high + more, ess=before.ess, terms=terms, method=LOCAL,
        )  # fmt: skip
        found.append((c, gain, (more, error)))
    return found


def _mean(terms: Array) -> tuple[float, float]:
    return float(terms.mean()), float(terms.std(ddof=1) / np.sqrt(terms.size))


def _without(
    left: Sequence[Evaluated], taken: Evaluated, *, again: int, stage: Stage
) -> list[Evaluated]:
    """What can still be taken: not another scan of the geometry; a DHR or DDR with new noise."""
    if taken.candidate.quantity == "brdf":
        return [c for c in left if not _alike(stage, c, taken)]
    return [
        replace(c, reading=read_hemispherical(stage, c.candidate, again=again))
        if c.reading is not None and c.candidate.geometry == taken.candidate.geometry else c
        for c in left
    ]  # fmt: skip


def _alike(stage: Stage, one: Evaluated, other: Evaluated) -> bool:
    b = stage.beliefs
    measured = b.posterior.measurement if b.measured else None
    return are_alike(one.candidate, other.candidate, measured)


def best_pair(
    stage: Stage, candidates: Sequence[Evaluated], *, minutes: float, law: LocalLaw | None = None
) -> Pairs | None:
    """Compare all pairs of the most promising candidates, of two geometries each.

    By simulated readings, or all by the local normal law where one of the pairs leaves too few
    draws. None where no pair fits the budget.

    Parameters
    ----------
    stage : Stage
    candidates : sequence of Evaluated
        With their tables, or what they tell locally.
    minutes : float
        Budget of the pair [min].
    law : LocalLaw, optional
        `local_law` of the stage, where it is there already.
    """
    here = law or local_law(stage)
    fit = _pairs(stage, [c for c in candidates if c.table is not None], minutes)[:_MOST_PAIRS]
    plain = _greedy(stage, here, candidates, minutes, 2, per_minute=False)
    if len(plain.members) < 2:
        return None
    if plain.gains[-1].method != LOCAL and fit:
        gains = [joint_gain(stage, pair) for pair in fit]
        if min(gain.ess for gain in gains) >= LEAST_DRAWS:
            i = int(np.argmax([g.eig for g in gains]))
            alone = joint_gain(stage, fit[i][:1])
            best = Batch().with_member(fit[i][0], alone, (alone.eig, alone.se))
            best = best.with_member(fit[i][1], gains[i], difference(gains[i], alone))
            if best.eig < plain.eig:
                best = plain
            gap, error = difference(best.gains[-1], plain.gains[-1])
            return Pairs(best, plain, gap, error, len(fit))
    return _best_local_pair(stage, here, candidates, plain, minutes)


def _pairs(
    stage: Stage, candidates: Sequence[Evaluated], minutes: float
) -> list[tuple[Evaluated, Evaluated]]:
    """Pairs that are not alike and fit the budget, those of the largest gains first."""
    ordered = sorted(candidates, key=lambda c: -c.gain.eig)
    pairs = [
        pair for pair in combinations(ordered, 2)
        if sum(c.candidate.minutes for c in pair) <= minutes + _ROUNDING
        and not _alike(stage, *pair)
    ]  # fmt: skip
    return sorted(pairs, key=lambda pair: -sum(c.gain.eig for c in pair))


def _best_local_pair(
    stage: Stage, law: LocalLaw, candidates: Sequence[Evaluated], plain: Batch, minutes: float
) -> Pairs | None:
    """By expected log-determinants: the gain of the greedy pair plus the difference to it."""
    pairs = _pairs(stage, [c for c in candidates if c.told is not None], minutes)[
        :_MOST_LOCAL_PAIRS
    ]
    if not pairs:
        return None
    reference = law.entropy(_told(plain.members))
    left = np.array([law.entropy(_told(pair)) for pair in pairs])
    i = int(np.argmin(left.mean(axis=1)))
    gap, error = _mean(reference - left[i])
    if gap <= 0.0:
        return Pairs(plain, plain, 0.0, 0.0, len(pairs), LOCAL)
    first, second = sorted(pairs[i], key=lambda c: -c.gain.eig)
    whole = plain.gains[-1]
    gain = replace(
        whole, eig=whole.eig + gap, se=float(np.hypot(whole.se, error)), low=whole.low + gap,
        high=whole.high + gap, terms=reference - left[i], method=LOCAL,
    )  # fmt: skip
    best = Batch().with_member(first, first.gain, (first.gain.eig, first.gain.se))
    more = gain.eig - first.gain.eig, float(np.hypot(gain.se, first.gain.se))
    return Pairs(best.with_member(second, gain, more), plain, gap, error, len(pairs), LOCAL)


def _told(members: Sequence[Evaluated]) -> list[Told]:
    return [m.told for m in members if m.told is not None]
