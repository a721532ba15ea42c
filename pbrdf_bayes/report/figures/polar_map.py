"""A polar map of the hemisphere: disc, rings, marks, and the scale of its colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from pbrdf_bayes.report.figures.axes import WIDTH, figure_of, new_axes
from pbrdf_bayes.report.figures.looks import FAINT, INK, MUTED
from pbrdf_bayes.report.figures.svg import inline_svg

Array = NDArray[np.float64]

ANGLE_TICKS = ([-90.0, -45.0, 0.0, 45.0, 90.0], ["−90° (p)", "−45°", "0° (s)", "45°", "90° (p)"])
"""Of an angle of linear polarisation [deg]: both ends are the same."""
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
    _fill(axes, x, y, inside, levels=levels, cmap=scale.colors)
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
        _fill(axes, x, y, near, levels=levels, colors=mpl.colormaps[scale.colors](place))


def _fill(axes: Axes, x: Array, y: Array, z: Array, **colors: Any) -> None:
    """Fill contours without white seams between the steps."""
    axes.contourf(x, y, z, antialiased=False, **colors).set(edgecolor="face", linewidth=0.4)


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


def plot_hemisphere(
    axes: Axes, x: Array, y: Array, z: Array, theta_i: float, scale: Scale, *,
    fill: Fill = fill_levels,
) -> Axes:  # fmt: skip
    """Draw a disc with rings at 30 and 60 deg, angles around it, ring and cross at +-theta_i.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    x, y : ndarray, shape (n_theta_r, n_phi_r)
        Places of the directions: theta_r [deg] times cosine and sine of phi_r.
    z : ndarray, shape (n_theta_r, n_phi_r)
    theta_i : float
        Angle of incidence [deg].
    scale : Scale
    fill : callable
        `fill_levels`, or `fill_angles` for values modulo 180 deg.

    Returns
    -------
    matplotlib.axes.Axes
        The one given.
    """
    axes.add_patch(Circle((0, 0), 90.0, fc=_MISSING, ec="none"))
    fill(axes, x, y, z, scale)
    for radius in (30.0, 60.0):
        axes.add_patch(Circle((0, 0), radius, fill=False, ec="white", lw=0.7, ls=(0, (2, 2))))
    axes.add_patch(Circle((0, 0), 90.0, fill=False, ec=FAINT, lw=0.9))
    for color, width in ((INK, 3.0), ("white", 1.4)):
        for angle, marker in ((theta_i, "o"), (-theta_i, "+")):
            axes.plot(angle, 0.0, marker, ms=10, mfc="none", mec=color, mew=width, clip_on=False)
    for at, word, offset, align in (
        ((0, 90), "90°", (0, 6), "center"), ((90, 0), "φ_r = 0°", (6, -4), "left"),
        ((-90, 0), "180°", (-6, -4), "right"), ((90, -90), "θ_r", (16, -21), "left"),
    ):  # fmt: skip
        axes.annotate(word, at, offset, textcoords="offset points", ha=align, color=MUTED)
    axes.set(xlim=(-91, 91), ylim=(-91, 91), aspect="equal", yticks=())
    axes.set_xticks(range(-90, 91, 30), [f"{abs(t)}°" for t in range(-90, 91, 30)])
    axes.grid(visible=False)
    axes.spines["bottom"].set_position(("outward", 5))
    return axes


def plot_colors(axes: Axes, scale: Scale) -> Axes:
    """Draw the scale of the colours with its labels below."""
    edges = np.linspace(scale.low, scale.high, _STEPS + 1)
    colors = mpl.colormaps[scale.colors](np.linspace(0.0, 1.0, _STEPS))
    axes.bar(edges[:-1], 1.0, np.diff(edges), align="edge", color=colors, edgecolor=colors, lw=0.8)
    axes.set(xlim=(scale.low, scale.high), ylim=(0, 1), yticks=())
    axes.set_xticks(scale.ticks, scale.words)
    axes.grid(visible=False)
    axes.set_xlabel("○ specular · + back to the source", fontsize=9.5, color=MUTED)
    return axes


def polar_map(
    x: Array, y: Array, z: Array, theta_i: float, scale: Scale, title: str, label: str, name: str,
    *, fill: Fill = fill_levels,
) -> Markup:  # fmt: skip
    """Return the map with its title above and the scale of the colours below."""
    disc, bar = new_axes(WIDTH, 384.0, (48, 96, 248, 248), (30, 34, WIDTH - 60, 11))
    plot_hemisphere(disc, x, y, z, theta_i, scale, fill=fill)
    disc.set_title(title, loc="center", fontsize=11.5, pad=22)
    plot_colors(bar, scale)
    return inline_svg(figure_of(disc), name=name, label=label)
