"""The sentences and short lists of the report that depend on the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pbrdf_bayes.document import run_number
from pbrdf_bayes.report.numbers import (
    MISSING,
    THIN,
    count,
    dex_as_percent,
    finite,
    fixed,
    number,
    seconds,
)
from pbrdf_bayes.words import say

Record = Mapping[str, Any]

WORDS = {
    "n_ensembles": "independent ensembles",
    "n_walkers": "walkers in each",
    "n_steps": "steps",
    "n_burn": "steps discarded",
    "thin": "kept one step in",
    "n_draws": "draws kept",
    "acceptance": "accepted fraction",
    "autocorrelation_time": "autocorrelation time (steps)",
    "k_hat": "Pareto k-hat",
    "n_evaluations": "model evaluations",
    "rtol": "relative tolerance",
    "normalisation_error": "normalisation error",
    "microseconds_per_evaluation": "time per evaluation (µs)",
}
"""Names of the entries of the summary where the key alone would not be read with pleasure."""


def banner(summary: Record) -> dict[str, str] | None:
    """Say on top that a page is not a result to be used."""
    failing = _failing(summary)
    if not failing:
        return None
    return {"title": say(f"page.{failing}.title"), "text": say(f"page.{failing}")}


def _failing(summary: Record) -> str:
    if summary["status"] != "done":
        return "not_converged"
    return "failed" if summary["verdict"] == "FAIL" else ""


def applicability(summary: Record) -> dict[str, Any]:
    """Whether the parameters are properties of the material, and what that was not tested for.

    Where the fit failed its checks only the latter is said of a model that applies.
    """
    found = summary.get("applicability") or {}
    caveats, said = found.get("caveats", ()), str(found.get("statement", ""))
    applies = found.get("verdict", "applies") == "applies"
    only_caveats = applies and _failing(summary)
    return {"applies": applies, "text": " ".join(caveats) if only_caveats else said}


def reservation(summary: Record) -> str:
    """Repeat that beside the values and the bands."""
    failing = _failing(summary)
    return say(f"reservation.{failing}") if failing else ""


def meta(summary: Record) -> str:
    """Wavelength and number of readings."""
    data = summary["input"]
    scans, n_dhr = len(data["scans"]), data["n_dhr"]
    brdf = f"{scans} BRDF scan{'s' * (scans != 1)} ({_readings(data['n_brdf'])})"
    return " · ".join([
        f"{number(summary['wavelength_um'], digits=5)}{THIN}µm",
        brdf if scans else "no BRDF scans",
        f"{count(n_dhr)} DHR reading{'s' * (n_dhr != 1)}" if n_dhr else "no DHR readings",
    ])  # fmt: skip


def values_note(summary: Record) -> str:
    """Say what the values of the first screen are."""
    shape = str(summary["line_shape"]).capitalize()
    fixed_ones = [
        f"{p['symbol']} = {number(p['mean'])}"
        for p in summary["parameters"].values()
        if p["kind"] == "fixed"
    ]
    held = f" Held fixed: {', '.join(fixed_ones)}." if fixed_ones else ""
    return (
        "Mean ± standard uncertainty, and the equal-tailed 95 % credible interval. Conditional on "
        f"the model, ρ_0 in particular on the {shape} line shape.{held}"
    )


def statement(summary: Record, code: str) -> str:
    """The statement of a verdict; nothing where there is none."""
    return str((summary["diagnostics"].get(code) or {}).get("statement", ""))


def residual_text(summary: Record) -> str:
    """Overall residuals and their autocorrelation."""
    fit = summary["fit"]
    at_map, best = fit["rms_dex"]["overall"], fit["rms_dex_best"]["overall"]
    return (
        f"Over all readings the rms is {number(at_map)}{THIN}dex ({dex_as_percent(at_map)}) at the "
        f"MAP and {number(best)}{THIN}dex ({dex_as_percent(best)}) at the least-squares optimum of "
        f"the same model; the lag-1 autocorrelation is {fixed(fit['lag1']['overall'], 2)}."
    )


def model_text(summary: Record) -> str:
    """Say which model and which likelihood were used."""
    config = summary["config"]
    effects = words_of(summary["effects"], "none")
    place = config.get("fresnel_at", "mean-sine").replace("-", " ")
    noise = {
        "iid": "independent noise",
        "correlated": "independent noise and a correlated discrepancy",
    }.get(config.get("noise"), config.get("noise", MISSING))
    if config.get("tails") == "student-t":
        noise += f" (Student-t noise, {number(config['student_dof'])} degrees of freedom)"
    return (
        f"Four-parameter model (n, k, σ_N0, ρ_0) with the "
        f"{summary['line_shape'].capitalize()} line shape, reflectance at the {place}. "
        f"Effects added: {effects}. BRDF readings enter by their logarithm, with {noise}; the "
        f"scale of the scans is {config.get('brdf_scale', MISSING)}. "
        f"Preset of priors: {config.get('prior', MISSING)}."
    )


def optima_text(n_optima: int) -> str:
    """Say how to read the table of optima."""
    return "All usable starts met in one." if n_optima == 1 else "Differences are to the best."


def data_facts(summary: Record) -> list[tuple[str, str]]:
    """File, hash, readings used and left out."""
    data = summary["input"]
    excluded = [f"{count(n)} × {flag}" for flag, n in data["excluded"].items()]
    return [
        ("file", data["file"] or MISSING),
        ("SHA-256", data["sha256"] or MISSING),
        ("readings used", f"{count(data['n_brdf'])} BRDF, {count(data['n_dhr'])} DHR"),
        ("excluded by their flag", words_of(excluded, "none")),
    ]


def provenance(summary: Record) -> list[tuple[str, str]]:
    """Return what is needed to make the run again."""
    data = summary["input"]
    versions = [f"{name} {version}" for name, version in summary["versions"].items()]
    return [
        ("run", run_number(summary)),
        ("created", str(summary["created_utc"])),
        ("input", f"{data['file'] or MISSING}, SHA-256 {data['sha256'] or MISSING}"),
        ("seed", str(summary["seed"])),
        ("versions", words_of(versions, MISSING)),
        ("platform", summary["platform"]),
        ("summary", f"schema {summary['schema_version']}"),
    ]


def shortened(text: str, most: int = 80) -> str:
    """Cut a text that has to fit in a line of its own."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _readings(n: int) -> str:
    return f"{count(n)} reading{'s' * (n != 1)}"


def facts(pairs: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values of a record as text."""
    return [(WORDS.get(n, n.replace("_", " ")), _plain(value)) for n, value in pairs.items()]


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return count(value) if isinstance(value, int) else number(value)
    return str(value) if value not in (None, "") else MISSING


def timing_rows(summary: Record) -> list[tuple[str, str]]:
    """Stage and duration, the sum last."""
    timings = summary["timings"]
    total = sum(v for v in (finite(t) for t in timings.values()) if v is not None)
    lines = [
        (stage.replace("_", " "), seconds(t)) for stage, t in timings.items() if stage != "total"
    ]
    return [*lines, ("total", seconds(timings.get("total", total)))]


def words_of(items: Sequence[str], none: str) -> str:
    """Join words by commas, or what to say where there are none."""
    return ", ".join(map(str, items)) or none
