"""What the tidy CSV allows, as a table of rules, and the check of a chunk of rows against it.

Rules work on whole columns; words are found only for the first rows that break one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.io.csv_table import Chunk
from pbrdf_bayes.io.problems import N_LISTED, Problem, Problems, show_cell
from pbrdf_bayes.io.tidy_columns import (
    NUMBER_COLUMNS,
    QUANTITIES,
    WORD_COLUMNS,
    Codebook,
    Rows,
    to_float,
    to_floats,
)
from pbrdf_bayes.measurement import POLARIZATIONS

MAX_LABEL = 200

_EMPTY = frozenset({""})
_EMPTY_OR_NAN = frozenset({"", "nan"})
_WORDS_MEANT = {
    **dict.fromkeys(("te", "perpendicular", "senkrecht"), "s"),
    **dict.fromkeys(("tm", "parallel"), "p"),
    **dict.fromkeys(("unpolarized", "unpolarised", "unpol", "none", "mean", "random"), "u"),
    **dict.fromkeys(("bsdf", "brf"), "brdf"),
    **dict.fromkeys(("hdr", "tis", "hemispherical", "reflectance"), "dhr"),
}


@dataclass(frozen=True)
class NumberRule:
    """What a number column allows in the rows of one quantity ('' means both)."""

    column: str
    quantity: str
    low: float
    high: float
    allowed: str
    remedy: str
    not_stated: frozenset[str] = frozenset()
    above_low: bool = False
    whole: bool = False

    def accepts(self, x: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which values, shape (n_rows,), are finite and in range."""
        inside = np.isfinite(x) & (x <= self.high)
        inside &= (x > self.low) if self.above_low else (x >= self.low)
        return inside & (x == np.floor(x)) if self.whole else inside


_NUMBER_RULES = (
    NumberRule(
        column="wavelength_um",
        quantity="",
        low=0.0,
        high=inf,
        above_low=True,
        allowed="> 0 um",
        remedy="Give the wavelength in micrometres.",
    ),
    NumberRule(
        column="theta_i_deg",
        quantity="",
        low=0.0,
        high=89.95,
        allowed="0 to 89.95 deg",
        remedy="Give the angle of incidence from the normal; theta_r_deg carries the sign.",
    ),
    NumberRule(
        column="theta_r_deg",
        quantity="brdf",
        low=-90.0,
        high=90.0,
        allowed="-90 to 90 deg",
        remedy="Give the angle from the normal, + on the forward (specular) side.",
    ),
    NumberRule(
        column="theta_r_deg",
        quantity="dhr",
        low=-inf,
        high=inf,
        not_stated=_EMPTY_OR_NAN,
        allowed="an empty cell in a DHR row",
        remedy="Leave the cell empty.",
    ),
    NumberRule(
        column="value",
        quantity="dhr",
        low=-0.05,
        high=1.05,
        allowed="-0.05 to 1.05",
        remedy="A DHR is a fraction: divide by 100 if it is in per cent, else flag the row.",
    ),
    NumberRule(
        column="sigma",
        quantity="",
        low=0.0,
        high=inf,
        not_stated=_EMPTY,
        allowed=">= 0, in the unit of value",
        remedy="Give the standard uncertainty, or leave the cell empty.",
    ),
    NumberRule(
        column="n_repeats",
        quantity="",
        low=1.0,
        high=inf,
        not_stated=_EMPTY,
        whole=True,
        allowed="a whole number >= 1",
        remedy="Give the number of readings behind value, or leave the cell empty.",
    ),
    NumberRule(
        column="phi_r_deg",
        quantity="brdf",
        low=-360.0,
        high=360.0,
        not_stated=_EMPTY,
        allowed="-360 to 360 deg",
        remedy="Give the azimuth from the plane of incidence, or leave the cell empty for 0.",
    ),
    NumberRule(
        column="phi_r_deg",
        quantity="dhr",
        low=-inf,
        high=inf,
        not_stated=_EMPTY_OR_NAN,
        allowed="an empty cell in a DHR row",
        remedy="Leave the cell empty.",
    ),
)
_BRDF_ABOVE_ZERO = NumberRule(
    column="value",
    quantity="brdf",
    low=0.0,
    high=inf,
    above_low=True,
    allowed="> 0 sr^-1",
    remedy="Give the instrument's noise floor (brdf_floor) so that the reading is treated as "
    "censored, or flag the row.",
)
_BRDF_WITH_FLOOR = NumberRule(
    column="value",
    quantity="brdf",
    low=-inf,
    high=inf,
    allowed="a finite number [sr^-1]",
    remedy="Give the reading, or flag the row.",
)


def number_rules(*, brdf_floor: float) -> tuple[NumberRule, ...]:
    """Rules of the number columns; above an instrument floor of 0 a BRDF may be zero or less."""
    return (*_NUMBER_RULES, _BRDF_WITH_FLOOR if brdf_floor > 0 else _BRDF_ABOVE_ZERO)


def check_chunk(
    chunk: Chunk,
    header: Sequence[str],
    *,
    rules: Sequence[NumberRule],
    codebooks: Mapping[str, Codebook],
    problems: Problems,
) -> Rows:
    """Convert the cells of a chunk and check every row that is not flagged."""
    cells = dict(zip(header, chunk.columns, strict=True))
    blank = ("",) * len(chunk.line)
    codes = {name: codebooks[name].encode(cells.get(name, blank)) for name in WORD_COLUMNS}
    numbers = {
        name: to_floats(cells[name]) if name in cells else np.full(len(blank), nan)
        for name in NUMBER_COLUMNS
    }
    words = {name: codebooks[name].words for name in WORD_COLUMNS}
    quantity = _lookup(words["quantity"], QUANTITIES)[codes["quantity"]]
    polarization = _lookup(words["polarization"], POLARIZATIONS)[codes["polarization"]]
    used = np.array([word.lower() in {"", "ok"} for word in words["flag"]])[codes["flag"]]
    bad = np.zeros(len(blank), dtype=bool)

    def note(column: str, wrong: NDArray[np.bool_], explain: Callable[[str], str]) -> None:
        index = np.flatnonzero(wrong)
        bad[index] = True
        problems.extend(
            (
                Problem(
                    int(chunk.line[i]),
                    column,
                    explain(cells[column][i]),
                    words["sample"][codes["sample"][i]],
                )
                for i in index[:N_LISTED].tolist()
            ),
            n=index.size,
        )

    for name, empty_allowed in (("sample", False), ("scan", True)):
        usable = np.array([_is_label(word, empty=empty_allowed) for word in words[name]])
        note(name, used & ~usable[codes[name]], _explain_label)
    note("quantity", used & (quantity < 0), _explain_word(QUANTITIES))
    note("polarization", used & (polarization < 0), _explain_word(POLARIZATIONS))
    for rule in rules:
        if rule.column in cells:
            wrong = used & ~rule.accepts(numbers[rule.column])
            if rule.quantity:
                wrong &= quantity == QUANTITIES.index(rule.quantity)
            _excuse_not_stated(wrong, cells[rule.column], rule.not_stated)
            note(rule.column, wrong, _explain_number(rule))
    return Rows(
        line=chunk.line,
        quantity=quantity,
        polarization=polarization,
        used=used,
        bad=bad,
        **{name: codes[name] for name in ("sample", "scan", "flag")},  # type: ignore[arg-type]
        **numbers,
    )


def _lookup(words: Sequence[str], known: Sequence[str]) -> NDArray[np.int64]:
    """Place of each word among the known ones, -1 where it is none of them."""
    place = {word: index for index, word in enumerate(known)}
    return np.array([place.get(word, -1) for word in words])


def _excuse_not_stated(
    wrong: NDArray[np.bool_], cells: Sequence[str], not_stated: frozenset[str]
) -> None:
    """Take out of ``wrong`` the cells that say, in an allowed way, that nothing is stated."""
    if not_stated:
        index = np.flatnonzero(wrong)
        wrong[index] = [cells[i].strip().lower() not in not_stated for i in index.tolist()]


def _is_label(word: str, *, empty: bool) -> bool:
    """Tell whether a name can be shown and used in a file name."""
    return word.isprintable() and len(word) <= MAX_LABEL and (empty or word != "")


def _explain_label(cell: str) -> str:
    """Say what is wrong with the name of a sample or of a scan."""
    if not cell.strip():
        return "empty. Give the name of the paint sample."
    allowed = f"up to {MAX_LABEL} printable characters"
    return f"{show_cell(cell)} is not allowed (allowed: {allowed}). Shorten or correct it."


def _explain_word(known: Sequence[str]) -> Callable[[str], str]:
    """Say which words a column allows, and which one may be meant."""

    def explain(cell: str) -> str:
        word = cell.strip().lower()
        meant = _WORDS_MEANT.get(word, word)
        hint = did_you_mean(meant, known) or f" Write one of {', '.join(known)}."
        seen = f"{show_cell(cell)} is not allowed" if word else "empty"
        return f"{seen} (allowed: {', '.join(known)}; in lower case).{hint}"

    return explain


def _explain_number(rule: NumberRule) -> Callable[[str], str]:
    """Say why a cell breaks a rule, what it allows and what to do."""

    def explain(cell: str) -> str:
        text, remedy = cell.strip(), rule.remedy
        if not isfinite(to_float(text)) and rule.column == "value":
            remedy = "Give the reading, or flag the row."
        if not text:
            seen = "empty"
        elif not isnan(to_float(text)) or text.lower().strip("+-") == "nan":
            seen = f"{show_cell(text)[1:-1]} is not allowed"
        else:
            seen = f"{show_cell(text)} is not a number"
            remedy = "Write a decimal point, not a decimal comma." if "," in text else remedy
        return f"{seen} (allowed: {rule.allowed}). {remedy}"

    return explain
