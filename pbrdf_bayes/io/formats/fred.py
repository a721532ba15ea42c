"""FRED tabulated BSDF: sections of one incidence each; theta_scat signed, + and phi 0 specular."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported
from pbrdf_bayes.io.formats.conventions import brdf_readings, directions, to_brdf

NAME = "fred"
_WORDS = {"angles": ("deg", "sin"), "bsdf": ("value", "log")}


def recognises(content: Content) -> bool:
    """First line ``type bsdf_data``."""
    return re.match(r"\s*type\s+bsdf_data\b", content.head, re.IGNORECASE) is not None


def read(content: Content) -> Imported:
    """BRDF of all sections.

    Raises
    ------
    DataError
    """
    options: dict[str, str] = {}
    section: tuple[float, float] | None = None
    n_rows = 0
    rows: list[tuple[float, float, float, float, float]] = []
    for number, line in enumerate(content.lines[1:], start=2):
        words = [word for word in re.split(r"[,\s]+", line.partition("!")[0].strip()) if word]
        if not words:
            continue
        if words[0].lower() == "format":
            options = dict(w.lower().split("=", 1) for w in words[1:] if "=" in w)
            continue
        numbers = content.numbers(words, line=number, what="cell")
        if len(numbers) == 2:
            if section is not None and not n_rows:
                content.refuse(f"line {number}: the section before has no rows")
            n_rows = 0
            section = numbers[0], numbers[1]
        elif len(numbers) != 3:
            content.refuse(
                f"line {number}: {len(numbers)} numbers (2 begin a section, 3 are a row)"
            )
        elif section is None:
            content.refuse(f"line {number}: a row before the first section")
        else:
            n_rows += 1
            rows.append((*section, numbers[0], numbers[1], numbers[2]))
    if not rows or not n_rows:
        content.refuse("no rows in the last section: is the file cut off?")
    table = np.array(rows)
    value = table[:, 4]
    unknown = {
        key: text for key, text in options.items()
        if text not in _WORDS.get(key, ()) and key not in ("scale", "exclude", "num")
    }  # fmt: skip
    if unknown:
        content.refuse(
            f"the line 'format' has {unknown}: angles=deg|sin and bsdf=value|log are read"
        )
    if options.get("bsdf") == "log":
        if np.any(np.abs(value) > 30.0):
            content.refuse("bsdf=log has exponents beyond 30")
        value = 10.0**value
    if "scale" in options:
        scale = content.number(options["scale"], line=2, what="scale")
        value = value * scale
        if scale != 1.0:
            content.say(f"scale: values are multiplied by {scale:g}")
    if "exclude" in options:
        left = value != content.number(options["exclude"], line=2, what="exclude")
        content.say(f"dropped: {np.count_nonzero(~left)} rows with the value that is excluded")
        table, value = table[left], value[left]
    if options.get("angles") == "sin":
        # alpha = sin theta sin phi across, beta = sin theta cos phi in plane.
        across, along = table[:, 2], table[:, 3]
        along_i = np.hypot(table[:, 0], table[:, 1])
        size = np.hypot(across, along)
        if np.any(size > 1.0 + 1e-9) or np.any(along_i > 1.0):
            content.refuse("angles=sin has direction cosines beyond 1: are these degrees?")
        theta_i = np.round(np.degrees(np.arcsin(along_i)), 4)
        theta = np.round(np.degrees(np.arcsin(np.minimum(size, 1.0))), 4)
        azimuth = np.round(np.degrees(np.arctan2(across, along)), 4)
        content.say("angles: direction cosines")
    else:
        if np.any(np.abs(table[:, [0, 2]]) > 90.0):
            content.refuse("an angle is beyond 90 deg")
        theta_i, theta, azimuth = table[:, 0], table[:, 2], table[:, 3] - table[:, 1]
    wavelength, polarization = (
        content.wavelength_um(None),
        content.polarization(None, otherwise="u"),
    )
    signed, plane = directions(content, theta_i, theta, azimuth, value, forward="phi0")
    return brdf_readings(
        content, content.sample(), wavelength_um=wavelength, polarization=polarization,
        theta_i_deg=theta_i, theta_r_deg=signed, phi_r_deg=plane,
        value=to_brdf(content, value, signed, "brdf"),
    )  # fmt: skip
