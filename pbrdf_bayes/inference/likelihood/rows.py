"""The readings of a measurement as the likelihoods take them."""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.geometry import polarization_codes

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TINY = 1e-280
RELATIVE_SCALE = 10.0
"""u_cal where the scale of a scan is free: a factor exp(10) either way."""


class Rows(NamedTuple):
    """Readings as the likelihood needs them; everything that the parameters do not enter.

    ``noise_column`` is the parameter column of s_q per scan, ``dhr_noise_column`` that of u_DHR or
    -1; ``u2`` is the stated relative variance u_a^2 (``dhr_u2`` absolute, negative where it is
    inferred). ``plain`` scans have neither a floor nor stated uncertainties: their rows share one
    variance.
    """

    y: Array
    u2: Array
    censored: NDArray[np.bool_]
    scan_start: Index
    noise_column: Index
    plain: NDArray[np.bool_]
    floor2: float
    log_floor: float
    u_cal2: float
    dhr: Array
    dhr_u2: Array
    dhr_group: Index
    dhr_noise_column: int
    dhr_cal2: float


def prepare_rows(
    measurement: Measurement,
    *,
    noise_columns: dict[str, int],
    dhr_noise_column: int,
    floor: float,
    u_cal: float,
    u_dhr_cal: float,
    correlated: bool,
) -> Rows:
    """Arrays of the likelihood from a measurement.

    Parameters
    ----------
    measurement : Measurement
    noise_columns : dict
        Column of s_q in the parameter array, by polarisation.
    dhr_noise_column : int
        Column of the inferred DHR noise, or -1 when every reading has a stated uncertainty.
    floor : float
        Noise-equivalent BRDF [sr^-1].
    u_cal, u_dhr_cal : float
        Relative standard uncertainties of the gains [1].
    correlated : bool
        Rows share a discrepancy. The scatter of repeated readings is largely common to neighbouring
        angles: it tells of gain and discrepancy then, and is not added to the noise.

    Returns
    -------
    Rows
    """
    brdf, dhr = measurement.brdf, measurement.dhr
    censored = brdf.value <= floor if floor > 0.0 else np.zeros(len(brdf), dtype=bool)
    y = np.log(np.where(censored, max(floor, _TINY), np.maximum(brdf.value, _TINY)))
    u2 = np.where(np.isnan(brdf.u_value), 0.0, brdf.u_value / np.exp(y)) ** 2
    for scan in measurement.scans:
        pooled = brdf.repeated[scan.rows] & ~np.isnan(brdf.u_value[scan.rows])
        if pooled.any():
            u2[scan.rows][pooled] = 0.0 if correlated else u2[scan.rows][pooled].mean()
    starts = [0, *(scan.stop for scan in measurement.scans)]
    return Rows(
        y=y,
        u2=u2,
        censored=censored,
        scan_start=np.array(starts, dtype=np.int64),
        noise_column=np.array(
            [noise_columns[s.polarization] for s in measurement.scans], dtype=np.int64
        ),
        plain=np.array(
            [floor == 0.0 and not u2[scan.rows].any() for scan in measurement.scans], dtype=bool
        ),
        floor2=floor * floor,
        log_floor=log(max(floor, _TINY)),
        u_cal2=u_cal * u_cal,
        dhr=dhr.value,
        dhr_u2=np.where(np.isnan(dhr.u_value), -1.0, dhr.u_value**2),
        dhr_group=polarization_codes(dhr.polarization),
        dhr_noise_column=dhr_noise_column,
        dhr_cal2=u_dhr_cal * u_dhr_cal,
    )
