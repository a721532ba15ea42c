"""A narrow peak around the direction back to the source: shadow hiding or coherent backscatter.

    f = a/pi  1 / (1 + tan^2(g/2)/w^2),    g the phase angle, between source and detector

a is its height over that of a white Lambertian, w its half width at half maximum in tan(g/2); null
a = 0. Reciprocal and unpolarised. With q = cos g = c_i c_r - s_i s_r cos(phi_r) it is
(1 + q)/(1 + q + (1 - q)/w^2), whose mean over the azimuth is a closed form.

Source: the variable tan(g/2) and the two causes are those of B. Hapke, "Bidirectional reflectance
spectroscopy: 5. The coherent backscatter opposition effect and anisotropic scattering", Icarus
157, 523 (2002), doi:10.1006/icar.2002.6853; the Lorentzian in it is ours: smooth at g = 0, as a
detector of finite aperture sees it.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.effects.polar_nodes import polar_nodes


@compiled(inline=True)
def backscatter_brdf(cos_g: float, height: float, width: float) -> float:
    """BRDF [sr^-1]; ``height`` is a, ``width`` w, in (0, 1)."""
    back = width * width * max(1.0 + cos_g, 0.0)
    return height / pi * back / (back + max(1.0 - cos_g, 0.0))


@compiled()
def backscatter_pole(width: float) -> float:
    """The cosine of the phase angle, beyond 1, at which the peak is singular."""
    return (1.0 + width * width) / (1.0 - width * width)


@compiled()
def backscatter_dhr(theta_i: float, height: float, width: float) -> float:
    """DHR [1] at the angle of incidence [rad]."""
    theta, weight = polar_nodes(theta_i, width)
    total = 0.0
    for i in range(theta.size):
        total += weight[i] * _ring(theta_i, theta[i], width * width)
    return height / pi * total


@compiled()
def _ring(theta_i: float, theta: float, w2: float) -> float:
    """Integral over the azimuth of c_r s_r w^2 (1 + q) / (w^2 (1 + q) + 1 - q).

    Numerator and denominator are linear in cos(phi): the numerator is t times the denominator and
    a constant, and the mean of 1/denominator is 1/sqrt(denominator nearest times farthest).
    """
    apart = sin(0.5 * (theta - theta_i))
    over = cos(0.5 * (theta + theta_i))
    nearest = 2.0 * apart * apart  # 1 - q where the ring comes nearest to the source
    opposite = 2.0 * over * over  # 1 + q where it is farthest
    d_near = w2 * (2.0 - nearest) + nearest
    d_far = w2 * opposite + 2.0 - opposite
    t = w2 / (w2 - 1.0)
    constant = w2 * (2.0 - nearest) - t * d_near
    mean = t + constant / sqrt(d_near * d_far)
    return 2.0 * pi * cos(theta) * sin(theta) * mean
