"""LightTools BSDF: absolute polar angles; light from azimuth POI 90, so that 270 is specular."""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported, numbered_words
from pbrdf_bayes.io.formats.conventions import (
    SAME_BAND,
    brdf_readings,
    directions,
    to_brdf,
    with_dhr,
)

NAME = "lighttools"
_KEYS = ("aoi", "poi", "side", "wavelength", "scattertype", "tristimulusvalue", "tis")
_MOST_CELLS = 1_000_000


def recognises(content: Content) -> bool:
    """ScatterRadial and blocks with AOI, but no AngleOfIncidence."""
    text = content.text[:20_000]
    return "AngleOfIncidence" not in text and all(
        re.search(rf"^\s*{word}\b", text, re.MULTILINE) for word in ("ScatterRadial", "AOI")
    )


def read(content: Content) -> Imported:
    """BRDF and TIS of the front side.

    Raises
    ------
    DataError
    """
    words = numbered_words(content)
    lists: dict[str, np.ndarray] = {}
    at = 0
    while at < len(words) and words[at][1].lower() != "databegin":
        word = words[at][1].lower()
        if word in ("scatterazimuth", "scatterradial"):
            count = words[at + 1][1] if at + 1 < len(words) else ""
            if not count.isdecimal() or not 1 <= int(count[:9]) <= 100_000:
                content.refuse(f"line {words[at][0]}: {word} needs the number of its entries")
            cells = words[at + 2 : at + 2 + int(count)]
            lists[word] = np.array([content.number(c, line=n, what=word) for n, c in cells])
            at += 1 + int(count)
        elif (
            word == "spectralcontent"
            and at + 1 < len(words)
            and words[at + 1][1].lower() != "monochrome"
        ):
            content.refuse("SpectralContent is not Monochrome: colours are no BRDF of a wavelength")
        at += 1
    if len(lists) < 2 or at >= len(words):
        content.refuse("ScatterAzimuth, ScatterRadial or DataBegin is missing")
    azimuth, radial = lists["scatterazimuth"], lists["scatterradial"]
    if np.any(np.abs(radial) > 90.0):
        content.refuse("ScatterRadial is beyond 90 deg: these are polar angles in this format")
    n_cells = azimuth.size * radial.size
    at += 1
    found: list[tuple[float, float, float, float, np.ndarray]] = []
    keys: dict[str, str] = {}
    while at < len(words) and words[at][1].lower() != "dataend":
        number, word = words[at]
        if word.lower() in _KEYS:
            keys[word.lower()] = words[at + 1][1] if at + 1 < len(words) else ""
            at += 2
            continue
        cells = words[at : at + n_cells]
        if len(cells) < n_cells:
            content.refuse(f"line {number}: {len(cells)} values where a block has {n_cells}")
        value = np.array([content.number(cell, line=line, what="value") for line, cell in cells])
        at += n_cells
        if (
            keys.get("scattertype", "brdf").lower() != "brdf"
            or keys.get("side", "front").lower() != "front"
        ):
            continue
        aoi = content.number(keys.get("aoi", ""), line=number, what="AOI")
        poi = content.number(keys.get("poi", "90"), line=number, what="POI")
        nm = (
            content.number(keys["wavelength"], line=number, what="Wavelength")
            if "wavelength" in keys
            else np.nan
        )
        tis = content.number(keys["tis"], line=number, what="TIS") if "tis" in keys else np.nan
        found.append((0.0 if aoi > 90.0 else aoi, poi, nm, tis, value))
        if len(found) * n_cells > _MOST_CELLS:
            content.refuse(f"more than {_MOST_CELLS} values")
    if at >= len(words):
        content.refuse("DataEnd is missing: is the file cut off?")
    if not found:
        content.refuse("no block of BRDF on the front side")
    wavelengths = sorted({block[2] for block in found if np.isfinite(block[2])})
    if len(wavelengths) > 1:
        wanted = content.decided.wavelength_um
        if wanted is None:
            what = f"the file has {len(wavelengths)} wavelengths (nm: {wavelengths[:5]})"
            content.ask(what, "--wavelength-um X")
        near = min(wavelengths, key=lambda nm: abs(nm / 1000.0 - wanted))
        if abs(near / 1000.0 / wanted - 1.0) > SAME_BAND:
            content.refuse(f"{wanted:g} um was not measured, the next is {near / 1000.0:g} um")
        content.say(f"wavelength: the blocks of {near:g} nm")
        found = [block for block in found if block[2] == near]
        wavelengths = [near]
    wavelength = content.wavelength_um(wavelengths[0] / 1000.0 if wavelengths else None)
    polarization = content.polarization(None, otherwise="u")
    n = len(found)
    theta_i = np.repeat([block[0] for block in found], n_cells)
    light = np.repeat([block[1] for block in found], n_cells)
    phi, theta = (x.ravel() for x in np.meshgrid(azimuth, radial, indexing="ij"))
    readings = np.concatenate([block[4] for block in found])
    theta, phi = np.tile(theta, n), np.tile(phi, n)
    signed, plane = directions(content, theta_i, theta, phi - light, readings, forward="phi180")
    same = np.concatenate([(theta[:n_cells] == 0.0) & (np.arange(n_cells) >= radial.size)] * n)
    rows = brdf_readings(
        content, content.sample(), wavelength_um=wavelength, polarization=polarization,
        theta_i_deg=theta_i[~same], theta_r_deg=signed[~same], phi_r_deg=plane[~same],
        value=to_brdf(content, readings, signed, "brdf")[~same],
    )  # fmt: skip
    return with_dhr(
        content, rows, [b[0] for b in found], [b[3] for b in found], polarization, wavelength
    )
