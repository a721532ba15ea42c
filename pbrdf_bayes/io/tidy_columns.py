"""Columns of the tidy CSV, each declared once: name, what it allows, what to do otherwise."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf, isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean, plain_spaces
from pbrdf_bayes.io.problems import Problem, Problems, show_cell
from pbrdf_bayes.measurement import MAX_LABEL, MAX_NAME
from pbrdf_bayes.quantities import MEANT, POLARIZATIONS, QUANTITIES, READ

OVERLOAD = 1e30
"""Numbers from here on are words of an instrument for 'overload', such as 9.9E37."""
MINUS = "\N{MINUS SIGN}"
"""What word processors write for a hyphen-minus."""


@dataclass(frozen=True)
class Range:
    """What a number may be.

    Attributes
    ----------
    low, high : float
        Both allowed, ``low`` not where ``above_low``.
    allowed, remedy : str
        For messages.
    not_stated : tuple of str
        Cells that stand for no number.
    above_low, whole : bool
    """

    low: float
    high: float
    allowed: str
    remedy: str
    not_stated: tuple[str, ...] = ()
    above_low: bool = False
    whole: bool = False

    def accepts(self, x: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which values, shape (n_rows,), are finite and in the range."""
        inside = np.isfinite(x) & (x <= self.high)
        inside &= (x > self.low) if self.above_low else (x >= self.low)
        return inside & (x == np.floor(x)) if self.whole else inside


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    name : str
    required : bool
    ranges : mapping of str to Range
        Of a number column: by quantity, "" for every one.
    words : tuple of str
        The allowed ones, where they are a closed list.
    longest : int
        Of free text; 0 where it is not looked at.
    most : int
        Different words that a file may have.
    """

    name: str
    required: bool = False
    ranges: Mapping[str, Range] = field(default_factory=dict)
    words: tuple[str, ...] = ()
    longest: int = 0
    most: int = 100_000


MOST_SAMPLES = 10_000
"""Samples of one file, each wavelength counted."""
_DHR = QUANTITIES["dhr"].readable
_EMPTY_IN_DHR = Range(-inf, inf, "an empty cell in a DHR row", "Leave the cell empty.", ("", "nan"))
_FLOOR = (
    "Give the instrument's noise floor (brdf_floor in the file of --config, or check "
    "--brdf-floor) so that the reading is treated as censored, or flag the row."
)
_COLUMNS = (
    Column("sample", required=True, longest=MAX_NAME, most=MOST_SAMPLES),
    Column("wavelength_um", required=True, ranges={"": Range(
        0.0, inf, "> 0 um", "Give the wavelength in micrometres.", above_low=True)}),
    Column("quantity", required=True, words=READ),
    Column("polarization", required=True, words=POLARIZATIONS),
    Column("theta_i_deg", required=True, ranges={"": Range(
        0.0, 89.95, "0 to 89.95 deg",
        "Give the angle of incidence from the normal; theta_r_deg carries the sign.")}),
    Column("theta_r_deg", required=True, ranges={
        "brdf": Range(-90.0, 90.0, "-90 to 90 deg",
                      "Give the angle from the normal, + on the forward (specular) side."),
        "dhr": _EMPTY_IN_DHR}),
    Column("value", required=True, ranges={
        "brdf": Range(0.0, inf, "> 0 sr^-1", _FLOOR, above_low=True),
        "dhr": Range(*_DHR, "{:g} to {:g}".format(*_DHR),
                     "A DHR is a fraction: divide by 100 if it is in per cent, "
                     "else flag the row.")}),
    Column("sigma", ranges={"": Range(
        0.0, inf, "> 0, in the unit of value",
        "Give the standard uncertainty, or leave the cell empty.", ("",), above_low=True)}),
    Column("n_repeats", ranges={"": Range(
        1.0, inf, "a whole number >= 1",
        "Give the number of readings behind value, or leave the cell empty.", ("",), whole=True)}),
    Column("phi_r_deg", ranges={
        "brdf": Range(
            -360.0, 360.0, "-360 to 360 deg",
            "Give the azimuth from the plane of incidence, or leave the cell empty for 0.", ("",)),
        "dhr": _EMPTY_IN_DHR}),
    Column("scan", longest=MAX_LABEL),
    Column("flag", most=10_000),
)  # fmt: skip
BRDF_WITH_FLOOR = Range(-inf, inf, "a finite number [sr^-1]", "Give the reading, or flag the row.")
"""Of the value of a BRDF where the instrument has a noise floor."""
COLUMN = {column.name: column for column in _COLUMNS}
COLUMNS = tuple(COLUMN)
REQUIRED = tuple(column.name for column in _COLUMNS if column.required)
NUMBER_COLUMNS = tuple(column.name for column in _COLUMNS if column.ranges)
WORD_COLUMNS = tuple(column.name for column in _COLUMNS if not column.ranges)


def to_floats(cells: Sequence[str]) -> NDArray[np.float64]:
    """Numbers in plain notation, correctly rounded; NaN where a cell holds none.

    Examples
    --------
    >>> to_floats(["1.5", " 2e-3 ", "", "1_000", "0,5", "\N{MINUS SIGN}3"]).tolist()
    [1.5, 0.002, nan, nan, nan, -3.0]
    """
    joined = "".join(cells)
    if joined.isascii() and "_" not in joined:
        try:
            return np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            return np.fromiter(map(to_float, cells), np.float64, len(cells))
    return np.fromiter(map(to_float, cells), np.float64, len(cells))


def to_float(cell: str) -> float:
    """Convert a cell, to NaN where it holds no number."""
    if not cell.isascii():
        cell = cell.strip().replace(MINUS, "-")
    try:
        return float(cell) if cell.isascii() and "_" not in cell else nan
    except ValueError:
        return nan


@lru_cache(maxsize=2**16)
def explain_number(cell: str, allowed: Range, column: str) -> tuple[str, str]:
    """The cell for a message, and what is the same for all cells that are wrong in this way."""
    text, remedy, value = cell.strip(), allowed.remedy, to_float(cell)
    if not isfinite(value) and column == "value":
        remedy = "Give the reading, or flag the row."
    if not text:
        return "", f"empty (allowed: {allowed.allowed}). {remedy}"
    if isnan(value) and text.lower().strip("+-") != "nan":
        if "," in text:
            remedy = "Write a decimal point, not a decimal comma."
        elif not text.isascii():
            remedy = f"It has characters that are no digits: {text[:20]!a}. {remedy}"
        return show_cell(text), f" is not a number (allowed: {allowed.allowed}). {remedy}"
    shown = show_cell(text)[1:-1]
    if isfinite(value) and abs(value) >= OVERLOAD:
        said = (
            f" is an overload word of the instrument, not a reading (allowed: below {OVERLOAD:g})"
        )
        return shown, f"{said}. Measure again in a wider range, or flag the row."
    if column == "sigma" and value == 0.0:
        remedy = f"No reading is without uncertainty. {remedy}"
    return shown, f" is not allowed (allowed: {allowed.allowed}). {remedy}"


def explain_word(cell: str, column: Column) -> tuple[str, str]:
    """As `explain_number`, of text."""
    word = cell.strip().lower()
    if column.words:
        known = ", ".join(column.words)
        meant = MEANT.get(word, word)
        hint = did_you_mean(meant, column.words) or f" Write one of {known}."
        shown, seen = (show_cell(cell), " is not allowed") if word else ("", "empty")
        return shown, f"{seen} (allowed: {known}; in lower case).{hint}"
    if not word:
        return "", "empty. Give the name of the paint sample."
    remedy = "Shorten or correct it."
    if plain_spaces(cell).replace("\u00a0", " ").isprintable() and len(cell) <= column.longest:
        remedy = "It has a no-break space or one of another width: type a plain one."
    allowed = f"up to {column.longest} printable characters"
    return show_cell(cell), f" is not allowed (allowed: {allowed}). {remedy}"


def check_header(header: Sequence[str], problems: Problems) -> tuple[str, ...]:
    """Find missing and repeated columns; return warnings about the unknown ones."""
    if not set(header) & set(COLUMNS):
        seen = show_cell(",".join(header))
        text = f"{seen} is not a header. The first line must name the columns, e.g. "
        problems.add(Problem(1, "", f"{text}{','.join(REQUIRED)}; comments are not allowed."))
        return ()
    for name in REQUIRED:
        if name not in header and name != "theta_r_deg":
            problems.add(missing_column(name, header))
    for name in COLUMNS:
        if (n := header.count(name)) > 1:
            problems.add(Problem(1, name, f"the header names it {n} times. Keep one of them."))
    absent = [name for name in COLUMNS if name not in header]
    return tuple(
        f"column {show_cell(name)} is not part of the format and was not read."
        f"{did_you_mean(name, absent)}"
        for name in header
        if name and name not in COLUMNS
    )


def missing_column(name: str, header: Sequence[str]) -> Problem:
    """Say which required column is missing, and which may be meant for it."""
    meant = {given.lower(): given for given in header if given not in COLUMNS}
    near = difflib.get_close_matches(name, meant, n=1)
    remedy = f"Add it; required are {', '.join(REQUIRED)}."
    if near:
        remedy = f"Is it the one named {show_cell(meant[near[0]])}? Rename that to {name!r}."
    return Problem(1, name, f"this required column is missing from the header. {remedy}")
