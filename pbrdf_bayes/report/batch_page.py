"""The index page of a batch: a table, control charts and the spread between samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from pbrdf_bayes.report.figures_batch import control_chart, sparkline
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

Record = Mapping[str, Any]
STATUS_WORDS = {"done": "done", "failed": "failed", "skipped": "done before"}
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
    error: str
    spark: Markup
    rms: str
    rms_key: str
    seconds: str
    seconds_key: str
    cells: tuple[Cell, ...]


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
    rows, compared = index["samples"], index["between_samples"]
    conformity = any(row["conformity"] for row in rows)
    return environment().get_template("batch.html.j2").render(
        rows=[_sample_row(i, row, list(compared)) for i, row in enumerate(rows)],
        symbols=[(symbol_markup(r["symbol"]), r["unit"].strip("1")) for r in compared.values()],
        parameters=[_section(name, record, rows) for name, record in compared.items()],
        conformity=conformity, verdict_words=VERDICT_WORDS, lead=_lead(index),
        n=len(rows), n_samples=index["n_samples"], finished=index["finished"],
        version=index["version"], failing=sum(row["verdict"] == "FAIL" for row in rows),
        tally=_tally(rows), total=seconds(sum(row["seconds"] or 0.0 for row in rows)),
    )  # fmt: skip


def _tally(rows: Sequence[Record]) -> list[tuple[str, str, int]]:
    """Words, class and number of each verdict, and of the samples without one."""
    verdicts = Counter(row["verdict"] for row in rows)
    words = {"PASS": "pass", "WARN": "with a warning", "FAIL": "fail", None: "without a result"}
    return [
        (text, str(v or "NONE"), verdicts[v])
        for v, text in words.items()
        if verdicts[v] or v == "PASS"
    ]


def _lead(index: Record) -> str:
    n, rows = index["n_samples"], index["samples"]
    if not index["finished"]:
        return f"{len(rows)} of {n} samples so far. The batch goes on, or can go on with --resume."
    failed = sum(row["status"] == "failed" for row in rows)
    beyond = {
        record["rows"][i]
        for record in index["between_samples"].values() if record["chart"]
        for i, out in enumerate(record["chart"]["beyond"]) if out
    }  # fmt: skip
    text = f"{n} sample{'s' * (n != 1)}"
    text += f", {failed} of them without a result" if failed else ", all with a result"
    if any(record["chart"] for record in index["between_samples"].values()):
        text += (
            f". {len(beyond)} {'is' if len(beyond) == 1 else 'are'} beyond the limits of a control "
            "chart"
            if beyond
            else ". None is beyond the limits of a control chart"
        )
    return f"{text}."


def _sample_row(i: int, row: Record, names: Sequence[str]) -> SampleRow:
    error = row["error"] or ""
    return SampleRow(
        number=i + 1, sample=row["sample"], source=row["source"],
        link=f"{quote(row['run'])}/report.html" if row["run"] else "",
        status=STATUS_WORDS[row["status"]], verdict=row["verdict"] or "",
        conformity=row["conformity"] or "",
        error=error if len(error) <= _LONGEST_ERROR else f"{error[:_LONGEST_ERROR]} …",
        spark=sparkline(row["curves"]),
        rms=number(row["rms_dex"], digits=2), rms_key=_key(row["rms_dex"]),
        seconds=seconds(row["seconds"]), seconds_key=_key(row["seconds"]),
        cells=tuple(_cell(row["parameters"].get(name)) for name in names),
    )  # fmt: skip


def _cell(record: Record | None) -> Cell:
    if not record:
        return Cell(MISSING, "", "")
    r = rounded(record["mean"], record["sd"], low=record["q025"], high=record["q975"])
    interval = f"{r.low} to {r.high}"
    return Cell(
        f"{r.value} ± {r.uncertainty}", interval, _key(record["mean"]), bool(record["identified"])
    )


def _key(value: Any) -> str:
    x = finite(value)
    return "" if x is None else repr(x)


def _section(name: str, record: Record, rows: Sequence[Record]) -> ParameterSection:
    names = [rows[i]["sample"] for i in record["rows"]]
    chart = record["chart"]
    beyond = [n for n, out in zip(names, chart["beyond"], strict=True) if out] if chart else []
    n_counted = sum(record["counted"])
    label = (
        f"{record['symbol']} of {len(names)} samples in order, {len(beyond)} beyond their limits"
    )
    note = "" if chart else "Limits need at least four samples that did not fail."
    if chart and n_counted < _PROVISIONAL_BELOW:
        note = f"Limits from {n_counted} samples, fewer than {_PROVISIONAL_BELOW}, are provisional."
    return ParameterSection(
        name, symbol_markup(record["symbol"]), control_chart(record, names, label=label),
        _spread(record), ", ".join(beyond), note,
    )  # fmt: skip


def _spread(record: Record) -> tuple[str, ...] | None:
    """Number of samples, mean and its interval, spread and its interval, largest uncertainty."""
    s = record["spread"]
    if s is None:
        return None
    if record["logarithmic"]:
        mean = [number(exp(s[k])) for k in ("mean_median", "mean_q025", "mean_q975")]
        sd = [percent(s[k]) for k in ("sd_mode", "sd_q025", "sd_median", "sd_q975")]
        own = percent(_mean_of(record))
    else:
        r = rounded(s["mean_median"], (s["mean_q975"] - s["mean_q025"]) / 4.0,
                    low=s["mean_q025"], high=s["mean_q975"])  # fmt: skip
        mean = [r.value, r.low, r.high]
        sd = [number(s[k], digits=2) for k in ("sd_mode", "sd_q025", "sd_median", "sd_q975")]
        own = number(_mean_of(record), digits=2)
    return (
        str(s["n"]), mean[0], f"{mean[1]} to {mean[2]}", sd[0], sd[2], f"{sd[1]} to {sd[3]}", own,
    )  # fmt: skip


def _mean_of(record: Record) -> float:
    """Root mean square of the uncertainties of the samples that count."""
    used = [u for u, c in zip(record["u"], record["counted"], strict=True) if c]
    return float((sum(u**2 for u in used) / len(used)) ** 0.5)
