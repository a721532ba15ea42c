"""A measurement as arrays of a run folder, and back: nothing is computed on either way."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import xarray as xr

from pbrdf_bayes.measurement import Measurement, Readings, Scan

_KINDS = ("brdf", "dhr")
_OF_ROWS = {f.name: f.name for f in fields(Readings) if f.name != "value"} | {"u_value": "u"}
"""Columns of `Readings` beside the values, and their names in the file after that of the kind."""
_OF_SCAN = tuple(f.name for f in fields(Scan) if f.name != "label")
_OF_ALL = ("sample", "wavelength_um", "source", "sha256")


def measurement_datasets(measurement: Measurement) -> dict[str, xr.Dataset]:
    """The groups ``observed_data`` and ``constant_data`` of a run, see `pbrdf_bayes.results`.

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    dict of str to Dataset
        `measurement_of` makes the same measurement of them, to the last bit, also when they have
        been written as netCDF.
    """
    m = measurement
    observed: dict[str, Any] = {}
    constant: dict[str, Any] = {}
    for kind in _KINDS:
        readings, along = getattr(m, kind), f"{kind}_obs"
        observed[kind] = (along, readings.value)
        for name, stored in _OF_ROWS.items():
            constant[f"{kind}_{stored}"] = (along, getattr(readings, name))
    constant["brdf_scan"] = ("brdf_obs", np.repeat(np.arange(len(m.scans)), [*map(len, m.scans)]))
    for name in _OF_SCAN:
        constant[f"scan_{name}"] = ("scan", np.array([getattr(scan, name) for scan in m.scans]))
    constant["warning"] = ("n_warnings", np.array(m.warnings, dtype=np.str_))
    constant["n_excluded"] = ("flag", np.array([*m.excluded.values()], dtype=np.int64))
    labels = {
        "scan": np.array([scan.label for scan in m.scans], dtype=np.str_),
        "flag": np.array([*m.excluded], dtype=np.str_),
    }
    attributes = {name: getattr(m, name) for name in _OF_ALL}
    return {
        "observed_data": xr.Dataset(observed),
        "constant_data": xr.Dataset(constant, coords=labels, attrs=attributes),
    }


def measurement_of(groups: xr.DataTree) -> Measurement:
    """The measurement that `measurement_datasets` wrote.

    Parameters
    ----------
    groups : DataTree
        The arrays of a run.

    Returns
    -------
    Measurement

    Raises
    ------
    KeyError
        A variable or an attribute is not there.
    """
    observed, constant = (groups[name].to_dataset() for name in ("observed_data", "constant_data"))
    readings = {}
    for kind in _KINDS:
        columns = {name: constant[f"{kind}_{stored}"].values for name, stored in _OF_ROWS.items()}
        columns["polarization"] = columns["polarization"].astype(np.str_)  # float where it is empty
        readings[kind] = Readings(value=observed[kind].values, **columns)
    of_scans = [constant[f"scan_{name}"].values.tolist() for name in _OF_SCAN]
    scans = tuple(
        Scan(label, **dict(zip(_OF_SCAN, row, strict=True)))
        for label, *row in zip(constant["scan"].values.tolist(), *of_scans, strict=True)
    )
    flags, n_excluded = (constant[name].values.tolist() for name in ("flag", "n_excluded"))
    return Measurement(
        **readings,
        scans=scans,
        excluded=dict(zip(flags, n_excluded, strict=True)),
        warnings=tuple(constant["warning"].values.tolist()),
        sample=str(constant.attrs["sample"]),
        wavelength_um=float(constant.attrs["wavelength_um"]),
        source=str(constant.attrs["source"]),
        sha256=str(constant.attrs["sha256"]),
    )
