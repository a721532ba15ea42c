"""The stored pages are what today's templates make of the stored numbers."""

from __future__ import annotations

import re
from pathlib import Path
from runpy import run_path

import pytest

pytestmark = pytest.mark.slow

REPORTS = Path(__file__).parents[2] / "reports"
SCRIPT = run_path(str(REPORTS / "render.py"))
REBUILT = {"published_paint"}  # computed anew by its own test


@pytest.mark.parametrize("numbers", SCRIPT["PAGES"])
def test_a_page_is_that_of_its_numbers(numbers: str) -> None:
    path, text = SCRIPT["rendered"](numbers)
    page = path.read_text(encoding="utf-8")
    assert page == text, f"{path.name} of {numbers}: run python reports/render.py"
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(ids) == len(set(ids)), "a picture would show parts of another"
    assert re.findall(r"<(?:link|script|img)[^>]*(?:src|href)=\"(?!data:)[^\"]*\"", page) == []


def test_no_page_is_left_out() -> None:
    ignored = (REPORTS.parent / ".gitignore").read_text(encoding="utf-8")
    stored = set(re.findall(r"^!reports/(\w+)/$", ignored, flags=re.MULTILINE))
    pages = {folder for folder in stored if (REPORTS / folder / "index.html").exists()}
    assert pages == REBUILT | {Path(numbers).parent.name for numbers in SCRIPT["PAGES"]}
