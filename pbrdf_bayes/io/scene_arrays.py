"""What was computed for a scene as a tidy CSV and as netCDF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes.quantities import QUANTITIES
from pbrdf_bayes.scenes import SceneValues

Array = NDArray[np.float64]

COLUMNS = (
    "wavelength_um", "quantity", "polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg", "value",
    "q05", "q95",
)  # fmt: skip
_ANGLE = (
    "modulo 180, 0 along s, positive counterclockwise for who looks into the beam; quantiles are "
    "those of the deviations from the mean axis of the draws, medians in (-90, 90]"
)
_TURNED = (
    "out of plane facets mix s and p: S0 of s or p light is not the BRDF there and does not "
    "integrate to the DHR; that of unpolarised light is and does"
)
_COMPONENTS = ("S0", "S1", "S2")
_OVER_GRID = ("theta_i_deg", "theta_r_deg", "phi_r_deg", "quantile")


def scene_csv(*values: SceneValues) -> str:
    """Tidy rows, one number each: brdf, S0, S1, S2 [sr^-1], dhr, dolp [1], aolp_deg [deg].

    Parameters
    ----------
    *values : SceneValues
        Of one wavelength, or of several one after another.

    Returns
    -------
    str
        ``wavelength_um`` is empty where it is not known. ``polarization`` is that of the
        illumination; ``value`` is the median of a run, ``q05`` and ``q95`` are empty for given
        parameters. A DHR has no scattering direction. Where there is no light the degree of
        polarisation is empty, where it is 0 the angle. ``q05`` and ``q95`` of the angle are on
        their own sides of ``value``, and may lie outside (-90, 90].
    """
    lines = (
        f"{'' if v.wavelength_um is None else f'{v.wavelength_um:.10g}'},{line}"
        for v in values
        for line in _lines(v)
    )
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"


def _lines(values: SceneValues) -> Iterator[str]:
    scene = values.scene
    over_grid: list[tuple[str, str, Array]] = []
    if values.brdf is not None:
        over_grid += [
            ("brdf", q, of_q) for q, of_q in zip(scene.polarizations, values.brdf, strict=True)
        ]
    if values.stokes is not None:
        stokes = zip(_COMPONENTS, values.stokes, strict=True)
        over_grid += [(name, scene.stokes_incident, part) for name, part in stokes]
    if values.dolp is not None:
        over_grid.append(("dolp", scene.stokes_incident, values.dolp))
    if values.aolp_deg is not None:
        over_grid.append(("aolp_deg", scene.stokes_incident, values.aolp_deg))
    directions = [
        f"{i:.10g},{r:.10g},{phi:.10g}"
        for i in scene.theta_i_deg for r in scene.theta_r_deg for phi in scene.phi_r_deg
    ]  # fmt: skip
    for quantity, q, array in over_grid:
        rows = array.reshape(-1, len(values.quantiles)).tolist()
        for at, row in zip(directions, rows, strict=True):
            yield f"{quantity},{q},{at},{_numbers(row)}"
    if values.dhr is not None:
        for q, of_q in zip(scene.polarizations, values.dhr.tolist(), strict=True):
            for theta_i, row in zip(scene.dhr_theta_i_deg, of_q, strict=True):
                yield f"dhr,{q},{theta_i:.10g},,,{_numbers(row)}"


def _numbers(row: list[float]) -> str:
    """Median, 5 % and 95 %."""
    low, middle, high = row if len(row) == 3 else (np.nan, row[0], np.nan)
    return ",".join("" if np.isnan(x) else f"{x:.9g}" for x in (middle, low, high))


def scene_dataset(values: SceneValues) -> xr.Dataset:
    """The same numbers on their grids, with units.

    Parameters
    ----------
    values : SceneValues

    Returns
    -------
    xarray.Dataset
        Variables ``brdf (polarization, theta_i_deg, theta_r_deg, phi_r_deg, quantile)``,
        ``dhr (polarization, dhr_theta_i_deg, quantile)``, ``stokes (component, theta_i_deg,
        theta_r_deg, phi_r_deg, quantile)``, ``dolp (theta_i_deg, theta_r_deg, phi_r_deg,
        quantile)`` and ``aolp_deg`` on the same axes, those that were asked for.
    """
    scene = values.scene
    found: dict[str, Any] = {}
    if values.brdf is not None:
        name = QUANTITIES["brdf"].long_name
        found["brdf"] = _variable(("polarization", *_OVER_GRID), values.brdf, name, "sr-1")
    if values.dhr is not None:
        over_angles = ("polarization", "dhr_theta_i_deg", "quantile")
        name = QUANTITIES["dhr"].long_name
        found["dhr"] = _variable(over_angles, values.dhr, name, "1")
    if values.stokes is not None:
        name = "Stokes components of the scattered light per unit irradiance"
        axes, array, said = _variable(("component", *_OVER_GRID), values.stokes, name, "sr-1")
        found["stokes"] = axes, array, {**said, "comment": _TURNED}
    if values.dolp is not None:
        found["dolp"] = _variable(_OVER_GRID, values.dolp, "degree of linear polarisation", "1")
    if values.aolp_deg is not None:
        axes, array, said = _variable(
            _OVER_GRID, values.aolp_deg, "angle of linear polarisation", "degree"
        )
        found["aolp_deg"] = axes, array, {**said, "comment": _ANGLE}
    angles = {
        key: (key, np.array(getattr(scene, key)), {"units": "degree"})
        for key in ("theta_i_deg", "theta_r_deg", "phi_r_deg", "dhr_theta_i_deg")
    }
    coordinates = {
        **angles,
        "polarization": np.array(scene.polarizations, dtype=object),
        "component": np.array(_COMPONENTS, dtype=object),
        "quantile": np.array(values.quantiles),
    }
    used = {axis for axes, *_ in found.values() for axis in axes}
    known = {} if values.wavelength_um is None else {"wavelength_um": values.wavelength_um}
    dataset = xr.Dataset(
        found,
        coords={name: value for name, value in coordinates.items() if name in used} | known,
        attrs={**values.source, **_choices(values)},
    )
    if known:
        dataset["wavelength_um"].attrs = {"units": "um", "long_name": "wavelength"}
    return dataset


def spectral_dataset(values: Sequence[SceneValues]) -> xr.Dataset:
    """A scene at several wavelengths: `scene_dataset` of each, along ``wavelength_um``.

    Parameters
    ----------
    values : sequence of SceneValues
        Of one scene, in the order of their wavelengths; of a single one `scene_dataset`.

    Returns
    -------
    xarray.Dataset
        What the runs have in common is an attribute; where they differ, as in their verdicts, it
        is a variable along ``wavelength_um``.
    """
    if len(values) == 1:
        return scene_dataset(values[0])
    each = [scene_dataset(v) for v in values]
    whole = xr.concat(each, "wavelength_um", combine_attrs="drop_conflicts")
    differing = sorted({name for v in values for name in v.source} - set(whole.attrs))
    texts = {n: [v.source.get(n, "") for v in values] for n in differing}
    return whole.assign(
        {n: ("wavelength_um", np.array(each, dtype=object)) for n, each in texts.items()}
    )


def _variable(axes: tuple[str, ...], array: Array, name: str, unit: str) -> tuple[Any, ...]:
    return axes, array, {"long_name": name, "units": unit}


def _choices(values: SceneValues) -> dict[str, Any]:
    """Choices of the scene that no axis shows."""
    scene = values.scene
    stokes = {
        "stokes_incident": scene.stokes_incident, "phase": scene.phase,
        "depolarisation": scene.depolarisation,
    }  # fmt: skip
    return {"instrument": int(scene.instrument), **(stokes if scene.stokes_incident else {})}
