"""Damaged files from outside are refused with an error of this package, never otherwise."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from types import ModuleType

import pytest

from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.errors import DataError, RunFolderError
from pbrdf_bayes.io import csv_table
from pbrdf_bayes.io.tidy_csv import read_samples


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz_run", Path(__file__).with_name("run.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


N_INPUTS = {
    "CSV": 300, "TOML": 500, "JSON": 500, "limits": 300, "document": 300, "scene": 300,
    "candidates": 300, "run folder": 40, "draws": 20,
}  # fmt: skip
"""The same inputs every time; python tests/fuzz/run.py tries others."""


@pytest.mark.parametrize("name", list(N_INPUTS))
def test_nothing_but_named_errors(script, name, tmp_path, request, monkeypatch):
    if name in ("run folder", "draws"):
        run = request.getfixturevalue("finished_run")
        monkeypatch.setattr(script, "finished_run", lambda: run)
    tried, crashes, hangs = script.fuzz(name, tmp_path, most=N_INPUTS[name], first=1)
    assert tried == N_INPUTS[name]
    assert crashes == []
    assert hangs == 0


@pytest.mark.parametrize("seed", [-63, 1.5, "one"])
def test_the_seed_of_a_run_is_a_whole_number(finished_run, tmp_path, seed):
    folder = Path(shutil.copytree(finished_run, tmp_path / "run"))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    (folder / "summary.json").write_text(json.dumps(summary | {"seed": seed}), encoding="utf-8")
    with pytest.raises(RunFolderError, match="seed"):
        load_analysis(folder)


def test_a_file_without_end_is_refused():
    """A device: none of it is read."""
    device = Path("/dev/zero")
    if not device.exists():
        pytest.skip("no /dev/zero here")
    with pytest.raises(DataError, match="a device or a pipe: write its content into a file"):
        read_samples(device)


def test_a_file_larger_than_allowed_is_refused(tmp_path):
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(csv_table.MAX_BYTES + 1)
    with pytest.raises(DataError, match=r"larger than 128 MiB .* Split it"):
        read_samples(tmp_path / "large.csv")


def test_too_many_rows_and_one_huge_line_are_refused(tmp_path):
    file = tmp_path / "bomb.csv"
    file.write_bytes(b"a,b\n" * (csv_table.MAX_ROWS + 1))
    with pytest.raises(DataError, match=r"3000001 lines \(allowed: up to 3000000\)"):
        read_samples(file)
    file.write_bytes(b"sample," + b"x" * 10_000_000)
    with pytest.raises(DataError, match="line 1: 10000007 bytes long"):
        read_samples(file)
