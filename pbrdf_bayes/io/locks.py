"""Locks of the operating system on files: gone with the process that holds them.

Two things go wrong with a lock. Another process has it: flock(2) then gives EWOULDBLOCK and nothing
else, msvcrt.locking EACCES or EDEADLOCK. Or the file system has none: ENOLCK, ENOSYS, EOPNOTSUPP,
and from flock on network and user-space file systems also EACCES.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

_HELD = {errno.EACCES, errno.EDEADLK} if os.name == "nt" else {errno.EWOULDBLOCK}
GO_ON = "PBRDF_BAYES_NO_LOCK"
"""Environment variable that lets a process go on where the file system cannot lock."""


def try_lock(handle: int) -> bool:
    """Lock an open file; False where another process has it.

    Where the file system cannot lock and the variable `GO_ON` is set, the file counts as locked.

    Raises
    ------
    OSError
        The file system cannot lock.
    """
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:
            return False
        if not os.environ.get(GO_ON):
            raise
    return True


@contextlib.contextmanager
def only_one_at_a_time(path: Path) -> Iterator[None]:
    """Wait until no other process is inside with the same file; not where none can lock.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    with path.open("a", encoding="utf-8") as handle:
        with contextlib.suppress(OSError):
            if os.name == "nt":
                import msvcrt

                msvcrt.locking(handle.fileno(), msvcrt.LK_LOCK, 1)  # type: ignore[attr-defined,unused-ignore]
            else:
                import fcntl

                fcntl.flock(handle, fcntl.LOCK_EX)
        yield
