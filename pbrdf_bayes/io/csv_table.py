"""The bytes of a comma-separated file as chunks of cells with the lines they stand on.

The csv module of the standard library reads them, not pandas: it is as fast here, knows the line
of every row (quoted line breaks included), and shows rows that are too short or too long, which
pandas fills or shifts in silence.
"""

from __future__ import annotations

import csv
import errno
import io
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, compress, islice
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.outside import read_ordinary
from pbrdf_bayes.io.problems import N_LINES, Problem, Problems, compose_message

MAX_BYTES = 128 * 2**20
"""Largest file read, about two million readings: what is larger would not fit into memory."""
MAX_ROWS = 3_000_000
MAX_LINE_BYTES = 65_536
MAX_ROW_LINES = 100
"""Lines that one row may take by line breaks in quotes."""
MAX_COLUMNS = 1000
CHUNK_ROWS, _CHUNK_CHARACTERS = 1024, 2**20

SAVE_AS_UTF8 = "Save the file as UTF-8 (in a spreadsheet: 'CSV UTF-8, comma delimited')."
_FOREIGN = (
    (b"\x1f\x8b", "a gzip archive", "Unpack it first: gunzip FILE."),
    (b"PK\x03\x04", "a zip archive or a spreadsheet", SAVE_AS_UTF8),
    (b"\xff\xfe", "text in UTF-16", SAVE_AS_UTF8),
    (b"\xfe\xff", "text in UTF-16", SAVE_AS_UTF8),
)
_NOT_PLAIN = (b"true", b"True", b"TRUE", b"false", b"False", b"FALSE")
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
    """Header cells and an iterator over the rows, to be used once."""

    header: tuple[str, ...]
    chunks: Iterator[Chunk]


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


def open_table(path: str | Path, data: bytes, problems: Problems) -> Table:
    """Split ``data`` into a header and chunks; rows of another length go to ``problems``.

    Raises
    ------
    DataError
        When the content is not comma-separated text in UTF-8 with a header.
    """
    _refuse_other_formats(path, data)
    blocks = _blocks(path, data, problems)
    first = next(blocks, ([], [[]]))[1][0]
    header = tuple(cell.strip() for cell in first)
    if not any(header):
        refuse(path, "line 1 is empty. It must be the header with the column names.")
    _refuse_other_separators(path, header)
    if len(header) > MAX_COLUMNS:
        reason = f"line 1 has {len(header)} columns (allowed: up to {MAX_COLUMNS})."
        refuse(path, f"{reason} Keep those of the format, one reading a line.")
    return Table(header, _chunks(blocks, len(header), problems))


def without_quotes(data: bytes) -> bytes:
    """Take the quotes away where each pair stands around a whole cell that does not need them."""
    content = np.frombuffer(data, dtype=np.uint8)
    is_quote = content == ord('"')
    quotes = np.flatnonzero(is_quote)
    if not quotes.size or quotes.size % 2:
        return data
    separates = (content == ord(",")) | (content == ord("\n")) | (content == ord("\r"))
    first, last = quotes[::2], quotes[1::2]
    bounded = (first == 0) | separates[first - 1]
    bounded &= separates[np.minimum(last + 1, content.size - 1)] | (last == content.size - 1)
    if not np.all(bounded):
        return data
    inside = np.zeros(content.size, dtype=np.int8)
    inside[first], inside[last] = 1, -1
    np.cumsum(inside, out=inside)
    return data if np.any(separates & (inside > 0)) else data.replace(b'"', b"")


@dataclass(frozen=True, eq=False)
class PlainColumn(Sequence[str]):
    """Cells of a column of a plain file, cut out of its lines when they are asked for."""

    data: bytes
    ends: NDArray[np.int64]
    place: int

    def __len__(self) -> int:
        return int(self.ends.size) - 1

    def __getitem__(self, row: Any) -> Any:
        line = self.data[self.ends[row] + 1 : self.ends[row + 1]].decode()
        return line.removesuffix("\r").split(",")[self.place]


def plain_columns(data: bytes, header: Sequence[str]) -> dict[str, PlainColumn]:
    """Columns of a plain file by name, the header not counted as a row."""
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n"))
    ends = ends if data.endswith(b"\n") else np.append(ends, len(data))
    return {name: PlainColumn(data, ends, place) for place, name in enumerate(header)}


def is_plain(data: bytes, width: int) -> bool:
    """Tell whether a file is of the plainest kind: rows of ``width`` cells, one a line, no quotes.

    Words that pandas would read as a number do not occur in it either.
    """
    if b'"' in data or any(word in data for word in _NOT_PLAIN):
        return False
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        return False
    content = np.frombuffer(data, dtype=np.uint8)
    ends = np.flatnonzero(content == ord("\n"))
    if not data.endswith(b"\n"):
        ends = np.append(ends, content.size)
    if ends.size < 2 or data.count(b",") != ends.size * (width - 1):
        return False
    starts = np.concatenate([[0], ends[:-1] + 1])
    n_commas = np.add.reduceat((content == ord(",")).view(np.uint8), starts, dtype=np.uint16)
    return bool(np.all(n_commas == width - 1))


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


def _refuse_other_formats(path: str | Path, data: bytes) -> None:
    """Refuse what is not lines of text."""
    if not re.search(rb"[^\xef\xbb\xbf\s]", data):
        refuse(path, "the file is empty. It needs a header and at least one row.")
    for magic, name, remedy in _FOREIGN:
        if data.startswith(magic):
            refuse(path, f"this is {name}, not a CSV file. {remedy}")
    if (at := data.find(b"\0")) >= 0:
        line = data.count(b"\n", 0, at) + 1
        refuse(path, f"line {line} has a zero byte (at byte {at}): a binary file. {SAVE_AS_UTF8}")
    if (n_rows := data.count(b"\n")) > MAX_ROWS:
        reason = f"the file has {n_rows} lines (allowed: up to {MAX_ROWS})."
        refuse(path, f"{reason} Split it, for example into one file for each sample.")
    line, length = _longest_line(data)
    if length > MAX_LINE_BYTES:
        reason = f"line {line} is {length} bytes long (allowed: up to {MAX_LINE_BYTES})."
        refuse(path, f"{reason} This is not one reading a line: check how the file was exported.")


def _longest_line(data: bytes) -> tuple[int, int]:
    """Find the number and the length [bytes] of the longest line."""
    content = np.frombuffer(data, dtype=np.uint8)
    is_break = content == ord("\n")
    is_break |= content == ord("\r")
    breaks = np.concatenate([[-1], np.flatnonzero(is_break), [content.size]])
    lengths = np.diff(breaks) - 1
    longest = int(np.argmax(lengths))
    start = int(breaks[longest]) + 1
    head = data[:start]
    return max(head.count(b"\n"), head.count(b"\r")) + 1, int(lengths[longest])


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


def _blocks(
    path: str | Path, data: bytes, problems: Problems
) -> Iterator[tuple[list[int], list[list[str]]]]:
    """Yield lines and rows: the header alone, then blocks; broken quotes end the file."""
    text = io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline="")
    source = _Lines(text)
    reader = csv.reader(source, strict=True, skipinitialspace=True)
    n_rows, line = 1, 1
    while True:
        rows: list[list[str]] = []
        broken = ""
        try:
            for row in islice(reader, n_rows):
                rows.append(row)
                source.of_row = 0
                if source.characters > _CHUNK_CHARACTERS:
                    break
        except UnicodeDecodeError:
            _refuse_encoding(path, data)
        except csv.Error as error:
            broken = str(error)
        lines = _start_lines(rows, line, reader.line_num)
        line = lines.pop()
        if rows:
            yield lines, rows
        if broken:
            reason = f"the quotes around a cell are broken ({broken}), nothing after it was read."
            problems.add(Problem(line, "", f"{reason} Close them; write a quote inside as two."))
        if broken or not rows:
            return
        n_rows, source.characters = CHUNK_ROWS, 0


@dataclass
class _Lines:
    """Lines of a text, counted, so that no row and no block of rows is without end."""

    text: Iterator[str]
    of_row: int = 0
    characters: int = 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line = next(self.text)
        self.of_row += 1
        self.characters += len(line)
        if self.of_row > MAX_ROW_LINES:
            msg = f"a row of more than {MAX_ROW_LINES} lines"
            raise csv.Error(msg)
        return line


def _start_lines(rows: Sequence[Sequence[str]], first: int, last: int) -> list[int]:
    """Line on which each row starts, and the one after them all; quoted cells may span several."""
    if last - first + 1 == len(rows):
        return list(range(first, last + 2))
    breaks = (sum(len(re.findall(r"\r\n|\r|\n", cell)) for cell in row) for row in rows)
    return list(accumulate((1 + n for n in breaks), initial=first))


def _refuse_encoding(path: str | Path, data: bytes) -> None:
    """Say which byte is not UTF-8."""
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        reason = f"line {line}: byte 0x{data[error.start]:02X} (at byte {error.start})"
        refuse(path, f"{reason} is not UTF-8. {SAVE_AS_UTF8}")


def _chunks(
    blocks: Iterable[tuple[list[int], list[list[str]]]], width: int, problems: Problems
) -> Iterator[Chunk]:
    """Turn blocks of rows into columns, without rows that are blank or of another length."""
    for lines, rows in blocks:
        if set(map(len, rows)) != {width} or not all(map(any, rows)):
            for problem in _ragged(lines, rows, width):
                problems.add(problem)
            keep = [len(row) == width and any(row) for row in rows]
            lines, rows = list(compress(lines, keep)), list(compress(rows, keep))
        if rows:
            yield Chunk(np.array(lines), tuple(zip(*rows, strict=True)))


def _ragged(lines: Sequence[int], rows: Sequence[Sequence[str]], width: int) -> Iterator[Problem]:
    """One problem for each way in which rows differ from the header in length."""
    kinds: dict[str, list[tuple[int, int]]] = {}
    for line, row in zip(lines, rows, strict=True):
        if len(row) != width and any(map(str.strip, row)):
            kinds.setdefault(why_ragged(row, width), []).append((line, len(row)))
    for remedy, found in kinds.items():
        line, n = found[0]
        text = f"{n} cell{'s' if n > 1 else ''} where the header has {width}. {remedy}"
        first = tuple(line for line, _ in found[:N_LINES])
        yield Problem(line, "", text, kind=remedy, n=len(found), lines=first)


def why_ragged(cells: Sequence[str], width: int) -> str:
    """What to do about a row of another length than the header, by what it looks like."""
    if any(";" in cell for cell in cells):
        return "Separate the cells by commas, not by semicolons."
    if len(cells) > width:
        return "Write decimal points, not decimal commas; put names with a comma in quotes."
    return "Fill in the missing cells; an empty cell needs its comma too."
