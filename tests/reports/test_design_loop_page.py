"""The committed closed loop of the design: complete, in agreement, and made of its numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from tools.validation.design_loop import CANDIDATES, PAINTS
from tools.validation.loop_page import errors_off

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[2] / "reports" / "design_loop"


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / "design_loop.json").read_text(encoding="utf-8"))
    return found


def test_every_paint_and_candidate_is_there(stored: dict[str, Any]) -> None:
    assert len(PAINTS) >= 5
    assert len(CANDIDATES) >= 6
    found = {(row["paint"], row["candidate"]) for row in stored["candidates"]}
    assert found == {(paint, c.label) for paint in PAINTS for c in CANDIDATES}
    assert {(g["paint"], g["grid"]) for g in stored["grids"]} == {
        (paint, grid) for paint in PAINTS for grid in ("chosen", "uniform", "random")
    }


def test_what_was_promised_was_realised(stored: dict[str, Any]) -> None:
    """The sum of squares is that of standard normal errors, one in a thousand times exceeded."""
    off = np.array([errors_off(row) for row in stored["candidates"]])
    assert np.sum(off**2) < chi2.ppf(0.999, off.size)


def test_chosen_scans_beat_the_others_in_the_same_minutes(stored: dict[str, Any]) -> None:
    rows = {(g["paint"], g["grid"]): g for g in stored["grids"]}
    for paint in PAINTS:
        chosen = rows[paint, "chosen"]
        for grid in ("uniform", "random"):
            other = rows[paint, grid]
            assert chosen["minutes"] == other["minutes"]
            error = np.hypot(chosen["realised_se"], other["realised_se"])
            assert chosen["realised"] - other["realised"] > 2.0 * error, (paint, grid)


def test_what_a_batch_promises_is_realised(stored: dict[str, Any]) -> None:
    for row in stored["grids"]:
        if row["grid"] == "chosen":
            error = np.hypot(row["realised_se"], row["promised_se"])
            assert abs(row["realised"] - row["promised"]) < 3.5 * error, row["paint"]
