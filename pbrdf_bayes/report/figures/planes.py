"""Scan planes: curves and readings grouped by incidence angle and azimuth, and their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import Curve, ScanPoints
from pbrdf_bayes.report.figures.axes import limits, positive
from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.numbers import MISSING, count, degrees, dex_as_percent, number, percent

Array = NDArray[np.float64]
T = TypeVar("T")

MOST_PLANES = 24
"""Scan planes, or scans, drawn at most: the worst-fitting ones."""
DECADES = 5.0
"""Depth of the logarithmic axis below which only readings go; an exact null has none."""


@dataclass(frozen=True, eq=False)
class Strand:
    """One polarisation of a scan plane: its predicted curve, if any, and its readings."""

    polarization: str
    curve: Curve | None
    scans: tuple[ScanPoints, ...]

    @property
    def residual_dex(self) -> Array:
        """Finite residuals of all readings [dex]."""
        return _finite([s.residual_dex for s in self.scans])

    @property
    def values(self) -> Array:
        """All finite readings [sr^-1]."""
        return _finite([s.value for s in self.scans])


@dataclass(frozen=True, eq=False)
class Plane:
    """All that is drawn of one scan plane."""

    theta_i_deg: float
    phi_r_deg: float
    strands: tuple[Strand, ...]

    @property
    def title(self) -> Markup:
        """Angles of the plane, typeset."""
        title = Markup("θ<sub>i</sub> = {}").format(degrees(self.theta_i_deg))
        azimuth = Markup(", φ<sub>r</sub> = {}").format(degrees(self.phi_r_deg))
        return title + azimuth if self.phi_r_deg else title

    @property
    def words(self) -> str:
        """Angles of the plane, for reading aloud."""
        azimuth = f", azimuth {degrees(self.phi_r_deg)}" if self.phi_r_deg else ""
        return f"{degrees(self.theta_i_deg)} incidence{azimuth}"

    @property
    def specular_deg(self) -> float | None:
        """Signed scattering angle of the specular direction; None where the plane misses it."""
        if self.theta_i_deg and self.phi_r_deg % 180:
            return None
        return self.theta_i_deg if self.phi_r_deg % 360 == 0 else -self.theta_i_deg

    @property
    def rms_dex(self) -> float:
        """Residual rms of all readings of the plane [dex]; NaN where there are none."""
        return rms(np.concatenate([s.residual_dex for s in self.strands]))


def _finite(parts: Sequence[Array]) -> Array:
    joined = np.concatenate([np.zeros(0), *parts])
    return np.asarray(joined[np.isfinite(joined)])


def rms(values: Array) -> float:
    """Root of the mean square of the finite values; NaN where there are none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")


def planes_of(curves: Sequence[Curve], scans: Sequence[ScanPoints]) -> list[Plane]:
    """Group curves and scans by incidence angle, azimuth and polarisation."""
    angles = {(c.theta_i_deg, c.phi_r_deg) for c in curves}
    angles |= {(s.theta_i_deg, s.phi_r_deg) for s in scans}
    return [Plane(*key, strands=_strands(key, curves, scans)) for key in sorted(angles)]


def _strands(
    key: tuple[float, float], curves: Sequence[Curve], scans: Sequence[ScanPoints]
) -> tuple[Strand, ...]:
    found = []
    for q in LOOKS:
        mine = [c for c in curves if (c.theta_i_deg, c.phi_r_deg, c.polarization) == (*key, q)]
        read = tuple(s for s in scans if (s.theta_i_deg, s.phi_r_deg, s.polarization) == (*key, q))
        if mine or read:
            found.append(Strand(q, mine[0] if mine else None, read))
    return tuple(found)


def worst(records: Sequence[T], rms_dex: Sequence[float]) -> list[T]:
    """Return at most `MOST_PLANES`, those with the largest residuals, in their order."""
    order = np.argsort(-np.nan_to_num(rms_dex), kind="stable")[:MOST_PLANES]
    return [records[i] for i in sorted(order.tolist())]


def brdf_limits(planes: Sequence[Plane]) -> tuple[float, float]:
    """Limits of the logarithmic axis that all panels share [sr^-1]."""
    strands = [s for p in planes for s in p.strands]
    predicted = [np.log10(positive(s.curve.predictive_band[:, [0, 4]]))
                 for s in strands if s.curve is not None]  # fmt: skip
    measured = [np.log10(positive(s.values)) for s in strands]
    low, high = limits(*predicted, *measured, pad=0.04, least=0.6)
    lowest = np.nanmin([high, *np.concatenate([np.zeros(0), *measured])]) - 0.1
    low = max(low, min(high - DECADES, float(lowest)), high - 2 * DECADES)
    return 10.0**low, 10.0**high


def dex_reach(strands: Sequence[Strand]) -> float:
    """Half height of the axis of deviations [dex] that all panels share: nearly all there is."""
    tops = [0.004]
    for strand in strands:
        if strand.residual_dex.size:
            tops.append(float(np.quantile(np.abs(strand.residual_dex), 0.995)))
        if strand.curve is not None:
            edges = deviations(strand.curve.predictive_band, strand.curve)
            known = np.abs(edges[np.isfinite(edges)])
            tops += [float(np.quantile(known, 0.9))] if known.size else []
    return min(1.15 * max(tops), 3.0)


def deviations(band: Array, curve: Curve) -> Array:
    """Band of a curve relative to its middle line [dex]."""
    return np.asarray(np.log10(positive(band)) - np.log10(positive(curve.map))[:, None])


def half_width(band: Array) -> str:
    """Median over angle of half the width of the 90 % interval, relative to the median curve."""
    good = band[(band[:, 2] > 0) & np.isfinite(band).all(axis=1)]
    relative = (good[:, 4] - good[:, 0]) / (2 * good[:, 2])
    return percent(np.median(relative)) if relative.size else MISSING


def fit_note(strand: Strand) -> str:
    """Numbers under a panel: residuals and typical half widths of the two bands."""
    parts = [f"rms {dex_as_percent(rms(strand.residual_dex))}"] if strand.residual_dex.size else []
    if strand.curve is not None and strand.curve.model_band is not None:
        parts.append(f"model ±{half_width(strand.curve.model_band)}")
    if strand.curve is not None:
        parts.append(f"predictive ±{half_width(strand.curve.predictive_band)}")
    return " · ".join(parts)


def held_out_note(strand: Strand) -> str:
    """Share of the readings inside the predictive band, and the width of the band."""
    curve = strand.curve
    if curve is None or not strand.scans:
        return ""
    value, band = strand.scans[0].value, curve.predictive_band
    known = np.isfinite(value)
    inside = (value >= band[:, 0]) & (value <= band[:, 4])
    share = percent(np.mean(inside[known]), digits=2) if known.any() else MISSING
    return f"{share} of {count(known.sum())} inside · band ±{half_width(band)}"


def label_of(plane: Plane, what: str) -> str:
    """Text alternative of a scan plane, in numbers."""
    return f"{what} at {plane.words}; " + "; ".join(_strand_label(s) for s in plane.strands)


def _strand_label(strand: Strand) -> str:
    curve, said = strand.curve, []
    if strand.scans:
        said.append(f"measured {span(strand.values)} per sr")
    elif curve is not None:
        said.append(f"predicted {span(curve.map)} per sr")
    if curve is not None and curve.model_band is not None:
        said.append(f"90 % model band ±{half_width(curve.model_band)}")
    if curve is not None:
        said.append(f"90 % predictive band ±{half_width(curve.predictive_band)}")
    return f"{LOOKS[strand.polarization].word}: {', '.join(said)}"


def span(values: Array) -> str:
    """Lowest and highest finite value."""
    good = values[np.isfinite(values)]
    return f"{number(good.min())} to {number(good.max())}" if good.size else "no value"
