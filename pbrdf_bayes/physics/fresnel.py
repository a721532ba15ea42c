"""Fresnel power coefficients without cancellation, for s and p from one complex root.

With m = n - ik the index, x the sine and c the cosine of the angle, c_t = sqrt(m^2 - x^2)
(Re >= 0, Im <= 0) and

    D = |c + c_t|^2,   E = |c c_t + x^2|^2,   G = |c c_t - x^2|^2,

the reflectances and one minus them are products, never differences:

    F_s = |1 - m^2|^2 / D^2            1 - F_s = 4 c Re(c_t) / D
    F_p = F_s G / E                    1 - F_p = 4 c Re(c_t) (|c_t|^2 + x^2) / (D E)

The last line uses |m^2 c + c_t|^2 = D E and Re(m^2 conj(c_t)) = Re(c_t) (|c_t|^2 + x^2). Near
n = 1 and at grazing every quantity keeps its full relative accuracy.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from pbrdf_bayes.physics.compiled import compiled


class Surface(NamedTuple):
    """What depends on the four parameters only; made by `surface` once per parameter set."""

    m2_re: float
    """Re(m^2) = n^2 - k^2."""
    m2_im: float
    """-Im(m^2) = 2 n k."""
    contrast: float
    """|1 - m^2|^2."""
    transmittance0: float
    """1 - F(0)."""
    width: float
    """4 rho0 / (1 - F(0)): rho_s(x) = width c Re(c_t) / D by Eq. (5)."""
    n: float
    k: float
    sigma_n0: float
    rho0: float


class FresnelTerms(NamedTuple):
    """The building blocks of the module's equations at one angle."""

    d: float
    e: float
    g: float
    re: float
    """Re(c_t)."""
    im: float
    """-Im(c_t)."""
    modulus: float
    """|c_t|^2."""


@compiled(inline=True)
def surface(n: float, k: float, sigma_n0: float, rho0: float) -> Surface:
    """Hoist what depends on the parameters only."""
    m2_im = 2.0 * n * k
    real = (1.0 - n) * (1.0 + n) + k * k
    t0 = 4.0 * n / ((1.0 + n) * (1.0 + n) + k * k)
    return Surface(
        (n - k) * (n + k), m2_im, real * real + m2_im * m2_im, t0, 4.0 * rho0 / t0,
        n, k, sigma_n0, rho0,
    )  # fmt: skip


@compiled(inline=True)
def fresnel_terms(x: float, c: float, surf: Surface) -> FresnelTerms:
    """Building blocks at direction sine ``x`` and its cosine ``c``."""
    x2 = x * x
    a = surf.m2_re - x2
    modulus = sqrt(a * a + surf.m2_im * surf.m2_im)
    larger = sqrt(0.5 * (modulus + abs(a)))
    smaller = 0.5 * surf.m2_im / larger
    re = larger if a >= 0.0 else smaller
    im = smaller if a >= 0.0 else larger
    c_re = c * re
    c_im2 = c * c * im * im
    return FresnelTerms(
        (c + re) * (c + re) + im * im,
        (c_re + x2) * (c_re + x2) + c_im2,
        (c_re - x2) * (c_re - x2) + c_im2,
        re,
        im,
        modulus,
    )


@compiled(inline=True)
def reflectances(x: float, c: float, surf: Surface) -> tuple[float, float]:
    """F_s and F_p at direction sine ``x``."""
    t = fresnel_terms(x, c, surf)
    f_s = surf.contrast / (t.d * t.d)
    return f_s, f_s * t.g / t.e


@compiled(inline=True)
def transmittances(x: float, c: float, surf: Surface) -> tuple[float, float]:
    """1 - F_s and 1 - F_p at direction sine ``x``."""
    t = fresnel_terms(x, c, surf)
    t_s = 4.0 * c * t.re / t.d
    return t_s, t_s * (t.modulus + x * x) / t.e


@compiled(inline=True)
def lobes(x: float, c: float, offset: float, h: float, surf: Surface) -> tuple[float, float]:
    """Lorentzian lobes of Eq. (3) for s and p: F_q(x) / [offset^2 + h rho_q(x)^2].

    Serves A_q (``x = (alpha + alpha_i)/2``, ``offset = alpha - alpha_i``) and B_q
    (``x = beta/2``, ``offset = beta``) alike; written over common denominators, one division each.
    """
    t = fresnel_terms(x, c, surf)
    d2 = t.d * t.d
    offset2 = offset * offset
    rho_s = surf.width * c * t.re  # times 1/D
    rho_p = rho_s * (t.modulus + x * x)  # times 1/(D E)
    lobe_s = surf.contrast / (offset2 * d2 + h * rho_s * rho_s)
    lobe_p = surf.contrast * t.g * t.e / (offset2 * d2 * t.e * t.e + h * rho_p * rho_p)
    return lobe_s, lobe_p


class LobeSlopes(NamedTuple):
    """Lobes of s and p with the derivatives of their logarithms.

    The derivatives are with respect to Re(m^2), -Im(m^2) and the width, the contrast
    |1 - m^2|^2 held fixed: it cancels between a lobe and its norm.
    """

    s: float
    p: float
    s_re: float
    s_im: float
    s_width: float
    p_re: float
    p_im: float
    p_width: float


@compiled(inline=True)
def lobe_slopes(x: float, c: float, offset: float, h: float, surf: Surface) -> LobeSlopes:
    """`lobes` and their logarithmic derivatives, from d c_t / d m^2 = 1 / (2 c_t)."""
    t = fresnel_terms(x, c, surf)
    x2 = x * x
    d2 = t.d * t.d
    offset2 = offset * offset
    excess = t.modulus + x2
    rho_s = surf.width * c * t.re
    rho_p = rho_s * excess
    inner_s = h * rho_s * rho_s
    inner_p = h * rho_p * rho_p
    whole_s = 1.0 / (offset2 * d2 + inner_s)
    whole_p = 1.0 / (offset2 * d2 * t.e * t.e + inner_p)
    share_s = inner_s * whole_s
    share_p = inner_p * whole_p
    per_modulus = 1.0 / t.modulus
    d_re = ((c + t.re) * t.re - t.im * t.im) * per_modulus / t.d
    d_im = t.im * (c + 2.0 * t.re) * per_modulus / t.d
    c_re = c * t.re
    c_im2 = c * c * t.im * t.im
    e_re = ((c_re + x2) * c_re - c_im2) * per_modulus / t.e
    e_im = c * t.im * (2.0 * c_re + x2) * per_modulus / t.e
    g = t.g + 1e-290
    g_re = ((c_re - x2) * c_re - c_im2) * per_modulus / g
    g_im = c * t.im * (2.0 * c_re - x2) * per_modulus / g
    root_re = 0.5 * per_modulus
    root_im = 0.5 * per_modulus * t.im / t.re
    excess_re = (surf.m2_re - x2) * per_modulus / excess
    excess_im = surf.m2_im * per_modulus / excess
    per_width = -2.0 / surf.width
    return LobeSlopes(
        surf.contrast * whole_s,
        surf.contrast * t.g * t.e * whole_p,
        -2.0 * ((1.0 - share_s) * d_re + share_s * root_re),
        -2.0 * ((1.0 - share_s) * d_im + share_s * root_im),
        per_width * share_s,
        g_re + e_re
        - 2.0 * ((1.0 - share_p) * (d_re + e_re) + share_p * (root_re + excess_re)),
        g_im + e_im
        - 2.0 * ((1.0 - share_p) * (d_im + e_im) + share_p * (root_im + excess_im)),
        per_width * share_p,
    )  # fmt: skip


@compiled()
def reflectance_slopes(x: float, c: float, surf: Surface) -> tuple[float, float, float, float]:
    """Derivatives of ln F_s and ln F_p with respect to Re(m^2) and -Im(m^2): s, s, p, p."""
    t = fresnel_terms(x, c, surf)
    x2 = x * x
    c_re = c * t.re
    c_im2 = c * c * t.im * t.im
    s_re = 2.0 * (surf.m2_re - 1.0) / surf.contrast
    s_im = 2.0 * surf.m2_im / surf.contrast
    s_re -= 2.0 * ((c + t.re) * t.re - t.im * t.im) / (t.modulus * t.d)
    s_im -= 2.0 * t.im * (c + 2.0 * t.re) / (t.modulus * t.d)
    g = t.g + 1e-290
    p_re = ((c_re - x2) * c_re - c_im2) / (t.modulus * g)
    p_re -= ((c_re + x2) * c_re - c_im2) / (t.modulus * t.e)
    p_im = c * t.im * (2.0 * c_re - x2) / (t.modulus * g)
    p_im -= c * t.im * (2.0 * c_re + x2) / (t.modulus * t.e)
    return s_re, s_im, s_re + p_re, s_im + p_im
