"""The page of the benchmark: one self-contained HTML file in the style of the report."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from pbrdf_bayes.bench.figures import LADDER, METHODS, PARAMETER_INKS, WORKERS, draw_figures
from pbrdf_bayes.config import ACCURACIES

_SYMBOLS = {"sigma_n0": "σ_N0", "rho0": "ρ_0", "u_dhr": "u_DHR"}


def render_page(result: dict[str, Any]) -> str:
    """The page as text; the same result gives the same page.

    Parameters
    ----------
    result : dict
        Of `pbrdf_bayes.bench.run.run_bench`.

    Returns
    -------
    str
    """
    environment = Environment(
        loader=FunctionLoader(
            lambda name: files("pbrdf_bayes.bench").joinpath(name).read_text(encoding="utf-8")
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters["symbol"] = _symbol
    environment.filters["sig"] = significant
    environment.filters["sci"] = scientific
    css = files("pbrdf_bayes.report").joinpath("report.css").read_text(encoding="utf-8")
    return environment.get_template("page.html.j2").render(
        **result,
        css=Markup(css),  # our own file
        figures=draw_figures(result),
        methods=METHODS,
        ladder_methods=LADDER,
        workers=WORKERS,
        lines=_lines(result),
        inks=PARAMETER_INKS,
        accuracies=_accuracies(result),
        comparison=_comparison(result),
        closed=_closed_form(result),
        threads=result["scaling"]["threads"],
    )


_LINES = (
    ("points", "points per scan, 10 scans"),
    ("scans", "scans of 81 points"),
    ("sets", "parameter sets a call"),
)


def _lines(result: dict[str, Any]) -> list[dict[str, Any]]:
    """Straight lines through the times against every size."""
    rows = [{"words": words, "unit": "µs", **result["scaling"][key]} for key, words in _LINES]
    samples = {"words": "samples, one after another", "unit": "s", **result["samples"]}
    return [*rows, samples]


def _symbol(name: str) -> Markup:
    """A parameter's symbol, set with a subscript."""
    head, mark, tail = _SYMBOLS.get(name, name).partition("_")
    return Markup("<i>{}</i>{}").format(
        head, Markup("<sub>{}</sub>").format(tail) if mark else Markup("")
    )


def significant(value: float, digits: int = 3) -> str:
    """A number to this many digits, without an exponent where it reads well.

    Examples
    --------
    >>> significant(36.0551), significant(123.45), significant(0.012345)
    ('36.1', '123', '0.0123')
    """
    rounded = float(f"{value:.{digits}g}")
    if abs(rounded) >= 1e7 or 0.0 < abs(rounded) < 1e-3:
        return scientific(value)
    if abs(rounded) >= 10 ** (digits - 1):
        return f"{rounded:,.0f}".replace(",", "\u202f")
    return f"{rounded:.{digits}g}"


def scientific(value: float) -> str:
    """One digit and a power of ten.

    Examples
    --------
    >>> scientific(2.46e-9), scientific(0.0), scientific(1.48)
    ('2×10⁻⁹', '0', '1')
    """
    if value == 0.0 or 0.95 <= abs(value) < 9.5:
        return f"{abs(value):.0f}"
    mantissa, _, exponent = f"{abs(value):.0e}".partition("e")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{raised}"


def _accuracies(result: dict[str, Any]) -> list[dict[str, Any]]:
    """What the levels of ``--accuracy`` cost: measured where measured."""
    shifts = {round(-np.log10(row["rtol"])): row for row in result["posterior_shift"]["rows"]}
    rows = []
    for name, level in ACCURACIES.items():
        row = shifts.get(round(-np.log10(level.rtol)))
        rows.append(
            {
                "name": name,
                "rtol": f"1e-{round(-np.log10(level.rtol))}",
                "shift": max(map(abs, row["shift"])) if row else None,
                "method": level.method,
                "ess": level.ess_target,
            }
        )
    return rows


def _comparison(result: dict[str, Any]) -> list[dict[str, Any]]:
    """At equal error: how much faster ours is than every other method, case by case."""
    rows = []
    for case in result["normalisation"]:
        ours = [p for p in case["points"] if p["method"] == "ours"]
        for method in ("tensor grid", "scipy dblquad"):
            others = [p for p in case["points"] if p["method"] == method]
            if not others:
                continue
            best = min(others, key=lambda p: float(p["error"]))
            equal = [p for p in ours if p["error"] <= best["error"]]
            if equal:
                cheapest = min(equal, key=lambda p: float(p["microseconds"]))
                rows.append(
                    {
                        "case": case["name"],
                        "method": METHODS[method][2],
                        "best": best,
                        "ours": cheapest,
                        "ratio": best["microseconds"] / cheapest["microseconds"],
                        "work": best["evaluations"] / cheapest["evaluations"],
                    }
                )
    return rows


def _closed_form(result: dict[str, Any]) -> dict[str, Any]:
    """Figures for the verdict on the closed forms."""
    error = result["error_map"]
    found: dict[str, Any] = {}
    for key in ("closed_form", "few_terms"):
        values = np.array(error[key])
        found[key] = {
            "median": float(np.median(values)),
            "largest": float(values.max()),
            "below": float(np.mean(values < 1e-3)),
        }
    paint = result["normalisation"][0]["points"]
    found["points"] = [p for p in paint if p["method"] in ("closed form", "few terms")]
    found["ours"] = next(p for p in paint if p["method"] == "ours")
    return found
