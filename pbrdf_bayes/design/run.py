"""The design calculation from beliefs and candidates to a result that can be saved and shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.batches import Batch, Pairs, best_pair, greedy_batch
from pbrdf_bayes.design.beliefs import Beliefs
from pbrdf_bayes.design.candidates import Candidate, was_measured
from pbrdf_bayes.design.evaluate import (
    FEWEST_LINEAR,
    N_LINEAR,
    Evaluated,
    Stage,
    evaluate,
    linear_gains,
    set_stage,
    told_by,
)
from pbrdf_bayes.design.fisher import Told
from pbrdf_bayes.design.for_goals import GoalRanking, rank_for_goal
from pbrdf_bayes.design.goals import Goal
from pbrdf_bayes.design.local import (
    LocalLaw,
    Slopes,
    local_gain,
    local_law,
    local_spread,
    slopes_of_quantities,
    surprise,
)
from pbrdf_bayes.design.nested import LEAST_DRAWS, LOCAL, REFINED, Gain
from pbrdf_bayes.design.quantities import Quantities, quantities_of, taken_from_goals
from pbrdf_bayes.design.ranking import Ranking, rank_gains
from pbrdf_bayes.design.refine import least_work, refined_gain, with_refined
from pbrdf_bayes.errors import ConfigError

Array = NDArray[np.float64]
Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST_EVALUATED = 240
_MANY = 1000
"""Candidates from which on tier 0 has fewer draws."""
_KEPT = 24
USUAL_BATCH, MOST_TOGETHER = 4, 20
"""Measurements of a batch: without a budget, and at most."""
_FEWEST_REFINED, _MOST_REFINED, _INNER_REFINED = 2, 8, 400
_MOST_LEADERS = 8
"""Candidates that tier 2 may take beyond these because they would lead."""
_WORK_REFINED = 2e8
"""Values of the model that tier 2 may compute in all, as long as it has the fewest candidates."""


@dataclass(frozen=True, kw_only=True)
class DesignChoices:
    """Choices of a design calculation.

    Attributes
    ----------
    n_outer, n_inner, n_nuisance : int
        Simulated paints, draws that each is compared with, draws of the nuisance for each.
    minutes : float
        Budget of the batch [min]; infinity for none.
    batch : int or None
        Measurements of the batch at most; None for `MOST_TOGETHER` under a budget, else
        `USUAL_BATCH`.
    seed : int
    threads : int
        Candidates at a time; results do not depend on it.
    """

    n_outer: int = 400
    n_inner: int = 800
    n_nuisance: int = 12
    minutes: float = float("inf")
    batch: int | None = None
    seed: int = 1
    threads: int = 2

    def __post_init__(self) -> None:
        limits = {
            "n_outer": (20, 100_000), "n_inner": (50, 100_000), "n_nuisance": (2, 4096),
            "most": (1, MOST_TOGETHER), "seed": (0, 10**18), "threads": (1, 1024),
        }  # fmt: skip
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            name = "batch" if name == "most" else name
            if not (isinstance(value, int) and low <= value <= high):
                msg = f"{name} = {value!r} is not allowed: give a whole number in [{low}, {high}]"
                raise ConfigError(msg)
        if not self.minutes > 0.0:
            msg = f"minutes = {self.minutes!r} is not allowed: give a number above 0"
            raise ConfigError(msg)

    @property
    def most(self) -> int:
        """Measurements of the batch at most."""
        if self.batch is not None:
            return self.batch
        return MOST_TOGETHER if np.isfinite(self.minutes) else USUAL_BATCH


@dataclass(frozen=True, eq=False)
class DesignResult:
    """What a design calculation found.

    Attributes
    ----------
    evaluated : tuple of Evaluated
        Candidates of tier 1, in the order given; where the bracket of tier 1 is wide, the most
        promising ones by tier 2 and the others by the local normal law.
    linear, linear_se : ndarray, shape (n_candidates,)
        Tier 0 of all candidates that were given [nat].
    candidates : tuple of Candidate
        All that were given.
    chosen : ndarray of int
        Index of each of ``evaluated`` among them.
    repeats : ndarray of bool, shape (n_evaluated,)
        Geometry measured before.
    by_gain, by_minute : Ranking
        Of ``evaluated``.
    quantities : tuple of str
        Names of the columns of ``spread``: parameters, then goals.
    sd_before : ndarray, shape (n_quantities,)
        Standard deviation before; that of ln for a BRDF or a ratio.
    batch : Batch
    pairs : Pairs or None
    goals : tuple of GoalRanking
        Of each goal.
    about : tuple of str
    choices : DesignChoices
        With as many draws of the nuisance as were made.
    config : RunConfig
        Of the beliefs: what is assumed of the instrument.
    scans_of_prior : bool
        `Beliefs.scans_of_prior`.
    """

    evaluated: tuple[Evaluated, ...]
    linear: Array
    linear_se: Array
    candidates: tuple[Candidate, ...]
    chosen: NDArray[np.int64]
    repeats: NDArray[np.bool_]
    by_gain: Ranking
    by_minute: Ranking
    quantities: tuple[str, ...]
    sd_before: Array
    batch: Batch
    pairs: Pairs | None
    goals: tuple[GoalRanking, ...]
    about: tuple[str, ...]
    choices: DesignChoices
    config: RunConfig
    scans_of_prior: bool


def design_measurements(
    beliefs: Beliefs, candidates: Sequence[Candidate], *, choices: DesignChoices | None = None,
    goals: Sequence[Goal] = (), told: Callable[[str, int, int], None] = lambda *_: None,
) -> DesignResult:  # fmt: skip
    """Expected information of every candidate, and the best ones together.

    Parameters
    ----------
    beliefs : Beliefs
    candidates : sequence of Candidate
        Of many, the most promising by tier 0, and by the local normal law for each goal, go on to
        tier 1.
    choices : DesignChoices, optional
    goals : sequence of Goal
        Predictions whose expected sharpening is wanted.
    told : callable
        Told the stage, and how many of how many candidates are done.

    Returns
    -------
    DesignResult

    Raises
    ------
    ConfigError
        When there is no candidate, or there are too few draws.
    """
    wanted = choices or DesignChoices()
    if not candidates:
        msg = "there is no candidate: give at least one measurement to consider"
        raise ConfigError(msg)
    with threadpool_limits(1):
        stage = set_stage(
            beliefs, n_outer=wanted.n_outer, n_inner=wanted.n_inner,
            n_nuisance=wanted.n_nuisance, seed=wanted.seed,
            n_linear=FEWEST_LINEAR if len(candidates) > _MANY else N_LINEAR,
        )  # fmt: skip
        aims = tuple(dict.fromkeys(goals))
        all_told = _each(lambda c: told_by(stage, c), candidates, wanted.threads, told, "screening")
        linear = np.array([linear_gains(stage, t) for t in all_told])
        level, minutes = linear.mean(axis=1), np.array([c.minutes for c in candidates])
        by_level = [level, level / minutes]
        kept = set(_promising(by_level, _KEPT).tolist())
        quantities = quantities_of(stage, aims)
        law, slopes = local_law(stage), slopes_of_quantities(stage, aims, quantities.variance)
        if len(candidates) > _MOST_EVALUATED:
            taken = taken_from_goals(law, all_told, slopes, quantities, len(beliefs.about))
            by_level += [share for one in taken.T for share in (one, one / minutes)]
        chosen = _promising(by_level, _MOST_EVALUATED)
        evaluated = tuple(_each(
            lambda i: _simulated(
                stage, law, slopes, quantities, candidates[i], all_told[i], keep=i in kept
            ),
            chosen.tolist(), wanted.threads, told, "simulating",
        ))  # fmt: skip
        evaluated = _refined(stage, law, evaluated, wanted, told)
        told("combining", 0, 1)
        batch = greedy_batch(stage, evaluated, minutes=wanted.minutes, most=wanted.most, law=law)
        pairs = None
        if len(batch.members) > 1:
            pairs = best_pair(stage, evaluated, minutes=wanted.minutes, law=law)
        told("combining", 1, 1)
    by_gain, by_minute = (
        rank_gains([e.gain for e in evaluated], minutes[chosen], per_minute=flag, seed=wanted.seed)
        for flag in (False, True)
    )
    measurement = beliefs.posterior.measurement
    return DesignResult(
        evaluated=evaluated,
        linear=level,
        linear_se=linear.std(axis=1, ddof=1) / np.sqrt(linear.shape[1]),
        candidates=tuple(candidates),
        chosen=chosen,
        repeats=np.array([
            beliefs.measured and was_measured(e.candidate, measurement) for e in evaluated
        ]),
        by_gain=by_gain,
        by_minute=by_minute,
        quantities=quantities.names,
        sd_before=quantities.sd,
        batch=batch,
        pairs=pairs,
        goals=tuple(
            rank_for_goal(name, evaluated, quantities.names.index(name), seed=wanted.seed)
            for name in dict.fromkeys(goal.label for goal in aims)
        ),
        about=beliefs.about,
        choices=wanted if stage.nuisance is None else replace(
            wanted, n_nuisance=stage.nuisance.log_weights.shape[1]
        ),
        config=beliefs.posterior.config,
        scans_of_prior=beliefs.scans_of_prior,
    )  # fmt: skip


def _simulated(
    stage: Stage, law: LocalLaw, slopes: Slopes, quantities: Quantities, candidate: Candidate,
    told: Told, *, keep: bool,
) -> Evaluated:  # fmt: skip
    """Tier 1; what is left by the local normal law where too few draws tell it."""
    q = quantities
    found = evaluate(stage, candidate, q.own, q.inner, keep=keep)
    is_local = found.gain.ess < LEAST_DRAWS
    spread = local_spread(law, told, slopes, len(q.inner)) if is_local else found.spread
    return replace(
        found, spread=spread.merged(q.groups, q.variance), told=told, local_spread=is_local
    )


def _refined(
    stage: Stage, law: LocalLaw, evaluated: tuple[Evaluated, ...], wanted: DesignChoices,
    told: Callable[[str, int, int], None],
) -> tuple[Evaluated, ...]:  # fmt: skip
    """Tier 2 for the most promising candidates whose bracket is wide, and for any that would lead.

    For the others the local normal law, where next to no draws are left or the middle of the
    bracket means nothing; the other wide ones keep it.
    """
    wide = np.flatnonzero([e.gain.wide and e.told is not None for e in evaluated])
    if not wide.size:
        return evaluated
    known = surprise(stage)
    found = list(evaluated)
    terms = {}
    for i in wide.tolist():
        done = found[i]
        assert done.told is not None
        terms[i] = known - law.entropy([done.told])
        gain = local_gain(terms[i], done.gain) if _is_few(done.gain) else done.gain
        found[i] = replace(done, gain=gain, local_nats=float(terms[i].mean()))
    level = np.array([found[i].gain.eig for i in wide])
    minutes = np.array([e.candidate.minutes for e in evaluated])
    best = _promising([level, level / minutes[wide]], _MOST_REFINED)
    best = wide[best[np.argsort(-level[best], kind="stable")]]
    needed = np.cumsum([least_work(stage, found[i].candidate) for i in best])
    best = best[: max(_FEWEST_REFINED, int(np.searchsorted(needed, _WORK_REFINED)))]
    share = _WORK_REFINED / len(best)

    def refine(i: int) -> Evaluated:
        done = found[i]
        gain = refined_gain(stage, done.candidate, n_inner=_INNER_REFINED, most_work=share)
        gain = with_refined(evaluated[i].gain, gain)
        return replace(done, gain=local_gain(terms[i], gain) if gain.bounded else gain)

    left, wanting = set(wide.tolist()), best.tolist()
    most = len(best) + _MOST_LEADERS
    while True:
        finer = _each(refine, wanting, wanted.threads, told, "refining")
        for i, e in zip(wanting, finer, strict=True):
            found[i] = e
        left -= set(wanting)
        shown = _on_one_scale(evaluated, found, terms)
        gains = np.array([e.gain.eig for e in shown])
        leaders = {int(np.argmax(gains)), int(np.argmax(gains / minutes))}
        wanting = sorted(leaders & left)
        if not wanting or len(wide) - len(left) + len(wanting) > most:
            return tuple(shown)


def _is_few(gain: Gain) -> bool:
    """Whether tier 1 leaves the local normal law to tell."""
    return gain.bounded or gain.ess < LEAST_DRAWS


def _on_one_scale(
    before: Sequence[Evaluated], found: Sequence[Evaluated], terms: Mapping[int, Array]
) -> list[Evaluated]:
    """Local gains moved by the mean of what tier 2 found beyond them, its scatter in their error.

    Else one that the local law sees too high would overtake those that tier 2 has corrected.
    """
    beyond = np.array([
        found[i].gain.eig - of_local.mean() for i, of_local in terms.items()
        if found[i].gain.method == REFINED and _is_few(before[i].gain)
    ])  # fmt: skip
    if beyond.size < _FEWEST_REFINED:
        return list(found)
    scatter = float(beyond.std(ddof=1) * np.sqrt(1.0 + 1.0 / beyond.size))
    return [
        replace(e, gain=local_gain(terms[i] + beyond.mean(), e.gain, alone=scatter))
        if e.gain.method == LOCAL else e
        for i, e in enumerate(found)
    ]  # fmt: skip


def _promising(utilities: Sequence[Array], most: int) -> NDArray[np.int64]:
    """Candidates with the largest of each utility in turn, in the order given."""
    n = utilities[0].size
    if n <= most:
        return np.arange(n)
    ordered = np.argsort(-np.stack(utilities, axis=1), axis=0, kind="stable").ravel()
    _, first = np.unique(ordered, return_index=True)
    return np.sort(ordered[np.sort(first)][:most])


def _each(
    work: Callable[[Item], Result], items: Sequence[Item], threads: int,
    told: Callable[[str, int, int], None], stage: str,
) -> list[Result]:  # fmt: skip
    """Results in the order of the items, with progress."""
    found: list[Result] = []
    with ThreadPoolExecutor(threads) as pool:
        for result in pool.map(work, items):
            found.append(result)
            told(stage, len(found), len(items))
    return found
