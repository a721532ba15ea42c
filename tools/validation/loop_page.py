"""The page of the closed loop of the design: promised and realised information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.svg import inline_svg
from tools.validation.page import page_template

Row = Mapping[str, Any]

AGREES = 3.0
"""Errors within which a realised drop agrees with the promise."""
_KINDS = {"scan": ("#0067a5", "o"), "DHR": ("#c24d00", "s")}
_GRIDS = {"chosen": "#1f4e79", "uniform": "#9aa7b4", "random": "#d5dadf"}
_WORDS = {"chosen": "chosen by design", "uniform": "evenly spread", "random": "at random"}


def render_loop(result: Mapping[str, Any]) -> str:
    """The page as text; the same result gives the same page.

    Parameters
    ----------
    result : mapping
        Of `tools.validation.design_loop.run_loop`.

    Returns
    -------
    str
    """
    rows = [{**row, "off": errors_off(row)} for row in result["candidates"]]
    with figure_style():
        scatter, bars = _scatter(rows), _bars(result["grids"])
    return page_template("loop.html.j2").render(
        **{**result, "candidates": rows}, scatter=scatter, bars=bars,
        words=_WORDS, agrees=AGREES, verdict=in_words(rows, result["grids"]),
    )  # fmt: skip


def errors_off(row: Row) -> float:
    """Realised less promised, in standard errors of both; the bracket counts as +-2 of them."""
    error = np.hypot(np.hypot(row["realised_se"], row["se"]), 0.25 * (row["high"] - row["low"]))
    return float((row["realised"] - row["eig"]) / error)


def in_words(rows: Sequence[Row], grids: Sequence[Row]) -> str:
    """What the study found."""
    off = np.array([errors_off(row) for row in rows])
    agree = int(np.count_nonzero(np.abs(off) < AGREES))
    by_paint = {(g["paint"], g["grid"]): g["realised"] for g in grids}
    paints = list(dict.fromkeys(g["paint"] for g in grids))
    wins = sum(
        by_paint[p, "chosen"] > max(by_paint[p, "uniform"], by_paint[p, "random"]) for p in paints
    )
    mean = {g: float(np.mean([by_paint[p, g] for p in paints])) for g in _GRIDS}
    return (
        f"{agree} of {off.size} realised drops agree with what was promised within {AGREES:g} "
        f"errors (mean {off.mean():+.1f}, root mean square {np.sqrt(np.mean(off**2)):.1f} errors). "
        f"Three scans chosen by design tell more than evenly spread and random ones for {wins} of "
        f"{len(paints)} paints: {mean['chosen']:.2f} nat against {mean['uniform']:.2f} and "
        f"{mean['random']:.2f} on average, in the same minutes."
    )


def _scatter(rows: Sequence[Row]) -> Markup:
    figure = Figure(figsize=(4.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    top = 1.08 * max(max(r["eig"], r["realised"]) for r in rows)
    axes.plot([0, top], [0, top], color="#9aa7b4", lw=1)
    for kind, (color, marker) in _KINDS.items():
        own = [r for r in rows if kind in r["candidate"]]
        axes.errorbar(
            [r["eig"] for r in own], [r["realised"] for r in own],
            yerr=[r["realised_se"] for r in own],
            xerr=np.array([(r["eig"] - r["low"], r["high"] - r["eig"]) for r in own]).T,
            fmt=marker, ms=4.5, color=color, elinewidth=1, label=kind,
        )  # fmt: skip
    axes.set(xlabel="promised [nat]", ylabel="realised [nat]", xlim=(0, top), ylim=(0, top))
    axes.legend(frameon=False, fontsize=9)
    _bare(axes)
    label = "Realised against promised information of every candidate, with the line of equality"
    return inline_svg(figure, name="loop", label=label)


def _bars(grids: Sequence[Row]) -> Markup:
    figure = Figure(figsize=(4.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    paints = list(dict.fromkeys(g["paint"] for g in grids))
    for i, (grid, color) in enumerate(_GRIDS.items()):
        own = [next(g for g in grids if (g["paint"], g["grid"]) == (p, grid)) for p in paints]
        axes.bar(
            np.arange(len(paints)) + 0.27 * (i - 1), [g["realised"] for g in own], 0.25,
            yerr=[g["realised_se"] for g in own], color=color, ecolor="#1c2126",
            error_kw={"elinewidth": 1}, label=_WORDS[grid],
        )  # fmt: skip
    axes.set(xticks=range(len(paints)), ylabel="realised [nat]")
    axes.set_xticklabels(paints)
    axes.set_ylim(0.0, 1.35 * max(g["realised"] for g in grids))
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    _bare(axes)
    label = "Information realised by three scans: chosen by design, evenly spread, at random"
    return inline_svg(figure, name="grids", label=label)


def _bare(axes: Axes) -> None:
    axes.tick_params(labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
