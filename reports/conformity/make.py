"""Three simulated paints against one specification: accepted, rejected, undecided.

python reports/conformity/make.py

The paints are the published green one with other grazing-absorption factors, simulated at three
angles of incidence with noise of 3 % (DHR: 0.002) and fitted as drafts. Everything goes through the
command line. ``tests/reports/test_conformity_page.py`` repeats one paint and checks the page.
"""

# ruff: noqa: E501
from __future__ import annotations

import json
import tempfile
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pbrdf_bayes.cli import main
from pbrdf_bayes.io.significant import significant
from pbrdf_bayes.report.conformity import (
    probability_text,
    risk_text,
    rule_text,
    tolerance_text,
    where_text,
)
from pbrdf_bayes.report.figures.axes import angles, figure_of, figure_style, name_axes, shade
from pbrdf_bayes.report.figures.incidence import conformity_pictures, tolerance_axes
from pbrdf_bayes.report.figures.looks import ALARM, Picture
from pbrdf_bayes.report.figures.looks import LOOKS as LIGHT
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import rounded

HERE = Path(__file__).parent
LIMITS = HERE / "limits.toml"
PAINTS = {"paint_a": 0.40, "paint_b": 0.56, "paint_c": 0.487}
"""Grazing-absorption factor of each paint."""
SEEDS = {"paint_a": 11, "paint_b": 12, "paint_c": 13}
KEPT = ("name", "quantity", "polarization", "difference", "unit", "lower", "upper", "verdict",
        "reason", "judged", "probability", "worst", "theta_i_deg", "theta_r_deg", "mean", "u",
        "q025", "q975")  # fmt: skip
DIGITS = 6


def run(*arguments: str) -> None:
    """One verb of the command line; anything but success ends here."""
    code = main(arguments)
    if code != 0:
        raise SystemExit(code)


def judge(paint: str, folder: Path) -> dict[str, Any]:
    """Simulate, fit and judge a paint below ``folder``; its conformity, numbers to `DIGITS`."""
    parameters = {"n": 1.526, "k": 0.193, "sigma_n0": PAINTS[paint], "rho0": 0.47}
    readings, out, result = folder / f"{paint}.csv", folder / paint, folder / f"{paint}.json"
    run("simulate", "--params", json.dumps(parameters), "--sample", paint, "--seed",
        str(SEEDS[paint]), "--theta-i", "0,20,60", "--theta-r=-80:80:4", "--noise", "0.03",
        "--dhr-noise", "0.002", "--out", str(readings))  # fmt: skip
    run("fit", str(readings), "--accuracy", "draft", "--quiet", "--out", str(out))
    run("conform", str(out), "--limits", str(LIMITS), "--json", str(result))
    found = json.loads(result.read_text(encoding="utf-8"))
    found["limits"] = [{key: limit[key] for key in KEPT} for limit in found["limits"]]
    return dict(significant(found, DIGITS))


LOOKS = {"ACCEPT": "#1a6b3c", "REJECT": "#a8201a", "UNDECIDED": "#8a5300"}


def section(paint: str, found: dict[str, Any]) -> str:
    """A paint: its verdict, its limits, the band that was not measured."""
    with figure_style():
        pictures = conformity_pictures({"conformity": found}, tag=f"{paint}-")
        pictures += [closeup(limit, paint) for limit in found["limits"] if len(limit["mean"]) > 1]
    rows = "".join(row(limit) for limit in found["limits"])
    because = f": {found['reason']}" if found["reason"] else ""
    panels = "".join(f"<figure><h4>{escape(str(p.title))}</h4>{p.svg}</figure>" for p in pictures)
    return f"""<section>
<h2>{paint}, σ<sub>N0</sub> = {PAINTS[paint]:g}: <span style="color:{LOOKS[found["verdict"]]}">{found["verdict"].lower()}</span></h2>
<p>Joint probability of conformity {probability_text(found["probability"])}{escape(because)}.{risk_text(found)}</p>
<div class="scroll"><table>
<thead><tr><th>Limit</th><th>Tolerance</th><th>Estimate ± u</th><th>Where</th><th>Probability of conformity</th><th>Verdict</th></tr></thead>
<tbody>{rows}</tbody></table></div>
<div class="pair">{panels}</div>
</section>"""


RANGE = (-30.0, 20.0)
"""Of a curve over its limit, less 1 [%]."""


def closeup(limit: dict[str, Any], paint: str) -> Picture:
    """A curve over its upper limit, where it is least probably met: there the band can be seen."""
    against = "theta_r_deg" if limit["theta_r_deg"] else "theta_i_deg"
    x = np.array(limit[against])
    low, mean, high = (
        100.0 * (np.array(limit[key]) / limit["upper"] - 1.0) for key in ("q025", "mean", "q975")
    )
    at = limit["worst"]
    near = np.flatnonzero((mean >= RANGE[0]) & (mean <= RANGE[1]))
    near = np.arange(max(near[0] - 1, 0), min(near[-1] + 2, x.size))
    across = (float(x[near[0]]), float(x[near[-1]]))
    (axes,) = tolerance_axes()
    axes.set(xlim=across, ylim=RANGE)
    angles(axes.xaxis)
    name_axes(axes, "scattering angle θ_r" if limit["theta_r_deg"] else "incidence angle θ_i",
              f"{limit['quantity'].upper()} over its limit, less 1 [%]", beside=50)  # fmt: skip
    color = LIGHT[limit["polarization"]].color
    shade(axes, x[near], low[near], high[near], color, 0.25)
    axes.plot(x[near], mean[near], color=color)
    axes.axhline(0.0, color=ALARM, lw=1.4)
    label = (
        f"{limit['name']}, relative to the limit: {mean[at]:.1f} %, 95 % from {low[at]:.1f} to "
        f"{high[at]:.1f} % at {x[at]:g} degrees"
    )
    name = f"closeup-{paint}-{limit['quantity']}"
    return Picture(
        inline_svg(figure_of(axes), name=name, label=label), f"{limit['name']}: near the limit"
    )


def row(limit: dict[str, Any]) -> str:
    """A limit at the point of its band where it is least probably met."""
    at = limit["worst"]
    shown = rounded(limit["mean"][at], limit["u"][at])
    cells = (
        tolerance_text(limit), f"{shown.value} ± {shown.uncertainty}", where_text(limit, at) or "–",
        probability_text(limit["probability"]), limit["verdict"].lower(),
    )  # fmt: skip
    return f"<tr><th>{escape(limit['name'])}</th>{''.join(f'<td>{c}</td>' for c in cells)}</tr>"


def page(stored: dict[str, Any]) -> str:
    """The whole page."""
    rule = rule_text(next(iter(stored.values())))
    style = (HERE.parent / "pages.css").read_text(encoding="utf-8")
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Conformity of three simulated paints</title><link rel="icon" href="data:,">
<style>{style}
h4 {{ font: 600 14px/1.35 var(--sans); margin: 0 0 4px; }}</style></head>
<body><main>
<p class="kicker"><span><b>pbrdf_bayes</b> · Conformity with a specification</span><span>simulated paints</span></p>
<h1>One specification, three paints</h1>
<p class="lead">The same limits, the same noise: one paint is accepted, one is rejected, and one lies where its readings do not decide.</p>
<p>{escape(rule)}</p>
<p>Shaded: 95 % at each angle, of the BRDF of the sample with the discrepancy of the model; red: the tolerance limits. A band conforms where the whole curve lies within them. The second pair of each paint is the same relative to the limit, near to it, on one scale for all: where the readings do not decide, the shade lies on both sides.</p>
{"".join(section(paint, found) for paint, found in stored.items())}
<footer>Limits: <code>limits.toml</code>; numbers: <code>conformity.json</code>; made by <code>python reports/conformity/make.py</code>.</footer>
</main></body></html>
"""


def make(target: Path) -> None:
    """Judge all three and write numbers and page into ``target``."""
    with tempfile.TemporaryDirectory() as scratch:
        stored = {paint: judge(paint, Path(scratch)) for paint in PAINTS}
    text = json.dumps(stored, ensure_ascii=False, separators=(",", ":"))
    (target / "conformity.json").write_text(text + "\n", encoding="utf-8")
    (target / "index.html").write_text(page(stored), encoding="utf-8")


if __name__ == "__main__":
    make(HERE)
