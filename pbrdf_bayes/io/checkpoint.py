"""Checkpoints of a run: what an interrupted fit goes on from, checked before it is used.

A checkpoint is an ``.npz`` file of plain arrays, never a pickle. Its member ``identity`` is a JSON
text that says what it was made from; the last 32 bytes of the file are the SHA-256 of all before.
"""

from __future__ import annotations

import hashlib
import io
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io.run_folder import refuse_difference, remove_parts, write_bytes

Arrays = Mapping[str, NDArray[np.generic]]

EVERY_SECONDS = 5.0
"""A state older than this is stored as soon as it is handed over, which is about every second."""

_PREFIX = "checkpoint_"
_IDENTITY = "identity"
_DIGEST_BYTES = hashlib.sha256().digest_size


def write_checkpoint(path: Path, arrays: Arrays, identity: Mapping[str, Any]) -> None:
    """Write a checkpoint whole or not at all.

    Parameters
    ----------
    path : Path
    arrays : mapping of str to ndarray
        Numbers only.
    identity : mapping
        What it is made from, as plain values for JSON.

    Raises
    ------
    RunFolderError
        When it cannot be written; a checkpoint that was there is unchanged.
    """
    text = json.dumps(identity, ensure_ascii=False).encode("utf-8")
    buffer = io.BytesIO()
    np.savez(buffer, **{_IDENTITY: np.frombuffer(text, np.uint8)}, **arrays)  # type: ignore[arg-type]
    content = buffer.getvalue()
    write_bytes(path, content + hashlib.sha256(content).digest())


def read_checkpoint(path: Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, Any]]:
    """Arrays and identity of a checkpoint.

    Raises
    ------
    RunFolderError
        When it is cut off, changed or no checkpoint at all.
    """
    try:
        stored = path.read_bytes()
    except OSError as error:
        msg = f"{path}: the checkpoint cannot be read ({error.strerror}). Make it readable"
        raise RunFolderError(msg) from None
    content, digest = stored[:-_DIGEST_BYTES], stored[-_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        msg = (
            f"{path}: the checkpoint is damaged ({len(stored)} bytes do not have the checksum at "
            "their end). Delete this file to start that stage from its beginning; all else is kept"
        )
        raise RunFolderError(msg)
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return arrays, json.loads(arrays.pop(_IDENTITY).tobytes())


@dataclass(eq=False)
class Checkpoints:
    """The checkpoints of one run folder, one for each stage that samples; see `open_checkpoints`.

    Attributes
    ----------
    folder : Path
    identity : mapping
    found : mapping of str to mapping
        Arrays by stage, as they were when the run began.
    now : callable
        A clock [s].
    """

    folder: Path
    identity: Mapping[str, Any]
    found: Mapping[str, Arrays]
    now: Callable[[], float] = time.monotonic
    _written: float = field(default=-np.inf, init=False)
    _waiting: tuple[str, Arrays] | None = field(default=None, init=False)

    def keep(self, stage: str, arrays: Arrays, *, at_once: bool = False) -> None:
        """Store a state, at once or when the last one has become old.

        Raises
        ------
        RunFolderError
        """
        self._waiting = stage, arrays
        if at_once or self.now() - self._written >= EVERY_SECONDS:
            self._store()

    @contextmanager
    def kept_when_interrupted(self) -> Iterator[None]:
        """Store the last state when the run is interrupted."""
        try:
            yield
        except RunFolderError:
            raise
        except BaseException:
            self._store()
            raise

    def _store(self) -> None:
        if self._waiting is not None:
            stage, arrays = self._waiting
            write_checkpoint(_path(self.folder, stage), arrays, self.identity)
            self._written, self._waiting = self.now(), None


def open_checkpoints(folder: Path, identity: Mapping[str, Any]) -> Checkpoints:
    """Checkpoints of a folder that this process has locked.

    Parameters
    ----------
    folder : Path
    identity : mapping
        Data, configuration, seed and versions of the run, as plain values for JSON.

    Raises
    ------
    RunFolderError
        A checkpoint is damaged or was made from something else.
    """
    remove_parts(folder)
    wanted = json.loads(json.dumps(identity))
    found = {}
    for path in _paths(folder):
        arrays, made_from = read_checkpoint(path)
        remedy = (
            "Go on with what it was made from, give another --out, or delete the file to start "
            "from the beginning"
        )
        refuse_difference(made_from, wanted, what=f"{path}: is a checkpoint", remedy=remedy)
        found[path.stem.removeprefix(_PREFIX)] = arrays
    return Checkpoints(folder, wanted, found)


def has_checkpoints(folder: Path) -> bool:
    """Something is there to go on from."""
    return bool(_paths(folder))


def remove_checkpoints(folder: Path) -> None:
    """Remove them all: the run is complete."""
    for path in _paths(folder):
        path.unlink(missing_ok=True)


def remove_checkpoints_of_other_files(folder: Path, sha256: str) -> None:
    """Remove those that were made when the readings stood in another file, or in an older state.

    For a folder whose name vouches for the readings: the fit begins again instead of being refused.

    Raises
    ------
    RunFolderError
        A checkpoint is damaged.
    """
    for path in _paths(folder):
        _, made_from = read_checkpoint(path)
        if made_from.get("data") != sha256:
            path.unlink(missing_ok=True)


def _path(folder: Path, stage: str) -> Path:
    return folder / f"{_PREFIX}{stage}.npz"


def _paths(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{_PREFIX}*.npz"))
