"""Figures of a design: gain against incidence, gain against minutes, expected shrinkage."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from math import floor
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pbrdf_bayes.quantities import PLANNED, QUANTITIES
from pbrdf_bayes.report.figures_planes import Picture
from pbrdf_bayes.report.numbers import fixed, number
from pbrdf_bayes.report.panel import FAINT, GRID, INK, LOOKS, MUTED
from pbrdf_bayes.report.svg import figure_style, inline_svg

Record = Mapping[str, Any]

KINDS = {
    word: (QUANTITIES[word].reading, symbol) for word, symbol in zip(PLANNED, "os^", strict=True)
}
"""Quantities of candidates: words and symbol."""
_TEXT = 10.5
_MOST_LABELS = 5
_BESIDE = {"s": -0.014, "p": 0.0, "u": 0.014}
"""Where many cost the same: polarisations beside each other, in shares of the axis."""
_SYMBOLS = {"sigma_n0": "σ_N0", "rho0": "ρ_0"}
_LOWERED = {"_s": "ₛ", "_p": "ₚ", "_u": "ᵤ"}


def gain_pictures(rows: Sequence[Record], *, per_minute: bool) -> list[Picture]:
    """Gain against the angle of incidence, one picture for each quantity, each to its scale.

    Parameters
    ----------
    rows : sequence of mapping
        Evaluated candidates.
    per_minute : bool
        Nat a minute instead of nat.
    """
    key = "eig_per_minute" if per_minute else "eig_nats"
    error = f"{key}_se" if per_minute else "eig_se"
    with figure_style():
        return [
            _gain(kind, here, key, error)
            for kind in KINDS
            if (here := [r for r in rows if r["quantity"] == kind])
        ]


def _gain(kind: str, rows: Sequence[Record], key: str, error: str) -> Picture:
    words, _ = KINDS[kind]
    unit = "nat" if key == "eig_nats" else "nat a minute"
    top = max(r[key] + r[error] for r in rows)
    low = min(0.0, *(r[key] - r[error] for r in rows))
    axes = _against_incidence(f"expected gain [{unit}]")
    axes.set_ylim(low - 0.04 * (top - low), top + 0.06 * (top - low))
    _curves(axes, rows, lambda r: (r[key], r[error]))
    best = max(rows, key=lambda r: r[key])
    label = f"{words}: expected gain in {unit} against incidence; the largest is that of "
    label += f"{best['label']}, {number(best[key])} {unit}"
    return Picture(_drawn(axes.figure, f"gain-{kind}-{unit[4:7]}", label), words, ())


def goal_pictures(goals: Sequence[Record]) -> list[Picture]:
    """Standard deviation left of each goal against the angle of incidence."""
    with figure_style():
        return [
            _goal(goal, i) for i, goal in enumerate(goals)
            if all("theta_i_deg" in row for row in goal["candidates"])
        ]  # fmt: skip


def _goal(goal: Record, number_of: int) -> Picture:
    rows = goal["candidates"]
    axes = _against_incidence("standard deviation left")
    top = max(1.0, *(r["sd_ratio"] + r["sd_ratio_se"] for r in rows))
    least = min(r["sd_ratio"] - r["sd_ratio_se"] for r in rows)
    low = floor(10.0 * least) / 10.0 if least > 0.5 else 0.0
    axes.set_ylim(low, top + 0.06 * (top - low))
    axes.set_yticks(np.linspace(low, 1.0, 3))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{100.0 * v:.0f} %"))
    for kind in KINDS:
        here = [r for r in rows if r["quantity"] == kind]
        _curves(axes, here, lambda r: (r["sd_ratio"], r["sd_ratio_se"]))
    best = min(rows, key=lambda r: r["sd_ratio"])
    label = f"{goal['name']}: standard deviation left against incidence; the smallest is that of "
    label += f"{best['label']}, {fixed(100.0 * best['sd_ratio'], 1)} %"
    return Picture(_drawn(axes.figure, f"goal-{number_of}", label), _symbol(goal["name"]), ())


def _against_incidence(title: str) -> Axes:
    axes = _axes(344, 236, (46, 38, 288, 168), title)
    axes.set_xlim(-3.0, 92.0)
    axes.set_xticks([0, 30, 60, 90], ["0°", "30°", "60°", "90°"])
    axes.set_xlabel("incidence angle θ_i", fontsize=_TEXT, color=INK, labelpad=3)
    return axes


def _curves(
    axes: Axes, rows: Sequence[Record], value: Callable[[Record], tuple[float, float]]
) -> None:
    """A value with its error against incidence, a line for each polarisation."""
    for q, look in LOOKS.items():
        here = sorted((r for r in rows if r["polarization"] == q), key=lambda r: r["theta_i_deg"])
        x = [r["theta_i_deg"] for r in here]
        pairs = [value(r) for r in here]
        y, u = np.array([v for v, _ in pairs]), np.array([e for _, e in pairs])
        once = len(set(x)) == len(x)
        dash: Any = (0, look.dash) if look.dash else "-"
        if once:
            axes.plot(x, y, color=look.color, linewidth=1.1, linestyle=dash)
        axes.errorbar(x, y, u, color=look.color, linestyle="none", elinewidth=1.0)
        for row, a, b in zip(here, x, y, strict=True):
            face = "white" if row.get("repeat") else look.color
            axes.plot(
                a,
                b,
                KINDS[row["quantity"]][1],
                markersize=4.6,
                color=look.color,
                markerfacecolor=face,
            )


def minutes_picture(rows: Sequence[Record]) -> Markup:
    """Gain against minutes with the candidates that no other one beats in both.

    Nothing where all cost the same.
    """
    if len({r["minutes"] for r in rows}) == 1:
        return Markup()
    with figure_style():
        axes = _axes(344, 300, (46, 38, 288, 232), "expected gain [nat]")
        minutes = np.array([r["minutes"] for r in rows])
        gain = np.array([r["eig_nats"] for r in rows])
        axes.set_xlim(0.0, 1.12 * minutes.max())
        axes.set_ylim(min(0.0, 1.1 * gain.min()), 1.14 * gain.max())
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axes.xaxis.set_major_formatter(FuncFormatter(_plain))
        axes.set_xlabel("minutes", fontsize=_TEXT, color=INK, labelpad=3)
        front = sorted((r for r in rows if r["pareto"]), key=lambda r: r["minutes"])
        x = [r["minutes"] for r in front]
        axes.step(x, [r["eig_nats"] for r in front], where="post", color=MUTED, linewidth=1.2)
        for row in rows:
            look, marker = LOOKS[row["polarization"]], KINDS[row["quantity"]][1]
            face = look.color if row["pareto"] else "none"
            beside = _BESIDE[row["polarization"]] * minutes.max() * (not row["pareto"])
            axes.plot(row["minutes"] + beside, row["eig_nats"], marker, color=look.color,
                      markersize=4.6, markerfacecolor=face, markeredgewidth=0.9)  # fmt: skip
        for row in front[-_MOST_LABELS:]:
            right = row["minutes"] > 0.55 * minutes.max()
            axes.annotate(
                row["label"], (row["minutes"], row["eig_nats"]), textcoords="offset points",
                xytext=(-7 if right else 7, 5), ha="right" if right else "left",
                fontsize=_TEXT, color=INK,
            )  # fmt: skip
        names = ", ".join(f"{r['label']} ({number(r['minutes'])} min)" for r in front)
        label = f"Expected gain against minutes; no other candidate beats {names}"
        return _drawn(axes.figure, "gain-minutes", label)


def shrinkage_picture(rows: Sequence[Record], sd_before: Mapping[str, Any]) -> Markup:
    """Expected standard deviation after over before, of the best candidates."""
    names = list(sd_before)
    width, left, row_height = 1080.0, 170.0, 21.0
    height = row_height * len(rows) + 60.0
    each = (width - left - 10.0) / len(names)
    with figure_style():
        figure = _figure(width, height)
        y = np.arange(len(rows))
        for i, name in enumerate(names):
            box = (left + i * each, 36.0, each - 18.0, row_height * len(rows))
            axes = _place(figure, (width, height), box, _symbol(name), beside=0.0)
            axes.set_xlim(0.0, 1.08)
            axes.set_ylim(len(rows) - 0.5, -0.5)
            axes.set_xticks([0.0, 0.5, 1.0], ["0", "50 %", "100 %"])
            axes.set_yticks(y, [r["label"] for r in rows] if i == 0 else [""] * len(rows))
            axes.axvline(1.0, color=FAINT, linewidth=1.0)
            for at, row in enumerate(rows):
                ratio = row["sd_ratio"][name]
                if ratio["ratio"] is None:
                    continue
                look, marker = LOOKS[row["polarization"]], KINDS[row["quantity"]][1]
                axes.plot([ratio["ratio"], 1.0], [at, at], color=look.color, linewidth=1.0,
                          alpha=0.35)  # fmt: skip
                axes.errorbar(ratio["ratio"], at, xerr=ratio["se"], fmt=marker, color=look.color,
                              markersize=5.0, elinewidth=1.2)  # fmt: skip
        best = rows[0]
        ratios = (
            f"{name} {fixed(100.0 * ratio['ratio'], 0)} %"
            for name, ratio in best["sd_ratio"].items() if ratio["ratio"] is not None
        )  # fmt: skip
        label = f"Expected standard deviation after over before; {best['label']}: "
        return _drawn(figure, "shrinkage", label + ", ".join(ratios))


def _symbol(name: str) -> str:
    """A quantity as figures write it: only the last word of a text may be lowered there."""
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    return re.sub("_[spu]", lambda m: _LOWERED[m[0]], name)


def _axes(width: float, height: float, box: tuple[float, ...], title: str) -> Axes:
    figure = _figure(width, height)
    return _place(figure, (width, height), box, title, beside=box[0] - 2.0)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width / 72, height / 72), dpi=72)


def _place(
    figure: Figure, size: tuple[float, float], box: tuple[float, ...], title: str, *, beside: float
) -> Axes:  # fmt: skip
    """Axes in a box of pixels; the title begins so many pixels to the left of them."""
    (width, height), (left, bottom, wide, high) = size, box
    axes = figure.add_axes((left / width, bottom / height, wide / width, high / height))
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.tick_params(labelsize=_TEXT, length=0, labelcolor=MUTED, pad=5)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.annotate(
        title, (0, 1), xycoords="axes fraction", textcoords="offset points",
        xytext=(-beside, 10), fontsize=_TEXT, color=INK,
    )  # fmt: skip
    return axes


def _plain(value: float, _: int) -> str:
    return number(round(value, 12))


def _drawn(figure: Any, name: str, label: str) -> Markup:
    return inline_svg(figure, name=name, label=label)
