"""A paint whose lobes are not Lorentzian: generalised Cauchy, in plain NumPy.

    [1 + (2^(1/nu) - 1) d^2/w^2]^-nu

keeps the half width w of the lobes of Eq. (3) and is the Lorentzian at nu = 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement

Array = NDArray[np.float64]

_N_GRID = 300


def _reflectance(x: Array, m2: complex) -> tuple[Array, Array]:
    c, c_t = np.sqrt(1.0 - x * x), np.sqrt(m2 - x * x)
    r_s, r_p = (c - c_t) / (c + c_t), (m2 * c - c_t) / (m2 * c + c_t)
    return np.abs(r_s) ** 2, np.abs(r_p) ** 2


def _lobe(distance: Array, f: Array, h: Array, rho: Array, nu: float) -> Array:
    """F/(h rho^2) times the shape of half width sqrt(h) rho: Eq. (3) for nu = 1."""
    width2 = h * rho * rho
    shape = (1.0 + (2.0 ** (1.0 / nu) - 1.0) * distance * distance / width2) ** -nu
    return np.asarray(f / width2 * shape)


def cauchy_log_brdf(alpha_i: float, alpha: Array, q: int, parameters: Array, nu: float) -> Array:
    """Ln BRDF in plane at the direction cosines ``alpha``, shape (n,); q is 0 for s, 1 for p."""
    n, k, sigma_n0, rho0 = parameters.tolist()
    m2 = complex(n, -k) ** 2
    f_0 = float(_reflectance(np.zeros(1), m2)[0][0])

    def along(a: Array) -> Array:
        f = _reflectance(0.5 * (a + alpha_i), m2)[q]
        h = 0.25 * (np.sqrt(1.0 - alpha_i**2) + np.sqrt(1.0 - a * a)) ** 2
        return _lobe(a - alpha_i, f, h, rho0 * (1.0 - f) / (1.0 - f_0), nu)

    def across(b: Array) -> Array:
        f = _reflectance(0.5 * b, m2)[1 - q]
        h = 0.25 * (1.0 + np.sqrt(1.0 - b * b)) ** 2
        return _lobe(b, f, h, rho0 * (1.0 - f) / (1.0 - f_0), nu)

    nodes, weights = np.polynomial.legendre.leggauss(_N_GRID)
    angle = 0.5 * np.pi * nodes  # alpha = sin t removes the ends of the disk
    a, rim = np.sin(angle), np.cos(angle)
    inner = np.sin(angle[None, :]) * rim[:, None]
    by_b = np.sum(0.5 * np.pi * weights * np.cos(angle) * rim[:, None] * across(inner), axis=1)
    norm = np.sum(0.5 * np.pi * weights * rim * along(a) * by_b)
    dhr = sigma_n0 * _reflectance(np.array([alpha_i]), m2)[q][0]
    return np.asarray(np.log(dhr / norm * along(alpha) * across(np.zeros(1))))


def cauchy_log_ratio(measurement: Measurement, parameters: Array, nu: float) -> Array:
    """Ln of the BRDF with exponent nu over the Lorentzian one, for every row of in-plane scans."""
    found = np.empty(len(measurement.brdf))
    for scan in measurement.scans:
        alpha_i = float(np.sin(np.deg2rad(scan.theta_i_deg)))
        alpha = np.sin(np.deg2rad(measurement.brdf.theta_r_deg[scan.rows]))
        q = "sp".index(scan.polarization)
        ratio = [cauchy_log_brdf(alpha_i, alpha, q, parameters, e) for e in (nu, 1.0)]
        found[scan.rows] = ratio[0] - ratio[1]
    return found
