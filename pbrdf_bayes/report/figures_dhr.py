"""Directional-hemispherical reflectance: readings, bands and differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrdf_bayes.report.arrays import DhrCurve, DhrPoints
from pbrdf_bayes.report.figures_brdf import BANDS, HEIGHT, WIDTH, Picture, evenly, half_width
from pbrdf_bayes.report.numbers import THIN, number
from pbrdf_bayes.report.panel import FAINT, LOOKS, Panel, limits, linear_ticks, new_figure
from pbrdf_bayes.report.svg import inline_svg

ANGLES = (0.0, 90.0)
MOST_READINGS = 90


def dhr_pictures(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> list[Picture]:
    """Return DHR against incidence, and its difference from the MAP where there are readings."""
    found = [_values_picture(curves, points)] if curves else []
    return [*found, _differences_picture(curves, points)] if points else found


def _values_picture(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    y = limits(*(c.model_band[:, [0, 4]] for c in curves), *(p.value for p in points), [0.0])
    panel = _frame(figure, (min(0.0, y[0] if y[0] < -0.02 else 0.0), min(y[1], 1.05)), "DHR")
    for curve in curves:
        color = LOOKS[curve.polarization].color
        for i in (0, 4):
            panel.line(curve.theta_i_deg, curve.predictive_band[:, i], color, 0.7, (2.0, 1.6))
        for low, high, alpha in BANDS:
            panel.fill(curve.theta_i_deg, curve.model_band[:, low], curve.model_band[:, high], color, alpha)
        panel.line(curve.theta_i_deg, curve.map, color, 1.3, LOOKS[curve.polarization].dash)
    _draw_readings(panel, points, differences=False)
    notes = tuple(
        (c.polarization, f"model ±{half_width(c.model_band)}, predictive ±{half_width(c.predictive_band)}")
        for c in curves
    )
    return Picture(inline_svg(figure, name="dhr", label=_label(curves, points)), "DHR", notes)


def _differences_picture(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    differences = [p.value - p.map for p in points]
    bands = [c.predictive_band[:, [0, 4]] - c.map[:, None] for c in curves if _has(points, c)]
    reach = max(abs(v) for v in limits(*differences, *bands, pad=0.06, least=1e-4))
    panel = _frame(figure, (-reach, reach), "DHR, measured − model")
    panel.segments([(*ANGLES[:1], 0, ANGLES[1], 0)], color=FAINT)
    for curve in curves:
        if _has(points, curve):
            _draw_differences(panel, curve)
    _draw_readings(panel, points, differences=True)
    notes = tuple((p.polarization, _difference_text(p)) for p in points)
    label = "DHR, measured minus model; " + "; ".join(f"{LOOKS[p].word}: {text}" for p, text in notes)
    return Picture(inline_svg(figure, name="dhrdiff", label=label), "Measured − model", notes)


def _frame(figure: object, y: tuple[float, float], title: str) -> Panel:
    panel = Panel(figure, 52, 36, WIDTH - 62, HEIGHT - 62, ANGLES, y)  # type: ignore[arg-type]
    panel.x_axis([0, 30, 60, 90], ["0°", "30°", "60°", "90°"], "incidence angle θ_i")
    panel.y_axis(*linear_ticks(*y), title)
    return panel


def _draw_differences(panel: Panel, curve: DhrCurve) -> None:
    color = LOOKS[curve.polarization].color
    for i in (0, 4):
        panel.line(curve.theta_i_deg, curve.predictive_band[:, i] - curve.map, color, 0.8, (2.0, 1.6))
    for low, high, alpha in BANDS:
        model = curve.model_band - curve.map[:, None]
        panel.fill(curve.theta_i_deg, model[:, low], model[:, high], color, alpha)


def _draw_readings(panel: Panel, points: Sequence[DhrPoints], *, differences: bool) -> None:
    """Readings with bars of one stated standard uncertainty."""
    for group in points:
        rows, look = evenly(group.value.size, MOST_READINGS), LOOKS[group.polarization]
        theta, u = group.theta_i_deg[rows], group.u_value[rows]
        value = group.value[rows] - (group.map[rows] if differences else 0.0)
        bars = [(t, v - e, t, v + e) for t, v, e in zip(theta, value, u, strict=True) if np.isfinite(v + e)]
        panel.segments(bars, color=look.color, width=1.0)
        panel.dots(theta, value, look.color, size=4.2, cap=look.cap)


def _has(points: Sequence[DhrPoints], curve: DhrCurve) -> bool:
    return any(p.polarization == curve.polarization for p in points)


def _difference_text(points: DhrPoints) -> str:
    difference = points.value - points.map
    good = difference[np.isfinite(difference)]
    rms = np.sqrt(np.mean(good**2)) if good.size else np.nan
    return f"rms {number(rms, digits=2)}{THIN}over {good.size} readings"


def _label(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> str:
    parts = []
    for group in points:
        good = group.value[np.isfinite(group.value)]
        if good.size:
            said = f"measured {number(good.min())} to {number(good.max())}"
            parts.append(f"{LOOKS[group.polarization].word}: {said} in {good.size} readings")
    for curve in curves:
        parts.append(
            f"{LOOKS[curve.polarization].word}: predicted {number(np.nanmin(curve.map))} to "
            f"{number(np.nanmax(curve.map))}, 90 % model band ±{half_width(curve.model_band)}"
        )
    return "DHR against incidence angle; " + "; ".join(parts)
