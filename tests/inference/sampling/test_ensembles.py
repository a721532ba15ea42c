"""A state of the ensembles holds all that decides how they go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import emcee
import numpy as np
import pytest
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.rejected import MOST_EXAMPLES, Rejected
from pbrdf_bayes.inference.sampling import ensembles
from pbrdf_bayes.inference.sampling.ensembles import (
    Checkpoint,
    Moves,
    SamplerState,
    advance,
    begin,
    state_from_arrays,
    state_to_arrays,
    walk_to,
)
from pbrdf_bayes.inference.sampling.importance import ImportanceDraws
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.moves import choose_moves
from pbrdf_bayes.inference.sampling.sampling import sample_posterior

Array = NDArray[np.float64]
MakeLaw = Callable[..., Posterior]

PROPOSAL = Mixture(np.zeros((1, 2)), 0.3 * np.eye(2)[None], np.ones(1))
QUICK = ImportanceDraws(np.zeros((10, 2)), np.zeros(10), 0.4, 5.0, 10)


@pytest.fixture(autouse=True)
def _one_thread_of_linear_algebra() -> Iterator[None]:
    """As `sample_posterior` walks: more of them only contend."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture(scope="module")
def law(make_law: MakeLaw) -> Posterior:
    """A round normal with a hole in which the model is not finite."""

    def density(x: Array) -> Array:
        values = -0.5 * np.sum((x / 0.3) ** 2, axis=1)
        values[x[:, 0] > 0.3] = np.nan
        values[x[:, 0] < -0.5] = np.inf
        return values

    return make_law(density, [-1.0, -1.0], [1.0, 1.0])


def moves() -> Moves:
    return [*choose_moves(PROPOSAL, QUICK)[0], (emcee.moves.KDEMove(), 0.5)]


@pytest.fixture(scope="module")
def start() -> SamplerState:
    rng = np.random.default_rng(1)
    return begin(
        [rng.uniform(-0.4, 0.2, (16, 2)) for _ in range(4)], [1, 2, 3, 4], PROPOSAL, QUICK,
        rejected=Rejected(),
    )  # fmt: skip


def assert_same(one: SamplerState, other: SamplerState) -> None:
    first, second = state_to_arrays(one), state_to_arrays(other)
    assert list(first) == list(second)
    for name in set(first) - {"seconds"}:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name, strict=True)


@pytest.mark.parametrize("threads", [1, 2])
def test_in_one_piece_in_many_or_from_a_stored_copy_the_walk_is_the_same(
    law: Posterior, start: SamplerState, threads: int
) -> None:
    at_once = advance(law, start, moves, 30, 1)
    state = start
    for n_steps in (1, 12, 2, 15):
        state = state_from_arrays(state_to_arrays(state))
        state = advance(law, state, moves, n_steps, threads)
    assert_same(state, at_once)
    assert at_once.n_steps == 30
    assert start.n_steps == 0
    assert len(np.unique(at_once.z[:, -1])) > 64  # ensembles do not repeat each other


def test_the_arrays_hold_every_field(law: Posterior, start: SamplerState) -> None:
    """A field that was forgotten would come back as its default."""
    state = replace(advance(law, start, moves, 10, 1), n_checked=7, n_passed=1, seconds=3.5)
    back = state_from_arrays(state_to_arrays(state))
    assert (back.n_checked, back.n_passed, back.seconds) == (7, 1, 3.5)
    assert back.quick.k_hat == 0.4
    assert_same(back, state)
    missing = state_to_arrays(state)
    del missing["random_keys"]
    with pytest.raises(KeyError, match="random_keys"):
        state_from_arrays(missing)


def test_points_where_the_model_is_not_finite_are_rejected_counted_and_kept(
    law: Posterior, start: SamplerState
) -> None:
    state = advance(law, start, moves, 50, 1)
    assert state.rejected.n > 50
    assert state.rejected.examples.shape == (MOST_EXAMPLES, 2)
    x = state.rejected.examples
    assert np.all((np.abs(x) <= 1.0) & ((x[:, :1] > 0.3) | (x[:, :1] < -0.5)))  # none outside
    assert np.all((state.z[..., 0] <= 0.3) & (state.z[..., 0] >= -0.5))


@pytest.mark.parametrize("method", ["psis", "emcee"])
def test_draws_tell_the_points_that_were_rejected(law: Posterior, method: str) -> None:
    config = pb.RunConfig(accuracy="draft", n_walkers=16, threads=1, max_steps=100)
    draws = sample_posterior(law, PROPOSAL, config, method=method, seed=1)
    assert draws.method == method
    assert draws.rejected.n > 100
    assert np.all((draws.x[..., 0] <= 0.3) & (draws.x[..., 0] >= -0.5))
    assert find_map(law, seed=1).rejected.n > 10


def test_from_any_state_that_was_handed_over_the_draws_are_the_same(
    law: Posterior, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also from within a round, between two checks, and when nothing is left to do."""
    monkeypatch.setattr(ensembles, "_PIECE_SECONDS", 0.02)
    config = pb.RunConfig(accuracy="draft", n_walkers=16, threads=1, max_steps=150)
    kept: list[SamplerState] = []
    watched = Checkpoint(None, lambda state, _: kept.append(state))
    whole = sample_posterior(law, PROPOSAL, config, method="emcee", seed=1, checkpoint=watched)
    inner = [s for s in kept if s.n_steps != s.n_checked]
    for state in (kept[0], inner[len(inner) // 2], kept[-2], kept[-1]):
        again = sample_posterior(
            law, PROPOSAL, config, method="emcee", seed=1, checkpoint=Checkpoint(state)
        )
        np.testing.assert_array_equal(again.x, whole.x)
        np.testing.assert_array_equal(again.log_prob, whole.log_prob)
        assert (again.rejected.n, again.n_steps) == (whole.rejected.n, whole.n_steps)


def test_states_are_handed_over_about_every_second(
    make_law: MakeLaw, start: SamplerState, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that runs with the evaluations, of which a step of the ensembles has 4 to 8."""
    now = [0.0]

    def slow(x: Array) -> Array:
        now[0] += 0.005
        return np.zeros(len(x))

    monkeypatch.setattr(ensembles.time, "perf_counter", lambda: now[0])
    times: list[float] = []
    checkpoint = Checkpoint(None, lambda *_: times.append(now[0]))
    law = make_law(slow, [-1.0, -1.0], [1.0, 1.0])
    walk_to(law, start, moves, 200, threads=1, checkpoint=checkpoint)
    assert 4 <= len(times) < 50
    assert np.max(np.diff([0.0, *times])) < 3.0
