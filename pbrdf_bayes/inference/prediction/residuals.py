"""Residuals of the BRDF rows in dex and how much they hang together along a scan.

Two kinds. Plain: log10(measured/model), nothing else. Calibrated: what is left of it beside the
calibration factor of the scan and the noise of the instrument's floor; verdicts on the model follow
from these, since neither a factor that is free nor a reading lost in the floor speaks against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.readings.observation import Law, reading_law

Array = NDArray[np.float64]

_INDEPENDENT = 0.1
_TINY = 1e-280
_LN10 = float(np.log(10.0))
_CLEAR_OF_FLOOR = 0.5


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals at one parameter set.

    Attributes
    ----------
    dex : ndarray, shape (n_brdf,)
        NaN where the reading is censored.
    rms : float
        Over all rows [dex]; NaN without BRDF rows.
    lag1 : float
        Pooled correlation of neighbouring residuals about zero [1]; NaN without neighbours.
    scan_rms, scan_bias, scan_lag1 : ndarray, shape (n_scans,)
    """

    dex: Array
    rms: float
    lag1: float
    scan_rms: Array
    scan_bias: Array
    scan_lag1: Array


def compute_residuals(posterior: Posterior, x: Array) -> Residuals:
    """log10(measured/model) at the parameters ``x``, shape (n_par,), physical units."""
    brdf, _ = posterior.predict(x[None, :])
    dex = (posterior.rows.y - np.log(np.maximum(brdf[0], _TINY))) / _LN10
    dex[posterior.rows.censored] = np.nan
    return _statistics(posterior, dex, np.ones(dex.size))


def calibrated_residuals(posterior: Posterior, x: Array) -> Residuals:
    """Residuals beside the calibration factor of each scan, low readings weighted down.

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_par,)
        Physical units.

    Returns
    -------
    Residuals
        ``dex`` is log10(measured/(model with floor and factor)).
    """
    brdf, _ = posterior.predict(x[None, :])
    residual = log_residuals(posterior, brdf[0])
    weight = row_weights(posterior, x)
    dex = beside_gains(posterior, x, residual, weight)[0] / _LN10
    dex[posterior.rows.censored] = np.nan
    return _statistics(posterior, dex, weight)


def log_residuals(posterior: Posterior, brdf: Array) -> Array:
    """Ln(measured/expected) of every BRDF row beside the floor, shape (..., n_brdf).

    ``brdf`` is the model there [sr^-1], of the same shape.
    """
    return np.asarray(posterior.rows.y - reading_law(brdf, posterior.config.brdf_floor).mean)


def law_of_rows(posterior: Posterior, x: Array, brdf: Array) -> Law:
    """Law of every BRDF row; ``x`` is (..., n_par), the model there ``brdf`` (..., n_brdf)."""
    rows = posterior.rows
    white = x[..., rows.noise_column[scan_of_rows(posterior)]] ** 2 + rows.u2
    return reading_law(brdf, posterior.config.brdf_floor, white)


def scan_of_rows(posterior: Posterior) -> NDArray[np.int64]:
    """Index of the scan of every BRDF row, shape (n_brdf,)."""
    lengths = np.diff(posterior.rows.scan_start)
    return np.repeat(np.arange(lengths.size), lengths)


def weight_beside_floor(value: ArrayLike, floor: float, noise: ArrayLike) -> Array:
    """Relative variance without over with the floor's part, in [0, 1]; 1 without a floor.

    Parameters
    ----------
    value : array_like
        Readings [sr^-1].
    floor : float
        Noise-equivalent BRDF [sr^-1].
    noise : array_like
        Relative noise of a bright reading [1].
    """
    white = np.asarray(noise, dtype=np.float64) ** 2
    return np.asarray(white / reading_law(value, floor, white).variance)


def row_weights(posterior: Posterior, x: Array) -> Array:
    """`weight_beside_floor` of every BRDF row at the noises in ``x``; 0 where censored."""
    noise = x[posterior.rows.noise_column][scan_of_rows(posterior)]
    weight = weight_beside_floor(np.exp(posterior.rows.y), posterior.config.brdf_floor, noise)
    return np.where(posterior.rows.censored, 0.0, weight)


def row_shares(posterior: Posterior) -> Array:
    """H of every BRDF row, where the BRDF is what was read."""
    return reading_law(np.exp(posterior.rows.y), posterior.config.brdf_floor).share


def beside_gains(
    posterior: Posterior, x: Array, residual: Array, weight: Array
) -> tuple[Array, Array]:
    """Residuals beside the most probable ln of the calibration factor of their scan, and those.

    ``residual`` has the shape (n_brdf,) or (n_brdf, n), the factors (n_scans,) or (n_scans, n).
    """
    rows, h = posterior.rows, row_shares(posterior)
    if rows.u_cal2 == 0.0:
        return residual, np.zeros((rows.noise_column.size, *residual.shape[1:]))
    starts = rows.scan_start[:-1]
    sums = np.add.reduceat((weight * h * residual.T).T, starts, axis=0)
    known = np.add.reduceat(weight * h * h, starts) + x[rows.noise_column] ** 2 / rows.u_cal2
    gains = (sums.T / known).T
    return np.asarray(residual - (h * gains[scan_of_rows(posterior)].T).T), np.asarray(gains)


def _statistics(posterior: Posterior, dex: Array, weight: Array) -> Residuals:
    """Weighted rms and lag-1 correlation, pooled and by scan; a NaN takes no part."""
    kept = [
        (dex[rows][np.isfinite(dex[rows])], weight[rows][np.isfinite(dex[rows])])
        for rows in (s.rows for s in posterior.measurement.scans)
    ]
    pairs = [_neighbours(*scan) for scan in kept]
    pooled = tuple(np.concatenate(parts) for parts in zip(*kept, strict=True)) or (np.zeros(0),) * 2
    return Residuals(
        dex=dex,
        rms=_rms(*pooled),
        lag1=_ratio(sum(p for p, _ in pairs), sum(q for _, q in pairs)),
        scan_rms=np.array([_rms(r, w) for r, w in kept]),
        scan_bias=np.array([_ratio(np.sum(w * r), np.sum(w)) for r, w in kept]),
        scan_lag1=np.array([_ratio(*pair) for pair in pairs]),
    )


def lag1_of(values: Array, weight: Array) -> float:
    """Weighted correlation of neighbours about zero [1]; NaN without neighbours.

    Parameters
    ----------
    values, weight : ndarray, shape (n,)
        Residuals in the order of the scan, and their weights.
    """
    return _ratio(*_neighbours(values, weight))


def white_noise_dex(posterior: Posterior, x: Array) -> float:
    """Median over scans of the noise that second differences along theta_r show [dex].

    Smooth curves and smooth misfits cancel in second differences; repeated angles do not disturb.
    Where a lobe is narrow beside the steps its curvature does not: differences are taken of the
    readings and of their residuals about the model, and the smaller of the two counts, since either
    has the noise and more. Readings less than a few times the floor do not count.

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_par,)
        Physical units, where the model comes closest to the readings.
    """
    rows = posterior.rows
    residual = log_residuals(posterior, posterior.predict(x[None, :])[0][0])
    clear = weight_beside_floor(np.exp(rows.y), posterior.config.brdf_floor, 0.1) > _CLEAR_OF_FLOOR
    clear &= ~rows.censored
    levels = []
    for scan in posterior.measurement.scans:
        kept = [values[scan.rows][clear[scan.rows]] for values in (rows.y, residual)]
        if kept[0].size >= 5:
            levels.append(min(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0) for y in kept))
    return float(np.median(levels) / _LN10) if levels else float("nan")


def effective_share(lag1: float) -> float:
    """Effective over actual number of readings for a first-order autoregression, in (0, 1].

    Correlations below 0.1 are taken as none: white noise shows as much.
    """
    if not np.isfinite(lag1) or lag1 <= _INDEPENDENT:
        return 1.0
    return max((1.0 - lag1) / (1.0 + lag1), 1e-3)


def _rms(values: Array, weight: Array) -> float:
    return float(np.sqrt(_ratio(np.sum(weight * values**2), np.sum(weight))))


def _neighbours(values: Array, weight: Array) -> tuple[float, float]:
    """Sums of products and of squares of neighbouring residuals."""
    both = np.sqrt(weight[1:] * weight[:-1])
    squares = 0.5 * (values[1:] ** 2 + values[:-1] ** 2)
    return float(np.sum(both * values[1:] * values[:-1])), float(np.sum(both * squares))


def _ratio(numerator: float, denominator: float) -> float:
    return float(numerator / denominator) if denominator > 0.0 else float("nan")
