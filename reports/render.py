"""Render the stored pages anew from their stored numbers, as after a change of style or words.

Nothing is measured or simulated::

    python reports/render.py
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from typing import Any

from pbrdf_bayes.bench.page import render_page as render_bench
from tools.validation.loop_page import render_loop
from tools.validation.page import render_page as render_studies

HERE = Path(__file__).parent


def _of(folder: str) -> Callable[[dict[str, Any]], str]:
    """Writer of the page of a folder with a ``make.py`` of its own."""
    page: Callable[[dict[str, Any]], str] = run_path(str(HERE / folder / "make.py"))["page"]
    return page


PAGES: dict[str, Callable[[dict[str, Any]], str]] = {
    "accuracy_vs_time/bench.json": render_bench,
    "calibration/calibration.json": render_studies,
    "conformity/conformity.json": _of("conformity"),
    "ddr/ddr.json": _of("ddr"),
    "design_loop/design_loop.json": render_loop,
    "fresnel_at/fresnel_at.json": _of("fresnel_at"),
    "mitsuba/mitsuba.json": _of("mitsuba"),
    "samplers/samplers.json": _of("samplers"),
}


def rendered(numbers: str) -> tuple[Path, str]:
    """The page's path and the text that the stored numbers and today's templates give."""
    stored = HERE / numbers
    return stored.with_name("index.html"), PAGES[numbers](
        json.loads(stored.read_text(encoding="utf-8"))
    )


if __name__ == "__main__":
    for numbers in PAGES:
        path, text = rendered(numbers)
        path.write_text(text, encoding="utf-8")
