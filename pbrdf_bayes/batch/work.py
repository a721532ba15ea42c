"""One sample in a process of its own kind: locally or on another machine, the same function."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pbrdf_bayes.batch.at_work import forget, stage_writer
from pbrdf_bayes.batch.outcome import DONE, SKIPPED, Row, failed_row, finished_row, noted
from pbrdf_bayes.batch.own_report import KEPT, is_own_report, note_report
from pbrdf_bayes.batch.plan import Job
from pbrdf_bayes.batch.shared_folder import blind_to, sees_mark
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import PbrdfError, RunFolderError
from pbrdf_bayes.io.checkpoint import has_checkpoints, remove_checkpoints_of_other_files
from pbrdf_bayes.io.run_folder import damage_of, is_finished, load_summary, locked
from pbrdf_bayes.workflow.fitting import Observer, fit_into
from pbrdf_bayes.workflow.paperwork import Paperwork, amend_folder

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)  # fmt: skip
"""Environment of a worker: as many processes as cores, so one thread each."""


@dataclass(frozen=True)
class Task:
    """A job with all that its worker needs; it pickles in about 20 bytes a reading and column.

    ``mark`` is what the client has left in ``out``.
    """

    job: Job
    out: Path
    config: RunConfig
    seed: int
    mark: str
    paperwork: Paperwork = field(default_factory=Paperwork)


def prepare_worker() -> None:
    """Leave interrupts to the parent, and end when the parent has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)


def run_task(task: Task) -> Row:
    """Fit a sample into its folder, or go on with what is there; never raises for a bad sample.

    The folder's name says what the run is made from, so what is found finished there is the
    result, but for the paperwork: that is done anew. Another process in the folder is refused by
    its lock.
    """
    started = time.perf_counter()
    job, m, wanted = task.job, task.job.measurement, task.paperwork
    assert m is not None
    status, notice = DONE, ""
    if not sees_mark(task.out, task.mark):
        return failed_row(job, blind_to(task.out), seconds=time.perf_counter() - started)
    told = stage_writer(task.out, job.folder)
    told("start")
    try:
        folder = own_folder(task.out, job.folder)
        if not _is_done(folder):  # it is where the process ended before it could say so
            if has_checkpoints(folder):
                with locked(folder):
                    remove_checkpoints_of_other_files(folder, m.sha256)
            run = fit_into(
                folder, m, task.config, seed=task.seed, resume=True, paperwork=wanted, brief=True,
                observer=Observer(stage=told),
            )  # fmt: skip
            note_report(folder)
            notice = run.notice
        elif wanted.amends:
            told("judge")
            amend_folder(folder, wanted, brief=True)
            note_report(folder)
            status = SKIPPED
        summary = load_summary(folder)
        seconds = time.perf_counter() - started if status == DONE else _of_the_fit(summary)
        row = finished_row(job, summary, status=status, seconds=seconds)
        row = noted(row, notice) if notice else row
    except PbrdfError as error:
        return failed_row(job, str(error), seconds=time.perf_counter() - started)
    except (ArithmeticError, ValueError, RuntimeError, OSError, MemoryError) as error:
        text = f"{type(error).__name__}: {error}. Fit this sample alone to see where it happens"
        return failed_row(job, text, seconds=time.perf_counter() - started)
    finally:
        forget(task.out, [job.folder])
        _give_back_memory()
    return row


def _give_back_memory() -> None:
    """Return what is free to the system: glibc keeps it, in pieces that grow over many samples."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    if trim is not None:
        trim(0)


def finished_before(out: Path, job: Job, wanted: Paperwork) -> Row | None:
    """Row of a sample that an earlier batch has finished and judged; None where it has not.

    What was issued by other means since then is left as it is, and is what the row says; so is a
    run with damaged files, which is fitted again only where its report is that of the batch.
    """
    try:
        folder = own_folder(out, job.folder)
        summary = load_summary(folder) if is_finished(folder) else None
        if summary is None or summary["status"] != "done":
            return None
        if damage := damage_of(folder, summary):
            return None if is_own_report(folder) else failed_row(job, f"{folder}: {damage}. {KEPT}")
        is_as_wanted = wanted.is_in(summary)
        if not is_as_wanted and is_own_report(folder):
            return None
        row = finished_row(job, summary, status=SKIPPED, seconds=_of_the_fit(summary))
        return row if is_as_wanted else noted(row, KEPT)
    except (RunFolderError, OSError) as error:
        return failed_row(job, str(error))


def _of_the_fit(summary: Mapping[str, Any]) -> float:
    """What the fit has taken when it was done [s]."""
    return float(sum(seconds or 0.0 for seconds in summary["timings"].values()))


def _is_done(folder: Path) -> bool:
    if not is_finished(folder):
        return False
    summary = load_summary(folder)
    return summary["status"] == "done" and not damage_of(folder, summary)


def own_folder(out: Path, name: str) -> Path:
    """Folder of a run inside ``out``; a link that could lead out of it is refused.

    Raises
    ------
    RunFolderError
    """
    folder = out / name
    links = [folder] if folder.is_symlink() else []
    links += [p for p in folder.iterdir() if p.is_symlink()] if folder.is_dir() else []
    if links:
        msg = (
            f"{links[0]}: is a symbolic link, which is not followed from a batch folder. Remove "
            "the link, or give another --out"
        )
        raise RunFolderError(msg)
    return folder
