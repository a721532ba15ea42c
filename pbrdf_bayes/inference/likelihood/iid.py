"""The i.i.d. likelihood of log-BRDF and DHR residuals.

For the rows a of scan j with model BRDF f, gain c_j and instrument floor b (noise-equivalent BRDF):

    y_a = ln(measured BRDF) ~ N( 1/2 ln(f^2 + b^2) + c_j,  s_q^2 + u_a^2 + b^2/(f^2 + b^2) )
    c_j ~ N(0, u_cal^2)

s_q is the inferred relative noise of polarisation q and u_a what the laboratory stated. Readings
at or below the floor are censored: they contribute the probability of falling there, the gain of
their scan integrated by Gauss-Hermite quadrature. DHR readings
D_a of polarisation q share a gain:

    D_a = g_q D_q(theta_a) + noise,   g_q ~ N(1, u_dhr_cal^2)

Gains are otherwise marginalised analytically (rank-one update of a diagonal covariance). Rows are
taken as independent given these; a misfit correlated along theta_r makes the result too narrow.
"""

from __future__ import annotations

from math import log as scalar_log
from math import pi

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.floored_scans import (
    allocate_scratch,
    cut_scratch,
    scan_with_floor,
)
from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.physics.brdf import (
    add_scan_slopes,
    at_rows,
    buffers,
    dhr_gradient,
    fill_dhr,
    log_brdf,
    to_parameters,
)
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.given import Given, fill_model
from pbrdf_bayes.physics.normalisation.plain import SLOPES, VALUES, workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LN_2PI = scalar_log(2.0 * pi)
_TINY = 1e-280


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
def dhr_readings(rows: Rows, model: Array, u_dhr: float, slopes: Array) -> tuple[float, float]:
    """The DHR readings; one gain for each polarisation.

    Returns the log-likelihood and its slope by u_dhr; the slopes by the DHR go into ``slopes``.
    """
    value = 0.0
    slope_u = 0.0
    for group in range(3):
        chi2 = 0.0
        cross = 0.0
        weights = 0.0
        for i in range(model.size):
            if rows.dhr_group[i] == group:
                v = rows.dhr_u2[i] if rows.dhr_u2[i] >= 0.0 else u_dhr * u_dhr
                residual = rows.dhr[i] - model[i]
                chi2 += residual * residual / v
                cross += residual * model[i] / v
                weights += model[i] * model[i] / v
                value -= 0.5 * (_LN_2PI + scalar_log(v))
        shrunk = rows.dhr_cal2 / (1.0 + rows.dhr_cal2 * weights)
        gain = cross * shrunk
        value -= 0.5 * (chi2 - cross * gain + np.log1p(rows.dhr_cal2 * weights))
        for i in range(model.size):
            if rows.dhr_group[i] == group:
                inferred = rows.dhr_u2[i] < 0.0
                v = u_dhr * u_dhr if inferred else rows.dhr_u2[i]
                residual = rows.dhr[i] - model[i]
                away = residual - gain * model[i]
                slopes[i] = ((1.0 + gain) * away - shrunk * model[i]) / v
                if inferred:
                    spread = away * away + shrunk * model[i] * model[i]
                    slope_u += u_dhr * (spread / (v * v) - 1.0 / v)
    return value, slope_u


@compiled(nogil=True)
def iid_log_likelihood(
    geometry: Geometry, rows: Rows, parameters: Array, digits: float, given: Given
) -> Array:
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

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    scratch = allocate_scratch(rows.y.size)
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
            log_f = at_rows(
                geometry, found.log_f[geometry.row_polarization[a]], a, scratch.log_f[a:b]
            )
            if rows.plain[scan]:
                s1, s2 = _moments(rows.y[a:b], log_f)
                value, _, _ = _plain_scan(s1, s2, b - a, s_rel, rows.u_cal2)
            else:
                work = cut_scratch(scratch, a, b)
                value, _ = scan_with_floor(
                    rows.y[a:b], log_f, rows.u2[a:b], rows.censored[a:b], s_rel, rows, VALUES,
                    work,
                )  # fmt: skip
            total += value
        result[j] = total
    return result


@compiled(nogil=True)
def iid_gradient(
    geometry: Geometry, rows: Rows, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """Log-likelihood and its derivatives by all parameters, from one pass.

    Parameters
    ----------
    geometry, rows, parameters, digits
        As for `iid_log_likelihood`.

    Returns
    -------
    tuple of ndarray, shapes (n_sets,) and (n_sets, n_par)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    slopes = np.zeros(parameters.shape)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    scratch = allocate_scratch(rows.y.size)
    dhr = np.empty(rows.dhr.size)
    dhr_work = np.empty(rows.dhr.size)
    physical = np.empty(4)
    sums = np.empty(3)
    ws = workspace()
    for j in range(n_sets):
        x = parameters[j]
        out = slopes[j]
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, SLOPES, ws, found)
        fill_dhr(geometry, surf, dhr)
        total, slope = dhr_readings(rows, dhr, x[rows.dhr_noise_column], dhr_work)
        if rows.dhr_noise_column >= 0:
            out[rows.dhr_noise_column] += slope
        for i in range(dhr.size):
            dhr_gradient(geometry, surf, i, physical)
            for p in range(4):
                out[p] += dhr_work[i] * physical[p]
        sums[:] = 0.0
        weight = 0.0
        for scan in range(rows.noise_column.size):
            a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
            s_rel = x[rows.noise_column[scan]]
            work = cut_scratch(scratch, a, b)
            log_f = at_rows(geometry, found.log_f[geometry.row_polarization[a]], a, work.log_f)
            if rows.plain[scan]:
                s1, s2 = _moments(rows.y[a:b], log_f)
                value, gain, by_v = _plain_scan(s1, s2, b - a, s_rel, rows.u_cal2)
                slope = 2.0 * s_rel * by_v
                _weigh(rows.y[a:b], log_f, gain, 1.0 / (s_rel * s_rel), work.slopes)
            else:
                value, slope = scan_with_floor(
                    rows.y[a:b], log_f, rows.u2[a:b], rows.censored[a:b], s_rel, rows, SLOPES,
                    work,
                )  # fmt: skip
            total += value
            out[rows.noise_column[scan]] += slope
            weight += add_scan_slopes(geometry, found, a, work.slopes, sums)
        to_parameters(sums[0], sums[1], sums[2], surf, physical)
        out[0] += physical[0]
        out[1] += physical[1]
        out[2] += weight / surf.sigma_n0
        out[3] += physical[3]
        result[j] = total
    return result, slopes
