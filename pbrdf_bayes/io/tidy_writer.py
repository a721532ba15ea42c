"""Tidy CSV out: columns in the order of the format, numbers that read back bit by bit."""

from __future__ import annotations

import contextlib
import csv
import io
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.formulas import guard
from pbrdf_bayes.io.tidy_columns import COLUMNS, NUMBER_COLUMNS, REQUIRED
from pbrdf_bayes.measurement import Measurement, name_direction


def write_tidy_csv(readings: Measurement | Mapping[str, ArrayLike], path: str | Path) -> None:
    r"""Write readings in the tidy format, replacing the file at once or not at all.

    Text that a spreadsheet would take for a formula gets an apostrophe before it, which the reader
    takes away again.

    Parameters
    ----------
    readings : Measurement or mapping of str to array_like, shape (n_rows,) or scalar
        Columns of the tidy CSV by name, scalars repeated; NaN becomes an empty cell. A
        `Measurement` keeps the standard uncertainty of repeated readings but not their number, so
        that ``n_repeats`` is not written for it.
    path : str or Path
        File to write.

    Raises
    ------
    DataError
        When a required column is missing, a column is not part of the format, lengths differ, or
        the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> file = pathlib.Path(folder.name) / "one.csv"
    >>> write_tidy_csv({"sample": "green", "wavelength_um": 3.39, "quantity": "brdf",
    ...     "polarization": "s", "theta_i_deg": 20, "theta_r_deg": [-5, 0], "value": 0.1}, file)
    >>> file.read_text().splitlines()[1:]
    ['green,3.39,brdf,s,20.0,-5.0,0.1', 'green,3.39,brdf,s,20.0,0.0,0.1']
    >>> folder.cleanup()
    """
    given = _columns_of(readings) if isinstance(readings, Measurement) else readings
    replace_file(Path(path), tidy_text(given))


def tidy_text(columns: Mapping[str, ArrayLike]) -> str:
    """The text of a tidy CSV with these columns, see `write_tidy_csv`."""
    cells = _to_cells(columns)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(cells)
    writer.writerows(zip(*cells.values(), strict=True))
    return text.getvalue()


def _columns_of(measurement: Measurement) -> dict[str, ArrayLike]:
    """Columns of a measurement, BRDF rows first; optional ones only where they say something."""
    brdf, dhr = measurement.brdf, measurement.dhr
    labels = _labels(measurement)
    columns: dict[str, ArrayLike] = {
        "sample": measurement.sample,
        "wavelength_um": measurement.wavelength_um,
        "quantity": np.repeat(["brdf", "dhr"], [len(brdf), len(dhr)]),
        "polarization": np.concatenate([brdf.polarization, dhr.polarization]),
        "theta_i_deg": np.concatenate([brdf.theta_i_deg, dhr.theta_i_deg]),
        "theta_r_deg": np.concatenate([brdf.theta_r_deg, np.full(len(dhr), np.nan)]),
        "value": np.concatenate([brdf.value, dhr.value]),
        "sigma": np.concatenate([brdf.u_value, dhr.u_value]),
        "phi_r_deg": np.concatenate([brdf.phi_r_deg, np.zeros(len(dhr))]),
        "scan": labels,
    }
    if np.all(np.isnan(columns["sigma"])):
        del columns["sigma"]
    if not np.any(columns["phi_r_deg"]):
        del columns["phi_r_deg"]
    if not any(labels):
        del columns["scan"]
    return columns


def _labels(measurement: Measurement) -> list[str]:
    """Scan label of each row: the name of its scan without the directions."""
    labels = [""] * measurement.n_obs
    for scan in measurement.scans:
        name = name_direction(scan.polarization, scan.theta_i_deg, scan.phi_r_deg)
        labels[scan.rows] = [scan.label.removeprefix(name).strip()] * len(scan)
    return labels


def _to_cells(columns: Mapping[str, ArrayLike]) -> dict[str, list[str]]:
    """Cells of each column in the order of the format."""
    for name in columns:
        if name not in COLUMNS:
            msg = f"column {name!r} is not part of the format.{did_you_mean(name, COLUMNS)}"
            raise DataError(msg)
    missing = [name for name in REQUIRED if name not in columns]
    if missing:
        msg = f"required columns are missing: {', '.join(missing)}"
        raise DataError(msg)
    names = [name for name in COLUMNS if name in columns]
    try:
        arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(columns[name])) for name in names))
    except ValueError as error:
        lengths = ", ".join(f"{name} {np.size(columns[name])}" for name in names)
        msg = f"columns differ in length: {lengths}"
        raise DataError(msg) from error
    return {name: _cells(name, array) for name, array in zip(names, arrays, strict=True)}


def _cells(name: str, values: NDArray[Any]) -> list[str]:
    """Shortest text that reads back as the same number, or guarded text."""
    if name not in NUMBER_COLUMNS:
        words = [str(value) for value in values.tolist()]
        guarded = {word: guard(word) for word in set(words)}
        return [guarded[word] for word in words]
    numbers = values.astype(np.float64).tolist()
    return ["" if number != number else repr(number) for number in numbers]


def replace_file(path: Path, text: str) -> None:
    """Write a file beside ``path`` and move it there."""
    if not path.name or path.is_dir():
        msg = f"{path}: is a folder. Give the name of a CSV file in it"
        raise DataError(msg)
    part = path.with_name(f".{secrets.token_hex(4)}.part")
    try:
        part.write_text(text, encoding="utf-8", newline="")
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        msg = f"{path}: the file cannot be written ({error.strerror})"
        raise DataError(msg) from error
