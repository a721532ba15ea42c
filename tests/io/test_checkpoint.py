"""Checkpoints on disk: whole or not at all, every changed byte noticed, stored often enough."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io.checkpoint import (
    Checkpoints,
    has_checkpoints,
    open_checkpoints,
    read_checkpoint,
    remove_checkpoints,
    write_checkpoint,
)

IDENTITY = {"data": "abc", "seed": 1, "priors": {"n": {"sd": 0.1}}, "effects": []}


def arrays(size: int = 50) -> dict[str, Any]:
    rng = np.random.default_rng(size)
    return {
        "z": rng.normal(size=(2, size)), "keys": rng.integers(0, 2**32, 624, dtype=np.uint32),
        "flag": np.asarray(True), "quick.k_hat": np.asarray(np.inf),
        "empty": np.empty((0, 3)),
    }  # fmt: skip


def test_it_reads_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint_sample.npz"
    write_checkpoint(path, arrays(), IDENTITY)
    found, identity = read_checkpoint(path)
    assert identity == IDENTITY
    assert list(found) == list(arrays())
    for name, value in arrays().items():
        np.testing.assert_array_equal(found[name], value, strict=True)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_others_can_read_it_and_it_is_no_pickle(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint_sample.npz"
    write_checkpoint(path, arrays(), IDENTITY)
    with np.load(path, allow_pickle=False) as file:
        np.testing.assert_array_equal(file["z"], arrays()["z"])


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("stored") / "checkpoint_sample.npz"
    write_checkpoint(path, arrays(), IDENTITY)
    return path.read_bytes()


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_every_flipped_bit_and_every_cut_is_noticed(
    data: st.DataObject, stored: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = data.draw(st.integers(0, len(stored) - 1))
    flipped = bytearray(stored)
    flipped[place] ^= 1 << data.draw(st.integers(0, 7))
    path = tmp_path_factory.getbasetemp() / "checkpoint_sample.npz"
    for damaged in (flipped, stored[:place], stored + b"\0"):
        path.write_bytes(damaged)
        with pytest.raises(RunFolderError, match=r"checkpoint_sample\.npz.*damaged.*Delete this"):
            read_checkpoint(path)


def test_what_differs_is_refused_by_name(tmp_path: Path) -> None:
    checkpoints = open_checkpoints(tmp_path, IDENTITY)
    assert checkpoints.found == {}
    checkpoints.keep("sample", arrays())
    assert list(open_checkpoints(tmp_path, IDENTITY).found) == ["sample"]
    with pytest.raises(RunFolderError, match="is a checkpoint of something else") as caught:
        open_checkpoints(tmp_path, IDENTITY | {"seed": 2, "priors": {}, "new": True})
    assert str(caught.value).splitlines()[1:-1] == [
        "  seed: 1 there, 2 now", "  priors: {'n': {'sd': 0.1}} there, {} now",
        "  new: None there, True now",
    ]  # fmt: skip


class Clock:
    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


def test_a_state_handed_over_every_second_is_stored_within_ten(tmp_path: Path) -> None:
    clock = Clock()
    checkpoints = Checkpoints(tmp_path, IDENTITY, {}, now=clock)
    stored, ages = -1, []
    for step in range(60):
        clock.seconds += 1.0
        checkpoints.keep("sample", {"z": np.array([step])})
        now = int(read_checkpoint(tmp_path / "checkpoint_sample.npz")[0]["z"][0])
        ages.append(step - now)
        stored = max(stored, now)
    assert max(ages) < 10
    assert stored < 59  # and not at every hand-over
    checkpoints.keep("sample", {"z": np.array([60])}, at_once=True)
    assert read_checkpoint(tmp_path / "checkpoint_sample.npz")[0]["z"][0] == 60


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_the_last_state_is_stored_when_the_run_is_interrupted(
    error: type[BaseException], tmp_path: Path
) -> None:
    checkpoints = Checkpoints(tmp_path, IDENTITY, {}, now=Clock())
    for step in (1, 2):
        checkpoints.keep("sample", {"z": np.array([step])})
    with pytest.raises(error), checkpoints.kept_when_interrupted():
        raise error
    assert read_checkpoint(tmp_path / "checkpoint_sample.npz")[0]["z"][0] == 2


def test_each_stage_has_its_own_and_all_are_removed(tmp_path: Path) -> None:
    checkpoints = open_checkpoints(tmp_path, IDENTITY)
    (tmp_path / "other.npz").write_bytes(b"mine")
    assert not has_checkpoints(tmp_path)
    checkpoints.keep("sample", arrays(3), at_once=True)
    checkpoints.keep("holdout", arrays(4), at_once=True)
    assert set(open_checkpoints(tmp_path, IDENTITY).found) == {"sample", "holdout"}
    assert has_checkpoints(tmp_path)
    remove_checkpoints(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["other.npz"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("needs root to mount a small file system")
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_leaves_the_last_checkpoint(small_disk: Path) -> None:
    path = small_disk / "checkpoint_sample.npz"
    write_checkpoint(path, arrays(), IDENTITY)
    before = path.read_bytes()
    with pytest.raises(RunFolderError, match=r"sample\.npz: cannot be written \(No space left"):
        write_checkpoint(path, arrays(10_000), IDENTITY)
    assert path.read_bytes() == before
    assert [p.name for p in small_disk.iterdir()] == [path.name]
    read_checkpoint(path)
