"""A scene in pictures: polar maps of the hemisphere, and s and p curves in the plane of incidence.

A map is seen from above. The radius is theta_r, light comes from the left (phi_r = 180 deg) and
goes on to the right (phi_r = 0). It is its own mirror image, of which the scene may hold half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from pbrdf_bayes.report.figures_planes import span
from pbrdf_bayes.report.numbers import degrees, number
from pbrdf_bayes.report.panel import (
    FAINT,
    INK,
    LOOKS,
    Panel,
    limits,
    linear_ticks,
    log10_or_gap,
    log_ticks,
    new_figure,
    theta_ticks,
)
from pbrdf_bayes.report.svg import figure_style, inline_svg
from pbrdf_bayes.scenes import SceneValues

Array = NDArray[np.float64]

WIDTH = 344.0
RADIUS = 124.0
MOST_DRAWN = 8
"""Angles of incidence that are drawn at most."""
_BOTTOM, _TOP, _CURVE = 96.0, 40.0, 170.0
_DECADES = 5.0
_STEPS = 40
_MAPS = {"BRDF": "viridis", "DoLP": "magma"}
"""Colours whose lightness rises evenly; also told apart in grey and by the colour-blind."""
_MISSING = "#eef0f2"


@dataclass(frozen=True)
class ScenePicture:
    """A picture with the name of its file and the part of the page that it belongs to."""

    name: str
    part: str
    svg: Markup


@dataclass(frozen=True)
class _Scale:
    """Axis of the colours: limits, ticks with their words, and the map."""

    low: float
    high: float
    ticks: list[float]
    words: list[str]
    colors: str


def scene_pictures(values: SceneValues) -> list[ScenePicture]:
    """Everything that a scene can show.

    Parameters
    ----------
    values : SceneValues

    Returns
    -------
    list of ScenePicture
        Maps of the BRDF, on one scale, and of the degree of linear polarisation, where the
        directions span a hemisphere; curves of both in the plane of incidence and of the DHR where
        there are two points or more.
    """
    with figure_style():
        return [*_curves(values), *_maps(values), *_dhr(values)]


def drawn_incidences(values: SceneValues) -> list[tuple[int, float]]:
    """Index and angle [deg] of the incidences that are drawn: `MOST_DRAWN`, evenly spread."""
    angles = values.scene.theta_i_deg
    chosen = np.unique(np.linspace(0, len(angles) - 1, min(len(angles), MOST_DRAWN)).astype(int))
    return [(i, angles[i]) for i in chosen.tolist()] if angles else []


# -------------------------------------------------------------------------------------------- maps


def _maps(values: SceneValues) -> list[ScenePicture]:
    scene, grid = values.scene, _closed(values)
    found: list[ScenePicture] = []
    if grid is None:
        return found
    x, y, order = grid
    drawn = drawn_incidences(values)
    if values.brdf is not None:
        logs = log10_or_gap(values.brdf[..., values.at_median])
        scale = _brdf_scale(logs)
        for i, theta_i in drawn:
            for q, z in zip(scene.polarizations, logs[:, i], strict=True):
                title = f"BRDF (sr⁻¹), {LOOKS[q].word}, θ_i = {degrees(theta_i)}"
                label = f"Polar map of the {q} BRDF at {degrees(theta_i)}: {span(10**z)} per sr"
                svg = _map(
                    x, y, z[:, order], theta_i, scale, title, label, f"map-{q}-{theta_i:.10g}"
                )
                found.append(ScenePicture(f"scene_brdf_{q}_{theta_i:.10g}", "hemisphere", svg))
    if values.dolp is not None:
        dolp = values.dolp[..., values.at_median]
        scale = _share_scale(dolp)
        for i, theta_i in drawn:
            z = dolp[i]
            title = f"Degree of linear polarisation, θ_i = {degrees(theta_i)}"
            label = (
                f"Polar map of the degree of linear polarisation at {degrees(theta_i)}: {span(z)}"
            )
            svg = _map(x, y, z[:, order], theta_i, scale, title, label, f"dolp-{theta_i:.10g}")
            found.append(ScenePicture(f"scene_dolp_{theta_i:.10g}", "polarisation", svg))
    return found


def _closed(values: SceneValues) -> tuple[Array, Array, NDArray[np.int64]] | None:
    """Points of a full circle of azimuths, and which azimuth of the scene each is.

    None where the scene has too few: two radii, and azimuths that reach from 0 to 180 deg when
    folded, in steps of 90 deg at most.
    """
    theta = np.array(values.scene.theta_r_deg)
    folded = np.mod(values.scene.phi_r_deg, 360.0)
    folded = np.where(folded > 180.0, 360.0 - folded, folded)
    phi, first = np.unique(folded, return_index=True)
    ends = phi.size > 2 and phi[0] == 0.0 and phi[-1] == 180.0
    if not ends or np.diff(phi).max() > 90.0 or theta.size < 2 or theta[0] < 0.0:
        return None
    order = np.concatenate([first, first[-2::-1]])
    circle = np.deg2rad(np.concatenate([phi, 360.0 - phi[-2::-1]]))
    return np.outer(theta, np.cos(circle)), np.outer(theta, np.sin(circle)), order


def _brdf_scale(logs: Array) -> _Scale:
    low, high = limits(logs, pad=0.0, least=0.4)
    low = max(low, high - _DECADES)
    return _Scale(low, high, *_ticks(low, high), _MAPS["BRDF"])


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Decades, and 1-2-5 in between where there are fewer than three of them."""
    ticks, words = log_ticks(low, high)
    if len(ticks) > 2:
        return ticks, words
    steps = [(f, d) for d in range(floor(low), ceil(high) + 1) for f in (1, 2, 5)]
    inside = [(f, d) for f, d in steps if low <= log10(f) + d <= high]
    return [log10(f) + d for f, d in inside], [number(f * 10.0**d) for f, d in inside]


def _share_scale(dolp: Array) -> _Scale:
    known = dolp[np.isfinite(dolp)]
    high = min(1.0, ceil(10.0 * max(float(known.max(initial=0.0)), 0.05) - 1e-9) / 10.0)
    return _Scale(0.0, high, *linear_ticks(0.0, high), _MAPS["DoLP"])


def _map(
    x: Array, y: Array, z: Array, theta_i: float, scale: _Scale, title: str, label: str, name: str
) -> Markup:
    """Disc with rings at 30 and 60 deg, angles around it, scale of the colours below."""
    height = _BOTTOM + 2 * RADIUS + _TOP
    figure = new_figure(WIDTH, height)
    left = 0.5 * WIDTH - RADIUS
    axes = figure.add_axes(
        (left / WIDTH, _BOTTOM / height, 2 * RADIUS / WIDTH, 2 * RADIUS / height),
        xlim=(-91.0, 91.0), ylim=(-91.0, 91.0), frameon=False,
    )  # fmt: skip
    axes.set_axis_off()
    axes.add_patch(Circle((0, 0), 90.0, fc=_MISSING, ec="none"))
    _fill(axes, x, y, z, scale)
    for ring in (30.0, 60.0):
        axes.add_patch(Circle((0, 0), ring, fill=False, ec="white", lw=0.7, ls=(0, (2, 2))))
    axes.add_patch(Circle((0, 0), 90.0, fill=False, ec=FAINT, lw=0.9))
    _mark(axes, theta_i)
    _write_around(Panel(figure, left, _BOTTOM, 2 * RADIUS, 2 * RADIUS, (-91, 91), (-91, 91)), title)
    bar = Panel(figure, 30.0, 34.0, WIDTH - 60.0, 11.0, (scale.low, scale.high), (0.0, 1.0))
    _color_bar(bar, scale)
    return inline_svg(figure, name=name, label=label)


def _fill(axes: Axes, x: Array, y: Array, z: Array, scale: _Scale) -> None:
    """Colours in even steps; a fine line at every labelled value."""
    if not np.isfinite(z).any():
        return
    inside = np.clip(z, scale.low, scale.high)
    levels = np.linspace(scale.low, scale.high, _STEPS + 1)
    levels[0], levels[-1] = levels[0] - 1e-9, levels[-1] + 1e-9
    filled = axes.contourf(x, y, inside, levels=levels, cmap=scale.colors, antialiased=False)
    filled.set_edgecolor("face")  # no white seams between the steps
    filled.set_linewidth(0.4)
    between = [t for t in scale.ticks if scale.low < t < scale.high]
    if between and np.nanmin(z) < np.nanmax(z):
        axes.contour(
            x, y, z, levels=between, colors="white", linewidths=0.8, alpha=0.75, linestyles="solid"
        )


def _mark(axes: Axes, theta_i: float) -> None:
    """Ring at the specular direction, cross at the one back to the source."""
    for color, width in ((INK, 3.0), ("white", 1.4)):
        axes.add_patch(Circle((theta_i, 0.0), 3.6, fill=False, ec=color, lw=width))
        arms = np.array([(-4.0, 0.0), (4.0, 0.0), (0.0, -4.0), (0.0, 4.0)])
        arms[:, 0] -= theta_i
        cross = Path(arms, [Path.MOVETO, Path.LINETO] * 2)
        axes.add_patch(PathPatch(cross, fill=False, ec=color, lw=width, capstyle="round"))


def _write_around(disc: Panel, title: str) -> None:
    size = disc.width
    disc.words(0.5 * size, size + 24, title, color=INK, size=11.5)
    disc.words(0.5 * size, size + 5, "90°")
    disc.words(size + 4, 0.5 * size - 4, "φ_r = 0°", align="left")
    disc.words(-4, 0.5 * size - 4, "180°", align="right")
    edge = -5.0
    for angle in (-90, -60, -30, 0, 30, 60, 90):
        at = size * (angle + 91.0) / 182.0
        disc.segments(
            [(angle, -91 + edge, angle, -91 + edge - 3)], color=FAINT, width=0.9, clip=False
        )
        disc.words(at, -21, f"{abs(angle)}°")
    disc.segments([(-90, -91 + edge, 90, -91 + edge)], color=FAINT, width=0.9, clip=False)
    disc.words(size + 17, -21, "θ_r", color=INK, align="left")


def _color_bar(bar: Panel, scale: _Scale) -> None:
    edges = np.linspace(scale.low, scale.high, _STEPS + 1)
    colors = mpl.colormaps[scale.colors](np.linspace(0.0, 1.0, _STEPS))
    for a, b, color in zip(edges, edges[1:], colors, strict=False):
        corners = Path([(a, 0), (b, 0), (b, 1), (a, 1), (a, 0)])
        bar.area(corners, mpl.colors.to_hex(color), 1.0)
    for tick, word in zip(scale.ticks, scale.words, strict=True):
        at = bar.width * (tick - scale.low) / (scale.high - scale.low)
        bar.segments([(tick, 0, tick, -0.3)], color=FAINT, clip=False)
        bar.words(at, -15, word)
    bar.words(0.5 * bar.width, -30, "○ specular · + back to the source", size=9.5)


# ------------------------------------------------------------------------------------------ curves


def _curves(values: SceneValues) -> list[ScenePicture]:
    found: list[ScenePicture] = []
    scene, (theta, rows, columns) = values.scene, _in_plane(values)
    if theta.size < 2:
        return found
    for i, theta_i in drawn_incidences(values):
        if values.brdf is not None:
            strands = {
                q: values.brdf[j, i][rows, columns] for j, q in enumerate(scene.polarizations)
            }
            svg = _brdf_curves(theta, strands, theta_i, values.at_median)
            found.append(ScenePicture(f"scene_plane_{theta_i:.10g}", "plane", svg))
        if values.dolp is not None:
            svg = _dolp_curve(theta, values.dolp[i][rows, columns], theta_i, values)
            found.append(ScenePicture(f"scene_plane_dolp_{theta_i:.10g}", "polarisation", svg))
    return found


def _in_plane(values: SceneValues) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Signed angles in the plane of incidence, and where they stand in the grid."""
    scene = values.scene
    turned = np.mod(scene.phi_r_deg, 360.0)
    columns = np.flatnonzero((turned == 0.0) | (turned == 180.0))
    signs = np.where(turned[columns] == 0.0, 1.0, -1.0)
    signed = np.outer(scene.theta_r_deg, signs)
    theta, first = np.unique(signed.ravel(), return_index=True)
    if not columns.size:
        return theta, first, first
    return theta, first // columns.size, columns[first % columns.size]


def _brdf_curves(theta: Array, strands: dict[str, Array], theta_i: float, middle: int) -> Markup:
    logs = {q: log10_or_gap(v) for q, v in strands.items()}
    low, high = limits(*logs.values(), pad=0.05, least=0.6)
    low = max(low, high - _DECADES)
    panel = _frame(f"In the plane of incidence, θ_i = {degrees(theta_i)}", (low, high))
    panel.y_axis(*_ticks(low, high), "BRDF (sr⁻¹)")
    panel.segments([(theta_i, low, theta_i, high)], color=FAINT, width=0.9)
    at = panel.width * (theta_i + 90.0) / 180.0
    panel.words(
        at, panel.height + 4, "specular", size=9, align="right" if theta_i > 65 else "center"
    )
    for q, curve in logs.items():
        _strand(panel, theta, curve, q, middle)
    _key(panel, list(logs))
    said = "; ".join(f"{q} {span(v[:, middle])} per sr" for q, v in strands.items())
    label = f"BRDF in the plane of incidence at {degrees(theta_i)}: {said}"
    return inline_svg(panel.figure, name=f"plane-{theta_i:.10g}", label=label)


def _dolp_curve(theta: Array, curve: Array, theta_i: float, values: SceneValues) -> Markup:
    scale, incident = _share_scale(curve), values.scene.stokes_incident
    title = f"Polarisation in the plane, θ_i = {degrees(theta_i)}"
    panel = _frame(title, (0.0, scale.high))
    panel.y_axis(scale.ticks, scale.words, "degree of linear polarisation")
    _strand(panel, theta, curve, incident, values.at_median)
    _key(panel, [incident])
    label = f"Degree of linear polarisation in plane: {span(curve[:, values.at_median])}"
    return inline_svg(panel.figure, name=f"plane-dolp-{theta_i:.10g}", label=label)


def _dhr(values: SceneValues) -> list[ScenePicture]:
    scene = values.scene
    if values.dhr is None or len(scene.dhr_theta_i_deg) < 2:
        return []
    theta = np.array(scene.dhr_theta_i_deg)
    _, high = limits(values.dhr, pad=0.06)
    panel = _frame("Hemispherical reflectance", (0.0, high), x=(0.0, 90.0))
    panel.y_axis(*linear_ticks(0.0, high), "DHR")
    for q, curve in zip(scene.polarizations, values.dhr, strict=True):
        _strand(panel, theta, curve, q, values.at_median)
    _key(panel, list(scene.polarizations))
    said = "; ".join(
        f"{q} {span(v[:, values.at_median])}"
        for q, v in zip(scene.polarizations, values.dhr, strict=True)
    )
    svg = inline_svg(panel.figure, name="scene-dhr", label=f"DHR against incidence: {said}")
    return [ScenePicture("scene_dhr", "dhr", svg)]


def _frame(
    title: str, y: tuple[float, float], *, x: tuple[float, float] = (-90.0, 90.0)
) -> Panel:  # fmt: skip
    figure = new_figure(WIDTH, _CURVE + 108.0)
    panel = Panel(figure, 46.0, 58.0, WIDTH - 56.0, _CURVE, x, y)
    panel.words(-44.0, panel.height + 32, title, color=INK, size=11.5, align="left")
    if x[0] < 0.0:
        panel.x_axis(*theta_ticks(), "scattering angle θ_r")
    else:
        ticks = list(range(0, 91, 30))
        panel.x_axis(ticks, [f"{t}°" for t in ticks], "angle of incidence θ_i")
    return panel


def _strand(panel: Panel, x: Array, curve: Array, q: str, middle: int) -> None:
    look = LOOKS[q]
    if curve.shape[1] > 1:
        panel.fill(x, curve[:, 0], curve[:, -1], look.color, 0.25)
    panel.line(x, curve[:, middle], look.color, 1.5, look.dash)


def _key(panel: Panel, words: Sequence[str]) -> None:
    """Line and word of each polarisation, below the axis."""
    at = 0.0
    for q in words:
        look = LOOKS[q]
        x = panel.x[0] + (panel.x[1] - panel.x[0]) * np.array([at, at + 26.0]) / panel.width
        y = panel.y[0] - (panel.y[1] - panel.y[0]) * 46.0 / panel.height
        panel.segments([(x[0], y, x[1], y)], look.color, 1.5, look.dash, clip=False)
        panel.words(at + 32.0, -49.5, look.word, color=INK, align="left")
        at += 32.0 + 6.0 * len(look.word) + 22.0
