"""The design calculation from beliefs and candidates to a result that can be saved and shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    nested_estimate,
    set_stage,
    told_by,
)
from pbrdf_bayes.design.goals import Goal, Quantities, quantities_of
from pbrdf_bayes.design.linear import LinearLaw, Told, linear_law, linear_spread, stand_in
from pbrdf_bayes.design.nested import LEAST_DRAWS, Spread
from pbrdf_bayes.design.ranking import GoalRanking, Ranking, rank_for_goal, rank_gains
from pbrdf_bayes.errors import ConfigError

Array = NDArray[np.float64]
Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST_EVALUATED = 240
_MANY = 1000
"""Candidates from which on the linear law has fewer paints."""
USUAL_BATCH, MOST_TOGETHER = 4, 20
"""Measurements of a batch: without a budget, and at most."""


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
        The most promising candidates, in the order given.
    linear, linear_se : ndarray, shape (n_candidates,)
        Linear estimate of all candidates that were given [nat].
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
        All are screened by the linear law, for the parameters and for each goal; the most
        promising ones are simulated.
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
        quantities, law = quantities_of(stage, aims), linear_law(stage.paints)
        all_told = _each(lambda c: told_by(stage, c), candidates, wanted.threads, told, "screening")
        linear = np.array([law.gain([t]) for t in all_told])
        level, minutes = linear.mean(axis=1), np.array([c.minutes for c in candidates])
        by_level = [level, level / minutes]
        if len(candidates) > _MOST_EVALUATED and aims:
            n = len(beliefs.about)
            spreads = (_linear_spread(law, t, quantities) for t in all_told)
            taken = np.array([1.0 - s.terms[:, n:].mean(axis=0) for s in spreads])
            by_level += [share for one in taken.T for share in (one, one / minutes)]
        chosen = _promising(by_level, _MOST_EVALUATED)
        evaluated = tuple(_each(
            lambda i: _evaluated(stage, law, quantities, candidates[i], all_told[i]),
            chosen.tolist(), wanted.threads, told, "simulating",
        ))  # fmt: skip
        told("combining", 0, 1)
        batch = greedy_batch(stage, law, evaluated, minutes=wanted.minutes, most=wanted.most)
        pairs = None
        if len(batch.members) > 1:
            pairs = best_pair(stage, law, evaluated, minutes=wanted.minutes)
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
            rank_for_goal(
                name, [e.spread for e in evaluated], minutes[chosen],
                quantities.names.index(name), seed=wanted.seed,
            )
            for name in dict.fromkeys(goal.label for goal in aims)
        ),
        about=beliefs.about,
        choices=wanted if stage.nuisance is None else replace(
            wanted, n_nuisance=stage.nuisance.log_weights.shape[1]
        ),
        config=beliefs.posterior.config,
        scans_of_prior=beliefs.scans_of_prior,
    )  # fmt: skip


def _evaluated(
    stage: Stage, law: LinearLaw, quantities: Quantities, candidate: Candidate, told: Told
) -> Evaluated:
    """The nested estimate; the linear law where too few draws are left for it."""
    q = quantities
    gain, spread = nested_estimate(stage, candidate, q.own, q.inner)
    is_local = gain.ess < LEAST_DRAWS
    spread = _linear_spread(law, told, q) if is_local else spread.merged(q.groups, q.variance)
    nats = law.level + float(law.gain([told]).mean()) if gain.wide else None
    return Evaluated(
        candidate, stand_in(law, told, gain) if gain.lost else gain, spread, told, nats, is_local
    )


def _linear_spread(law: LinearLaw, told: Told, q: Quantities) -> Spread:
    return linear_spread(law, told, q.slopes, q.variance).merged(q.groups, q.variance)


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
