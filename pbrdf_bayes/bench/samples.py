"""Time of several measurements: draft fits one after another, in two threads, in two processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from pbrdf_bayes.bench.timing import straight_line
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.inference.sampling.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

WORKERS = 2
_CONFIG = RunConfig(accuracy="draft", threads=1)
_SEED = 1


def measure_samples(*, quick: bool) -> dict[str, Any]:
    """Seconds until so many samples are fitted, one after another and by two workers.

    A fit is the search of the optimum, its Laplace approximation and the draws of ``draft``. The
    clock is read as fits end; workers have started and have everything compiled before it runs.
    Two processes need longer for that than a quick run may take.

    Returns
    -------
    dict
        sizes, seconds (one after another), exponent, fixed, per_unit and off_the_line [s] as for
        the other scalings; threads and, in a full run, processes: sizes, seconds, speed_up at the
        last size; starts of a search and points of a scan.
    """
    sizes = (1, 2, 3) if quick else (1, 2, 4, 8)
    starts, points = (4, 41) if quick else (16, 321)
    grid = np.linspace(-80.0, 80.0, points)
    jobs = [
        (simulate_measurement(GREEN_PAINT, seed=seed, theta_r_deg=grid), starts)
        for seed in range(1, sizes[-1] + 1)
    ]
    clocks: dict[str, _Clock] = {"one": _one_after_another}
    with ExitStack() as stack:
        threads = stack.enter_context(ThreadPoolExecutor(WORKERS))
        clocks["threads"] = by_workers(threads)
        if not quick:
            clocks["processes"] = by_workers(stack.enter_context(ready_processes()))
        best = {name: np.full(len(jobs), np.inf) for name in clocks}
        _fit((jobs[0][0], 1))
        for _ in range(1 if quick else 2):
            for name, clock in clocks.items():
                best[name] = np.minimum(best[name], list(clock(jobs)))
    one = [float(best["one"][n - 1]) for n in sizes]
    found: dict[str, Any] = {
        "sizes": list(sizes),
        "seconds": one,
        **straight_line(sizes, one),
        "starts": starts,
        "points": points,
    }
    shared = [n for n in sizes if n >= WORKERS]
    for name in clocks.keys() - {"one"}:
        seconds = [float(best[name][n - 1]) for n in shared]
        found[name] = {"sizes": shared, "seconds": seconds, "speed_up": one[-1] / seconds[-1]}
    return found


_Job = tuple[Measurement, int]
_Clock = Callable[[list[_Job]], Iterator[float]]


def _fit(job: _Job) -> None:
    measurement, starts = job
    posterior = build_posterior(measurement, _CONFIG)
    mixture = laplace_mixture(posterior, find_map(posterior, n_starts=starts, seed=_SEED))
    sample_posterior(posterior, mixture, _CONFIG, method="psis", seed=_SEED)


def _one_after_another(jobs: list[_Job]) -> Iterator[float]:
    """Seconds from the start to the end of each fit."""
    started = perf_counter()
    for job in jobs:
        _fit(job)
        yield perf_counter() - started


def by_workers(pool: Executor) -> _Clock:
    """A clock of fits that a pool shares out."""

    def clock(jobs: list[_Job]) -> Iterator[float]:
        started = perf_counter()
        for _ in as_completed([pool.submit(_fit, job) for job in jobs]):
            yield perf_counter() - started

    return clock


class _Barrier(Protocol):
    def wait(self) -> int: ...


def ready_processes() -> ProcessPoolExecutor:
    """Two processes that are ready to fit."""
    context = multiprocessing.get_context("spawn")  # the same on every system
    barrier = context.Barrier(WORKERS)
    pool = ProcessPoolExecutor(WORKERS, mp_context=context, initializer=_begin, initargs=(barrier,))
    list(pool.map(abs, range(WORKERS)))
    return pool


def _begin(barrier: _Barrier) -> None:
    """One thread for BLAS, kernels loaded; then wait for the others."""
    threadpool_limits(limits=1)
    grid = np.linspace(-80.0, 80.0, 21)
    _fit((simulate_measurement(GREEN_PAINT, seed=_SEED, theta_r_deg=grid), 1))
    barrier.wait()
