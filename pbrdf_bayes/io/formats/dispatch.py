"""Which reader a file belongs to, by its content; a reader is one file and one line here."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.csv_table import read_bytes
from pbrdf_bayes.io.formats import (
    astm,
    bird,
    cary,
    ecostress,
    fred,
    lighttools,
    perkinelmer,
    rt300s,
    spectrum,
    table,
    zemax,
)
from pbrdf_bayes.io.formats.content import (
    MOST_BYTES,
    MOST_LINES,
    Content,
    Decided,
    Imported,
    UndecidedError,
)
from pbrdf_bayes.io.tidy_columns import COLUMNS, REQUIRED
from pbrdf_bayes.io.tidy_writer import tidy_text
from pbrdf_bayes.quantities import POLARIZATIONS

READERS: tuple[ModuleType, ...] = (
    bird, astm, zemax, lighttools, fred, rt300s, perkinelmer, ecostress, cary, table, spectrum,
)  # fmt: skip
"""In the order in which they are asked; the last two have no mark of their own."""
FORMATS = tuple(reader.NAME for reader in READERS)
_TEXT_INSTEAD = "Export it as text of another format: " + ", ".join(FORMATS)
_NOT_READ = (
    (b"OPTIS - Anisotropic BSDF", "Speos", _TEXT_INSTEAD),
    (b"DataType:\tBRDF(Raywiz)", "RayWiz", _TEXT_INSTEAD),
    (b"tensor_file\0", "Mitsuba or RGL", _TEXT_INSTEAD),
    (b"#DIM ", "ALTA", _TEXT_INSTEAD),
)
_CHOICES = {
    "format": FORMATS, "polarization": POLARIZATIONS, "forward": ("phi0", "phi180"),
    "value": ("brdf", "brf", "brdf_cos"), "unit": ("fraction", "percent"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Foreign:
    """Readings of files in other formats, in the tidy one.

    Attributes
    ----------
    text : str
        A tidy CSV.
    decisions : tuple of str
        What was read how, file by file.
    sha256 : mapping of str to str
        Hash of each file by its name.
    """

    text: str
    decisions: tuple[str, ...]
    sha256: Mapping[str, str]


def is_tidy(data: bytes) -> bool:
    """Tell whether the first line has names of the tidy CSV, whatever separates them."""
    first = data[:65_536].removeprefix(b"\xef\xbb\xbf").splitlines()[:1]
    words = re.split(r"[,;\t|\s]+", first[0].decode("utf-8", "replace")) if first else []
    return len({word.strip('"') for word in words} & set(COLUMNS)) >= 2


def convert(path: str | Path, data: bytes) -> Foreign | None:
    """A file in another format as a tidy CSV; None where no reader knows it.

    Raises
    ------
    DataError
        A reader knows the file, and something is wrong or undecided.
    """
    if is_tidy(data) or len(data) > MOST_BYTES or data.count(b"\n") > MOST_LINES:
        return None
    content = Content(str(path), data)
    reader = _reader_of(content)
    if reader is None:
        return None
    try:
        return _combine([_read(content, reader)])
    except UndecidedError as error:
        msg = f"{error} (options of `pbrdf-bayes import`, which writes a tidy CSV)"
        raise UndecidedError(msg) from None


def import_files(paths: Sequence[str | Path], decided: Decided) -> Foreign:
    """Files of one sample, of any formats, as one tidy CSV.

    Parameters
    ----------
    paths : sequence of str or Path
    decided : Decided

    Returns
    -------
    Foreign

    Raises
    ------
    ConfigError
        The name of a decision is unknown.
    DataError
        A file is in no format that is known, is damaged or leaves something undecided.
    """
    for name, allowed in _CHOICES.items():
        given = getattr(decided, name)
        if given is not None and given not in allowed:
            hint = did_you_mean(given, allowed)
            msg = f"{name} = {given!r} is not allowed.{hint} Allowed: {', '.join(allowed)}"
            raise ConfigError(msg)
    for name, low, high in (("wavelength_um", 1e-3, 1e4), ("theta_i_deg", 0.0, 89.95)):
        number = getattr(decided, name)
        if number is not None and not low <= number <= high:
            msg = f"{name} = {number!r} is not allowed (allowed: {low:g} to {high:g})"
            raise ConfigError(msg)
    if not paths:
        msg = "no files to import"
        raise ConfigError(msg)
    return _combine([_import_one(path, decided) for path in paths])


def _import_one(path: str | Path, decided: Decided) -> tuple[Content, Imported]:
    data = read_bytes(path)
    content = Content(str(path), data, decided)
    if len(data) > MOST_BYTES:
        content.refuse(
            f"larger than {MOST_BYTES // 2**20} MiB (allowed in other formats: up to that)"
        )
    if not data.strip():
        content.refuse("the file is empty")
    if decided.format is not None:
        reader = READERS[FORMATS.index(decided.format)]
        if not reader.recognises(content):
            content.refuse(f"this is not a file of format {decided.format}")
        return _read(content, reader)
    if is_tidy(data):
        content.refuse("this is a tidy CSV: it is read as it is")
    found = _reader_of(content)
    if found is not None:
        return _read(content, found)
    return content.refuse(f"its content is none of the formats {', '.join(FORMATS)}")


def _reader_of(content: Content) -> ModuleType | None:
    """The reader that knows the content; formats that are known and not read are refused."""
    for mark, name, remedy in _NOT_READ:
        if content.data.lstrip().startswith(mark):
            content.refuse(f"this is a {name} file, which is not read. {remedy}")
    return next((reader for reader in READERS if reader.recognises(content)), None)


def _read(content: Content, reader: ModuleType) -> tuple[Content, Imported]:
    content.say(f"format: {reader.NAME}")
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            found: Imported = reader.read(content)
    except FloatingPointError:
        content.refuse("numbers in it are out of range")
    return content, found


def _combine(parts: Sequence[tuple[Content, Imported]]) -> Foreign:
    """One tidy CSV, all files under the name of the first sample."""
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in COLUMNS}
    sample = parts[0][1].columns["sample"][0]
    for _, found in parts:
        n = found.columns["sample"].size
        for name in COLUMNS:
            none = "" if name in ("scan", "flag") else np.nan
            columns[name].append(
                np.broadcast_to(found.columns.get(name, np.array(none)), n).astype(object)
            )
        columns["sample"][-1] = np.full(n, sample, dtype=object)
    joined = {name: np.concatenate(blocks) for name, blocks in columns.items()}
    kept = {
        name: x for name, x in joined.items()
        if name in REQUIRED or not all(v == "" or v != v for v in x.tolist())
    }  # fmt: skip
    text = tidy_text(kept)
    several = len(parts) > 1
    said = tuple(
        f"{Path(content.path).name}: {text}" if several else text
        for content, _ in parts
        for text in content.said
    )
    return Foreign(
        text, said, {Path(c.path).name: hashlib.sha256(c.data).hexdigest() for c, _ in parts}
    )
