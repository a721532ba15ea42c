"""J&C RT-300S: the workbook, the .jdv text and the STIL REFLET text.

Workbook: readings are columns, labels (Azimuth, Incidence, Receive, RT) stand in column A; in plane
is azimuth -90, Receive is signed, + on the specular side. RT is the signal, not a BRDF: without
a blank the user has to say that RT / (pi cos theta_r) is good enough (``--value brdf_cos`` takes RT
as pi BRDF cos theta_r). Text: sections of one incidence, a row of angles, rows of azimuths.
"""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported, to_number
from pbrdf_bayes.io.formats.conventions import brdf_readings, directions, to_brdf
from pbrdf_bayes.io.formats.spreadsheet import is_workbook, sheets

NAME = "rt300s"
_LABELS = ("azimuth", "incidence", "receive")
_IN_PLANE_DEG = -90.0


def recognises(content: Content) -> bool:
    """The labels of the workbook, or the first words of one of its texts."""
    if is_workbook(content):
        return any(_labels(rows) for rows in sheets(content).values())
    return re.match(r"\s*DataType:\s*BRDF\(RT-300S\)|\s*Name / Comment :", content.head) is not None


def _labels(rows: list[list[str]]) -> dict[str, int]:
    """Row of each label in the first column; empty where one is missing."""
    found = {
        row[0].strip().lower(): i for i, row in reversed(list(enumerate(rows))) if row and row[0]
    }
    return found if all(name in found for name in _LABELS) else {}


def read(content: Content) -> Imported:
    """Signal of each reading as a BRDF.

    Raises
    ------
    DataError
    """
    rows = _from_workbook(content) if is_workbook(content) else _from_text(content)
    if not rows:
        content.refuse("no readings in it")
    azimuth, theta_i, theta_r, value = np.array(rows, dtype=np.float64).T
    if np.any(np.abs(theta_i) > 90.0) or np.any(np.abs(theta_r) > 90.0):
        content.refuse("an angle is beyond 90 deg")
    if content.decided.value is None and is_workbook(content):
        content.ask("RT is a signal, not a BRDF: subtract the blank, or decide what it is",
                    "--value brdf, brf (pi BRDF) or brdf_cos (BRDF cos theta_r)")  # fmt: skip
    value = to_brdf(content, value, theta_r, None if is_workbook(content) else "brdf")
    wavelength, polarization = (
        content.wavelength_um(None),
        content.polarization(None, otherwise="u"),
    )
    content.say(
        "azimuth: -90 is the plane of incidence; near theta_r = -theta_i the detector is in the way"
    )
    signed, plane = directions(
        content, theta_i, theta_r, azimuth - _IN_PLANE_DEG, value, forward="phi0"
    )
    return brdf_readings(
        content, content.sample(), wavelength_um=wavelength, polarization=polarization,
        theta_i_deg=theta_i, theta_r_deg=signed, phi_r_deg=plane, value=value,
    )  # fmt: skip


def _from_workbook(content: Content) -> list[tuple[float, ...]]:
    found: list[tuple[float, ...]] = []
    for name, rows in sheets(content).items():
        labels = _labels(rows)
        if not labels or (content.decided.sheet or name) != name:
            continue
        signal = labels.get("rt")
        if signal is None:
            content.refuse(f"sheet {name[:50]!r} has no row 'RT'")
        for column in range(1, len(rows[labels["azimuth"]])):
            picked = [rows[labels[label]] for label in _LABELS] + [rows[signal]]
            cells = [row[column] if column < len(row) else "" for row in picked]
            if any(cells):
                found.append(tuple(content.numbers(cells, line=labels["azimuth"] + 1, what="cell")))
    return found


def _from_text(content: Content) -> list[tuple[float, ...]]:
    """Sections of the .jdv text or of the REFLET text."""
    found: list[tuple[float, ...]] = []
    incidence: float | None = None
    angles: list[float] = []
    azimuths: list[float] = []
    in_rows = reflet = False
    given: dict[str, float] = {}
    for number, line in enumerate(content.lines, start=1):
        cells = [cell.strip() for cell in line.split("\t")]
        key = cells[0].rstrip(": ")
        if re.match(r"(Phi measure|Theta Lighting|Incidence|DataType|Name / Comment)", key):
            in_rows, angles = False, []
        if key.startswith("Phi measure"):
            given[key.rsplit(" ", 1)[-1]] = content.number(
                cells[1] if len(cells) > 1 else "", line=number, what=key
            )
        elif key in ("Incidence", "Theta Lighting"):
            incidence = content.number(cells[1] if len(cells) > 1 else "", line=number, what=key)
            reflet = key == "Theta Lighting"
            if reflet:
                azimuths, in_rows = _steps(content, given), True
        elif key == "Raw data":
            in_rows, reflet = True, False
        elif in_rows and any(cells):
            numbers = [to_number(cell) for cell in cells if cell]
            if not reflet and not angles:
                angles = content.numbers(
                    [cell for cell in cells if cell], line=number, what="polar angle"
                )
                continue
            width = len(azimuths if reflet else angles)
            if None in numbers or len(numbers) != width + 1 or incidence is None:
                content.refuse(
                    f"line {number}: {len(numbers)} numbers where {width + 1} are expected"
                )
            first, values = numbers[0], numbers[1:]
            for other, value in zip(azimuths if reflet else angles, values, strict=True):
                azimuth, theta = (other, first) if reflet else (first, other)
                found.append(
                    (float(azimuth or 0.0), incidence, float(theta or 0.0), float(value or 0.0))
                )
    return found


def _steps(content: Content, given: dict[str, float]) -> list[float]:
    """Azimuths from beginning, end and step."""
    missing = [name for name in ("beginning", "end", "step") if name not in given]
    if (
        missing
        or given["step"] <= 0
        or not 0 <= (given["end"] - given["beginning"]) / given["step"] <= 10_000
    ):
        content.refuse("'Phi measure beginning', 'end' and 'step' do not give the azimuths")
    n = round((given["end"] - given["beginning"]) / given["step"]) + 1
    return [given["beginning"] + i * given["step"] for i in range(n)]
