"""ECOSTRESS and ASTER spectral library text: header lines ``Name: text``, then two columns."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported, to_number
from pbrdf_bayes.io.formats.conventions import dhr_readings, incidence_deg

NAME = "ecostress"


def recognises(content: Content) -> bool:
    """Lines ``Name:`` and ``Y Units:``."""
    head = content.text[:5000]
    return bool(
        re.search(r"^Name:", head, re.MULTILINE) and re.search(r"^Y Units:", head, re.MULTILINE)
    )


def read(content: Content) -> Imported:
    """DHR at one wavelength, unpolarised, at the angle of the line Measurement.

    Raises
    ------
    DataError
    """
    header: dict[str, str] = {}
    rows = []
    for number, line in enumerate(content.lines, start=1):
        cells = line.split()
        if len(cells) == 2 and to_number(cells[0]) is not None:
            rows.append(content.numbers(cells, line=number, what="reading"))
        elif rows and cells:
            content.refuse(f"line {number}: {line[:40]!r} among the readings")
        elif ":" in line:
            key, _, text = line.partition(":")
            header.setdefault(key.strip().lower(), text.strip())
    if not rows:
        content.refuse("no readings after the header: is the file cut off?")
    announced = header.get("number of x values", "")
    if announced.isdecimal() and int(announced) != len(rows):
        content.refuse(
            f"{len(rows)} readings where the header announces {announced}: is the file cut off?"
        )
    x_unit, y_unit = header.get("x units", "").lower(), header.get("y units", "").lower()
    if "micro" not in x_unit and "um" not in x_unit and "nano" not in x_unit:
        content.refuse(f"X Units: {x_unit[:40]!r} is not micrometres or nanometres")
    if "reflectance" not in y_unit:
        content.refuse(f"Y Units: {y_unit[:40]!r} is not a reflectance")
    measurement = header.get("measurement", "")
    angle = re.search(r"(\d+(?:\.\d+)?) ?deg", measurement, re.IGNORECASE)
    if not re.search(r"hemispher", measurement, re.IGNORECASE):
        content.refuse(
            f"Measurement: {measurement[:60]!r} is not directional hemispherical reflectance"
        )
    x, y = np.array(rows).T
    content.say("credit: data of the ECOSTRESS library require a line of credit")
    theta_i = incidence_deg(content, float(angle[1]) if angle else None)
    return dhr_readings(
        content, content.sample(header.get("name", "")),
        wavelength_um=x * (1e-3 if "nano" in x_unit else 1.0),
        value=y, polarization=content.polarization(None, otherwise="u"), theta_i_deg=theta_i,
        percent=True if "percent" in y_unit or "%" in y_unit else None,
    )  # fmt: skip
