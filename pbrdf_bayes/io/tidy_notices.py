"""What in valid rows of a sample is worth a warning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.io.tidy_columns import COLUMNS

RADIANS_BELOW = 1.6
"""Largest angle that may be in radians: just above pi / 2."""
NANOMETRES_ABOVE_UM = 100.0
"""Wavelength from which a value is probably in nanometres [um]."""


def notice(rows: Mapping[str, NDArray[Any]]) -> tuple[str, ...]:
    """Warnings about the rows of one sample at one wavelength, columns of the tidy CSV by name."""
    found = (
        _notice_wavelengths(rows), _notice_radians(rows), _notice_nanometres(rows),
        _notice_dhr_range(rows), _notice_sigma(rows), _notice_copies(rows),
    )  # fmt: skip
    return tuple(text for text in found if text)


def _notice_wavelengths(rows: Mapping[str, NDArray[Any]]) -> str:
    """Name wavelengths that were taken for the one of the other rows."""
    kept, read = rows["wavelength_um"], rows["wavelength_as_read"]
    if np.array_equal(kept, read):
        return ""
    listed = ", ".join(f"{w:.10g}" for w in np.unique(read[read != kept])[:3].tolist())
    return f"wavelength_um {listed} is read as {kept[0]:.10g}: rounding, not another wavelength."


def _notice_radians(rows: Mapping[str, NDArray[Any]]) -> str:
    """Suspect radians where several angles differ from 0 and none exceeds pi / 2."""
    angles = np.concatenate([rows["theta_i_deg"], rows["theta_r_deg"][~rows["is_dhr"]]])
    largest = float(np.abs(angles).max())
    if largest >= RADIANS_BELOW or np.unique(angles[angles != 0]).size < 2:
        return ""
    return (
        f"all angles lie within {largest:.3g} in absolute value: are they in radians? "
        "They are read as degrees; multiply them by 180 / pi if they are."
    )


def _notice_nanometres(rows: Mapping[str, NDArray[Any]]) -> str:
    """Suspect nanometres where the wavelength is far beyond the infrared."""
    wavelength_um = float(rows["wavelength_um"][0])
    if wavelength_um <= NANOMETRES_ABOVE_UM:
        return ""
    return f"wavelength_um is {wavelength_um:.6g}: is it in nanometres? It is read as micrometres."


def _notice_dhr_range(rows: Mapping[str, NDArray[Any]]) -> str:
    """Name hemispherical readings outside 0 to 1."""
    outside = rows["is_dhr"] & ((rows["value"] < 0) | (rows["value"] > 1))
    if not (n := np.count_nonzero(outside)):
        return ""
    lines = ", ".join(map(str, rows["line"][outside][:5].tolist()))
    return (
        f"{n} DHR reading{'s' if n > 1 else ''} outside 0 to 1 accepted as noise (line {lines}"
        f"{', ...' if n > 5 else ''}): check the zero and the reference of the sphere."
    )


def _notice_sigma(rows: Mapping[str, NDArray[Any]]) -> str:
    """Question uncertainties above the value in most of the readings that state one."""
    sigma, value = rows["sigma"], np.abs(rows["value"])
    n_stated, above = np.count_nonzero(sigma > 0), sigma > value
    n = np.count_nonzero(above)
    if 2 * n <= n_stated or not n:
        return ""
    line = rows["line"][above][0]
    return (
        f"sigma exceeds value in {n} of {n_stated} readings (first: line {line}): "
        "is it in per cent? It is read in the unit of value; multiply it by value / 100 if it is."
    )


def _notice_copies(rows: Mapping[str, NDArray[Any]]) -> str:
    """Name rows that equal an earlier one in every column that is read."""
    table = np.stack([rows[name] for name in COLUMNS if name != "flag"], axis=1, dtype=np.float64)
    table[np.isnan(table)] = np.inf  # no cell that is read holds it
    by_value = np.argsort(table[:, COLUMNS.index("value")], kind="stable")
    again = np.zeros(len(table), dtype=bool)
    value = table[by_value, COLUMNS.index("value")]
    again[by_value[1:][value[1:] == value[:-1]]] = True
    again[by_value[:-1][value[1:] == value[:-1]]] = True
    index = np.flatnonzero(again)
    index = index[np.argsort(rows["line"][index])]
    if not index.size:
        return ""
    _, first, place = np.unique(table[index], axis=0, return_index=True, return_inverse=True)
    original = first[place.ravel()]
    copies = np.flatnonzero(original != np.arange(index.size))
    if not copies.size:
        return ""
    lines, n = rows["line"][index], copies.size
    return (
        f"{n} row{'s' if n > 1 else ''} identical to an earlier one (first: line "
        f"{lines[copies[0]]} equals line {lines[original[copies[0]]]}): counted as separate "
        "readings; remove copies."
    )
