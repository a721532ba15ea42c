"""Rows of a tidy CSV that cannot be read, taken out so that the others can be.

A row is taken out where it is a line of its own: no quoted cell reaches over its ends. Where the
quotes do not tell that, nothing is, for then no row of the file can be trusted.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pbrdf_bayes.io.csv_table import MAX_LINE_BYTES, MAX_ROWS, SAVE_AS_UTF8, why_ragged
from pbrdf_bayes.io.formulas import unguard
from pbrdf_bayes.io.problems import Problem, Problems
from pbrdf_bayes.io.tidy_columns import MOST_SAMPLES
from pbrdf_bayes.measurement import is_name


@dataclass(frozen=True)
class SetAside:
    """A file without the rows that cannot be read, and what was wrong with these.

    Attributes
    ----------
    data : bytes
        The file with an empty line for each of them.
    problems : Problems
        By sample; "" where the name cannot be told.
    """

    data: bytes
    problems: Problems


@dataclass(frozen=True)
class _Row:
    line: int
    cells: Sequence[str]
    wrong: str
    kind: str = ""


def set_aside(data: bytes) -> SetAside:
    """Take out rows that are no text, too long, of another length than the header, or nameless.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Returns
    -------
    SetAside
        Without problems where there is no such row, or none that can be taken out.
    """
    problems = Problems()
    lines = data.splitlines(keepends=True) if data.count(b"\n") <= MAX_ROWS else []
    header = _cells(lines[0].removeprefix(b"\xef\xbb\xbf")) if lines else []
    if "sample" not in header or b'"' in lines[0] or len(lines) > MAX_ROWS + 1:
        return SetAside(data, problems)
    place = header.index("sample")
    names: set[str] = set()
    found: list[_Row] = []
    for row in _rows(lines, header):
        if row.wrong:
            found.append(row)
            lines[row.line - 1] = b"\n"
        elif len(names) < MOST_SAMPLES:
            names.add(row.cells[place])
    for row in found:
        sample = _owner(row, place, names)
        if len(problems.found) > MOST_SAMPLES and sample not in problems.found:
            sample = ""
        problems.add(Problem(row.line, "", row.wrong, sample, kind=row.kind))
    return SetAside(b"".join(lines) if found else data, problems)


def _rows(lines: Sequence[bytes], header: Sequence[str]) -> Iterator[_Row]:
    """Rows that are a line each, the header left out."""
    place, flag = header.index("sample"), header.index("flag") if "flag" in header else None
    inside = False
    for number, line in enumerate(lines, start=1):
        quotes = line.count(b'"') % 2
        if number > 1 and not inside and not quotes and line.strip():
            cells = _cells(line)
            wrong, kind = _wrong(line, cells, len(header))
            used = flag is None or len(cells) <= flag or cells[flag].lower() in ("", "ok")
            if not wrong and not cells[place] and used and any(cells):
                wrong = "column sample is empty. Give the name of the paint sample."
            yield _Row(number, cells, wrong, kind)
        inside ^= bool(quotes)


def _wrong(line: bytes, cells: Sequence[str], width: int) -> tuple[str, str]:
    """What is wrong with a line, and what that has in common with others; empty where nothing."""
    if len(line.rstrip(b"\r\n")) > MAX_LINE_BYTES:
        what = f"the line is longer than {MAX_LINE_BYTES} bytes."
        return f"{what} This is not one reading a line: check how the file was exported.", what
    if b"\0" in line:
        return f"the line has a zero byte. {SAVE_AS_UTF8}", ""
    try:
        line.decode("utf-8")
    except UnicodeDecodeError as error:
        return f"byte 0x{line[error.start]:02X} is not UTF-8. {SAVE_AS_UTF8}", SAVE_AS_UTF8
    if len(cells) != width and any(cells):
        why, n = why_ragged(cells, width), len(cells)
        return f"{n} cell{'s' * (n != 1)} where the header has {width}. {why}", why
    return "", ""


def _cells(line: bytes) -> list[str]:
    """Cells of a line by themselves, blanks and formula guards left out."""
    text = line[:MAX_LINE_BYTES].decode("utf-8", "surrogateescape")
    row = next(csv.reader([text], skipinitialspace=True), [])
    return [unguard(cell.strip()) for cell in row]


def _owner(row: _Row, place: int, names: set[str]) -> str:
    """Sample of a row; "" where its cell is damaged, or may be another one that has shifted."""
    cells = row.cells
    if any(";" in cell for cell in cells):
        cells = [cell.strip() for cell in ",".join(cells).split(";")]
    name = cells[place] if place < len(cells) else ""
    return name if is_name(name) and (place == 0 or name in names) else ""
