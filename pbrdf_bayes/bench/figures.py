"""Figures of the page: work and precision, error maps, posterior shifts, ladder, scaling."""

from __future__ import annotations

from collections.abc import Callable
from math import log10
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from pbrdf_bayes.report.figures.axes import figure_of, figure_style, name_axes, new_axes
from pbrdf_bayes.report.figures.looks import INK, MUTED, Picture
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


def _plain(value: float) -> str:
    return f"{value:g}"


def _axes(
    x: str, y: str, *, width: float = 324.0, subs: tuple[float, ...] = (1.0,),
    words: Callable[[float], str] = power_of_ten,
) -> Axes:  # fmt: skip
    """Logarithmic axes with ticks at ``subs`` times powers of ten."""
    (axes,) = new_axes(width, 252.0)
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda v, _: words(v)))
        axis.set_minor_locator(NullLocator())
    axes.margins(x=0.05)
    name_axes(axes, x, y)
    return axes


def _finish(axes: Axes, name: str, title: str, label: str) -> Picture:
    return Picture(inline_svg(figure_of(axes), name=name, label=label), title)


def _line(axes: Axes, x: Any, y: Any, color: str, marker: str = "o") -> None:
    axes.plot(x, y, color=color, marker=marker, markersize=5.5)


def _precision(case: dict[str, Any], key: str, x_label: str, index: int) -> Picture:
    axes = _axes(x_label, "relative error")
    for method, (color, marker, _) in METHODS.items():
        points = [p for p in case["points"] if p["method"] == method]
        _line(axes, [p[key] for p in points], [max(p["error"], _SMALLEST) for p in points],
              color, marker)  # fmt: skip
    ours = next(p for p in case["points"] if p["method"] == "ours" and p["setting"] == "1e-06")
    reached = f"{ours['error']:.1e} in {ours['microseconds']:.1f} µs, {ours['evaluations']}"
    label = (
        f"{case['name']}: relative error against {x_label}; at rtol 1e-6 this package reaches "
        f"{reached} evaluations"
    )
    title = case["name"].replace("_0", "₀").replace("_i", "ᵢ")
    return _finish(axes, f"bench-{key[:4]}-{index}", title, label)


def _maps(error: dict[str, Any]) -> list[Picture]:
    titles = {"closed_form": "Closed form", "few_terms": "8 terms, B frozen"}
    made = []
    for key, title in titles.items():
        axes = _axes("θ_i  [deg]", "ρ_0", words=_plain)
        values = np.log10(np.maximum(error[key], 1e-5))
        levels = [-4.0, -3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 1.0]
        axes.set_xscale("linear")
        filled = axes.contourf(
            error["theta_i_deg"], error["rho0"], values, levels=levels, cmap="Blues",
            extend="both",
        )  # fmt: skip
        lines = axes.contour(
            filled, levels=[-3.0, -2.0, -1.0, 0.0], colors=INK, linewidths=0.9, linestyles="solid"
        )
        axes.clabel(lines, fmt={-3.0: "0.1 %", -2.0: "1 %", -1.0: "10 %", 0.0: "100 %"}, fontsize=9)
        label = (
            f"{title}: relative error over incidence angle and roughness, from "
            f"{np.min(error[key]):.1e} to {np.max(error[key]):.1e}"
        )
        made.append(_finish(axes, f"bench-map-{key[:3]}", title, label))
    return made


def _shift(shift: dict[str, Any]) -> Picture:
    axes = _axes("rtol of the normalisation", "shift of the mean  [posterior sd]", width=374.0)
    rtol = [row["rtol"] for row in shift["rows"]]
    for i, ink in enumerate(PARAMETER_INKS):
        _line(axes, rtol, [max(abs(row["shift"][i]), 1e-10) for row in shift["rows"]], ink)
    worst = max(abs(v) for row in shift["rows"] if row["rtol"] <= 1e-6 for v in row["shift"])
    label = f"Shift of the posterior means against rtol; at 1e-6 and below at most {worst:.1e} sd"
    return _finish(axes, "bench-shift", "Shift of the posterior means", label)


def _ladder(ladder: dict[str, Any], key: str, words: str) -> Picture:
    axes = _axes("seconds, search of the optimum included", "largest error  [sd]",
                 subs=(1.0, 2.0, 5.0), words=_plain)  # fmt: skip
    for method, (color, marker) in LADDER.items():
        rows = [r for r in ladder["rows"] if r["method"].startswith(method)]
        _line(axes, [r["seconds"] for r in rows], [r[key] for r in rows], color, marker)
    best = min(ladder["rows"], key=lambda r: float(r[key]))
    label = f"Error of the {words} against seconds; smallest {best[key]:.1e} sd by {best['method']}"
    return _finish(axes, f"bench-ladder-{key[6:]}", f"Error of the {words}", label)


def _proportional(axes: Axes, x: list[float], y: list[float]) -> None:
    """Dashed line of what grows as x, through the last point."""
    axes.plot(x, [y[-1] * v / x[-1] for v in x], color=MUTED, lw=1.0, linestyle=(0, (4, 3)))


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
        _line(axes, series["sizes"], series["microseconds"], PARAMETER_INKS[0])
        _proportional(axes, series["sizes"], series["microseconds"])
        label = f"{title}: {y_label}, growing with exponent {series['exponent']:.2f}"
        made.append(_finish(axes, f"bench-scale-{key}", title, label))
    return made


def _samples(samples: dict[str, Any]) -> Picture:
    axes = _axes("samples", "seconds", subs=(1.0, 2.0, 5.0), words=_plain)
    for way, (color, marker, _) in WORKERS.items():
        series = samples if way == "one" else samples.get(way, {"sizes": [], "seconds": []})
        _line(axes, series["sizes"], series["seconds"], color, marker)
    x, y = samples["sizes"], samples["seconds"]
    _proportional(axes, x, y)
    label = (
        f"Samples fitted: {y[-1] / x[-1]:.2g} s each one after another, two threads "
        f"{samples['threads']['speed_up']:.2g} times as fast"
    )
    return _finish(axes, "bench-scale-samples", "Samples fitted", label)
