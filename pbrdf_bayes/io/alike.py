"""Names of samples that a person could take for one another."""

from __future__ import annotations

import unicodedata
from pathlib import Path

from pbrdf_bayes.io.csv_table import open_table
from pbrdf_bayes.io.formulas import unguard
from pbrdf_bayes.io.problems import Problems, show_cell

_PADDED = [
    pair
    for blank in (b" ", b"\t", b"\xc2\xa0")
    for pair in (b'"' + blank, *(blank + end for end in (b'"', b",", b"\r", b"\n")))
]
_WARNING = (
    "column sample: {} differ by blanks at the ends and are taken as one sample. Give names that "
    "differ otherwise if they are several."
)
_LATIN = str.maketrans("\u0430\u0435\u043e\u0440\u0441\u0443\u0445\u0456\u0458\u0455", "aeopcyxijs")
"""Small Cyrillic letters that are drawn as Latin ones."""


def likeness(name: str) -> str:
    r"""What names have in common that look the same, or differ by capitals or blanks alone.

    Examples
    --------
    >>> likeness("Lot  7") == likeness("l\u043et\u00a07"), likeness("Lot 7") == likeness("Lot 1")
    (True, False)
    """
    plain = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join(plain.translate(_LATIN).split())


def spelled_with_blanks(path: str | Path, data: bytes) -> dict[str, tuple[str, ...]]:
    """A warning by the name of each sample that stands there with other blanks at its ends too."""
    if not any(pair in data for pair in _PADDED):
        return {}
    table = open_table(path, data, Problems())
    place, cells = table.header.index("sample"), set[str]()
    for chunk in table.chunks:
        cells.update(chunk.columns[place])
    spelled: dict[str, list[str]] = {}
    for cell in sorted(cells):
        spelled.setdefault(unguard(cell.strip()), []).append(cell)
    return {
        name: (_WARNING.format(", ".join(map(show_cell, found[:5]))),)
        for name, found in spelled.items()
        if name and len(found) > 1 and any(cell != cell.strip() for cell in found)
    }
