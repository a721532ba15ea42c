"""Who computes: processes of this machine or those of a Dask cluster, behind one interface.

Both are `concurrent.futures.Executor`; everything above knows no more than that.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pbrdf_bayes.batch.outcome import Row
from pbrdf_bayes.batch.work import ONE_THREAD, Task, prepare_worker, run_task, sees_mark
from pbrdf_bayes.errors import ConfigError

CONNECT_SECONDS = 10.0
CLOSE_SECONDS = 5.0
FIRST_WORKER_SECONDS = 30.0
"""A scheduler without workers is given that long to get one."""
_ANSWER_SECONDS = 2.0


@dataclass(frozen=True)
class Crew:
    """Workers that can be asked for.

    Attributes
    ----------
    start : callable
        An executor with at most that many workers.
    n_workers : int
        Samples computed at the same time.
    stop : callable
        Ends an executor and what it still does.
    work : callable
        What is handed to the executor.
    lost : tuple of exception types
        What says that all workers are gone for good, and with them what was handed over.
    blind : callable
        Workers that do not see the folder of the batch, given with what the client left in it.
    count : callable or None
        Workers there are just now, where that may change.
    """

    start: Callable[[int], Executor]
    n_workers: int
    stop: Callable[[Executor], None]
    work: Callable[[Task], Row] = run_task
    lost: tuple[type[BaseException], ...] = ()
    blind: Callable[[Path, str], Sequence[str]] = lambda *_: ()
    count: Callable[[], int] | None = None


@contextmanager
def local_crew(n_workers: int) -> Iterator[Crew]:
    """Processes of this machine, one thread each, started afresh so that none inherits threads."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield Crew(_start_pool, n_workers, _stop_pool)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start_pool(n_workers: int) -> Executor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(n_workers, mp_context=context, initializer=prepare_worker)


def _stop_pool(pool: Executor) -> None:
    pool.shutdown(wait=False, cancel_futures=True)
    for child in multiprocessing.active_children():
        child.terminate()
        child.join()


@contextmanager
def cluster_crew(address: str) -> Iterator[Crew]:
    """Workers of a Dask scheduler that is running.

    Raises
    ------
    ConfigError
        `distributed` is not installed, the scheduler cannot be reached, it has no worker within
        `FIRST_WORKER_SECONDS`, or one with several threads.
    """
    try:
        from distributed import Client
        from distributed.client import ClosedClientError
        from distributed.comm import CommClosedError
    except ImportError:
        msg = (
            f"--scheduler {address}: the package 'distributed' is not installed. Install it with: "
            "pip install 'pbrdf-bayes[cluster]'"
        )
        raise ConfigError(msg) from None
    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        msg = (
            f"--scheduler {address}: no scheduler answers there within {CONNECT_SECONDS:g} s "
            f"({type(error).__name__}). Start one with: dask scheduler; give its address as "
            "tcp://HOST:8786"
        )
        raise ConfigError(msg) from None
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)  # that the scheduler is lost is said once, and in plain words
    try:
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=FIRST_WORKER_SECONDS)
        threads = client.nthreads()
        if not threads or any(n != 1 for n in threads.values()):
            found = f"threads {sorted(threads.values())}"
            if not threads:
                found = f"no worker, and none came in {FIRST_WORKER_SECONDS:g} s"
            msg = (
                f"--scheduler {address}: workers with one thread each are needed, it has {found}. "
                f"Start them with: dask worker {address} --nworkers N --nthreads 1"
            )
            raise ConfigError(msg)
        yield Crew(
            lambda _: client.get_executor(pure=False),
            len(threads),
            _stop_quietly(lambda executor: executor.shutdown(wait=False)),
            run_on_cluster,
            (CancelledError, asyncio.CancelledError, ClosedClientError, CommClosedError),
            lambda out, mark: _blind_workers(client, out, mark),
            _counter(client, len(threads)),
        )
    finally:
        _stop_quietly(lambda one: one.close(timeout=CLOSE_SECONDS))(client)
        log.setLevel(level)


def _blind_workers(client: Any, out: Path, mark: str) -> list[str]:
    """Addresses of the workers that do not see the folder of the batch."""
    try:
        found = client.run(sees_mark, out, mark)
    except (ImportError, AttributeError) as error:
        msg = f"the workers do not run this version of pbrdf_bayes ({error}). Install it there too"
        raise ConfigError(msg) from None
    return sorted(address for address, sees in found.items() if not sees)


def _counter(client: Any, at_first: int) -> Callable[[], int]:
    """Number of workers; what it was before where the scheduler does not answer at once."""
    known = at_first

    def count() -> int:
        nonlocal known
        if client.status == "running":
            with suppress(Exception):
                known = len(client.sync(client.scheduler.ncores, callback_timeout=_ANSWER_SECONDS))
        return known

    return count


def _stop_quietly(stop: Callable[[Any], None]) -> Callable[[Any], None]:
    """What a scheduler that is gone cannot answer is no error of its own."""

    def guarded(what: Any) -> None:
        with suppress(Exception, asyncio.CancelledError):
            stop(what)

    return guarded


def run_on_cluster(task: Task) -> Row:
    """`run_task` where xarray must not see the cluster around it.

    It would ask the scheduler for the lock of every file it writes, and wait for it for ever.
    """
    import dask

    with dask.config.set(scheduler="single-threaded"):
        return run_task(task)
