"""Zemax tabular BSDF: angles from the specular direction; azimuth 0 is towards the normal.

With s the specular direction, t towards the normal in the plane and y across it, a cell of radial
angle R and azimuth A is d = cos R s + sin R (cos A t + sin A y), so that in plane theta_r is
theta_i - R for A = 0 and theta_i + R for A = 180 deg. TIS is the DHR at that incidence.
"""

from __future__ import annotations

import re

import numpy as np

from pbrdf_bayes.io.formats.content import Content, Imported, numbered_words
from pbrdf_bayes.io.formats.conventions import brdf_readings, directions, to_brdf, with_dhr

NAME = "zemax"
_LISTS = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
_MOST_CELLS = 1_000_000


def recognises(content: Content) -> bool:
    """The keywords of the header, but not AOI of LightTools."""
    head = content.text[:20_000]
    return all(re.search(rf"^\s*{word}\b", head, re.MULTILINE | re.IGNORECASE) for word in
               ("AngleOfIncidence", "ScatterRadial"))  # fmt: skip


def read(content: Content) -> Imported:
    """BRDF in the directions of the grid above the surface, and the TIS as DHR.

    Raises
    ------
    DataError
    """
    words = numbered_words(content)
    at, header, lists = 0, {}, {}
    while at < len(words) and words[at][1].lower() != "databegin":
        number, word = words[at]
        name = next((name for name in _LISTS if name.lower() == word.lower()), None)
        if name is None:
            if at + 1 < len(words) and words[at + 1][0] == number:
                header[word.lower()] = words[at + 1][1].lower()
                at += 1
            at += 1
            continue
        count = _count(content, words, at + 1, name)
        cells = words[at + 2 : at + 2 + count]
        if len(cells) < count:
            content.refuse(f"line {number}: {name} announces {count} numbers and the file ends")
        lists[name] = [content.number(cell, line=line, what=name) for line, cell in cells]
        at += 2 + count
    missing = [name for name in _LISTS[1:] if name not in lists]
    if missing or at >= len(words):
        content.refuse(f"{', '.join(missing) or 'DataBegin'} is missing")
    if header.get("scattertype", "brdf") != "brdf":
        content.refuse(f"ScatterType is {header['scattertype']}, not BRDF")
    if header.get("spectralcontent", "monochrome") != "monochrome":
        content.refuse("SpectralContent is not Monochrome: colours are no BRDF of a wavelength")
    rotations = lists.get("SampleRotation", [0.0])
    if len(rotations) > 1:
        content.say(f"rotation: the first of {len(rotations)}, {rotations[0]:g} deg, is read")
    incidence = np.array(lists["AngleOfIncidence"])
    if np.any((incidence < 0.0) | (incidence > 90.0)):
        content.refuse("AngleOfIncidence is outside 0 to 90 deg")
    azimuth, radial = np.array(lists["ScatterAzimuth"]), np.array(lists["ScatterRadial"])
    n_cells = azimuth.size * radial.size
    if n_cells * incidence.size > _MOST_CELLS:
        content.refuse(f"{n_cells * incidence.size} cells (allowed: up to {_MOST_CELLS})")
    at += 1
    tis, blocks = [], []
    for angle in incidence.tolist():
        if at >= len(words) or words[at][1].lower() != "tis":
            where = f"line {words[at][0]}" if at < len(words) else "the end of the file"
            content.refuse(f"{where}: 'TIS' is missing before the cells of {angle:g} deg")
        cells = words[at + 1 : at + 2 + n_cells]
        numbers = [content.number(cell, line=line, what="cell") for line, cell in cells]
        if len(numbers) < n_cells + 1:
            content.refuse(f"the cells of {angle:g} deg end early: {len(numbers) - 1} of {n_cells}")
        tis.append(numbers[0])
        blocks.append(numbers[1:])
        at += 2 + n_cells
    if at >= len(words):
        content.refuse("DataEnd is missing: is the file cut off?")
    if words[at][1].lower() not in ("dataend", "tis"):
        content.refuse(f"line {words[at][0]}: more cells than the header announces")
    sample = content.sample()
    wavelength, polarization = (
        content.wavelength_um(_wavelength(content)),
        content.polarization(None, otherwise="u"),
    )
    i, a, r = (x.ravel() for x in np.meshgrid(np.radians(incidence), np.radians(azimuth),
                                              np.radians(radial), indexing="ij"))  # fmt: skip
    x = np.cos(r) * np.sin(i) - np.sin(r) * np.cos(a) * np.cos(i)
    y = np.sin(r) * np.sin(a)
    z = np.cos(r) * np.cos(i) + np.sin(r) * np.cos(a) * np.sin(i)
    value = np.array(blocks).ravel()
    above = z > 1e-9
    same = np.zeros(value.size, dtype=bool)
    same[:] = (r == 0.0) & (a != a[0])
    keep = above & ~same
    content.say(f"dropped: {np.count_nonzero(~above)} cells below the horizon, "
                f"{np.count_nonzero(above & same)} repeats of the specular direction")  # fmt: skip
    theta = np.round(np.degrees(np.arccos(np.clip(z[keep], -1.0, 1.0))), 6)
    phi = np.round(np.degrees(np.arctan2(y[keep], x[keep])), 6)
    theta_i = np.repeat(incidence, n_cells)[keep]
    signed, plane = directions(content, theta_i, theta, phi, value[keep], forward="phi0")
    rows = brdf_readings(
        content, sample, wavelength_um=wavelength, polarization=polarization, theta_i_deg=theta_i,
        theta_r_deg=signed, phi_r_deg=plane, value=to_brdf(content, value[keep], signed, "brdf"),
    )  # fmt: skip
    return with_dhr(content, rows, incidence, np.array(tis), polarization, wavelength)


def _count(content: Content, words: list[tuple[int, str]], at: int, name: str) -> int:
    if (
        at >= len(words)
        or not words[at][1].isdecimal()
        or not 1 <= int(words[at][1][:9]) <= 100_000
    ):
        content.refuse(f"{name} needs the number of its entries")
    return int(words[at][1])


def _wavelength(content: Content) -> float | None:
    """Wavelength [um] that a comment names, where there is one alone."""
    comments = " ".join(line.partition("#")[2] for line in content.lines[:200] if "#" in line)
    found = {float(x) / 1000 for x in re.findall(r"\b(\d{3,5}(?:\.\d+)?) ?nm\b", comments)}
    return found.pop() if len(found) == 1 else None
