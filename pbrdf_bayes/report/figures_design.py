"""Figures of a design: gain against incidence, gain against minutes, expected shrinkage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pbrdf_bayes.report.figures_planes import Picture
from pbrdf_bayes.report.numbers import fixed, number
from pbrdf_bayes.report.panel import FAINT, GRID, INK, LOOKS, MUTED
from pbrdf_bayes.report.svg import figure_style, inline_svg

Record = Mapping[str, Any]

KINDS = {
    "brdf": ("Scan of the BRDF", "o"),
    "dhr": ("DHR reading", "s"),
    "ddr": ("DDR reading", "^"),
}
"""Quantities of candidates: words and symbol."""
_TEXT = 10.5
_MOST_LABELS = 5
_SYMBOLS = {"sigma_n0": "σ_N0", "rho0": "ρ_0"}
_LOWERED = {"_s": "ₛ", "_p": "ₚ", "_u": "ᵤ"}


def gain_pictures(rows: Sequence[Record], *, per_minute: bool) -> list[Picture]:
    """Gain against the angle of incidence, one picture for each quantity, all to one scale.

    Parameters
    ----------
    rows : sequence of mapping
        Evaluated candidates.
    per_minute : bool
        Nat a minute instead of nat.
    """
    key = "eig_per_minute" if per_minute else "eig_nats"
    error = f"{key}_se" if per_minute else "eig_se"
    top = max(r[key] + r[error] for r in rows)
    low = min(0.0, *(r[key] - r[error] for r in rows))
    limits = (low - 0.04 * (top - low), top + 0.06 * (top - low))
    with figure_style():
        return [
            _gain(kind, [r for r in rows if r["quantity"] == kind], key, error, limits)
            for kind in KINDS
            if any(r["quantity"] == kind for r in rows)
        ]


def _gain(
    kind: str, rows: Sequence[Record], key: str, error: str, limits: tuple[float, float]
) -> Picture:
    words, marker = KINDS[kind]
    unit = "nat" if key == "eig_nats" else "nat a minute"
    axes = _axes(344, 236, (46, 38, 288, 168), f"expected gain [{unit}]")
    axes.set_xlim(-3.0, 92.0)
    axes.set_ylim(*limits)
    axes.set_xticks([0, 30, 60, 90], ["0°", "30°", "60°", "90°"])
    axes.set_xlabel("incidence angle θ_i", fontsize=_TEXT, color=INK, labelpad=3)
    for q, look in LOOKS.items():
        here = sorted((r for r in rows if r["polarization"] == q), key=lambda r: r["theta_i_deg"])
        x = [r["theta_i_deg"] for r in here]
        y, u = np.array([r[key] for r in here]), np.array([r[error] for r in here])
        once = len(set(x)) == len(x)
        dash: Any = (0, look.dash) if look.dash else "-"
        if once:
            axes.plot(x, y, color=look.color, linewidth=1.1, linestyle=dash)
        axes.errorbar(x, y, u, color=look.color, linestyle="none", elinewidth=1.0)
        for row, a, b in zip(here, x, y, strict=True):
            face = "white" if row["repeat"] else look.color
            axes.plot(a, b, marker, markersize=4.6, color=look.color, markerfacecolor=face)
    best = max(rows, key=lambda r: r[key])
    label = f"{words}: expected gain in {unit} against incidence; the largest is that of "
    label += f"{best['label']}, {number(best[key])} {unit}"
    return Picture(_drawn(axes.figure, f"gain-{kind}-{unit[4:7]}", label), words, ())


def minutes_picture(rows: Sequence[Record]) -> Markup:
    """Gain against minutes with the candidates that no other one beats in both."""
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
            axes.plot(row["minutes"], row["eig_nats"], marker, color=look.color, markersize=4.6,
                      markerfacecolor=face, markeredgewidth=0.9)  # fmt: skip
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
