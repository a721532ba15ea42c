"""Fixtures used across the suite."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.io.print_pdf import BROWSERS
from pbrdf_bayes.workflow.compile_ahead import WITH_EFFECTS, compile_ahead
from pbrdf_bayes.workflow.fitting import fit_file
from tests.laws import green, make_law, make_measurement, small, small_posterior

__all__ = ["green", "make_law", "make_measurement", "small", "small_posterior"]

collect_ignore = ["reference/generate_shaped.py"]  # a script: imports the one beside it

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session", autouse=True)
def _kernels_on_disk() -> None:
    """Every worker loads the kernels of a fit; one of them has them compiled."""
    compile_ahead("iid")
    compile_ahead("correlated")
    compile_ahead("iid" + WITH_EFFECTS)


@pytest.fixture
def signals_as_before() -> Iterator[None]:
    """`main` takes SIGTERM over for its process, which here is the test's."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def make_of() -> Callable[[str], ModuleType]:
    """The script ``make.py`` of a folder of reports/, as a module."""

    def load(folder: str) -> ModuleType:
        path = REPOSITORY / "reports" / folder / "make.py"
        spec = importlib.util.spec_from_file_location(f"{folder}_make", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # its dataclasses look for it there
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measured data made by others, kept outside the repository."""
    folder = REPOSITORY / ".." / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"measured data are not here: {folder.resolve()}")
    return folder


@pytest.fixture(scope="session")
def small_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated green paint: two angles, s and p, 33 readings a scan, DHR; never changed."""
    path = tmp_path_factory.mktemp("data") / "small_simulated.csv"
    measurement = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=3, sample="small", theta_i_deg=(20.0, 60.0),
        theta_r_deg=np.linspace(-80.0, 80.0, 33),
    )  # fmt: skip
    pb.write_tidy_csv(measurement, path)
    return path


@pytest.fixture(scope="session")
def finished_run(small_csv: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of a draft fit of it with seed 1; never changed: copy it first."""
    folder = tmp_path_factory.mktemp("runs") / "finished"
    fit_file(small_csv, pb.RunConfig(accuracy="draft"), out=folder, seed=1)
    return folder


def find_browser() -> str | None:
    """Path of an installed Chromium, or None."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = find_browser()
    if path is None:
        pytest.skip(f"no browser found: looked for {', '.join(BROWSERS)}")
    as_root = hasattr(os, "geteuid") and os.geteuid() == 0
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox"] if as_root else []
        )
        yield chromium
        chromium.close()
