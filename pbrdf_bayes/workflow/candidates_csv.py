"""Candidates for the next measurement: those of a grid, and those of a CSV file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.design.candidates import (
    MOST_READINGS,
    Candidate,
    Costs,
    list_candidates,
    repeats,
    usual_scan,
)
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.csv_table import open_table, read_bytes, refuse
from pbrdf_bayes.io.problems import Problem, Problems, compose_message, show_cell
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.quantities import PLANNED, POLARIZATIONS
from pbrdf_bayes.scenes import spaced

Fault = tuple[str, str]
"""A column, empty for the row as a whole, and what is wrong there."""
KINDS = {"scan": "brdf", "dhr": "dhr", "ddr": "ddr"}
"""Kinds of measurement as the command line has them, and the quantity that each gives."""
_REQUIRED = ("quantity", "polarization", "theta_i_deg")
_RANGE = ("theta_r_lo_deg", "theta_r_hi_deg", "theta_r_step_deg")
_NO_RANGE = dict.fromkeys(_RANGE, "")
_OPTIONAL = (*_RANGE, "port_deg", "minutes")
_OF_PLAN = ("order", "readings", "cumulative_minutes", "expected_gain_nats")
"""Columns of a measurement plan beyond these: a plan can be given back as candidates."""
_MOST_CANDIDATES = 20_000
"""Rows of a file of candidates: each is screened, and the promising ones are simulated."""
_MOST_READINGS_IN_ALL = 2_000_000
"""Readings of all scans of a file."""
GRID_DEG = tuple(float(a) for a in range(0, 90, 5))
"""Angles of incidence where nothing else is said [deg]."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Candidates that are asked for.

    Attributes
    ----------
    kinds : tuple of {"scan", "dhr", "ddr"}
        Of the grid; empty for none.
    csv : Path, optional
        Explicit candidates.
    theta_i_deg : tuple of float or None
        Angles of incidence of the grid [deg]; None for every 5 degrees to 85 and every geometry
        that was measured.
    theta_r_deg : tuple of float
        Of every scan; empty for those that the sample has been scanned with [deg].
    polarizations : tuple of {"s", "p", "u"}
    port_deg : tuple of float
        Half angles of the specular port of a DDR [deg].
    costs : Costs
    """

    kinds: tuple[str, ...] = tuple(KINDS)
    csv: Path | None = None
    theta_i_deg: tuple[float, ...] | None = None
    theta_r_deg: tuple[float, ...] = ()
    polarizations: tuple[str, ...] = POLARIZATIONS
    port_deg: tuple[float, ...] = (5.0,)
    costs: Costs = field(default_factory=Costs)


def parse_kinds(text: str) -> tuple[tuple[str, ...], Path | None]:
    """Kinds of candidates and the CSV file in ``scan,dhr,FILE.csv``.

    Raises
    ------
    ConfigError

    Examples
    --------
    >>> parse_kinds("scan,dhr")
    (('scan', 'dhr'), None)
    """
    kinds: list[str] = []
    files: list[Path] = []
    for word in (part.strip() for part in text.split(",")):
        if word in KINDS:
            kinds.append(word)
        elif word.lower().endswith(".csv") or Path(word).is_file():
            files.append(Path(word))
        elif word:
            hint = did_you_mean(word, KINDS)
            msg = (
                f"--candidates: {word[:60]!r} is not known.{hint} "
                f"Give {', '.join(KINDS)} with commas, or the path of a CSV file"
            )
            raise ConfigError(msg)
    if len(files) > 1 or not (kinds or files):
        msg = f"--candidates {text[:60]!r}: give {', '.join(KINDS)} with commas, or one CSV file"
        raise ConfigError(msg)
    return tuple(dict.fromkeys(kinds)), files[0] if files else None


def list_wanted(wanted: Wanted, measurement: Measurement | None) -> tuple[Candidate, ...]:
    """Candidates of the grid and of the file, each once.

    Parameters
    ----------
    wanted : Wanted
    measurement : Measurement or None
        What has been measured: scans are taken as it was scanned, where nothing else is said.

    Returns
    -------
    tuple of Candidate

    Raises
    ------
    ConfigError, DataError
    """
    scan = wanted.theta_r_deg or _scan_so_far(measurement)
    found: tuple[Candidate, ...] = ()
    quantities = [KINDS[kind] for kind in wanted.kinds]
    if quantities:
        found = list_candidates(
            quantities=quantities,
            theta_i_deg=GRID_DEG if wanted.theta_i_deg is None else wanted.theta_i_deg,
            polarizations=wanted.polarizations, theta_r_deg=scan, port_deg=wanted.port_deg,
            costs=wanted.costs,
        )  # fmt: skip
    if measurement is not None and wanted.theta_i_deg is None:
        again = repeats(measurement, scan, costs=wanted.costs)
        found += tuple(
            c for c in again if c.quantity in quantities and c.polarization in wanted.polarizations
        )
    if wanted.csv is not None:
        port = wanted.port_deg[0]
        found += read_candidates(wanted.csv, scan, costs=wanted.costs, port_deg=port)
    return tuple(dict.fromkeys(found))


def _scan_so_far(measurement: Measurement | None) -> tuple[float, ...]:
    if measurement is None:
        return tuple(float(a) for a in range(-80, 81))
    return usual_scan(measurement)


def read_candidates(
    path: Path, scan: Sequence[float], *, costs: Costs, port_deg: float
) -> tuple[Candidate, ...]:
    """Candidates of a CSV file, or a plan of measurements made before.

    Parameters
    ----------
    path : Path
        Columns quantity, polarization and theta_i_deg; optional theta_r_lo_deg, theta_r_hi_deg and
        theta_r_step_deg together, port_deg and minutes. An empty cell is one not given.
    scan : sequence of float
        theta_r of scans that do not say theirs [deg].
    costs : Costs
        Of candidates that do not say their minutes.
    port_deg : float
        Half angle of the port of a DDR that does not say its own [deg].

    Returns
    -------
    tuple of Candidate

    Raises
    ------
    DataError
        With file, line, value, what is allowed and what to do.
    """
    problems = Problems()
    table = open_table(path, read_bytes(path))
    _check_header(path, table.header)
    found: list[Candidate] = []
    n_rows = n_readings = 0
    known: dict[tuple[float, ...], tuple[float, ...]] = {}
    for chunk in table.chunks:
        beyond = _MOST_CANDIDATES - n_rows
        if len(chunk.line) > beyond:
            where = f"line {chunk.line[beyond]}: " if beyond >= 0 else ""
            refuse(path, f"{where}more than {_MOST_CANDIDATES} rows (allowed: up to that). "
                         "Give fewer.")  # fmt: skip
        for line, cells in zip(chunk.line.tolist(), zip(*chunk.columns, strict=True), strict=True):
            row = {name: cell.strip() for name, cell in zip(table.header, cells, strict=True)}
            one, faults = _read_row(row, scan, costs, port_deg)
            n_rows += 1
            for column, text in faults:
                problems.add(Problem(line, column, text))
            if one is not None:
                same = known.setdefault(one.theta_r_deg, one.theta_r_deg)  # kept once in memory
                found.append(replace(one, theta_r_deg=same) if same is not one.theta_r_deg else one)
                n_readings += one.n_readings
            if n_readings > _MOST_READINGS_IN_ALL:
                refuse(path, f"line {line}: the scans have more than {_MOST_READINGS_IN_ALL} "
                             "readings in all (allowed: up to that). Give fewer rows, or larger "
                             "theta_r_step_deg.")  # fmt: skip
    problems.extend(table.unreadable)
    if problems.n:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    if not found:
        refuse(path, "there is a header and no candidate. Give at least one row.")
    return tuple(found)


class _CellError(Exception):
    """Cells that are not usable, and what is read instead to find what else is wrong."""

    def __init__(self, faults: Sequence[Fault], instead: Mapping[str, str]) -> None:
        super().__init__()
        self.faults, self.instead = faults, instead


def _read_row(
    row: Mapping[str, str], scan: Sequence[float], costs: Costs, port_deg: float
) -> tuple[Candidate | None, list[Fault]]:
    """The candidate of a row, or everything that is wrong with it."""
    faults: list[Fault] = []
    while True:
        try:
            one = _candidate(row, scan, costs, port_deg)
        except _CellError as wrong:
            faults += wrong.faults
            row = {**row, **wrong.instead}
        except ConfigError as error:
            of_cells = str(error).partition(": ")[2] if faults else str(error)
            return None, [*faults, ("", f"{of_cells}.")]
        else:
            return (None if faults else one), faults


def _check_header(path: Path, header: Sequence[str]) -> None:
    known = (*_REQUIRED, *_OPTIONAL)
    for name in header:
        if header.count(name) > 1:
            refuse(path, f"line 1: column {show_cell(name)} is there twice. Keep one of them.")
        if name not in (*known, *_OF_PLAN):
            hint = did_you_mean(name, known)
            refuse(path, f"line 1: column {show_cell(name)} is not known.{hint} "
                         f"Known: {', '.join(known)}.")  # fmt: skip
    missing = [name for name in _REQUIRED if name not in header]
    if missing:
        refuse(path, f"line 1: column {missing[0]} is missing. Required: {', '.join(_REQUIRED)}.")


def _candidate(
    row: Mapping[str, str], scan: Sequence[float], costs: Costs, port_deg: float
) -> Candidate:
    quantity = _word(row, "quantity", PLANNED)
    angles = tuple(scan) if quantity == "brdf" else ()
    if any(row.get(name) for name in _RANGE):
        if quantity != "brdf":
            text = f"belongs to scans, and this is a {quantity}. Leave it empty."
            raise _CellError([(_RANGE[0], text)], _NO_RANGE)
        angles = _range(row)
    port = port_deg if quantity == "ddr" else 0.0
    if row.get("port_deg"):
        port = _number(row, "port_deg")
    cost = costs.of(quantity, max(len(angles), 1))
    return Candidate(
        quantity,
        _word(row, "polarization", POLARIZATIONS),
        _number(row, "theta_i_deg"),
        minutes=_number(row, "minutes") if row.get("minutes") else cost,
        theta_r_deg=angles,
        port_deg=port,
    )


def _range(row: Mapping[str, str]) -> tuple[float, ...]:
    faults: list[Fault] = []
    for name in _RANGE:
        if not row.get(name):
            faults.append((name, f"empty. Give all of {', '.join(_RANGE)}, or none of them."))
        elif not math.isfinite(_float(row[name])):
            faults.append((name, _no_number(row[name])))
    if faults:
        raise _CellError(faults, _NO_RANGE)
    low, high, step = (_float(row[name]) for name in _RANGE)
    try:
        return tuple(spaced(f"{low}:{high}:{step}", most=MOST_READINGS))
    except ValueError:
        text = f"{low:g} to {high:g} by {step:g} is no scan of up to {MOST_READINGS} readings. "
        fault = _RANGE[0], text + "Give lo <= hi and a step above 0."
        raise _CellError([fault], _NO_RANGE) from None


def _word(row: Mapping[str, str], name: str, allowed: Sequence[str]) -> str:
    cell = row[name]
    if cell not in allowed:
        meant = KINDS.get(cell)
        hint = f" Did you mean {meant!r}?" if meant in allowed else did_you_mean(cell, allowed)
        text = f"{show_cell(cell)} is not known.{hint} Allowed: {', '.join(allowed)}."
        raise _CellError([(name, text)], {name: allowed[0]} if name != "quantity" else _usable(row))
    return cell


def _usable(row: Mapping[str, str]) -> dict[str, str]:
    """A quantity to which what else is in the row may belong."""
    if any(row.get(name) for name in _RANGE):
        return {"quantity": "brdf"}
    return {"quantity": "ddr" if row.get("port_deg") else "dhr"}


def _number(row: Mapping[str, str], name: str) -> float:
    value = _float(row[name])
    if not math.isfinite(value):
        raise _CellError([(name, _no_number(row[name]))], {name: "1"})
    return value


def _float(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _no_number(cell: str) -> str:
    return f"{show_cell(cell)} is not a number. Give one, e.g. 55."
