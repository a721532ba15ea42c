"""How far a batch is, and what a person is told of it."""

from __future__ import annotations

from dataclasses import dataclass

from pbrdf_bayes.batch.at_work import AtWork
from pbrdf_bayes.batch.outcome import Row


@dataclass(frozen=True)
class Progress:
    """How far a batch is.

    Attributes
    ----------
    row : mapping or None
        What has just come out; None at the start and in between.
    n_done, n_samples : int
        Samples that have their row, and all.
    running : tuple of str
        Samples being fitted, at most one for each worker.
    seconds_left : float or None
        None until the first sample is done.
    n_workers : int
    at_work : tuple of AtWork
        What each worker says that it does; a worker that starts or waits says nothing.
    """

    row: Row | None
    n_done: int
    n_samples: int
    running: tuple[str, ...]
    seconds_left: float | None
    n_workers: int = 1
    at_work: tuple[AtWork, ...] = ()


def estimate_left(elapsed: float, *, n_computed: int, n_left: int, n_running: int) -> float | None:
    """Time left [s] at the pace so far, samples being fitted taken as half done.

    Parameters
    ----------
    elapsed : float
        Since the first sample was handed over [s].
    n_computed : int
        Samples done in that time.
    n_left : int
        Samples not done, those being fitted among them.
    n_running : int

    Examples
    --------
    >>> estimate_left(60.0, n_computed=5, n_left=8, n_running=2)
    70.0
    >>> estimate_left(60.0, n_computed=0, n_left=8, n_running=2)
    """
    if not n_computed:
        return None
    half = n_running / 2.0
    return elapsed * max(n_left - half, 0.0) / (n_computed + half)
