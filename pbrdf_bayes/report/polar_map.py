"""A polar map of the hemisphere: disc, rings, marks, and the scale of its colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from pbrdf_bayes.report.panel import FAINT, INK, Panel, new_figure
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]

WIDTH = 344.0
RADIUS = 124.0
ANGLE_TICKS = ([-90.0, -45.0, 0.0, 45.0, 90.0], ["−90° (p)", "−45°", "0° (s)", "45°", "90° (p)"])
"""Of an angle of linear polarisation [deg]: both ends are the same."""
_BOTTOM, _TOP = 96.0, 40.0
_STEPS = 40
_MISSING = "#eef0f2"
_FINER = 6
_TOO_FAR_DEG = 67.5


@dataclass(frozen=True)
class Scale:
    """Axis of the colours: limits, ticks with their words, and the map."""

    low: float
    high: float
    ticks: list[float]
    words: list[str]
    colors: str


Fill = Callable[[Axes, Array, Array, Array, Scale], None]


def fill_levels(axes: Axes, x: Array, y: Array, z: Array, scale: Scale) -> None:
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


def fill_angles(axes: Axes, x: Array, y: Array, z: Array, scale: Scale) -> None:
    """Colours of angles modulo 180 deg, in even steps.

    Between the directions exp(2 i angle) is interpolated. Twice half of the circle is drawn, each
    time with the cut through the other half.
    """
    turned = _finer(np.exp(2j * np.deg2rad(z)))
    x, y = _finer(x), _finer(y)
    for centre in (0.0, 90.0):
        apart = 0.5 * np.rad2deg(np.angle(turned * np.exp(-2j * np.deg2rad(centre))))
        near = np.ma.masked_where(~(np.abs(apart) < _TOO_FAR_DEG), apart)
        if near.mask.all():
            continue
        levels = np.linspace(-45.0, 45.0, _STEPS // 2 + 1)
        middles = 0.5 * (levels[1:] + levels[:-1]) + centre
        place = np.mod(middles - scale.low, 180.0) / (scale.high - scale.low)
        filled = axes.contourf(
            x, y, near, levels=levels, colors=mpl.colormaps[scale.colors](place), antialiased=False
        )
        filled.set_edgecolor("face")
        filled.set_linewidth(0.4)


def _finer(grid: Array | NDArray[np.complex128]) -> NDArray[Any]:
    """Values between those of a grid, by straight lines along both of its axes."""
    for axis in range(2):
        n = grid.shape[axis]
        at = np.linspace(0.0, n - 1.0, (n - 1) * _FINER + 1)
        first = np.minimum(at.astype(int), n - 2)
        share = np.expand_dims(at - first, 1 - axis)
        low, high = np.take(grid, first, axis=axis), np.take(grid, first + 1, axis=axis)
        on_node = share == 0.0
        grid = np.where(on_node, low, (1.0 - share) * low + share * high)
    return grid


def polar_map(
    x: Array, y: Array, z: Array, theta_i: float, scale: Scale, title: str, label: str, name: str,
    *, fill: Fill = fill_levels,
) -> Markup:  # fmt: skip
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
    fill(axes, x, y, z, scale)
    for ring in (30.0, 60.0):
        axes.add_patch(Circle((0, 0), ring, fill=False, ec="white", lw=0.7, ls=(0, (2, 2))))
    axes.add_patch(Circle((0, 0), 90.0, fill=False, ec=FAINT, lw=0.9))
    _mark(axes, theta_i)
    _write_around(Panel(figure, left, _BOTTOM, 2 * RADIUS, 2 * RADIUS, (-91, 91), (-91, 91)), title)
    bar = Panel(figure, 30.0, 34.0, WIDTH - 60.0, 11.0, (scale.low, scale.high), (0.0, 1.0))
    _color_bar(bar, scale)
    return inline_svg(figure, name=name, label=label)


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


def _color_bar(bar: Panel, scale: Scale) -> None:
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
