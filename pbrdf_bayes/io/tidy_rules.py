"""What the tidy CSV allows, as a table of rules, and the check of rows against it.

Rules work on whole columns; words are found only for the first rows that break one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, isnan

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean, plain_spaces
from pbrdf_bayes.io.problems import N_LINES, Problem, Problems, show_cell
from pbrdf_bayes.io.tidy_columns import QUANTITIES, to_float
from pbrdf_bayes.io.tidy_rows import Rows, look_up_words
from pbrdf_bayes.measurement import DHR_RANGE, MAX_LABEL, MAX_NAME, POLARIZATIONS, is_label, is_name

_EMPTY = frozenset({""})
_EMPTY_OR_NAN = frozenset({"", "nan"})
_MOST_LOOKED_AT = 100_000
"""Wrong cells of a column that are told apart; those after them count with the first."""
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
        low=DHR_RANGE[0],
        high=DHR_RANGE[1],
        allowed="{:g} to {:g}".format(*DHR_RANGE),
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
    remedy="Give the instrument's noise floor (brdf_floor in the file of --config, or check "
    "--brdf-floor) so that the reading is treated as censored, or flag the row.",
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


@dataclass(frozen=True)
class Breach:
    """Rows that break one rule, shape (n_rows,), and the words for a cell that does.

    ``explain`` gives two parts: the cell, and what is the same for every cell of its kind.
    """

    column: str
    wrong: NDArray[np.bool_]
    explain: Callable[[str], tuple[str, str]]
    not_stated: frozenset[str] = frozenset()


def find_breaches(
    rows: Rows, words: Mapping[str, Sequence[str]], rules: Iterable[NumberRule]
) -> Iterator[Breach]:
    """Compare every row that is not flagged with every rule.

    Cells that hold no number are counted as wrong; whether one of the ``not_stated`` words excuses
    them is for the caller to see.
    """
    for name, is_usable, longest in (("sample", is_name, MAX_NAME), ("scan", is_label, MAX_LABEL)):
        usable = look_up_words(words[name], getattr(rows, name), is_usable)
        yield Breach(name, rows.used & (usable == 0), _explain_label(longest))
    yield Breach("quantity", rows.used & (rows.quantity < 0), _explain_word(QUANTITIES))
    yield Breach("polarization", rows.used & (rows.polarization < 0), _explain_word(POLARIZATIONS))
    for rule in rules:
        wrong = rows.used & ~rule.accepts(getattr(rows, rule.column))
        if rule.quantity:
            wrong &= rows.quantity == QUANTITIES.index(rule.quantity)
        yield Breach(rule.column, wrong, _explain_number(rule), rule.not_stated)


def check_rows(
    rows: Rows,
    cells: Mapping[str, Sequence[str]],
    words: Mapping[str, Sequence[str]],
    *,
    rules: Iterable[NumberRule],
    problems: Problems,
    nan_is_empty: bool = False,
) -> NDArray[np.bool_]:
    """Add what is wrong with the rows to ``problems``; return which rows, shape (n_rows,).

    ``nan_is_empty`` says that NaN stands for empty cells only, so that they need not be looked at.
    """
    bad = np.zeros(len(rows), dtype=bool)
    for breach in find_breaches(rows, words, rules):
        if breach.column not in cells:
            continue
        column = cells[breach.column]
        index = np.flatnonzero(breach.wrong)
        if breach.not_stated and nan_is_empty:
            index = index[~np.isnan(getattr(rows, breach.column)[index])]
        if breach.not_stated:
            stated = [column[i].strip().lower() not in breach.not_stated for i in index.tolist()]
            index = index[np.array(stated, dtype=bool)]
        bad[index] = True
        for problem in _by_kind(breach, rows, column, words["sample"], index):
            problems.add(problem)
    return bad


def _by_kind(
    breach: Breach, rows: Rows, column: Sequence[str], names: Sequence[str],
    index: NDArray[np.int64],
) -> Iterator[Problem]:  # fmt: skip
    """One problem for each kind and sample among the rows ``index``."""
    values = getattr(rows, breach.column)[index]
    # Numbers out of range are all of one kind; what is no number, or no known word, is looked at.
    is_number = np.isfinite(values) if values.dtype.kind == "f" else np.zeros(len(index), bool)
    kinds: dict[str, NDArray[np.int64]] = {}
    if np.any(is_number):
        numbers = index[is_number]
        kinds[breach.explain(column[numbers[0]])[1]] = numbers
    looked_at: dict[str, list[int]] = {}
    known: dict[str, str] = {}
    others = index[~is_number]
    for i in others[:_MOST_LOOKED_AT].tolist():
        cell = column[i]
        if cell not in known:
            known[cell] = breach.explain(cell)[1]
        looked_at.setdefault(known[cell], []).append(i)
    kinds |= {kind: np.array(members) for kind, members in looked_at.items()}
    if others.size > _MOST_LOOKED_AT:
        first = known[column[int(others[0])]]
        kinds[first] = np.concatenate([kinds[first], others[_MOST_LOOKED_AT:]])
    for kind, members in kinds.items():
        order = members[np.argsort(rows.sample[members], kind="stable")]
        for own in np.split(order, np.flatnonzero(np.diff(rows.sample[order])) + 1):
            lines = tuple(rows.line[own[:N_LINES]].tolist())
            yield Problem(
                line=lines[0], column=breach.column, text="".join(breach.explain(column[own[0]])),
                sample=names[rows.sample[own[0]]], kind=kind, n=own.size, lines=lines,
            )  # fmt: skip


def _explain_label(longest: int) -> Callable[[str], tuple[str, str]]:
    """Say what is wrong with the name of a sample or of a scan."""

    def explain(cell: str) -> tuple[str, str]:
        if not cell.strip():
            return "", "empty. Give the name of the paint sample."
        allowed = f"up to {longest} printable characters"
        remedy = "Shorten or correct it."
        if plain_spaces(cell).replace("\u00a0", " ").isprintable() and len(cell) <= longest:
            remedy = "It has a no-break space or one of another width: type a plain one."
        return show_cell(cell), f" is not allowed (allowed: {allowed}). {remedy}"

    return explain


def _explain_word(known: Sequence[str]) -> Callable[[str], tuple[str, str]]:
    """Say which words a column allows, and which one may be meant."""

    def explain(cell: str) -> tuple[str, str]:
        word = cell.strip().lower()
        meant = _WORDS_MEANT.get(word, word)
        hint = did_you_mean(meant, known) or f" Write one of {', '.join(known)}."
        cell, seen = (show_cell(cell), " is not allowed") if word else ("", "empty")
        return cell, f"{seen} (allowed: {', '.join(known)}; in lower case).{hint}"

    return explain


def _explain_number(rule: NumberRule) -> Callable[[str], tuple[str, str]]:
    """Say why a cell breaks a rule, what it allows and what to do."""

    def explain(cell: str) -> tuple[str, str]:
        text, remedy = cell.strip(), rule.remedy
        if not isfinite(to_float(text)) and rule.column == "value":
            remedy = "Give the reading, or flag the row."
        if not text:
            shown, seen = "", "empty"
        elif not isnan(to_float(text)) or text.lower().strip("+-") == "nan":
            shown, seen = show_cell(text)[1:-1], " is not allowed"
        else:
            shown, seen = show_cell(text), " is not a number"
            remedy = "Write a decimal point, not a decimal comma." if "," in text else remedy
        return shown, f"{seen} (allowed: {rule.allowed}). {remedy}"

    return explain
