"""Tidy CSV in: one file, validated as a whole, to measurements of its samples."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.alike import spelled_with_blanks
from pbrdf_bayes.io.csv_table import (
    MAX_ROWS,
    Table,
    open_table,
    plain_columns,
    read_bytes,
    refuse,
    without_quotes,
)
from pbrdf_bayes.io.problems import Problem, Problems, compose_message, printable, show_cell
from pbrdf_bayes.io.set_aside import set_aside
from pbrdf_bayes.io.tidy_choice import Key, choose_key, explain_sample
from pbrdf_bayes.io.tidy_columns import (
    MOST_SAMPLES,
    QUANTITIES,
    TooManyWordsError,
    check_header,
    missing_column,
)
from pbrdf_bayes.io.tidy_flags import Flags, count_flags, excluded_by_flag
from pbrdf_bayes.io.tidy_notices import notice
from pbrdf_bayes.io.tidy_rows import (
    Rows,
    join_rows,
    new_codebooks,
    rows_from_cells,
    rows_from_plain,
)
from pbrdf_bayes.io.tidy_rules import NumberRule, check_rows, number_rules
from pbrdf_bayes.io.tidy_writer import write_tidy_csv
from pbrdf_bayes.measurement import POLARIZATIONS, Measurement, measurement_from_columns

_MOST_SCANS = 100_000

__all__ = [
    "TidyFile", "read_measurement", "read_samples", "read_usable_samples", "write_tidy_csv",
]  # fmt: skip


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
    """Converted rows of a file and what was found in it; `Rows` has indices into the words."""

    path: str
    sha256: str
    rows: Rows
    bad: NDArray[np.bool_]
    words: Mapping[str, Sequence[str]]
    problems: Problems
    warnings: tuple[str, ...]
    spelled: Mapping[str, tuple[str, ...]]


def read_measurement(
    path: str | Path,
    *,
    sample: str | None = None,
    wavelength_um: float | None = None,
    brdf_floor: float = 0.0,
) -> Measurement:
    r"""Read and validate a tidy CSV; return the readings of one sample at one wavelength.

    The whole file has to be valid, so that a shifted column is noticed wherever it shows first.
    Rows with a ``flag`` other than ``ok`` are counted in ``Measurement.excluded`` and not checked.

    Parameters
    ----------
    path : str or Path
        File in UTF-8 with a header, comma-separated.
    sample : str, optional
        Name of the sample; needed where the file has several.
    wavelength_um : float, optional
        Wavelength [um]; needed where the sample has several.
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
    content = _read(path, read_bytes(path), brdf_floor)
    groups = _group(content)
    key = choose_key(_names_in_use(content), list(groups), sample, wavelength_um)
    if isinstance(key, Problem):
        content.problems.add(key)
    if content.problems.n or key is None or isinstance(key, Problem):
        raise DataError(_message(content))
    return _build(
        content, key, groups[key], count_flags(content.path, content.rows, content.words, [key])
    )


def read_samples(path: str | Path, *, brdf_floor: float = 0.0) -> TidyFile:
    """Read a tidy CSV once; return the measurements of all its samples and all its problems.

    A problem in the rows of one sample leaves the other samples usable. ``brdf_floor`` is as in
    `read_measurement` [sr^-1].

    Raises
    ------
    DataError
        When the file as a whole is not usable: no such file, not text, header not right, rows
        that belong to no sample.
    ConfigError
        When ``brdf_floor`` is negative or not finite.
    """
    content = _read(path, read_bytes(path), brdf_floor)
    if "" in content.problems.found:
        raise DataError(_message(content))
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
    try:
        return read_samples(path, brdf_floor=brdf_floor)
    except DataError as error:
        data = read_bytes(path)
        aside = set_aside(data)
        try:
            content = _read(path, aside.data, brdf_floor) if aside.problems.n else None
        except DataError:
            raise error from None
        if content is None or "" in content.problems.found:
            raise
    content.problems.extend(aside.problems)
    said = (f"not read, and may be of this sample: {p}" for p in aside.problems.listed(""))
    sha256 = hashlib.sha256(data).hexdigest()
    return _tidy_file(replace(content, sha256=sha256, warnings=(*content.warnings, *said)))


def _tidy_file(content: _Content) -> TidyFile:
    errors = _refused_samples(content)
    groups = {key: rows for key, rows in _group(content).items() if key[0] not in errors}
    measurements = _build_all(content, groups, errors)
    return TidyFile(
        source=Path(content.path).name,
        sha256=content.sha256,
        n_rows=len(content.rows),
        measurements=measurements,
        errors=errors,
        first_lines=_first_lines(content, errors),
        problems=content.problems.listed(),
        n_problems=content.problems.n,
        warnings=content.warnings,
        message=_message(content) if content.problems.n else "",
    )


def _read(path: str | Path, data: bytes, brdf_floor: float) -> _Content:
    """Convert and check every row; refuse only what leaves no rows to speak of."""
    if not (isfinite(brdf_floor) and brdf_floor >= 0):
        msg = f"brdf_floor = {brdf_floor!r} is not allowed: give a BRDF [sr^-1] of 0 or more"
        raise ConfigError(msg)
    problems = Problems()
    table = open_table(path, data, problems)
    warnings = check_header(table.header, problems)
    if problems.n:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    try:
        rows, bad, words = _convert(data, table, number_rules(brdf_floor=brdf_floor), problems)
    except TooManyWordsError as error:
        refuse(path, f"{error}. Split the file into several, for example by lots.")
    if not len(rows) and not problems.n:
        problems.add(Problem(0, "", "the file has a header but no rows. Add the readings."))
    if not len(rows):
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    if "theta_r_deg" not in table.header and np.any(rows.used & (rows.quantity == 0)):
        problems.add(missing_column("theta_r_deg", table.header))
    digest = hashlib.sha256(data).hexdigest()
    spelled = spelled_with_blanks(path, data)
    return _Content(printable(str(path)), digest, rows, bad, words, problems, warnings, spelled)


def _convert(
    data: bytes, table: Table, rules: Sequence[NumberRule], problems: Problems
) -> tuple[Rows, NDArray[np.bool_], Mapping[str, Sequence[str]]]:
    """Convert all rows at once, or cell by cell where that is not possible; find the bad ones."""
    codebooks = new_codebooks()
    words = {name: book.words for name, book in codebooks.items()}
    bare = without_quotes(data)
    plain = rows_from_plain(bare, table.header, codebooks)
    if plain is not None and not np.any(plain.may_be_blank):
        bad_rows = check_rows(
            plain, plain_columns(bare, table.header), words, rules=rules, problems=problems,
            nan_is_empty=True,
        )  # fmt: skip
        return plain, bad_rows, words
    parts, bad = [], []
    for chunk in table.chunks:
        cells = dict(zip(table.header, chunk.columns, strict=True))
        parts.append(rows_from_cells(chunk.line, cells, codebooks))
        bad.append(check_rows(parts[-1], cells, words, rules=rules, problems=problems))
    return join_rows(parts), np.concatenate([np.zeros(0, dtype=bool), *bad]), words


def _message(content: _Content) -> str:
    """All problems of a file as one message."""
    return compose_message(content.path, content.problems.listed(), content.problems.n)


def _names_in_use(content: _Content) -> list[str]:
    """Names of the samples with at least one row that is not flagged."""
    codes = np.unique(content.rows.sample[content.rows.used])
    return sorted({content.words["sample"][code] for code in codes.tolist()} - {""})


def _group(content: _Content) -> dict[Key, NDArray[np.int64]]:
    """Rows without a problem of each sample and wavelength, by name and wavelength."""
    rows = content.rows
    index = np.flatnonzero(rows.used & ~content.bad)
    index = index[np.lexsort((rows.wavelength_um[index], rows.sample[index]))]
    sample, wavelength = rows.sample[index], rows.wavelength_um[index]
    new = (sample[1:] != sample[:-1]) | (wavelength[1:] != wavelength[:-1])
    if (n := np.count_nonzero(new) + 1) > MOST_SAMPLES:
        reason = f"the file has {n} samples, each wavelength counted"
        refuse(content.path, f"{reason} (allowed: up to {MOST_SAMPLES}). Split it into several.")
    parts = np.split(index, np.flatnonzero(new) + 1) if index.size else []
    names = content.words["sample"]
    keyed = {(names[rows.sample[p[0]]], float(rows.wavelength_um[p[0]])): p for p in parts}
    return {key: keyed[key] for key in sorted(keyed)}


def _refused_samples(content: _Content) -> dict[str, str]:
    """Message for each sample with a problem, or without a row that is not flagged."""
    names = content.words["sample"]
    unused = set(names) - set(_names_in_use(content)) - {""}
    errors = {
        name: f"{content.path}: sample {show_cell(name)}: {explain_sample(None, [])}"
        for name in unused
    }
    lines, codes = content.rows.line[content.bad], content.rows.sample[content.bad]
    unique = np.unique(codes, return_index=True, return_counts=True)
    found = {
        names[code]: [(int(lines[first]), int(n))] for code, first, n in zip(*unique, strict=True)
    }
    for name, own in content.problems.found.items():
        aside = [(p.line, p.n) for p in own.values() if not p.column]  # these are not among rows
        found[name] = [*found.get(name, []), *aside]
    for name, rows in found.items():
        n, first = sum(n for _, n in rows), min(line for line, _ in rows)
        what = f"sample {show_cell(name)} was" if name else "what belongs to no sample was"
        head = f"{content.path}: {what} not read: {n} row"
        head += f"{'s' if n > 1 else ''} with problems from line {first} on."
        own_lines = (f"  {problem}" for problem in content.problems.listed(name))
        errors[name] = "\n".join([head, *own_lines])
    return {name: errors[name] for name in sorted(errors)}


def _first_lines(content: _Content, errors: Iterable[str]) -> dict[str, int]:
    """Line on which each of these samples begins, whatever is wrong with it."""
    codes, first = np.unique(content.rows.sample, return_index=True)
    names = [content.words["sample"][code] for code in codes.tolist()]
    begins = dict(zip(names, content.rows.line[first].tolist(), strict=True))
    for name in errors:
        lines = [p.line for p in content.problems.found.get(name, {}).values() if p.line]
        begins[name] = min([*lines, begins.get(name, MAX_ROWS)])
    return {name: begins[name] for name in errors}


def _build_all(
    content: _Content, groups: Mapping[Key, NDArray[np.int64]], errors: dict[str, str]
) -> dict[Key, Measurement]:
    """Measurements of all samples; those that cannot be made go to ``errors``."""
    flags = count_flags(content.path, content.rows, content.words, groups)
    found: dict[Key, Measurement] = {}
    n_scans = 0
    for key, rows in groups.items():
        try:
            found[key] = _build(content, key, rows, flags)
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
    rows = content.rows
    columns = {
        name: getattr(rows, name)[index]
        for name in ("theta_i_deg", "theta_r_deg", "value", "sigma", "n_repeats")
    }
    columns["phi_r_deg"] = np.nan_to_num(rows.phi_r_deg[index], nan=0.0)
    columns["quantity"] = np.array(QUANTITIES)[rows.quantity[index]]
    columns["polarization"] = np.array(POLARIZATIONS)[rows.polarization[index]]
    labels, place = np.unique(rows.scan[index], return_inverse=True)
    scans = [content.words["scan"][label] for label in labels.tolist()]
    columns["scan"] = np.array(scans, dtype=object)[place]  # one long label makes no long array
    try:
        return measurement_from_columns(
            sample=key[0],
            wavelength_um=key[1],
            row=rows.line[index],
            excluded=excluded_by_flag(flags, key),
            source=Path(content.path).name,
            sha256=content.sha256,
            warnings=(*content.warnings, *content.spelled.get(key[0], ()), *notice(rows, index)),
            **columns,
        )
    except DataError as error:
        msg = f"{content.path}: sample {show_cell(key[0])}: {error}"
        raise DataError(msg) from None
