"""Where readings lie in what all others predict: distribution functions minus the diagonal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import kstwo

from pbrdf_bayes.report.arrays import ScanPlaces
from pbrdf_bayes.report.figures_planes import Picture
from pbrdf_bayes.report.numbers import count, fixed, number
from pbrdf_bayes.report.panel import FAINT, INK, LOOKS, MUTED, Panel, linear_ticks, new_figure
from pbrdf_bayes.report.svg import inline_svg
from pbrdf_bayes.verdict import FALSE_ALARM

Array = NDArray[np.float64]

COLUMNS = 5
MOST_SCANS = 20
CELL, HEIGHT = 148.0, 74.0
GAP_X, GAP_Y, LEFT, BELOW, ABOVE = 20.0, 34.0, 42.0, 36.0, 46.0
ALARM = "#a8201a"
_POINTS = 160


def pit_picture(scans: Sequence[ScanPlaces]) -> Picture | None:
    """Small multiples, one for each scan, all on the same axes; None without scans."""
    if not scans:
        return None
    shown = chosen_scans(scans)
    bands = [_critical(s.pit.size, len(scans)) for s in shown]
    away = [_deviation(s.pit) for s in shown]
    reach = 1.25 * max([*bands, *(float(np.abs(d).max()) for d in away)])
    reach = min(reach, 1.0)
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    width = LEFT + columns * CELL + (columns - 1) * GAP_X + 10
    figure = new_figure(width, BELOW + rows * HEIGHT + (rows - 1) * GAP_Y + ABOVE)
    for i, (scan, band) in enumerate(zip(shown, bands, strict=True)):
        row, column = divmod(i, columns)
        left = LEFT + column * (CELL + GAP_X)
        bottom = BELOW + (rows - 1 - row) * (HEIGHT + GAP_Y)
        last = i + columns >= len(shown)
        _cell(figure, (left, bottom), scan, band, reach, first=column == 0, last=last)
    axes = Panel(figure, LEFT, BELOW, width - LEFT, HEIGHT, (0.0, 1.0), (0.0, 1.0))
    top = rows * HEIGHT + (rows - 1) * GAP_Y
    axes.words(-LEFT + 2, top + 27, "share of readings − uniform", color=INK, align="left")
    axes.words(CELL / 2, -28, "place in the predicted law", color=INK)
    outside = sum(_distance(s.pit) > b for s, b in zip(shown, bands, strict=True))
    label = (
        f"Distribution of the readings of {len(shown)} scans in what all others predict, minus "
        f"uniform: {outside} outside the 99 % envelope; "
        + "; ".join(f"{s.label}: distance {number(_distance(s.pit), digits=2)}" for s in shown)
    )
    return Picture(inline_svg(figure, name="pit", label=label), "")


def chosen_scans(scans: Sequence[ScanPlaces]) -> list[ScanPlaces]:
    """At most `MOST_SCANS`, those least like chance, in their order."""
    order = np.argsort([s.p_value for s in scans], kind="stable")[:MOST_SCANS]
    return [scans[i] for i in sorted(order.tolist())]


def _cell(
    figure: Figure, corner: tuple[float, float], scan: ScanPlaces, band: float, reach: float,
    *, first: bool, last: bool,
) -> None:  # fmt: skip
    panel = Panel(figure, *corner, CELL, HEIGHT, (0.0, 1.0), (-reach, reach))
    look = LOOKS[scan.polarization]
    grid = np.linspace(0.0, 1.0, 61)
    panel.fill(grid, np.maximum(-band, -grid), np.minimum(band, 1.0 - grid), FAINT, 0.22)
    ticks, labels = linear_ticks(-reach, reach)
    panel.y_axis(ticks, labels if first else [""] * len(ticks))
    panel.segments([(0.0, 0.0, 1.0, 0.0)], MUTED, 0.8)
    panel.x_axis([0.0, 0.5, 1.0], ["0", "0.5", "1"] if last else [""] * 3)
    n = scan.pit.size
    keep = np.unique(np.linspace(0, n - 1, min(n, _POINTS)).round().astype(int))
    x = np.concatenate([[0.0], scan.pit[keep], [1.0]])
    y = np.concatenate([[0.0], (keep + 0.5) / n - scan.pit[keep], [0.0]])
    outside = _distance(scan.pit) > band
    panel.line(x, y, look.color, 1.6, look.dash)
    panel.words(0, HEIGHT + 7, scan.label, color=INK, align="left")
    words = f"{count(n)} · distance {fixed(_distance(scan.pit), 2)}"
    panel.words(CELL, HEIGHT + 7, words, color=ALARM if outside else MUTED, size=9.0, align="right")


def _deviation(pit: Array) -> Array:
    return np.asarray((np.arange(pit.size) + 0.5) / pit.size - pit)


def _distance(pit: Array) -> float:
    """Kolmogorov distance of ascending values from the uniform distribution."""
    return float(np.abs(_deviation(pit)).max() + 0.5 / pit.size)


def _critical(n: int, n_scans: int) -> float:
    """Distance that chance reaches in one of a hundred runs, in any of the scans."""
    return float(kstwo.isf(FALSE_ALARM / n_scans, n))
