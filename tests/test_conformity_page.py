"""The committed example of conformity: complete, and what its script makes today."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "reports" / "conformity"
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
