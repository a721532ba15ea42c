"""What in valid rows is worth a warning: copies, radians, nanometres, DHR beyond 0 to 1."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pbrdf_bayes.io.tidy_columns import COLUMNS
from pbrdf_bayes.io.tidy_rows import Rows

RADIANS_BELOW = 1.6
"""Largest angle that may be in radians: just above pi / 2."""
NANOMETRES_ABOVE_UM = 100.0
"""Wavelength from which a value is probably in nanometres [um]."""


def notice(rows: Rows, index: NDArray[np.int64]) -> tuple[str, ...]:
    """Warnings about the rows ``index`` of one sample at one wavelength."""
    found = (
        _notice_radians(rows, index),
        _notice_nanometres(float(rows.wavelength_um[index[0]])),
        _notice_dhr_range(rows, index),
        _notice_copies(rows, index),
    )
    return tuple(text for text in found if text)


def _notice_radians(rows: Rows, index: NDArray[np.int64]) -> str:
    """Suspect radians where several angles differ from 0 and none exceeds pi / 2."""
    is_brdf = rows.quantity[index] == 0
    angles = np.concatenate([rows.theta_i_deg[index], rows.theta_r_deg[index][is_brdf]])
    largest = float(np.abs(angles).max())
    if largest >= RADIANS_BELOW or np.unique(angles[angles != 0]).size < 2:
        return ""
    return (
        f"all angles lie within {largest:.3g} in absolute value: are they in radians? "
        "They are read as degrees; multiply them by 180 / pi if they are."
    )


def _notice_nanometres(wavelength_um: float) -> str:
    """Suspect nanometres where the wavelength is far beyond the infrared."""
    if wavelength_um <= NANOMETRES_ABOVE_UM:
        return ""
    return f"wavelength_um is {wavelength_um:.6g}: is it in nanometres? It is read as micrometres."


def _notice_dhr_range(rows: Rows, index: NDArray[np.int64]) -> str:
    """Name hemispherical readings outside 0 to 1."""
    value = rows.value[index]
    outside = index[(rows.quantity[index] == 1) & ((value < 0) | (value > 1))]
    if not outside.size:
        return ""
    lines = ", ".join(map(str, rows.line[outside[:5]].tolist()))
    return (
        f"{outside.size} DHR reading{'s' if outside.size > 1 else ''} outside 0 to 1 accepted as "
        f"noise (line {lines}{', ...' if outside.size > 5 else ''}): check the zero and the "
        "reference of the sphere."
    )


def _notice_copies(rows: Rows, index: NDArray[np.int64]) -> str:
    """Name rows that equal an earlier one in every column that is read."""
    order = np.sort(index[_occurs_again(rows.value[index])])
    if not order.size:
        return ""
    table = pd.DataFrame({name: getattr(rows, name)[order] for name in COLUMNS if name != "flag"})
    copy = table.duplicated().to_numpy()
    if not copy.any():
        return ""
    at = int(np.argmax(copy))
    same = table.iloc[:at].eq(table.iloc[at]) | table.iloc[:at].isna() & table.iloc[at].isna()
    original = int(np.argmax(same.all(axis=1).to_numpy()))
    lines = rows.line[order]
    n = int(copy.sum())
    return (
        f"{n} row{'s' if n > 1 else ''} identical to an earlier one (first: line {lines[at]} "
        f"equals line {lines[original]}): counted as separate readings; remove copies."
    )


def _occurs_again(x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which numbers, shape (n,), occur more than once."""
    ordered = np.sort(x)
    again: NDArray[np.bool_] = np.isin(x, ordered[1:][ordered[1:] == ordered[:-1]])
    return again
