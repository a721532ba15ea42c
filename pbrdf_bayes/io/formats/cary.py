"""Agilent Cary WinUV batch CSV: two columns a sample, percent, a log below the readings."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.io.formats.content import Content, Imported, named_polarization, to_number
from pbrdf_bayes.io.formats.conventions import dhr_readings, incidence_deg

NAME = "cary"
_MICROMETRES = {"nm": 1e-3, "\u00b5m": 1.0, "um": 1.0}


def recognises(content: Content) -> bool:
    """A second line of pairs: a wavelength and %R, %T or Abs."""
    lines = content.lines[:2]
    return len(lines) == 2 and bool(
        re.match(
            r'"?(Wavelength \((nm|um|\u00b5m)\)|nm)"?[,;]"?(%R|%T|Abs|R)\b', lines[1], re.IGNORECASE
        )
    )


def read(content: Content) -> Imported:
    """DHR of one sample at one wavelength.

    Raises
    ------
    DataError
    """
    separator = ";" if content.lines[1].count(";") > content.lines[1].count(",") else ","
    names, heads = (
        [cell.strip().strip('"') for cell in line.split(separator)] for line in content.lines[:2]
    )
    pairs = [i for i in range(0, len(heads) - 1, 2) if heads[i]]
    of_name = {(names[i] if i < len(names) else "") or f"column {i + 1}": i for i in pairs}
    samples = [name for name in of_name if not name.lower().startswith("baseline")]
    wanted = content.decided.sample
    if wanted is None and len(samples) != 1:
        content.ask(
            f"the file has {len(samples)} samples: {', '.join(samples)[:300]}", "--sample NAME"
        )
    if wanted is not None and wanted not in of_name and len(samples) != 1:
        content.refuse(f"there is no sample {wanted[:80]!r}.{did_you_mean(wanted, of_name)} "
                       f"The file has: {', '.join(samples)[:300]}")  # fmt: skip
    name = wanted if wanted in of_name else samples[0]
    at = of_name[name]
    unit, quantity = heads[at], heads[at + 1]
    if not re.fullmatch(r"%?R", quantity, re.IGNORECASE):
        content.refuse(f"column {name[:80]!r} has {quantity[:20]!r}, not a reflectance (%R)")
    x: list[float] = []
    y: list[float] = []
    for number, line in enumerate(content.lines[2:], start=3):
        cells = [cell.strip() for cell in line.split(separator)]
        if not any(cells):
            break
        if at + 1 >= len(cells) or not (cells[at] or cells[at + 1]):
            continue
        pair = cells[at : at + 2]
        if separator == ";":
            pair = [cell.replace(",", ".") for cell in pair]
        if to_number(pair[0]) is None and not x:
            content.refuse(f"line {number}: {pair[0][:30]!r} is not a wavelength")
        found = content.numbers(pair, line=number, what="reading")
        x.append(found[0])
        y.append(found[1])
    if not x:
        content.refuse(f"no readings of {name[:80]!r}")
    match = re.search(r"nm|um|\u00b5m", unit, re.IGNORECASE)
    factor = _MICROMETRES[match[0].lower()] if match else 1e-3
    content.say(f"sample: column {name}")
    theta_i = incidence_deg(content, None)
    polarization = content.polarization(named_polarization(name))
    return dhr_readings(
        content, content.sample(name), wavelength_um=np.array(x) * factor, value=np.array(y),
        polarization=polarization, theta_i_deg=theta_i, percent=quantity.startswith("%"),
    )  # fmt: skip
