"""The i.i.d. likelihood of log-BRDF and DHR residuals.

The law is that of `readings.observation` without a discrepancy: given the gain of their scan, rows
are independent. A misfit correlated along theta_r makes the result too narrow. Gains are
marginalised analytically (rank-one update of a diagonal covariance). Readings at or below the floor
are censored: they contribute the probability of falling there, the gain of their scan integrated by
Gauss-Hermite quadrature. DHR readings: `inference.likelihood.dhr`.
"""

from __future__ import annotations

from math import log as scalar_log
from math import pi

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.dhr import add_dhr_slopes, dhr_readings
from pbrdf_bayes.inference.likelihood.independent import independent_scan
from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.inference.likelihood.scaled_rows import (
    ScaledRows,
    add_scaled_scan,
    add_to_parameters,
    compare_scan,
    scaled_rows,
)
from pbrdf_bayes.inference.likelihood.systematic import (
    add_independent_scan,
    independent_slopes,
    marginalise,
    rotate,
)
from pbrdf_bayes.physics.brdf import Buffers, add_scan_slopes, at_rows, buffers, fill_dhr, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.given import Given, fill_model
from pbrdf_bayes.physics.normalisation.plain import SLOPES, VALUES, workspace

Array = NDArray[np.float64]

_LN_2PI = scalar_log(2.0 * pi)


@compiled(reassociate=True)
def _moments(y: Array, log_f: Array) -> tuple[float, float]:
    """Sum and sum of squares of the residuals y - ln f of a scan."""
    total = 0.0
    squares = 0.0
    for i in range(y.size):
        residual = y[i] - log_f[i]
        total += residual
        squares += residual * residual
    return total, squares


@compiled()
def _weigh(y: Array, log_f: Array, gain: float, precision: float, out: Array) -> None:
    """Slopes of the log-likelihood by ln f."""
    for i in range(y.size):
        out[i] = (y[i] - log_f[i] - gain) * precision


@compiled()
def _plain_scan(
    total: float, squares: float, n: int, s_rel: float, u_cal2: float
) -> tuple[float, float, float]:
    """A scan whose rows share the variance v = s_rel^2, from its moments.

    Returns the log-likelihood, the gain's posterior mean and the slope by v.
    """
    v = s_rel * s_rel
    inflation = 1.0 + u_cal2 * n / v
    shrunk = u_cal2 / (v * inflation)  # posterior variance of the gain over v
    gain = total * shrunk
    chi2 = (squares - total * gain) / v
    value = -0.5 * (chi2 + n * (_LN_2PI + scalar_log(v)) + scalar_log(inflation))
    about_gain = squares - 2.0 * gain * total + n * gain * gain
    slope = 0.5 * (about_gain / (v * v) - n / v + n * shrunk / v)
    return value, gain, slope


@compiled()
def _error_arrays(rows: Rows, sensitivities: Array) -> tuple[Array, Array, Array]:
    """Scratch of the rows, v and G."""
    m = sensitivities.shape[1]
    return np.empty((2 + m, rows.y.size)), np.empty(m), np.empty((m, m))


@compiled()
def _errors(
    geometry: Geometry, rows: Rows, found: Buffers, x: Array, s: Array, row: ScaledRows,
    work: Array, v: Array, g: Array,
) -> float:  # fmt: skip
    """What systematic errors add to the log-likelihood; `marginalise` leaves ``v`` and ``g``.

    The precisions of the rows over h are left in the first row of ``work``.
    """
    v[:] = 0.0
    g[:] = 0.0
    for scan in range(rows.noise_column.size):
        a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
        compare_scan(geometry, rows, found, x, scan, row)
        precision, s2 = work[0, a:b], x[rows.noise_column[scan]] ** 2
        for i in range(b - a):
            precision[i] = 1.0 / (s2 + row.extra[a + i])
        add_independent_scan(row.residual[a:b], precision, rows.u_cal2, s, a, work[1:], v, g)
    return marginalise(v, g)


@compiled(nogil=True)
def iid_log_likelihood(
    geometry: Geometry, rows: Rows, parameters: Array, digits: float, given: Given,
    sensitivities: Array,
) -> Array:  # fmt: skip
    """Log-likelihood of every parameter set.

    Parameters
    ----------
    geometry : Geometry
    rows : Rows
    parameters : ndarray, shape (n_sets, n_par)
        Physical units; the first four columns are n, k, sigma_n0, rho0.
    digits : float
        Correct decimal digits of the normalisation.
    given : Given
        The model's values where they are not those of the four parameters.
    sensitivities : ndarray, shape (n_sets or 1, n_errors, n_rows)
        S of `readings.observation`; none beside censored rows.

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    row, work, v, g = scaled_rows(rows), *_error_arrays(rows, sensitivities)
    dhr = np.empty(rows.dhr.size)
    dhr_work = np.empty(rows.dhr.size)
    ws = workspace()
    for j in range(n_sets):
        x = parameters[j]
        fill_model(geometry, given, j, x, digits, ws, found, dhr)
        total, _ = dhr_readings(rows, dhr, x[rows.dhr_noise_column], dhr_work)
        for scan in range(rows.noise_column.size):
            a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
            s_rel = x[rows.noise_column[scan]]
            if rows.plain[scan]:
                values = found.log_f[geometry.row_polarization[a]]
                s1, s2 = _moments(rows.y[a:b], at_rows(geometry, values, a, row.log_f[a:b]))
                value, _, _ = _plain_scan(s1, s2, b - a, s_rel, rows.u_cal2)
            else:
                value = compare_scan(geometry, rows, found, x, scan, row)
                value += independent_scan(
                    row.residual[a:b], row.extra[a:b], rows.censored[a:b], s_rel * s_rel,
                    rows.u_cal2, False, work, work[0], work[0],
                )  # fmt: skip
            total += value
        s = sensitivities[min(j, sensitivities.shape[0] - 1)]
        if v.size > 0:
            total += _errors(geometry, rows, found, x, s, row, work, v, g)
        result[j] = total
    return result


@compiled(nogil=True)
def iid_gradient(
    geometry: Geometry, rows: Rows, parameters: Array, digits: float, sensitivities: Array
) -> tuple[Array, Array]:
    """Log-likelihood and its derivatives by all parameters, the sensitivities held.

    Parameters
    ----------
    geometry, rows, parameters, digits, sensitivities
        As for `iid_log_likelihood`.

    Returns
    -------
    tuple of ndarray, shapes (n_sets,) and (n_sets, n_par)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    slopes = np.zeros(parameters.shape)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    row, by_row, precision = scaled_rows(rows), np.empty((2, rows.y.size)), np.empty(rows.y.size)
    work, v, g = _error_arrays(rows, sensitivities)
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    sums = np.empty(3)
    ws = workspace()
    for j in range(n_sets):
        x = parameters[j]
        out = slopes[j]
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, SLOPES, ws, found)
        fill_dhr(geometry, surf, dhr)
        total = add_dhr_slopes(geometry, rows, surf, x, dhr, dhr_work, out)
        sums[:] = 0.0
        weight = 0.0
        t = sensitivities[min(j, sensitivities.shape[0] - 1)].copy()
        if v.size > 0:
            total += _errors(geometry, rows, found, x, t, row, work, v, g)
            precision[:] = work[0]
            rotate(t, g)
        for scan in range(rows.noise_column.size):
            a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
            s_rel = x[rows.noise_column[scan]]
            if rows.plain[scan] and v.size == 0:
                values = found.log_f[geometry.row_polarization[a]]
                log_f = at_rows(geometry, values, a, row.log_f[a:b])
                s1, s2 = _moments(rows.y[a:b], log_f)
                value, gain, by_v = _plain_scan(s1, s2, b - a, s_rel, rows.u_cal2)
                out[rows.noise_column[scan]] += 2.0 * s_rel * by_v
                _weigh(rows.y[a:b], log_f, gain, 1.0 / (s_rel * s_rel), by_row[0, a:b])
                weight += add_scan_slopes(geometry, found, a, by_row[0, a:b], sums)
            else:
                value = compare_scan(geometry, rows, found, x, scan, row)
                value += independent_scan(
                    row.residual[a:b], row.extra[a:b], rows.censored[a:b], s_rel * s_rel,
                    rows.u_cal2, True, work, by_row[0, a:b], by_row[1, a:b],
                )  # fmt: skip
                if v.size > 0:
                    independent_slopes(
                        row.residual[a:b], precision[a:b], rows.u_cal2, t, a, v, work,
                        by_row[0, a:b], by_row[1, a:b],
                    )  # fmt: skip
                weight += add_scaled_scan(geometry, rows, found, x, scan, row, by_row, sums, out)
            total += value
        add_to_parameters(sums, weight, surf, out)
        result[j] = total
    return result, slopes
