"""Lobes beyond the strict model: any line shape, narrowing, and place of the Fresnel factor.

    A_q = F_q / w_q^2 * S(offset^2 / w_q^2),   w_q^2 = h rho_q(x)^2,
    rho_q(x) = rho0 [(1 - F_q(x)) / (1 - F(0))]^g

with the arguments x, c, offset, h of `fresnel.lobe_fractions`: they serve A and B alike. S is a
line shape; g, the narrowing, is 1 in Eq. (5). With the Lorentzian and g = 1 this is Eq. (3).

The factor F_q in front is taken at one of three places:

- ``MEAN_SINE``: at x, the mean direction sine; this is the paper's.
- ``GEOMETRIC_MEAN``: sqrt(F_q(alpha_i) F_q(alpha)), for B sqrt(F_q(0) F_q(beta)), after Stover.
- ``MEAN_ANGLE``: at the sine of the mean of the two angles.

All follow from x, offset and h: alpha = x + offset/2, its cosine sqrt(h) - x offset / (2 sqrt(h)),
and x / sqrt(h) is the tangent of the mean angle.

In a kernel, per parameter set (the first three lines), angle of incidence and direction::

    shaped = lobe(CAUCHY, nu, narrowing, MEAN_SINE)
    surf = surface(n, k, sigma_n0, rho0)
    cumulative = shaped_cumulative(surf, shaped, digits, ws)        # ws = shaped_workspace()
        norm_s, norm_p = shaped_integrals(inc, surf, shaped, cumulative, digits, ws)
            log_a_s, log_a_p = shaped_log_lobes(x, c, offset, h, surf, shaped)

The last three are in `pbrdf_bayes.physics.shaped_normalisation` but for `shaped_log_lobes`.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import TINIEST, Surface, reflectances, transmittances
from pbrdf_bayes.physics.line_shapes import LineShape, line_shape, log_line_shape

MEAN_SINE, GEOMETRIC_MEAN, MEAN_ANGLE = range(3)
FRESNEL_AT = {
    "mean_sine": MEAN_SINE,
    "geometric_mean": GEOMETRIC_MEAN,
    "mean_angle": MEAN_ANGLE,
}
"""Codes by name."""
NARROWING_RANGE = (0.0, 2.0)
"""Exponent of Eq. (5), where it is 1; 0 is a width that no angle changes."""


class Lobe(NamedTuple):
    """What a lobe is besides its surface; made by `lobe` once per parameter set."""

    shape: LineShape
    narrowing: float
    fresnel_at: int


@compiled()
def lobe(code: int, parameter: float, narrowing: float, fresnel_at: int) -> Lobe:
    """The lobe with the line shape of `line_shape`, a narrowing and a place of Fresnel's factor."""
    return Lobe(line_shape(code, parameter), float(narrowing), fresnel_at)


@compiled()
def squared_widths(
    x: float, c: float, h: float, surf: Surface, narrowing: float
) -> tuple[float, float]:
    """w_s^2 and w_p^2."""
    if narrowing == 0.0:
        plain = h * surf.rho0 * surf.rho0
        return plain, plain
    t_s, t_p = transmittances(x, c, surf)
    if narrowing == 1.0:
        scale = 0.25 * surf.width
        return h * (scale * t_s) * (scale * t_s), h * (scale * t_p) * (scale * t_p)
    scale = h * surf.rho0 * surf.rho0
    inverse = 1.0 / surf.transmittance0
    return (
        scale * exp(2.0 * narrowing * log(max(t_s * inverse, TINIEST))),
        scale * exp(2.0 * narrowing * log(max(t_p * inverse, TINIEST))),
    )


@compiled()
def lobe_reflectances(
    x: float, c: float, offset: float, h: float, surf: Surface, fresnel_at: int
) -> tuple[float, float]:
    """The factors F_s and F_p in front of the lobe."""
    if fresnel_at == MEAN_SINE:
        return reflectances(x, c, surf)
    root = sqrt(h)
    if fresnel_at == MEAN_ANGLE:
        scale = 1.0 / sqrt(x * x + h)
        return reflectances(x * scale, root * scale, surf)
    tilt = 0.5 * offset * x / root
    f_s, f_p = reflectances(x + 0.5 * offset, max(root - tilt, 0.0), surf)
    i_s, i_p = reflectances(x - 0.5 * offset, max(root + tilt, 0.0), surf)
    return sqrt(f_s * i_s), sqrt(f_p) * sqrt(max(i_p, TINIEST))


@compiled()
def shaped_log_lobes(
    x: float, c: float, offset: float, h: float, surf: Surface, shaped: Lobe
) -> tuple[float, float]:
    """ln A_s and ln A_p; arguments as for `fresnel.lobe_fractions`, which serve B as well."""
    w2_s, w2_p = squared_widths(x, c, h, surf, shaped.narrowing)
    f_s, f_p = lobe_reflectances(x, c, offset, h, surf, shaped.fresnel_at)
    offset2 = offset * offset
    return (
        log(f_s) - log(w2_s) + log_line_shape(offset2 / w2_s, shaped.shape),
        log(max(f_p, TINIEST)) - log(w2_p) + log_line_shape(offset2 / w2_p, shaped.shape),
    )
