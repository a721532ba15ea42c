"""Residuals of the BRDF rows in dex and how much they hang together along a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_INDEPENDENT = 0.1


@dataclass(frozen=True, eq=False)
class Residuals:
    """log10(measured/model) at one parameter set.

    Attributes
    ----------
    dex : ndarray, shape (n_brdf,)
        NaN where the reading is censored.
    rms : float
        Over all rows [dex]; NaN without BRDF rows.
    lag1 : float
        Pooled correlation of neighbouring residuals about zero [1].
    scan_rms, scan_bias, scan_lag1 : ndarray, shape (n_scans,)
    """

    dex: Array
    rms: float
    lag1: float
    scan_rms: Array
    scan_bias: Array
    scan_lag1: Array


def compute_residuals(posterior: Posterior, x: Array) -> Residuals:
    """Residuals at the parameters ``x``, shape (n_par,), physical units."""
    brdf, _ = posterior.predict(x[None, :])
    dex = (posterior.rows.y - np.log(np.maximum(brdf[0], 1e-280))) / np.log(10.0)
    dex[posterior.rows.censored] = np.nan
    per_scan = [dex[scan.rows] for scan in posterior.measurement.scans]
    kept = [scan[np.isfinite(scan)] for scan in per_scan]
    products = sum(float(np.sum(r[1:] * r[:-1])) for r in kept)
    squares = sum(float(np.sum(0.5 * (r[1:] ** 2 + r[:-1] ** 2))) for r in kept)
    return Residuals(
        dex=dex,
        rms=_rms(np.concatenate(kept) if kept else np.zeros(0)),
        lag1=products / squares if squares > 0.0 else float("nan"),
        scan_rms=np.array([_rms(r) for r in kept]),
        scan_bias=np.array([r.mean() if r.size else np.nan for r in kept]),
        scan_lag1=np.array([_lag1(r) for r in kept]),
    )


def white_noise_dex(posterior: Posterior) -> float:
    """Median over scans of the noise that second differences along theta_r show [dex].

    Smooth curves and smooth misfits cancel in second differences; repeated angles do not disturb.
    """
    levels = []
    for scan in posterior.measurement.scans:
        y = posterior.rows.y[scan.rows][~posterior.rows.censored[scan.rows]]
        if y.size >= 5:
            levels.append(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0))
    return float(np.median(levels) / np.log(10.0)) if levels else float("nan")


def effective_share(lag1: float) -> float:
    """Effective over actual number of readings for a first-order autoregression, in (0, 1].

    Correlations below 0.1 are taken as none: white noise shows as much.
    """
    if not np.isfinite(lag1) or lag1 <= _INDEPENDENT:
        return 1.0
    return max((1.0 - lag1) / (1.0 + lag1), 1e-3)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _lag1(values: Array) -> float:
    squares = float(np.sum(0.5 * (values[1:] ** 2 + values[:-1] ** 2)))
    return float(np.sum(values[1:] * values[:-1])) / squares if squares > 0.0 else float("nan")
