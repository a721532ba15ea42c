"""Figures of a design: gain against incidence, gain against minutes, expected shrinkage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from pbrdf_bayes.quantities import PLANNED, QUANTITIES
from pbrdf_bayes.report.figures.axes import (
    WIDTH,
    angles,
    figure_of,
    figure_style,
    limits,
    name_axes,
    new_axes,
)
from pbrdf_bayes.report.figures.looks import FAINT, INK, LOOKS, MUTED, Picture
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import fixed, number

Record = Mapping[str, Any]

KINDS = {
    word: (QUANTITIES[word].reading, symbol) for word, symbol in zip(PLANNED, "os^", strict=True)
}
"""Quantities of candidates: words and symbol."""
_MOST_LABELS = 5
_BESIDE = {"s": -0.014, "p": 0.0, "u": 0.014}
"""Where many cost the same: polarisations beside each other, in shares of the axis."""
_SYMBOLS = {"sigma_n0": "σ_N0", "rho0": "ρ_0"}
_LOWERED = {"_s": "ₛ", "_p": "ₚ", "_u": "ᵤ"}


def plot_gain(
    axes: Axes, rows: Sequence[Record], *, key: str = "eig_nats", error: str = "eig_se"
) -> Axes:  # fmt: skip
    """Draw a quantity of candidates with its standard error against the angle of incidence [deg].

    Candidates of one polarisation are joined by a line where none is at an angle twice; open
    symbols are repeats.
    """
    axes.set_xlim(-3.0, 92.0)
    angles(axes.xaxis, 0, 30, 60, 90)
    for q, look in LOOKS.items():
        here = sorted((r for r in rows if r["polarization"] == q), key=lambda r: r["theta_i_deg"])
        x, y = [r["theta_i_deg"] for r in here], [r[key] for r in here]
        if len(set(x)) == len(x):
            axes.plot(x, y, lw=1.1, **look.line)
        axes.errorbar(x, y, [r[error] for r in here], color=look.color, ls="none", elinewidth=1.0)
        for row, a, b in zip(here, x, y, strict=True):
            _point(axes, row, a, b, filled=not row.get("repeat"))
    return axes


def _point(axes: Axes, row: Record, x: float, y: float, *, filled: bool) -> None:
    color = LOOKS[row["polarization"]].color
    axes.plot(x, y, KINDS[row["quantity"]][1], ms=4.6, mew=1.0, color=color,
              mfc=color if filled else "white")  # fmt: skip


def gain_pictures(rows: Sequence[Record], *, per_minute: bool) -> list[Picture]:
    """Gain against the angle of incidence, one picture for each quantity, each to its scale.

    Parameters
    ----------
    rows : sequence of mapping
        Evaluated candidates.
    per_minute : bool
        Nat a minute instead of nat.
    """
    key, error, unit = (
        ("eig_per_minute", "eig_per_minute_se", "nat a minute") if per_minute
        else ("eig_nats", "eig_se", "nat")
    )  # fmt: skip
    found = []
    for kind, (words, _) in KINDS.items():
        here = [r for r in rows if r["quantity"] == kind]
        if not here:
            continue
        with figure_style():
            (axes,) = new_axes(WIDTH, 236.0)
            plot_gain(axes, here, key=key, error=error)
            ends = [r[key] + sign * r[error] for r in here for sign in (-1, 1)]
            axes.set_ylim(limits(ends, [0.0]))
            name_axes(axes, "incidence angle θ_i", f"expected gain [{unit}]")
            best = max(here, key=lambda r: r[key])
            label = f"{words}: expected gain in {unit} against incidence; the largest is that of "
            label += f"{best['label']}, {number(best[key])} {unit}"
            svg = inline_svg(figure_of(axes), name=f"gain-{kind}-{unit[4:7]}", label=label)
        found.append(Picture(svg, words))
    return found


def goal_pictures(goals: Sequence[Record]) -> list[Picture]:
    """Standard deviation left of each goal against the angle of incidence."""
    with figure_style():
        return [
            _goal(goal, i) for i, goal in enumerate(goals)
            if all("theta_i_deg" in row for row in goal["candidates"])
        ]  # fmt: skip


def _goal(goal: Record, number_of: int) -> Picture:
    rows = goal["candidates"]
    (axes,) = new_axes(WIDTH, 236.0)
    for kind in KINDS:
        here = [r for r in rows if r["quantity"] == kind]
        plot_gain(axes, here, key="sd_ratio", error="sd_ratio_se")
    least = min(r["sd_ratio"] - r["sd_ratio_se"] for r in rows)
    most = max(1.0, *(r["sd_ratio"] + r["sd_ratio_se"] for r in rows))
    low = np.floor(10.0 * least) / 10.0 if least > 0.5 else 0.0
    axes.set_ylim(low, most + 0.06 * (most - low))
    axes.set_yticks(np.linspace(low, 1.0, 3))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
    name_axes(axes, "incidence angle θ_i", "standard deviation left")
    best = min(rows, key=lambda r: r["sd_ratio"])
    label = f"{goal['name']}: standard deviation left against incidence; the smallest is that of "
    label += f"{best['label']}, {fixed(100.0 * best['sd_ratio'], 1)} %"
    svg = inline_svg(figure_of(axes), name=f"goal-{number_of}", label=label)
    return Picture(svg, _symbol(goal["name"]))


def plot_minutes(axes: Axes, rows: Sequence[Record]) -> Axes:
    """Draw gain [nat] against minutes; filled and joined: candidates that no other one beats."""
    longest = max(r["minutes"] for r in rows)
    front = sorted((r for r in rows if r["pareto"]), key=lambda r: r["minutes"])
    x, y = [r["minutes"] for r in front], [r["eig_nats"] for r in front]
    axes.step(x, y, where="post", color=MUTED, lw=1.2)
    for row in rows:
        beside = _BESIDE[row["polarization"]] * longest * (not row["pareto"])
        _point(axes, row, row["minutes"] + beside, row["eig_nats"], filled=row["pareto"])
    for row in front[-_MOST_LABELS:]:
        right = row["minutes"] > 0.55 * longest
        axes.annotate(
            row["label"], (row["minutes"], row["eig_nats"]), (-7 if right else 7, 5),
            textcoords="offset points", ha="right" if right else "left", color=INK,
        )  # fmt: skip
    axes.set_xlim(0.0, 1.12 * longest)
    axes.set_ylim(min(0.0, *(1.1 * r["eig_nats"] for r in rows)), 1.14 * max(y))
    name_axes(axes, "minutes", "expected gain [nat]")
    return axes


def minutes_picture(rows: Sequence[Record]) -> Markup:
    """Gain against minutes; nothing where all cost the same."""
    if len({r["minutes"] for r in rows}) == 1:
        return Markup()
    front = sorted((r for r in rows if r["pareto"]), key=lambda r: r["minutes"])
    names = ", ".join(f"{r['label']} ({number(r['minutes'])} min)" for r in front)
    label = f"Expected gain against minutes; no other candidate beats {names}"
    with figure_style():
        (axes,) = new_axes(WIDTH, 300.0)
        plot_minutes(axes, rows)
        return inline_svg(figure_of(axes), name="gain-minutes", label=label)


def plot_shrinkage(axes: Axes, rows: Sequence[Record], name: str) -> Axes:
    """Draw the expected standard deviation of a parameter, after over before, by candidate."""
    axes.axvline(1.0, color=FAINT, lw=1.0)
    for at, row in enumerate(rows):
        ratio, look = row["sd_ratio"][name], LOOKS[row["polarization"]]
        if ratio["ratio"] is not None:
            axes.plot([ratio["ratio"], 1.0], [at, at], color=look.color, lw=1.0, alpha=0.35)
            axes.errorbar(ratio["ratio"], at, xerr=ratio["se"], fmt=KINDS[row["quantity"]][1],
                          color=look.color, ms=5.0, elinewidth=1.2)  # fmt: skip
    axes.set(xlim=(0.0, 1.08), ylim=(len(rows) - 0.5, -0.5))
    axes.set_xticks([0.0, 0.5, 1.0], ["0", "50 %", "100 %"])
    axes.set_yticks(range(len(rows)), [r["label"] for r in rows])
    axes.set_title(_symbol(name))
    return axes


def shrinkage_picture(rows: Sequence[Record], sd_before: Mapping[str, Any]) -> Markup:
    """Expected standard deviation after over before, of the best candidates."""
    names, width, left, height = list(sd_before), 1080.0, 170.0, 21.0 * len(rows)
    each = (width - left - 10.0) / len(names)
    boxes = [(left + i * each, 36.0, each - 18.0, height) for i in range(len(names))]
    ratios = (
        f"{name} {fixed(100.0 * ratio['ratio'], 0)} %"
        for name, ratio in rows[0]["sd_ratio"].items() if ratio["ratio"] is not None
    )  # fmt: skip
    label = f"Expected standard deviation after over before; {rows[0]['label']}: "
    with figure_style():
        panels = new_axes(width, height + 60.0, *boxes)
        for axes, name in zip(panels, names, strict=True):
            plot_shrinkage(axes, rows, name)
        for axes in panels[1:]:
            axes.tick_params(labelleft=False)
        return inline_svg(figure_of(panels[0]), name="shrinkage", label=label + ", ".join(ratios))


def _symbol(name: str) -> str:
    """A quantity as figures write it: only the last word of a text may be lowered there."""
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    return re.sub("_[spu]", lambda m: _LOWERED[m[0]], name)
