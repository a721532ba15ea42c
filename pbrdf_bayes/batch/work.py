"""One sample in a process of its own kind: locally or on another machine, the same function."""

from __future__ import annotations

import ctypes
import hashlib
import multiprocessing
import os
import secrets
import signal
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pbrdf_bayes.batch.outcome import DONE, SKIPPED, Row, failed_row, finished_row, noted
from pbrdf_bayes.batch.plan import Job
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import PbrdfError, RunFolderError
from pbrdf_bayes.io.checkpoint import has_checkpoints, remove_checkpoints_of_other_files
from pbrdf_bayes.io.run_folder import (
    PDF,
    REPORT,
    SUMMARY,
    damage_of,
    is_finished,
    load_summary,
    locked,
    write_text,
)
from pbrdf_bayes.workflow.fitting import fit_into
from pbrdf_bayes.workflow.paperwork import Paperwork, amend_folder

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)  # fmt: skip
"""Environment of a worker: as many processes as cores, so one thread each."""
KEPT = (
    "Its report was made by other means since the batch made one, and is kept with its verdict. "
    f"Remove {REPORT} and {PDF} from its folder to have that of the batch with --resume."
)
SHARE = (
    "All workers must share it under the same path, on a network file system: give an --out that "
    "they share"
)
SEEN_WITHIN = 10.0
"""Time that a network file system may take to show a file everywhere [s]."""
_LOOK_EVERY = 0.1
_MARK = ".batch"
_NOTE = ".batch_report"


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
        worker = f"worker {socket.gethostname()} {os.getpid()}"
        error = f"{worker} does not see the folder of this batch, {task.out}. {SHARE}"
        return failed_row(job, error, seconds=time.perf_counter() - started)
    try:
        folder = own_folder(task.out, job.folder)
        if not _is_done(folder):  # it is where the process ended before it could say so
            if has_checkpoints(folder):
                with locked(folder):
                    remove_checkpoints_of_other_files(folder, m.sha256)
            run = fit_into(
                folder, m, task.config, seed=task.seed, resume=True, paperwork=wanted, brief=True
            )
            note_report(folder)
            notice = run.notice
        elif wanted.amends:
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


def note_report(folder: Path) -> None:
    """Leave in the run folder which report the batch has made.

    Raises
    ------
    RunFolderError
    """
    write_text(folder / _NOTE, _digest(folder / REPORT))


def is_own_report(folder: Path) -> bool:
    """Whether the batch made the report of a run, so that it may replace it.

    A report issued since, with `report`, `conform --save` or `fit`, is somebody else's document.
    One without a note is of a process that died.
    """
    if (folder / PDF).exists():
        return False
    with suppress(FileNotFoundError):
        return (folder / _NOTE).read_bytes() == _digest(folder / REPORT).encode()
    return True


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def leave_mark(out: Path) -> str:
    """Write something into the folder of the batch that no other folder has; returns it.

    A worker on another machine may have a folder of that name on a disk of its own: it looks for
    the mark, and the client looks for the runs.
    """
    mark = secrets.token_hex(16)
    write_text(out / _MARK, mark)
    return mark


def remove_mark(out: Path) -> None:
    """When the batch has ended."""
    with suppress(OSError):
        (out / _MARK).unlink(missing_ok=True)


def sees_mark(out: Path, mark: str) -> bool:
    """Whether this process sees the folder that the mark was left in, perhaps after a while."""
    return _appears(out / _MARK, mark.encode())


def sees_run(out: Path, run: str) -> bool:
    """Whether the summary of a run is to be seen from here, perhaps after a while."""
    return _appears(out / run / SUMMARY)


def _appears(path: Path, content: bytes | None = None) -> bool:
    until = time.monotonic() + SEEN_WITHIN
    while True:
        with suppress(OSError):
            os.listdir(path.parent)  # noqa: PTH208 - a network file system asks again for it
            with path.open("rb") as file:
                if content is None or file.read(len(content) + 1) == content:
                    return True
        if time.monotonic() >= until:
            return False
        time.sleep(_LOOK_EVERY)
