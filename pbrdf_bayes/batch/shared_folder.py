"""Whether client and workers see the same folder: each looks for what the other has written there.

A worker on another machine may have a folder of that name on a disk of its own; what it writes
there is lost to the batch.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
from contextlib import suppress
from pathlib import Path

from pbrdf_bayes.io.run_folder import SUMMARY, write_text

MARK = ".batch"
SEEN_WITHIN = 10.0
"""Time that a network file system may take to show a file everywhere [s]."""
_LOOK_EVERY = 0.1


def leave_mark(out: Path) -> str:
    """Write something into the folder of the batch that no other folder has; returns it."""
    mark = secrets.token_hex(16)
    write_text(out / MARK, mark)
    return mark


def remove_mark(out: Path) -> None:
    """When the batch has ended."""
    with suppress(OSError):
        (out / MARK).unlink(missing_ok=True)


def sees_mark(out: Path, mark: str) -> bool:
    """Whether this process sees the folder that the mark was left in, perhaps after a while."""
    return _appears(out / MARK, mark.encode())


def sees_run(out: Path, run: str) -> bool:
    """Whether the summary of a run is to be seen from here, perhaps after a while."""
    return _appears(out / run / SUMMARY)


def blind_to(out: Path) -> str:
    """What is said of a worker that does not see the mark."""
    worker = f"{socket.gethostname()} {os.getpid()}"
    return f"worker {worker} does not see the folder of this batch, {out}. {SHARE}"


SHARE = (
    "All workers must share it under the same path, on a network file system: give an --out that "
    "they share"
)


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
