"""Columns of the tidy CSV: their names, and how cells become numbers and words."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from math import nan

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.io.formulas import unguard
from pbrdf_bayes.io.problems import Problem, Problems, show_cell

REQUIRED = (
    "sample",
    "wavelength_um",
    "quantity",
    "polarization",
    "theta_i_deg",
    "theta_r_deg",
    "value",
)
OPTIONAL = ("sigma", "n_repeats", "phi_r_deg", "scan", "flag")
COLUMNS = REQUIRED + OPTIONAL
WORD_COLUMNS = ("sample", "quantity", "polarization", "scan", "flag")
NUMBER_COLUMNS = tuple(name for name in COLUMNS if name not in WORD_COLUMNS)
QUANTITIES = ("brdf", "dhr")


MOST_SAMPLES = 10_000
"""Samples of one file, each wavelength counted."""
MOST_WORDS = {"sample": MOST_SAMPLES, "flag": MOST_SAMPLES}
_MOST_OTHER_WORDS = 100_000


class TooManyWordsError(Exception):
    """A text column holds more distinct words than a file may have."""


class Codebook:
    """Distinct words of a text column, numbered as they are met; `encode` extends it.

    Raises
    ------
    TooManyWordsError
        From `encode`, before the words beyond the limit are kept.
    """

    def __init__(self, column: str) -> None:
        self.column = column
        self.words: list[str] = []
        self._word_code: dict[str, int] = {}
        self._cell_code: dict[str, int] = {}

    def encode(self, cells: Sequence[str]) -> NDArray[np.int64]:
        """Give the number of the word in each cell, its blanks and formula guard left out."""
        new = set(cells) - self._cell_code.keys()
        most = MOST_WORDS.get(self.column, _MOST_OTHER_WORDS)
        if len(self._cell_code) + len(new) > most + 1:  # an empty one beside them
            msg = f"column {self.column} has more than {most} different words (allowed: up to that)"
            raise TooManyWordsError(msg)
        for cell in sorted(new):
            word = unguard(cell.strip())
            code = self._word_code.setdefault(word, len(self.words))
            if code == len(self.words):
                self.words.append(word)
            self._cell_code[cell] = code
        return np.fromiter(map(self._cell_code.__getitem__, cells), np.int64, len(cells))


def to_floats(cells: Sequence[str]) -> NDArray[np.float64]:
    """Numbers in plain notation, correctly rounded; NaN where a cell holds none.

    Examples
    --------
    >>> to_floats(["1.5", " 2e-3 ", "", "1_000", "0,5"]).tolist()
    [1.5, 0.002, nan, nan, nan]
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
    try:
        return float(cell) if cell.isascii() and "_" not in cell else nan
    except ValueError:
        return nan


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
