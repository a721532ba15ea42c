"""Tables without a standard: angles down, and angles, wavelengths or values across.

Read are a list with named columns (``Incident_angle, Measure_angle, 390nm ...`` or ``src_z src_a
view_z view_a ...``) and a matrix of theta_r against theta_i with a title that says which is which.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.io.formats.content import (
    Content,
    Imported,
    named_polarization,
    named_wavelength_um,
    to_number,
)
from pbrdf_bayes.io.formats.conventions import brdf_readings, directions, incidence_deg, to_brdf
from pbrdf_bayes.io.formats.spreadsheet import cells, is_table

NAME = "table"
_COLUMNS = {
    "theta_i": r"incid|^src_z|theta_?i\b|\u03b8_?i\b|^aoi\b|^angle of inc",
    "phi_i": r"^src_a|phi_?i\b",
    "theta_r": r"^measure_?angle|^view_z|theta_?[rsvo]\b|\u03b8_?[rsvo]\b|^scatter|^receiv|^detect|"
    r"^view|^exit",
    "phi_r": r"^view_a|phi_?[rsvo]\b|azimuth",
}
_VALUE = r"^(brdf|bsdf|brf|value|ccbrdf|reflectance factor|f_r)\b"


@dataclass(frozen=True)
class _List:
    """Where a list has its columns: place by name, and wavelength [um] or None of each value."""

    header: int
    place: dict[str, int]
    values: dict[int, float | None]


def recognises(content: Content) -> bool:
    """A list with named angles, or a matrix of angles, on any sheet."""
    return is_table(content, lambda rows: _list(rows) is not None or _matrix(rows) is not None)


def read(content: Content) -> Imported:
    """BRDF of the table; several wavelengths are all read.

    Raises
    ------
    DataError
    """
    rows = cells(content)
    listed = _list(rows)
    if listed is not None:
        return _read_list(content, rows, listed)
    header = _matrix(rows)
    if header is None:
        content.refuse("no header with angles in it: a list needs columns for theta_i and theta_r, "
                       "a matrix a row of angles")  # fmt: skip
    return _read_matrix(content, rows, header)


def _plain(cell: str) -> str:
    return re.sub(r"[\[(].*?[\])]", "", cell).strip().lower()


def _list(rows: Sequence[Sequence[str]]) -> _List | None:
    """The header of a list among the first lines: it names theta_r, and values."""
    for at, row in enumerate(rows[:100]):
        place: dict[str, int] = {}
        values: dict[int, float | None] = {}
        for i, cell in enumerate(row):
            word = _plain(cell)
            name = next(
                (n for n, p in _COLUMNS.items() if n not in place and re.search(p, word)), None
            )
            if name is not None and to_number(cell) is None:
                place[name] = i
            elif (w := named_wavelength_um(cell)) is not None:
                values[i] = w
            elif re.match(_VALUE, word):
                values[i] = None
        if "theta_r" in place and values and len(rows) > at + 1:
            return _List(at, place, values)
    return None


def _angle(cell: str) -> float | None:
    return to_number(
        re.sub(r"\(.*|\s*(\u00b0|deg(rees?)?)\s*$", "", cell.strip(), flags=re.IGNORECASE)
    )


def _matrix(rows: Sequence[Sequence[str]]) -> int | None:
    """The first row whose cells after the first are angles, over a row of numbers."""
    for at, row in enumerate(rows[:100]):
        angles = [_angle(cell) for cell in row[1:] if cell]
        below = rows[at + 1] if at + 1 < len(rows) else []
        if (
            row and to_number(row[0]) is None and angles
            and all(a is not None and -90.0 <= a <= 90.0 for a in angles[: _n_angles(row)])
            and _n_angles(row) >= 1
            and below and abs(_angle(below[0]) or 0.0) <= 90.0 and _angle(below[0]) is not None
            and any(to_number(c) is not None for c in below[1:])
        ):  # fmt: skip
            return at
    return None


def _n_angles(row: Sequence[str]) -> int:
    """Angles after the first cell, before a title."""
    n = 0
    for cell in row[1:]:
        if _angle(cell) is None:
            break
        n += 1
    return n


def _kind(words: str) -> str | None:
    """What the values are by the words of the titles; None where they do not say one thing."""
    cosine = re.search(
        r"cc_?brdf|cos(ine)?[ -]?(corrected|weighted)|brdf ?[*\u00b7x]? ?cos", words, re.IGNORECASE
    )
    brf = re.search(r"(?<![a-z])brf(?![a-z])|reflectance factor", words, re.IGNORECASE)
    brdf = re.search(
        r"(?<![a-z])b[rs]df(?![a-z])|1/sr|sr ?\^?-1|sr\u207b\u00b9", words, re.IGNORECASE
    )
    found = [
        k for k, has in (("brdf_cos", cosine), ("brf", brf), ("brdf", brdf and not cosine)) if has
    ]
    return found[0] if len(found) == 1 else None


def _titles(rows: Sequence[Sequence[str]], header: int) -> str:
    return ", ".join(cell for row in rows[: header + 1] for cell in row if to_number(cell) is None)


def _sheet_sample(content: Content) -> str:
    return content.decided.sheet or ""


def _read_list(content: Content, rows: Sequence[Sequence[str]], listed: _List) -> Imported:
    titles = _titles(rows, listed.header)
    numbers: list[list[float]] = []
    places = [*listed.place.values(), *listed.values]
    for number, row in enumerate(rows[listed.header + 1 :], start=listed.header + 2):
        if not any(row):
            continue
        if max(listed.place.values()) >= len(row):
            content.refuse(f"row {number}: {len(row)} cells, too few for the angles")
        found = []
        for i in places:
            cell = row[i] if i < len(row) else ""
            if i in listed.values and not cell:
                found.append(np.nan)
            else:
                found.append(
                    content.number(cell, line=number, what=rows[listed.header][i] or "cell")
                )
        numbers.append(found)
    if not numbers:
        content.refuse("a header and no rows")
    table = np.array(numbers)
    at = {name: table[:, i] for i, name in enumerate(listed.place)}
    if "theta_i" not in at:
        at["theta_i"] = np.full(len(table), incidence_deg(content, None))
    if np.any(np.abs(at["theta_i"]) > 90.0) or np.any(np.abs(at["theta_r"]) > 90.0):
        content.refuse("an angle is beyond 90 deg")
    wavelengths = list(listed.values.values())
    if len(wavelengths) == 1:
        wavelengths = [content.wavelength_um(wavelengths[0])]
    elif any(w is None for w in wavelengths):
        content.refuse("several columns of values, and not all are named after a wavelength")
    else:
        content.say(
            f"wavelength: {len(wavelengths)} columns, {wavelengths[0]:g} to {wavelengths[-1]:g} um"
        )
    n, m = len(table), len(wavelengths)
    value = table[:, len(listed.place) :].T.ravel()
    zero = np.zeros(n)
    azimuth = at.get("phi_r", zero) - at.get("phi_i", zero)
    return _finish(content, titles, wavelength=np.repeat(np.array(wavelengths, dtype=float), n),
                   theta_i=np.tile(at["theta_i"], m), theta_r=np.tile(at["theta_r"], m),
                   azimuth=np.tile(azimuth, m), value=value)  # fmt: skip


def _read_matrix(content: Content, rows: Sequence[Sequence[str]], header: int) -> Imported:
    n = _n_angles(rows[header])
    titles = _titles(rows, header) + " " + " ".join(rows[header])
    across = np.array([_angle(cell) for cell in rows[header][1 : n + 1]], dtype=np.float64)
    down: list[float] = []
    values: list[list[float]] = []
    for number, row in enumerate(rows[header + 1 :], start=header + 2):
        if not any(row):
            continue
        angle = _angle(row[0])
        if angle is None or abs(angle) > 90.0:
            content.refuse(f"row {number}: {row[0][:30]!r} is not an angle within 90 deg")
        down.append(angle)
        cells_of = [row[i] if i < len(row) else "" for i in range(1, n + 1)]
        values.append(
            [content.number(c, line=number, what="value") if c else np.nan for c in cells_of]
        )
    table = np.array(values)
    if _down_is_theta_r(content, rows[header][0], titles, np.array(down), across):
        theta_r, theta_i = (x.ravel() for x in np.meshgrid(down, across, indexing="ij"))
    else:
        theta_i, theta_r = (x.ravel() for x in np.meshgrid(down, across, indexing="ij"))
    measured = np.isfinite(table.ravel())
    named = {w for word in re.findall(r"\d+(?:[.,]\d+)?\s*(?:nm|[u\u00b5\u03bc]m)\b", titles)
             if (w := named_wavelength_um(word)) is not None}  # fmt: skip
    wavelength = content.wavelength_um(named.pop() if len(named) == 1 else None)
    return _finish(content, titles, wavelength=np.full(measured.sum(), wavelength),
                   theta_i=theta_i[measured],
                   theta_r=theta_r[measured], azimuth=np.zeros(measured.sum()),
                   value=table.ravel()[measured])  # fmt: skip


def _down_is_theta_r(
    content: Content,
    corner: str,
    titles: str,
    down: NDArray[np.float64],
    across: NDArray[np.float64],
) -> bool:
    """Which angle is down: by the corner, else by the titles, else by the signs."""
    for words in (corner, titles):
        r, i = (
            re.search(pattern, words.lower())
            for pattern in (_COLUMNS["theta_r"], _COLUMNS["theta_i"])
        )
        if r and i:
            content.say(
                f"angles: {'theta_r' if r.start() < i.start() else 'theta_i'} down, by the title"
            )
            return r.start() < i.start()
        if r or i:
            content.say(f"angles: {'theta_r' if r else 'theta_i'} down, by the title")
            return r is not None
    if (down.min() < 0.0) != (across.min() < 0.0):
        content.say("angles: the ones with both signs are theta_r")
        return bool(down.min() < 0.0)
    return content.refuse(
        "it is not clear which angles are theta_r: write theta_r\\theta_i (down\\across) into the "
        "first cell of the header"
    )


def _finish(
    content: Content, titles: str, *, wavelength: NDArray[np.float64], theta_i: NDArray[np.float64],
    theta_r: NDArray[np.float64], azimuth: NDArray[np.float64], value: NDArray[np.float64],
) -> Imported:  # fmt: skip
    """Values of any kind to BRDF rows with the specular side forward."""
    value = to_brdf(content, value, theta_r, _kind(titles))
    polarization = content.polarization(named_polarization(titles))
    if np.any(theta_i < 0.0):
        content.say("theta_i: negative angles are the other side, theta_r turned with them")
        theta_r, theta_i = np.where(theta_i < 0.0, -theta_r, theta_r), np.abs(theta_i)
    theta, phi = directions(content, theta_i, theta_r, azimuth, np.nan_to_num(value))
    return brdf_readings(
        content, content.sample(_sheet_sample(content)), wavelength_um=wavelength,
        polarization=polarization, theta_i_deg=theta_i, theta_r_deg=theta, phi_r_deg=phi,
        value=value,
    )  # fmt: skip
