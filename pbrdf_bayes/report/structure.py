"""What the form of the model itself says: widths of the lobes, and reciprocity."""

from __future__ import annotations

from collections.abc import Mapping
from math import log
from typing import Any

from pbrdf_bayes.report.numbers import MISSING, degrees, finite, fixed, number, rounded
from pbrdf_bayes.report.tables import DIAGONAL, background

Record = Mapping[str, Any]
_FULL = log(4.0)


def widths_text(summary: Record) -> str:
    """How widths of single scans compare with Eq. (5); nothing without scans."""
    scans = summary.get("scan_widths")
    if not scans:
        return ""
    known = [s for s in scans if finite(s["rho"]) is not None]
    words = (
        "Each scan with the ρ_0 and the scale that fit it best, all other parameters held at the "
        "MAP. "
    )
    if "narrowing" in summary["effects"]:
        words += "Eq. (5) is meant with the exponent g of the fit. "
    if not known:
        return f"{words}No scan has a width inside the model's domain."
    away = [abs(s["rho"] - s["rho_model"]) / s["u_rho"] for s in known]
    farthest = known[away.index(max(away))]
    ratio = rounded(
        farthest["rho"] / farthest["rho_model"], farthest["u_rho"] / farthest["rho_model"]
    )
    missing = len(scans) - len(known)
    return (
        f"{words}{sum(a <= 2.0 for a in away)} of {len(known)} widths lie within two standard "
        f"errors of Eq. (5); the farthest is that of scan {farthest['label']}, {ratio.value} ± "
        f"{ratio.uncertainty} times Eq. (5)"
        + (f"; without a width inside the model's domain: {missing}" * bool(missing))
        + ". Points that turn away from the curve towards grazing say that the lobes of this "
        "sample narrow otherwise than Eq. (5) has it."
    )


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
