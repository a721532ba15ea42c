"""What the form of the model itself says: widths of the lobes, and reciprocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import Any

from pbrdf_bayes.quantities import STATES
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


@dataclass(frozen=True)
class Factor:
    """A cell of the table of factors: median, 90 % interval, background."""

    text: str
    interval: str
    background: str


_EMPTY = Factor(MISSING, "", DIAGONAL[1])


def reciprocity_rows(summary: Record) -> list[tuple[str, list[Factor]]]:
    """Angle and cells: s below the diagonal and p above it, or unpolarised light below it alone.

    Every cell is f(a -> b) / f(b -> a) with a the smaller angle of the two.
    """
    found = summary.get("reciprocity")
    if not found:
        return []
    angles = found["theta_deg"]
    below = "u" if "u" in found["factors"] else "s"

    def cell(i: int, j: int) -> Factor:
        q, a, b = (below, j, i) if j < i else ("p", i, j)
        if i == j or q not in found["factors"]:
            return _EMPTY if i == j else replace(_EMPTY, text="", background="none")
        return _factor(found, q, a, b)

    indices = range(len(angles))
    return [(degrees(angles[i]), [cell(i, j) for j in indices]) for i in indices]


def _factor(found: Record, q: str, a: int, b: int) -> Factor:
    x = finite(found["factors"][q][a][b])
    if x is None or x <= 0.0:
        return _EMPTY
    ends = [_ratio(found[level][q][a][b]) for level in ("q05", "q95") if level in found]
    return Factor(_ratio(x), "–".join(ends), background(log(x) / _FULL))


def _ratio(value: Any) -> str:
    x = finite(value)
    return fixed(x, 2) if x is not None and 0.1 <= x < 100.0 else number(x, digits=2)


def reciprocity_caption(summary: Record) -> str:
    """What the table shows."""
    found = summary.get("reciprocity") or {}
    where = (
        f"median over {found['n_draws']} draws of the posterior, and their 90 % interval"
        if "n_draws" in found
        else "at the MAP"
    )
    states = (
        "unpolarised light, as measured"
        if "u" in found.get("factors", {})
        else "s below the diagonal, p above it"
    )
    return (
        "BRDF from the smaller angle to the larger one, over that of the way back, both on the "
        f"forward side: {states}; {where}. 1 is reciprocal; blue is above, orange below."
    )


def reciprocity_text(summary: Record) -> str:
    """What the defect means and the largest one within the measured angles."""
    if "reciprocity" not in summary:
        return ""
    if not summary["reciprocity"]:
        return "Reciprocity is not shown: the surface reflects totally at some angles."
    largest = summary["reciprocity"]["largest"]
    if not largest:
        within = "No pair of angles was measured in the plane of incidence."
    else:
        a, b = degrees(largest["theta_a_deg"]), degrees(largest["theta_b_deg"])
        within = (
            f"Within the measured angles the factor between the two ways is at most "
            f"{number(largest['factor'])} ({STATES[largest['polarization']].label}, from {a} to {b}"
            + (
                f"; 90 % interval {number(largest['q05'])} to {number(largest['q95'])})."
                if "q05" in largest
                else ")."
            )
        )
    extended = bool(summary["effects"]) or summary["line_shape"] != "lorentzian"
    counted = "; line shape and effects of the sample are counted in" if extended else ""
    return (
        "A surface scatters as much light from a to b as from b to a (in plane, s or p kept; their "
        "mean as well). "
        "The normalisation of Eq. (4) gives every angle of incidence its DHR and does not keep to "
        f"that{counted}. {within} "
        "Readings do not show it where light went one way only; whoever reverses light paths with "
        "this model makes that error."
    )
