"""Files that texts name are there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "reports/README.md", "Makefile")
SOURCES = sorted([*(ROOT / "pbrdf_bayes").rglob("*.py"), *(ROOT / "reports").rglob("*.py")])
PATH = re.compile(r"(?<![\w./-])(?:tests|reports|notebooks)/[\w./<>*-]*")
TEST = re.compile(r"(?<![\w./-])test_\w+\.py")
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
"""Commands of an example, whose run folders a user makes."""


def missing(text: str) -> list[str]:
    """Paths of this repository in a text, and names of tests without a folder, that are not there.

    What has < or * in it stands for many.
    """
    examples = " ".join(FENCED.findall(text))
    named = {*PATH.findall(FENCED.sub("", text)), *re.findall(r"(?:tests|notebooks)/\S+", examples)}
    plain = {path.rstrip(".") for path in named if not set("<*") & set(path)}
    found = [path for path in plain if not (ROOT / path).exists()]
    found += [name for name in set(TEST.findall(text)) if not any(ROOT.glob(f"tests/**/{name}"))]
    return sorted(found)


def docstrings(path: Path) -> Iterator[str]:
    """Docstrings of a module, and strings that stand alone below a constant."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield str(node.value.value)


@pytest.mark.parametrize("name", PAGES)
def test_pages_name_files_that_exist(name: str) -> None:
    assert missing((ROOT / name).read_text(encoding="utf-8")) == []


def test_docstrings_name_files_that_exist() -> None:
    wrong = {
        str(path.relative_to(ROOT)): absent
        for path in SOURCES
        if (absent := missing("\n\n".join(docstrings(path))))
    }
    assert wrong == {}


def test_notebooks_name_notebooks_and_tests_that_exist() -> None:
    """Their run folders are made as they run."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        absent = missing(path.read_text(encoding="utf-8"))
        assert [name for name in absent if not name.startswith("reports/")] == [], path.name


def test_an_absent_file_is_found() -> None:
    text = (
        "``tests/test_reciprocity.py``, reports/gone/index.html, notebooks/99_x.ipynb; test_gone.py\n"
        "```\nfit --out reports/green/first\n```\n"
        "tests/conftest.py, reports/<sample>/<time>, (notebooks/01_quickstart.ipynb)."
    )
    assert missing(text) == [
        "notebooks/99_x.ipynb", "reports/gone/index.html", "test_gone.py",
        "tests/test_reciprocity.py",
    ]  # fmt: skip
