"""Cells of a table: CSV, TSV, semicolons with decimal commas, xlsx and xls."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Callable
from typing import Any

from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.formats.content import Content

XLSX, XLS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
_MOST_ROWS, _MOST_CELLS, _MOST_UNPACKED = 200_000, 2_000_000, 256 * 2**20
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")


def is_workbook(content: Content) -> bool:
    """An xlsx or xls file."""
    return content.data.startswith((XLSX, XLS))


def sheets(content: Content) -> dict[str, list[list[str]]]:
    """Cells of each sheet that has any, rows without blanks at their ends.

    Raises
    ------
    DataError
    """
    try:
        found = _xlsx(content) if content.data.startswith(XLSX) else _xls(content)
    except ImportError as error:
        content.refuse(f"workbooks need the package {error.name}: pip install {error.name}")
    return {name: rows for name, rows in found.items() if rows}


def cells(content: Content) -> list[list[str]]:
    """Cells of a text table, or of the sheet that is decided or the only one.

    Raises
    ------
    DataError
    """
    if not is_workbook(content):
        return _split(content)
    found = sheets(content)
    wanted = content.decided.sheet
    if wanted is not None:
        if wanted not in found:
            content.refuse(
                f"there is no sheet {wanted[:50]!r} with cells (there are: "
                f"{', '.join(found)[:200]})"
            )
        return found[wanted]
    if len(found) > 1:
        content.ask(
            f"the workbook has {len(found)} sheets: {', '.join(found)[:200]}", "--sheet NAME"
        )
    if not found:
        content.refuse("the workbook is empty")
    return next(iter(found.values()))


def is_table(content: Content, test: Callable[[list[list[str]]], bool]) -> bool:
    """Tell whether the cells of a text, or those of any sheet, pass a test."""
    if is_workbook(content):
        return any(test(rows) for rows in sheets(content).values())
    try:
        return bool(content.text) and test(_split(Content(content.path, content.data)))
    except DataError:
        return False


def _split(content: Content) -> list[list[str]]:
    """Cells of text by the separator that most lines have, decimal commas as points."""
    lines = content.lines
    if len(lines) > _MOST_ROWS:
        content.refuse(f"{len(lines)} lines (allowed in a table: up to {_MOST_ROWS})")
    counts = {separator: sum(separator in line for line in lines) for separator in "\t;,"}
    separator = max(counts, key=lambda key: counts[key])
    for better in "\t;":
        if counts[better] >= max(2, 0.6 * counts[separator]):
            separator = better
            break
    if content.text.count(separator) > _MOST_CELLS:
        content.refuse(f"more than {_MOST_CELLS} cells (allowed: up to that)")
    if not counts[separator]:
        rows = [line.split() for line in lines]
    else:
        try:
            rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
        except csv.Error as error:
            content.refuse(f"the cells cannot be told apart ({error})")
    rows = [[cell.strip() for cell in row] for row in rows]
    if separator != "," and any(_DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row):
        content.say("numbers: decimal commas")
        rows = [
            [c.replace(",", ".") if _DECIMAL_COMMA.fullmatch(c) else c for c in row] for row in rows
        ]
    return rows


def _text(value: Any) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value).strip()


def _trim(rows: list[list[str]]) -> list[list[str]]:
    while rows and not any(rows[-1]):
        rows.pop()
    return rows


def _xlsx(content: Content) -> dict[str, list[list[str]]]:
    import openpyxl

    try:
        with zipfile.ZipFile(io.BytesIO(content.data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            if size > _MOST_UNPACKED:
                content.refuse(
                    f"{size // 2**20} MiB unpacked (allowed: up to {_MOST_UNPACKED // 2**20})"
                )
            if "xl/workbook.xml" not in archive.namelist():
                content.refuse("this is a zip archive and no workbook. Unpack it first")
        book = openpyxl.load_workbook(io.BytesIO(content.data), read_only=True, data_only=True)
        found: dict[str, list[list[str]]] = {}
        n = 0
        for sheet in book.worksheets:
            rows: list[list[str]] = []
            for row in sheet.iter_rows(values_only=True):
                rows.append([_text(value) for value in row])
                n += len(row)
                if n > _MOST_CELLS or len(rows) > _MOST_ROWS:
                    content.refuse(f"more than {_MOST_ROWS} rows or {_MOST_CELLS} cells")
            found[sheet.title] = _trim(rows)
    except (ImportError, DataError):
        raise
    except Exception as error:
        content.refuse(f"the workbook cannot be read ({type(error).__name__}): is it cut off?")
    return found


def _xls(content: Content) -> dict[str, list[list[str]]]:
    import xlrd

    try:
        book = xlrd.open_workbook(file_contents=content.data, logfile=io.StringIO())
        return {
            sheet.name: _trim(
                [
                    [_text(sheet.cell_value(r, c)) for c in range(sheet.ncols)]
                    for r in range(sheet.nrows)
                ]
            )
            for sheet in book.sheets()
        }
    except Exception as error:
        content.refuse(f"the workbook cannot be read ({type(error).__name__}): is it cut off?")
