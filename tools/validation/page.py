"""The page of the studies: one self-contained HTML file in the style of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.figure import Figure

from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.svg import inline_svg
from tools.validation.sbc import envelope

_INK, _CONTROL, _BAND = "#1f4e79", "#c24d00", "#e3e9ef"
LEAST_COVERED, WIDEST = 0.85, 1.5
_NAMES = {
    "sigma_n0": "σ_N0", "rho0": "ρ_0", "s_rel_s": "s_s", "s_rel_p": "s_p", "tau": "τ",
    "ell_deg": "ℓ", "u_dhr": "u_DHR", "log_likelihood": "ln likelihood",
}  # fmt: skip


def render_page(result: dict[str, Any]) -> str:
    """The page as text; the same result gives the same page.

    Parameters
    ----------
    result : dict
        Of `tools.validation.run.run_studies`.

    Returns
    -------
    str
    """
    return page_template("page.html.j2").render(
        **result, figures=_rank_figures(result),
        verdict_on_coverage=coverage_in_words(result["coverage"]),
    )  # fmt: skip


def page_template(name: str) -> Template:
    """A template of this package, with the style of the report."""
    environment = Environment(
        loader=FunctionLoader(
            lambda name: files("tools.validation").joinpath(name).read_text(encoding="utf-8")
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters["symbol"] = symbol
    css = files("pbrdf_bayes.report").joinpath("report.css").read_text(encoding="utf-8")
    environment.globals["css"] = Markup(css)  # our own file
    return environment.get_template(name)


def coverage_in_words(table: Sequence[Mapping[str, Any]]) -> str:
    """Which misfits the correlated likelihood covers as it should, and which it does not.

    Parameters
    ----------
    table : sequence of mapping
        Of `tools.validation.coverage.tabulate`.
    """
    rows = [r for r in table if r["noise"] == "correlated" and r["width_ratio"]]
    short = [
        f"{r['shape']} (mean {100 * r['covered_mean']:.0f} %, worst "
        f"{100 * min(r['covered'].values()):.0f} %, width up to "
        f"{max(r['width_ratio'].values()):.1f} times)"
        for r in rows
        if r["covered_mean"] < LEAST_COVERED or max(r["width_ratio"].values()) > WIDEST
    ]
    goal = (
        f"the goal of {100 * LEAST_COVERED:.0f} % coverage of 90 % intervals, at most {WIDEST} "
        "times as wide as with the error's covariance known"
    )
    kept = f"{len(rows) - len(short)} of {len(rows)} shapes of misfit keep {goal}"
    return f"{kept}. Not kept: {'; '.join(short)}." if short else f"{kept}."


def symbol(name: str) -> str:
    """How a quantity is written on the page."""
    return _NAMES.get(name, name)


def _rank_figures(result: dict[str, Any]) -> list[tuple[str, Markup]]:
    """ECDF of the ranks minus that of uniform ones, with its band; the control beside it."""
    found: list[tuple[str, Markup]] = []
    with figure_style():
        for name, study in result["ranks"]["quantities"].items():
            figure = Figure(figsize=(2.9, 1.9), layout="constrained")
            axes = figure.add_subplot()
            grid = np.linspace(0.0, 1.0, 201)
            low, high = envelope(result["ranks"]["n"], grid)
            axes.fill_between(grid, low - grid, high - grid, color=_BAND, lw=0)
            for ranks, ink in (
                (study["ranks"], _INK),
                (result["control"]["quantities"][name]["ranks"], _CONTROL),
            ):
                below = np.searchsorted(np.sort(ranks), grid, side="right") / len(ranks)
                axes.plot(grid, below - grid, color=ink, lw=1.4)
            axes.axhline(0.0, color="#59636e", lw=0.6)
            axes.set(xlim=(0, 1), ylim=(-0.3, 0.3), xticks=(0, 0.5, 1), yticks=(-0.2, 0, 0.2))
            axes.tick_params(labelsize=8)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
            words = symbol(name)
            label = f"Ranks of {words}: distribution function minus that of uniform ranks"
            found.append((words, inline_svg(figure, name=f"ranks-{len(found)}", label=label)))
    return found
