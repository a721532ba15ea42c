"""The index page of a batch: a table, control charts and the spread between samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp
from typing import Any
from urllib.parse import quote

from markupsafe import Markup, escape

from pbrdf_bayes.report.conformity import LOOK_OF, WORDS, probability_text
from pbrdf_bayes.report.figures.batch import control_chart, sparkline
from pbrdf_bayes.report.numbers import (
    MISSING,
    finite,
    number,
    percent,
    rounded,
    seconds,
    symbol_markup,
)
from pbrdf_bayes.report.page import VERDICT_WORDS, environment
from pbrdf_bayes.words import counted, say

Record = Mapping[str, Any]
STATUS_WORDS = {"done": "done", "failed": "failed", "skipped": "done before"}
_OPEN, _REPEAT = "not done yet", "repeat"
_DECIDED = {"ACCEPT": "accepted", "REJECT": "rejected", "UNDECIDED": "undecided"}
_FITTED = {"PASS": "pass", "WARN": "with a warning", "FAIL": "fail"}
_PROVISIONAL_BELOW = 20
_LONGEST_ERROR = 600


@dataclass(frozen=True)
class Cell:
    """A parameter of a sample: text, interval, and the number to sort by."""

    text: str
    interval: str
    key: str
    identified: bool = True


@dataclass(frozen=True)
class SampleRow:
    """One line of the table."""

    number: int
    sample: str
    source: str
    link: str
    status: str
    verdict: str
    conformity: str
    probability: str
    risk: str
    wavelength: str
    wavelength_key: str
    error: str
    notice: str
    spark: Markup
    rms: str
    rms_key: str
    seconds: str
    seconds_key: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class WavelengthSection:
    """Charts and spreads of the samples at one wavelength."""

    title: str
    wavelength: str
    parameters: tuple[ParameterSection, ...]


@dataclass(frozen=True)
class ParameterSection:
    """Spread and chart of one parameter."""

    name: str
    symbol: Markup
    chart: Markup
    spread: tuple[str, ...] | None
    beyond: str
    note: str


def render_batch(index: Record) -> str:
    """Write the index of a batch as one self-contained page.

    Parameters
    ----------
    index : mapping
        The content of ``index.json``.

    Returns
    -------
    str
    """
    rows, groups = index["samples"], index["by_wavelength"]
    known = {n: r for row in rows for n, r in row["parameters"].items()}
    names = list(dict.fromkeys(name for row in rows for name in row["parameters"]))
    conformity = any(row["conformity"] for row in rows)
    return environment().get_template("batch.html.j2").render(
        rows=[_sample_row(i, row, names) for i, row in enumerate(rows)],
        symbols=[(symbol_markup(known[n]["symbol"]), known[n]["unit"].strip("1")) for n in names],
        groups=[_group(group, rows, alone=len(groups) == 1) for group in groups],
        conformity=conformity, verdict_words=VERDICT_WORDS, lead=_lead(index),
        decided_words=WORDS, looks=LOOK_OF,
        n=len(rows) - sum(_is_open(row) for row in rows), n_samples=index["n_samples"],
        running=index["running"], written=index["written_utc"], version=index["version"],
        failing=_failing(rows), unidentified=_unidentified(groups),
        tally=_decisions(rows) if conformity else _fits(rows),
        total=seconds(sum(row["seconds"] or 0.0 for row in rows)),
    )  # fmt: skip


def _is_open(row: Record) -> bool:
    return bool(row["status"] == "skipped" and not row["verdict"] and not row["repeat_of"])


def _decisions(rows: Sequence[Record]) -> list[tuple[str, str, int]]:
    """Words, class and number of each verdict on conformity, and of what has none."""
    found = Counter(row["conformity"] for row in rows)
    listed = [(words, LOOK_OF[v], found[v]) for v, words in _DECIDED.items()]
    unjudged = sum(not row["conformity"] and bool(row["verdict"]) for row in rows)
    return [*listed, *_present(("not judged", "NONE", unjudged), *_without(rows))]


def _fits(rows: Sequence[Record]) -> list[tuple[str, str, int]]:
    """Words, class and number of each verdict on a fit, and of the samples without one."""
    found = Counter(row["verdict"] for row in rows)
    listed = [(text, v, found[v]) for v, text in _FITTED.items() if found[v] or v == "PASS"]
    return [*listed, *_present(*_without(rows))]


def _without(rows: Sequence[Record]) -> list[tuple[str, str, int]]:
    repeats = sum(bool(row["repeat_of"]) for row in rows)
    left = sum(_is_open(row) for row in rows)
    failed = sum(row["status"] == "failed" for row in rows)
    return [
        ("without a result", "NONE", failed), (f"repeat{'s' * (repeats != 1)}", "NONE", repeats),
        (_OPEN, "NONE", left),
    ]  # fmt: skip


def _present(*counts: tuple[str, str, int]) -> list[tuple[str, str, int]]:
    return [one for one in counts if one[2]]


def _lead(index: Record) -> Markup:
    """What came out, and what is to be looked at, in a few sentences."""
    if not index["finished"]:
        return escape(_results_lead(index))
    groups = index["by_wavelength"]
    return escape(f"{_results_lead(index)}{_chart_lead(groups)}") + _drift_lead(groups)


def _results_lead(index: Record) -> str:
    n, rows = index["n_samples"], index["samples"]
    if not index["finished"]:
        done = len(rows) - sum(_is_open(row) for row in rows)
        return f"{done} of {n} samples so far. The batch goes on, or can go on with --resume."
    failed = sum(row["status"] == "failed" for row in rows)
    repeats = sum(bool(row["repeat_of"]) for row in rows)
    results = n - failed - repeats
    text = f"{_samples(n)}, " + (
        f"{results} with a result" if failed or repeats else "all with a result"
    )
    if repeats:
        one = repeats == 1
        text += f". {repeats} {'has' if one else 'have'} the readings of another and "
        text += f"{'is' if one else 'are'} not counted again"
    return f"{_conformity_lead(rows)}{text}."


def _samples(n: int) -> str:
    return f"{n} sample{'s' * (n != 1)}"


def _conformity_lead(rows: Sequence[Record]) -> str:
    """How many the limits let pass, and what the fits themselves are."""
    judged = [row["conformity"] for row in rows if row["conformity"]]
    if not judged:
        return ""
    found, n = Counter(judged), len(judged)
    accepted = found["ACCEPT"]
    how_many = (
        ("the one" if n == 1 else f"all {n}") if accepted == n else f"{accepted or 'none'} of {n}"
    )
    verb = "is" if accepted < 2 else "are"
    text = f"{how_many} sample{'s' * (n != 1)} judged {verb} accepted"
    for verdict, words in list(_DECIDED.items())[1:]:
        text += f", {found[verdict]} {words}" if found[verdict] else ""
    fits = Counter(row["verdict"] for row in rows)
    fitted = ", ".join(f"{fits[v]} {words}" for v, words in _FITTED.items() if fits[v])
    return f"By the limits given {text}. Fits: {fitted}. "


def _chart_lead(groups: Sequence[Record]) -> str:
    charted = [r for group in groups for r in group["parameters"].values() if r["chart"]]
    if not charted:
        return ""
    beyond = {
        record["rows"][i]
        for record in charted
        for i, out in enumerate(record["chart"]["beyond"]) if out
    }  # fmt: skip
    if not beyond:
        return " None is beyond its limits in a control chart."
    verb, limits = ("is", "its limits") if len(beyond) == 1 else ("are", "their limits")
    return f" {len(beyond)} {verb} beyond {limits} in a control chart."


def _drift_lead(groups: Sequence[Record]) -> Markup:
    """A sentence for each parameter that drifts."""
    text = Markup()
    for group in groups:
        at = f" at {number(group['wavelength_um'], digits=6)} µm" if len(groups) > 1 else ""
        for record in group["parameters"].values():
            if record["trend"] and record["trend"]["seen"]:
                symbol = symbol_markup(record["symbol"])
                text += Markup(" <i>{}</i>{} drifts: {}.").format(symbol, at, _drift(record))
    return text


def _sample_row(i: int, row: Record, names: Sequence[str]) -> SampleRow:
    error = row["error"] or ""
    return SampleRow(
        number=i + 1, sample=row["sample"], source=row["source"],
        link=f"{quote(row['run'])}/report.html" if row["run"] else "",
        status=_status(row), verdict=row["verdict"] or "",
        conformity=row["conformity"] or "", probability=_probability(row), risk=_risk(row),
        wavelength=number(row["wavelength_um"], digits=6),
        wavelength_key=_key(row["wavelength_um"]),
        error=error if len(error) <= _LONGEST_ERROR else f"{error[:_LONGEST_ERROR]} …",
        notice=row["notice"] or "", spark=sparkline(row["curves"]),
        rms=number(row["rms_dex"], digits=2), rms_key=_key(row["rms_dex"]),
        seconds=seconds(row["seconds"] or None), seconds_key=_key(row["seconds"]),
        cells=tuple(_cell(row["parameters"].get(name)) for name in names),
    )  # fmt: skip


def _status(row: Record) -> str:
    if row["repeat_of"]:
        return f"{_REPEAT} of No. {row['repeat_of']}"
    return _OPEN if _is_open(row) else STATUS_WORDS[row["status"]]


def _probability(row: Record) -> str:
    """Of conformity with all limits together; nothing where no limit can be judged."""
    if row["p_conformity"] is None:
        return ""
    ends = {"low": row["p_conformity_low"], "high": row["p_conformity_high"]}
    found = {"value": row["p_conformity"], "u": row["u_p_conformity"], **ends}
    return probability_text(found)


def _risk(row: Record) -> str:
    """The specific risk of the decision; what it is at most where no draw speaks against it."""
    if row["p_conformity"] is None or row["conformity"] not in ("ACCEPT", "REJECT"):
        return ""
    accepted = row["conformity"] == "ACCEPT"
    value = row["consumer_risk"] if accepted else row["producer_risk"]
    most = 1.0 - row["p_conformity_low"] if accepted else row["p_conformity_high"]
    return f"below {percent(most)}" if value == 0.0 else percent(value)


def _cell(record: Record | None) -> Cell:
    if not record:
        return Cell(MISSING, "", "")
    if record["kind"] == "fixed":
        return Cell(number(record["mean"]), "fixed", _key(record["mean"]))
    r = rounded(record["mean"], record["sd"], low=record["q025"], high=record["q975"])
    interval = f"{r.low} to {r.high}"
    return Cell(
        f"{r.value} ± {r.uncertainty}", interval, _key(record["mean"]), bool(record["identified"])
    )


def _key(value: Any) -> str:
    x = finite(value)
    return "" if x is None else repr(x)


def _failing(rows: Sequence[Record]) -> str:
    """What the numbers of samples with the verdict FAIL are worth."""
    n = sum(row["verdict"] == "FAIL" for row in rows)
    samples = f"{counted(n, 'sample')} {'has' if n == 1 else 'have'}"
    return say("batch.failed", samples=samples) if n else ""


def _unidentified(groups: Sequence[Record]) -> str:
    """Which parameters samples do not identify, and how many samples each."""
    found: Counter[str] = Counter()
    for record in (r for group in groups for r in group["parameters"].values()):
        found[record["symbol"]] += record["why_not"].count("not identified")
    listed = [f"{symbol} in {counted(n, 'sample')}" for symbol, n in found.items() if n]
    return say("batch.unidentified", listed=", ".join(listed)) if listed else ""


def _group(group: Record, rows: Sequence[Record], *, alone: bool) -> WavelengthSection:
    wavelength = number(group["wavelength_um"], digits=6)
    title = "" if alone else f"{wavelength} µm"
    sections = (_section(name, record, rows, title) for name, record in group["parameters"].items())
    return WavelengthSection(title, wavelength, tuple(sections))


def _section(name: str, record: Record, rows: Sequence[Record], at: str) -> ParameterSection:
    names = [rows[i]["sample"] for i in record["rows"]]
    chart = record["chart"]
    numbered = [f"No. {i + 1} {n}" for i, n in zip(record["rows"], names, strict=True)]
    beyond = [n for n, out in zip(numbered, chart["beyond"], strict=True) if out] if chart else []
    out = chart["beyond"] if chart else [False] * len(names)
    n_counted = sum(c and not o for c, o in zip(record["counted"], out, strict=True))
    label = (
        f"{record['symbol']} of {_samples(len(names))}{' at ' * bool(at)}{at} in order, "
        f"{len(beyond)} beyond their limits"
    )
    note = "" if chart else "Limits need at least four samples that count."
    if chart and n_counted < _PROVISIONAL_BELOW:
        note = f"Limits from {n_counted} samples, fewer than {_PROVISIONAL_BELOW}, are provisional."
    note = f"{note} {_trend(record)}".strip()
    return ParameterSection(
        name, symbol_markup(record["symbol"]), control_chart(record, names, label=label),
        _spread(record), ", ".join(beyond), note,
    )  # fmt: skip


def _trend(record: Record) -> str:
    """Whether the parameter drifts, in a sentence; empty where samples are too few."""
    if record["trend"] is None:
        return ""
    seen = "Trend" if record["trend"]["seen"] else "No trend is seen"
    return f"{seen}: {_drift(record)}."


def _drift(record: Record) -> str:
    """Change from a sample to the next, with equal decimals; relative where that is meant."""
    t = record["trend"]
    ends = [t["slope_median"], t["slope_q025"], t["slope_q975"]]
    unit = ""
    if record["logarithmic"]:
        ends, unit = [100.0 * (exp(b) - 1.0) for b in ends], " %"
    r = rounded(ends[0], (ends[2] - ends[1]) / 4.0, low=ends[1], high=ends[2])
    return f"{r.value}{unit} from a sample to the next (95 % interval {r.low} to {r.high}{unit})"


def _spread(record: Record) -> tuple[str, ...] | None:
    """Number of samples, mean and its interval, spread and its interval, largest uncertainty."""
    s = record["spread"]
    if s is None:
        return None
    middle, low, high = (s[k] for k in ("mean_median", "mean_q025", "mean_q975"))
    if record["logarithmic"]:
        middle, low, high = exp(middle), exp(low), exp(high)
    r = rounded(middle, (high - low) / 4.0, low=low, high=high)
    if record["logarithmic"]:
        sd = [percent(s[k]) for k in ("sd_mode", "sd_q025", "sd_median", "sd_q975")]
        own = percent(_mean_of(record))
    else:
        sd = [number(s[k], digits=2) for k in ("sd_mode", "sd_q025", "sd_median", "sd_q975")]
        own = number(_mean_of(record), digits=2)
    return (
        str(s["n"]), r.value, f"{r.low} to {r.high}", sd[0], sd[2], f"{sd[1]} to {sd[3]}", own,
    )  # fmt: skip


def _mean_of(record: Record) -> float:
    """Root mean square of the uncertainties of the samples that count."""
    used = [u for u, c in zip(record["u"], record["counted"], strict=True) if c]
    return float((sum(u**2 for u in used) / len(used)) ** 0.5)
