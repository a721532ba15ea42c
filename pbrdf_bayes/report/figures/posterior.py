"""The posterior: parameters and priors, agreement of the ensembles, places of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.stats import kstwo, rankdata

from pbrdf_bayes.report.arrays import ScanPlaces
from pbrdf_bayes.report.figures.axes import WIDTH, emptied, figure_of, name_axes, new_axes
from pbrdf_bayes.report.figures.looks import (
    ALARM,
    ENSEMBLES,
    FAINT,
    INK,
    LOOKS,
    MUTED,
    SHADE,
    Picture,
)
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import count, fixed, number, rounded, symbol_markup
from pbrdf_bayes.verdict import FALSE_ALARM

Array = NDArray[np.float64]

MARGINAL, JOINT = 70, 44
"""Bins of the one- and the two-dimensional histograms before smoothing."""
MOST_DRAWS = 40_000
"""Draws of a parameter that figures use at most, evenly thinned along the chains."""
MOST_SCANS, COLUMNS = 20, 5
_SYMBOL: dict[str, Any] = {"fontsize": 14, "fontstyle": "italic"}


@dataclass(frozen=True, eq=False)
class Sample:
    """Draws of one parameter, shape (n_chain, n_draw), every ``step``-th of the run."""

    name: str
    symbol: str
    posterior: Array
    prior: Array
    map: float | None
    step: int = 1

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


# ------------------------------------------------------------------------------------------ corner


def plot_posterior(axes: Axes, x: Sample) -> Axes:
    """Draw the marginal density of a parameter, its prior (dashed) and the MAP (dotted)."""
    for draws, width, color, line in (
        (x.prior, 4.0, MUTED, (0, (4.0, 2.5))), (x.posterior, 1.6, SHADE, "-")
    ):  # fmt: skip
        centres, density = _density(draws, x.view, width)
        axes.plot(centres, density, color=color, linestyle=line)
    axes.fill_between(centres, density, color=SHADE, alpha=0.25, linewidth=0)
    if x.map is not None:
        axes.axvline(x.map, color=INK, lw=0.9, linestyle=(0, (1.5, 1.5)))
    axes.set(xlim=x.view, yticks=())
    axes.set_ylim(0.0, 1.06 * axes.get_ylim()[1])
    axes.set_xlabel(x.symbol, **_SYMBOL)
    return axes


def plot_joint(axes: Axes, x: Sample, y: Sample) -> Axes:
    """Draw where 50 and 90 % of the draws of two parameters lie, and their MAP."""
    counts, x_edges, y_edges = np.histogram2d(
        x.posterior.ravel(), y.posterior.ravel(), bins=JOINT, range=(x.view, y.view)
    )
    density = gaussian_filter(counts, 1.5, mode="nearest")
    low, high = _levels(density)
    if 0.0 < low < high < density.max():
        axes.contourf(
            x_edges[:-1] + np.diff(x_edges) / 2, y_edges[:-1] + np.diff(y_edges) / 2, density.T,
            levels=[low, high, 2.0 * density.max()],
            colors=[to_rgba(SHADE, 0.2), to_rgba(SHADE, 0.6)],
        )  # fmt: skip
    if x.map is not None and y.map is not None:
        axes.plot(x.map, y.map, "o", color=INK, markersize=4)
    axes.set(xlim=x.view, ylim=y.view)
    axes.set_xlabel(x.symbol, **_SYMBOL)
    axes.set_ylabel(y.symbol, **_SYMBOL)
    return axes


def corner_picture(samples: Sequence[Sample]) -> Picture:
    """Marginal densities with the prior on the diagonal, joint densities below it."""
    n, cell, gap, left, below = len(samples), 136.0, 18.0, 62.0, 44.0
    places = [(row, column) for row in range(n) for column in range(row + 1)]
    boxes = [
        (left + column * (cell + gap), below + (n - 1 - row) * (cell + gap), cell, cell)
        for row, column in places
    ]
    size = n * (cell + gap) - gap
    panels = new_axes(left + size + 12, below + size + 22, *boxes)
    for (row, column), axes in zip(places, panels, strict=True):
        x, y = samples[column], samples[row]
        plot_posterior(axes, x) if row == column else plot_joint(axes, x, y)
        axes.locator_params("x", nbins=3, steps=[1, 2, 5, 10], prune="both")
        if row == column:
            axes.set_title(x.symbol, loc="center", **_SYMBOL)
        else:
            axes.locator_params("y", nbins=4, prune="both")
            axes.spines["left"].set_visible(True)
            axes.set_ylabel(y.symbol, rotation="horizontal", ha="left", va="top", **_SYMBOL)
            axes.yaxis.set_label_coords(-60 / cell, 1.0)
        if row < n - 1:
            axes.tick_params(labelbottom=False)
            axes.set_xlabel("")
        if column:
            axes.tick_params(labelleft=False)
            axes.set_ylabel("")
    label = "Posterior of " + "; ".join(_label(s) for s in samples)
    svg = inline_svg(figure_of(panels[0]), name="corner", label=label)
    return Picture(svg, "Posterior and prior")


def _density(draws: Array, view: tuple[float, float], width: float) -> tuple[Array, Array]:
    """Smoothed histogram; mirrored at the ends, so that a bound keeps its step."""
    flat = draws[np.isfinite(draws)]
    counts, edges = np.histogram(flat, bins=MARGINAL, range=view)
    smooth = gaussian_filter1d(counts.astype(np.float64), width, mode="nearest")
    return np.linspace(*view, MARGINAL), smooth / max(flat.size * (edges[1] - edges[0]), 1e-300)


def _levels(density: Array) -> list[float]:
    """Density above which 90 and 50 % of the draws lie."""
    ordered = np.sort(density.ravel())[::-1]
    share = np.cumsum(ordered) / max(ordered.sum(), 1e-300)
    rows = np.searchsorted(share, (0.9, 0.5)).clip(0, share.size - 1)
    return [float(ordered[row]) for row in rows]


def _label(sample: Sample) -> str:
    flat = sample.posterior[np.isfinite(sample.posterior)]
    if flat.size == 0:
        return f"{sample.symbol}: no draws"
    low, high = np.quantile(flat, [0.025, 0.975])
    r = rounded(flat.mean(), flat.std(), low=low, high=high)
    return f"{sample.symbol} {r.value} ± {r.uncertainty} (95 % {r.low} to {r.high})"


# ------------------------------------------------------------------------------------------ chains


def plot_trace(axes: Axes, sample: Sample, ensembles: NDArray[np.int64]) -> Axes:
    """Draw median and 90 % range of the walkers of each ensemble along the run."""
    n_draw = sample.posterior.shape[1]
    steps = np.array_split(np.arange(n_draw), min(n_draw, 60))
    middle = sample.step * np.array([s.mean() for s in steps])
    for i, ensemble in enumerate(np.unique(ensembles)):
        look, chains = ENSEMBLES[i % len(ENSEMBLES)], sample.posterior[ensembles == ensemble]
        q = np.array([np.quantile(chains[:, s], [0.05, 0.5, 0.95]) for s in steps])
        axes.plot(middle, q[:, 1], **look.line)
        axes.plot(middle, q[:, [0, 2]], color=look.color, lw=0.5)
    axes.set(xlim=(0, sample.step * max(n_draw - 1, 1)), ylim=sample.view)
    name_axes(axes, "draw", "")
    return axes


def plot_ranks(axes: Axes, ranks: Sequence[Array]) -> Axes:
    """Draw the histogram of the ranks of each ensemble among all draws, relative to uniform."""
    for i, relative in enumerate(ranks):
        edges = np.repeat(np.linspace(0, 1, relative.size + 1), 2)[1:-1]
        axes.plot(edges, np.repeat(relative, 2), lw=1.1, **ENSEMBLES[i % len(ENSEMBLES)].line)
    axes.set(xlim=(0, 1), ylim=(0, 2), yticks=(0, 1, 2))
    name_axes(axes, "rank", "")
    axes.set_xticks([0, 0.5, 1], ["0", "½", "1"])
    return axes


def chain_pictures(samples: Sequence[Sample], ensembles: NDArray[np.int64]) -> list[Picture]:
    """Return traces and rank histograms by ensemble, one picture per parameter."""
    found, panels = [], new_axes(WIDTH, 128, (52, 34, 166, 84), (252, 34, 82, 84))
    for i, sample in enumerate(samples):
        left, right = emptied(panels)
        plot_trace(left, sample, ensembles)
        ranks = _relative_ranks(sample, ensembles)
        plot_ranks(right, ranks)
        spread = max(float(np.abs(r - 1).max()) for r in ranks)
        label = (
            f"Trace and ranks of {sample.symbol} in {len(ranks)} ensembles: the ranks of one "
            f"ensemble deviate from uniform by at most {100 * spread:.0f} %"
        )
        svg = inline_svg(figure_of(left), name=f"chain{i}", label=label)
        title = Markup('<span class="sym">{}</span>').format(symbol_markup(sample.symbol))
        found.append(Picture(svg, title))
    return found


def _relative_ranks(sample: Sample, ensembles: NDArray[np.int64]) -> list[Array]:
    """Shares of the ranks of each ensemble in ten bins, times ten."""
    ranks = rankdata(sample.posterior).reshape(sample.posterior.shape) / sample.posterior.size
    parts = [ranks[ensembles == ensemble] for ensemble in np.unique(ensembles)]
    return [np.histogram(part, bins=10, range=(0, 1))[0] * 10 / part.size for part in parts]


# ------------------------------------------------------------------------------ places of readings


def plot_places(axes: Axes, scan: ScanPlaces, *, n_scans: int = 1) -> Axes:
    """Draw the distribution of the places of a scan minus uniform, and the 99 % envelope."""
    band, look, n = _critical(scan, n_scans), LOOKS[scan.polarization], scan.pit.size
    grid = np.linspace(0.0, 1.0, 61)
    axes.fill_between(grid, np.maximum(-band, -grid), np.minimum(band, 1.0 - grid),
                      color=FAINT, alpha=0.22, linewidth=0)  # fmt: skip
    axes.axhline(0.0, color=MUTED, lw=0.8)
    keep = np.unique(np.linspace(0, n - 1, min(n, 160)).round().astype(int))
    y = (keep + 0.5) / n - scan.pit[keep]
    axes.plot([0.0, *scan.pit[keep], 1.0], [0.0, *y, 0.0], lw=1.6, **look.line)
    axes.set(xlim=(0, 1), xticks=(0, 0.5, 1))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_title(scan.label)
    distance = _distance(scan)
    axes.set_title(f"{count(n)} · distance {fixed(distance, 2)}", loc="right", fontsize=9,
                   color=ALARM if distance > band else MUTED)  # fmt: skip
    return axes


def places_picture(scans: Sequence[ScanPlaces]) -> Picture | None:
    """Small multiples of the scans least like chance, all on the same axes; None without scans."""
    if not scans:
        return None
    order = np.argsort([s.p_value for s in scans], kind="stable")[:MOST_SCANS]
    shown = [scans[i] for i in sorted(order.tolist())]
    most = [max(_critical(s, len(scans)), _distance(s)) for s in shown]
    reach = min(1.25 * max(most), 1.0)
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    boxes = [(42.0 + 168.0 * (i % columns), 36.0 + 108.0 * (rows - 1 - i // columns), 148.0, 74.0)
             for i in range(len(shown))]  # fmt: skip
    panels = new_axes(32.0 + 168.0 * columns, 48.0 + 108.0 * rows, *boxes)
    for i, (axes, scan) in enumerate(zip(panels, shown, strict=True)):
        plot_places(axes, scan, n_scans=len(scans))
        axes.set_ylim(-reach, reach)
        axes.tick_params(labelleft=i % columns == 0, labelbottom=i + columns >= len(shown))
    name_axes(panels[0], "", "share of readings − uniform", beside=40, above=27)
    panels[(rows - 1) * columns].set_xlabel("place in the predicted law")
    outside = sum(_distance(s) > _critical(s, len(scans)) for s in shown)
    label = (
        f"Distribution of the readings of {len(shown)} scans in what all others predict, minus "
        f"uniform: {outside} outside the 99 % envelope; "
        + "; ".join(f"{s.label}: distance {number(_distance(s), digits=2)}" for s in shown)
    )
    return Picture(inline_svg(figure_of(panels[0]), name="pit", label=label), "")


def _distance(scan: ScanPlaces) -> float:
    """Kolmogorov distance of the places from the uniform distribution."""
    n = scan.pit.size
    return float(np.abs((np.arange(n) + 0.5) / n - scan.pit).max() + 0.5 / n)


def _critical(scan: ScanPlaces, n_scans: int) -> float:
    """Distance that chance reaches in one of a hundred runs, in any of the scans."""
    return float(kstwo.isf(FALSE_ALARM / n_scans, scan.pit.size))
