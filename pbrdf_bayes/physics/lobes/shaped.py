"""Lobes beyond the strict model: any line shape, narrowing, and place of the Fresnel factor.

    A_q = F_q / w_q^2 * S(offset^2 / w_q^2),   w_q^2 = h rho_q(x)^2,
    rho_q(x) = rho0 [(1 - F_q(x)) / (1 - F(0))]^g

with the arguments x, c, offset, h of `fresnel.lobe_fractions`: they serve A and B alike. S is a
line shape; g, the narrowing, is 1 in Eq. (5). With the Lorentzian and g = 1 this is
Eq. (3a) and (3b), see `pbrdf_bayes.physics.equations`.

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

`pbrdf_bayes.physics.normalisation.shaped` has the norms. In plane f_s has the factor B_p(0):
``shaped_log_lobes(0.0, 1.0, 0.0, 1.0, surf, shaped)`` has its logarithm.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.effects_table import FRESNEL_AT
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import TINIEST, Surface, reflectances, transmittances
from pbrdf_bayes.physics.lobes.line_shapes import (
    CAUCHY,
    GAUSSIAN,
    LORENTZIAN,
    LineShape,
    line_shape,
    log_line_shape,
)

Array = NDArray[np.float64]

MEAN_SINE, GEOMETRIC_MEAN, MEAN_ANGLE = range(len(FRESNEL_AT))
"""Codes, in the order of the table."""
LOWEST = -600.0
"""Ln of the shape that counts as zero in a norm; smaller ones would end in denormal numbers."""
LOWEST_OF_ROW = -690.0
"""The same of a reading, below everything that the likelihood tells apart."""


class Lobe(NamedTuple):
    """What a lobe is besides its surface; made by `lobe` once per parameter set."""

    shape: LineShape
    narrowing: float
    fresnel_at: int


@compiled()
def lobe(code: int, parameter: float, narrowing: float, fresnel_at: int) -> Lobe:
    """The lobe with the line shape of `line_shape`, a narrowing and a place of Fresnel's factor."""
    return Lobe(line_shape(code, parameter), float(narrowing), fresnel_at)


@compiled(inline=True)
def squared_widths(
    x: float, c: float, h: float, surf: Surface, narrowing: float
) -> tuple[float, float]:
    """w_s^2 and w_p^2."""
    t_s, t_p = transmittances(x, c, surf)
    if narrowing == 1.0:
        scale = 0.25 * surf.width
        w_s, w_p = scale * t_s, scale * t_p
    else:
        inverse = 1.0 / surf.transmittance0
        w_s = surf.rho0 * exp(narrowing * log(max(t_s * inverse, TINIEST)))
        w_p = surf.rho0 * exp(narrowing * log(max(t_p * inverse, TINIEST)))
    return h * w_s * w_s, h * w_p * w_p


@compiled(inline=True)
def mean_angle_reflectances(x: float, h: float, surf: Surface) -> tuple[float, float]:
    """F_s and F_p at the mean of the two angles."""
    root = sqrt(h)
    scale = 1.0 / sqrt(x * x + h)
    return reflectances(x * scale, root * scale, surf)


@compiled(inline=True)
def outgoing_roots(x: float, offset: float, h: float, surf: Surface) -> tuple[float, float]:
    """The roots of F_s and F_p at alpha; at alpha_i with ``offset`` negated."""
    root = sqrt(h)
    f_s, f_p = reflectances(x + 0.5 * offset, max(root - 0.5 * offset * x / root, 0.0), surf)
    return sqrt(f_s), sqrt(max(f_p, TINIEST))


@compiled()
def shaped_log_lobes(
    x: float, c: float, offset: float, h: float, surf: Surface, shaped: Lobe
) -> tuple[float, float]:
    """Ln A_s and ln A_p; arguments as for `fresnel.lobe_fractions`, which serve B as well."""
    if shaped.fresnel_at == MEAN_SINE:
        f_s, f_p = reflectances(x, c, surf)
    elif shaped.fresnel_at == GEOMETRIC_MEAN:
        f_s, f_p = outgoing_roots(x, offset, h, surf)
        root_s, root_p = outgoing_roots(x, -offset, h, surf)
        f_s, f_p = f_s * root_s, f_p * root_p
    else:
        f_s, f_p = mean_angle_reflectances(x, h, surf)
    w2_s, w2_p = squared_widths(x, c, h, surf, shaped.narrowing)
    offset2 = offset * offset
    return (
        log(f_s) - log(w2_s) + log_line_shape(offset2 / w2_s, shaped.shape),
        log(max(f_p, TINIEST)) - log(w2_p) + log_line_shape(offset2 / w2_p, shaped.shape),
    )


# Loops over nodes and rows: one for each choice, so that the compiler vectorises it.


class Places(NamedTuple):
    """Contiguous arrays (n,): the arguments of a lobe, and a factor of each place."""

    x: Array
    c: Array
    offset: Array
    h: Array
    weight: Array


@compiled()
def fill_shaped_lobes(
    at: Places, sine_i: float, cosine_i: float, surf: Surface, shaped: Lobe, lowest: float,
    w2_s: Array, w2_p: Array, out_s: Array, out_p: Array,
) -> None:  # fmt: skip
    """A_s and A_p times the weights; B_s and B_p at normal incidence. ``w2`` is scratch.

    ``lowest`` is ln of the line shape that counts as zero.
    """
    fill_squared_widths(at, surf, shaped.narrowing, w2_s, w2_p)
    fill_reflectances(at, sine_i, cosine_i, surf, shaped.fresnel_at, out_s, out_p)
    fill_shape(at, w2_s, shaped.shape, lowest, out_s)
    fill_shape(at, w2_p, shaped.shape, lowest, out_p)


@compiled()
def fill_squared_widths(
    at: Places, surf: Surface, narrowing: float, w2_s: Array, w2_p: Array
) -> None:
    """w_s^2 and w_p^2."""
    x, c, h = at.x, at.c, at.h
    if narrowing == 0.0:
        for i in range(x.size):
            w2_s[i] = w2_p[i] = h[i] * surf.rho0 * surf.rho0
    elif narrowing == 1.0:
        for i in range(x.size):
            w2_s[i], w2_p[i] = squared_widths(x[i], c[i], h[i], surf, 1.0)
    else:
        for i in range(x.size):
            w2_s[i], w2_p[i] = squared_widths(x[i], c[i], h[i], surf, narrowing)


@compiled()
def fill_reflectances(
    at: Places, sine_i: float, cosine_i: float, surf: Surface, fresnel_at: int, f_s: Array,
    f_p: Array,
) -> None:  # fmt: skip
    """The factors F_s and F_p in front of the lobes; for B at normal incidence.

    Found once, F_p(alpha_i) is the same number in all of a norm, however close to zero it is.
    """
    x, c, offset, h = at.x, at.c, at.offset, at.h
    if fresnel_at == MEAN_SINE:
        for i in range(x.size):
            f_s[i], f_p[i] = reflectances(x[i], c[i], surf)
    elif fresnel_at == GEOMETRIC_MEAN:
        i_s, i_p = reflectances(sine_i, cosine_i, surf)
        root_s, root_p = sqrt(i_s), sqrt(max(i_p, TINIEST))
        for i in range(x.size):
            out_s, out_p = outgoing_roots(x[i], offset[i], h[i], surf)
            f_s[i], f_p[i] = root_s * out_s, root_p * out_p
    else:
        for i in range(x.size):
            f_s[i], f_p[i] = mean_angle_reflectances(x[i], h[i], surf)


@compiled()
def fill_shape(at: Places, w2: Array, shape: LineShape, lowest: float, out: Array) -> None:
    """Lobes times the weights; ``out`` comes with the factors F, ``w2`` is lost."""
    offset, weight = at.offset, at.weight
    if shape.code == LORENTZIAN:
        for i in range(offset.size):
            out[i] *= weight[i] / (offset[i] * offset[i] + w2[i])
        return
    for i in range(offset.size):
        inverse = 1.0 / w2[i]
        out[i] *= weight[i] * inverse
        w2[i] = offset[i] * offset[i] * inverse
    if shape.code == GAUSSIAN:
        for i in range(offset.size):
            out[i] *= exp(max(-shape.curvature * w2[i], lowest))
    elif shape.code == CAUCHY:
        for i in range(offset.size):
            out[i] *= exp(max(-shape.exponent * log(1.0 + shape.curvature * w2[i]), lowest))
    else:
        for i in range(offset.size):
            out[i] *= exp(max(log_line_shape(w2[i], shape), lowest))
