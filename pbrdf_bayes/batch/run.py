"""A batch from its files to its index: every sample gets a row, whatever happens to the others."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pbrdf_bayes.batch.executors import Crew, cluster_crew, local_crew
from pbrdf_bayes.batch.index import INDEX_FILES, write_index
from pbrdf_bayes.batch.outcome import FAILED, Row, failed_row, open_row, repeat_row
from pbrdf_bayes.batch.plan import Job, plan_batch
from pbrdf_bayes.batch.work import (
    SHARE,
    Task,
    finished_before,
    leave_mark,
    remove_mark,
    sees_run,
)
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.document import Document, refuse_shared_items
from pbrdf_bayes.errors import ClusterError, ConfigError, PbrdfError
from pbrdf_bayes.inference.parameters.effects import before_choice
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.io.run_folder import locked, refuse_other_content
from pbrdf_bayes.specification import Specification
from pbrdf_bayes.workflow.compile_ahead import compile_ahead, likelihood_to_compile
from pbrdf_bayes.workflow.fitting import DEFAULT_SEED
from pbrdf_bayes.workflow.paperwork import Paperwork

_INDEX_EVERY = 5.0
_INDEX_AT_LEAST_EVERY = 60.0
"""Also where no sample is done, so that its readers see that the batch goes on."""
_LOOK_EVERY = 0.5
Rows = dict[int, Row]


@dataclass(frozen=True)
class Progress:
    """How far a batch is.

    Attributes
    ----------
    row : mapping or None
        What has just come out; None at the start and in between.
    n_done, n_samples : int
        Samples that have their row, and all.
    running : tuple of tuple
        Name of each sample that is being fitted, at most one for each worker, and for how long [s].
    seconds_left : float or None
        None until the first sample is done.
    n_workers : int
    """

    row: Row | None
    n_done: int
    n_samples: int
    running: tuple[tuple[str, float], ...]
    seconds_left: float | None
    n_workers: int = 1


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


@dataclass(frozen=True)
class BatchResult:
    """What a batch left behind.

    Attributes
    ----------
    folder : Path
        With ``index.html``, ``index.csv``, ``index.json`` and the run folders.
    samples : tuple of mapping
        Rows of the index, in the order of the samples.
    """

    folder: Path
    samples: tuple[Row, ...]

    @property
    def is_clean(self) -> bool:
        """No sample failed, no verdict is FAIL, and where limits were given all are accepted."""
        return not any(
            row["status"] == FAILED
            or row["verdict"] == "FAIL"
            or row["conformity"] not in (None, "ACCEPT")
            for row in self.samples
        )


def fit_batch(
    files: Sequence[str | Path],
    config: RunConfig | None = None,
    *,
    out: str | Path | None = None,
    seed: int = DEFAULT_SEED,
    workers: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    limits: Specification | None = None,
    reference: str | Path | None = None,
    document: Document | None = None,
    told: Callable[[Progress], None] | None = None,
    interrupted: Callable[[], bool] | None = None,
) -> BatchResult:
    """Fit every sample of some tidy CSV files and write an index of them.

    Parameters
    ----------
    files : sequence of str or Path
        In their order; a list in the alphabetical one comes by the numbers in the names.
    config : RunConfig, optional
        Of every sample; ``threads`` is 1 in each worker.
    out : str or Path, optional
        Folder of the batch; reports/batch/<time> by default.
    seed : int
        Of every sample.
    workers : int
        Processes on this machine.
    scheduler : str, optional
        Address of a Dask scheduler whose workers are taken instead; they must see ``out`` under
        the same path.
    resume : bool
        Go on with ``out``: samples finished with the same readings, configuration, seed and version
        are skipped, interrupted ones go on from their checkpoints, wherever their files are now.
        Limits and document are not among these: where they are others than before, samples that
        are finished are judged anew and not fitted again, but for those whose report was made by
        other means since: it is kept, and the row says so.
    limits : Specification, optional
        What every sample is judged against, see `read_limits`.
    reference : str or Path, optional
        Run folder of the sample that differences in the limits are to; workers of a scheduler
        must see it under the same path.
    document : Document, optional
        Items of every report, see `read_document`.
    told : callable, optional
        Told how far the batch is: after every sample, and twice a second in between.
    interrupted : callable, optional
        Asked twice a second whether to stop.

    Returns
    -------
    BatchResult

    Raises
    ------
    ConfigError
        No files, choices that no sample can be fitted with, workers that cannot be had, limits on
        what the model does not have or with differences and no reference, a report number that
        several reports would have in common.
    RunFolderError
        The reference is no finished run, ``out`` is not empty, in use, or cannot be written.
    ClusterError
        The scheduler was lost; the index has what was done, and ``resume`` goes on.
    """
    if not files:
        msg = "no files. Give at least one CSV file"
        raise ConfigError(msg)
    if not 1 <= workers <= 1024:
        msg = f"workers = {workers!r} is not allowed: give a whole number from 1 to 1024"
        raise ConfigError(msg)
    other = None if reference is None else Path(reference).resolve()
    paperwork = Paperwork(limits, other, document)
    paperwork.check()
    config = replace(config or RunConfig(), threads=1)
    jobs = plan_batch([Path(file) for file in files], config, seed=seed)
    if document is not None:
        refuse_shared_items(document, [job.sample for job in jobs if job.folder])
    folder = _folder(out, resume=resume)
    with locked(folder), _crew(workers, scheduler) as crew:
        batch = _Batch(jobs, folder.resolve(), config, seed, paperwork, told, interrupted)
        batch.run(crew, resume=resume)
        return BatchResult(folder, tuple(batch.rows[i] for i in range(len(jobs))))


def _crew(workers: int, scheduler: str | None) -> AbstractContextManager[Crew]:
    return local_crew(workers) if scheduler is None else cluster_crew(scheduler)


def _folder(out: str | Path | None, *, resume: bool) -> Path:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = Path(out) if out is not None else Path("reports") / "batch" / stamp
    remedy = "Give another --out" if resume else "Add --resume, or give another --out"
    refuse_other_content(
        folder, known=INDEX_FILES if resume else (), any_of=True, what="the folder of the batch",
        remedy=remedy,
    )  # fmt: skip
    return folder


@dataclass(eq=False)
class _Batch:
    """The state of a batch that runs; rows by the number of their job."""

    jobs: tuple[Job, ...]
    out: Path
    config: RunConfig
    seed: int
    paperwork: Paperwork
    told: Callable[[Progress], None] | None
    interrupted: Callable[[], bool] | None
    rows: Rows = field(default_factory=dict)
    running: dict[Future[Row], int] = field(default_factory=dict)
    handed: dict[int, float] = field(default_factory=dict)
    index_written: float = -float("inf")
    began: float = field(default_factory=time.monotonic)
    n_computed: int = 0
    n_workers: int = 1
    lost: str = ""
    mark: str = ""

    def run(self, crew: Crew, *, resume: bool) -> None:
        waiting: deque[int] = deque()
        for i, job in enumerate(self.jobs):
            row = self._known(job, resume=resume)
            if row is None:
                waiting.append(i)
            else:
                self.rows[i] = row
        self.n_workers = crew.n_workers
        try:
            self._write()
            self.mark = leave_mark(self.out)
            for row in [r for r in self.rows.values() if r["error"] or r["notice"]]:
                self._tell(row)
            if waiting:
                self._refuse_blind(crew)
                self._compile(waiting)
                self._tell()
                self._work_off(crew, waiting)
        except ClusterError as error:
            self.lost = str(error)
            raise
        finally:
            remove_mark(self.out)
            self._write(whole=True)

    def _refuse_blind(self, crew: Crew) -> None:
        """What workers elsewhere write would be lost; one that joins later is asked by its task."""
        if blind := crew.blind(self.out, self.mark):
            msg = f"{len(blind)} of the workers do not see {self.out} ({', '.join(blind[:3])}). "
            raise ConfigError(msg + SHARE)

    def _known(self, job: Job, *, resume: bool) -> Row | None:
        if job.measurement is None:
            return failed_row(job, job.error)
        if job.repeat_of is not None:
            return repeat_row(job)
        return finished_before(self.out, job, self.paperwork) if resume else None

    def _compile(self, waiting: Sequence[int]) -> None:
        """Have the kernels of the first sample compiled, so that the workers only load them."""
        measurement = self.jobs[waiting[0]].measurement
        assert measurement is not None
        with suppress(PbrdfError):  # its worker says what is wrong with it
            missing = likelihood_to_compile(
                build_posterior(measurement, before_choice(self.config))
            )
            if missing is not None:
                compile_ahead(missing)

    def _work_off(self, crew: Crew, waiting: deque[int]) -> None:
        """All samples at the same time; those in hand when a process died, one by one after that.

        Which one it died of is not known. The second process lost with a sample alone in it is.
        """
        self.began = time.monotonic()
        while waiting:
            for i in self._compute(crew, waiting):
                if self._compute(crew, deque([i]), alone=True):
                    self._take(i, failed_row(self.jobs[i], _LOST))

    def _compute(self, crew: Crew, waiting: deque[int], *, alone: bool = False) -> list[int]:
        """Work off what waits; the samples that were in hand when a process died, if one did."""
        self.n_workers = 1 if alone else crew.n_workers
        executor = crew.start(self.n_workers)
        broken: list[int] = []
        try:
            while (waiting or self.running) and not broken:
                if crew.count is not None and not alone:
                    self.n_workers = max(crew.count(), 1)
                while waiting and len(self.running) <= self.n_workers:
                    self._submit(executor, crew, waiting)
                for future in self._completed():
                    i = self.running.pop(future)
                    try:
                        self._take(i, self._seen(i, future.result()))
                    except BrokenExecutor:
                        broken.append(i)
                    except crew.lost:
                        raise
                    except Exception as error:  # of the cluster: it gave the sample up
                        self._take(i, failed_row(self.jobs[i], f"{type(error).__name__}: {error}"))
        except BrokenExecutor:  # on handing over
            broken += self.running.values()
        except crew.lost:
            raise ClusterError(_NO_SCHEDULER.format(len(self.rows), len(self.jobs))) from None
        finally:
            in_hand = [*self.running.values(), *broken]
            if broken:
                broken = sorted(set(in_hand))
            self.running.clear()
            crew.stop(executor)
        return broken

    def _submit(self, executor: Executor, crew: Crew, waiting: deque[int]) -> None:
        i = waiting[0]
        task = Task(self.jobs[i], self.out, self.config, self.seed, self.mark, self.paperwork)
        self.running[executor.submit(crew.work, task)] = i
        self.handed[i] = time.monotonic()
        waiting.popleft()

    def _completed(self) -> Iterator[Future[Row]]:
        """What is done within half a second, perhaps nothing."""
        if self.interrupted is not None and self.interrupted():
            raise KeyboardInterrupt
        done, _ = wait(self.running, timeout=_LOOK_EVERY, return_when=FIRST_COMPLETED)
        if not done:
            self._tell()
            if time.monotonic() - self.index_written >= _INDEX_AT_LEAST_EVERY:
                self._write()
        yield from done

    def _seen(self, i: int, row: Row) -> Row:
        """The row; a failed one where the run that it speaks of is not to be seen from here."""
        if row["run"] is None or sees_run(self.out, row["run"]):
            return row
        error = _NOT_SEEN.format(self.out / row["run"])
        return failed_row(self.jobs[i], error, seconds=row["seconds"])

    def _take(self, i: int, row: Row) -> None:
        self.rows[i] = row
        self.n_computed += 1
        self._write()
        self._tell(row)

    def _tell(self, row: Row | None = None) -> None:
        if self.told is None:
            return
        now = time.monotonic()
        in_hand = list(self.running.values())[: self.n_workers]
        running = tuple((self.jobs[i].sample, now - self.handed[i]) for i in in_hand)
        left = estimate_left(
            now - self.began, n_computed=self.n_computed,
            n_left=len(self.jobs) - len(self.rows), n_running=len(running),
        )  # fmt: skip
        self.told(Progress(row, len(self.rows), len(self.jobs), running, left, self.n_workers))

    def _write(self, *, whole: bool = False) -> None:
        """The index, at most every five seconds while the batch runs, and ``whole`` at its end."""
        if whole or time.monotonic() - self.index_written >= _INDEX_EVERY:
            found = dict(self.rows)
            if self.lost:
                left = (i for i in range(len(self.jobs)) if i not in found)
                found |= {i: open_row(self.jobs[i], _NOT_REACHED) for i in left}
            rows: list[dict[str, Any]] = [found[i] for i in sorted(found)]
            finished = len(self.rows) == len(self.jobs)
            write_index(
                self.out, rows, n_samples=len(self.jobs), finished=finished, running=not whole
            )
            self.index_written = time.monotonic()


_LOST = (
    "the process that fitted this sample died twice, the second time with nothing else to do: out "
    "of memory, or killed. Fit this sample alone to see where it happens"
)
_NOT_SEEN = "its worker has fitted this sample, but {} is not to be seen from here. " + SHARE
_NO_SCHEDULER = (
    "the scheduler was lost with {} of {} samples done: it ended, or cannot be reached any more. "
    "Nothing of what was done is lost. Start scheduler and workers again, and go on with --resume "
    "and the same --out"
)
_NOT_REACHED = (
    "not done yet: the scheduler was lost before this sample was. Start scheduler and workers "
    "again, and go on with --resume"
)
