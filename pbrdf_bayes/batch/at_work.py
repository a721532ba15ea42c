"""Who does what just now: a small file for every sample in hand, which its worker writes.

The workers see the folder of the batch, wherever they run, so nothing else has to connect them
with the process that waits for them, and one that is killed leaves nothing to be closed.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_PREFIX = ".at_work-"
_LENGTH = 200
"""Bytes, always as many, so that nothing is ever read half written."""


@dataclass(frozen=True)
class AtWork:
    """A worker and what it does.

    Attributes
    ----------
    worker : str
        Host and process.
    sample : str
    stage : str
        Of the fit.
    seconds : float
        How long it has been in that stage.
    """

    worker: str
    sample: str
    stage: str
    seconds: float


def stage_writer(out: Path, folder: str) -> Callable[[str], None]:
    """What a worker tells the stages of its sample; a disk that is full does not stop the fit.

    Parameters
    ----------
    out : Path
        Folder of the batch.
    folder : str
        Name of the run folder.
    """
    path = _path(out, folder)
    worker = f"{socket.gethostname()} {os.getpid()}"

    def told(stage: str) -> None:
        flags = os.O_WRONLY | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        with suppress(OSError), os.fdopen(os.open(path, flags, 0o644), "wb") as file:
            file.write(f"{worker}\t{stage}".encode("ascii", "replace")[:_LENGTH].ljust(_LENGTH))

    return told


def forget(out: Path, folders: Iterable[str]) -> None:
    """Remove what was written of these samples."""
    for folder in folders:
        with suppress(OSError):
            _path(out, folder).unlink(missing_ok=True)


def forget_all(out: Path) -> None:
    """Remove what an earlier batch left behind that was killed."""
    forget(out, [path.name.removeprefix(_PREFIX) for path in out.glob(f"{_PREFIX}*")])


def look(out: Path, samples: dict[str, str], *, most: int) -> tuple[AtWork, ...]:
    """What is being done, in the order of the workers' names.

    Parameters
    ----------
    out : Path
        Folder of the batch.
    samples : dict of str to str
        Sample by the name of its run folder, of what was handed over.
    most : int
        Workers there are; the latest count where one that was killed left its file behind.
    """
    found = []
    for folder, sample in samples.items():
        path = _path(out, folder)
        with suppress(OSError):
            if path.is_symlink():
                continue
            with path.open("rb") as file:
                text = file.read(_LENGTH).decode("ascii", "replace").rstrip()
            since = path.stat().st_mtime
            worker, tab, stage = text.partition("\t")
            if tab:
                found.append((since, AtWork(worker, sample, stage, max(time.time() - since, 0.0))))
    latest = sorted(found, key=lambda pair: pair[0])[-most:]
    return tuple(sorted((one for _, one in latest), key=lambda one: one.worker))


def _path(out: Path, folder: str) -> Path:
    return out / f"{_PREFIX}{folder}"
