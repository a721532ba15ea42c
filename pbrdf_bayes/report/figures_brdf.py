"""BRDF against scattering angle: each scan plane with its bands, and deviations in dex below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import Curve
from pbrdf_bayes.report.figures_planes import (
    Picture,
    Plane,
    Strand,
    deviations,
    dex_reach,
    fit_note,
    label_of,
    log_limits,
)
from pbrdf_bayes.report.panel import (
    FAINT,
    LOOKS,
    Panel,
    linear_ticks,
    log10_or_gap,
    log_ticks,
    new_figure,
    theta_ticks,
)
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]

WIDTH = 344.0
MOST_POINTS = 161
"""Readings of a scan drawn at most over a curve."""
BANDS = ((0, 4, 0.20), (1, 3, 0.32))
"""Indices of the quantiles of the 90 and the 50 % interval, and their opacity."""
OUTLINE = (2.0, 1.6)
"""Dashes of the predictive band, which is never shaded."""
THETA = (-90.0, 90.0)
LEFT, RIGHT, TOP, BELOW, BETWEEN, GAP, STRIP = 46.0, 10.0, 26.0, 36.0, 30.0, 9.0, 42.0


def plane_pictures(
    planes: Sequence[Plane],
    *,
    name: str,
    what: str = "BRDF",
    note: Callable[[Strand], str] = fit_note,
) -> list[Picture]:
    """Return one panel per scan plane, all on the same axes."""
    y, reach = log_limits(planes), dex_reach(planes)
    return [
        Picture(
            inline_svg(
                _stacked(plane, y, reach), name=f"{name}{i}", label=label_of(plane, what=what)
            ),
            plane.title,
            tuple((s.polarization, note(s)) for s in plane.strands),
        )
        for i, plane in enumerate(planes)
    ]


def key_picture(planes: Sequence[Plane]) -> tuple[Picture, Plane]:
    """Draw the worst-fitting plane for the first screen."""
    worst = max(planes, key=lambda p: float(np.nan_to_num(p.rms_dex)))
    figure = _stacked(worst, log_limits([worst]), dex_reach([worst]), width=384, upper=172)
    return Picture(inline_svg(figure, name="key", label=label_of(worst)), worst.title), worst


def _stacked(
    plane: Plane,
    y: tuple[float, float],
    reach: float,
    *,
    width: float = WIDTH,
    upper: float = 146.0,
) -> Figure:
    """Curve on a logarithmic axis above, one strip of deviations per polarisation below."""
    n = len(plane.strands)
    strips = n * STRIP + (n - 1) * GAP
    figure = new_figure(width, BELOW + strips + BETWEEN + upper + TOP)
    across = width - LEFT - RIGHT
    panel = Panel(figure, LEFT, BELOW + strips + BETWEEN, across, upper, THETA, y)
    panel.x_axis(theta_ticks()[0], [""] * 5)
    panel.y_axis(*log_ticks(*y), "BRDF (sr⁻¹)")
    _draw_curves(panel, plane)
    for i, strand in enumerate(plane.strands):
        bottom = BELOW + (n - 1 - i) * (STRIP + GAP)
        strip = Panel(figure, LEFT, bottom, across, STRIP, THETA, (-reach, reach))
        _frame_strip(strip, first=i == 0, last=i == n - 1)
        draw_deviations(strip, strand, most=MOST_POINTS)
        color = LOOKS[strand.polarization].color
        strip.words(across + 2, STRIP / 2 - 4, strand.polarization, color=color, align="left")
    return figure


def _frame_strip(strip: Panel, *, first: bool, last: bool) -> None:
    ticks, labels = theta_ticks()
    strip.x_axis(ticks, labels if last else [""] * 5, "scattering angle θ_r" if last else "")
    reach = strip.y[1]
    strip.y_axis(*linear_ticks(-reach, reach), "relative to the model (dex)" if first else "")


def draw_deviations(panel: Panel, strand: Strand, *, most: int) -> None:
    """Bands and readings relative to the model, in dex; readings beyond the axis at its edge."""
    look, reach = LOOKS[strand.polarization], panel.y[1]
    if strand.curve is not None:
        _draw_bands(panel, strand.curve, partial(deviations, curve=strand.curve), look.color)
    panel.segments([(THETA[0], 0, THETA[1], 0)], color=FAINT)
    for scan in strand.scans:
        residual = scan.residual_dex
        rows = extremes(residual, max(20, most // len(strand.scans)))
        at_edge = np.clip(residual[rows], -0.97 * reach, 0.97 * reach)
        panel.dots(scan.theta_r_deg[rows], at_edge, look.color, size=2.2, square=look.square)


def _draw_curves(panel: Panel, plane: Plane) -> None:
    """Specular direction, bands, readings, curve: in this order."""
    _mark_specular(panel, plane)
    for strand in plane.strands:
        if strand.curve is not None:
            _draw_bands(panel, strand.curve, log10_or_gap, LOOKS[strand.polarization].color)
    for strand in plane.strands:
        look = LOOKS[strand.polarization]
        for i, scan in enumerate(strand.scans):
            rows = evenly(scan.value.size, max(12, MOST_POINTS // len(strand.scans)), offset=i)
            panel.dots(
                scan.theta_r_deg[rows], log10_or_gap(scan.value[rows]), look.color,
                size=2.6, square=look.square, alpha=0.5,
            )  # fmt: skip
    for strand in plane.strands:
        if strand.curve is not None:
            look = LOOKS[strand.polarization]
            height = log10_or_gap(strand.curve.map)
            panel.line(strand.curve.theta_r_deg, height, look.color, 1.3, look.dash)


def _draw_bands(panel: Panel, curve: Curve, scale: Callable[[Array], Array], color: str) -> None:
    """Model band shaded, predictive band outlined."""
    predictive = scale(curve.predictive_band)
    for i in (0, 4):
        panel.line(curve.theta_r_deg, predictive[:, i], color, 0.75, OUTLINE)
    if curve.model_band is not None:
        model = scale(curve.model_band)
        for low, high, alpha in BANDS:
            panel.fill(curve.theta_r_deg, model[:, low], model[:, high], color, alpha)


def _mark_specular(panel: Panel, plane: Plane) -> None:
    """Thin line and a small word at the specular direction, where the plane holds it."""
    if plane.theta_i_deg and plane.phi_r_deg % 180:
        return
    at = plane.theta_i_deg if plane.phi_r_deg % 360 == 0 else -plane.theta_i_deg
    panel.segments([(at, panel.y[0], at, panel.y[1])], color=FAINT, width=0.9)
    x = panel.width * (at - THETA[0]) / (THETA[1] - THETA[0])
    panel.words(x, panel.height + 4, "specular", size=9, align="right" if at > 65 else "center")


def extremes(values: Array, most: int) -> NDArray[np.int64]:
    """Rows to draw so that no outlier is lost: the ends of each of ``most / 2`` bins."""
    if values.size <= most:
        return np.arange(values.size)
    known = np.nan_to_num(values)
    bins = np.array_split(np.arange(values.size), most // 2)
    rows = [(b[np.argmin(known[b])], b[np.argmax(known[b])]) for b in bins]
    return np.unique(np.asarray(rows))


def evenly(size: int, most: int, *, offset: int = 0) -> NDArray[np.int64]:
    """Rows to draw, evenly spread; scans drawn together differ by their offset."""
    step = max(1, -(-size // most))
    return np.arange(offset % step, size, step)
