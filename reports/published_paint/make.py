"""Draw the curves of the 2011 paper from its published parameters: index.html beside this file.

python reports/published_paint/make.py

Uses the public interface of the package only. ``test_published_paint.py`` computes the
numbers again and compares them with those in the committed page.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator, NullFormatter

import pbrdf_bayes as pb

HERE = Path(__file__).parent
PAINT = pb.GREEN_PAINT
RHO0_FROM_SCAN = {0.0: 0.473, 20.0: 0.457}
"""rho0 that the paper found from the s scan at this angle of incidence [deg]."""
THETA_I_DEG = (0.0, 20.0, 40.0, 60.0, 80.0)
PAIRS_DEG = ((0.0, 20.0), (20.0, 40.0), (20.0, 60.0), (40.0, 60.0), (20.0, 80.0), (60.0, 80.0))
RTOL = 1e-10

INK, MUTED, GRID = "#1c2126", "#59636e", "#e6e9ec"
LOOKS = {"s": ("#0067a5", "-"), "p": ("#c24d00", (0, (4.2, 2.1)))}
ANGLE_COLORS = ("#7a3b8f", "#0067a5", "#00745a", "#a36a00", "#a8201a")
WIDTH, HEIGHT = 470, 350


# Numbers ------------------------------------------------------------------------------------------


def rho_q(polarization: str, theta_deg: Any) -> Any:
    """Half width of the lobe at a direction, Eq. (5); F_q is the DHR over sigma_N0, Eq. (2)."""
    reflectance = pb.dhr(PAINT, theta_deg, polarization) / PAINT.sigma_n0
    normal = pb.dhr(PAINT, 0.0, polarization) / PAINT.sigma_n0
    return PAINT.rho0 * (1.0 - reflectance) / (1.0 - normal)


def numbers() -> dict[str, Any]:
    """What the page states, at round angles."""
    angles, directions = np.arange(0.0, 81.0, 10.0), np.arange(-80.0, 81.0, 10.0)
    return {
        "parameters": {name: getattr(PAINT, name) for name in ("n", "k", "sigma_n0", "rho0")},
        "theta_i_deg": angles.tolist(),
        "dhr": {q: rounded(pb.dhr(PAINT, angles, q)) for q in "sp"},
        "rho_q": {q: rounded(rho_q(q, angles)) for q in "sp"},
        "pseudo_brewster_deg": round(float(_darkest_angle()), 2),
        "theta_r_deg": directions.tolist(),
        "brdf": {
            q: {f"{a:g}": rounded(pb.brdf(PAINT, a, directions, q, rtol=RTOL)) for a in THETA_I_DEG}
            for q in "sp"
        },
        "reciprocity": [
            {"theta_a_deg": a, "theta_b_deg": b}
            | {q: rounded([pb.reciprocity_ratio(PAINT, a, b, q)])[0] for q in "spu"}
            for a, b in PAIRS_DEG
        ],
    }


def rounded(values: Any) -> list[float]:
    """Eight significant digits."""
    return [float(f"{value:.8g}") for value in np.atleast_1d(values)]


def _darkest_angle() -> float:
    """Angle of incidence at which the DHR for p is least [deg]."""
    grid = np.arange(40.0, 75.0, 0.01)
    return float(grid[np.argmin(pb.dhr(PAINT, grid, "p"))])


# Figures ------------------------------------------------------------------------------------------


def new_axes(title_y: str, title_x: str) -> tuple[Figure, Axes]:
    """One plot with its vertical quantity above the axis."""
    figure = Figure(figsize=(WIDTH / 72, HEIGHT / 72), dpi=72)
    axes = figure.add_axes((0.112, 0.135, 0.865, 0.775))
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", length=0, colors=MUTED, labelsize=11.5, pad=6)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color("#9aa4ae")
    axes.set_xlabel(title_x, color=INK, fontsize=12, labelpad=5)
    axes.text(-0.128, 1.045, title_y, transform=axes.transAxes, color=INK, fontsize=12)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
    return figure, axes


def log_axis(axes: Axes, ticks: Sequence[float], low: float, high: float) -> None:
    """Logarithmic axis with its numbers written out."""
    axes.set_yscale("log")
    axes.set_yticks(ticks, [f"{tick:f}".rstrip("0").rstrip(".") for tick in ticks])
    axes.set_ylim(low, high)
    axes.yaxis.set_minor_formatter(NullFormatter())


def label(
    axes: Axes, x: float, y: float, text: str, color: str, *, align: str = "center", dy: float = 0.0
) -> None:
    """Name of a curve beside it, so that colour is not needed."""
    axes.annotate(
        text, (x, y), (0, dy), textcoords="offset points", color=color, fontsize=12,
        ha=align, va="center", fontweight="bold", annotation_clip=False,
    )  # fmt: skip


def draw_dhr() -> Figure:
    """Fig. 2: DHR against the angle of incidence."""
    figure, axes = new_axes("DHR", "angle of incidence θ_i [°]")
    fine, read = np.linspace(0.0, 85.0, 341), np.arange(10.0, 81.0, 10.0)
    for q, (color, dash) in LOOKS.items():
        axes.plot(fine, pb.dhr(PAINT, fine, q), color=color, ls=dash, lw=1.7)
        axes.plot(read, pb.dhr(PAINT, read, q), "o" if q == "s" else "s", color=color, ms=4.5)
    axes.set(xlim=(0, 86), ylim=(0.0, 0.4))
    label(axes, 66.0, float(pb.dhr(PAINT, 70.0, "s")) + 0.02, "s", LOOKS["s"][0])
    label(axes, 80.5, 0.065, "p", LOOKS["p"][0])
    return figure


def draw_widths() -> Figure:
    """Fig. 3: the width of the lobe, Eq. (5)."""
    figure, axes = new_axes("ρ_q", "angle of the mean direction [°]")
    fine = np.linspace(0.0, 89.9, 360)
    for q, (color, dash) in LOOKS.items():
        axes.plot(fine, rho_q(q, fine), color=color, ls=dash, lw=1.7)
    axes.set(xlim=(0, 90), ylim=(0.0, 0.58))
    axes.xaxis.set_major_locator(MultipleLocator(15))
    label(axes, 52.0, 0.375, "s", LOOKS["s"][0])
    label(axes, 60.0, 0.52, "p", LOOKS["p"][0])
    return figure


def draw_calibration() -> Figure:
    """Fig. 4: the two scans that rho0 was taken from."""
    figure, axes = new_axes("BRDF [sr⁻¹], s", "scattering angle θ_r [°]")
    grid = np.arange(-80.0, 80.1, 0.5)
    for (theta_i, rho0), color in zip(RHO0_FROM_SCAN.items(), ANGLE_COLORS, strict=False):
        own = pb.brdf(replace(PAINT, rho0=rho0), theta_i, grid, "s", rtol=RTOL)
        shared = pb.brdf(PAINT, theta_i, grid, "s", rtol=RTOL)
        axes.plot(grid, own, color=color, lw=1.7)
        axes.plot(grid, shared, color=color, lw=1.1, ls=(0, (1.5, 2.0)))
        label(axes, grid[0] + 1, float(own[0]), f"{theta_i:g}°", color, align="left", dy=9)
    log_axis(axes, (0.002, 0.005, 0.01, 0.02, 0.05), 0.0018, 0.05)
    degree_axis(axes)
    return figure


def draw_scans(q: str, low: float, high: float) -> Figure:
    """Figs. 5 and 6: the scans of a polarisation at the five angles of incidence."""
    figure, axes = new_axes(f"BRDF [sr⁻¹], {q}", "scattering angle θ_r [°]")
    grid = np.arange(-85.0, 85.1, 0.25)
    first = {}
    for theta_i, color in zip(THETA_I_DEG, ANGLE_COLORS, strict=True):
        curve = pb.brdf(PAINT, theta_i, grid, q, rtol=RTOL)
        axes.plot(grid, curve, color=color, lw=1.7, ls=LOOKS[q][1])
        first[f"{theta_i:g}°", color] = float(curve[0])
        axes.plot([theta_i], pb.brdf(PAINT, theta_i, theta_i, q), "|", color=color, ms=11, mew=1.6)
    log_axis(axes, (0.0001, 0.001, 0.01, 0.1, 1.0, 10.0), low, high)
    name_curves(axes, first)
    degree_axis(axes)
    return figure


def name_curves(axes: Axes, first: Mapping[tuple[str, str], float]) -> None:
    """Names at the left ends of curves, moved apart where they would touch."""
    ends = sorted(first.items(), key=lambda item: item[1])
    at = np.log10([value for _, value in ends])
    gap = 12.5 / (0.775 * HEIGHT) * np.diff(np.log10(axes.get_ylim()))[0]
    for _ in range(200):
        lack = np.clip(gap - np.diff(at), 0.0, None)
        at[1:] += 0.4 * lack
        at[:-1] -= 0.4 * lack
    for ((text, color), value), log_y in zip(ends, at, strict=True):
        axes.plot([-90, -85], [10.0**log_y, value], color=color, lw=0.8)
        label(axes, -91, 10.0**log_y, text, color, align="right")


def degree_axis(axes: Axes) -> None:
    """Scattering angles, with room for the names of curves on the left."""
    axes.set_xlim(-104, 88)
    axes.xaxis.set_major_locator(MultipleLocator(20))
    axes.set_xticks(np.arange(-80, 81, 20))


def draw_reciprocity() -> Figure:
    """Ratio of the BRDF to the BRDF with source and detector exchanged."""
    figure, axes = new_axes("f(20° → θ) / f(θ → 20°)", "θ [°]")
    grid = np.arange(0.0, 85.1, 0.5)
    for q, (color, dash) in LOOKS.items():
        ratio = [pb.reciprocity_ratio(PAINT, 20.0, theta, q) for theta in grid]
        axes.plot(grid, ratio, color=color, ls=dash, lw=1.7)
    axes.axhline(1.0, color=INK, lw=0.9)
    log_axis(axes, (0.5, 1.0, 2.0, 5.0, 10.0, 20.0), 0.4, 30.0)
    axes.set_xlim(0, 86)
    label(axes, 79.0, 3.4, "s", LOOKS["s"][0])
    label(axes, 47.0, 3.6, "p", LOOKS["p"][0])
    label(axes, 2.0, 0.8, "reciprocal", INK, align="left")
    return figure


def inline_svg(figure: Figure, name: str, alternative: str) -> str:
    """A figure as an element of the page: text stays text, no size, no ids that could collide."""
    FigureCanvasSVG(figure)
    file = StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.hashsalt": name}):
        figure.savefig(file, format="svg", dpi=72, metadata=nothing, transparent=True)
    text = file.getvalue()
    body = text[text.index(">", text.index("<svg")) + 1 :]
    body = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    body = re.sub(r'="[^"]*"', lambda m: re.sub(r"-?\d+\.\d{3,}", _two_decimals, m[0]), body)
    body = re.sub(r"(?<=[\"; ])font: [^;\"]*", _font, body)
    body = re.sub(r"font-family: [^;\"]*;? ?", "", body)
    body = re.sub(r' transform="rotate\(-?0 [^"]*\)"', "", body)
    body = re.sub(r">([^<>]*)_(\w)([^<>]*)</text>", _lowered, body)
    body = re.sub(r">\s+<", "><", body.strip())
    opening = f'<svg class="plot" viewBox="0 0 {WIDTH} {HEIGHT}" role="img"'
    return f'{opening} aria-label="{html.escape(alternative)}">{body}'


def _two_decimals(match: re.Match[str]) -> str:
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")


def _font(match: re.Match[str]) -> str:
    """Size and weight only; the family is that of the page."""
    size = re.search(r"[\d.]+px", match[0])
    weight = "font-weight: 600; " if re.search(r"bold|700", match[0]) else ""
    return f"{weight}font-size: {size[0] if size else '12px'}"


def _lowered(match: re.Match[str]) -> str:
    """The letter after an underscore as a subscript."""
    low = f'<tspan dy=".2em" font-size=".8em">{match[2]}</tspan>'
    return f'>{match[1]}{low}<tspan dy="-.16em">{match[3]}</tspan></text>'


# Page ---------------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Small table of numbers, the first column a label."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(
        f"<tr><th>{row[0]}</th>" + "".join(f"<td>{cell}</td>" for cell in row[1:]) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def written(value: float) -> str:
    """Three significant digits."""
    if value < 0.001:
        mantissa, exponent = f"{value:.2e}".split("e")
        return f"{mantissa} × 10<sup>−{-int(exponent)}</sup>"
    return f"{value:.{2 - int(np.floor(np.log10(value)))}f}"


def values_of_dhr(found: Mapping[str, Any]) -> str:
    """Table under Figs. 2 and 3."""
    columns = (found["theta_i_deg"], *found["dhr"].values(), *found["rho_q"].values())
    rows = [[f"{row[0]:g}°", *map(written, row[1:])] for row in zip(*columns, strict=True)]
    return table(("θ<sub>i</sub>", "DHR s", "DHR p", "ρ<sub>s</sub>", "ρ<sub>p</sub>"), rows)


def values_of_brdf(found: Mapping[str, Any], q: str) -> str:
    """Table under Figs. 5 and 6."""
    scans = found["brdf"][q]
    columns = (found["theta_r_deg"], *scans.values())
    rows = [
        [f"{row[0]:g}°".replace("-", "−"), *map(written, row[1:])]
        for row in zip(*columns, strict=True)
    ]
    return table(("θ<sub>r</sub>", *(f"θ<sub>i</sub> = {a}°" for a in scans)), rows)


def values_of_reciprocity(found: Mapping[str, Any]) -> str:
    """Table of the reciprocity defect."""
    rows = [
        [f"{r['theta_a_deg']:g}° and {r['theta_b_deg']:g}°", *(f"{r[q]:.2f}" for q in "spu")]
        for r in found["reciprocity"]
    ]
    return table(("<i>a</i> and <i>b</i>", "s", "p", "unpolarised"), rows)


def alternatives(found: Mapping[str, Any]) -> dict[str, str]:
    """What each figure shows, in words and numbers."""
    dhr, width, darkest = found["dhr"], found["rho_q"], found["pseudo_brewster_deg"]
    ratio = ratio_at(found, 20.0, 60.0)

    def peaks(q: str) -> str:
        found_there = (f"{pb.brdf(PAINT, a, a, q):.3g} at {a:g} degrees" for a in THETA_I_DEG)
        return (
            f"{q}-polarised BRDF per steradian in the specular direction: {', '.join(found_there)}"
        )

    return {
        "dhr": f"DHR against angle of incidence: s rises from {dhr['s'][0]:.4f} at 0 to "
        f"{dhr['s'][-1]:.3f} at 80 degrees; p falls to its least value at {darkest:.1f} and rises "
        f"to {dhr['p'][-1]:.3f} at 80 degrees.",
        "widths": f"Half width against angle: {PAINT.rho0:g} at 0 for both; at 80 degrees "
        f"{width['s'][-1]:.3f} for s and {width['p'][-1]:.3f} for p.",
        "calibration": "s-polarised BRDF at 0 and 20 degrees of incidence, each with its own rho0 "
        "and with 0.47: the two curves of a scan differ by less than 4 per cent.",
        "s": f"{peaks('s')}.",
        "p": f"{peaks('p')}.",
        "reciprocity": "Ratio of the BRDF from 20 degrees to theta and back: 1 at 20 degrees; at "
        f"60 degrees {ratio['s']:.2f} for s and {ratio['p']:.2f} for p.",
    }


def ratio_at(found: Mapping[str, Any], a_deg: float, b_deg: float) -> Mapping[str, float]:
    """Row of the reciprocity table."""
    wanted = (a_deg, b_deg)
    rows = found["reciprocity"]
    return next(row for row in rows if (row["theta_a_deg"], row["theta_b_deg"]) == wanted)


def page(found: Mapping[str, Any]) -> str:
    """The whole page: the template with its figures, tables and numbers."""
    figures = {
        "dhr": draw_dhr(),
        "widths": draw_widths(),
        "calibration": draw_calibration(),
        "s": draw_scans("s", 2e-4, 6e1),
        "p": draw_scans("p", 3e-5, 3e1),
        "reciprocity": draw_reciprocity(),
    }
    words = alternatives(found)
    ratio = ratio_at(found, 20.0, 60.0)
    plots = {f"plot_{name}": inline_svg(plot, name, words[name]) for name, plot in figures.items()}
    parts = plots | {
        **{name: f"{value:g}" for name, value in found["parameters"].items()},
        "table_dhr": values_of_dhr(found),
        "table_s": values_of_brdf(found, "s"),
        "table_p": values_of_brdf(found, "p"),
        "table_reciprocity": values_of_reciprocity(found),
        "darkest": f"{found['pseudo_brewster_deg']:.1f}",
        "ratio_s": f"{ratio['s']:.2f}",
        "ratio_p": f"{ratio['p']:.2f}",
        "numbers": json.dumps(found),
        "css": (HERE.parent / "pages.css").read_text(encoding="utf-8"),
    }
    template = (HERE / "page.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda m: parts[m[1]], template)


def build() -> str:
    """Numbers, figures and page."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"svg.fonttype": "none", "text.parse_math": False})
        return page(numbers())


if __name__ == "__main__":
    (HERE / "index.html").write_text(build(), encoding="utf-8")
