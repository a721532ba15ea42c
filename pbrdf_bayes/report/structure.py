"""What the form of the model itself says: reciprocity."""

from __future__ import annotations

from collections.abc import Mapping
from math import log
from typing import Any

from pbrdf_bayes.report.numbers import MISSING, degrees, finite, fixed, number
from pbrdf_bayes.report.tables import DIAGONAL, background

Record = Mapping[str, Any]
_FULL = log(4.0)


def reciprocity_rows(summary: Record) -> list[tuple[str, list[tuple[str, str]]]]:
    """Angle, and text and background of each cell: s below the diagonal, p above it.

    Every cell is f(a -> b) / f(b -> a) with a the smaller angle of the two.
    """
    found = summary.get("reciprocity")
    if not found:
        return []
    angles, factors = found["theta_deg"], found["factors"]
    return [
        (
            degrees(angle),
            [
                _factor(factors["s"][j][i]) if j < i else _factor(factors["p"][i][j])
                if j > i else (MISSING, DIAGONAL[1])
                for j in range(len(angles))
            ],
        )
        for i, angle in enumerate(angles)
    ]  # fmt: skip


def _factor(value: Any) -> tuple[str, str]:
    x = finite(value)
    if x is None or x <= 0.0:
        return MISSING, DIAGONAL[1]
    text = fixed(x, 2) if 0.1 <= x < 100.0 else number(x, digits=2)
    return text, background(log(x) / _FULL)


def reciprocity_text(summary: Record) -> str:
    """What the defect means and the largest one within the measured angles."""
    if "reciprocity" not in summary:
        return ""
    if not summary["reciprocity"]:
        return "Reciprocity is not shown: at the MAP the surface reflects totally at some angles."
    largest = summary["reciprocity"]["largest"]
    if not largest:
        within = "No pair of angles was measured in the plane of incidence."
    else:
        a, b = degrees(largest["theta_a_deg"]), degrees(largest["theta_b_deg"])
        within = (
            f"Within the measured angles the factor between the two ways is at most "
            f"{number(largest['factor'])} ({largest['polarization']}, from {a} to {b})."
        )
    extended = bool(summary["effects"]) or summary["line_shape"] != "lorentzian"
    counted = "; line shape and effects of the sample are counted in" if extended else ""
    return (
        "A surface scatters as much light from a to b as from b to a (in plane, s or p kept). "
        "The normalisation of Eq. (4) gives every angle of incidence its DHR and does not keep to "
        f"that{counted}. {within} "
        "Readings do not show it where light went one way only; whoever reverses light paths with "
        "this model makes that error."
    )
