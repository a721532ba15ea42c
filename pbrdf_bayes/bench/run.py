"""The benchmark as a whole: measure, tabulate, write the page and its JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from pbrdf_bayes import __version__
from pbrdf_bayes.bench.inference import inference_ladder, posterior_shift
from pbrdf_bayes.bench.normalisation import error_map, work_precision
from pbrdf_bayes.bench.page import render_page
from pbrdf_bayes.bench.samples import measure_samples
from pbrdf_bayes.bench.scenes import measure_scenes
from pbrdf_bayes.bench.speed import measure_headline, measure_options, measure_scaling
from pbrdf_bayes.bench.timing import describe_machine
from pbrdf_bayes.io.run_folder import write_text
from pbrdf_bayes.io.significant import significant

DEFAULT_FOLDER = Path("reports") / "accuracy_vs_time"
SCHEMA_VERSION = 1
_DIGITS = 5


def run_bench(
    *, quick: bool = False, told: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Measure what accuracy costs in time on this machine.

    Parameters
    ----------
    quick : bool
        Fewer and shorter measurements: under a minute.
    told : callable
        Told the name of each stage as it begins.

    Returns
    -------
    dict
        headline, normalisation, error_map, posterior_shift, ladder, scaling, samples, options,
        scenes, machine and what was run when; the content of ``bench.json``.
    """
    started = perf_counter()
    machine = describe_machine()
    stages: dict[str, Callable[[], Any]] = {
        "headline": lambda: measure_headline(rounds=25 if quick else 250),
        "normalisation": lambda: work_precision(quick=quick),
        "error_map": lambda: error_map(n_angles=24 if quick else 36, n_widths=24 if quick else 36),
        "posterior_shift": lambda: posterior_shift(quick=quick),
        "ladder": lambda: inference_ladder(quick=quick),
        "scaling": lambda: measure_scaling(quick=quick),
        "samples": lambda: measure_samples(quick=quick),
        "options": lambda: measure_options(quick=quick),
        "scenes": lambda: measure_scenes(quick=quick),
    }
    found: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "quick": quick,
        "machine": machine,
    }
    with threadpool_limits(limits=1):
        for name, measure in stages.items():
            told(name.replace("_", " "))
            found[name] = significant(measure(), _DIGITS)
    found["seconds"] = round(perf_counter() - started, 1)
    return found


def write_bench(result: dict[str, Any], folder: Path) -> Path:
    """Write ``index.html`` and ``bench.json``; returns the page's path.

    Parameters
    ----------
    result : dict
        Of `run_bench`.
    folder : Path
        Made where it is missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "bench.json", json.dumps(result, indent=1) + "\n")
    page = folder / "index.html"
    write_text(page, render_page(result))
    return page


def text_table(result: dict[str, Any]) -> str:
    """The main figures as plain text."""
    head, machine = result["headline"], result["machine"]
    lines = [
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load']}",
        "",
        "likelihood at paper size (10 scans x 321 points, 16 DHR), rtol 1e-6, 64 sets a call",
    ]
    for words, key, ratio in (
        ("log-likelihood", "microseconds", ""),
        ("arithmetic floor", "floor_microseconds", f"1/{head['floor_ratio']:.2f}"),
        ("with gradient", "gradient_microseconds", f"x {head['gradient_ratio']:.2f}"),
        ("plain NumPy, 100 x 100 grid", "plain_microseconds", f"x {head['plain_ratio']:.0f}"),
    ):
        lines.append(f"  {words:<34}{head[key]:10.1f} us a set  {ratio}")
    lines.append(f"  {'two threads':<34}{head['two_threads']:10.2f} times as fast")
    lines.append(f"  {'the floor, two threads':<34}{head['two_threads_floor']:10.2f} times as fast")
    heading = f"  {'method':<16}{'setting':<12}{'error':>10}{'us':>12}{'evaluations':>14}"
    for case in result["normalisation"]:
        lines += ["", f"normalisation, {case['name']}", heading]
        lines += [
            f"  {p['method']:<16}{p['setting']:<12}{p['error']:>10.1e}{p['microseconds']:>12.3f}"
            f"{p['evaluations']:>14}"
            for p in case["points"]
        ]
    lines += ["", "shift of posterior means [sd], largest of all parameters"]
    lines += [
        f"  rtol {row['rtol']:.0e}{max(map(abs, row['shift'])):>14.1e}"
        for row in result["posterior_shift"]["rows"]
    ]
    lines += [
        "",
        f"  {'inference':<20}{'seconds':>9}{'mean':>10}{'sd':>10}{'95 % ends':>12}   [sd]",
    ]
    lines += [
        f"  {r['method']:<20}{r['seconds']:>9.2f}{r['error_mean']:>10.1e}{r['error_sd']:>10.1e}"
        f"{r['error_interval']:>12.1e}"
        for r in result["ladder"]["rows"]
    ]
    lines += ["", f"  {'options':<52}{'us':>8}{'ratio':>8}"]
    lines += [
        f"  {row['option']:<52}{row['microseconds']:>8.1f}{row['ratio']:>8.2f}"
        for row in result["options"]
    ]
    lines += ["", f"  {'scenes, a draw':<52}{'us':>8}{'ratio':>8}"]
    lines += [
        f"  {row['scene']:<52}{row['microseconds']:>8.1f}{row['ratio']:>8.2f}"
        for row in result["scenes"]
    ]
    samples = result["samples"]
    each = samples["seconds"][-1] / samples["sizes"][-1]
    gains = [
        f"two {way} {samples[way]['speed_up']:.2f}"
        for way in ("threads", "processes")
        if way in samples
    ]
    together = f"{', '.join(gains)} times as fast"
    lines += ["", f"samples fitted one after another: {each:.2f} s each; {together}"]
    exponents = ", ".join(
        f"{name} {series['exponent']:.2f}"
        for name, series in [*result["scaling"].items(), ("samples", samples)]
        if "exponent" in series
    )
    return "\n".join([*lines, "", f"growth: exponents {exponents}", ""])
