"""Cells of a tidy CSV to numbers and codes of words, checked against `tidy_columns`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.csv_table import Chunk, open_table, read_bytes, refuse
from pbrdf_bayes.io.formats.dispatch import convert
from pbrdf_bayes.io.formulas import unguard
from pbrdf_bayes.io.problems import (
    N_LINES,
    Problem,
    Problems,
    compose_message,
    printable,
    show_cell,
)
from pbrdf_bayes.io.tidy_columns import (
    BRDF_WITH_FLOOR,
    COLUMN,
    MINUS,
    NUMBER_COLUMNS,
    OVERLOAD,
    WORD_COLUMNS,
    Range,
    check_header,
    explain_number,
    explain_word,
    missing_column,
    to_floats,
)
from pbrdf_bayes.measurement import (
    is_label,
    is_name,
)

Rows = Mapping[str, NDArray[Any]]
"""Columns by name, shape (n_rows,): numbers, codes of words, ``line``, ``used`` and ``bad``."""

SAME_WAVELENGTH = 1e-4
"""Wavelengths of a sample that differ by less, relatively, are one."""
_LEAST_SIGMA = 1e-8
"""Of ``value``: no instrument is better."""
_MOST_SPELLINGS = 5


@dataclass(frozen=True, eq=False)
class CheckedRows:
    """Checked rows of a file; ``problems`` is all that is wrong, ``words`` what codes mean."""

    path: str
    sha256: str
    rows: Rows
    words: Mapping[str, Words]
    problems: Problems
    warnings: tuple[str, ...]

    @property
    def message(self) -> str:
        """All problems as one text."""
        return compose_message(self.path, self.problems.listed(), self.problems.n)


class Words(dict[str, int]):
    """Code of the word in each cell of a text column, its blanks and formula guard left out."""

    def __init__(self, path: str, column: str) -> None:
        super().__init__()
        self.path, self.column = path, COLUMN[column]
        self.words: list[str] = []
        self.allowed: list[bool] = []
        self.spellings: list[list[str]] = []
        self._codes: dict[str, int] = {}

    def __missing__(self, cell: str) -> int:
        if len(self) > self.column.most:
            what = f"column {self.column.name} has more than {self.column.most} different words"
            refuse(self.path, f"{what} (allowed: up to that). Split the file into several, for "
                              "example by lots.")  # fmt: skip
        word = unguard(cell.strip())
        self[cell] = code = self._codes.setdefault(word, len(self.words))
        if code == len(self.words):
            self.words.append(word)
            self.allowed.append(self._allows(word))
            self.spellings.append([])
        if len(self.spellings[code]) < _MOST_SPELLINGS:
            self.spellings[code].append(cell)
        return code

    def _allows(self, word: str) -> bool:
        if self.column.words:
            return word in self.column.words
        if self.column.name == "sample":
            return is_name(word)
        return not self.column.longest or is_label(word)

    def encode(self, cells: Sequence[str]) -> NDArray[np.int64]:
        """Code of each cell, shape (n_rows,)."""
        return np.fromiter(map(self.__getitem__, cells), np.int64, len(cells))


def read_rows(path: str | Path, brdf_floor: float, *, rows_of_no_sample: bool) -> CheckedRows:
    """Convert and check every row; refuse only what leaves no rows to speak of."""
    if not (isfinite(brdf_floor) and brdf_floor >= 0):
        msg = f"brdf_floor = {brdf_floor!r} is not allowed: give a BRDF [sr^-1] of 0 or more"
        raise ConfigError(msg)
    data = read_bytes(path)
    foreign = convert(path, data)
    digest = hashlib.sha256(data).hexdigest()
    if foreign is not None:
        data = foreign.text.encode()
    return check_data(path, data, digest, brdf_floor, foreign.decisions if foreign else (),
                      rows_of_no_sample=rows_of_no_sample)  # fmt: skip


def check_data(
    path: str | Path, data: bytes, digest: str, brdf_floor: float, decisions: tuple[str, ...], *,
    rows_of_no_sample: bool,
) -> CheckedRows:  # fmt: skip
    """Rows of a tidy CSV; ``digest`` and ``decisions`` are of the file that it was made of."""
    table = open_table(path, data)
    problems = Problems()
    warnings = (*decisions, *check_header(table.header, problems))
    if problems.n:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    words = {name: Words(str(path), name) for name in WORD_COLUMNS}
    parts, minus, has_minus = [], [], MINUS.encode() in data
    for chunk in table.chunks:
        parts.append(_convert(chunk, table.header, words, problems, brdf_floor=brdf_floor))
        if has_minus:
            minus += _lines_with_minus(chunk, table.header)
    names = parts[0] if parts else ()
    rows: Rows = {name: np.concatenate([part[name] for part in parts]) for name in names}
    said = _set_aside(table.unreadable, problems, words["sample"], table.header, rows_of_no_sample)
    if not rows and not problems.n:
        problems.add(Problem(0, "", "the file has a header but no rows. Add the readings."))
    if not rows:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    is_brdf = rows["quantity"] == words["quantity"]["brdf"]
    incomplete = "theta_r_deg" not in table.header and bool(np.any(rows["used"] & is_brdf))
    if incomplete:
        problems.add(missing_column("theta_r_deg", table.header))
    if rows_of_no_sample and (incomplete or table.doubtful):
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    if table.trailing:
        what = f"empty cells at the end of {len(table.trailing)} lines"
        warnings += (f"{what} (first: line {table.trailing[0]}), left out.",)
    if minus:
        what = f"numbers with U+2212, a minus sign that is no hyphen, in {len(minus)} lines"
        warnings += (f"{what} (first: line {minus[0]}) are read as if it were one.",)
    rows = _merge_wavelengths(rows)
    return CheckedRows(printable(str(path)), digest, rows, words, problems, (*warnings, *said))


def _convert(
    chunk: Chunk, header: Sequence[str], words: Mapping[str, Words], problems: Problems, *,
    brdf_floor: float,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Numbers and codes of some rows; what is wrong with them goes to ``problems``."""
    cells = dict(zip(header, chunk.columns, strict=True))
    n_rows, blank = len(chunk.line), ("",) * len(chunk.line)
    rows: dict[str, NDArray[Any]] = {"line": chunk.line}
    for name, book in words.items():
        rows[name] = book.encode(cells.get(name, blank))
    for name in NUMBER_COLUMNS:
        rows[name] = to_floats(cells[name]) if name in cells else np.full(n_rows, nan)
    flags = words["flag"].words
    rows["used"] = np.array([word.lower() in ("", "ok") for word in flags])[rows["flag"]]
    rows["bad"] = np.zeros(n_rows, dtype=bool)
    names = words["sample"].words
    for column, index, allowed in _breaches(rows, cells, words, brdf_floor):
        rows["bad"][index] = True
        kinds: dict[tuple[str, int], list[int]] = {}
        for i, code in zip(index.tolist(), rows["sample"][index].tolist(), strict=True):
            _, kind = _explain(cells[column][i], column, allowed)
            kinds.setdefault((kind, code), []).append(i)
        for (kind, code), members in kinds.items():
            text = "".join(_explain(cells[column][members[0]], column, allowed))
            lines = tuple(chunk.line[members[:N_LINES]].tolist())
            problems.add(Problem(lines[0], column, text, names[code], kind, len(members), lines))
    return rows


def _lines_with_minus(chunk: Chunk, header: Sequence[str]) -> list[int]:
    """Lines with a minus sign that is no hyphen in a number."""
    found: set[int] = set()
    for name, cells in zip(header, chunk.columns, strict=True):
        if name in NUMBER_COLUMNS:
            has_one = np.array([MINUS in cell for cell in cells])
            found.update(chunk.line[has_one].tolist())
    return sorted(found)


def _explain(cell: str, column: str, allowed: Range | str | None) -> tuple[str, str]:
    if isinstance(allowed, str):
        return show_cell(cell.strip())[1:-1], allowed
    if allowed is None:
        return explain_word(cell, COLUMN[column])
    return explain_number(cell, allowed, column)


def _breaches(
    rows: Rows, cells: Mapping[str, Sequence[str]], words: Mapping[str, Words], brdf_floor: float
) -> Iterator[tuple[str, NDArray[np.int64], Range | str | None]]:
    """Column, rows that break a rule, and the rule or what it says."""
    for name, book in words.items():
        if name in cells:
            yield name, np.flatnonzero(rows["used"] & ~np.array(book.allowed)[rows[name]]), None
    for name in NUMBER_COLUMNS:
        if name not in cells:
            continue
        for quantity, allowed in COLUMN[name].ranges.items():
            if name == "value" and quantity == "brdf" and brdf_floor > 0:
                allowed = BRDF_WITH_FLOOR
            wrong = rows["used"] & ~allowed.accepts(rows[name])
            if name == "value":
                wrong |= rows["used"] & (np.abs(rows[name]) >= OVERLOAD)
            if quantity:
                wrong &= rows["quantity"] == words["quantity"][quantity]
            index = np.flatnonzero(wrong)
            if allowed.not_stated:
                column, unstated = cells[name], allowed.not_stated
                stated = [column[i].strip().lower() not in unstated for i in index.tolist()]
                index = index[np.array(stated, dtype=bool)]
            yield name, index, allowed
    sigma, value = rows["sigma"], np.abs(rows["value"])
    too_small = rows["used"] & (sigma > 0) & (sigma < _LEAST_SIGMA * value)
    yield "sigma", np.flatnonzero(too_small), (
        f" is less than {_LEAST_SIGMA:g} of value: no instrument is that good. Give the standard "
        "uncertainty, or leave the cell empty."
    )  # fmt: skip


def _set_aside(
    unreadable: Problems, problems: Problems, samples: Words, header: Sequence[str],
    rows_of_no_sample: bool,
) -> tuple[str, ...]:  # fmt: skip
    """Give rows that cannot be read to their samples, or to none; return a warning for all."""
    nameless = Problems()
    for name, own in unreadable.found.items():
        name = unguard(name)
        # Where the name is not the first cell, it may be another cell that has shifted.
        known = is_name(name) and (header.index("sample") == 0 or name in samples.words)
        for problem in own.values():
            owner = name if known and rows_of_no_sample else ""
            (problems if owner else nameless).add(problem.of(owner))
    if rows_of_no_sample:
        for problem in problems.found.pop("", {}).values():
            nameless.add(problem)
            problems.n -= problem.n
    problems.extend(nameless)
    if not rows_of_no_sample:
        return ()
    rows = (p for p in nameless.listed() if p.column in ("", "sample"))
    return tuple(f"not read, and may be of this sample: {p}" for p in rows)


def _merge_wavelengths(rows: Rows) -> Rows:
    """Give readings of one sample the wavelength of most of them, where they nearly agree."""
    wavelength, sample = rows["wavelength_um"], rows["sample"]
    index = np.flatnonzero(wavelength > 0)
    index = index[np.lexsort((wavelength[index], sample[index]))]
    x, code = wavelength[index], sample[index]
    if not index.size:
        return rows
    new = np.ones(x.size, dtype=bool)
    new[1:] = (code[1:] != code[:-1]) | (x[1:] > x[:-1] * (1 + SAME_WAVELENGTH))
    start = np.flatnonzero(new)
    last = np.append(start[1:], x.size) - 1
    differ = np.flatnonzero((x[start] < x[last]) & (x[last] <= x[start] * (1 + SAME_WAVELENGTH)))
    merged = wavelength.copy()
    for i in differ.tolist():
        own = index[start[i] : last[i] + 1]
        values, n = np.unique(wavelength[own], return_counts=True)
        merged[own] = values[np.argmax(n)]
    return {**rows, "wavelength_um": merged, "wavelength_as_read": wavelength}
