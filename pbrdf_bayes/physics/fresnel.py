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

from numba import njit


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
    sigma_n0: float
    rho0: float
    width: float
    """4 rho0 / (1 - F(0)): rho_s(x) = width c Re(c_t) / D by Eq. (5)."""


class FresnelTerms(NamedTuple):
    """The building blocks D, E, G of the module's equations at one angle."""

    d: float
    e: float
    g: float
    c_re: float
    """c Re(c_t)."""
    excess: float
    """|c_t|^2 + x^2."""


@njit(cache=True, error_model="numpy", inline="always")
def surface(n: float, k: float, sigma_n0: float, rho0: float) -> Surface:
    """Hoist what depends on the parameters only."""
    m2_im = 2.0 * n * k
    real = (1.0 - n) * (1.0 + n) + k * k
    t0 = 4.0 * n / ((1.0 + n) * (1.0 + n) + k * k)
    return Surface(
        (n - k) * (n + k), m2_im, real * real + m2_im * m2_im, t0, sigma_n0, rho0, 4.0 * rho0 / t0
    )


@njit(cache=True, error_model="numpy", inline="always")
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
        c_re,
        modulus + x2,
    )


@njit(cache=True, error_model="numpy", inline="always")
def reflectances(x: float, c: float, surf: Surface) -> tuple[float, float]:
    """F_s and F_p at direction sine ``x``."""
    t = fresnel_terms(x, c, surf)
    f_s = surf.contrast / (t.d * t.d)
    return f_s, f_s * t.g / t.e


@njit(cache=True, error_model="numpy", inline="always")
def transmittances(x: float, c: float, surf: Surface) -> tuple[float, float]:
    """1 - F_s and 1 - F_p at direction sine ``x``."""
    t = fresnel_terms(x, c, surf)
    t_s = 4.0 * t.c_re / t.d
    return t_s, t_s * t.excess / t.e


@njit(cache=True, error_model="numpy", inline="always")
def lobes(x: float, c: float, offset: float, h: float, surf: Surface) -> tuple[float, float]:
    """Lorentzian lobes of Eq. (3) for s and p: F_q(x) / [offset^2 + h rho_q(x)^2].

    Serves A_q (``x = (alpha + alpha_i)/2``, ``offset = alpha - alpha_i``) and B_q
    (``x = beta/2``, ``offset = beta``) alike; written over common denominators, one division each.
    """
    t = fresnel_terms(x, c, surf)
    d2 = t.d * t.d
    offset2 = offset * offset
    rho_s = surf.width * t.c_re  # times 1/D
    rho_p = rho_s * t.excess  # times 1/(D E)
    lobe_s = surf.contrast / (offset2 * d2 + h * rho_s * rho_s)
    lobe_p = surf.contrast * t.g * t.e / (offset2 * d2 * t.e * t.e + h * rho_p * rho_p)
    return lobe_s, lobe_p
