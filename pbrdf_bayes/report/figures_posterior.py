"""The posterior: pairs of parameters against their priors, and the agreement of the ensembles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from contourpy import FillType, contour_generator
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.path import Path
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.stats import rankdata

from pbrdf_bayes.report.figures_brdf import WIDTH
from pbrdf_bayes.report.figures_planes import Picture
from pbrdf_bayes.report.numbers import rounded, symbol_markup
from pbrdf_bayes.report.panel import (
    ENSEMBLE_LOOKS,
    FAINT,
    INK,
    MUTED,
    Panel,
    linear_ticks,
    new_figure,
)
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]
CELL, GAP, LEFT, BELOW = 136.0, 18.0, 62.0, 40.0
MARGINAL, JOINT = 70, 44
"""Bins of the one- and the two-dimensional histograms before smoothing."""
SHADE = "#2b5d86"


@dataclass(frozen=True, eq=False)
class Sample:
    """Draws of one parameter, shape (n_chain, n_draw), with what the corner plot writes."""

    name: str
    symbol: str
    posterior: Array
    prior: Array
    map: float | None

    @property
    def view(self) -> tuple[float, float]:
        """Limits of the axes: all but a permille of the draws, nothing beyond the last."""
        flat = self.posterior[np.isfinite(self.posterior)]
        if flat.size == 0 or not flat.max() > flat.min():
            middle = float(flat[0]) if flat.size else 0.0
            return middle - 0.5, middle + 0.5
        low, high = np.quantile(flat, [0.0005, 0.9995]).tolist()
        pad = 0.04 * (high - low)
        return max(low - pad, float(flat.min())), min(high + pad, float(flat.max()))


def corner_picture(samples: Sequence[Sample]) -> Picture:
    """Marginal densities with the prior on the diagonal, joint densities below it."""
    n = len(samples)
    size = LEFT + n * CELL + (n - 1) * GAP + 12, BELOW + n * CELL + (n - 1) * GAP + 20
    figure = new_figure(*size)
    for row, y in enumerate(samples):
        for column, x in enumerate(samples[: row + 1]):
            left = LEFT + column * (CELL + GAP)
            bottom = BELOW + (n - 1 - row) * (CELL + GAP)
            box = (left, bottom, CELL, CELL)
            if row == column:
                _marginal(figure, box, x, last=row == n - 1)
            else:
                _joint(figure, box, x, y, first=column == 0, last=row == n - 1)
    label = "Posterior of " + "; ".join(_label(s) for s in samples)
    return Picture(inline_svg(figure, name="corner", label=label), "Posterior and prior")


def chain_pictures(samples: Sequence[Sample], ensembles: NDArray[np.int64]) -> list[Picture]:
    """Return traces and rank histograms by ensemble, one panel per parameter."""
    found = []
    for i, sample in enumerate(samples):
        if sample.posterior.size == 0:
            continue
        figure = new_figure(WIDTH, 128)
        _trace(figure, sample, ensembles)
        spread = _ranks(figure, sample, ensembles)
        n = np.unique(ensembles).size
        label = (
            f"Trace and ranks of {sample.symbol} in {n} ensembles: the ranks of one ensemble "
            f"deviate from uniform by at most {100 * spread:.0f} %"
        )
        svg = inline_svg(figure, name=f"chain{i}", label=label)
        title = Markup('<span class="sym">{}</span>').format(symbol_markup(sample.symbol))
        found.append(Picture(svg, title))
    return found


def _marginal(
    figure: Figure, box: tuple[float, float, float, float], x: Sample, *, last: bool
) -> None:
    low, high = x.view
    posterior, prior = _density(x.posterior, x.view, 1.6), _density(x.prior, x.view, 4.0)
    top = 1.12 * max(posterior.max(initial=0.0), prior.max(initial=0.0), 1e-300)
    panel = Panel(figure, *box, x=(low, high), y=(0.0, top))
    _x_ticks(panel, x, labels=last)
    centres = np.linspace(low, high, MARGINAL)
    panel.fill(centres, np.zeros(MARGINAL), posterior, SHADE, 0.25)
    panel.line(centres, posterior, SHADE, 1.3)
    panel.line(centres, prior, MUTED, 1.3, (4.0, 2.5))
    if x.map is not None and low < x.map < high:
        panel.segments([(x.map, 0, x.map, top)], INK, 0.9, (1.5, 1.5))
    panel.words(CELL / 2, CELL + 6, x.symbol, color=INK, size=14, italic=True)


def _joint(
    figure: Figure, box: tuple[float, float, float, float], x: Sample, y: Sample,
    *, first: bool, last: bool,
) -> None:  # fmt: skip
    panel = Panel(figure, *box, x=x.view, y=y.view)
    _x_ticks(panel, x, labels=last)
    ticks, labels = _inner_ticks(y.view)
    panel.y_axis(ticks, labels if first else [""] * len(ticks))
    if first:
        panel.words(-LEFT + 2, CELL, y.symbol, color=INK, size=14, italic=True, align="left")
    panel.segments([(x.view[0], y.view[0], x.view[0], y.view[1])], color=FAINT, clip=False)
    density = _histogram(x, y)
    for level, alpha in zip(_levels(density), (0.18, 0.5), strict=True):
        for path in _areas(density, x.view, y.view, level):
            panel.area(path, SHADE, alpha)
    if x.map is not None and y.map is not None:
        panel.dots(np.array([x.map]), np.array([y.map]), INK, size=4.0)


def _x_ticks(panel: Panel, x: Sample, *, labels: bool) -> None:
    ticks, words = _inner_ticks(x.view)
    panel.x_axis(ticks, words if labels else [""] * len(ticks))
    if labels:
        panel.words(CELL / 2, -30, x.symbol, color=INK, size=14, italic=True)


def _inner_ticks(view: tuple[float, float]) -> tuple[list[float], list[str]]:
    """Ticks whose labels stay clear of the neighbouring panels."""
    margin = 0.07 * (view[1] - view[0])
    return linear_ticks(view[0] + margin, view[1] - margin, least=2)


def _density(draws: Array, view: tuple[float, float], width: float) -> Array:
    """Smoothed histogram; mirrored at the ends, so that a bound keeps its step."""
    flat = draws[np.isfinite(draws)]
    if flat.size == 0:
        return np.zeros(MARGINAL)
    counts, edges = np.histogram(flat, bins=MARGINAL, range=view)
    smooth = gaussian_filter1d(counts.astype(np.float64), width, mode="nearest")
    return np.asarray(smooth / (flat.size * (edges[1] - edges[0])))


def _histogram(x: Sample, y: Sample) -> Array:
    counts, _, _ = np.histogram2d(
        x.posterior.ravel(), y.posterior.ravel(), bins=JOINT, range=(x.view, y.view)
    )
    return np.asarray(gaussian_filter(counts, 1.5, mode="nearest"))


def _levels(density: Array) -> list[float]:
    """Density above which 90 and 50 % of the draws lie."""
    ordered = np.sort(density.ravel())[::-1]
    share = np.cumsum(ordered) / max(ordered.sum(), 1e-300)
    rows = np.searchsorted(share, (0.9, 0.5)).clip(0, share.size - 1)
    return [float(ordered[row]) for row in rows]


def _areas(
    density: Array, x: tuple[float, float], y: tuple[float, float], level: float
) -> list[Path]:
    """Outlines of the density above a level."""
    centres = [np.linspace(*view, 2 * JOINT + 1)[1::2] for view in (x, y)]
    generator = contour_generator(
        x=centres[0], y=centres[1], z=density.T, fill_type=FillType.OuterCode
    )
    points, codes, *_ = generator.filled(level, 2 * float(density.max()) + 1.0)
    pairs = zip(points, codes, strict=True)
    return [Path(p, c) for p, c in pairs if p is not None and c is not None]


def _trace(figure: Figure, sample: Sample, ensembles: NDArray[np.int64]) -> None:
    """Median and 90 % range of the walkers of each ensemble along the run."""
    n_draw = sample.posterior.shape[1]
    panel = Panel(figure, 52, 34, 166, 84, (0, max(n_draw - 1, 1)), sample.view)
    panel.x_axis(*linear_ticks(0, max(n_draw - 1, 1)), "draw")
    panel.y_axis(*linear_ticks(*sample.view, least=2))
    steps = np.array_split(np.arange(n_draw), min(n_draw, 60))
    middle = np.array([s.mean() for s in steps])
    for i, ensemble in enumerate(np.unique(ensembles)):
        color, dash = ENSEMBLE_LOOKS[i % len(ENSEMBLE_LOOKS)]
        chains = sample.posterior[ensembles == ensemble]
        q = np.array([np.quantile(chains[:, s], [0.05, 0.5, 0.95]) for s in steps])
        panel.line(middle, q[:, 1], color, 1.3, dash)
        for k in (0, 2):
            panel.line(middle, q[:, k], color, 0.5)


def _ranks(figure: Figure, sample: Sample, ensembles: NDArray[np.int64]) -> float:
    """Histogram of the ranks of each ensemble among all draws; the largest deviation from 1."""
    ranks = rankdata(sample.posterior).reshape(sample.posterior.shape) / sample.posterior.size
    panel = Panel(figure, 252, 34, 82, 84, (0.0, 1.0), (0.0, 2.0))
    panel.x_axis([0, 0.5, 1], ["0", "½", "1"], "rank")
    panel.y_axis([0, 1, 2], ["0", "1", "2"])
    worst = 0.0
    for i, ensemble in enumerate(np.unique(ensembles)):
        color, dash = ENSEMBLE_LOOKS[i % len(ENSEMBLE_LOOKS)]
        mine = ranks[ensembles == ensemble]
        counts, edges = np.histogram(mine, bins=10, range=(0, 1))
        relative = counts * 10 / mine.size
        worst = max(worst, float(np.abs(relative - 1).max()))
        panel.line(np.repeat(edges, 2)[1:-1], np.repeat(relative, 2), color, 1.1, dash)
    return worst


def _label(sample: Sample) -> str:
    flat = sample.posterior[np.isfinite(sample.posterior)]
    if flat.size == 0:
        return f"{sample.symbol}: no draws"
    low, high = np.quantile(flat, [0.025, 0.975])
    r = rounded(flat.mean(), flat.std(), low=low, high=high)
    return f"{sample.symbol} {r.value} ± {r.uncertainty} (95 % {r.low} to {r.high})"
