"""Files from outside: only ordinary ones are read, and only so much of them."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

MAX_TEXT_BYTES = 2**20
"""Largest TOML or JSON file read that a user writes."""


def read_ordinary(path: str | Path, most: int) -> bytes:
    """Content of an ordinary file.

    Parameters
    ----------
    path : str or Path
    most : int
        Bytes it may have; no more are held in memory.

    Returns
    -------
    bytes

    Raises
    ------
    OSError
        ``strerror`` says why: no such file, a folder, a device or a pipe, larger than ``most``
        (``errno.EFBIG``).
    ValueError
        The path is none.
    """
    with open(path, "rb", opener=_without_waiting) as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise OSError(errno.EINVAL, "a device or a pipe: write its content into a file first")
        data = stream.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"larger than {most // 2**20} MiB, allowed is up to that")
    return data


def _without_waiting(path: str, flags: int) -> int:
    """Open; a pipe that nobody writes to does not block."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
