"""The tables of the report as records of finished text; the template only places them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pbrdf_bayes.report.numbers import (
    MISSING,
    THIN,
    alike,
    count,
    degrees,
    dex_as_percent,
    finite,
    fixed,
    number,
    percent,
    rounded,
    symbol_markup,
)
from pbrdf_bayes.words import say

Record = Mapping[str, Any]
_READINGS = 3
DIAGONAL = ("1", "#eceef0")
PARTS = {
    "physical": "Physical parameters",
    "instrument": "Instrument",
    "nuisance": "Noise and calibration",
    "fixed": "Held fixed",
}
"""Titles of the kinds of parameter, in the order of the table."""
ORDER = {"FAIL": 0, "WARN": 1, "PASS": 2, "SKIP": 3}


def discrepancy_rows(summary: Record) -> list[tuple[Markup, str, str, str]]:
    """Symbol, standard deviation, that of independent readings and their ratio, by parameter."""
    found = summary.get("discrepancy")
    if not found:
        return []
    parameters, claimed = summary["parameters"], found["sd_if_independent"]
    return [
        (
            symbol_markup(parameters[name]["symbol"]), number(sd, digits=2),
            number(claimed[name], digits=2), number(sd / claimed[name], digits=2),
        )
        for name, sd in found["sd"].items()
    ]  # fmt: skip


@dataclass(frozen=True)
class Bar:
    """Where the posterior lies in the prior, per cent of the prior's 95 % interval."""

    left: float
    width: float
    words: str


@dataclass(frozen=True)
class ParameterRow:
    """One parameter: posterior, sampling error and prior."""

    name: str
    symbol: Markup
    description: str
    unit: str
    part: str
    physical: bool
    identified: bool
    says: str
    mean: str
    sd: str
    interval: str
    map: str
    mcse: str
    rhat: str
    ess_bulk: str
    ess_tail: str
    prior: str
    contraction: str
    effective: str
    by_prior: str
    by_readings: str
    bar: Bar | None


@dataclass(frozen=True)
class CheckRow:
    """A check of the data or a diagnostic of the fit."""

    title: str
    verdict: str
    value: str
    threshold: str
    statement: str
    advice: str


@dataclass(frozen=True)
class CorrelationRow:
    """A line of the correlation matrix up to the diagonal: text and background."""

    symbol: Markup
    cells: tuple[tuple[str, str], ...]


def parameter_rows(
    summary: Record, priors: Mapping[str, NDArray[np.float64]]
) -> list[ParameterRow]:
    """By the kind of parameter, in the order of the summary.

    Parameters
    ----------
    summary : mapping
    priors : mapping of str to ndarray
        Draws of the prior of each parameter, for the bar that shows where the posterior lies in it.
    """
    order = list(PARTS)
    items = sorted(summary["parameters"].items(), key=lambda item: order.index(item[1]["kind"]))
    return [_parameter_row(name, p, priors.get(name, np.zeros(0))) for name, p in items]


def _parameter_row(name: str, p: Record, prior: NDArray[np.float64]) -> ParameterRow:
    fixed_value = p["kind"] == "fixed"
    sampled = {} if fixed_value else p
    r = rounded(
        p["mean"], sampled.get("sd"), low=sampled.get("q025"), high=sampled.get("q975"),
        at_map=sampled.get("map"),
    )  # fmt: skip
    rhat = sampled.get("rhat")
    return ParameterRow(
        name=name,
        symbol=symbol_markup(p["symbol"]),
        description=p["description"],
        unit="" if p["unit"] in ("", "1") else p["unit"],
        part=PARTS[p["kind"]],
        physical=p["kind"] == "physical",
        identified=fixed_value or bool(p["identified"]),
        says=_says(p),
        mean=r.value,
        sd=r.uncertainty,
        interval="fixed" if fixed_value else f"{r.low} to {r.high}",
        map=r.map,
        mcse=number(sampled.get("mcse_mean"), digits=2),
        rhat=fixed(rhat, 4 if (finite(rhat) or 2) < 1.1 else 2),
        ess_bulk=count(sampled.get("ess_bulk")),
        ess_tail=count(sampled.get("ess_tail")),
        prior=p["prior"],
        contraction=_contraction(sampled.get("contraction")),
        effective=_contraction(p["contraction_effective"]) if "contraction_effective" in p else "",
        by_prior=fixed(p.get("prior_sensitivity"), 2),
        by_readings=fixed(p.get("likelihood_sensitivity"), 2),
        bar=_bar(sampled, prior),
    )


def _says(p: Record) -> str:
    """What decides a parameter."""
    if p["kind"] == "fixed":
        return say("parameter.assumed")
    return say("parameter.identified" if p["identified"] else "parameter.prior")


def _contraction(value: Any) -> str:
    x = finite(value)
    if x is None:
        return MISSING
    return ">0.999" if x > 0.9995 else fixed(x, 3)


def _bar(p: Record, prior: NDArray[np.float64]) -> Bar | None:
    """Interval of the posterior within that of the prior."""
    draws = prior[np.isfinite(prior)]
    low, high = finite(p.get("q025")), finite(p.get("q975"))
    if draws.size < 20 or low is None or high is None:
        return None
    start, end = np.quantile(draws, [0.025, 0.975]).tolist()
    if not end > start:
        return None
    left = float(np.clip(100 * (low - start) / (end - start), 0, 100))
    right = float(np.clip(100 * (high - start) / (end - start), 0, 100))
    width = max(right - left, 1.5)
    words = (
        f"prior 95 % {number(start)} to {number(end)}; "
        f"posterior covers {number(right - left, digits=2)} % of it"
    )
    return Bar(round(min(left, 100 - width), 2), round(width, 2), words)


def check_rows(summary: Record) -> tuple[list[CheckRow], list[CheckRow]]:
    """Return the checks of the data and the diagnostics of the fit."""
    data = [_check_row(c) for c in summary["input"]["checks"]]
    return data, [_check_row(c) for c in summary["diagnostics"].values()]


def finding_rows(summary: Record) -> list[CheckRow]:
    """Return the mistakes that the readings show."""
    return [
        CheckRow(
            title=f["code"].replace("_", " "), verdict=f["verdict"], value="", threshold="",
            statement=f["statement"], advice=f["remedy"],
        )
        for f in summary.get("findings", [])
    ]  # fmt: skip


def attention(rows: Sequence[CheckRow]) -> list[CheckRow]:
    """Return what did not pass, failures first."""
    return sorted(
        (r for r in rows if r.verdict in ("FAIL", "WARN")), key=lambda r: ORDER[r.verdict]
    )


def tally(rows: Sequence[CheckRow]) -> str:
    """Count the verdicts in words.

    Examples
    --------
    >>> tally([CheckRow("a", v, "", "", "", "") for v in ("PASS", "PASS", "WARN", "SKIP")])
    '2 checks passed, 1 warning, 1 not applicable'
    """
    words = {
        "PASS": ("check passed", "checks passed"),
        "FAIL": ("failure", "failures"),
        "WARN": ("warning", "warnings"),
        "SKIP": ("not applicable", "not applicable"),
    }
    counts = {v: sum(r.verdict == v for r in rows) for v in words}
    return ", ".join(f"{n} {words[v][n != 1]}" for v, n in counts.items() if n)


def _check_row(check: Record) -> CheckRow:
    unit = check["unit"] or ""
    unit = "" if unit == "1" else unit
    return CheckRow(
        title=check["title"],
        verdict=check["verdict"],
        value=_with_unit(check["value"], unit, digits=_digits(check)),
        threshold=_with_unit(check["threshold"], unit),
        statement=check["statement"],
        advice=check["advice"] or "",
    )


def _digits(check: Record) -> int:
    """Significant digits that tell a value from its threshold."""
    value, threshold = finite(check["value"]), finite(check["threshold"])
    if value is None or threshold is None:
        return 3
    near = abs(value - threshold) < 0.05 * abs(threshold)
    return 3 if not near else 5 if 1 <= abs(value) < 10 else 4


def _with_unit(value: Any, unit: str, *, digits: int = 3) -> str:
    text = number(value, digits=digits)
    return text if text == MISSING or not unit else f"{text}{THIN}{unit}"


def correlation_rows(summary: Record) -> list[CorrelationRow]:
    """Lower triangle of the correlation matrix of the posterior."""
    names, matrix = summary["correlation"]["names"], summary["correlation"]["matrix"]
    symbols = [summary["parameters"].get(n, {}).get("symbol", n) for n in names]
    return [
        CorrelationRow(symbol_markup(symbols[i]), (*(_cell(v) for v in row[:i]), DIAGONAL))
        for i, row in enumerate(matrix)
    ]


def _cell(value: Any) -> tuple[str, str]:
    """Text of a correlation and its background: blue positive, orange negative."""
    r = finite(value)
    if r is None:
        return MISSING, DIAGONAL[1]
    return fixed(r, 2), background(r)


def background(strength: float) -> str:
    """Colour of a cell: blue for positive, orange for negative, full at 1 and beyond."""
    full = (0, 103, 165) if strength > 0 else (194, 77, 0)
    weight = 0.66 * min(abs(strength), 1.0) ** 1.2
    mixed = [round(255 + (c - 255) * weight) for c in full]
    return f"rgb({mixed[0]},{mixed[1]},{mixed[2]})"


def scan_rows(summary: Record) -> list[tuple[str, ...]]:
    """One line per scan: geometry, range, residuals."""
    return [
        (
            s["label"], s["polarization"], degrees(s["theta_i_deg"]), degrees(s["phi_r_deg"]),
            count(s["n"]), f"{degrees(s['theta_r_min_deg'])} to {degrees(s['theta_r_max_deg'])}",
            f"{number(s['value_min'])} to {number(s['value_max'])}",
            rounded(s["rms_dex"], s["rms_dex"]).value, rounded(s["bias_dex"], s["rms_dex"]).value,
            fixed(s["lag1"], 2), _scale(s),
        )
        for s in summary["input"]["scans"]
    ]  # fmt: skip


def _scale(scan: Record) -> str:
    """Calibration factor of a scan with its standard uncertainty."""
    if not finite(scan["u_scale"]):
        return "exact"
    found = rounded(scan["scale"], scan["u_scale"])
    return f"{found.value} ± {found.uncertainty}"


def optima_rows(summary: Record) -> tuple[list[Markup], list[tuple[str, ...]]]:
    """Symbols of what is not fixed, and one line per distinct optimum of the posterior density."""
    optima, parameters = summary["map"]["optima"], summary["parameters"]
    free = [n for n, p in parameters.items() if p["kind"] != "fixed"]
    names = [n for n in free if any(n in o["parameters"] for o in optima)]
    lines = [
        (
            str(rank), fixed(o["log_posterior"], 2), fixed(o["delta"], 2), count(o["n_starts"]),
            *(_like(o["parameters"].get(n), parameters[n]) for n in names),
        )
        for rank, o in enumerate(optima, start=1)
    ]  # fmt: skip
    return [symbol_markup(parameters[n]["symbol"]) for n in names], lines


def _like(value: Any, parameter: Record) -> str:
    """Value to the digits of the uncertainty of its parameter."""
    return rounded(value, parameter["sd"]).value


def holdout_rows(summary: Record) -> list[tuple[str, ...]]:
    """One line per scan that was left out, and the overall line last."""
    record = summary["holdout"]
    if not record:
        return []
    lines = [*record["scans"], {"label": "all", **record}]
    return [
        (
            str(s["label"]), number(s["rms_dex"], digits=2), dex_as_percent(s["rms_dex"]),
            percent(s["coverage_90"], digits=3), number(s["width_dex"], digits=2),
            dex_as_percent(s["width_dex"]),
        )
        for s in lines
    ]  # fmt: skip


def case_rows(summary: Record) -> list[tuple[str, ...]]:
    """One line per prediction of scans left out: verdict, what, from what, how well."""
    words = {"recipe": "all but {}", "angle": "{}", "polarization": "{}"}
    return [
        (
            str(h["verdict"]), words.get(h["kind"], "{}").format(h["name"]), str(h["fitted"]),
            count(h["n"]), number(h["rms_dex"], digits=2), dex_as_percent(h["rms_dex"]),
            number(h["rms_expected_dex"], digits=2), percent(h["coverage_90"], digits=3),
            number(h["width_dex"], digits=2), dex_as_percent(h["width_dex"]),
        )
        for h in summary.get("holdouts") or []
    ]  # fmt: skip


@dataclass(frozen=True)
class CandidateRow:
    """A candidate of the choice of effects: how it fits, predicts and costs."""

    chosen: bool
    name: str
    n_free: str
    rms: str
    held_out: str
    mean_held_out: str
    difference: str
    at_bound: tuple[Markup, ...]
    microseconds: str


def effect_rows(summary: Record) -> list[CandidateRow]:
    """One line per candidate; the numbers of a column have the same decimals."""
    found = summary.get("effects_choice") or {}
    candidates, symbols = found.get("candidates", []), found.get("symbols", {})
    columns = ("rms_dex", "held_out_dex", "mean_held_out_dex", "microseconds")
    shown = {name: alike([c.get(name) for c in candidates]) for name in columns}
    return [
        CandidateRow(
            chosen=c["chosen"], name=str(c["name"]), n_free=count(c["n_free"]),
            rms=shown["rms_dex"][i], held_out=shown["held_out_dex"][i],
            mean_held_out=shown["mean_held_out_dex"][i],
            difference=f"{fixed(c['difference'], 3)} ± {fixed(c['u_difference'], 3)}",
            at_bound=tuple(symbol_markup(symbols.get(name, name)) for name in c["at_bound"]),
            microseconds=shown["microseconds"][i],
        )
        for i, c in enumerate(candidates)
    ]  # fmt: skip


def reading_rows(summary: Record) -> list[tuple[str, ...]]:
    """Readings that weigh most in the posterior, then those farthest from all others."""
    found = summary.get("leave_one_out") or {}
    lines = [("most influential", r) for r in found.get("most_influential", [])[:_READINGS]]
    lines += [("farthest", r) for r in found.get("farthest", [])[:_READINGS]]
    return [
        (
            why, str(r["label"]), degrees(r["angle_deg"]), count(r["row"] or None),
            fixed(r["k_hat"], 2), fixed(r["z"], 1),
        )
        for why, r in lines
    ]  # fmt: skip
