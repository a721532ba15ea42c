"""Widths of the lobes: those that single scans ask for, and the curve of Eq. (5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrdf_bayes.report.arrays import ScanWidthPoints, WidthCurve
from pbrdf_bayes.report.figures_brdf import BANDS, WIDTH
from pbrdf_bayes.report.figures_planes import Picture, span
from pbrdf_bayes.report.numbers import number
from pbrdf_bayes.report.panel import FAINT, LOOKS, Panel, limits, linear_ticks, new_figure
from pbrdf_bayes.report.svg import inline_svg

HEIGHT = 236.0
ANGLES = (-4.0, 90.0)
_BESIDE = {"s": -0.8, "p": 0.8, "u": 0.0}
"""Where s and p were measured at one angle, their points stand side by side [deg]."""
_FLAT = 0.05
_FARTHEST = 3.0


def width_pictures(
    curves: Sequence[WidthCurve], points: Sequence[ScanWidthPoints]
) -> list[Picture]:
    """Return widths against incidence, and the same over Eq. (5) at the MAP."""
    if not curves:
        return []
    return [_picture(curves, points, relative=relative) for relative in (False, True)]


def _picture(
    curves: Sequence[WidthCurve], points: Sequence[ScanWidthPoints], *, relative: bool
) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    bands = [c.model_band / (c.map[:, None] if relative else 1.0) for c in curves]
    reference = 1.0 if relative else 0.0
    shown = [p.width / (p.model if relative else 1.0) for p in points]
    errors = [p.u_width / (p.model if relative else 1.0) for p in points]
    most = _FARTHEST * max((float(np.nanmax(b)) for b in bands if np.isfinite(b).any()), default=1)
    ends = [
        np.clip(v + sign * u, 0.0, most)
        for v, u in zip(shown, errors, strict=True)
        for sign in (-1.0, 0.0, 1.0)
    ]
    y = limits(*bands, *ends, [reference], least=2 * _FLAT if relative else 0.0)
    y = y if relative else (0.0, y[1])
    panel = Panel(figure, 52, 36, WIDTH - 62, HEIGHT - 62, ANGLES, y)
    panel.x_axis([0, 30, 60, 90], ["0°", "30°", "60°", "90°"], "incidence angle θ_i")
    panel.y_axis(*linear_ticks(*y), "width over Eq. (5)" if relative else "half width ρ")
    if relative:
        panel.segments([(ANGLES[0], 1.0, ANGLES[1], 1.0)], color=FAINT)
    for curve, band in zip(curves, bands, strict=True):
        look = LOOKS[curve.polarization]
        for low, high, alpha in BANDS:
            panel.fill(curve.theta_i_deg, band[:, low], band[:, high], look.color, alpha)
        line = np.ones_like(curve.map) if relative else curve.map
        panel.line(curve.theta_i_deg, line, look.color, 1.3, look.dash)
    for group in points:
        _draw_points(panel, group, relative=relative)
    title = "Over Eq. (5) at the MAP" if relative else "Against incidence"
    name = "widths-relative" if relative else "widths"
    notes = tuple((p.polarization, _note(p)) for p in points)
    label = f"Lobe width of each scan, {title.lower()}: " + "; ".join(
        f"{LOOKS[p.polarization].word}: {span(v)} in {v.size} scans, {_note(p)}"
        for p, v in zip(points, shown, strict=True)
    )
    return Picture(inline_svg(figure, name=name, label=label), title, notes)


def _draw_points(panel: Panel, group: ScanWidthPoints, *, relative: bool) -> None:
    """Draw widths with bars of one standard error."""
    look, over = LOOKS[group.polarization], group.model if relative else 1.0
    value, u = group.width / over, group.u_width / over
    theta = group.theta_i_deg + _BESIDE[group.polarization]
    bars = [
        (t, v - e, t, v + e) for t, v, e in zip(theta, value, u, strict=True) if np.isfinite(v + e)
    ]
    panel.segments(bars, color=look.color, width=1.0)
    panel.dots(theta, value, look.color, size=4.4, square=look.square)


def _note(group: ScanWidthPoints) -> str:
    away = group.width / group.model - 1.0
    good = away[np.isfinite(away)]
    if not good.size:
        return "0 scans with a width"
    return f"rms {number(100.0 * np.sqrt(np.mean(good**2)), digits=2)}\u202f% away from Eq. (5)"
