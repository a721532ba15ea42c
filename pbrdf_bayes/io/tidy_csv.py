"""Tidy CSV in: one file, validated as a whole, to measurements of its samples.

The way of a file: `csv_table` cuts it into cells, `_convert` makes numbers and codes of words and
checks them against `tidy_columns`, `_group` finds samples and wavelengths, `_build` makes each a
`Measurement`.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isclose, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.csv_table import MAX_ROWS, Chunk, open_table, read_bytes, refuse
from pbrdf_bayes.io.formats.content import Decided
from pbrdf_bayes.io.formats.dispatch import Foreign, convert, import_files
from pbrdf_bayes.io.formulas import unguard
from pbrdf_bayes.io.problems import (
    N_LINES,
    N_LISTED,
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
    MOST_SAMPLES,
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
from pbrdf_bayes.io.tidy_notices import notice
from pbrdf_bayes.io.tidy_writer import replace_file, write_tidy_csv
from pbrdf_bayes.measurement import (
    Measurement,
    is_label,
    is_name,
    measurement_from_columns,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "TidyFile", "import_readings", "import_to_csv", "read_measurement", "read_samples",
    "read_usable_samples", "write_tidy_csv",
]  # fmt: skip

Key = tuple[str, float]
"""Sample and wavelength [um]."""
Rows = Mapping[str, NDArray[Any]]
"""Columns by name, shape (n_rows,): numbers, codes of words, ``line``, ``used`` and ``bad``."""
Flags = Mapping[Key, Mapping[str, int]]
"""Flagged rows by flag, by sample and wavelength; "" and 0 where they name none."""

SAME_WAVELENGTH = 1e-4
"""Wavelengths of a sample that differ by less, relatively, are one."""
_LEAST_SIGMA = 1e-8
"""Of ``value``: no instrument is better."""
_MOST_SCANS = 100_000
_ANY_FLOOR = 1e-300
"""Noise floor [sr^-1] with which any finite BRDF is admitted."""
_MOST_COUNTS = 1_000_000
_MOST_SPELLINGS = 5


@dataclass(frozen=True, eq=False)
class TidyFile:
    """Everything a tidy CSV holds, sample by sample.

    Attributes
    ----------
    source, sha256 : str
        File name (without folder) and hash of its bytes.
    n_rows : int
        Rows read, flagged ones included.
    measurements : mapping of (sample, wavelength_um) to Measurement
        Samples without a problem, by name and wavelength.
    errors : mapping of str to str
        Message for each sample that is refused or has no usable row, by name; "" for rows that
        belong to no sample.
    first_lines : mapping of str to int
        First line of each of these.
    problems : tuple of Problem
        First kinds of problems of the whole file, in its order.
    n_problems : int
        Number of all problems.
    warnings : tuple of str
        What concerns the file as a whole; every measurement repeats it.
    message : str
        All problems as one message; empty where there is none.
    """

    source: str
    sha256: str
    n_rows: int
    measurements: Mapping[Key, Measurement]
    errors: Mapping[str, str]
    first_lines: Mapping[str, int]
    problems: tuple[Problem, ...]
    n_problems: int
    warnings: tuple[str, ...]
    message: str


@dataclass(frozen=True, eq=False)
class _Content:
    """Checked rows of a file; ``problems`` is all that is wrong, ``words`` what codes mean."""

    path: str
    sha256: str
    rows: Rows
    words: Mapping[str, _Words]
    problems: Problems
    warnings: tuple[str, ...]

    @property
    def message(self) -> str:
        """All problems as one text."""
        return compose_message(self.path, self.problems.listed(), self.problems.n)


def read_measurement(
    path: str | Path | pd.DataFrame,
    *,
    sample: str | None = None,
    wavelength_um: float | None = None,
    brdf_floor: float = 0.0,
) -> Measurement:
    r"""Read and validate readings; return those of one sample at one wavelength.

    The whole file has to be valid, so that a shifted column is noticed wherever it shows first.
    Rows with a ``flag`` other than ``ok`` are counted in ``Measurement.excluded`` and not checked.

    Parameters
    ----------
    path : str, Path or DataFrame
        Tidy CSV in UTF-8 with a header, comma-separated, or a table with its columns; or a file in
        one of the formats of `import_readings`, where it leaves nothing undecided.
    sample : str, optional
        Name of the sample; needed where the file has several.
    wavelength_um : float, optional
        Wavelength [um]; needed where the sample has several. Those that agree within
        `SAME_WAVELENGTH` are one.
    brdf_floor : float, optional
        Noise-equivalent BRDF of the instrument [sr^-1]. Above 0, readings of zero or less are
        accepted: the likelihood treats them as censored.

    Returns
    -------
    Measurement
        ``warnings`` holds what was noticed without being refused.

    Raises
    ------
    DataError
        When anything is wrong: one message that names line, column, value, allowed range and
        remedy of the first 20 kinds of problems, and the number of all.
    ConfigError
        When ``brdf_floor`` is negative or not finite.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> file = pathlib.Path(folder.name) / "green.csv"
    >>> header = "sample,wavelength_um,quantity,polarization,theta_i_deg,theta_r_deg,value"
    >>> _ = file.write_text(header + "\ngreen,3.39,brdf,s,20,-5,0.011\ngreen,3.39,dhr,s,20,,0.03")
    >>> m = read_measurement(file)
    >>> m.sample, m.wavelength_um, len(m.brdf), len(m.dhr)
    ('green', 3.39, 1, 1)
    >>> folder.cleanup()
    """
    if isinstance(path, str | Path):
        content = _read(path, brdf_floor, rows_of_no_sample=False)
    else:
        data = path.to_csv(index=False).encode("utf-8", "surrogatepass")
        digest = hashlib.sha256(data).hexdigest()
        content = _read_data("DataFrame", data, digest, brdf_floor, (), rows_of_no_sample=False)
    return _measurement(content, sample, wavelength_um)


def _measurement(content: _Content, sample: str | None, wavelength_um: float | None) -> Measurement:
    """The readings of one sample at one wavelength."""
    groups = _group(content)
    key = _choose(_names_in_use(content), list(groups), sample, wavelength_um)
    if isinstance(key, Problem):
        content.problems.add(key)
    if content.problems.n or key is None or isinstance(key, Problem):
        raise DataError(content.message)
    return _build(content, key, groups[key], _count_flags(content, [key]))


def import_readings(*paths: str | Path, brdf_floor: float = 0.0, **decisions: Any) -> Measurement:
    """Read files as laboratories have them into one measurement.

    Parameters
    ----------
    *paths : str or Path
        Files of one sample in any of the formats of `pbrdf_bayes.io.formats`: content decides,
        not the extension.
    brdf_floor : float, optional
        As in `read_measurement` [sr^-1].
    **decisions
        What the files leave open, see `Decided`: ``format``, ``sample``, ``polarization``,
        ``wavelength_um``, ``theta_i_deg``, ``forward``, ``value``, ``unit``, ``sheet``.

    Returns
    -------
    Measurement
        ``warnings`` holds every decision.

    Raises
    ------
    DataError
        A file is damaged, in no format that is known, or leaves something undecided: the option
        that decides is named (`UndecidedError`).
    ConfigError
        A decision is none of those that there are.
    """
    try:
        decided = Decided(**decisions)
    except TypeError:
        known = list(Decided.__dataclass_fields__)
        wrong = next(name for name in decisions if name not in known)
        msg = f"{wrong!r} is not a decision.{did_you_mean(wrong, known)} Known: {', '.join(known)}"
        raise ConfigError(msg) from None
    content = _read_foreign(paths, import_files(paths, decided), brdf_floor)
    return _measurement(content, None, None)


def import_to_csv(paths: Sequence[str | Path], decided: Decided, out: Path) -> tuple[str, ...]:
    """Write files of one sample as a tidy CSV; return the decisions.

    Parameters
    ----------
    paths : sequence of str or Path
    decided : Decided
        What the files leave open.
    out : Path

    Raises
    ------
    DataError, ConfigError
        As `import_readings`; nothing is written then.
    """
    foreign = import_files(paths, decided)
    content = _read_foreign(paths, foreign, _ANY_FLOOR)
    if content.problems.n:
        raise DataError(content.message)
    replace_file(out, foreign.text)
    return (*foreign.decisions, *content.warnings[len(foreign.decisions) :])


def _read_foreign(paths: Sequence[str | Path], foreign: Foreign, brdf_floor: float) -> _Content:
    """Rows of files that were converted."""
    digest = next(iter(foreign.sha256.values())) if len(paths) == 1 else ""
    digest = digest or hashlib.sha256("".join(foreign.sha256.values()).encode()).hexdigest()
    return _read_data(
        paths[0], foreign.text.encode(), digest, brdf_floor, foreign.decisions,
        rows_of_no_sample=False,
    )  # fmt: skip


def read_samples(path: str | Path, *, brdf_floor: float = 0.0) -> TidyFile:
    """Read a tidy CSV once; return the measurements of all its samples and all its problems.

    A problem in the rows of one sample leaves the other samples usable. ``brdf_floor`` is as in
    `read_measurement` [sr^-1].

    Raises
    ------
    DataError
        When the file as a whole is not usable: no such file, not text, header not right, rows
        that cannot be read or belong to no sample.
    ConfigError
        When ``brdf_floor`` is negative or not finite.
    """
    content = _read(path, brdf_floor, rows_of_no_sample=False)
    if "" in content.problems.found:
        raise DataError(content.message)
    return _tidy_file(content)


def read_usable_samples(path: str | Path, *, brdf_floor: float = 0.0) -> TidyFile:
    """`read_samples` where a row that cannot be read costs the sample that it belongs to alone.

    Such are rows of another length than the header, that are no text, or that name no sample.
    Where the sample cannot be told, the message is that of the sample "", and every other one has
    a warning: the reading may be of it.

    Raises
    ------
    DataError
        As `read_samples`, where that is not the fault of single rows: the quotes are unbalanced,
        the header is wrong.
    """
    return _tidy_file(_read(path, brdf_floor, rows_of_no_sample=True))


def _tidy_file(content: _Content) -> TidyFile:
    errors = _refused_samples(content)
    groups = {key: rows for key, rows in _group(content).items() if key[0] not in errors}
    measurements = _build_all(content, groups, errors)
    return TidyFile(
        source=Path(content.path).name,
        sha256=content.sha256,
        n_rows=content.rows["line"].size,
        measurements=measurements,
        errors=errors,
        first_lines=_first_lines(content, errors),
        problems=content.problems.listed(),
        n_problems=content.problems.n,
        warnings=content.warnings,
        message=content.message if content.problems.n else "",
    )


# Cells to checked rows


class _Words(dict[str, int]):
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


def _read(path: str | Path, brdf_floor: float, *, rows_of_no_sample: bool) -> _Content:
    """Convert and check every row; refuse only what leaves no rows to speak of."""
    if not (isfinite(brdf_floor) and brdf_floor >= 0):
        msg = f"brdf_floor = {brdf_floor!r} is not allowed: give a BRDF [sr^-1] of 0 or more"
        raise ConfigError(msg)
    data = read_bytes(path)
    foreign = convert(path, data)
    digest = hashlib.sha256(data).hexdigest()
    if foreign is not None:
        data = foreign.text.encode()
    return _read_data(path, data, digest, brdf_floor, foreign.decisions if foreign else (),
                      rows_of_no_sample=rows_of_no_sample)  # fmt: skip


def _read_data(
    path: str | Path, data: bytes, digest: str, brdf_floor: float, decisions: tuple[str, ...], *,
    rows_of_no_sample: bool,
) -> _Content:  # fmt: skip
    """Rows of a tidy CSV; ``digest`` and ``decisions`` are of the file that it was made of."""
    table = open_table(path, data)
    problems = Problems()
    warnings = (*decisions, *check_header(table.header, problems))
    if problems.n:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    words = {name: _Words(str(path), name) for name in WORD_COLUMNS}
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
    return _Content(printable(str(path)), digest, rows, words, problems, (*warnings, *said))


def _convert(
    chunk: Chunk, header: Sequence[str], words: Mapping[str, _Words], problems: Problems, *,
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
    rows: Rows, cells: Mapping[str, Sequence[str]], words: Mapping[str, _Words], brdf_floor: float
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
    unreadable: Problems, problems: Problems, samples: _Words, header: Sequence[str],
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


# Rows to measurements


def _spellings(samples: _Words, code: int) -> tuple[str, ...]:
    """A warning where the name of a sample stands there with other blanks at its ends too."""
    cells = sorted(samples.spellings[code])
    if len(cells) < 2 or all(cell == cell.strip() for cell in cells):
        return ()
    listed = ", ".join(map(show_cell, cells))
    text = f"column sample: {listed} differ by blanks at the ends and are taken as one sample."
    return (f"{text} Give names that differ otherwise if they are several.",)


def _names_in_use(content: _Content) -> list[str]:
    """Names of the samples with at least one row that is not flagged."""
    codes = np.unique(content.rows["sample"][content.rows["used"]])
    return sorted({content.words["sample"].words[code] for code in codes.tolist()} - {""})


def _group(content: _Content) -> dict[Key, NDArray[np.int64]]:
    """Rows without a problem of each sample and wavelength, by name and wavelength."""
    rows = content.rows
    index = np.flatnonzero(rows["used"] & ~rows["bad"])
    index = index[np.lexsort((rows["wavelength_um"][index], rows["sample"][index]))]
    sample, wavelength = rows["sample"][index], rows["wavelength_um"][index]
    new = (sample[1:] != sample[:-1]) | (wavelength[1:] != wavelength[:-1])
    if (n := np.count_nonzero(new) + 1) > MOST_SAMPLES:
        reason = f"the file has {n} samples, each wavelength counted"
        refuse(content.path, f"{reason} (allowed: up to {MOST_SAMPLES}). Split it into several.")
    parts = np.split(index, np.flatnonzero(new) + 1) if index.size else []
    names = content.words["sample"].words
    keyed = {(names[rows["sample"][p[0]]], float(rows["wavelength_um"][p[0]])): p for p in parts}
    return {key: keyed[key] for key in sorted(keyed)}


def _choose(
    names: Sequence[str], keys: Iterable[Key], sample: str | None, wavelength_um: float | None
) -> Key | Problem | None:
    """The sample and wavelength asked for, or why there is none; None where its rows are all bad.

    ``names`` are samples with rows that are not flagged, ``keys`` have rows without a problem.
    """
    if sample is None and len(names) == 1:
        sample = names[0]
    if sample is None or sample not in names:
        return Problem(0, "sample", _explain_sample(sample, names))
    present = [wavelength for name, wavelength in keys if name == sample]
    if wavelength_um is None:
        near = present
    else:
        near = [w for w in present if isclose(w, wavelength_um, rel_tol=SAME_WAVELENGTH)]
        near = sorted(near, key=lambda w: abs(w - wavelength_um))[:1]
    if len(near) == 1 or not present:
        return (sample, near[0]) if near else None
    listed = f"sample {show_cell(sample)} has {_list_some([f'{w:.10g}' for w in present])} um."
    if wavelength_um is None:
        text = f"{listed} Choose one (wavelength_um=, or --wavelength)."
    else:
        text = f"{wavelength_um:.10g} um was not measured: {listed} Choose one of them."
    return Problem(0, "wavelength_um", text)


def _explain_sample(sample: str | None, names: Sequence[str]) -> str:
    """Say why no sample is chosen, and which there are."""
    if not names:
        return "every row is flagged, no reading is left. Clear the flag of rows to be used."
    listed = _list_some([show_cell(name) for name in names])
    if sample is None:
        return f"the file has {len(names)} samples. Choose one (sample=, or --sample): {listed}."
    hint = did_you_mean(sample, names)
    return f"{show_cell(sample)} has no rows to use.{hint} The file has: {listed}."


def _list_some(words: Sequence[str]) -> str:
    """First words of a list, and how many there are where they are too many."""
    more = f", ... ({len(words)} in all)" if len(words) > N_LISTED else ""
    return ", ".join(words[:N_LISTED]) + more


def _count_flags(content: _Content, keys: Iterable[Key]) -> Flags:
    """Flagged rows, counted once for all samples and wavelengths ``keys``."""
    rows = content.rows
    index = np.flatnonzero(~rows["used"])
    wavelength = np.where(rows["wavelength_um"][index] > 0, rows["wavelength_um"][index], 0.0)
    kinds = np.stack([rows["sample"][index], wavelength, rows["flag"][index]], axis=1)
    names, flags = content.words["sample"].words, content.words["flag"].words
    found: dict[Key, dict[str, int]] = {}
    for (code, um, flag), n in zip(*np.unique(kinds, axis=0, return_counts=True), strict=True):
        found.setdefault((names[int(code)], float(um)), {})[flags[int(flag)]] = int(n)
    if sum(len(found.get(place, ())) for key in keys for place in _places(key)) > _MOST_COUNTS:
        reason = "flagged rows that name no sample or no wavelength have too many different flags."
        refuse(content.path, f"{reason} They count in every sample: fill in where they belong.")
    return found


def _places(key: Key) -> tuple[Key, ...]:
    """Where `Flags` has the rows that count for a sample and wavelength."""
    return key, (key[0], 0.0), ("", key[1]), ("", 0.0)


def _refused_samples(content: _Content) -> dict[str, str]:
    """Message for each sample with a problem, or without a row that is not flagged."""
    names = content.words["sample"].words
    unused = set(names) - set(_names_in_use(content)) - {""}
    errors = {
        name: f"{content.path}: sample {show_cell(name)}: {_explain_sample(None, [])}"
        for name in unused
    }
    bad = content.rows["bad"]
    lines, codes = content.rows["line"][bad], content.rows["sample"][bad]
    unique = np.unique(codes, return_index=True, return_counts=True)
    found = {
        names[code]: [(int(lines[first]), int(n))] for code, first, n in zip(*unique, strict=True)
    }
    for name, own in content.problems.found.items():
        aside = [(p.line, p.n) for p in own.values() if not p.column]  # these are not among rows
        found[name] = [*found.get(name, []), *aside]
    for name, parts in found.items():
        n, first = sum(n for _, n in parts), min(line for line, _ in parts)
        what = f"sample {show_cell(name)} was" if name else "what belongs to no sample was"
        head = f"{content.path}: {what} not read: {n} row"
        head += f"{'s' if n > 1 else ''} with problems from line {first} on."
        own_lines = (f"  {problem}" for problem in content.problems.listed(name))
        errors[name] = "\n".join([head, *own_lines])
    return {name: errors[name] for name in sorted(errors)}


def _first_lines(content: _Content, errors: Iterable[str]) -> dict[str, int]:
    """Line on which each of these samples begins, whatever is wrong with it."""
    codes, first = np.unique(content.rows["sample"], return_index=True)
    names = [content.words["sample"].words[code] for code in codes.tolist()]
    begins = dict(zip(names, content.rows["line"][first].tolist(), strict=True))
    for name in errors:
        lines = [p.line for p in content.problems.found.get(name, {}).values() if p.line]
        begins[name] = min([*lines, begins.get(name, MAX_ROWS)])
    return {name: begins[name] for name in errors}


def _build_all(
    content: _Content, groups: Mapping[Key, NDArray[np.int64]], errors: dict[str, str]
) -> dict[Key, Measurement]:
    """Measurements of all samples; those that cannot be made go to ``errors``."""
    flags = _count_flags(content, groups)
    found: dict[Key, Measurement] = {}
    n_scans = 0
    for key, index in groups.items():
        try:
            found[key] = _build(content, key, index, flags)
        except DataError as error:
            errors[key[0]] = str(error)
            content.problems.add(Problem(0, "", str(error), sample=key[0]))
            continue
        n_scans += len(found[key].scans)
        if n_scans > _MOST_SCANS:
            reason = f"more than {_MOST_SCANS} scans in all (allowed: up to that)."
            refuse(content.path, f"{reason} Split the file into several.")
    return {key: m for key, m in found.items() if key[0] not in errors}


def _build(content: _Content, key: Key, index: NDArray[np.int64], flags: Flags) -> Measurement:
    """Measurement from the rows of one sample at one wavelength."""
    rows = {name: column[index] for name, column in content.rows.items()}
    columns: dict[str, Any] = {
        name: rows[name] for name in ("theta_i_deg", "theta_r_deg", "value", "sigma", "n_repeats")
    }
    columns["phi_r_deg"] = np.nan_to_num(rows["phi_r_deg"], nan=0.0)
    for name in ("quantity", "polarization", "scan"):
        codes, place = np.unique(rows[name], return_inverse=True)
        words = [content.words[name].words[code] for code in codes.tolist()]
        columns[name] = np.array(words, dtype=object)[place]  # one long label makes no long array
    excluded: Counter[str] = Counter()
    for of in _places(key):
        excluded.update(flags.get(of, {}))
    rows["is_dhr"] = columns["quantity"] == "dhr"
    said = (*_spellings(content.words["sample"], int(rows["sample"][0])), *notice(rows))
    try:
        return measurement_from_columns(
            sample=key[0],
            wavelength_um=key[1],
            row=rows["line"],
            excluded=dict(sorted(excluded.items())),
            source=Path(content.path).name,
            sha256=content.sha256,
            warnings=(*content.warnings, *said),
            **columns,
        )
    except DataError as error:
        msg = f"{content.path}: sample {show_cell(key[0])}: {error}"
        raise DataError(msg) from None
