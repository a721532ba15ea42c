"""BRDF against scattering angle: readings, model bands and predictive bands of each scan plane."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import Curve, HeldOut, ScanPoints
from pbrdf_bayes.report.numbers import MISSING, THIN, degrees, dex_as_percent, number, percent
from pbrdf_bayes.report.panel import (
    FAINT,
    INK,
    LOOKS,
    MUTED,
    Panel,
    limits,
    linear_ticks,
    log10_or_gap,
    log_ticks,
    new_figure,
    theta_ticks,
)
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]
Plane = tuple[float, float]

WIDTH, HEIGHT = 344.0, 236.0
MOST_PLANES = 24
"""Scan planes drawn at most, the worst-fitting ones."""
MOST_POINTS = 161
"""Readings of a scan drawn at most."""
DECADES = 5.0
"""Depth of the logarithmic axis at most; an exact Brewster null has none."""
BANDS = ((0, 4, 0.20), (1, 3, 0.32))
"""Indices of the quantiles of the 90 and the 50 % interval, and their opacity."""


@dataclass(frozen=True)
class Picture:
    """A plot with its heading and the numbers under it, each with its polarisation or none."""

    svg: Markup
    title: str
    notes: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class PlaneData:
    """All that is drawn in the panel of one scan plane."""

    theta_i_deg: float
    phi_r_deg: float
    curves: tuple[Curve, ...]
    scans: tuple[ScanPoints, ...]

    @property
    def title(self) -> str:
        """``θᵢ = 20°`` and the azimuth where it is not the plane of incidence."""
        return plane_title(self.theta_i_deg, self.phi_r_deg)

    @property
    def rms_dex(self) -> float:
        """Residual rms of all readings of the plane [dex]; NaN where there are none."""
        parts = [s.residual_dex for s in self.scans]
        joined = np.concatenate(parts) if parts else np.zeros(0)
        good = joined[np.isfinite(joined)]
        return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")


def plane_title(theta_i_deg: float, phi_r_deg: float) -> str:
    """Name a scan plane by its angles."""
    title = f"θᵢ = {degrees(theta_i_deg)}"
    return f"{title}, φᵣ = {degrees(phi_r_deg)}" if phi_r_deg else title


def planes_of(curves: Sequence[Curve], scans: Sequence[ScanPoints]) -> list[PlaneData]:
    """Group curves and scans by incidence angle and azimuth."""
    keys: Iterable[Plane] = dict.fromkeys((c.theta_i_deg, c.phi_r_deg) for c in [*scans, *curves])
    return [
        PlaneData(
            *key,
            curves=tuple(c for c in curves if (c.theta_i_deg, c.phi_r_deg) == key),
            scans=tuple(s for s in scans if (s.theta_i_deg, s.phi_r_deg) == key),
        )
        for key in sorted(keys)
    ]


def worst_planes(planes: Sequence[PlaneData]) -> list[PlaneData]:
    """Return at most `MOST_PLANES`, those with the largest residuals, in their order."""
    if len(planes) <= MOST_PLANES:
        return list(planes)
    rms = np.nan_to_num([p.rms_dex for p in planes])
    return [planes[i] for i in sorted(np.argsort(-rms, kind="stable")[:MOST_PLANES].tolist())]


def log_limits(planes: Sequence[PlaneData]) -> tuple[float, float]:
    """Limits of the logarithmic axis that all panels share."""
    inside = [np.abs(c.theta_r_deg) <= 85 for p in planes for c in p.curves]
    curves = [c for p in planes for c in p.curves]
    values = [log10_or_gap(c.model_band[rows][:, [0, 4]]) for c, rows in zip(curves, inside, strict=True)]
    values += [log10_or_gap(s.value) for p in planes for s in p.scans]
    low, high = limits(*values, pad=0.04, least=0.6)
    return max(low, high - DECADES), high


def plane_pictures(planes: Sequence[PlaneData], *, name: str) -> list[Picture]:
    """Return one panel per scan plane, all on the same axes."""
    y = log_limits(planes)
    return [_plane_picture(plane, y, f"{name}{i}") for i, plane in enumerate(planes)]


def held_out_pictures(held_out: Sequence[HeldOut], curves: Sequence[Curve]) -> list[Picture]:
    """Readings that were left out in the predictive band made without them."""
    depth = [log10_or_gap(h.value) for h in held_out] + [log10_or_gap(h.band[:, [0, 4]]) for h in held_out]
    low, high = limits(*depth, pad=0.04, least=0.6)
    y = (max(low, high - DECADES), high)
    planes = sorted({(h.theta_i_deg, h.phi_r_deg) for h in held_out})
    return [
        _held_out_picture([h for h in held_out if (h.theta_i_deg, h.phi_r_deg) == p], y, f"held{i}")
        for i, p in enumerate(planes[:MOST_PLANES])
        if curves is not None
    ]


def key_picture(planes: Sequence[PlaneData]) -> tuple[Picture, PlaneData]:
    """Draw the worst-fitting plane large, with its residuals below."""
    measured = [p for p in planes if p.scans]
    worst = max(measured, key=lambda p: float(np.nan_to_num(p.rms_dex)))
    figure = new_figure(420, 330)
    low, high = log_limits([worst])
    upper = Panel(figure, 44, 124, 366, 180, (-90, 90), (low, high))
    _frame(upper, "BRDF (sr⁻¹)", theta_labels=False)
    _draw_plane(upper, worst)
    strip = residual_strip(figure, (44, 36, 366, 60), worst.scans, worst.curves)
    strip.x_axis(*theta_ticks(), "scattering angle θ_r")
    return Picture(inline_svg(figure, name="key", label=_label(worst)), worst.title), worst


def residual_strip(
    figure: object, box: tuple[float, float, float, float],
    scans: Sequence[ScanPoints], curves: Sequence[Curve],
) -> Panel:  # fmt: skip
    """Residuals in dex about zero with the model and the predictive band."""
    residuals = [s.residual_dex for s in scans]
    reach = max(abs(v) for v in limits(*residuals, pad=0.06, least=0.02))
    panel = Panel(figure, *box, x=(-90, 90), y=(-reach, reach))  # type: ignore[arg-type]
    panel.y_axis(*linear_ticks(-reach, reach, 3), "log₁₀(measured / model)  (dex)")
    for curve in curves:
        draw_bands_dex(panel, curve)
    panel.segments([(-90, 0, 90, 0)], color=FAINT)
    for scan, residual in zip(scans, residuals, strict=True):
        rows = extremes(residual, MOST_POINTS)
        look = LOOKS[scan.polarization]
        panel.dots(scan.theta_r_deg[rows], residual[rows], look.color, size=2.4, cap=look.cap)
    return panel


def draw_bands_dex(panel: Panel, curve: Curve) -> None:
    """Bands of a curve relative to the MAP."""
    at_map = log10_or_gap(curve.map)[:, None]
    look = LOOKS[curve.polarization]
    model = log10_or_gap(curve.model_band) - at_map
    predictive = log10_or_gap(curve.predictive_band) - at_map
    for i in (0, 4):
        panel.line(curve.theta_r_deg, predictive[:, i], look.color, 0.8, (2.0, 1.6))
    for low, high, alpha in BANDS:
        panel.fill(curve.theta_r_deg, model[:, low], model[:, high], look.color, alpha)


def extremes(values: Array, most: int) -> NDArray[np.int64]:
    """Rows to draw so that none of the outliers is lost: the ends of each of ``most / 2`` bins."""
    if values.size <= most:
        return np.arange(values.size)
    known = np.nan_to_num(values)
    bins = np.array_split(np.arange(values.size), most // 2)
    rows = [(b[np.argmin(known[b])], b[np.argmax(known[b])]) for b in bins]
    return np.unique(np.asarray(rows))


def evenly(size: int, most: int) -> NDArray[np.int64]:
    """Rows to draw, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(np.int64))


def _plane_picture(plane: PlaneData, y: tuple[float, float], name: str) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    panel = Panel(figure, 44, 36, WIDTH - 54, HEIGHT - 62, (-90, 90), y)
    _frame(panel, "BRDF (sr⁻¹)")
    _draw_plane(panel, plane)
    notes = tuple(_note(curve, plane.scans) for curve in plane.curves)
    return Picture(inline_svg(figure, name=name, label=_label(plane)), plane.title, notes)


def _frame(panel: Panel, title: str, *, theta_labels: bool = True) -> None:
    ticks, labels = theta_ticks()
    if theta_labels:
        panel.x_axis(ticks, labels, "scattering angle θ_r")
    else:
        panel.x_axis(ticks, [""] * len(ticks))
    panel.y_axis(*log_ticks(*panel.y), title)


def _draw_plane(panel: Panel, plane: PlaneData) -> None:
    """Specular direction, bands, readings, curve: in this order."""
    _mark_specular(panel, plane.theta_i_deg, plane.phi_r_deg)
    for curve in plane.curves:
        color = LOOKS[curve.polarization].color
        predictive, model = log10_or_gap(curve.predictive_band), log10_or_gap(curve.model_band)
        for i in (0, 4):
            panel.line(curve.theta_r_deg, predictive[:, i], color, 0.7, (2.0, 1.6))
        for low, high, alpha in BANDS:
            panel.fill(curve.theta_r_deg, model[:, low], model[:, high], color, alpha)
    for scan in plane.scans:
        rows = evenly(scan.value.size, _share(plane))
        look = LOOKS[scan.polarization]
        panel.dots(
            scan.theta_r_deg[rows], log10_or_gap(scan.value[rows]), look.color, cap=look.cap, alpha=0.55
        )
    for curve in plane.curves:
        look = LOOKS[curve.polarization]
        panel.line(curve.theta_r_deg, log10_or_gap(curve.map), look.color, 1.3, look.dash)


def _share(plane: PlaneData) -> int:
    """Readings drawn of each scan where several share a panel."""
    return max(12, 2 * MOST_POINTS // max(2, len(plane.scans)))


def _mark_specular(panel: Panel, theta_i_deg: float, phi_r_deg: float) -> None:
    """Thin line and a small word at the specular direction, where the plane holds it."""
    if theta_i_deg and phi_r_deg % 180:
        return
    at = theta_i_deg if phi_r_deg % 360 == 0 else -theta_i_deg
    panel.segments([(at, panel.y[0], at, panel.y[1])], color=FAINT, width=0.9)
    x = panel.width * (at + 90) / 180
    align = "end" if at > 55 else "center"
    panel.words(x, panel.height + 4, "specular", size=9, align=align)


def _held_out_picture(scans: Sequence[HeldOut], y: tuple[float, float], name: str) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    panel = Panel(figure, 44, 36, WIDTH - 54, HEIGHT - 62, (-90, 90), y)
    _frame(panel, "BRDF (sr⁻¹)")
    _mark_specular(panel, scans[0].theta_i_deg, scans[0].phi_r_deg)
    for scan in scans:
        look, band = LOOKS[scan.polarization], log10_or_gap(scan.band)
        for low, high, alpha in BANDS:
            panel.fill(scan.theta_r_deg, band[:, low], band[:, high], look.color, alpha)
        for i in (0, 4):
            panel.line(scan.theta_r_deg, band[:, i], look.color, 0.7, (2.0, 1.6))
        rows = evenly(scan.value.size, MOST_POINTS)
        panel.dots(scan.theta_r_deg[rows], log10_or_gap(scan.value[rows]), INK, size=2.0, cap=look.cap)
    title = plane_title(scans[0].theta_i_deg, scans[0].phi_r_deg)
    notes = tuple((s.polarization, _held_out_text(s)) for s in scans)
    label = f"Held-out BRDF at {title}; " + "; ".join(f"{LOOKS[p].word}: {text}" for p, text in notes)
    return Picture(inline_svg(figure, name=name, label=label), title, notes)


def _held_out_text(scan: HeldOut) -> str:
    known = np.isfinite(scan.value)
    inside = (scan.value >= scan.band[:, 0]) & (scan.value <= scan.band[:, 4])
    share = np.mean(inside[known]) if known.any() else np.nan
    return f"{percent(share)} of {known.sum()} readings inside the 90{THIN}% predictive band"


def _note(curve: Curve, scans: Sequence[ScanPoints]) -> tuple[str, str]:
    """Numbers under a panel: residuals and typical half widths of the two bands."""
    mine = PlaneData(0, 0, (), tuple(s for s in scans if s.polarization == curve.polarization))
    rms = mine.rms_dex
    text = f"rms {number(rms, digits=2)}{THIN}dex ({dex_as_percent(rms)}); " if np.isfinite(rms) else ""
    model, predictive = half_width(curve.model_band), half_width(curve.predictive_band)
    return curve.polarization, f"{text}model ±{model}, predictive ±{predictive}"


def half_width(band: Array) -> str:
    """Median over angle of half the width of the 90 % interval, relative to the median curve."""
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = (band[:, 4] - band[:, 0]) / (2 * band[:, 2])
    good = relative[np.isfinite(relative)]
    return percent(np.median(good)) if good.size else MISSING


def _label(plane: PlaneData) -> str:
    """Text alternative of a scan plane, in numbers."""
    parts = []
    for curve in plane.curves:
        word = LOOKS[curve.polarization].word
        values = [s.value for s in plane.scans if s.polarization == curve.polarization]
        joined = np.concatenate(values) if values else np.zeros(0)
        good = joined[np.isfinite(joined)]
        if good.size:
            said = f"measured {number(good.min())} to {number(good.max())} per sr"
        else:
            at = curve.map[np.isfinite(curve.map)]
            said = f"predicted {number(at.min())} to {number(at.max())} per sr" if at.size else "no curve"
        parts.append(f"{word}: {said}, 90 % model band ±{half_width(curve.model_band)}, "
                     f"predictive band ±{half_width(curve.predictive_band)}")  # fmt: skip
    return f"BRDF at {plane.title}; " + "; ".join(parts)


_ = MUTED
