"""Figures of the page: work and precision, error maps, posterior shifts, ladder, scaling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.svg import inline_svg

METHODS = {
    "ours": ("#1f4e79", "o", "this package, rtol 1e-2 to 1e-12"),
    "tensor grid": ("#00745a", "s", "Gauss–Legendre grid, 50² to 400²"),
    "scipy dblquad": ("#c24d00", "^", "scipy dblquad"),
    "few terms": ("#7a5195", "D", "8 terms, B frozen"),
    "closed form": ("#59636e", "X", "closed form"),
}
LADDER = {
    "MAP + Laplace": ("#59636e", "X"),
    "PSIS": ("#00745a", "s"),
    "emcee": ("#1f4e79", "o"),
}
PARAMETER_INKS = ("#1f4e79", "#c24d00", "#00745a", "#7a5195")
WORKERS = {
    "one": ("#1f4e79", "o", "one after another"),
    "threads": ("#c24d00", "^", "two threads"),
    "processes": ("#00745a", "s", "two processes"),
}
_SMALLEST = 1e-16
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Picture:
    """One drawing with its heading."""

    title: str
    svg: Markup


def power_of_ten(value: float) -> str:
    """A power of ten as text.

    Examples
    --------
    >>> power_of_ten(1e-6), power_of_ten(1.0), power_of_ten(3e-6)
    ('10⁻⁶', '1', '')
    """
    if value <= 0.0:
        return ""
    exponent = log10(value)
    if abs(exponent - round(exponent)) > 1e-9:
        return ""
    if round(exponent) in (0, 1, 2):
        return f"{10 ** round(exponent)}"
    return "10" + str(round(exponent)).translate(_SUPERSCRIPTS)


def draw_figures(result: dict[str, Any]) -> dict[str, list[Picture]]:
    """Draw every figure.

    Parameters
    ----------
    result : dict
        Of `pbrdf_bayes.bench.run.run_bench`.

    Returns
    -------
    dict of str to list of Picture
        ``time``, ``work``, ``maps``, ``shift``, ``ladder``, ``scaling``.
    """
    with figure_style():
        cases = result["normalisation"]
        return {
            "time": [_precision(c, "microseconds", "time, s and p  [µs]", i)
                     for i, c in enumerate(cases)],
            "work": [_precision(c, "evaluations", "integrand evaluations", i)
                     for i, c in enumerate(cases)],
            "maps": _maps(result["error_map"]),
            "shift": [_shift(result["posterior_shift"])],
            "ladder": [_ladder(result["ladder"], key, words)
                       for key, words in (("error_mean", "mean"), ("error_sd", "sd"),
                                          ("error_interval", "ends of the 95 % interval"))],
            "scaling": [*_scaling(result["scaling"]), _samples(result["samples"])],
        }  # fmt: skip


def _axes(x_label: str, y_label: str, *, width: float = 4.5, height: float = 3.5) -> Axes:
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0.155, 0.15, 0.825, 0.82))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#8a939b")
    axes.tick_params(labelsize=9.5, color="#8a939b", labelcolor="#1c2126", which="both")
    axes.set_xlabel(x_label, fontsize=10, color="#1c2126")
    axes.set_ylabel(y_label, fontsize=10, color="#1c2126")
    axes.grid(color="#e4e8ec", linewidth=0.7)
    axes.set_axisbelow(True)
    return axes


def _log_log(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda v, _: power_of_ten(v)))
        axis.set_minor_locator(NullLocator())


def _finish(axes: Axes, name: str, title: str, label: str) -> Picture:
    figure = axes.get_figure(root=True)
    if figure is None:
        msg = "axes without a figure"
        raise TypeError(msg)
    return Picture(title, inline_svg(figure, name=name, label=label))


def _precision(case: dict[str, Any], key: str, x_label: str, index: int) -> Picture:
    axes = _axes(x_label, "relative error")
    for method, (colour, marker, _) in METHODS.items():
        points = [p for p in case["points"] if p["method"] == method]
        x, y = [p[key] for p in points], [max(p["error"], _SMALLEST) for p in points]
        axes.plot(x, y, color=colour, marker=marker, markersize=5.5, linewidth=1.3)
    _log_log(axes)
    ours = next(p for p in case["points"] if p["method"] == "ours" and p["setting"] == "1e-06")
    reached = f"{ours['error']:.1e} in {ours['microseconds']:.1f} µs, {ours['evaluations']}"
    label = (
        f"{case['name']}: relative error against {x_label}; at rtol 1e-6 this package reaches "
        f"{reached} evaluations"
    )
    return _finish(
        axes, f"bench-{key[:4]}-{index}", case["name"].replace("_0", "₀").replace("_i", "ᵢ"), label
    )


def _maps(error: dict[str, Any]) -> list[Picture]:
    titles = {"closed_form": "Closed form", "few_terms": "8 terms, B frozen"}
    made = []
    for key, title in titles.items():
        axes = _axes("θ_i  [deg]", "ρ_0")
        values = np.log10(np.maximum(error[key], 1e-5))
        levels = [-4.0, -3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 1.0]
        filled = axes.contourf(
            error["theta_i_deg"], error["rho0"], values, levels=levels, cmap="Blues",
            extend="both",
        )  # fmt: skip
        lines = axes.contour(
            filled,
            levels=[-3.0, -2.0, -1.0, 0.0],
            colors="#1c2126",
            linewidths=0.9,
            linestyles="solid",
        )
        axes.clabel(lines, fmt={-3.0: "0.1 %", -2.0: "1 %", -1.0: "10 %", 0.0: "100 %"}, fontsize=9)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
        label = (
            f"{title}: relative error over incidence angle and roughness, from "
            f"{np.min(error[key]):.1e} to {np.max(error[key]):.1e}"
        )
        made.append(_finish(axes, f"bench-map-{key[:3]}", title, label))
    return made


def _shift(shift: dict[str, Any]) -> Picture:
    axes = _axes("rtol of the normalisation", "shift of the mean  [posterior sd]", width=5.2)
    rtol = [row["rtol"] for row in shift["rows"]]
    for i, ink in enumerate(PARAMETER_INKS):
        values = [max(abs(row["shift"][i]), 1e-10) for row in shift["rows"]]
        axes.plot(rtol, values, color=ink, marker="o", markersize=5, linewidth=1.3)
    _log_log(axes)
    worst = max(abs(v) for row in shift["rows"] if row["rtol"] <= 1e-6 for v in row["shift"])
    label = f"Shift of the posterior means against rtol; at 1e-6 and below at most {worst:.1e} sd"
    return _finish(axes, "bench-shift", "Shift of the posterior means", label)


def _ladder(ladder: dict[str, Any], key: str, words: str) -> Picture:
    axes = _axes("seconds, search of the optimum included", "largest error  [sd]")
    for method, (colour, marker) in LADDER.items():
        rows = [r for r in ladder["rows"] if r["method"].startswith(method)]
        axes.plot(
            [r["seconds"] for r in rows], [r[key] for r in rows],
            color=colour, marker=marker, markersize=6, linewidth=1.3,
        )  # fmt: skip
    _log_log(axes)
    _few_ticks(axes, [r["seconds"] for r in ladder["rows"]], [r[key] for r in ladder["rows"]])
    best = min(ladder["rows"], key=lambda r: float(r[key]))
    label = f"Error of the {words} against seconds; smallest {best[key]:.1e} sd by {best['method']}"
    return _finish(axes, f"bench-ladder-{key[6:]}", f"Error of the {words}", label)


def _few_ticks(axes: Axes, x: Sequence[float], y: Sequence[float]) -> None:
    """Ticks at 1, 2, 5 times powers of ten, for ranges of about a decade."""
    for axis, values in ((axes.xaxis, x), (axes.yaxis, y)):
        least, most = min(values), max(values)
        decades = range(floor(log10(least)), floor(log10(most)) + 2)
        ticks = [m * 10.0**e for e in decades for m in (1, 2, 5)]
        axis.set_ticks([t for t in ticks if least / 1.5 <= t <= most * 1.5])
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def _scaling(scaling: dict[str, Any]) -> list[Picture]:
    words = {
        "points": ("Points per scan, 10 scans", "µs a parameter set"),
        "scans": ("Scans of 81 points", "µs a parameter set"),
        "sets": ("Parameter sets a call", "µs a call"),
    }
    made = []
    for key, (title, y_label) in words.items():
        series = scaling[key]
        axes = _axes(title.split(",")[0].lower(), y_label)
        x, y = np.array(series["sizes"], float), np.array(series["microseconds"])
        axes.plot(x, y, color="#1f4e79", marker="o", markersize=5.5, linewidth=1.3)
        axes.plot(x, y[-1] * x / x[-1], color="#59636e", linewidth=1.0, linestyle=(0, (4, 3)))
        _log_log(axes)
        label = f"{title}: {y_label}, growing with exponent {series['exponent']:.2f}"
        made.append(_finish(axes, f"bench-scale-{key}", title, label))
    return made


def _samples(samples: dict[str, Any]) -> Picture:
    axes = _axes("samples", "seconds")
    for way, (colour, marker, _) in WORKERS.items():
        series = samples if way == "one" else samples.get(way, {"sizes": [], "seconds": []})
        axes.plot(
            series["sizes"], series["seconds"],
            color=colour, marker=marker, markersize=5.5, linewidth=1.3,
        )  # fmt: skip
    x, y = np.array(samples["sizes"], float), np.array(samples["seconds"])
    axes.plot(x, y[-1] * x / x[-1], color="#59636e", linewidth=1.0, linestyle=(0, (4, 3)))
    _log_log(axes)
    _few_ticks(axes, x.tolist(), y.tolist())
    label = (
        f"Samples fitted: {y[-1] / x[-1]:.2g} s each one after another, two threads "
        f"{samples['threads']['speed_up']:.2g} times as fast"
    )
    return _finish(axes, "bench-scale-samples", "Samples fitted", label)
