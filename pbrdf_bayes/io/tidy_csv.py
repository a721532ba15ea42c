"""Tidy CSV in: one file, validated as a whole, to measurements of its samples.

The way of a file: `csv_table` cuts it into cells, `tidy_rows` makes numbers and codes of words and
checks them against `tidy_columns`, `_group` finds samples and wavelengths, `_build` makes each a
`Measurement`.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.csv_table import MAX_ROWS, refuse
from pbrdf_bayes.io.formats.content import Decided
from pbrdf_bayes.io.formats.dispatch import Foreign, import_files
from pbrdf_bayes.io.problems import (
    N_LISTED,
    Problem,
    show_cell,
)
from pbrdf_bayes.io.tidy_columns import (
    MOST_SAMPLES,
)
from pbrdf_bayes.io.tidy_notices import notice
from pbrdf_bayes.io.tidy_rows import SAME_WAVELENGTH, CheckedRows, Words, check_data, read_rows
from pbrdf_bayes.io.tidy_writer import replace_file, write_tidy_csv
from pbrdf_bayes.measurement import (
    ANGLE_TOLERANCE_DEG,
    Measurement,
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
Flags = Mapping[Key, Mapping[str, int]]
"""Flagged rows by flag, by sample and wavelength; "" and 0 where they name none."""

_MOST_SCANS = 100_000
_ANY_FLOOR = 1e-300
"""Noise floor [sr^-1] with which any finite BRDF is admitted."""
_MOST_COUNTS = 1_000_000


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


def read_measurement(
    path: str | Path | pd.DataFrame,
    *,
    sample: str | None = None,
    wavelength_um: float | None = None,
    brdf_floor: float = 0.0,
    angle_tolerance_deg: float = ANGLE_TOLERANCE_DEG,
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
    angle_tolerance_deg : float, optional
        Incidences and azimuths that differ by no more are one geometry [deg]; 0 merges none.

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
        content = read_rows(path, brdf_floor, rows_of_no_sample=False)
    else:
        data = path.to_csv(index=False).encode("utf-8", "surrogatepass")
        digest = hashlib.sha256(data).hexdigest()
        content = check_data("DataFrame", data, digest, brdf_floor, (), rows_of_no_sample=False)
    return _measurement(content, sample, wavelength_um, angle_tolerance_deg)


def _measurement(
    content: CheckedRows, sample: str | None, wavelength_um: float | None, tolerance_deg: float
) -> Measurement:
    """The readings of one sample at one wavelength."""
    groups = _group(content)
    key = _choose(_names_in_use(content), list(groups), sample, wavelength_um)
    if isinstance(key, Problem):
        content.problems.add(key)
    if content.problems.n or key is None or isinstance(key, Problem):
        raise DataError(content.message)
    return _build(content, key, groups[key], _count_flags(content, [key]), tolerance_deg)


def import_readings(
    *paths: str | Path, brdf_floor: float = 0.0,
    angle_tolerance_deg: float = ANGLE_TOLERANCE_DEG, **decisions: Any,
) -> Measurement:  # fmt: skip
    """Read files as laboratories have them into one measurement.

    Parameters
    ----------
    *paths : str or Path
        Files of one sample in any of the formats of `pbrdf_bayes.io.formats`: content decides,
        not the extension.
    brdf_floor, angle_tolerance_deg : float, optional
        As in `read_measurement` [sr^-1, deg].
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
        The name of a decision is unknown.
    """
    try:
        decided = Decided(**decisions)
    except TypeError:
        known = list(Decided.__dataclass_fields__)
        wrong = next(name for name in decisions if name not in known)
        msg = f"{wrong!r} is not a decision.{did_you_mean(wrong, known)} Known: {', '.join(known)}"
        raise ConfigError(msg) from None
    content = _read_foreign(paths, import_files(paths, decided), brdf_floor)
    return _measurement(content, None, None, angle_tolerance_deg)


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


def _read_foreign(paths: Sequence[str | Path], foreign: Foreign, brdf_floor: float) -> CheckedRows:
    """Rows of files that were converted."""
    digest = next(iter(foreign.sha256.values())) if len(paths) == 1 else ""
    digest = digest or hashlib.sha256("".join(foreign.sha256.values()).encode()).hexdigest()
    return check_data(
        paths[0], foreign.text.encode(), digest, brdf_floor, foreign.decisions,
        rows_of_no_sample=False,
    )  # fmt: skip


def read_samples(
    path: str | Path, *, brdf_floor: float = 0.0,
    angle_tolerance_deg: float = ANGLE_TOLERANCE_DEG,
) -> TidyFile:  # fmt: skip
    """Read a tidy CSV once; return the measurements of all its samples and all its problems.

    A problem in the rows of one sample leaves the other samples usable. ``brdf_floor`` [sr^-1] and
    ``angle_tolerance_deg`` are as in `read_measurement`.

    Raises
    ------
    DataError
        When the file as a whole is not usable: no such file, not text, header not right, rows
        that cannot be read or belong to no sample.
    ConfigError
        When ``brdf_floor`` is negative or not finite.
    """
    content = read_rows(path, brdf_floor, rows_of_no_sample=False)
    if "" in content.problems.found:
        raise DataError(content.message)
    return _tidy_file(content, angle_tolerance_deg)


def read_usable_samples(
    path: str | Path, *, brdf_floor: float = 0.0,
    angle_tolerance_deg: float = ANGLE_TOLERANCE_DEG,
) -> TidyFile:  # fmt: skip
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
    content = read_rows(path, brdf_floor, rows_of_no_sample=True)
    return _tidy_file(content, angle_tolerance_deg)


def _tidy_file(content: CheckedRows, tolerance_deg: float) -> TidyFile:
    errors = _refused_samples(content)
    groups = {key: rows for key, rows in _group(content).items() if key[0] not in errors}
    measurements = _build_all(content, groups, errors, tolerance_deg)
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


def _spellings(samples: Words, code: int) -> tuple[str, ...]:
    """A warning where the name of a sample stands there with other blanks at its ends too."""
    cells = sorted(samples.spellings[code])
    if len(cells) < 2 or all(cell == cell.strip() for cell in cells):
        return ()
    listed = ", ".join(map(show_cell, cells))
    text = f"column sample: {listed} differ by blanks at the ends and are taken as one sample."
    return (f"{text} Give names that differ otherwise if they are several.",)


def _names_in_use(content: CheckedRows) -> list[str]:
    """Names of the samples with at least one row that is not flagged."""
    codes = np.unique(content.rows["sample"][content.rows["used"]])
    return sorted({content.words["sample"].words[code] for code in codes.tolist()} - {""})


def _group(content: CheckedRows) -> dict[Key, NDArray[np.int64]]:
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


def _count_flags(content: CheckedRows, keys: Iterable[Key]) -> Flags:
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


def _refused_samples(content: CheckedRows) -> dict[str, str]:
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


def _first_lines(content: CheckedRows, errors: Iterable[str]) -> dict[str, int]:
    """Line on which each of these samples begins, whatever is wrong with it."""
    codes, first = np.unique(content.rows["sample"], return_index=True)
    names = [content.words["sample"].words[code] for code in codes.tolist()]
    begins = dict(zip(names, content.rows["line"][first].tolist(), strict=True))
    for name in errors:
        lines = [p.line for p in content.problems.found.get(name, {}).values() if p.line]
        begins[name] = min([*lines, begins.get(name, MAX_ROWS)])
    return {name: begins[name] for name in errors}


def _build_all(
    content: CheckedRows, groups: Mapping[Key, NDArray[np.int64]], errors: dict[str, str],
    tolerance_deg: float,
) -> dict[Key, Measurement]:  # fmt: skip
    """Measurements of all samples; those that cannot be made go to ``errors``."""
    flags = _count_flags(content, groups)
    found: dict[Key, Measurement] = {}
    n_scans = 0
    for key, index in groups.items():
        try:
            found[key] = _build(content, key, index, flags, tolerance_deg)
        except DataError as error:
            errors[key[0]] = str(error)
            content.problems.add(Problem(0, "", str(error), sample=key[0]))
            continue
        n_scans += len(found[key].scans)
        if n_scans > _MOST_SCANS:
            reason = f"more than {_MOST_SCANS} scans in all (allowed: up to that)."
            refuse(content.path, f"{reason} Split the file into several.")
    return {key: m for key, m in found.items() if key[0] not in errors}


def _build(
    content: CheckedRows, key: Key, index: NDArray[np.int64], flags: Flags, tolerance_deg: float
) -> Measurement:
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
            angle_tolerance_deg=tolerance_deg,
            **columns,
        )
    except DataError as error:
        msg = f"{content.path}: sample {show_cell(key[0])}: {error}"
        raise DataError(msg) from None
