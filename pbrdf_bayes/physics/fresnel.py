"""Fresnel power coefficients without cancellation, for s and p from one complex root.

With m = n - ik the index, x the sine and c the cosine of the angle, c_t = sqrt(m^2 - x^2)
(Re >= 0, Im <= 0) and

    D = |c + c_t|^2 = c^2 + 2 c Re(c_t) + |c_t|^2,
    E = |c c_t + x^2|^2,   G = |c c_t - x^2|^2,   E G = |m^2 c^2 - x^2|^2,

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

TINIEST = 1e-307
"""Added to what may vanish before it is divided by or its logarithm taken."""


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
    """F_s and F_p at direction sine ``x``, `equations.fresnel`."""
    t = fresnel_terms(x, c, surf)
    f_s = surf.contrast / (t.d * t.d)
    return f_s, f_s * t.g / t.e


@compiled(inline=True)
def transmittances(x: float, c: float, surf: Surface) -> tuple[float, float]:
    """1 - F_s and 1 - F_p at direction sine ``x``; a quarter of the width times it is Eq. (5)."""
    t = fresnel_terms(x, c, surf)
    t_s = 4.0 * c * t.re / t.d
    return t_s, t_s * (t.modulus + x * x) / t.e


class LobeFractions(NamedTuple):
    """Lobes of s and p as numerators and denominators, free of divisions."""

    above_s: float
    below_s: float
    above_p: float
    below_p: float


@compiled(inline=True)
def lobe_fractions(
    x: float, c: float, offset: float, h: float, surf: Surface, dense: bool
) -> LobeFractions:
    """Lorentzian lobes of Eq. (3a) and Eq. (3b) for s and p: F_q(x) / [offset^2 + h rho_q(x)^2].

    Serves A_q (``x = (alpha + alpha_i)/2``, ``offset = alpha - alpha_i``) and B_q
    (``x = beta/2``, ``offset = beta``) alike, over common denominators; as printed they are
    `equations.lobe_along` and `equations.lobe_across`. All sums but the one in
    E G = |m^2 c^2 - x^2|^2 are of positive terms. ``dense`` says that Re(m^2) >= 1, so that
    Re(c_t^2) is positive at every angle and its root needs no division.
    """
    x2 = x * x
    c2 = c * c
    a = surf.m2_re - x2
    modulus = sqrt(a * a + surf.m2_im * surf.m2_im)
    larger = sqrt(0.5 * (modulus + abs(a)))
    c_re = c * (larger if dense or a >= 0.0 else 0.5 * surf.m2_im / larger)
    d = c2 + 2.0 * c_re + modulus
    e = c2 * modulus + x2 * (2.0 * c_re + x2)
    eg_re = surf.m2_re * c2 - x2
    eg_im = surf.m2_im * c2
    offset_d = offset * d
    offset_de = offset_d * e
    rho_s = surf.width * c_re  # times 1/D
    rho_p = rho_s * (modulus + x2)  # times 1/(D E)
    return LobeFractions(
        surf.contrast,
        offset_d * offset_d + h * rho_s * rho_s,
        surf.contrast * (eg_re * eg_re + eg_im * eg_im),
        offset_de * offset_de + h * rho_p * rho_p,
    )


@compiled(inline=True)
def lobes(x: float, c: float, offset: float, h: float, surf: Surface) -> tuple[float, float]:
    """The lobes themselves."""
    t = lobe_fractions(x, c, offset, h, surf, dense=False)
    return t.above_s / t.below_s, t.above_p / t.below_p


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
    """`lobes` and their logarithmic derivatives, from d c_t / d m^2 = 1 / (2 c_t).

    With c_t^2 = a - i Im: d ln D = (c Re(c_t) + a, c Im(c_t) + Im) / (|c_t|^2 D) and so on; one
    division serves all of them.
    """
    t = fresnel_terms(x, c, surf)
    x2 = x * x
    c2 = c * c
    a = surf.m2_re - x2
    c_re = c * t.re
    c_im = c * t.im
    excess = t.modulus + x2
    offset_d = offset * t.d
    offset_de = offset_d * t.e
    rho_s = surf.width * c_re
    rho_p = rho_s * excess
    inner_s = h * rho_s * rho_s
    inner_p = h * rho_p * rho_p
    below_s = offset_d * offset_d + inner_s
    below_p = offset_de * offset_de + inner_p
    per_below = 1.0 / (below_s * below_p)
    whole_s = per_below * below_p
    whole_p = per_below * below_s
    share_s = inner_s * whole_s
    share_p = inner_p * whole_p
    common = 1.0 / (t.modulus * t.d * t.e * excess * t.re)
    per_re = common * t.d * t.e * excess  # 1 / (|c_t|^2 Re(c_t))
    per_modulus = per_re * t.re
    common_re = common * t.re
    per_d = common_re * t.e * excess  # 1 / (|c_t|^2 D)
    per_e = common_re * t.d * excess
    per_excess = common_re * t.d * t.e
    d_re = (c_re + a) * per_d
    d_im = (c_im + surf.m2_im) * per_d
    e_re = c * (c * a + x2 * t.re) * per_e
    e_im = c * (c * surf.m2_im + x2 * t.im) * per_e
    eg_re = surf.m2_re * c2 - x2
    eg_im = surf.m2_im * c2
    eg = eg_re * eg_re + eg_im * eg_im
    per_eg = 2.0 * c2 / (eg + TINIEST)
    root_re = 0.5 * per_modulus
    root_im = 0.5 * t.im * per_re
    excess_re = a * per_excess
    excess_im = surf.m2_im * per_excess
    per_width = -2.0 / surf.width
    return LobeSlopes(
        surf.contrast * whole_s,
        surf.contrast * eg * whole_p,
        -2.0 * ((1.0 - share_s) * d_re + share_s * root_re),
        -2.0 * ((1.0 - share_s) * d_im + share_s * root_im),
        per_width * share_s,
        eg_re * per_eg
        - 2.0 * ((1.0 - share_p) * (d_re + e_re) + share_p * (root_re + excess_re)),
        eg_im * per_eg
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
