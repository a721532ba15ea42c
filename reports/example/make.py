"""The one committed example of a run: simulate, fit, predict, and draw README's picture.

python reports/example/make.py

The readings are those of the published green paint, simulated as in data/ but thinned to three
angles of incidence and every fourth degree, which keeps the committed files small, and with noise
of 8 % (DHR: 0.002), which makes the bands wide enough to be seen. Everything goes through the
command line. ``tests/reports/test_example_report.py`` repeats the fit and compares.
"""

from __future__ import annotations

import csv
import re
import shutil
import tempfile
from io import StringIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from pbrdf_bayes.cli import main

HERE = Path(__file__).parent
PARAMETERS = '{"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}'
SIMULATE = (
    "--params", PARAMETERS, "--sample", "green_paint_simulated", "--seed", "2011",
    "--theta-i", "0,20,60", "--theta-r=-80:80:4", "--noise", "0.08", "--dhr-noise", "0.002",
)  # fmt: skip
READINGS = "green_paint_simulated.csv"
KEPT = ("summary.json", "report.html")

INK, MUTED, GRID = "#1c2126", "#59636e", "#e6e9ec"
LOOKS = {"s": ("#0067a5", "-", "o"), "p": ("#c24d00", (0, (4.2, 2.1)), "s")}
PANELS = (
    ("20° of incidence, fitted", 20.0, (0.001, 0.05), (0.001, 0.003, 0.01, 0.03)),
    ("60° of incidence, fitted", 60.0, (1e-4, 2.0), (0.0001, 0.001, 0.01, 0.1, 1.0)),
    ("75° of incidence, not measured", 75.0, (1e-4, 20.0), (0.0001, 0.001, 0.01, 0.1, 1.0, 10.0)),
)


def run(*arguments: str) -> None:
    """One verb of the command line; anything but success ends here."""
    code = main(arguments)
    if code != 0:
        raise SystemExit(code)


def fit_example(folder: Path) -> Path:
    """Readings and run below ``folder``; returns the run folder."""
    readings = folder / READINGS
    run("simulate", *SIMULATE, "--out", str(readings))
    out = folder / "run"
    run("fit", str(readings), "--accuracy", "draft", "--quiet", "--out", str(out))
    return out


def columns_of(path: Path, q: str, angle: float) -> dict[str, np.ndarray]:
    """Numbers of the BRDF rows of one curve or scan in a tidy CSV."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if (row["quantity"], row["polarization"], float(row["theta_i_deg"]))
            == ("brdf", q, angle)
        ]
    wanted = ("theta_r_deg", "value", "q05", "q95", "pred_q05", "pred_q95")
    return {name: np.array([float(row[name]) for row in rows if name in row]) for name in wanted}


def draw(readings: Path, curves: Path) -> Figure:
    """Readings and predicted curves with both bands."""
    figure = Figure(figsize=(12.4, 4.1), dpi=72, facecolor="white")
    for index, (title, angle, limits, ticks) in enumerate(PANELS):
        axes = figure.add_axes((0.057 + 0.33 * index, 0.21, 0.265, 0.655))
        dress(axes, title, limits, ticks)
        for q in LOOKS:
            plot_curve(axes, q, columns_of(curves, q, angle), columns_of(readings, q, angle))
    note = (
        "Points: readings.  Line: posterior median.  Light band: 90 % of new readings.  "
        "Dark band: 90 % for the curve itself."
    )
    figure.text(0.057, 0.02, note, color=MUTED, fontsize=12)
    figure.text(0.008, 0.925, "BRDF [sr⁻¹]", color=INK, fontsize=12.5)
    return figure


def dress(axes: Axes, title: str, limits: tuple[float, float], ticks: tuple[float, ...]) -> None:
    """Grid, axes and title of a panel."""
    axes.set_yscale("log")
    axes.set_yticks(ticks, [f"{tick:f}".rstrip("0").rstrip(".") for tick in ticks])
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlim=(-85, 88), ylim=limits)
    axes.set_xticks([-80, -40, 0, 40, 80], ["−80", "−40", "0", "40", "80"])
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", length=0, colors=MUTED, labelsize=12)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color("#9aa4ae")
    axes.set_xlabel("scattering angle [°]", color=INK, fontsize=12.5)
    axes.set_title(title, color=INK, fontsize=13.5, fontweight="bold", pad=10)


def plot_curve(
    axes: Axes, q: str, curve: dict[str, np.ndarray], readings: dict[str, np.ndarray]
) -> None:
    """Curve, bands and readings of a polarisation, with its name at the right end."""
    color, dash, marker = LOOKS[q]
    theta, median = curve["theta_r_deg"], curve["value"]
    axes.fill_between(theta, curve["pred_q05"], curve["pred_q95"], color=color, alpha=0.22, lw=0)
    axes.fill_between(theta, curve["q05"], curve["q95"], color=color, alpha=0.5, lw=0)
    axes.plot(theta, median, color=color, ls=dash, lw=1.1)
    axes.plot(readings["theta_r_deg"], readings["value"], marker, color=color, ms=3.2, mew=0)
    axes.annotate(
        q, (theta[-1], median[-1]), (5, 0), textcoords="offset points", color=color,
        fontsize=13.5, fontweight="bold", va="center", annotation_clip=False,
    )  # fmt: skip


def svg_text(figure: Figure) -> str:
    """The picture without date and version, short numbers, in the reader's sans serif."""
    FigureCanvasSVG(figure)
    file = StringIO()
    figure.savefig(file, format="svg", dpi=72, metadata=dict.fromkeys(("Date", "Creator", "Type")))
    text = file.getvalue().replace("'DejaVu Sans'", "Arial, Helvetica, sans-serif")
    return re.sub(
        r' (?:d|x|y|width|height)="[^"]*"',
        lambda m: re.sub(r"\d+\.\d{3,}", lambda n: f"{float(n[0]):.2f}", m[0]),
        text,
    )


def make(target: Path) -> None:
    """Fit, and put report, summary and picture into ``target``."""
    angles = ",".join(f"{angle:g}" for _, angle, _, _ in PANELS)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        out = fit_example(folder)
        table = folder / "curves.csv"
        run("predict", str(out), "--theta-i", angles, "--theta-r=-80:80:2", "--out", str(table))
        for name in KEPT:
            shutil.copyfile(out / name, target / name)
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "example"})
            picture = svg_text(draw(folder / READINGS, table))
        (target / "curves.svg").write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    make(HERE)
