"""Axes in one style, and the marks that several figures share. One unit is one CSS pixel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import ceil, floor, log10
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator
from matplotlib.transforms import offset_copy
from numpy.typing import NDArray

from pbrdf_bayes.report.figures.looks import FAINT, GRID, INK, MUTED, Look
from pbrdf_bayes.report.numbers import number

Array = NDArray[np.float64]

WIDTH = 344.0
"""Of most pictures [px]: three stand beside each other in the report."""
BANDS = ((0, 4, 0.20), (1, 3, 0.32))
"""Indices of the quantiles of the 90 and the 50 % interval, and their opacity."""

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "pbrdf_bayes", "text.parse_math": False,
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 10.5,
    "figure.dpi": 72, "path.simplify": True, "path.simplify_threshold": 0.15,
    "axes.spines.left": False, "axes.spines.right": False, "axes.spines.top": False,
    "axes.edgecolor": FAINT, "axes.labelcolor": INK, "axes.labelsize": 10.5, "axes.labelpad": 3,
    "axes.titlesize": 10.5, "axes.titlecolor": INK, "axes.titley": 1.0, "axes.titlepad": 7,
    "axes.titlelocation": "left", "axes.grid": True, "axes.axisbelow": True, "axes.xmargin": 0,
    "axes.formatter.useoffset": False, "axes.formatter.limits": (-5, 6), "grid.color": GRID,
    "xtick.labelsize": 10.5, "ytick.labelsize": 10.5, "xtick.color": MUTED, "ytick.color": MUTED,
    "xtick.major.size": 0, "ytick.major.size": 0, "xtick.major.pad": 5, "ytick.major.pad": 5,
    "lines.linewidth": 1.3, "lines.markeredgewidth": 0, "lines.scale_dashes": False,
}  # fmt: skip
"""Settings of matplotlib that every figure relies on; all others are matplotlib's own defaults."""


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw under the defaults of matplotlib and `STYLE`, whatever the user's settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def new_axes(width: float, height: float, *boxes: tuple[float, float, float, float]) -> list[Axes]:
    """Axes in a new figure of this size [px], in boxes of left, bottom, width, height [px].

    One box with room for labels where none is given.
    """
    figure = Figure(figsize=(width / 72, height / 72))
    places = boxes or ((48.0, 38.0, width - 58.0, height - 64.0),)
    return [
        figure.add_axes((x / width, y / height, w / width, h / height)) for x, y, w, h in places
    ]


def figure_of(axes: Axes) -> Figure:
    """Figure that holds the axes."""
    figure = axes.get_figure(root=True)
    assert figure is not None, "axes outside a figure"
    return figure


def emptied(panels: Sequence[Axes]) -> Sequence[Axes]:
    """Remove what is drawn in the axes: pictures of one layout share them to save time."""
    for axes in panels:
        for artist in (*axes.lines, *axes.collections, *axes.texts):
            artist.remove()
    return panels


def name_axes(
    axes: Axes, x: str, y: str, *, beside: float = 42.0, above: float = 10.0
) -> None:  # fmt: skip
    """Quantity of x below; that of y above, to be read without turning the head."""
    axes.set_xlabel(x, va="baseline")
    axes.set_ylabel(y, rotation="horizontal", ha="left", va="baseline")
    figure, frame = figure_of(axes), axes.transAxes
    low = offset_copy(frame, figure, 0.0, -28.0, units="points")
    high = offset_copy(frame, figure, -beside, above, units="points")
    axes.xaxis.set_label_coords(0.5, 0.0, transform=low)
    axes.yaxis.set_label_coords(0.0, 1.0, transform=high)


def angles(axis: Axis, *ticks: float) -> None:
    """Ticks in degrees, where matplotlib chooses if none are given."""
    if ticks:
        axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter("{x:g}°")


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Axis of y from ``low`` to ``high`` > 0 with plain numbers: decades, or 1-2-5 where few."""
    axes.set_yscale("log", nonpositive="mask")
    axes.set_ylim(low, high)
    many = floor(log10(high)) - ceil(log10(low)) > 1
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if many else (1.0, 2.0, 5.0), numticks=7))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    axes.yaxis.set_minor_locator(NullLocator())


def mark_specular(axes: Axes, theta_r_deg: float) -> None:
    """Line and word at the specular direction."""
    axes.axvline(theta_r_deg, color=FAINT, lw=0.9)
    axes.annotate(
        "specular", (theta_r_deg, 1), (0, 4), axes.get_xaxis_transform(), "offset points",
        fontsize=9, color=MUTED, ha="right" if theta_r_deg > 65 else "center",
    )  # fmt: skip


def positive(values: Any) -> Array:
    """NaN for what has no logarithm."""
    values = np.asarray(values, dtype=np.float64)
    return np.where(values > 0, values, np.nan)


def limits(*values: Any, pad: float = 0.05, least: float = 0.0) -> tuple[float, float]:
    """Range of everything finite, widened by ``pad`` and to at least ``least``."""
    joined = np.concatenate([np.zeros(0), *(np.ravel(np.asarray(v, float)) for v in values)])
    finite = joined[np.isfinite(joined)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    extra = max(pad * (high - low), (least - (high - low)) / 2, 1e-12 + 1e-9 * abs(high))
    return low - extra, high + extra


def thinned(values: Array, most: int) -> NDArray[np.int64]:
    """Rows to draw so that no outlier is lost: the ends of each of ``most / 2`` bins."""
    if values.size <= most:
        return np.arange(values.size)
    known = np.nan_to_num(values)
    bins = np.array_split(np.arange(values.size), most // 2)
    return np.unique([row for b in bins for row in (b[known[b].argmin()], b[known[b].argmax()])])


def dots(axes: Axes, x: Array, y: Array, look: Look, *, size: float, alpha: float = 1.0) -> None:
    """Readings."""
    size *= {"D": 0.8, "s": 0.9}.get(look.marker, 1.0)
    axes.plot(x, y, look.marker, color=look.color, markersize=size, alpha=alpha)


def shade(axes: Axes, x: Array, low: Array, high: Array, color: str, alpha: float) -> None:
    """Area between two curves, interrupted where either is not finite; limits are set before.

    Points that move no outline are left out: matplotlib writes every point of an area.
    """
    area = axes.fill_between(x, low, high, color=color, alpha=alpha, linewidth=0)
    to_pixels = axes.transData
    back = to_pixels.inverted()
    for path in area.get_paths():
        cleaned = to_pixels.transform_path(path).cleaned(simplify=True)
        vertices, codes = np.asarray(cleaned.vertices), np.asarray(cleaned.codes)
        kept = np.isin(codes, (Path.MOVETO, Path.LINETO))
        path.vertices, path.codes = back.transform(vertices[kept]), codes[kept]


def draw_bands(
    axes: Axes, x: Array, color: str, *, model: Array | None, predictive: Array | None = None
) -> None:
    """Bands of shape (n_x, 5): that of the model shaded, the predictive one outlined."""
    if predictive is not None:
        axes.plot(x, predictive[:, [0, 4]], color=color, lw=0.75, linestyle=(0, (2.0, 1.6)))
    if model is not None:
        for low, high, alpha in BANDS:
            shade(axes, x, model[:, low], model[:, high], color, alpha)
