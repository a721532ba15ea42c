"""The likelihood of log-BRDF and DHR readings with a misfit correlated along theta_r.

The law is that of `readings.observation`: the filter sees c + d with residuals and variances over h
and h^2. d_g is a Matérn process of amplitude tau and length ell, see `inference.likelihood.kalman`.
DHR readings: `inference.likelihood.dhr`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.dhr import add_dhr_slopes, dhr_readings
from pbrdf_bayes.inference.likelihood.groups import (
    Groups,
    prepare_groups,
    set_errors,
    set_variances,
    workspace,
)
from pbrdf_bayes.inference.likelihood.kalman import group_gradient, group_log_likelihood
from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.inference.likelihood.scaled_rows import add_row_slopes, compare_rows, scaled_rows
from pbrdf_bayes.inference.likelihood.systematic import marginalise
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.brdf import buffers, fill_dhr, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.given import Given, fill_model
from pbrdf_bayes.physics.normalisation.plain import SLOPES, VALUES
from pbrdf_bayes.physics.normalisation.plain import workspace as quadrature_workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NONE = -1
"""Column of a parameter that there is not."""


class Discrepancy(NamedTuple):
    """Which rows share a discrepancy, and the parameter columns of its law."""

    groups: Groups
    noise_column: Index
    """Parameter column of s_q per group."""
    group_of_scan: Index
    varied: bool
    """Rows have variances of their own: stated ones or a floor."""
    tau_column: int
    ell_column: int


def prepare_discrepancy(
    measurement: Measurement, rows: Rows, *, tau_column: int = NONE, ell_column: int = NONE,
    rough: bool = False,
) -> Discrepancy:  # fmt: skip
    """Group the rows of a measurement by the discrepancy they share.

    Without one every scan is a group.

    Parameters
    ----------
    measurement : Measurement
    rows : Rows
    tau_column, ell_column : int
        Columns of amplitude [1] and length [deg] in the parameter array, `NONE` without.
    rough : bool
        Matérn 1/2 instead of 3/2.

    Returns
    -------
    Discrepancy
    """
    scans = measurement.scans
    shared = tau_column != NONE
    keys = [
        (s.theta_i_deg, s.phi_r_deg, s.polarization, 0 if shared else i)
        for i, s in enumerate(scans)
    ]
    names = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    lengths = [len(scan) for scan in scans]
    noise_column = np.zeros(len(names), dtype=np.int64)
    for key, column in zip(keys, rows.noise_column.tolist(), strict=True):
        noise_column[names[key]] = column
    return Discrepancy(
        groups=prepare_groups(
            measurement.brdf.theta_r_deg,
            np.repeat([names[key] for key in keys], lengths),
            np.repeat(np.arange(len(scans)), lengths),
            rough=rough,
        ),
        noise_column=noise_column,
        group_of_scan=np.array([names[key] for key in keys], dtype=np.int64),
        varied=bool(rows.floor2 > 0.0 or rows.u2.any()),
        tau_column=tau_column,
        ell_column=ell_column,
    )


@compiled()
def fill_group_variance(law: Discrepancy, x: Array, out: Array) -> None:
    """s_q^2 of every group."""
    for group in range(law.noise_column.size):
        out[group] = x[law.noise_column[group]] ** 2


@compiled(nogil=True)
def correlated_log_likelihood(
    geometry: Geometry, rows: Rows, law: Discrepancy, parameters: Array, digits: float,
    given: Given, sensitivities: Array,
) -> Array:  # fmt: skip
    """Log-likelihood of every parameter set.

    Parameters
    ----------
    geometry : Geometry
    rows : Rows
        None censored.
    law : Discrepancy
    parameters : ndarray, shape (n_sets, n_par)
        Physical units; the first four columns are n, k, sigma_n0, rho0.
    digits : float
        Correct decimal digits of the normalisation.
    given : Given
        The model's values where they are not those of the four parameters.
    sensitivities : ndarray, shape (n_sets or 1, n_errors, n_rows)
        S of `readings.observation`.

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    row, group_variance = scaled_rows(rows), np.empty(law.noise_column.size)
    work = workspace(law.groups, False, sensitivities.shape[1])
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    ws = quadrature_workspace()
    for j in range(n_sets):
        x = parameters[j]
        fill_model(geometry, given, j, x, digits, ws, found, dhr)
        total, _ = dhr_readings(rows, dhr, x[rows.dhr_noise_column], dhr_work)
        total += compare_rows(geometry, rows, found, x, row)
        fill_group_variance(law, x, group_variance)
        if law.varied:
            set_variances(law.groups, work, row.extra)
        if j < sensitivities.shape[0]:
            set_errors(law.groups, work, sensitivities[j])
        total += group_log_likelihood(
            law.groups, work, row.residual, group_variance, rows.u_cal2, x[law.tau_column],
            x[law.ell_column],
        )  # fmt: skip
        result[j] = total + marginalise(work.v, work.g)
    return result


@compiled(nogil=True)
def correlated_gradient(
    geometry: Geometry, rows: Rows, law: Discrepancy, parameters: Array, digits: float,
    sensitivities: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Log-likelihood and its derivatives by all parameters, the sensitivities held.

    Parameters
    ----------
    geometry, rows, law, parameters, digits, sensitivities
        As for `correlated_log_likelihood`.

    Returns
    -------
    tuple of ndarray, shapes (n_sets,) and (n_sets, n_par)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    slopes = np.zeros(parameters.shape)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    row, group_variance = scaled_rows(rows), np.empty(law.noise_column.size)
    work = workspace(law.groups, True, sensitivities.shape[1])
    by_row = np.empty((4, rows.y.size))
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    ws = quadrature_workspace()
    for j in range(n_sets):
        x = parameters[j]
        out = slopes[j]
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, SLOPES, ws, found)
        fill_dhr(geometry, surf, dhr)
        total = add_dhr_slopes(geometry, rows, surf, x, dhr, dhr_work, out)
        total += compare_rows(geometry, rows, found, x, row)
        fill_group_variance(law, x, group_variance)
        if law.varied:
            set_variances(law.groups, work, row.extra)
        set_errors(law.groups, work, sensitivities[min(j, sensitivities.shape[0] - 1)])
        value, by_tau, by_ell = group_gradient(
            law.groups, work, row.residual, group_variance, rows.u_cal2, x[law.tau_column],
            x[law.ell_column], by_row,
        )  # fmt: skip
        out[law.tau_column] += by_tau
        out[law.ell_column] += by_ell
        add_row_slopes(geometry, rows, found, surf, x, row, by_row, out)
        result[j] = total + value
    return result, slopes
