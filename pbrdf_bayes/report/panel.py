"""One small plot: a rectangle in a matplotlib figure, data limits, and few marks with good manners.

A report holds some sixty plots. ``matplotlib.axes.Axes`` spends 50 ms on each, nearly all of it on
ticks it may never show; a `Panel` places the same artists on the figure itself and takes 5 to 10.
Units of the figure are CSS pixels, y upwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform, TransformedBbox
from numpy.typing import NDArray

from pbrdf_bayes.report.numbers import fixed, number

Array = NDArray[np.float64]

INK, MUTED, FAINT, GRID = "#1c2126", "#59636e", "#9aa4ae", "#e6e9ec"
TEXT_SIZE = 10.5
CHARACTER = 5.6
"""Width of a digit at `TEXT_SIZE`, to leave out labels that would touch."""


@dataclass(frozen=True)
class Look:
    """How a polarisation is drawn: never by colour alone."""

    word: str
    color: str
    dash: tuple[float, ...]
    square: bool


LOOKS = {
    "s": Look("s", "#0067a5", (), square=False),
    "p": Look("p", "#c24d00", (5.0, 2.5), square=True),
    "u": Look("unpolarised (u)", "#00745a", (7.0, 2.0, 1.5, 2.0), square=False),
}
"""Blue, vermilion and green after Okabe and Ito, darkened to be read on white paper."""

ENSEMBLE_LOOKS: tuple[tuple[str, tuple[float, ...]], ...] = (
    ("#0067a5", ()),
    ("#c24d00", (5.0, 2.0)),
    ("#00745a", (1.5, 1.5)),
    ("#a3417f", (7.0, 2.0, 1.5, 2.0)),
)


def new_figure(width: float, height: float) -> Figure:
    """Empty figure of this size in CSS pixels."""
    return Figure(figsize=(width / 72, height / 72), dpi=72)


@dataclass(frozen=True, eq=False)
class Panel:
    """Part of a figure with its own coordinates.

    Attributes
    ----------
    figure : Figure
    left, bottom, width, height : float
        Rectangle [px].
    x, y : tuple of float
        Limits of the data; logarithms where the axis is to be logarithmic.
    """

    figure: Figure
    left: float
    bottom: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def transform(self) -> Affine2D:
        """From data to pixels."""
        scale_x = self.width / (self.x[1] - self.x[0])
        scale_y = self.height / (self.y[1] - self.y[0])
        return Affine2D.from_values(
            scale_x, 0, 0, scale_y,
            self.left - scale_x * self.x[0], self.bottom - scale_y * self.y[0],
        )  # fmt: skip

    def fill(self, x: Array, low: Array, high: Array, color: str, alpha: float) -> None:
        """Area between two curves, interrupted where either is not finite."""
        good = np.isfinite(low) & np.isfinite(high)
        polygons: list[Path] = []
        for run in np.split(np.arange(x.size), np.flatnonzero(np.diff(good)) + 1):
            if run.size < 2 or not good[run[0]]:
                continue
            there, back = self._simple(x[run], low[run]), self._simple(x[run], high[run])
            polygons.append(Path(np.concatenate([there, back[::-1]]), closed=False))
        if polygons:
            patch = PathPatch(
                Path.make_compound_path(*polygons), facecolor=color, alpha=alpha, lw=0
            )
            self._add(patch, in_pixels=True)

    def area(self, path: Path, color: str, alpha: float) -> None:
        """Fill an outline in data coordinates."""
        self._add(PathPatch(path, facecolor=color, edgecolor=color, lw=0.8, alpha=alpha))

    def line(
        self, x: Any, y: Any, color: str = INK, width: float = 1.2, dash: Sequence[float] = ()
    ) -> None:
        """Curve through points; a gap where one is not finite."""
        path = Path(np.column_stack([np.asarray(x, float), np.asarray(y, float)]))
        style = (0, [d / width for d in dash]) if dash else "-"
        self._add(PathPatch(path, fill=False, ec=color, lw=width, ls=style, joinstyle="round"))

    def dots(
        self,
        x: Array,
        y: Array,
        color: str,
        *,
        size: float = 2.8,
        square: bool = False,
        alpha: float = 1.0,
    ) -> None:
        """Points as short lines, a tenth of the bytes: discs are caps of lines without length."""
        good = np.isfinite(x) & np.isfinite(y)
        if not good.any():
            return
        at = np.repeat(self.transform.transform(np.column_stack([x[good], y[good]])), 2, axis=0)
        side = 0.85 * size if square else 0.0
        at[0::2, 0] -= side / 2
        at[1::2, 0] += side / 2
        path = Path(at, np.tile([Path.MOVETO, Path.LINETO], at.shape[0] // 2))
        path.should_simplify = False
        cap, width = ("butt", side) if square else ("round", size)
        patch = PathPatch(path, fill=False, ec=color, lw=width, capstyle=cap, alpha=alpha)
        self._add(patch, in_pixels=True)

    def segments(
        self, ends: Sequence[tuple[float, float, float, float]], color: str = GRID,
        width: float = 0.8, dash: Sequence[float] = (), *, clip: bool = True,
    ) -> None:  # fmt: skip
        """Straight lines (x0, y0, x1, y1), one artist for all."""
        if not ends:
            return
        at = np.asarray(ends, float).reshape(-1, 2)
        path = Path(at, np.tile([Path.MOVETO, Path.LINETO], len(ends)))
        style = (0, [d / width for d in dash]) if dash else "-"
        self._add(PathPatch(path, fill=False, ec=color, lw=width, ls=style), clip=clip)

    def words(
        self, x: float, y: float, text: str, *, color: str = MUTED, size: float = TEXT_SIZE,
        align: str = "center", italic: bool = False,
    ) -> None:  # fmt: skip
        """Text with its baseline at pixels measured from the lower left corner of the panel."""
        self._add(
            Text(self.left + x, self.bottom + y, text, color=color, fontsize=size, ha=align,
                 va="baseline", fontstyle="italic" if italic else "normal"),
            in_pixels=True, clip=False,
        )  # fmt: skip

    def x_axis(self, ticks: Sequence[float], labels: Sequence[str], title: str = "") -> None:
        """Grid, base line, numbers and the quantity below them."""
        (low, high), (bottom, top) = self.x, self.y
        self.segments([(t, bottom, t, top) for t in ticks if low <= t <= high])
        self.segments([(low, bottom, high, bottom)], color=FAINT, clip=False)
        end = -self.width
        for tick, label in zip(ticks, labels, strict=True):
            at, half = self.width * (tick - low) / (high - low), CHARACTER * len(label) / 2
            if low <= tick <= high and at - half >= end:
                self.words(at, -13, label)
                end = at + half + CHARACTER if label else end
        if title:
            self.words(self.width / 2, -28, title, color=INK)

    def y_axis(self, ticks: Sequence[float], labels: Sequence[str], title: str = "") -> None:
        """Grid, numbers and the quantity above them, to be read without turning the head."""
        (low, high), (left, right) = self.y, self.x
        self.segments([(left, t, right, t) for t in ticks if low <= t <= high])
        for tick, label in zip(ticks, labels, strict=True):
            if low <= tick <= high:
                self.words(
                    -6, self.height * (tick - low) / (high - low) - 3.6, label, align="right"
                )
        if title:
            self.words(-self.left + 2, self.height + 9, title, color=INK, align="left")

    def _simple(self, x: Array, y: Array) -> Array:
        """Pixels of a curve without the points that a straight line passes through anyway."""
        pixels = self.transform.transform(np.column_stack([x, y]))
        margin = 4 * (self.height + self.width)
        pixels = np.clip(pixels, -margin, margin)
        cleaned = Path(pixels).cleaned(simplify=True)
        vertices = np.asarray(cleaned.vertices, dtype=np.float64)
        return np.asarray(vertices[cleaned.codes != Path.STOP])

    def _add(self, artist: Artist, *, in_pixels: bool = False, clip: bool = True) -> None:
        artist.set_transform(IdentityTransform() if in_pixels else self.transform)
        self.figure.add_artist(artist, clip=False)
        if clip:
            box = Bbox.from_bounds(self.left, self.bottom, self.width, self.height)
            artist.set_clip_box(TransformedBbox(box, IdentityTransform()))


def linear_ticks(low: float, high: float, *, least: int = 3) -> tuple[list[float], list[str]]:
    """Round numbers inside [low, high], ``least`` to about six of them, and how they are written.

    Examples
    --------
    >>> linear_ticks(-0.011, 0.012)
    ([-0.01, 0.0, 0.01], ['−0.01', '0', '0.01'])
    >>> linear_ticks(1.5221, 1.5299)[1]
    ['1.524', '1.526', '1.528']
    """
    span = high - low
    if not span > 0:
        return [low], [number(low)]
    power = 10.0 ** floor(log10(span))
    for factor in (5.0, 2.0, 1.0, 0.5, 0.25):
        step = factor * power
        index = range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)
        if len(index) >= least:
            break
    decimals = max(0, round(-log10(power)) + {0.5: 1, 0.25: 2}.get(factor, 0))
    ticks = [round(i * step, 12) for i in index]
    return ticks, ["0" if t == 0 else fixed(t, decimals) for t in ticks]


def log_ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Ticks of an axis of decimal logarithms: decades, or 1-2-5 where there are few of them.

    Examples
    --------
    >>> log_ticks(-3.2, -0.9)
    ([-3.0, -2.0, -1.0], ['0.001', '0.01', '0.1'])
    >>> log_ticks(-2.2, -1.2)[1]
    ['0.01', '0.02', '0.05']
    """
    decades = range(floor(low), ceil(high) + 1)
    every = max(1, ceil((high - low) / 6))
    factors = (1,) if high - low > 1.6 else (1, 2, 5) if high - low > 0.5 else range(1, 10)
    chosen = [(f, d) for d in decades if d % every == 0 for f in factors]
    inside = [(f, d) for f, d in chosen if low - 1e-9 <= log10(f) + d <= high + 1e-9]
    return [log10(f) + d for f, d in inside], [number(f * 10.0**d) for f, d in inside]


def log10_or_gap(values: Any) -> Array:
    """Decimal logarithm, NaN for what has none."""
    values = np.asarray(values, dtype=np.float64)
    positive = np.where(values > 0, values, np.nan)
    return np.asarray(np.log10(positive))


def limits(*values: Any, pad: float = 0.05, least: float = 0.0) -> tuple[float, float]:
    """Range of everything finite, widened by ``pad`` and to at least ``least``."""
    joined = np.concatenate(
        [np.ravel(np.asarray(v, dtype=np.float64)) for v in values] or [np.zeros(0)]
    )
    finite = joined[np.isfinite(joined)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    extra = max(pad * (high - low), (least - (high - low)) / 2, 1e-12 + 1e-9 * abs(high))
    return low - extra, high + extra


def theta_ticks() -> tuple[list[float], list[str]]:
    """Ticks of a signed scattering angle [deg]."""
    return [-60, -30, 0, 30, 60], ["−60°", "−30°", "0°", "30°", "60°"]
