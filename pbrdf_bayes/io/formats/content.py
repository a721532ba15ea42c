"""What every reader works on: the content of a file, what the user decides, and what it gives."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.problems import printable, show_cell

MOST_BYTES = 32 * 2**20
"""Largest file of a foreign format that is read."""
MOST_READINGS = 1_000_000
MOST_LINES = 1_000_000
MOST_LINE, MOST_WORDS = 2**20, 2_000_000
_BOMS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))


@dataclass(frozen=True, kw_only=True)
class Decided:
    """What the user decides about a file; None leaves it to the file.

    Attributes
    ----------
    format, sample, sheet : str, optional
    polarization : {"s", "p", "u"}, optional
    wavelength_um, theta_i_deg : float, optional
        [um], [deg]
    forward : {"phi0", "phi180"}, optional
        Azimuth of the specular side.
    value : {"brdf", "brf", "brdf_cos"}, optional
        BRDF, reflectance factor (pi BRDF) or BRDF times cos theta_r.
    unit : {"fraction", "percent"}, optional
    """

    format: str | None = None
    sample: str | None = None
    polarization: str | None = None
    wavelength_um: float | None = None
    theta_i_deg: float | None = None
    forward: str | None = None
    value: str | None = None
    unit: str | None = None
    sheet: str | None = None


class UndecidedError(DataError):
    """The file does not say something, and an option can."""


@dataclass(frozen=True, eq=False)
class Content:
    """A file from outside.

    Attributes
    ----------
    path : str
    data : bytes
    decided : Decided
    said : list of str
        Decisions so far, added to while a reader is at work.
    """

    path: str
    data: bytes
    decided: Decided = field(default_factory=Decided)
    said: list[str] = field(default_factory=list)

    @cached_property
    def is_text(self) -> bool:
        """No zero bytes, other than those of UTF-16."""
        return b"\0" not in self.data or self.data[:2] in (b"\xff\xfe", b"\xfe\xff")

    @cached_property
    def text(self) -> str:
        """The file as text, line ends as line feeds; empty where it is none."""
        if not self.is_text:
            return ""
        for mark, encoding in _BOMS:
            if self.data.startswith(mark):
                try:
                    text = self.data[len(mark) :].decode(encoding)
                except UnicodeDecodeError:
                    return ""
                return text.replace("\r\n", "\n").replace("\r", "\n")
        try:
            text = self.data.decode("utf-8")
        except UnicodeDecodeError:
            text = self.data.decode("latin-1")
        return text.replace("\r\n", "\n").replace("\r", "\n")

    @cached_property
    def lines(self) -> Sequence[str]:
        """Lines of the text without blanks at their ends."""
        if self.text.count("\n") > MOST_LINES:
            self.refuse(f"more than {MOST_LINES} lines (allowed: up to that)")
        lines = [line.rstrip() for line in self.text.split("\n")]
        at = max(range(len(lines)), key=lambda i: len(lines[i]))
        if (n := len(lines[at])) > MOST_LINE:
            self.refuse(f"line {at + 1}: {n} bytes long (allowed: up to {MOST_LINE})")
        return lines

    @cached_property
    def head(self) -> str:
        """The first thousand characters."""
        return self.text[:1000]

    def say(self, decision: str) -> None:
        """Note a decision for the user."""
        self.said.append(decision)

    def refuse(self, reason: str) -> NoReturn:
        """Raise that the file is wrong."""
        end = "" if reason.endswith(("?", ".")) else "."
        msg = f"{printable(self.path)}: {reason}{end} Nothing was read."
        raise DataError(msg)

    def ask(self, what: str, option: str) -> NoReturn:
        """Raise that the file does not say ``what``, and which option does."""
        msg = f"{printable(self.path)}: {what}. Decide it: {option}. Nothing was read."
        raise UndecidedError(msg)

    def number(self, cell: str, *, line: int, what: str) -> float:
        """A finite number in a cell, with a decimal point.

        Raises
        ------
        DataError
        """
        found = to_number(cell)
        if found is None:
            self.refuse(f"line {line}: {what} {show_cell(cell)} is not a finite number")
        return found

    def numbers(self, cells: Sequence[str], *, line: int, what: str) -> list[float]:
        """As `number`, of several cells."""
        return [self.number(cell, line=line, what=what) for cell in cells]

    def sample(self, named: str = "") -> str:
        """Name of the sample: as decided, else as named in the file, else the file's stem."""
        name = self.decided.sample or " ".join(printable(named).split())[:200]
        return name or printable(Path(self.path).stem) or "sample"

    def wavelength_um(self, named: float | None) -> float:
        """Wavelength [um] of a file that has one at most."""
        if self.decided.wavelength_um is not None:
            if named is not None and abs(named / self.decided.wavelength_um - 1.0) > 1e-3:
                self.say(f"wavelength: {self.decided.wavelength_um:g} um as decided, although the "
                         f"file says {named:g} um")  # fmt: skip
            return self.decided.wavelength_um
        if named is None:
            self.ask("the file does not say the wavelength", "--wavelength-um X")
        self.say(f"wavelength: {named:g} um, from the file")
        return named

    def polarization(self, named: str | None, *, otherwise: str | None = None) -> str:
        """Incident polarisation: as decided, as named, or ``otherwise``; asked for where None."""
        if self.decided.polarization is not None:
            return self.decided.polarization
        if named is not None:
            self.say(f"polarisation: {named}, from the file")
            return named
        if otherwise is None:
            self.ask("the file does not say the polarisation", "--polarization s|p|u")
        self.say(f"polarisation: {otherwise}: the file names none (--polarization s|p|u)")
        return otherwise


@dataclass(frozen=True, eq=False)
class Imported:
    """Readings of one file.

    Attributes
    ----------
    columns : mapping of str to ndarray, shape (n_rows,)
        Columns of the tidy CSV.
    """

    columns: Mapping[str, NDArray[Any]]


def imported(content: Content, sample: str, **columns: ArrayLike) -> Imported:
    """Broadcast the columns of a reader, and refuse an empty or a huge result."""
    names = list(columns)
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(columns[name])) for name in names))
    n = arrays[0].size
    if n == 0:
        content.refuse("no readings in it")
    if n > MOST_READINGS:
        content.refuse(f"{n} readings (allowed: up to {MOST_READINGS})")
    return Imported(
        {"sample": np.full(n, sample, dtype=object), **dict(zip(names, arrays, strict=True))}
    )


def to_number(cell: str) -> float | None:
    """A finite number in plain notation, U+2212 as its minus; None where there is none."""
    cell = cell.strip().replace("\N{MINUS SIGN}", "-")
    if not cell.isascii() or "_" in cell:
        return None
    try:
        found = float(cell)
    except ValueError:
        return None
    return found if isfinite(found) else None


def named_wavelength_um(text: str) -> float | None:
    """Wavelength [um] in a word such as ``650nm`` or ``3.39 um``; None where it is none."""
    match = re.fullmatch(r"\s*(\d+(?:[.,]\d+)?)\s*(nm|[u\u00b5\u03bc]m)\s*", text, re.IGNORECASE)
    if not match or (value := float(match[1].replace(",", "."))) <= 0:
        return None
    return value / 1000.0 if match[2].lower() == "nm" else value


def numbered_words(content: Content) -> list[tuple[int, str]]:
    """Words with the lines they stand on, without comments after ``#``."""
    found: list[tuple[int, str]] = []
    for number, line in enumerate(content.lines, start=1):
        found += [(number, word) for word in line.partition("#")[0].split()]
        if len(found) > MOST_WORDS:
            content.refuse(f"more than {MOST_WORDS} words (allowed: up to that)")
    return found


def keyed_lines(lines: Sequence[str]) -> Iterator[tuple[int, str, str]]:
    """Number of each line that is not blank, its first word and the rest."""
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().replace("\t", " ").partition(" ")
        if word:
            yield number, word, rest.strip()


def named_polarization(text: str) -> str | None:
    """Polarisation that a title names, such as ``s-pol``, ``p polarized`` or ``(s, 3.39 um)``."""
    patterns = (
        r"(?<![a-z])([spu])[ _-]?pol", r"polari[sz](?:ation|ed|er)?[ _=:,]*([spu])(?![a-z])",
        r"\(\s*([spu])\s*[,;)]",
    )  # fmt: skip
    found = {m.lower() for pattern in patterns for m in re.findall(pattern, text, re.IGNORECASE)}
    found |= {"u"} if re.search(r"unpolari[sz]ed", text, re.IGNORECASE) else set()
    return found.pop() if len(found) == 1 else None
