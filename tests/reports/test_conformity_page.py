"""The committed example of conformity: complete, and what its script makes today."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "reports" / "conformity"
VERDICTS = {"paint_a": "ACCEPT", "paint_b": "REJECT", "paint_c": "UNDECIDED"}

pytestmark = pytest.mark.usefixtures("signals_as_before")


@pytest.fixture(scope="module")
def make(make_of: Callable[[str], ModuleType]) -> ModuleType:
    return make_of("conformity")


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / "conformity.json").read_text(encoding="utf-8"))
    return found


def test_one_paint_of_each_verdict(stored: dict[str, Any]) -> None:
    assert {paint: found["verdict"] for paint, found in stored.items()} == VERDICTS


def test_a_paint_comes_out_the_same(
    make: ModuleType, stored: dict[str, Any], tmp_path: Path
) -> None:
    """Within the Monte Carlo error of about 2000 effective draws."""
    now, then = make.judge("paint_c", tmp_path), stored["paint_c"]
    assert now["verdict"] == then["verdict"]
    assert now["probability"]["value"] == pytest.approx(then["probability"]["value"], abs=0.06)
    for a, b in zip(now["limits"], then["limits"], strict=True):
        assert a["verdict"] == b["verdict"]
        assert a["mean"] == pytest.approx(b["mean"], abs=0.15 * max(b["u"]))
        assert a["u"] == pytest.approx(b["u"], rel=0.1)


def test_the_page_prints_the_risks_taken(stored: dict[str, Any]) -> None:
    """With no draw against the decision, what the risk is at most: 3.7 draws of the effective ones."""
    page = (FOLDER / "index.html").read_text(encoding="utf-8")
    sections = page.split("<section>")[1:]
    whose = {"ACCEPT": "consumer", "REJECT": "producer"}
    for section, found in zip(sections, stored.values(), strict=True):
        said = re.findall(r"Specific (\w+)'s risk: below ([0-9.]+)", section)
        if found["verdict"] == "UNDECIDED":
            assert said == []
            continue
        ((who, most),) = said
        assert who == whose[found["verdict"]]
        assert float(most) / 100.0 == pytest.approx(3.69 / found["probability"]["ess"], rel=0.03)


def test_the_page_shows_where_the_readings_do_not_decide(stored: dict[str, Any]) -> None:
    """A picture relative to the limit, tall enough for the band, on both sides of it for one paint."""
    page = (FOLDER / "index.html").read_text(encoding="utf-8")
    said = re.findall(r"relative to the limit: \S+ %, 95 % from (\S+) to (\S+) % at", page)
    ends = [(float(low), float(high)) for low, high in said]
    curves = [limit for found in stored.values() for limit in found["limits"][1:]]
    for (low, high), limit in zip(ends, curves, strict=True):
        at = limit["worst"]
        assert low == pytest.approx(100.0 * (limit["q025"][at] / limit["upper"] - 1.0), abs=0.06)
        assert high == pytest.approx(100.0 * (limit["q975"][at] / limit["upper"] - 1.0), abs=0.06)
        assert (low < 0.0 < high) == (limit["verdict"] == "UNDECIDED")
