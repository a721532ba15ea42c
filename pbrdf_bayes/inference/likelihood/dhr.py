"""The likelihood of DHR readings.

Readings D_a of polarisation q share a gain, which is marginalised analytically:

    D_a = g_q D_q(theta_a) + noise,   g_q ~ N(1, u_dhr_cal^2)

They come from an instrument of their own and share nothing with the scans.
"""

from __future__ import annotations

from math import log as scalar_log
from math import pi

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.physics.brdf import dhr_gradient
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface
from pbrdf_bayes.physics.geometry import Geometry

Array = NDArray[np.float64]

_LN_2PI = scalar_log(2.0 * pi)


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
