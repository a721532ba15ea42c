"""The i.i.d. likelihood of log-BRDF and DHR residuals.

For the rows a of scan j with model BRDF f, gain c_j and instrument floor b (noise-equivalent BRDF):

    y_a = ln(measured BRDF) ~ N( 1/2 ln(f^2 + b^2) + c_j,  s_q^2 + u_a^2 + b^2/(f^2 + b^2) )
    c_j ~ N(0, u_cal^2)

s_q is the inferred relative noise of polarisation q and u_a what the laboratory stated. Readings
at or below the floor are censored: they contribute the probability of falling there. DHR readings
D_a of polarisation q share a gain:

    D_a = g_q D_q(theta_a) + noise,   g_q ~ N(1, u_dhr_cal^2)

Both gains are marginalised analytically (rank-one update of a diagonal covariance). Rows are
taken as independent given these; a misfit correlated along theta_r makes the result too narrow.
"""

from __future__ import annotations

from math import erfc, pi, sqrt
from math import log as scalar_log
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.brdf import Geometry, brdf_s_p, fill_dhr, mix_rows
from pbrdf_bayes.physics.elementary import log
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.normalisation import workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LN_2PI = scalar_log(2.0 * pi)
_TINY = 1e-280
RELATIVE_SCALE = 10.0
"""u_cal where the scale of a scan is free: a factor exp(10) either way."""


class Rows(NamedTuple):
    """Readings as the likelihood needs them; everything that the parameters do not enter.

    ``noise_column`` is the parameter column of s_q per scan, ``dhr_noise_column`` that of u_DHR or
    -1; ``u2`` is the stated relative variance (``u_DHR`` absolute). ``plain`` scans have neither a
    floor nor stated uncertainties: their rows share one variance.
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
            u2[scan.rows][pooled] = u2[scan.rows][pooled].mean()
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
        log_floor=float(np.log(max(floor, _TINY))),
        u_cal2=u_cal * u_cal,
        dhr=dhr.value,
        dhr_u2=np.where(np.isnan(dhr.u_value), -1.0, dhr.u_value**2),
        dhr_group=np.array([("s", "p", "u").index(q) for q in dhr.polarization.tolist()], np.int64),
        dhr_noise_column=dhr_noise_column,
        dhr_cal2=u_dhr_cal * u_dhr_cal,
    )


@njit(cache=True, error_model="numpy")
def log_normal_cdf(z: float) -> float:
    """ln Phi(z), without underflow for z down to -1e150."""
    if z > -20.0:
        return scalar_log(0.5 * erfc(-z / sqrt(2.0)))
    z2 = 1.0 / (z * z)
    series = 1.0 - z2 * (1.0 - 3.0 * z2 * (1.0 - 5.0 * z2 * (1.0 - 7.0 * z2)))
    return -0.5 * z * z - 0.5 * _LN_2PI - scalar_log(-z) + scalar_log(series)


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _moments(residual: Array) -> tuple[float, float]:
    """Sum and sum of squares."""
    total = 0.0
    squares = 0.0
    for i in range(residual.size):
        total += residual[i]
        squares += residual[i] * residual[i]
    return total, squares


@njit(cache=True, error_model="numpy")
def _log_residuals(y: Array, model: Array, out: Array) -> None:
    """Y minus ln(model), into ``out``."""
    for i in range(y.size):
        out[i] = y[i] - log(max(model[i], _TINY))


@njit(cache=True, error_model="numpy")
def _plain_scan(y: Array, model: Array, s_rel: float, u_cal2: float, out: Array) -> float:
    """Log-likelihood of a scan whose rows share the variance s_rel^2."""
    _log_residuals(y, model, out)
    total, squares = _moments(out)
    variance = s_rel * s_rel
    inflation = 1.0 + u_cal2 * y.size / variance
    chi2 = (squares - total * total * u_cal2 / (variance * inflation)) / variance
    return -0.5 * (chi2 + y.size * (_LN_2PI + scalar_log(variance)) + scalar_log(inflation))


@njit(cache=True, error_model="numpy")
def _scan_with_floor(
    y: Array, model: Array, u2: Array, censored: NDArray[np.bool_], s_rel: float, rows: Rows
) -> float:
    """Log-likelihood of a scan with a floor, stated uncertainties or censored readings."""
    total = 0.0
    chi2 = 0.0
    weights = 0.0
    log_terms = 0.0
    for i in range(y.size):
        f2 = max(model[i] * model[i], _TINY)
        with_floor = f2 + rows.floor2
        variance = s_rel * s_rel + u2[i] + rows.floor2 / with_floor
        residual = y[i] - 0.5 * scalar_log(with_floor)
        if censored[i]:
            log_terms -= 2.0 * log_normal_cdf(residual / sqrt(variance + rows.u_cal2))
        else:
            weights += 1.0 / variance
            total += residual / variance
            chi2 += residual * residual / variance
            log_terms += _LN_2PI + scalar_log(variance)
    inflation = 1.0 + rows.u_cal2 * weights
    chi2 -= total * total * rows.u_cal2 / inflation
    return -0.5 * (chi2 + log_terms + scalar_log(inflation))


@njit(cache=True, error_model="numpy")
def _dhr_readings(rows: Rows, model: Array, u_dhr: float) -> float:
    """Log-likelihood of the DHR readings; one gain for each polarisation."""
    result = 0.0
    for group in range(3):
        chi2 = 0.0
        cross = 0.0
        weights = 0.0
        log_terms = 0.0
        for i in range(model.size):
            if rows.dhr_group[i] != group:
                continue
            variance = rows.dhr_u2[i] if rows.dhr_u2[i] >= 0.0 else u_dhr * u_dhr
            residual = rows.dhr[i] - model[i]
            chi2 += residual * residual / variance
            cross += residual * model[i] / variance
            weights += model[i] * model[i] / variance
            log_terms += _LN_2PI + scalar_log(variance)
        inflation = 1.0 + rows.dhr_cal2 * weights
        chi2 -= cross * cross * rows.dhr_cal2 / inflation
        result -= 0.5 * (chi2 + log_terms + scalar_log(inflation))
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def iid_log_likelihood(geometry: Geometry, rows: Rows, parameters: Array, digits: float) -> Array:
    """Log-likelihood of every parameter set.

    Parameters
    ----------
    geometry : Geometry
    rows : Rows
    parameters : ndarray, shape (n_sets, n_par)
        Physical units; the first four columns are n, k, sigma_n0, rho0.
    digits : float
        Correct decimal digits of the normalisation.

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets = parameters.shape[0]
    result = np.empty(n_sets)
    s_p = np.empty((2, geometry.directions.shape[1]))
    brdf = np.empty(rows.y.size)
    residual = np.empty(rows.y.size)
    dhr = np.empty(rows.dhr.size)
    ws = workspace()
    for j in range(n_sets):
        x = parameters[j]
        surf = surface(x[0], x[1], x[2], x[3])
        brdf_s_p(geometry, surf, digits, ws, s_p)
        mix_rows(geometry, s_p, brdf)
        fill_dhr(geometry, surf, dhr)
        total = _dhr_readings(rows, dhr, x[rows.dhr_noise_column])
        for scan in range(rows.noise_column.size):
            a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
            s_rel = x[rows.noise_column[scan]]
            if rows.plain[scan]:
                total += _plain_scan(rows.y[a:b], brdf[a:b], s_rel, rows.u_cal2, residual[a:b])
            else:
                total += _scan_with_floor(
                    rows.y[a:b], brdf[a:b], rows.u2[a:b], rows.censored[a:b], s_rel, rows
                )
        result[j] = total
    return result
