"""What is compiled once is used again, but never after a kernel has changed anywhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pbrdf_bayes.physics.compiled import kernel_sources

PACKAGE = Path(kernel_sources.__wrapped__.__code__.co_filename).parents[1]
INNER = """from pbrdf_bayes.physics.compiled import compiled

@compiled()
def inner(x):
    return {factor} * x
"""
OUTER = """from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.made_up_inner import inner

@compiled()
def outer(x):
    return inner(x) + 1.0
"""
CALL = (
    "from pbrdf_bayes.physics.made_up_outer import outer; print(outer(2.0), outer.stats.cache_hits)"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the kernels' package, with two kernels of its own in two files."""
    copy = tmp_path / "pbrdf_bayes"
    (copy / "physics").mkdir(parents=True)
    for file in ("errors.py", "physics/compiled.py"):
        shutil.copy(PACKAGE / file, copy / file)
    for folder in (copy, copy / "physics"):
        (folder / "__init__.py").write_text("")
    (copy / "physics/made_up_inner.py").write_text(INNER.format(factor="3.0"))
    (copy / "physics/made_up_outer.py").write_text(OUTER)
    return copy


def call(package: Path) -> str:
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(package.parent)
    done = subprocess.run(
        [sys.executable, "-c", CALL], cwd=package.parent, env=environment,
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    return done.stdout.strip()


def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(package: Path) -> None:
    assert call(package) == "7.0 Counter()"
    assert call(package).startswith("7.0 Counter({")
    (package / "physics/made_up_inner.py").write_text(INNER.format(factor="5.0"))
    assert call(package) == "11.0 Counter()"


def test_the_hash_covers_kernels_only(package: Path) -> None:
    before = kernel_sources(package)
    (package / "no_kernel.py").write_text("x = 1")
    kernel_sources.cache_clear()
    assert kernel_sources(package) == before
    (package / "kernel.py").write_text("@compiled()\ndef f(x):\n    return x\n")
    kernel_sources.cache_clear()
    assert kernel_sources(package) != before
