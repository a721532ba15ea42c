"""From the conventions of other formats to those here: directions, kinds of values, spectra."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.io.formats.content import Content, Imported, imported

_SPECULAR_DEG, _LEAST_THETA_I_DEG, _LEAST_RATIO = 15.0, 20.0, 1.2
SAME_BAND = 0.02
"""Relative distance up to which a wavelength stands for the one that is decided."""


def directions(
    content: Content, theta_i_deg: ArrayLike, theta_r_deg: ArrayLike, azimuth_deg: ArrayLike,
    value: ArrayLike, *, forward: str | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Signed theta_r and phi_r [deg] of the tidy format, + and 0 on the specular side.

    Parameters
    ----------
    content : Content
    theta_i_deg, theta_r_deg, azimuth_deg, value : array_like, shape (n_rows,)
        ``azimuth_deg`` is that of the viewer less that of the incident beam; a negative
        ``theta_r_deg`` is the opposite azimuth.
    forward : {"phi0", "phi180"}, optional
        Specular side where the format says it; else it is found from the lobe.

    Raises
    ------
    UndecidedError
        Neither the format nor the lobe nor the user says it.
    """
    theta_i, theta, azimuth, value = np.broadcast_arrays(
        *(np.asarray(a, dtype=np.float64) for a in (theta_i_deg, theta_r_deg, azimuth_deg, value))
    )
    azimuth = np.where(theta < 0.0, azimuth + 180.0, azimuth)
    azimuth = np.where(np.abs(theta) < 1e-9, 0.0, np.round(azimuth, 6) % 360.0)
    size = np.abs(theta)
    side = content.decided.forward or forward
    at_normal = bool(np.all(np.abs(theta_i) < 1e-9))
    found = _side_of_lobe(theta_i, size, azimuth, value)
    if side is None and (found is not None or at_normal):
        side = found or "phi0"
        content.say(
            f"forward side: {side}, " + ("from the lobe" if found else "all at normal incidence")
        )
    elif side is None:
        content.ask(
            "the lobe does not show which azimuth is the specular side", "--forward phi0|phi180"
        )
    else:
        by = "as decided" if content.decided.forward else "by the format"
        but = (
            f"; the lobe speaks for {found}, look at the result"
            if found not in (None, side)
            else ""
        )
        content.say(f"forward side: {side}, {by}{but}")
    phi = azimuth if side == "phi0" else (azimuth + 180.0) % 360.0
    phi = np.where(size < 1e-9, 0.0, phi)
    back = (phi > 90.0) & (phi <= 270.0)
    phi = np.where(back, phi - 180.0, np.where(phi > 270.0, phi - 360.0, phi))
    return np.where(back, -size, size) + 0.0, phi + 0.0


def _side_of_lobe(
    theta_i: NDArray[np.float64], theta: NDArray[np.float64], azimuth: NDArray[np.float64],
    value: NDArray[np.float64],
) -> str | None:  # fmt: skip
    """Side with the larger value within 15 deg of the specular direction, by a factor of 1.2."""
    near = (theta_i >= _LEAST_THETA_I_DEG) & (np.abs(theta - theta_i) <= _SPECULAR_DEG)
    away = np.abs((azimuth + 180.0) % 360.0 - 180.0)
    logs = []
    for angle in np.unique(theta_i[near]).tolist():
        mine = near & (theta_i == angle)
        at_0, at_180 = mine & (away <= 10.0), mine & (away >= 170.0)
        if at_0.any() and at_180.any():
            logs.append(np.log(max(value[at_0].max(), 1e-12) / max(value[at_180].max(), 1e-12)))
    if not logs or abs(float(np.mean(logs))) < np.log(_LEAST_RATIO):
        return None
    return "phi0" if np.mean(logs) > 0 else "phi180"


def to_brdf(
    content: Content, value: NDArray[np.float64], theta_r_deg: NDArray[np.float64],
    kind: str | None,
) -> NDArray[np.float64]:  # fmt: skip
    """BRDF [sr^-1] from values of a kind, which the user may decide otherwise.

    Parameters
    ----------
    content : Content
    value, theta_r_deg : ndarray, shape (n_rows,)
    kind : {"brdf", "brf", "brdf_cos"} or None
        As the format has it; asked for where None.
    """
    chosen = content.decided.value or kind
    cosine = np.cos(np.radians(theta_r_deg))
    if chosen is None:
        content.ask(
            "the file does not say whether the values are BRDF [1/sr], reflectance factors (pi "
            f"BRDF) or BRDF times cos(theta_r); they reach {np.max(value):.4g}, where a surface "
            "cannot have a reflectance factor far above 1 outside its lobe",
            "--value brdf|brf|brdf_cos",
        )
    content.say(f"values: {chosen}, " + ("as decided" if content.decided.value else "by the file"))
    if chosen == "brf":
        return value / np.pi
    return value / np.maximum(cosine, 1e-12) if chosen == "brdf_cos" else value


def brdf_readings(
    content: Content, sample: str, *, wavelength_um: ArrayLike, polarization: ArrayLike,
    theta_i_deg: ArrayLike, theta_r_deg: ArrayLike, phi_r_deg: ArrayLike, value: ArrayLike,
    sigma: ArrayLike = np.nan, n_repeats: ArrayLike = np.nan,
) -> Imported:  # fmt: skip
    """BRDF rows; those without a value are dropped, those of zero or less flagged."""
    columns = dict(zip(
        ("wavelength_um", "polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg", "value",
         "sigma", "n_repeats"),
        np.broadcast_arrays(wavelength_um, polarization, theta_i_deg, theta_r_deg, phi_r_deg,
                            value, sigma, n_repeats),
        strict=True,
    ))  # fmt: skip
    out = (columns["theta_i_deg"] > 89.95) | (np.abs(columns["theta_r_deg"]) > 90.0)
    out |= ~np.isfinite(columns["value"]) | (columns["theta_i_deg"] < 0.0)
    if n := np.count_nonzero(out):
        content.say(
            f"dropped: {n} rows without a finite value or beyond 89.95 (theta_i) and 90 deg"
        )
    columns = {name: column[~out] for name, column in columns.items()}
    columns = _at_wavelength(content, columns)
    dark = columns["value"] <= 0.0
    if n := np.count_nonzero(dark):
        content.say(f"flagged: {n} rows with a BRDF of zero or less ('not_positive')")
    _check_level(content, columns, dark)
    flag = np.where(dark, "not_positive", "")
    return imported(content, sample, quantity="brdf", flag=flag, **columns)


def _at_wavelength(
    content: Content, columns: dict[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Rows of the wavelength next to the one that is decided."""
    wanted, present = content.decided.wavelength_um, np.unique(columns["wavelength_um"])
    if wanted is None or present.size < 2:
        return columns
    near = present[np.argmin(np.abs(present - wanted))]
    if abs(near / wanted - 1.0) > SAME_BAND:
        content.refuse(f"{wanted:g} um was not measured, the next is {near:g} um")
    content.say(f"wavelength: {near:g} um of {present.size}, the next to {wanted:g} um")
    mine = columns["wavelength_um"] == near
    return {name: column[mine] for name, column in columns.items()}


def _check_level(
    content: Content, columns: dict[str, NDArray[Any]], dark: NDArray[np.bool_]
) -> None:
    """Say the reflectance that the rows in plane amount to, were the BRDF the same all around."""
    found = []
    used = ~dark & (np.abs(columns["phi_r_deg"]) < 1e-6)
    for angle in np.unique(columns["theta_i_deg"][used]).tolist():
        mine = used & (columns["theta_i_deg"] == angle)
        theta, at = np.unique(columns["theta_r_deg"][mine], return_index=True)
        if theta.size >= 5 and theta[-1] - theta[0] > 60.0:
            x = np.radians(theta)
            y = columns["value"][mine][at] * np.cos(x) * np.sin(np.abs(x)) * np.pi
            found.append(float(np.sum((y[1:] + y[:-1]) / 2.0 * np.diff(x))))
    if not found:
        return
    least = min(found)
    text = f"level: in plane the values amount to a reflectance of {least:.3g} to {max(found):.3g}"
    content.say(
        f"{text}; above 1: are they reflectance factors? (--value brf)" if least > 1.05 else text
    )


def with_dhr(
    content: Content, rows: Imported, theta_i_deg: ArrayLike, dhr: ArrayLike, polarization: str,
    wavelength_um: float,
) -> Imported:  # fmt: skip
    """The rows, and a DHR row for each total reflectance between 0 and 1."""
    theta_i, value = np.broadcast_arrays(np.atleast_1d(theta_i_deg), np.atleast_1d(dhr))
    usable = (value > 0.0) & (value <= 1.0) & (theta_i <= 89.95)
    content.say(f"total reflectance: {np.count_nonzero(usable)} DHR rows, "
                f"{np.count_nonzero(~usable)} outside 0 to 1 left out")  # fmt: skip
    n = int(np.count_nonzero(usable))
    more: dict[str, ArrayLike] = {
        "sample": rows.columns["sample"][0], "quantity": "dhr", "wavelength_um": wavelength_um,
        "polarization": polarization, "theta_i_deg": theta_i[usable], "value": value[usable],
        "theta_r_deg": np.nan, "sigma": np.nan, "n_repeats": np.nan, "phi_r_deg": np.nan,
        "flag": "",
    }  # fmt: skip
    return Imported({
        name: np.concatenate([column, np.broadcast_to(np.asarray(more[name]), n)])
        for name, column in rows.columns.items()
    })  # fmt: skip


def dhr_readings(
    content: Content, sample: str, *, wavelength_um: NDArray[np.float64],
    value: NDArray[np.float64],
    polarization: str, theta_i_deg: float, percent: bool | None,
) -> Imported:  # fmt: skip
    """One DHR row from a spectrum, interpolated to the wavelength that is decided.

    Parameters
    ----------
    content : Content
    wavelength_um, value : ndarray, shape (n,)
        In any order.
    percent : bool or None
        Whether ``value`` is in per cent; found from the level where None.
    """
    if content.decided.unit is not None:
        percent = content.decided.unit == "percent"
        content.say(f"unit: {content.decided.unit}, as decided")
    elif percent is None:
        percent = bool(np.max(value) > 1.5)
        unit = "percent" if percent else "fraction"
        content.say(f"unit: {unit}, from the largest value {np.max(value):.4g} (--unit)")
    else:
        content.say(f"unit: {'percent' if percent else 'fraction'}, from the file")
    wanted = content.decided.wavelength_um
    order = np.argsort(wavelength_um, kind="stable")
    x, y = wavelength_um[order], value[order] / (100.0 if percent else 1.0)
    if wanted is None:
        content.ask(f"a spectrum from {x[0]:g} to {x[-1]:g} um, and one wavelength is fitted",
                    "--wavelength-um X")  # fmt: skip
    if np.any(np.diff(x) <= 0.0):
        content.refuse("a wavelength is there twice in one spectrum")
    if not x[0] <= wanted <= x[-1]:
        content.refuse(f"{wanted:g} um is outside the spectrum, {x[0]:g} to {x[-1]:g} um")
    distance = float(np.min(np.abs(x - wanted)))
    content.say(
        f"wavelength: {wanted:g} um, interpolated, {1000 * round(distance, 9):.3g} nm from the "
        "next reading"
    )
    return imported(
        content, sample, quantity="dhr", wavelength_um=wanted, polarization=polarization,
        theta_i_deg=theta_i_deg, theta_r_deg=np.nan, value=float(np.interp(wanted, x, y)),
    )  # fmt: skip


def incidence_deg(content: Content, named: float | None) -> float:
    """Angle of incidence [deg] of a spectrum: as decided, else as the file says."""
    if content.decided.theta_i_deg is not None:
        return content.decided.theta_i_deg
    if named is None:
        content.ask("the file does not say the angle of incidence", "--theta-i DEG")
    content.say(f"theta_i: {named:g} deg, from the file")
    return named
