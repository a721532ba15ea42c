"""ASTM E1392 text: lines KEY value, VARS, rows in radians; phi_s - phi_i = pi is forward."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import (
    Content,
    Imported,
    keyed_lines,
    named_polarization,
    named_wavelength_um,
)
from pbrdf_bayes.io.formats.conventions import brdf_readings, directions, to_brdf

NAME = "astm"
_ANGLES = ("theta_i", "phi_i", "theta_s", "phi_s")


def recognises(content: Content) -> bool:
    """A line VARS with theta_i."""
    return re.search(r"^VARS\s+.*theta_i", content.text[:20_000], re.MULTILINE) is not None


def read(content: Content) -> Imported:
    """BRDF of each value column that is a wavelength, or of the only one.

    Raises
    ------
    DataError
    """
    header: dict[str, str] = {}
    start, names = 0, []
    for number, key, rest in keyed_lines(content.lines):
        header[key] = rest
        if key == "VARS":
            start, names = number, [name.strip() for name in rest.split(",")]
            break
    width = 0
    rows = []
    for number, line in enumerate(content.lines[start:], start=start + 1):
        if not line.strip():
            continue
        cells = [cell for cell in re.split(r"[,\s]+", line.strip()) if cell]
        width = width or len(cells)
        if len(cells) != width:
            content.refuse(f"line {number}: {len(cells)} numbers where the first row has {width}")
        rows.append(content.numbers(cells, line=number, what="cell"))
    if not rows:
        content.refuse("no rows after VARS")
    if (
        names[:3] == ["theta_i", "phi_i", "theta_s"]
        and "phi_s" not in names
        and width == len(names) + 1
    ):
        content.say("columns: VARS leaves out phi_s, taken as the fourth")
        names.insert(3, "phi_s")
    if width != len(names):
        content.refuse(f"VARS names {len(names)} columns and the rows have {width}")
    missing = [name for name in _ANGLES if name not in names]
    if missing:
        content.refuse(f"VARS lacks {', '.join(missing)}")
    table = np.array(rows)
    declared = header.get("NUM_POINTS", "")
    if declared.isdecimal() and int(declared) != len(table):
        content.say(f"rows: {len(table)}, although NUM_POINTS says {declared}: cut off?")
    angles = {name: np.degrees(table[:, names.index(name)]) for name in _ANGLES}
    if any(np.any(np.abs(angles[name]) > 90.01) for name in ("theta_i", "theta_s")):
        content.refuse("theta_i or theta_s is beyond pi / 2: the format has radians")
    theta_i, theta_s = (np.round(angles[name], 4) for name in ("theta_i", "theta_s"))
    azimuth = np.round(angles["phi_s"] - angles["phi_i"], 3)
    words = " ".join(header.get(key, "") for key in ("LAB_COMMENTS", "FILE_NAME", "MEAS_NAME"))
    polarization = content.polarization(named_polarization(words), otherwise="u")
    values = [name for name in names if name not in _ANGLES]
    of_wavelength = {name: w for name in values if (w := named_wavelength_um(name)) is not None}
    if not of_wavelength:
        if len(values) != 1 and {name.upper() for name in values} & {"R", "X"}:
            content.refuse(
                f"the values are colours ({', '.join(values)}), not those of a wavelength"
            )
        of_wavelength = {values[0]: content.wavelength_um(None)}
    if len(of_wavelength) < len(values):
        content.say(f"columns: {', '.join(of_wavelength)} of {', '.join(values)[:100]} are read")
    if len(of_wavelength) == 1:
        (one,) = of_wavelength
        of_wavelength = {one: content.wavelength_um(of_wavelength[one])}
    n, m = len(table), len(of_wavelength)
    value = np.concatenate([table[:, names.index(name)] for name in of_wavelength])
    theta, phi = directions(content, np.tile(theta_i, m), np.tile(theta_s, m), np.tile(azimuth, m),
                            value, forward="phi180")  # fmt: skip
    return brdf_readings(
        content, content.sample(header.get("SAMPLE_NAME", "")),
        wavelength_um=np.repeat(list(of_wavelength.values()), n), polarization=polarization,
        theta_i_deg=np.tile(theta_i, m), theta_r_deg=theta, phi_r_deg=phi,
        value=to_brdf(content, value, theta, "brdf"),
    )  # fmt: skip
