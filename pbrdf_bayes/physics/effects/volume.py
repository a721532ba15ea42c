"""Single scattering below the surface: Lommel-Seeliger with a phase function that peaks backwards.

    f = h_b/pi  2/(c_i + c_r)  [(1 - b)^2 / (1 - 2 b cos g + b^2)]^(3/2)
    cos g = c_i c_r - s_i s_r cos(phi_r)

c, s are cosines and sines of the two polar angles and g the phase angle, between the directions to
source and detector, so that the phase function is 1 where they coincide. Reciprocal and
unpolarised. Null h_b = 0; b in [0, 0.95]. In the hemisphere, with A = 1 + b^2 - 2 b c_i c_r and
B = 2 b s_i s_r, the azimuth gives a complete elliptic integral of the second kind:

    integral of (A - B cos phi)^(-3/2) d phi over a circle = 4 E(2B/(A + B)) / ((A - B) sqrt(A + B))

Source: H. Seeliger, Abh. Bayer. Akad. Wiss. 16, 405 (1888); S. Chandrasekhar, Radiative Transfer
(1960), section 47; phase function L. G. Henyey and J. L. Greenstein, Astrophys. J. 93, 70 (1941),
doi:10.1086/144246, scaled to 1 backwards.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.effects.polar_nodes import polar_nodes

_STEPS = 8
_NEGLIGIBLE = 1e-9


@compiled(inline=True)
def volume_brdf(cosine_i: float, cosine_r: float, cos_g: float, strength: float, b: float) -> float:
    """BRDF [sr^-1]; ``strength`` is h_b. The cosines are not both zero."""
    ratio = (1.0 - b) * (1.0 - b) / (1.0 - 2.0 * b * cos_g + b * b)
    return 2.0 * strength / (pi * (cosine_i + cosine_r)) * ratio * sqrt(ratio)


@compiled()
def volume_pole(b: float) -> float:
    """The cosine of the phase angle, beyond 1, at which the phase function is singular."""
    return 0.5 * (b + 1.0 / b)


@compiled()
def elliptic_e(m: float) -> float:
    """Complete elliptic integral of the second kind, 0 <= m <= 1, by the arithmetic-geometric mean.

    doi:10.6028/NBS.AMS.55, 17.6.
    """
    a, g = 1.0, sqrt(max(1.0 - m, 0.0))
    if g == 0.0:
        return 1.0
    total = 0.5 * m
    power = 0.5
    for _ in range(_STEPS):
        c = 0.5 * (a - g)
        a, g = 0.5 * (a + g), sqrt(a * g)
        power *= 2.0
        total += power * c * c
        if c < _NEGLIGIBLE:
            break
    return 0.5 * pi / a * (1.0 - total)


@compiled()
def volume_dhr(theta_i: float, strength: float, b: float) -> float:
    """DHR [1] at the angle of incidence [rad].

    Towards grazing incidence 1/(c_i + c_r) varies over the distance from the horizon, twice over.
    """
    theta, weight = polar_nodes(theta_i, min(1.0 - b, pi - 2.0 * theta_i))
    total = 0.0
    for i in range(theta.size):
        total += weight[i] * _ring(theta_i, theta[i], b)
    return strength / pi * total


@compiled()
def _ring(theta_i: float, theta: float, b: float) -> float:
    """Integral over the azimuth of 2 c_r s_r/(c_i + c_r) times the phase function."""
    c_i, s_i, c_r, s_r = cos(theta_i), sin(theta_i), cos(theta), sin(theta)
    apart = sin(0.5 * (theta - theta_i))
    half = 1.0 - b
    least = half * half + 4.0 * b * apart * apart  # A - B
    both = least + 4.0 * b * s_i * s_r  # A + B
    circle = 4.0 * elliptic_e(4.0 * b * s_i * s_r / both) / (least * sqrt(both))
    return 2.0 * c_r * s_r / (c_i + c_r) * half * half * half * circle
