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

from math import erfc, pi, sqrt
from math import log as scalar_log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.brdf import (
    Geometry,
    add_scan_slopes,
    at_rows,
    buffers,
    dhr_gradient,
    fill_dhr,
    log_brdf,
    sum_of,
    to_parameters,
)
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.normalisation import SLOPES, VALUES, workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LN_2PI = scalar_log(2.0 * pi)
_TINY = 1e-280
RELATIVE_SCALE = 10.0
"""u_cal where the scale of a scan is free: a factor exp(10) either way."""


_GAIN_NODES, _GAIN_WEIGHTS = np.polynomial.hermite_e.hermegauss(24)
_GAIN_LOG_WEIGHTS = np.log(_GAIN_WEIGHTS / np.sqrt(2.0 * np.pi))


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


@compiled()
def log_normal_cdf(z: float) -> float:
    """Ln Phi(z), without underflow for z down to -1e150."""
    if z > -20.0:
        return scalar_log(0.5 * erfc(-z / sqrt(2.0)))
    z2 = 1.0 / (z * z)
    series = 1.0 - z2 * (1.0 - 3.0 * z2 * (1.0 - 5.0 * z2 * (1.0 - 7.0 * z2)))
    return -0.5 * z * z - 0.5 * _LN_2PI - scalar_log(-z) + scalar_log(series)


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


class Scratch(NamedTuple):
    """Scratch of one evaluation, allocated once for many; one element a row."""

    log_f: Array
    slopes: Array
    """Slopes of the log-likelihood by ln f."""
    residual: Array
    precision: Array
    f2: Array
    share: Array
    """Of each node of the gain."""


@compiled()
def _scratch(n_rows: int) -> Scratch:
    rows = np.empty((5, n_rows))
    return Scratch(rows[0], rows[1], rows[2], rows[3], rows[4], np.empty(_GAIN_NODES.size))


@compiled()
def _cut(work: Scratch, a: int, b: int) -> Scratch:
    return Scratch(
        work.log_f[a:b], work.slopes[a:b], work.residual[a:b], work.precision[a:b], work.f2[a:b],
        work.share,
    )  # fmt: skip


@compiled()
def _compare_with_floor(
    y: Array, log_f: Array, u2: Array, censored: NDArray[np.bool_],
    s2: float, floor2: float, work: Scratch,
) -> None:  # fmt: skip
    """Residuals y - 1/2 ln(f^2 + b^2), their precisions 1/v without the gain, and f^2.

    The precision of a censored reading is zero.
    """
    residual, precision, f2 = work.residual, work.precision, work.f2
    for i in range(y.size):
        f2[i] = exp(2.0 * min(max(log_f[i], -300.0), 300.0))
        with_floor = f2[i] + floor2
        residual[i] = y[i] - 0.5 * log(with_floor)
        found = with_floor / ((s2 + u2[i]) * with_floor + floor2)
        precision[i] = 0.0 if censored[i] else found


@compiled(reassociate=True)
def _weighted_moments(residual: Array, precision: Array) -> tuple[float, float, float]:
    """Sums of the weights, of the weighted residuals and of their squares."""
    weights = 0.0
    total = 0.0
    chi2 = 0.0
    for i in range(residual.size):
        weighted = precision[i] * residual[i]
        weights += precision[i]
        total += weighted
        chi2 += weighted * residual[i]
    return weights, total, chi2


@compiled()
def _sum_of_logs(values: Array, work: Array) -> float:
    """Sum of the logarithms of the values that are not zero, one logarithm for four of them."""
    n = values.size // 4
    v0, v1, v2, v3 = values[:n], values[n : 2 * n], values[2 * n : 3 * n], values[3 * n : 4 * n]
    logs = work[:n]
    for i in range(n):
        left = (v0[i] if v0[i] > 0.0 else 1.0) * (v1[i] if v1[i] > 0.0 else 1.0)
        right = (v2[i] if v2[i] > 0.0 else 1.0) * (v3[i] if v3[i] > 0.0 else 1.0)
        logs[i] = log(left * right)
    total = sum_of(logs)
    for i in range(4 * n, values.size):
        total += log(values[i] if values[i] > 0.0 else 1.0)
    return total


@compiled()
def _variance(f2: float, u2: float, s_rel: float, floor2: float) -> tuple[float, float]:
    """Variance of ln(reading) without the gain, and d mean / d ln f."""
    above = f2 / (f2 + floor2)
    return s_rel * s_rel + u2 + floor2 / (f2 + floor2), above


@compiled()
def _censored_nodes(
    u2: Array, censored: NDArray[np.bool_], s_rel: float, rows: Rows,
    gain: float, gain_sd: float, work: Scratch, share: Array,
) -> float:  # fmt: skip
    """Log-probability of all censored readings, the gain ~ N(gain, gain_sd^2) integrated out.

    Gauss-Hermite quadrature; the posterior shares of its nodes go into ``share``, of which there
    is only one where the gain is known.
    """
    for k in range(share.size):
        known = share.size == 1
        node = gain if known else gain + gain_sd * _GAIN_NODES[k]
        share[k] = 0.0 if known else _GAIN_LOG_WEIGHTS[k]
        for i in range(u2.size):
            if censored[i]:
                v, _ = _variance(work.f2[i], u2[i], s_rel, rows.floor2)
                share[k] += log_normal_cdf((work.residual[i] - node) / sqrt(v))
    largest = share.max()
    total = 0.0
    for k in range(share.size):
        share[k] = np.exp(share[k] - largest)
        total += share[k]
    for k in range(share.size):
        share[k] /= total
    result: float = largest + scalar_log(total)
    return result


@compiled(reassociate=True)
def _observed_slopes(
    censored: NDArray[np.bool_], floor2: float, gain: float, shrunk: float,
    by_gain: float, by_spread: float, work: Scratch,
) -> float:  # fmt: skip
    """Slopes by ln f of the readings above the floor; returns the sum of those by the variance.

    ``by_gain`` and ``by_spread`` are the slopes of the censored readings by the mean of the gain
    and by half its variance.
    """
    residual, precision, f2, out = work.residual, work.precision, work.f2, work.slopes
    total = 0.0
    for i in range(residual.size):
        above = f2[i] / (f2[i] + floor2)
        away = (residual[i] - gain) * precision[i]
        by_residual = by_gain * shrunk * precision[i] - away
        by_v = 0.5 * (away * away - precision[i])
        by_v += precision[i] * (
            precision[i] * shrunk * (0.5 + 0.5 * by_spread) - by_gain * shrunk * away
        )
        total += by_v
        slope = -above * (by_residual + 2.0 * by_v * (1.0 - above))
        out[i] = out[i] if censored[i] else slope
    return total


@compiled()
def _scan_with_floor(
    y: Array, log_f: Array, u2: Array, censored: NDArray[np.bool_],
    s_rel: float, rows: Rows, n_series: int, work: Scratch,
) -> tuple[float, float]:  # fmt: skip
    """A scan with a floor, stated uncertainties or censored readings.

    Returns the log-likelihood and, where ``n_series`` is SLOPES, its slope by s_rel; the slopes by
    ln f then go into ``work.slopes``.
    """
    _compare_with_floor(y, log_f, u2, censored, s_rel * s_rel, rows.floor2, work)
    weights, total, chi2 = _weighted_moments(work.residual, work.precision)
    n_censored = 0
    for i in range(censored.size):
        n_censored += censored[i]
    shrunk = rows.u_cal2 / (1.0 + rows.u_cal2 * weights)  # posterior variance of the gain
    gain = total * shrunk
    gain_sd = sqrt(shrunk)
    value = -0.5 * ((y.size - n_censored) * _LN_2PI - _sum_of_logs(work.precision, work.slopes))
    value -= 0.5 * (chi2 - total * gain + np.log1p(rows.u_cal2 * weights))
    by_gain = 0.0
    by_gain_sd = 0.0
    by_variance = 0.0
    if n_censored:
        share = work.share[: _GAIN_NODES.size if shrunk > 0.0 else 1]
        value += _censored_nodes(u2, censored, s_rel, rows, gain, gain_sd, work, share)
        for i in range(y.size):
            if n_series != SLOPES or not censored[i]:
                continue
            v, above = _variance(work.f2[i], u2[i], s_rel, rows.floor2)
            by_residual = 0.0
            by_v = 0.0
            for k in range(share.size):
                node = _GAIN_NODES[k] if share.size > 1 else 0.0
                z = (work.residual[i] - gain - gain_sd * node) / sqrt(v)
                hazard = share[k] * np.exp(-0.5 * z * z - 0.5 * _LN_2PI - log_normal_cdf(z))
                by_residual += hazard / sqrt(v)
                by_v -= 0.5 * hazard * z / v
                by_gain_sd -= hazard * node / sqrt(v)
            by_gain -= by_residual
            by_variance += by_v
            work.slopes[i] = -by_residual * above - 2.0 * by_v * above * (1.0 - above)
    if n_series == SLOPES:
        by_variance += _observed_slopes(
            censored, rows.floor2, gain, shrunk, by_gain, by_gain_sd * gain_sd, work
        )
    return value, 2.0 * s_rel * by_variance


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
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    scratch = _scratch(rows.y.size)
    dhr = np.empty(rows.dhr.size)
    dhr_work = np.empty(rows.dhr.size)
    ws = workspace()
    for j in range(n_sets):
        x = parameters[j]
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, VALUES, ws, found)
        fill_dhr(geometry, surf, dhr)
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
                work = _cut(scratch, a, b)
                value, _ = _scan_with_floor(
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
    scratch = _scratch(rows.y.size)
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
            work = _cut(scratch, a, b)
            log_f = at_rows(geometry, found.log_f[geometry.row_polarization[a]], a, work.log_f)
            if rows.plain[scan]:
                s1, s2 = _moments(rows.y[a:b], log_f)
                value, gain, by_v = _plain_scan(s1, s2, b - a, s_rel, rows.u_cal2)
                slope = 2.0 * s_rel * by_v
                _weigh(rows.y[a:b], log_f, gain, 1.0 / (s_rel * s_rel), work.slopes)
            else:
                value, slope = _scan_with_floor(
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
