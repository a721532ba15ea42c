"""The index of a batch: the same rows as a page, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from math import log
from pathlib import Path
from typing import Any

from pbrdf_bayes import __version__
from pbrdf_bayes.batch.between_samples import infer_spread
from pbrdf_bayes.batch.control_chart import draw_limits
from pbrdf_bayes.batch.outcome import FAILED, RISKS
from pbrdf_bayes.batch.trend import infer_trend
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.formulas import guard
from pbrdf_bayes.io.problems import printable
from pbrdf_bayes.io.run_folder import write_text
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.report.batch_page import render_batch

INDEX_FILES = ("index.html", "index.csv", "index.json")
Row = Mapping[str, Any]

_LOGARITHMIC = ("sigma_n0", "rho0")
_NORMAL_975 = 1.959963984540054
_PLAIN = (
    "sample", "wavelength_um", "status", "verdict", "conformity", *RISKS, "run", "error",
    "notice", "repeat_of", "source", "seconds", "n_brdf", "n_dhr", "rms_dex", "headline",
)  # fmt: skip
_OF_PARAMETER = ("mean", "sd", "q025", "q975")


def write_index(
    folder: Path, rows: Sequence[Row], *, n_samples: int, finished: bool | None = None,
    running: bool = False,
) -> None:  # fmt: skip
    """Write all three files, each whole or not at all.

    Parameters
    ----------
    folder : Path
    rows : sequence of mapping
        Samples that are done, in their order.
    n_samples : int
        All samples of the batch.
    finished : bool, optional
        Nothing is left to be done; whether all samples have a row by default.
    running : bool
        The batch goes on, so that the page is loaded again.

    Raises
    ------
    RunFolderError
    """
    groups = compare_wavelengths(rows)
    index = {
        "schema_version": 1,
        "version": __version__,
        "n_samples": n_samples,
        "finished": len(rows) == n_samples if finished is None else finished,
        "running": running,
        "written_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "samples": list(rows),
        "between_samples": None if len(groups) > 1 else groups[0]["parameters"] if groups else {},
        "by_wavelength": groups,
    }
    text = json.dumps(plain(index), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(folder / "index.json", text + "\n")
    write_text(folder / "index.csv", csv_text(rows))
    write_text(folder / "index.html", render_batch(plain(index)))


def csv_text(rows: Sequence[Row]) -> str:
    """The rows as comma-separated text.

    A text that a spreadsheet would take for a formula begins with an apostrophe, characters that
    cannot be seen are escaped; numbers are numbers, negative ones too.
    """
    names = parameter_names(rows)
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([*_PLAIN, *(f"{name}_{key}" for name in names for key in _OF_PARAMETER)])
    for row in rows:
        values = [
            row["parameters"].get(name, {}).get(key) for name in names for key in _OF_PARAMETER
        ]
        plain = (harmless(_seen(name, row[name])) for name in _PLAIN)
        writer.writerow([*plain, *map(harmless, values)])
    return file.getvalue()


def harmless(value: Any) -> Any:
    """A cell that no spreadsheet takes for a formula.

    Examples
    --------
    >>> harmless("=1+1"), harmless(-0.5), harmless(None)
    ("'=1+1", -0.5, '')
    """
    if value is None:
        return ""
    return guard(value) if isinstance(value, str) else value


def _seen(name: str, value: Any) -> Any:
    """Text with what cannot be seen escaped, but for the lines of a message."""
    if not isinstance(value, str):
        return value
    return "\n".join(map(printable, value.split("\n"))) if name == "error" else printable(value)


def parameter_names(rows: Sequence[Row]) -> list[str]:
    """Parameters of any sample, in their order."""
    return list(dict.fromkeys(name for row in rows for name in row["parameters"]))


def compare_wavelengths(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Spread and control charts, each wavelength on its own: constants of a paint depend on it.

    Returns
    -------
    list of dict
        ``wavelength_um`` [um] and ``parameters``, see `compare_samples`; wavelengths ascend.
    """
    found = sorted({row["wavelength_um"] for row in rows if row["parameters"]})
    return [{"wavelength_um": w, "parameters": compare_samples(rows, w)} for w in found]


def compare_samples(rows: Sequence[Row], wavelength_um: float) -> dict[str, Any]:
    """Spread, trend and control chart of each parameter over the samples at a wavelength.

    Samples whose verdict is FAIL do not count: their numbers are no constants of the material. Nor
    does a parameter that the readings of a sample do not identify: its number is that of the prior.
    Both are in the chart, where they are held against the limits of the others.
    """
    found = {}
    for name in parameter_names(rows):
        mine = [
            i
            for i, row in enumerate(rows)
            if row["wavelength_um"] == wavelength_um and _has(row, name)
        ]
        if not mine:
            continue
        records = [rows[i]["parameters"][name] for i in mine]
        is_log = name in _LOGARITHMIC and all(r["q025"] > 0.0 for r in records)
        located = [_location(record, is_log) for record in records]
        why_not = [_why_not(rows[i], name) for i in mine]
        counted = [not why for why in why_not]
        chart = _chart(located, counted)
        found[name] = {
            "symbol": records[0]["symbol"], "unit": records[0]["unit"], "logarithmic": is_log,
            "rows": mine, "values": [v for v, _ in located], "u": [u for _, u in located],
            "counted": counted, "why_not": why_not, "spread": _spread(located, counted),
            "trend": _trend(located, counted, chart), "chart": chart,
        }  # fmt: skip
    return found


def _has(row: Row, name: str) -> bool:
    record = row["parameters"].get(name)
    return bool(row["status"] != FAILED and record and record["sd"] and record["sd"] > 0.0)


def _why_not(row: Row, name: str) -> str:
    """Why a number is no measurement of a parameter of the material; empty where it is one."""
    if row["verdict"] == "FAIL":
        return "verdict FAIL"
    return "" if row["parameters"][name]["identified"] else "not identified"


def _location(record: Row, is_log: bool) -> tuple[float, float]:
    """Mean and standard deviation, or those of the logarithm from median and 95 % interval."""
    if not is_log:
        return float(record["mean"]), float(record["sd"])
    width = log(record["q975"]) - log(record["q025"])
    return log(record["median"]), width / (2.0 * _NORMAL_975)


def _spread(located: Sequence[tuple[float, float]], counted: Sequence[bool]) -> Any:
    used = [pair for pair, use in zip(located, counted, strict=True) if use]
    try:
        return asdict(infer_spread([v for v, _ in used], [u for _, u in used]))
    except DataError:
        return None


def _trend(located: Sequence[tuple[float, float]], counted: Sequence[bool], chart: Any) -> Any:
    """Over the places, without samples beyond their limits unless these are many."""
    places = [i for i, use in enumerate(counted) if use]
    inside = [i for i in places if chart is None or not chart["beyond"][i]]
    if 3 * len(inside) >= 2 * len(places):
        places = inside
    used = [(i, *located[i]) for i in places]
    found = infer_trend(*zip(*used, strict=True)) if used else None
    return None if found is None else {**asdict(found), "seen": found.is_seen}


def _chart(located: Sequence[tuple[float, float]], counted: Sequence[bool]) -> Any:
    chart = draw_limits([v for v, _ in located], [u for _, u in located], counted)
    if chart is None:
        return None
    return {
        "centre": chart.centre, "low": chart.low, "high": chart.high,
        "sigma_between": chart.sigma_between, "sample_low": chart.sample_low.tolist(),
        "sample_high": chart.sample_high.tolist(), "beyond": chart.beyond.tolist(),
    }  # fmt: skip
