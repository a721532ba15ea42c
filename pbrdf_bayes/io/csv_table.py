"""The bytes of a comma-separated file as chunks of cells with the lines they stand on.

The csv module of the standard library reads them, not pandas: it knows the line of every row
(quoted line breaks included), and shows rows that are too short or too long, which pandas fills or
shifts in silence.
"""

from __future__ import annotations

import csv
import errno
import io
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.outside import read_ordinary
from pbrdf_bayes.io.problems import Problem, Problems, compose_message

if TYPE_CHECKING:
    import _csv

MAX_BYTES = 128 * 2**20
"""Largest file read, about two million readings: what is larger would not fit into memory."""
MAX_ROWS = 3_000_000
MAX_LINE_BYTES = 65_536
MAX_ROW_LINES = 100
"""Lines that one row may take by line breaks in quotes."""
MAX_COLUMNS = 1000
_MOST_OWNERS = 10_000
"""Samples whose unreadable rows are counted one by one."""
_CHUNK_ROWS, _CHUNK_CHARACTERS = 4096, 2**20

SAVE_AS_UTF8 = "Save the file as UTF-8 (in a spreadsheet: 'CSV UTF-8, comma delimited')."
_FOREIGN = (
    (b"\x1f\x8b", "a gzip archive", "Unpack it first: gunzip FILE."),
    (b"PK\x03\x04", "a zip archive or a spreadsheet", SAVE_AS_UTF8),
    (b"\xff\xfe", "text in UTF-16", SAVE_AS_UTF8),
    (b"\xfe\xff", "text in UTF-16", SAVE_AS_UTF8),
)
_SEPARATORS = {
    ";": ("semicolons", "sed 's/,/./g; s/;/,/g' OLD.csv > NEW.csv"),
    "\t": ("tabs", "sed 's/,/./g' OLD.csv | tr '\\t' ',' > NEW.csv"),
    "|": ("bars", "tr '|' ',' < OLD.csv > NEW.csv"),
}


@dataclass(frozen=True)
class Chunk:
    """Consecutive rows: their lines, shape (n_rows,), and their cells column by column."""

    line: NDArray[np.int64]
    columns: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Table:
    """Header cells and an iterator over the rows, to be used once.

    Attributes
    ----------
    header : tuple of str
    chunks : iterator of Chunk
        Rows with something in them and as many cells as the header.
    unreadable : Problems
        Other rows, added to while ``chunks`` is used: no text, too long, another number of cells.
        ``sample`` of a problem is the cell of the column ``sample``, where it has one.
    trailing : list of int
        Lines with more cells than the header, all of them empty: read without these.
    doubtful : list of int
        Lines of unreadable rows of which a quote may have swallowed others.
    """

    header: tuple[str, ...]
    chunks: Iterator[Chunk]
    unreadable: Problems
    trailing: list[int]
    doubtful: list[int]


def read_bytes(path: str | Path) -> bytes:
    """Content of a file.

    Raises
    ------
    DataError
        When it does not exist, is a folder, a device or a pipe, cannot be read or is larger than
        `MAX_BYTES`.
    """
    file = Path(path)
    try:
        return read_ordinary(file, MAX_BYTES)
    except FileNotFoundError:
        refuse(path, f"there is no such file.{_similar_file(file)}")
    except (OSError, ValueError) as error:
        if os.path.isdir(file):  # noqa: PTH112 - Path.is_dir raises for a name that is too long
            refuse(path, "this is a folder. Give the CSV file in it.")
        if getattr(error, "errno", None) == errno.EFBIG:
            reason = f"the file is larger than {MAX_BYTES // 2**20} MiB (allowed: up to that)."
            refuse(path, f"{reason} Split it, for example into one file for each sample.")
        refuse(path, f"the file cannot be read ({getattr(error, 'strerror', None) or error}).")


def open_table(path: str | Path, data: bytes) -> Table:
    """Split ``data`` into a header and chunks of rows.

    Raises
    ------
    DataError
        When the content is not comma-separated text with a header; from ``chunks`` where the
        quotes do not tell the rows apart.
    """
    if not re.search(rb"[^\xef\xbb\xbf\s]", data):
        refuse(path, "the file is empty. It needs a header and at least one row.")
    for magic, name, remedy in _FOREIGN:
        if data.startswith(magic):
            refuse(path, f"this is {name}, not a CSV file. {remedy}")
    if data.count(b"\r") != data.count(b"\r\n"):
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if (n_rows := data.count(b"\n")) > MAX_ROWS:
        reason = f"the file has {n_rows} lines (allowed: up to {MAX_ROWS})."
        refuse(path, f"{reason} Split it, for example into one file for each sample.")
    lines = _Lines(data.removeprefix(b"\xef\xbb\xbf"))
    reader = csv.reader(lines, strict=True, skipinitialspace=True)
    try:
        header = tuple(cell.strip() for cell in next(reader))
        lines.row_starts = reader.line_num + 1
    except csv.Error as error:
        broken = f"line 1: the quotes around a cell are broken ({error}). Close them."
        refuse(path, lines.fatal or broken)
    if lines.bad:
        refuse(path, f"line 1: {lines.bad[0][2]}")
    if not any(header):
        refuse(path, "line 1 is empty. It must be the header with the column names.")
    _refuse_other_separators(path, header)
    if len(header) > MAX_COLUMNS:
        reason = f"line 1 has {len(header)} columns (allowed: up to {MAX_COLUMNS})."
        refuse(path, f"{reason} Keep those of the format, one reading a line.")
    table = Table(header, iter(()), Problems(), [], [])
    return replace(table, chunks=_chunks(path, reader, lines, table))


def refuse(path: str | Path, reason: str) -> NoReturn:
    """Raise a `DataError` about the file as a whole."""
    raise DataError(compose_message(str(path), [Problem(0, "", reason)], 1))


def _similar_file(file: Path) -> str:
    """Name a file of the same folder that may have been meant."""
    try:
        names = [entry.name for entry in file.parent.iterdir()]
    except (OSError, ValueError):
        return ""
    return did_you_mean(file.name, names)


def _refuse_other_separators(path: str | Path, header: Sequence[str]) -> None:
    """Refuse semicolons and the like, saying how to convert."""
    line = ",".join(header)
    for separator, (name, command) in _SEPARATORS.items():
        if line.count(separator) > line.count(","):
            reason = f"line 1: the columns are separated by {name}, not by commas. Convert them,"
            refuse(path, f"{reason} and decimal commas to points: {command}")
    if len(header) == 1 and len(line.split()) > 3:
        reason = "line 1: the columns are separated by spaces, not by commas."
        refuse(path, f"{reason} Convert them: sed 's/  */,/g' OLD.csv > NEW.csv")


class _Lines:
    """Decoded lines for the csv reader; a line that is no text becomes an empty one, and ``bad``.

    It ends the file with a `csv.Error` where a row has too many lines, or a bad line may be a part
    of a quoted cell.
    """

    def __init__(self, data: bytes) -> None:
        self._lines = io.BytesIO(data)
        self._number = self._place = 0
        self._in_quotes = False
        self.row_starts = 1
        self.characters = 0
        self.bad: list[tuple[int, bytes, str]] = []
        self.fatal = ""

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line = next(self._lines)
        self._number += 1
        if self._number - self.row_starts >= MAX_ROW_LINES:
            msg = f"a row of more than {MAX_ROW_LINES} lines"
            raise csv.Error(msg)
        opens_or_closes = line.count(b'"') % 2 == 1
        text, wrong = self._decode(line)
        if wrong:
            if self._in_quotes or opens_or_closes:
                self.fatal = f"line {self._number}: {wrong}"
                raise csv.Error(wrong)
            self.bad.append((self._number, line[:MAX_LINE_BYTES], wrong))
            text = "\n"
        self._in_quotes ^= opens_or_closes
        self._place += len(line)
        self.characters += len(text)
        return text

    def _decode(self, line: bytes) -> tuple[str, str]:
        """The text of a line, or what is wrong with it."""
        if (n := len(line.rstrip(b"\r\n"))) > MAX_LINE_BYTES:
            wrong = f"{n} bytes long (allowed: up to {MAX_LINE_BYTES}). This is not one reading a "
            return "", f"{wrong}line: check how the file was exported."
        if (at := line.find(b"\0")) >= 0:
            where = f"(at byte {self._place + at})"
            return "", f"a zero byte {where}: a binary file, or a damaged one. {SAVE_AS_UTF8}"
        try:
            return line.decode("utf-8"), ""
        except UnicodeDecodeError as error:
            where = f"0x{line[error.start]:02X} (at byte {self._place + error.start})"
            return "", f"byte {where} is not UTF-8. {SAVE_AS_UTF8}"


def _chunks(path: str | Path, reader: _csv.Reader, lines: _Lines, table: Table) -> Iterator[Chunk]:
    """Gather rows into chunks; what is no row of the table goes to its other lists."""
    width = len(table.header)
    place = table.header.index("sample") if "sample" in table.header else width
    numbers: list[int] = []
    rows: list[list[str]] = []

    def report(number: int, cells: Sequence[str], wrong: str, kind: str) -> None:
        if any(";" in cell for cell in cells):
            cells = ",".join(cells).split(";")
        sample = cells[place].strip() if place < len(cells) else ""
        if len(table.unreadable.found) > _MOST_OWNERS and sample not in table.unreadable.found:
            sample = ""
        table.unreadable.add(Problem(number, "", wrong, sample, kind=kind))

    def take_bad() -> None:
        for number, line, wrong in lines.bad:
            cells = line.decode("utf-8", "surrogateescape").split(",")
            report(number, cells, wrong, wrong.partition(". ")[2])
        lines.bad.clear()

    while True:
        try:
            row = next(reader, None)
        except csv.Error as error:
            reason = f"line {lines.row_starts}: the quotes around a cell are broken ({error})."
            refuse(path, lines.fatal or f"{reason} Close them; write a quote inside as two.")
        if lines.bad:
            take_bad()
        full = len(rows) >= _CHUNK_ROWS or lines.characters > _CHUNK_CHARACTERS
        if rows and (full or row is None):
            yield Chunk(np.array(numbers), tuple(zip(*rows, strict=True)))
            numbers, rows, lines.characters = [], [], 0
        if row is None:
            return
        number, lines.row_starts = lines.row_starts, reader.line_num + 1
        if len(row) > width and any(row) and not any(map(str.strip, row[width:])):
            table.trailing.append(number)
            del row[width:]
        if len(row) == width and any(row):
            numbers.append(number)
            rows.append(row)
        elif any(map(str.strip, row)):
            remedy, n = why_ragged(row, width), len(row)
            text = f"{n} cell{'s' if n > 1 else ''} where the header has {width}. {remedy}"
            report(number, row, text, remedy)
            odd = sum(cell.count('"') for cell in row) % 2 == 1
            if odd or lines.row_starts > number + 1:
                table.doubtful.append(number)


def why_ragged(cells: Sequence[str], width: int) -> str:
    """What to do about a row of another length than the header, by what it looks like."""
    if any(";" in cell for cell in cells):
        return "Separate the cells by commas, not by semicolons."
    if len(cells) > width:
        return "Write decimal points, not decimal commas; put names with a comma in quotes."
    return "Fill in the missing cells; an empty cell needs its comma too."
