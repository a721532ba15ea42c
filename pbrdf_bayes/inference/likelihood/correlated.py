"""The likelihood of log-BRDF and DHR readings with a misfit correlated along theta_r.

For the rows a of scan j and group g (the scans of one angle of incidence, plane and polarisation),
with model BRDF f, gain c_j, discrepancy d_g and instrument floor b:

    y_a = 1/2 ln(f^2 + b^2) + h_a (c_j + d_g(theta_r,a)) + noise_a,   c_j ~ N(0, u_cal^2)
    noise_a ~ N(0, s_q^2 + u_a^2 + b^2/(f^2 + b^2)),   h_a = f^2/(f^2 + b^2)

Gain and discrepancy are those of the BRDF: h_a is how much of them is left beside the floor, to
first order. The rows are divided by it, and the filter sees c + d with residuals and variances of
that size.

d_g is a Matérn process of amplitude tau and length ell, see `inference.likelihood.kalman`. The
scatter of repeated readings is largely common to neighbouring angles: it tells of c and d, and is
not added to the noise. DHR readings as in `pbrdf_bayes.inference.likelihood.iid`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.groups import Groups, prepare_groups, set_variances, workspace
from pbrdf_bayes.inference.likelihood.iid import dhr_readings
from pbrdf_bayes.inference.likelihood.kalman import group_gradient, group_log_likelihood
from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.brdf import (
    Buffers,
    add_scan_slopes,
    at_rows,
    buffers,
    dhr_gradient,
    fill_dhr,
    log_brdf,
    to_parameters,
)
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import Surface, surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.given import Given, fill_model
from pbrdf_bayes.physics.normalisation.plain import SLOPES, VALUES
from pbrdf_bayes.physics.normalisation.plain import workspace as quadrature_workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NONE = -1
"""Column of a parameter that there is not."""


LEAST_ABOVE = 1e-6
"""Smallest h: nothing of the BRDF is left there."""


class Discrepancy(NamedTuple):
    """Which rows share a discrepancy, and the parameter columns of its law."""

    groups: Groups
    noise_column: Index
    """Parameter column of s_q per group."""
    group_of_scan: Index
    stated2: Array
    """Relative variance stated for each row beside its repeats."""
    varied: bool
    """Rows have variances of their own: stated ones or a floor."""
    tau_column: int
    ell_column: int


def prepare_discrepancy(
    measurement: Measurement, rows: Rows, *, tau_column: int = NONE, ell_column: int = NONE,
    rough: bool = False,
) -> Discrepancy:  # fmt: skip
    """Group the rows of a measurement by the discrepancy they share.

    Without one every scan is a group, and the scatter of repeated readings is white noise.

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
    stated2 = np.where(measurement.brdf.repeated & shared, 0.0, rows.u2)
    return Discrepancy(
        groups=prepare_groups(
            measurement.brdf.theta_r_deg,
            np.repeat([names[key] for key in keys], lengths),
            np.repeat(np.arange(len(scans)), lengths),
            rough=rough,
        ),
        noise_column=noise_column,
        group_of_scan=np.array([names[key] for key in keys], dtype=np.int64),
        stated2=stated2,
        varied=bool(rows.floor2 > 0.0 or stated2.any()),
        tau_column=tau_column,
        ell_column=ell_column,
    )


class Rowwise(NamedTuple):
    """Numbers of every row, allocated once: see `compare_rows`."""

    log_f: Array
    residual: Array
    above: Array
    extra: Array
    group_variance: Array


@compiled()
def rowwise(n_rows: int, n_groups: int) -> Rowwise:
    """Arrays for `compare_rows`."""
    return Rowwise(
        np.empty(n_rows), np.empty(n_rows), np.ones(n_rows), np.zeros(n_rows), np.empty(n_groups)
    )


@compiled()
def compare_rows(
    geometry: Geometry, rows: Rows, law: Discrepancy, found: Buffers, x: Array, row: Rowwise
) -> float:
    """Residuals and variances of the rows, over h and h^2.

    Returns minus the sum of ln h over the rows that are not censored, which their densities need.
    """
    jacobian = 0.0
    for scan in range(rows.noise_column.size):
        a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
        values = found.log_f[geometry.row_polarization[a]]
        log_f = at_rows(geometry, values, a, row.log_f[a:b])
        y, residual = rows.y[a:b], row.residual[a:b]
        for i in range(y.size):
            residual[i] = y[i] - log_f[i]
        if rows.floor2 > 0.0:
            above, extra, stated = row.above[a:b], row.extra[a:b], law.stated2[a:b]
            s2 = x[rows.noise_column[scan]] ** 2
            for i in range(y.size):
                ratio = rows.floor2 * exp(min(-2.0 * log_f[i], 600.0))
                above[i] = 1.0 / (1.0 + ratio)
                h = max(above[i], LEAST_ABOVE)
                residual[i] = (residual[i] - 0.5 * log(1.0 + ratio)) / h
                extra[i] = (s2 + stated[i] + ratio * above[i]) / (h * h) - s2
                jacobian -= 0.0 if rows.censored[a + i] else log(h)
    for group in range(law.noise_column.size):
        row.group_variance[group] = x[law.noise_column[group]] ** 2
    return jacobian


def divide_by_share(rows: Rows, law: Discrepancy, s2: Array, brdf: Array) -> tuple[Array, Array]:
    """What `compare_rows` does, for one parameter set in NumPy.

    Parameters
    ----------
    rows : Rows
    law : Discrepancy
    s2, brdf : ndarray, shape (n_brdf,)
        White variance of the rows [1] and the model there [sr^-1].

    Returns
    -------
    tuple of ndarray, each of shape (n_brdf,)
        h, and the variance over h^2 beyond ``s2``.
    """
    if rows.floor2 == 0.0:
        return np.ones(s2.size), law.stated2
    above = brdf * brdf / (brdf * brdf + rows.floor2)
    h = np.maximum(above, LEAST_ABOVE)
    return h, (s2 + law.stated2 + 1.0 - above) / (h * h) - s2


@compiled(nogil=True)
def correlated_log_likelihood(
    geometry: Geometry, rows: Rows, law: Discrepancy, parameters: Array, digits: float,
    given: Given,
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

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    row = rowwise(rows.y.size, law.noise_column.size)
    work = workspace(law.groups, False)
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    ws = quadrature_workspace()
    for j in range(n_sets):
        x = parameters[j]
        fill_model(geometry, given, j, x, digits, ws, found, dhr)
        total, _ = dhr_readings(rows, dhr, x[rows.dhr_noise_column], dhr_work)
        total += compare_rows(geometry, rows, law, found, x, row)
        if law.varied:
            set_variances(law.groups, work, row.extra if rows.floor2 > 0.0 else law.stated2)
        result[j] = total + group_log_likelihood(
            law.groups, work, row.residual, row.group_variance, rows.u_cal2, x[law.tau_column],
            x[law.ell_column],
        )  # fmt: skip
    return result


@compiled()
def add_dhr_slopes(
    geometry: Geometry, rows: Rows, surf: Surface, x: Array, dhr: Array, work: Array, out: Array
) -> float:
    """Log-likelihood of the DHR readings; its slopes by all parameters are added to ``out``."""
    total, slope = dhr_readings(rows, dhr, x[rows.dhr_noise_column], work)
    if rows.dhr_noise_column >= 0:
        out[rows.dhr_noise_column] += slope
    physical = np.empty(4)
    for i in range(dhr.size):
        dhr_gradient(geometry, surf, i, physical)
        for p in range(4):
            out[p] += work[i] * physical[p]
    return total


@compiled()
def add_row_slopes(
    geometry: Geometry, rows: Rows, found: Buffers, surf: Surface, x: Array, row: Rowwise,
    by_row: Array, out: Array,
) -> None:  # fmt: skip
    """Add the slopes by physical parameters and noises to ``out``.

    ``by_row`` holds those by the mean and by the variance of every row; the first are replaced.
    """
    sums, physical = np.zeros(3), np.empty(4)
    weight = 0.0
    for scan in range(rows.noise_column.size):
        a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
        s_rel = x[rows.noise_column[scan]]
        by_log_f, by_v, above = by_row[0, a:b], by_row[1, a:b], row.above[a:b]
        residual, extra, censored = row.residual[a:b], row.extra[a:b], rows.censored[a:b]
        for i in range(b - a):
            h, below = max(above[i], LEAST_ABOVE), 1.0 - above[i]
            out[rows.noise_column[scan]] += 2.0 * s_rel * by_v[i] / (h * h)
            by_h = 2.0 * residual[i] * by_log_f[i] - 4.0 * by_v[i] * (s_rel * s_rel + extra[i])
            by_h -= 0.0 if censored[i] else 2.0
            by_h *= below if above[i] > LEAST_ABOVE else 0.0
            by_log_f[i] = above[i] / h * (by_log_f[i] - 2.0 * by_v[i] * below / h) + by_h
        weight += add_scan_slopes(geometry, found, a, by_log_f, sums)
    to_parameters(sums[0], sums[1], sums[2], surf, physical)
    out[0] += physical[0]
    out[1] += physical[1]
    out[2] += weight / surf.sigma_n0
    out[3] += physical[3]


@compiled(nogil=True)
def correlated_gradient(
    geometry: Geometry, rows: Rows, law: Discrepancy, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """Log-likelihood and its derivatives by all parameters, from one pass.

    Parameters
    ----------
    geometry, rows, law, parameters, digits
        As for `correlated_log_likelihood`.

    Returns
    -------
    tuple of ndarray, shapes (n_sets,) and (n_sets, n_par)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    slopes = np.zeros(parameters.shape)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    row = rowwise(rows.y.size, law.noise_column.size)
    work = workspace(law.groups, True)
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
        total += compare_rows(geometry, rows, law, found, x, row)
        if law.varied:
            set_variances(law.groups, work, row.extra if rows.floor2 > 0.0 else law.stated2)
        value, by_tau, by_ell = group_gradient(
            law.groups, work, row.residual, row.group_variance, rows.u_cal2, x[law.tau_column],
            x[law.ell_column], by_row,
        )  # fmt: skip
        out[law.tau_column] += by_tau
        out[law.ell_column] += by_ell
        add_row_slopes(geometry, rows, found, surf, x, row, by_row, out)
        result[j] = total + value
    return result, slopes


@compiled(nogil=True)
def precision_times(rows: Rows, law: Discrepancy, x: Array, extra: Array, values: Array) -> Array:
    """K^-1 times values of the rows, K their covariance at one parameter set.

    Parameters
    ----------
    rows : Rows
    law : Discrepancy
    x : ndarray, shape (n_par,)
        Physical units.
    extra : ndarray, shape (n_rows,)
        Variance of each row beside s_q^2.
    values : ndarray, shape (n_columns, n_rows)

    Returns
    -------
    ndarray, shape (n_columns, n_rows)
    """
    work = workspace(law.groups, True)
    set_variances(law.groups, work, extra)
    variance = np.empty(law.noise_column.size)
    for group in range(variance.size):
        variance[group] = x[law.noise_column[group]] ** 2
    by_row = np.empty((4, rows.y.size))
    result = np.empty(values.shape)
    for i in range(values.shape[0]):
        group_gradient(
            law.groups, work, values[i], variance, rows.u_cal2, x[law.tau_column],
            x[law.ell_column], by_row,
        )  # fmt: skip
        result[i] = by_row[0]
    return result
