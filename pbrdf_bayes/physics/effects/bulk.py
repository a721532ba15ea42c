"""Bulk scatter seen through the surface: light that enters, loses its direction, and leaves.

    f_q = D_b/pi  T_q(theta_i) Tbar(theta_r) / T(0)^2,    T_q = 1 - F_q,  Tbar = (T_s + T_p)/2

The light is unpolarised inside, whatever enters; that which leaves is detected whatever its
polarisation. T_q(theta_i) gives bulk scatter the polarisation of what enters. Null D_b = 0. In the
hemisphere

    DHR_q = D_b T_q(theta_i) / T(0)^2  integral of Tbar(mu) 2 mu d mu over [0, 1].

Source: L. B. Wolff, "Diffuse-reflectance model for smooth dielectric surfaces", J. Opt. Soc. Am. A
11, 2956 (1994), doi:10.1364/JOSAA.11.002956, with the transmittances of the effective index and
without its series of internal reflections, which D_b holds.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface, transmittances

_X, _W = np.polynomial.legendre.leggauss(24)
_ROOT_COSINE, _WEIGHT = 0.5 * (1.0 + _X), 0.5 * _W


@compiled(inline=True)
def bulk_brdf(
    sine_i: float, cosine_i: float, sine_r: float, cosine_r: float, strength: float, surf: Surface
) -> tuple[float, float]:
    """BRDF [sr^-1] for s and p illumination; ``strength`` is D_b."""
    in_s, in_p = transmittances(sine_i, cosine_i, surf)
    out_s, out_p = transmittances(sine_r, cosine_r, surf)
    common = strength * 0.5 * (out_s + out_p) / (pi * surf.transmittance0 * surf.transmittance0)
    return in_s * common, in_p * common


@compiled()
def escape(surf: Surface) -> float:
    """Integral of Tbar(mu) 2 mu d mu over [0, 1]; mu = x^2 resolves grazing near n = 1."""
    total = 0.0
    for i in range(_ROOT_COSINE.size):
        x = _ROOT_COSINE[i]
        mu = x * x
        t_s, t_p = transmittances(sqrt((1.0 - mu) * (1.0 + mu)), mu, surf)
        total += _WEIGHT[i] * 2.0 * x * mu * (t_s + t_p)
    return total


@compiled()
def bulk_dhr(
    sine_i: float, cosine_i: float, strength: float, escaped: float, surf: Surface
) -> tuple[float, float]:
    """DHR [1] for s and p illumination; ``escaped`` is from `escape`."""
    in_s, in_p = transmittances(sine_i, cosine_i, surf)
    common = strength * escaped / (surf.transmittance0 * surf.transmittance0)
    return in_s * common, in_p * common
