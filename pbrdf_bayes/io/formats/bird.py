"""BiRD JSON: v1.0 of the official schema, the style of national institutes, and legacy v4.

Angles in deg or rad; theta_r is 0 to 90 deg and the side of phi_r - phi_i is found from the lobe.
The total reflectance (per cent) becomes a DHR row where theta_i is decided.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.io.formats.content import Content, Imported
from pbrdf_bayes.io.formats.conventions import (
    brdf_readings,
    directions,
    to_brdf,
    with_dhr,
)
from pbrdf_bayes.quantities import POLARIZATIONS

NAME = "bird"
_DEGREES = {"deg": 1.0, "\u00b0": 1.0, "degree": 1.0, "degrees": 1.0, "rad": 180.0 / np.pi,
            "radian": 180.0 / np.pi, "radians": 180.0 / np.pi}  # fmt: skip
_MICROMETRES = {"nm": 1e-3, "um": 1.0, "\u00b5m": 1.0, "\u03bcm": 1.0}
_PER_STERADIAN = ("1/sr", "sr^-1", "sr-1", "sr\u207b\u00b9")


def recognises(content: Content) -> bool:
    """A JSON object with BRDF data."""
    head = content.head.lstrip("\ufeff \t\n")
    return head.startswith("{") and '"data"' in content.text and "theta_i" in content.text


def read(content: Content) -> Imported:
    """Readings of the file, see `directions` and `brdf_readings`.

    Raises
    ------
    DataError
    """
    try:
        table = json.loads(content.text.lstrip("\ufeff"), parse_constant=_refuse_constant(content))
    except RecursionError:
        content.refuse("the JSON is nested too deeply")
    except ValueError as error:
        content.refuse(f"this is not valid JSON ({error})")
    if not isinstance(table, dict) or not isinstance(table.get("data"), dict):
        content.refuse("the JSON has no object 'data' with lists of angles and BRDF")
    data, metadata = table["data"], _object(table.get("metadata"))
    sample = content.sample(_text(_object(metadata.get("sample")).get("name")))
    if "theta_v" in data:
        return _legacy(content, data, sample)
    theta_i = _angles(content, data, "theta_i")
    n = theta_i.size
    theta_r = _angles(content, data, "theta_r", n)
    phi_i = _angles(content, data, "phi_i", n, default=0.0)
    phi_r = _angles(content, data, "phi_r", n, default=0.0)
    entry = _entry(content, data, "BRDF")
    unit = _text(entry.get("unit"))
    if unit and unit not in _PER_STERADIAN:
        content.refuse(f"the unit of BRDF is {unit[:20]!r} (allowed: {', '.join(_PER_STERADIAN)})")
    value = to_brdf(content, _values(content, entry, "BRDF", n), theta_r, "brdf")
    sigma, repeats = _uncertainty(content, data, entry, value)
    theta, phi = directions(content, theta_i, theta_r, phi_r - phi_i, value)
    wavelength, polarization = _wavelengths(content, data, n), _polarizations(content, data, n)
    rows = brdf_readings(
        content, sample, wavelength_um=wavelength, polarization=polarization, theta_i_deg=theta_i,
        theta_r_deg=theta, phi_r_deg=phi, value=value, sigma=sigma, n_repeats=repeats,
    )  # fmt: skip
    return _with_total(
        content, rows, _object(_object(metadata.get("sample")).get("total_reflectance"))
    )


def _with_total(content: Content, rows: Imported, total: Mapping[str, Any]) -> Imported:
    """The rows, and the total reflectance as DHR where its geometry is clear."""
    value = total.get("value")
    if not isinstance(value, int | float) or isinstance(value, bool):
        return rows
    only = {
        name: set(rows.columns[name].tolist())
        for name in ("theta_i_deg", "polarization", "wavelength_um")
    }
    if content.decided.theta_i_deg is not None:
        only["theta_i_deg"] = {content.decided.theta_i_deg}
    if any(len(values) > 1 for values in only.values()):
        content.say("total reflectance: left out, its angle, polarisation or wavelength "
                    "is not stated (--theta-i, --polarization)")  # fmt: skip
        return rows
    theta_i, polarization, wavelength = (values.pop() for values in only.values())
    return with_dhr(content, rows, theta_i, value / 100.0, polarization, wavelength)


def _refuse_constant(content: Content) -> Any:
    def refuse(word: str) -> float:
        content.refuse(f"{word} is no number of JSON")

    return refuse


def _object(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def _entry(content: Content, data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    entry = data.get(name)
    if isinstance(entry, list):
        return {"values": entry}
    if not isinstance(entry, dict):
        content.refuse(f"data.{name} is missing, or no object with unit and values")
    return entry


def _values(
    content: Content, entry: Mapping[str, Any], name: str, n: int | None
) -> NDArray[np.float64]:
    """Numbers under ``values`` or ``value``; one stands for all."""
    given = entry.get("values", entry.get("value"))
    listed = given if isinstance(given, list) else [given]
    if not listed or not all(
        isinstance(x, int | float) and not isinstance(x, bool) for x in listed
    ):
        content.refuse(f"data.{name}: values must be a list of numbers")
    try:
        found = np.array(listed, dtype=np.float64)
    except OverflowError:
        content.refuse(f"data.{name}: a number is too large")
    if n is not None and found.size not in (1, n):
        content.refuse(f"data.{name} has {found.size} values where theta_i has {n}")
    return found if n is None else np.broadcast_to(found, n).copy()


def _angles(
    content: Content, data: Mapping[str, Any], name: str, n: int | None = None,
    default: float | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    """Angles [deg], those in radians rounded to what six digits are worth."""
    if default is not None and name not in data and n is not None:
        return np.full(n, default)
    entry = _entry(content, data, name)
    unit = _text(entry.get("unit")) or "deg"
    if unit not in _DEGREES:
        content.refuse(f"the unit of {name} is {unit[:20]!r} (allowed: deg, \u00b0, rad)")
    degrees = _values(content, entry, name, n) * _DEGREES[unit]
    if unit.startswith("rad"):
        degrees = np.round(degrees, 4)
    if name.startswith("theta") and np.any((degrees < -90.0) | (degrees > 90.0)):
        content.refuse(f"data.{name} has an angle beyond 90 deg (unit {unit})")
    return degrees


def _wavelengths(content: Content, data: Mapping[str, Any], n: int) -> NDArray[np.float64] | float:
    name = "wavelength_i" if "wavelength_i" in data else "wavelength"
    if name not in data:
        return content.wavelength_um(None)
    entry = _entry(content, data, name)
    unit = _text(entry.get("unit"))
    if unit not in _MICROMETRES:
        content.refuse(f"the unit of {name} is {unit[:20]!r} (allowed: nm, \u03bcm)")
    found = np.round(_values(content, entry, name, n) * _MICROMETRES[unit], 9)
    if np.any(found <= 0.0):
        content.refuse(f"data.{name} has a wavelength of zero or less")
    listed = ", ".join(f"{w:g}" for w in np.unique(found)[:10])
    content.say(f"wavelength: {listed} um, from the file")
    return found


def _polarizations(content: Content, data: Mapping[str, Any], n: int) -> NDArray[np.object_] | str:
    """Incident polarisation of each row; a detected one that is not u is refused."""
    if "polarization_r" in data:
        states = _states(content, data, "polarization_r", n)
        if np.any(states != "u"):
            content.refuse("readings behind an analyser (polarization_r) cannot be read yet")
    if content.decided.polarization is not None or "polarization_i" not in data:
        return content.polarization(None, otherwise="u")
    found = _states(content, data, "polarization_i", n)
    content.say(f"polarisation: {', '.join(sorted(set(found.tolist())))}, from the file")
    return found


def _states(content: Content, data: Mapping[str, Any], name: str, n: int) -> NDArray[np.object_]:
    entry = _entry(content, data, name)
    given = entry.get("values", entry.get("value"))
    if isinstance(given, str):
        given = [given] * n if len(given) == 1 else list(given)
    if not isinstance(given, list) or len(given) not in (1, n):
        content.refuse(f"data.{name}: values must be a list of {n} states")
    words = [_state(content, state, name) for state in given]
    return np.array(words * (n if len(words) == 1 < n else 1), dtype=object)


def _state(content: Content, state: object, name: str) -> str:
    """s, p or u of a word or of a Stokes vector."""
    if isinstance(state, str) and state.lower() in POLARIZATIONS:
        return state.lower()
    numbers = state if isinstance(state, list) and len(state) == 4 else []
    if numbers and all(isinstance(x, int | float) for x in numbers) and numbers[0] > 0:
        for word, q in (("s", 1.0), ("p", -1.0), ("u", 0.0)):
            if np.allclose(np.array(numbers[1:]) / numbers[0], (q, 0.0, 0.0), atol=1e-3):
                return word
    return content.refuse(
        f"data.{name}: {str(state)[:40]} is not s, p or u (as word or Stokes vector)"
    )


def _uncertainty(
    content: Content, data: Mapping[str, Any], entry: Mapping[str, Any], value: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Standard uncertainty [sr^-1] and repeats of each row, NaN where not stated."""
    none = np.full(value.size, np.nan)
    stated = data.get("uBRDF", entry.get("uncertainty"))
    if not isinstance(stated, dict):
        return none, none
    u = _values(content, stated, "uncertainty of BRDF", value.size)
    if _text(stated.get("unit")) == "%":
        u = u / 100.0 * np.abs(value)
    elif _text(stated.get("unit")) not in _PER_STERADIAN:
        content.refuse("the unit of the uncertainty of BRDF must be %, 1/sr or sr^-1")
    content.say("uncertainty: standard uncertainty of each row, from the file")
    if np.any(u <= 0.0):
        content.say(
            f"uncertainty: {np.count_nonzero(u <= 0.0)} rows state none above zero, left out"
        )
        u = np.where(u > 0.0, u, np.nan)
    dof = _object(entry.get("comments")).get("degrees_of_freedom")
    if not isinstance(dof, list):
        return u, none
    freedom = _values(content, {"values": dof}, "degrees_of_freedom", value.size)
    whole = (freedom >= 1.0) & (freedom == np.floor(freedom))
    repeats = np.where(whole, freedom + 1.0, np.nan)
    content.say("repeats: degrees of freedom + 1, sigma is that of one reading")
    return np.where(whole, u * np.sqrt(np.where(whole, repeats, 1.0)), u), repeats


def _legacy(content: Content, data: Mapping[str, Any], sample: str) -> Imported:
    """Version 4 of 2019: ``data[wavelength][geometry]``, signed theta_v."""
    wavelengths = _values(content, {"values": data.get("wavelengths")}, "wavelengths", None)
    theta_i = _values(content, {"values": data.get("theta_i")}, "theta_i", None)
    n = theta_i.size
    theta_v = _values(content, {"values": data.get("theta_v")}, "theta_v", n)
    azimuth = [
        _values(content, {"values": data.get(name, [0.0])}, name, n) for name in ("phi_i", "phi_v")
    ]
    rows = data.get("data")
    if not isinstance(rows, list) or len(rows) != wavelengths.size:
        content.refuse(f"data.data must have {wavelengths.size} lists, one for each wavelength")
    value = np.concatenate([_values(content, {"values": row}, "data", n) for row in rows])
    factor = 1e-3 if np.min(wavelengths) > 100.0 else 1.0
    content.say(f"wavelength: read as {'nm' if factor < 1 else 'um'}, from its size")
    states = data.get("pol")
    named = (
        states if isinstance(states, list) else list(states) if isinstance(states, str) else None
    )
    m = wavelengths.size
    if content.decided.polarization is not None or not named:
        polarization: Any = content.polarization(None, otherwise="u")
    else:
        polarization = np.tile(_states(content, {"pol": {"values": named}}, "pol", n), m)
        content.say(f"polarisation: {', '.join(sorted(set(polarization.tolist())))}, from the file")
    theta, phi = directions(
        content,
        np.tile(theta_i, m),
        np.tile(theta_v, m),
        np.tile(azimuth[1] - azimuth[0], m),
        value,
    )
    return brdf_readings(
        content, sample, wavelength_um=np.repeat(wavelengths * factor, n),
        polarization=polarization,
        theta_i_deg=np.tile(theta_i, m), theta_r_deg=theta, phi_r_deg=phi,
        value=to_brdf(content, value, theta, "brdf"),
    )  # fmt: skip
