"""Rows of the tidy CSV as arrays, converted from cells by one of two ways that agree.

A file without anything unusual goes through the fast reader of pandas. Every other file, and every
file with a problem, is converted from its cells, so that a message can show them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import nan
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pbrdf_bayes.io.csv_table import is_plain
from pbrdf_bayes.io.tidy_columns import (
    NUMBER_COLUMNS,
    QUANTITIES,
    WORD_COLUMNS,
    Codebook,
    to_floats,
)
from pbrdf_bayes.measurement import POLARIZATIONS

# From pandas 3.1 every number is rounded correctly and asking for it is deprecated.
_ALWAYS_EXACT = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
_PART_ROWS = 2**18
_EXACT: dict[str, Any] = {} if _ALWAYS_EXACT else {"float_precision": "round_trip"}


@dataclass(frozen=True, eq=False)
class Rows:
    """Converted rows, shape (n_rows,) each.

    ``sample``, ``scan`` and ``flag`` number the words of their columns; ``quantity`` and
    ``polarization`` index `QUANTITIES` and ``POLARIZATIONS``, -1 where the word is unknown.
    ``used`` marks rows without a flag.
    """

    line: NDArray[np.int64]
    sample: NDArray[np.int64]
    wavelength_um: NDArray[np.float64]
    quantity: NDArray[np.int64]
    polarization: NDArray[np.int64]
    theta_i_deg: NDArray[np.float64]
    theta_r_deg: NDArray[np.float64]
    value: NDArray[np.float64]
    sigma: NDArray[np.float64]
    n_repeats: NDArray[np.float64]
    phi_r_deg: NDArray[np.float64]
    scan: NDArray[np.int64]
    flag: NDArray[np.int64]
    used: NDArray[np.bool_]

    def __len__(self) -> int:
        return int(self.line.size)

    @property
    def may_be_blank(self) -> NDArray[np.bool_]:
        """Rows without a known word and without numbers: perhaps nothing but commas."""
        blank = (self.quantity < 0) & (self.polarization < 0)
        return blank & np.isnan(self.theta_i_deg) & np.isnan(self.value)


def new_codebooks() -> dict[str, Codebook]:
    """Empty codebook for each text column."""
    return {name: Codebook(name) for name in WORD_COLUMNS}


def rows_from_cells(
    line: NDArray[np.int64],
    cells: Mapping[str, Sequence[str]],
    codebooks: Mapping[str, Codebook],
) -> Rows:
    """Convert the cells of some rows, column by column; NaN where a cell holds no number."""
    blank = ("",) * len(line)
    codes = {name: codebooks[name].encode(cells.get(name, blank)) for name in WORD_COLUMNS}
    numbers = {
        name: to_floats(cells[name]) if name in cells else np.full(len(blank), nan)
        for name in NUMBER_COLUMNS
    }
    return _assemble(line, codes, numbers, codebooks)


def rows_from_plain(
    data: bytes, header: Sequence[str], codebooks: Mapping[str, Codebook]
) -> Rows | None:
    """Convert a whole file at once; None where it is not plain.

    NaN always means an empty cell here; minus infinity stands for a cell that holds no number.
    """
    if not is_plain(data, len(header)):
        return None
    place = {name: header.index(name) for name in WORD_COLUMNS + NUMBER_COLUMNS if name in header}
    try:
        if not data.isascii():
            data.decode()  # pandas does not look at the columns it leaves out
        codes, numbers = _convert_plain(data, len(header), place, np.float64, codebooks)
    except UnicodeDecodeError:
        return None
    except ValueError:
        codes, numbers = _convert_plain(data, len(header), place, object, codebooks)
    n_rows = numbers[NUMBER_COLUMNS[0]].size
    return _assemble(np.arange(2, n_rows + 2), codes, numbers, codebooks)


def _convert_plain(
    data: bytes, width: int, place: Mapping[str, int], number: type,
    codebooks: Mapping[str, Codebook],
) -> tuple[dict[str, NDArray[np.int64]], dict[str, NDArray[np.float64]]]:  # fmt: skip
    """Codes and numbers of all columns; part by part, so that cells are not all there at once."""
    codes: dict[str, list[NDArray[np.int64]]] = {name: [] for name in WORD_COLUMNS}
    numbers: dict[str, list[NDArray[np.float64]]] = {name: [] for name in NUMBER_COLUMNS}
    for part in _read_plain(data, width, place, number):
        for name, words in codes.items():
            book = codebooks[name]
            if name in place:
                cell, cells = pd.factorize(part[place[name]])
                words.append(book.encode([*cells, ""])[cell])
            else:
                words.append(np.full(len(part), book.encode([""])[0]))
        for name, values in numbers.items():
            if name not in place:
                values.append(np.full(len(part), nan))
            elif number is object:
                values.append(_nan_where_empty(part[place[name]].tolist()))
            else:
                values.append(part[place[name]].to_numpy())
    return (
        {name: np.concatenate(codes.pop(name)) for name in WORD_COLUMNS},
        {name: np.concatenate(numbers.pop(name)) for name in NUMBER_COLUMNS},
    )


def _nan_where_empty(cells: Sequence[str]) -> NDArray[np.float64]:
    numbers = to_floats(cells)
    stated = np.fromiter(map(bool, cells), np.bool_, len(cells))
    return np.where(np.isnan(numbers) & stated, -np.inf, numbers)


def _read_plain(
    data: bytes, width: int, place: Mapping[str, int], number: type
) -> Iterator[pd.DataFrame]:
    """Cells by the place of their column, with numbers or, where ``number`` is object, as text."""
    empty: dict[str, Any] = {"na_filter": False} if number is object else {"na_values": [""]}
    with pd.read_csv(
        io.BytesIO(data),
        header=None,
        skiprows=1,
        names=range(width),
        usecols=sorted(place.values()),
        # Not "category": it turns words such as 01 into numbers.
        dtype={i: object if n in WORD_COLUMNS else number for n, i in place.items()},
        keep_default_na=False,
        skipinitialspace=True,
        quoting=csv.QUOTE_NONE,
        chunksize=_PART_ROWS,
        **empty,
        **_EXACT,
    ) as parts:
        yield from parts


def join_rows(parts: Sequence[Rows]) -> Rows:
    """Concatenate the rows of all chunks."""
    parts = parts or [rows_from_cells(np.zeros(0, np.int64), {}, new_codebooks())]
    names = [f.name for f in fields(Rows)]
    return Rows(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


def _assemble(
    line: NDArray[np.int64],
    codes: Mapping[str, NDArray[np.int64]],
    numbers: Mapping[str, NDArray[np.float64]],
    codebooks: Mapping[str, Codebook],
) -> Rows:
    """Look up the words that have a meaning of their own."""

    def look_up(name: str, meaning: Callable[[str], int]) -> NDArray[np.int64]:
        return look_up_words(codebooks[name].words, codes[name], meaning)

    meaning: dict[str, Any] = {
        "quantity": look_up("quantity", _place_in(QUANTITIES)),
        "polarization": look_up("polarization", _place_in(POLARIZATIONS)),
        "used": look_up("flag", lambda word: word.lower() in {"", "ok"}).astype(bool),
    }
    return Rows(line=line, **{**codes, **numbers, **meaning})


def look_up_words(
    words: Sequence[str], codes: NDArray[np.int64], meaning: Callable[[str], int]
) -> NDArray[np.int64]:
    """What the word of each code means, asked once for each word, of those that occur alone."""
    if len(words) <= codes.size:
        return np.array([meaning(word) for word in words], dtype=np.int64)[codes]
    present, place = np.unique(codes, return_inverse=True)
    return np.array([meaning(words[code]) for code in present.tolist()], dtype=np.int64)[place]


def _place_in(known: Sequence[str]) -> Callable[[str], int]:
    """The place of a word among the known ones; -1 where it is none of them."""
    place = {word: index for index, word in enumerate(known)}
    return lambda word: place.get(word, -1)
