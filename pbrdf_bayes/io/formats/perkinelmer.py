"""PerkinElmer Lambda: UV WinLab .asc (numbered header, #GR, #DATA) and its CSV."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported, named_polarization
from pbrdf_bayes.io.formats.conventions import dhr_readings, incidence_deg

NAME = "perkinelmer"
_POLARISER_LINE = 49


def recognises(content: Content) -> bool:
    """``PE UV`` or the blocks #GR and #DATA; for CSV a second line nm with %R, %T or A."""
    if re.match(r"PE (UV|IR|FL)\b", content.head):
        return True
    if (
        re.search(r"^#GR$", content.text[:20_000], re.MULTILINE)
        and "#DATA" in content.text[:20_000]
    ):
        return True
    return bool(re.match(r"Created as New Dataset[,;]*\n\"?nm\"?\s*[,;]", content.head))


def read(content: Content) -> Imported:
    """DHR at one wavelength.

    Raises
    ------
    DataError
    """
    lines = content.lines
    csv = content.head.startswith("Created as New Dataset")
    if csv:
        units = [cell.strip().strip('"') for cell in re.split(r"[,;]", lines[1])][:2]
        start, name = 2, ""
        decimal_comma = ";" in lines[1]
    else:
        marks = {
            line.strip(): i for i, line in reversed(list(enumerate(lines))) if line.startswith("#")
        }
        if "#GR" not in marks or "#DATA" not in marks:
            content.refuse("#GR or #DATA is missing: is the file cut off?")
        units = [line.strip() for line in lines[marks["#GR"] + 1 : marks["#GR"] + 3]]
        start, name, decimal_comma = (
            marks["#DATA"] + 1,
            lines[8].strip() if len(lines) > 8 else "",
            True,
        )
        announced = lines[marks["#GR"] + 7].strip() if marks["#GR"] + 7 < len(lines) else ""
    if len(units) < 2 or units[0].lower() not in ("nm", "um", "\u00b5m"):
        content.refuse(f"the unit of x is {''.join(units[:1])[:20]!r} (allowed: nm, um)")
    if units[1].upper() not in ("%R", "R"):
        content.refuse(f"the readings are {units[1][:20]!r}, not a reflectance (%R)")
    rows = []
    for number, line in enumerate(lines[start:], start=start + 1):
        if not line.strip(" ,;\t"):
            continue
        separator = "\t" if "\t" in line else ";" if ";" in line else "," if csv else None
        cells = [cell.strip() for cell in line.split(separator) if cell.strip()]
        if decimal_comma:
            cells = [cell.replace(",", ".") for cell in cells]
        if len(cells) != 2:
            content.refuse(f"line {number}: {len(cells)} numbers where 2 are expected")
        rows.append(content.numbers(cells, line=number, what="reading"))
    if not rows:
        content.refuse("no readings after #DATA: is the file cut off?")
    if not csv and announced.isdecimal() and int(announced) != len(rows):
        content.refuse(
            f"{len(rows)} readings where the header announces {announced}: is the file cut off?"
        )
    x, y = np.array(rows).T
    named = named_polarization(name) or _word(name)
    if (
        not csv
        and len(lines) > _POLARISER_LINE
        and (angle := lines[_POLARISER_LINE - 1].strip()) not in ("", "-1")
    ):
        content.say(
            f"polariser: line {_POLARISER_LINE} says {angle[:40]!r}; the set-up decides which is s"
        )
    match = re.search(r"(\d+(?:\.\d+)?) ?(?:deg|\u00b0)", name)
    theta_i = incidence_deg(content, float(match[1]) if match else None)
    return dhr_readings(
        content, content.sample(), wavelength_um=x * (1e-3 if units[0].lower() == "nm" else 1.0),
        value=y, polarization=content.polarization(named), theta_i_deg=theta_i,
        percent=units[1].startswith("%"),
    )  # fmt: skip


def _word(name: str) -> str | None:
    """A description that ends in a polarisation alone, such as ``paint 8 deg s``."""
    found = re.search(r"(?:deg|\u00b0) ([spu])$", name)
    return found[1] if found else None
