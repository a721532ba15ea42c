"""Equations (2) to (6) of the 2011 paper as they are printed, for readers and for comparison.

The kernels compute the same in another arrangement: without cancellation, in logarithms, the
integral of Eq. (4) by two integrals over a line. ``tests/physics/test_equations.py`` holds them to
the functions of this module, at many points.

==========  ======================================================================
F_q         `pbrdf_bayes.physics.fresnel.reflectances`
Eq. (2)     `pbrdf_bayes.physics.brdf.fill_dhr`
Eq. (3)     `pbrdf_bayes.physics.brdf.log_brdf`
Eq. (3a)    `pbrdf_bayes.physics.fresnel.lobe_fractions`; general `..lobes.shaped`
Eq. (3b)    the same function with other arguments
Eq. (4)     `pbrdf_bayes.physics.normalisation.plain.integrals`; general `..shaped`
Eq. (5)     `pbrdf_bayes.physics.fresnel.transmittances` times `Surface.width`
Eq. (6)     `pbrdf_bayes.physics.brdf._log_mean`
==========  ======================================================================

alpha_i is the sine of the angle of incidence; (alpha, beta) are the direction cosines of the
scattered light; q is 0 for s and 1 for p, and 1 - q the other one. Every function takes scalars or
arrays. They lose digits where the kernels do not: at grazing angles and as n goes to 1.

Source: Renhorn, Hallberg, Bergstrom, Boreman, Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = float | Array


class FourParameters(NamedTuple):
    """n - ik, sigma_N0 and rho0 [1]."""

    n: float
    k: float
    sigma_n0: float
    rho0: float


def fresnel(q: int, x: Values, paint: FourParameters) -> Array:
    """F_q(x), the power reflectance [1] at the direction sine x."""
    m2 = complex(paint.n, -paint.k) ** 2
    c, c_t = np.sqrt(1.0 - np.square(x)), np.sqrt(m2 - np.square(x))
    r = (c - c_t) / (c + c_t) if q == 0 else (m2 * c - c_t) / (m2 * c + c_t)
    return np.asarray(np.abs(r) ** 2)


def half_width(q: int, x: Values, paint: FourParameters) -> Array:
    """rho_q(x) [1], Eq. (5): a lobe narrows as the surface reflects more."""
    return paint.rho0 * (1.0 - fresnel(q, x, paint)) / (1.0 - fresnel(q, 0.0, paint))


def lobe_along(q: int, alpha: Values, alpha_i: Values, paint: FourParameters) -> Array:
    """A_q(alpha; alpha_i), Eq. (3a): the lobe in the plane of incidence."""
    x = (alpha + alpha_i) / 2.0
    h = (np.sqrt(1.0 - np.square(alpha_i)) + np.sqrt(1.0 - np.square(alpha))) ** 2 / 4.0
    w2 = h * half_width(q, x, paint) ** 2
    return fresnel(q, x, paint) / (np.square(alpha - alpha_i) + w2)


def lobe_across(q: int, beta: Values, paint: FourParameters) -> Array:
    """B_q(beta), Eq. (3b): the lobe out of that plane, A_q at normal incidence."""
    h = (1.0 + np.sqrt(1.0 - np.square(beta))) ** 2 / 4.0
    w2 = h * half_width(q, beta / 2.0, paint) ** 2
    return fresnel(q, beta / 2.0, paint) / (np.square(beta) + w2)


def dhr(q: int, alpha_i: Values, paint: FourParameters) -> Array:
    """DHR_q(alpha_i) [1], Eq. (2)."""
    return paint.sigma_n0 * fresnel(q, alpha_i, paint)


def disk_integral(q: int, alpha_i: float, paint: FourParameters, *, n_panels: int = 12) -> float:
    """I_q(alpha_i), Eq. (4): A_q B_q' integrated over the disk alpha^2 + beta^2 <= 1.

    By a product of Gauss rules in polar coordinates, with panels of equal length: for lobes that
    are not narrow.

    Examples
    --------
    >>> round(disk_integral(0, 0.5, FourParameters(1.5, 0.0, 1.0, 0.5)), 6)
    0.046848
    """
    node, weight = np.polynomial.legendre.leggauss(12)
    panel = np.arange(2 * n_panels)[:, None]
    place = ((panel + 0.5 + 0.5 * node) / (2 * n_panels)).ravel()
    w = np.tile(0.5 * weight, 2 * n_panels) / (2 * n_panels)
    theta, phi = 0.5 * np.pi * place[:, None], np.pi * place
    alpha, beta = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    f = lobe_along(q, alpha, alpha_i, paint) * lobe_across(1 - q, beta, paint)
    area = (0.5 * np.pi * w)[:, None] * np.sin(theta) * np.cos(theta) * (np.pi * w)
    return float(2.0 * np.sum(area * f))


def scale(q: int, alpha_i: float, paint: FourParameters) -> float:
    """sigma_N^q(alpha_i) = DHR_q / I_q: with it f_q has the DHR of Eq. (2)."""
    return float(dhr(q, alpha_i, paint) / disk_integral(q, alpha_i, paint))


def brdf(q: int, alpha_i: float, alpha: Values, beta: Values, paint: FourParameters) -> Array:
    """f_q(alpha_i; alpha, beta) [sr^-1], Eq. (3)."""
    shape = lobe_along(q, alpha, alpha_i, paint) * lobe_across(1 - q, beta, paint)
    return scale(q, alpha_i, paint) * shape


def unpolarised_brdf(alpha_i: float, alpha: Values, beta: Values, paint: FourParameters) -> Array:
    """The mean of f_s and f_p [sr^-1], Eq. (6)."""
    return 0.5 * (brdf(0, alpha_i, alpha, beta, paint) + brdf(1, alpha_i, alpha, beta, paint))
