"""Ensembles of walkers: their whole state as one record, and the function that advances it.

A state holds all that decides how the walk goes on: walked in one piece, in many, or in another
process from a stored copy, the steps are the same bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.rejected import Rejected, rejected_among, together
from pbrdf_bayes.inference.sampling.importance import ImportanceDraws
from pbrdf_bayes.inference.sampling.mixture import Mixture

Array = NDArray[np.float64]
Moves = list[tuple[object, float]]

_FIRST_STEPS = 10
_PIECE_SECONDS = 1.0


@dataclass(frozen=True, eq=False)
class SamplerState:
    """Where independent ensembles are and how they go on.

    Attributes
    ----------
    mixture : Mixture
        Fixed proposal of the independence move.
    quick : ImportanceDraws
        How good a proposal it is; without its draws.
    starts : ndarray, shape (n_ensembles, n_walkers, n_par)
        Where the walk began, in the coordinates z.
    z : ndarray, shape (n_ensembles, n_steps, n_walkers, n_par)
        The walk.
    log_prob : ndarray, shape (n_ensembles, n_steps, n_walkers)
        Log-density of its places in the coordinates z.
    accepted : ndarray, shape (n_ensembles, n_walkers)
        Accepted proposals of each walker.
    random_keys : ndarray of uint32, shape (n_ensembles, 624)
    random_rest : ndarray, shape (n_ensembles, 3)
        State of each ensemble's Mersenne twister: its keys; position, whether a normal deviate is
        left over, and that deviate.
    rejected : Rejected
        Points where the model gave no finite density, since the first evaluation.
    n_checked, n_passed : int
        Steps at the last check of convergence, and checks passed in a row up to it.
    seconds : float
        Time this took so far, in all processes; for display only.
    """

    mixture: Mixture
    quick: ImportanceDraws
    starts: Array
    z: Array
    log_prob: Array
    accepted: Array
    random_keys: NDArray[np.uint32]
    random_rest: Array
    rejected: Rejected
    n_checked: int = 0
    n_passed: int = 0
    seconds: float = 0.0

    @property
    def n_steps(self) -> int:
        """Steps of each ensemble so far."""
        return int(self.z.shape[1])


@dataclass(frozen=True)
class Checkpoint:
    """The state to go on from, if there is one, and who is handed every state that is reached.

    ``keep`` is called about every second; its second argument asks for the state to be stored at
    once. It does not change the draws.
    """

    found: SamplerState | None = None
    keep: Callable[[SamplerState, bool], None] = field(default=lambda *_: None)


def begin(
    starts: Sequence[Array], seeds: Sequence[int], mixture: Mixture, quick: ImportanceDraws,
    *, rejected: Rejected,
) -> SamplerState:  # fmt: skip
    """The state of ensembles that have not moved yet.

    Parameters
    ----------
    starts : sequence of ndarray, each of shape (n_walkers, n_par)
        Walkers of each ensemble, in the coordinates z.
    seeds : sequence of int
        One for each ensemble.
    mixture, quick, rejected
        As in `SamplerState`.
    """
    places = np.array(starts)
    n_ensembles, n_walkers, n_par = places.shape
    random: list[Any] = [np.random.RandomState(seed).get_state() for seed in seeds]
    return SamplerState(
        mixture=mixture,
        quick=replace(quick, z=quick.z[:0], log_prob=quick.log_prob[:0]), starts=places,
        z=np.empty((n_ensembles, 0, n_walkers, n_par)),
        log_prob=np.empty((n_ensembles, 0, n_walkers)),
        accepted=np.zeros((n_ensembles, n_walkers)),
        random_keys=np.array([r[1] for r in random], dtype=np.uint32),
        random_rest=np.array([r[2:] for r in random], dtype=np.float64),
        rejected=rejected,
    )  # fmt: skip


def advance(
    posterior: Posterior, state: SamplerState, moves: Callable[[], Moves], n_steps: int,
    threads: int,
) -> SamplerState:  # fmt: skip
    """The state after ``n_steps`` more steps of every ensemble.

    Parameters
    ----------
    posterior : Posterior
    state : SamplerState
    moves : callable
        Makes the moves and their shares; they hold intermediate results while they propose, so
        every ensemble has its own.
    n_steps, threads : int

    Returns
    -------
    SamplerState
    """

    def walk(ensemble: int) -> SamplerState:
        return _walk(posterior, state, ensemble, moves(), n_steps)

    started = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        walked = list(pool.map(walk, range(len(state.starts))))
    return replace(
        state,
        z=np.concatenate([state.z, np.concatenate([w.z for w in walked])], axis=1),
        log_prob=np.concatenate(
            [state.log_prob, np.concatenate([w.log_prob for w in walked])], axis=1
        ),
        accepted=state.accepted + np.concatenate([w.accepted for w in walked]),
        random_keys=np.concatenate([w.random_keys for w in walked]),
        random_rest=np.concatenate([w.random_rest for w in walked]),
        rejected=together(state.rejected, *(w.rejected for w in walked)),
        seconds=state.seconds + time.perf_counter() - started,
    )


def walk_to(
    posterior: Posterior, state: SamplerState, moves: Callable[[], Moves], end: int,
    *, threads: int, checkpoint: Checkpoint,
) -> SamplerState:  # fmt: skip
    """Advance to the step ``end``, in pieces of about a second, each handed to the checkpoint.

    The pieces follow the clock, the steps do not.
    """
    while state.n_steps < end:
        n_steps = min(_steps_of_a_piece(state), end - state.n_steps)
        state = advance(posterior, state, moves, n_steps, threads)
        checkpoint.keep(state, False)
    return state


def _steps_of_a_piece(state: SamplerState) -> int:
    if not state.n_steps:
        return _FIRST_STEPS
    return max(1, int(_PIECE_SECONDS * state.n_steps / max(state.seconds, 1e-6)))


def _walk(
    posterior: Posterior, state: SamplerState, ensemble: int, moves: Moves, n_steps: int
) -> SamplerState:
    """The next steps of one ensemble alone, in the same record."""
    points, values = [], []

    def density(z: Array) -> Array:
        log_prob = posterior.log_prob_coordinates(z)
        bad = ~np.isfinite(log_prob)
        points.append(z[bad])
        values.append(log_prob[bad])
        return log_prob

    n_walkers, n_par = state.starts.shape[1:]
    moved = state.n_steps > 0
    # emcee ignores an integer as random state without a word; only a full state seeds it
    position, has_gauss, gauss = state.random_rest[ensemble]
    start = emcee.State(
        state.z[ensemble, -1] if moved else state.starts[ensemble],
        log_prob=state.log_prob[ensemble, -1] if moved else None,
        random_state=(
            "MT19937", state.random_keys[ensemble], int(position), int(has_gauss), float(gauss)
        ),
    )  # fmt: skip
    sampler = emcee.EnsembleSampler(n_walkers, n_par, density, moves=moves, vectorize=True)
    sampler.run_mcmc(start, n_steps, skip_initial_state_check=True)
    random = sampler.random_state
    x = posterior.from_coordinates(np.concatenate(points))
    return replace(
        state,
        z=sampler.get_chain()[None],
        log_prob=sampler.get_log_prob()[None],
        accepted=sampler.backend.accepted[None],
        random_keys=np.array(random[1], dtype=np.uint32)[None],
        random_rest=np.array(random[2:], dtype=np.float64)[None],
        rejected=rejected_among(posterior, x, np.concatenate(values)),
    )


def state_to_arrays(state: SamplerState) -> dict[str, NDArray[np.generic]]:
    """All of a state as plain arrays by name; `state_from_arrays` gives it back."""
    return dict(_flat(state, ""))


def state_from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> SamplerState:
    """The state whose arrays `state_to_arrays` gave.

    Raises
    ------
    KeyError
        When one of them is missing.
    """
    state: SamplerState = _record(SamplerState, arrays, "")
    return state


_RECORDS = {"mixture": Mixture, "quick": ImportanceDraws, "rejected": Rejected}


def _flat(record: Any, prefix: str) -> Iterator[tuple[str, NDArray[np.generic]]]:
    for f in fields(record):
        value, name = getattr(record, f.name), f"{prefix}{f.name}"
        if f.name in _RECORDS:
            yield from _flat(value, f"{name}.")
        else:
            yield name, np.asarray(value)


def _record(kind: Any, arrays: Mapping[str, NDArray[np.generic]], prefix: str) -> Any:
    values = {}
    for f in fields(kind):
        name = f"{prefix}{f.name}"
        if f.name in _RECORDS:
            values[f.name] = _record(_RECORDS[f.name], arrays, f"{name}.")
        else:
            values[f.name] = arrays[name] if arrays[name].ndim else arrays[name].item()
    return kind(**values)
