"""Tidy CSV in: one file, validated as a whole, to measurements of its samples."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isclose, isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.csv_table import open_table, read_bytes
from pbrdf_bayes.io.problems import N_LISTED, Problem, Problems, compose_message, show_cell
from pbrdf_bayes.io.tidy_columns import (
    QUANTITIES,
    WORD_COLUMNS,
    Codebook,
    Rows,
    check_header,
    join_rows,
    missing_column,
)
from pbrdf_bayes.io.tidy_notices import notice
from pbrdf_bayes.io.tidy_rules import check_chunk, number_rules
from pbrdf_bayes.measurement import POLARIZATIONS, Measurement, measurement_from_columns

Key = tuple[str, float]


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
        Message for each sample that is refused or has no usable row, by name.
    problems : tuple of Problem
        First problems of the whole file, in its order.
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
    words: Mapping[str, Sequence[str]]
    problems: Problems
    warnings: tuple[str, ...]


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
        remedy of the first 20 problems, and the number of all.
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
    content = _read(path, brdf_floor)
    groups = _group(content)
    key = _choose(content, list(groups), sample, wavelength_um)
    if key is None or content.problems.n:
        raise DataError(_message(content))
    return _build(content, key, groups[key])


def read_samples(path: str | Path, *, brdf_floor: float = 0.0) -> TidyFile:
    """Read a tidy CSV once; return the measurements of all its samples and all its problems.

    A problem in the rows of one sample leaves the other samples usable.

    Parameters
    ----------
    path : str or Path
    brdf_floor : float, optional
        As in `read_measurement` [sr^-1].

    Returns
    -------
    TidyFile

    Raises
    ------
    DataError
        When the file as a whole is not usable: no such file, not text, header not right, rows
        that belong to no sample.
    ConfigError
        When ``brdf_floor`` is negative or not finite.
    """
    content = _read(path, brdf_floor)
    if any(not problem.sample for problem in content.problems.found):
        raise DataError(_message(content))
    errors = _refused_samples(content)
    groups = {key: rows for key, rows in _group(content).items() if key[0] not in errors}
    return TidyFile(
        source=Path(path).name,
        sha256=content.sha256,
        n_rows=len(content.rows),
        measurements={key: _build(content, key, rows) for key, rows in groups.items()},
        errors=errors,
        problems=content.problems.listed(),
        n_problems=content.problems.n,
        warnings=content.warnings,
        message=_message(content) if content.problems.n else "",
    )


def _read(path: str | Path, brdf_floor: float) -> _Content:
    """Convert and check every row; refuse only what leaves no rows to speak of."""
    if not (isfinite(brdf_floor) and brdf_floor >= 0):
        msg = f"brdf_floor = {brdf_floor!r} is not allowed: give a BRDF [sr^-1] of 0 or more"
        raise ConfigError(msg)
    data = read_bytes(path)
    problems = Problems()
    table = open_table(path, data, problems)
    warnings = check_header(table.header, problems)
    if problems.n:
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    codebooks = {name: Codebook() for name in WORD_COLUMNS}
    rules = number_rules(brdf_floor=brdf_floor)
    parts = [
        check_chunk(chunk, table.header, rules=rules, codebooks=codebooks, problems=problems)
        for chunk in table.chunks
    ]
    if not parts:
        problems.add(Problem(0, "", "the file has a header but no rows."), n=not problems.n)
        raise DataError(compose_message(str(path), problems.listed(), problems.n))
    rows = join_rows(parts)
    if "theta_r_deg" not in table.header and np.any(rows.used & (rows.quantity == 0)):
        problems.add(missing_column("theta_r_deg", table.header))
    words = {name: codebooks[name].words for name in WORD_COLUMNS}
    digest = hashlib.sha256(data).hexdigest()
    return _Content(str(path), digest, rows, words, problems, warnings)


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
    index = np.flatnonzero(rows.used & ~rows.bad)
    index = index[np.lexsort((rows.wavelength_um[index], rows.sample[index]))]
    sample, wavelength = rows.sample[index], rows.wavelength_um[index]
    new = (sample[1:] != sample[:-1]) | (wavelength[1:] != wavelength[:-1])
    parts = np.split(index, np.flatnonzero(new) + 1) if index.size else []
    names = content.words["sample"]
    keyed = {(names[rows.sample[p[0]]], float(rows.wavelength_um[p[0]])): p for p in parts}
    return {key: keyed[key] for key in sorted(keyed)}


def _choose(
    content: _Content, keys: Iterable[Key], sample: str | None, wavelength_um: float | None
) -> Key | None:
    """Find the sample and wavelength asked for, or add to the problems why there is none."""
    names = _names_in_use(content)
    if sample is None and len(names) == 1:
        sample = names[0]
    if sample is None or sample not in names:
        content.problems.add(Problem(0, "sample", _explain_sample(sample, names)))
        return None
    present = [wavelength for name, wavelength in keys if name == sample]
    found = [w for w in present if wavelength_um is None or isclose(w, wavelength_um, rel_tol=1e-6)]
    if len(found) == 1:
        return sample, found[0]
    if present:
        text = _explain_wavelength(sample, wavelength_um, present)
        content.problems.add(Problem(0, "wavelength_um", text))
    return None


def _explain_sample(sample: str | None, names: Sequence[str]) -> str:
    """Say why no sample is chosen, and which there are."""
    if not names:
        return "every row is flagged, no reading is left. Clear the flag of rows to be used."
    listed = _list_some([show_cell(name) for name in names])
    if sample is None:
        return f"the file has {len(names)} samples. Choose one (sample=, or --sample): {listed}."
    hint = did_you_mean(sample, names)
    return f"{show_cell(sample)} has no rows to use.{hint} The file has: {listed}."


def _explain_wavelength(sample: str, wanted: float | None, present: Sequence[float]) -> str:
    """Say why no wavelength is chosen, and which there are."""
    listed = f"sample {show_cell(sample)} has {_list_some([f'{w:.10g}' for w in present])} um."
    if wanted is None:
        return f"{listed} Choose one (wavelength_um=, or --wavelength)."
    return f"{wanted:.10g} um was not measured: {listed} Choose one of them."


def _list_some(words: Sequence[str]) -> str:
    """First words of a list, and how many there are where they are too many."""
    more = f", ... ({len(words)} in all)" if len(words) > N_LISTED else ""
    return ", ".join(words[:N_LISTED]) + more


def _refused_samples(content: _Content) -> dict[str, str]:
    """Message for each sample with a problem, or without a row that is not flagged."""
    rows, names = content.rows, content.words["sample"]
    bad_rows = Counter(rows.sample[rows.bad].tolist())
    errors = {}
    for code, n in sorted(bad_rows.items(), key=lambda item: names[item[0]]):
        listed = [p for p in content.problems.listed() if p.sample == names[code]]
        first = int(rows.line[np.argmax(rows.bad & (rows.sample == code))])
        head = f"{content.path}: sample {show_cell(names[code])} has {n} rows with problems,"
        head += f" from line {first}; it was not read."
        errors[names[code]] = "\n".join([head, *(f"  {problem}" for problem in listed)])
    in_use = set(_names_in_use(content))
    for name in sorted(set(names) - in_use - {""}):
        errors[name] = f"{content.path}: sample {show_cell(name)}: {_explain_sample(None, [])}"
    return errors


def _build(content: _Content, key: Key, index: NDArray[np.int64]) -> Measurement:
    """Measurement from the rows of one sample at one wavelength."""
    rows = content.rows
    columns = {
        name: getattr(rows, name)[index]
        for name in ("theta_i_deg", "theta_r_deg", "value", "sigma", "n_repeats")
    }
    columns["phi_r_deg"] = np.nan_to_num(rows.phi_r_deg[index], nan=0.0)
    columns["quantity"] = np.array(QUANTITIES)[rows.quantity[index]]
    columns["polarization"] = np.array(POLARIZATIONS)[rows.polarization[index]]
    columns["scan"] = np.array(content.words["scan"])[rows.scan[index]]
    return measurement_from_columns(
        sample=key[0],
        wavelength_um=key[1],
        row=rows.line[index],
        excluded=_count_flags(content, key),
        source=Path(content.path).name,
        sha256=content.sha256,
        warnings=(*content.warnings, *notice(rows, index)),
        **columns,
    )


def _count_flags(content: _Content, key: Key) -> dict[str, int]:
    """Count flagged rows by flag; those that name no sample or wavelength count everywhere."""
    rows = content.rows
    index = np.flatnonzero(~rows.used)
    mine = [code for code, name in enumerate(content.words["sample"]) if name in (key[0], "")]
    wavelength = rows.wavelength_um[index]
    here = np.isin(rows.sample[index], mine) & ((wavelength == key[1]) | ~(wavelength > 0))
    counts = Counter(rows.flag[index[here]].tolist())
    return {content.words["flag"][code]: n for code, n in sorted(counts.items())}
