"""The paper's wish, an analytic normalisation: two approximations and where they stand.

With every slowly varying factor of Eq. (3) frozen at its peak both lobes are Lorentzians,

    A_q(alpha) ~ F_q(alpha_i) / [(alpha - alpha_i)^2 + w^2],   w = cos(theta_i) rho_q(alpha_i)
    B_q'(beta) ~ F(0) / [beta^2 + rho0^2]

and with the rim of the disk taken at alpha = alpha_i the integral is a product of arctangents:

    I_q ~ F_q(alpha_i) F(0) / (w rho0)
          * [atan((1 - alpha_i)/w) + atan((1 + alpha_i)/w)] * 2 atan(cos(theta_i)/rho0)

The few-term form keeps A and the rim and freezes B only: 4 Gauss nodes on either side of the peak.
"""

from __future__ import annotations

from math import asinh, atan, pi

import numpy as np

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface, lobes, reflectances, transmittances
from pbrdf_bayes.physics.normalisation.plain import Incidence

_HALF_NODES, _HALF_WEIGHTS = np.polynomial.legendre.leggauss(4)
_NODES, _WEIGHTS = 0.5 * (1.0 + _HALF_NODES), 0.5 * _HALF_WEIGHTS


@compiled()
def closed_form(inc: Incidence, surf: Surface) -> tuple[float, float]:
    """I_s and I_p with all slowly varying factors frozen at the peak."""
    f_s, f_p = reflectances(inc.sine, inc.cosine, surf)
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    f_0, _ = reflectances(0.0, 1.0, surf)
    scale = inc.cosine * surf.rho0 / surf.transmittance0
    across = 2.0 * f_0 / surf.rho0 * atan(inc.cosine / surf.rho0)
    w_s, w_p = scale * t_s, scale * t_p
    ends_s = atan((1.0 - inc.sine) / w_s) + atan((1.0 + inc.sine) / w_s)
    ends_p = atan((1.0 - inc.sine) / w_p) + atan((1.0 + inc.sine) / w_p)
    return across * f_s / w_s * ends_s, across * f_p / w_p * ends_p


@compiled()
def few_terms(inc: Incidence, surf: Surface) -> tuple[float, float]:
    """I_s and I_p with B frozen and A summed over eight nodes."""
    t_s, t_p = transmittances(inc.sine, inc.cosine, surf)
    width = min(t_s, t_p) / surf.transmittance0 * surf.rho0
    f_0, _ = reflectances(0.0, 1.0, surf)
    total_s, total_p = 0.0, 0.0
    for sign in (-1.0, 1.0):
        length = asinh((0.5 * pi - sign * inc.theta) / width)
        for i in range(_NODES.size):
            u = length * _NODES[i]
            t = inc.theta + sign * width * np.sinh(u)
            sine, cosine = np.sin(t), max(np.cos(t), 0.0)
            x = 0.5 * (sine + inc.sine)
            c = np.sqrt((1.0 - x) * (1.0 + x))
            h = 0.25 * (inc.cosine + cosine) ** 2
            a_s, a_p = lobes(x, c, sine - inc.sine, h, surf)
            across = 2.0 * f_0 / surf.rho0 * atan(cosine / surf.rho0)
            weight = length * _WEIGHTS[i] * width * np.cosh(u) * cosine * across
            total_s += weight * a_s
            total_p += weight * a_p
    return total_s, total_p
