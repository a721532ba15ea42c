"""Directional-hemispherical reflectance: readings, bands and differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import DhrCurve, DhrPoints
from pbrdf_bayes.report.figures_brdf import BANDS, OUTLINE, WIDTH, evenly
from pbrdf_bayes.report.figures_planes import Picture, half_width, span
from pbrdf_bayes.report.numbers import number
from pbrdf_bayes.report.panel import FAINT, LOOKS, Panel, limits, linear_ticks, new_figure
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]
HEIGHT = 236.0
ANGLES = (0.0, 90.0)
MOST_READINGS = 90


def dhr_pictures(
    curves: Sequence[DhrCurve], points: Sequence[DhrPoints], *, name: str = "dhr"
) -> list[Picture]:
    """Return DHR against incidence, and its difference from the MAP for each polarisation read."""
    found = [_values_picture(curves, points, name)] if curves else []
    reach = _reach(curves, points)
    return [*found, *(_difference_picture(p, _curve_of(p, curves), reach, name) for p in points)]


def _values_picture(curves: Sequence[DhrCurve], points: Sequence[DhrPoints], name: str) -> Picture:
    figure = new_figure(WIDTH, HEIGHT)
    y = limits(*(c.model_band[:, [0, 4]] for c in curves), *(p.value for p in points), [0.0])
    panel = _frame(figure, (min(0.0, y[0] if y[0] < -0.02 else 0.0), min(y[1], 1.05)), "DHR")
    for curve in curves:
        look = LOOKS[curve.polarization]
        _draw_bands(panel, curve, 0.0)
        panel.line(curve.theta_i_deg, curve.map, look.color, 1.3, look.dash)
    _draw_readings(panel, points, differences=False)
    notes = tuple(
        (
            c.polarization,
            f"model ±{half_width(c.model_band)} · predictive ±{half_width(c.predictive_band)}",
        )
        for c in curves
    )
    return Picture(
        inline_svg(figure, name=name, label=_label(curves, points)), "Against incidence", notes
    )


def _difference_picture(
    points: DhrPoints, curve: DhrCurve | None, reach: float, name: str
) -> Picture:
    figure, word = new_figure(WIDTH, HEIGHT), LOOKS[points.polarization].word
    panel = _frame(figure, (-reach, reach), "DHR, measured − model")
    if curve is not None:
        _draw_bands(panel, curve, curve.map)
    panel.segments([(ANGLES[0], 0, ANGLES[1], 0)], color=FAINT)
    _draw_readings(panel, [points], differences=True)
    text = _difference_text(points)
    svg = inline_svg(
        figure,
        name=f"{name}-{points.polarization}",
        label=f"DHR {word}, measured minus model: {text}",
    )
    return Picture(svg, f"Measured − model, {word}", ((points.polarization, text),))


def _frame(figure: object, y: tuple[float, float], title: str) -> Panel:
    panel = Panel(figure, 52, 36, WIDTH - 62, HEIGHT - 62, ANGLES, y)  # type: ignore[arg-type]
    panel.x_axis([0, 30, 60, 90], ["0°", "30°", "60°", "90°"], "incidence angle θ_i")
    panel.y_axis(*linear_ticks(*y), title)
    return panel


def _draw_bands(panel: Panel, curve: DhrCurve, base: Array | float) -> None:
    """Model band shaded, predictive band outlined, above a base line."""
    color = LOOKS[curve.polarization].color
    model = curve.model_band - np.reshape(base, (-1, 1))
    predictive = curve.predictive_band - np.reshape(base, (-1, 1))
    for i in (0, 4):
        panel.line(curve.theta_i_deg, predictive[:, i], color, 0.75, OUTLINE)
    for low, high, alpha in BANDS:
        panel.fill(curve.theta_i_deg, model[:, low], model[:, high], color, alpha)


def _draw_readings(panel: Panel, points: Sequence[DhrPoints], *, differences: bool) -> None:
    """Draw the readings with bars of one stated standard uncertainty."""
    for group in points:
        rows, look = evenly(group.value.size, MOST_READINGS), LOOKS[group.polarization]
        theta, u = group.theta_i_deg[rows], group.u_value[rows]
        value = group.value[rows] - (group.map[rows] if differences else 0.0)
        bars = [
            (t, v - e, t, v + e)
            for t, v, e in zip(theta, value, u, strict=True)
            if np.isfinite(v + e)
        ]
        panel.segments(bars, color=look.color, width=1.0)
        panel.dots(theta, value, look.color, size=4.4, square=look.square)


def _curve_of(points: DhrPoints, curves: Sequence[DhrCurve]) -> DhrCurve | None:
    return next((c for c in curves if c.polarization == points.polarization), None)


def _reach(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> float:
    """Half height of the axis of differences that all polarisations share."""
    spreads = [p.value - p.map for p in points]
    found = [c for c in (_curve_of(p, curves) for p in points) if c is not None]
    spreads += [
        (c.predictive_band[:, i] - c.map)[c.theta_i_deg <= 80] for c in found for i in (0, 4)
    ]
    return max(abs(v) for v in limits(*spreads, pad=0.06, least=1e-4))


def _difference_text(points: DhrPoints) -> str:
    difference = points.value - points.map
    good = difference[np.isfinite(difference)]
    rms = np.sqrt(np.mean(good**2)) if good.size else np.nan
    return f"rms {number(rms, digits=2)} over {good.size} readings"


def _label(curves: Sequence[DhrCurve], points: Sequence[DhrPoints]) -> str:
    parts = [
        f"{LOOKS[p.polarization].word}: measured {span(p.value)} in {p.value.size} readings"
        for p in points
    ]
    parts += [
        f"{LOOKS[curve.polarization].word}: predicted {span(curve.map)}, 90 % model band "
        f"±{half_width(curve.model_band)}"
        for curve in curves
    ]
    return "DHR against incidence angle; " + "; ".join(parts)
