"""A spectrum of reflectance in columns: nm, um or cm^-1, fraction or per cent."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.io.formats.content import Content, Imported, named_polarization, to_number
from pbrdf_bayes.io.formats.conventions import dhr_readings, incidence_deg
from pbrdf_bayes.io.formats.spreadsheet import cells, is_table

NAME = "spectrum"
_UNITS = (
    ("cm-1", r"cm ?\^?-1|cm\u207b\u00b9|1/cm|wavenumber"), ("nm", r"\bnm\b|nanomet"),
    ("um", r"\b[u\u00b5\u03bc]m\b|microm|micron"),
)  # fmt: skip
_UNCERTAINTY = r"rms|sigma|uncert|std|error"


def recognises(content: Content) -> bool:
    """A header that names the unit of the first column, over at least two rows of numbers."""
    return is_table(content, lambda rows: _header(rows) is not None)


def _header(rows: Sequence[Sequence[str]]) -> int | None:
    """The row before the first two rows of numbers, where it or one above names a unit."""
    for at in range(1, min(len(rows) - 1, 200)):
        if all(len([c for c in row if c]) >= 2 and all(to_number(c) is not None for c in row if c)
               for row in rows[at : at + 2]):  # fmt: skip
            return at - 1 if _unit(" ".join(cell for row in rows[:at] for cell in row)) else None
    return None


def _unit(words: str) -> str | None:
    return next(
        (unit for unit, pattern in _UNITS if re.search(pattern, words, re.IGNORECASE)), None
    )


def read(content: Content) -> Imported:
    """DHR of one column at one wavelength.

    Raises
    ------
    DataError
    """
    rows = cells(content)
    header = _header(rows)
    if header is None:
        content.refuse("no header that names the unit of the first column (nm, um or cm^-1)")
    names, titles = list(rows[header]), " ".join(cell for row in rows[: header + 1] for cell in row)
    unit = _unit(names[0] if names else "") or _unit(titles)
    columns = [
        i
        for i in range(1, len(names))
        if not re.search(_UNCERTAINTY, names[i], re.IGNORECASE) and names[i]
    ]
    columns = columns or [1]
    at = columns[0]
    wanted = content.decided.sample
    if len(columns) > 1:
        listed = ", ".join(names[i] for i in columns)[:300]
        if wanted is None:
            content.ask(
                f"the file has {len(columns)} columns of readings: {listed}", "--sample NAME"
            )
        if wanted not in names:
            content.refuse(
                f"there is no column {wanted[:80]!r}.{did_you_mean(wanted, names)} "
                f"There are: {listed}"
            )
        at = names.index(wanted)
    name = names[at] if at < len(names) else ""
    if re.search(r"%? ?T\b|transm|absor|\babs\b", name, re.IGNORECASE):
        content.refuse(f"column {name[:40]!r} is not a reflectance")
    numbers = []
    for number, row in enumerate(rows[header + 1 :], start=header + 2):
        if any(row):
            pair = [row[0], row[at] if at < len(row) else ""]
            numbers.append(content.numbers(pair, line=number, what="reading"))
    x, y = np.array(numbers).T
    if np.any(x <= 0.0):
        content.refuse(f"a wavelength of {x.min():g} {unit}")
    content.say(f"x: {unit}, from the header")
    x = {"nm": x / 1000.0, "um": x, "cm-1": 1e4 / x}[unit or "um"]
    angle = re.search(r"(\d+(?:\.\d+)?) ?(?:deg|\u00b0)", titles)
    theta_i = incidence_deg(content, float(angle[1]) if angle else None)
    return dhr_readings(
        content, content.sample(name if len(columns) > 1 else ""), wavelength_um=x, value=y,
        polarization=content.polarization(named_polarization(titles)), theta_i_deg=theta_i,
        percent=True if "%" in name or "percent" in name.lower() else None,
    )  # fmt: skip
