"""Fresnel coefficients against the textbook amplitudes in complex arithmetic at 40 digits.

The only inexact input of the formulas is m^2 - x^2, a difference of two rounded numbers: with the
condition number ``kappa = 1 + (|m^2| + x^2) / |m^2 - x^2|`` every coefficient is a product of
fewer than eight factors, each good to half an epsilon times kappa, so 4 eps kappa bounds the
error. F_p vanishes at the Brewster angle, where ``c c_t - x^2`` cancels: there the error of that
difference, 4 eps kappa (c |c_t| + x^2), sets the accuracy.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mpmath
import numpy as np
import pytest

from pbrdf_bayes.physics.fresnel import lobes, reflectances, surface, transmittances

mp = mpmath.MPContext()
mp.dps = 40
EPS = 2.0**-52


class Exact(NamedTuple):
    """Textbook values at one angle, and what bounds the rounding errors."""

    f_s: mpmath.mpf
    f_p: mpmath.mpf
    condition: float
    spread_p: float
    """Bound of |F_p - exact| beyond its relative error."""


def exact(n: float, k: float, theta: float) -> Exact:
    m2 = mp.mpc(n, -k) ** 2
    x, c = mp.sin(mp.mpf(theta)), mp.cos(mp.mpf(theta))
    c_t = mp.sqrt(m2 - x * x)
    if c_t.imag > 0 or c_t.real < 0:
        c_t = -c_t
    r_s = (c - c_t) / (c + c_t)
    r_p = (m2 * c - c_t) / (m2 * c + c_t)
    condition = 1.0 + float((abs(m2) + x * x) / abs(m2 - x * x))
    difference, total = abs(c * c_t - x * x), abs(c * c_t + x * x)
    error = 4.0 * EPS * condition * float(c * abs(c_t) + x * x)
    spread = float(abs(r_s) ** 2 / total**2) * (2.0 * float(difference) * error + error**2)
    return Exact(abs(r_s) ** 2, abs(r_p) ** 2, condition, spread)


def domain(size: int, seed: int) -> list[tuple[float, float, float]]:
    """Seeded (n, k, theta): metals, absorbing and clear dielectrics; grazing and Brewster angles."""
    rng = np.random.default_rng(seed)
    points = []
    for i in range(size):
        if i % 4 == 0:
            n, k = rng.uniform(0.1, 1.0), 10.0 ** rng.uniform(0.0, 0.9)
        else:
            n = 1.0 + 10.0 ** rng.uniform(math.log10(5e-4), math.log10(5.0))
            k = 0.0 if i % 3 == 0 else 10.0 ** rng.uniform(-6.0, 1.0)
        choices = (
            0.0, 89.95, rng.uniform(0.0, 89.95),
            90.0 - 10.0 ** rng.uniform(math.log10(0.05), 1.0), math.degrees(math.atan(n)),
        )  # fmt: skip
        points.append((float(n), float(k), math.radians(min(choices[i % 5], 89.95))))
    corners = [(n, k) for n in (1.0005, 6.0) for k in (0.0, 1e-6, 10.0)]
    corners += [(n, k) for n in (0.1, 1.0) for k in (1.0, 8.0)]
    angles = [math.radians(a) for a in (0.0, 45.0, 89.95)]
    return points + [(n, k, t) for n, k in corners for t in angles]


def test_reflectances_and_transmittances_agree_with_the_textbook() -> None:
    worst: dict[str, tuple[float, object]] = {}
    for n, k, theta in domain(3000, 1):
        x, c = math.sin(theta), math.cos(theta)
        surf = surface(n, k, 0.5, 0.1)
        f_s, f_p = reflectances(x, c, surf)
        t_s, t_p = transmittances(x, c, surf)
        want = exact(n, k, theta)
        limit = 4.0 * EPS * want.condition
        found = {
            "F_s": abs(f_s - want.f_s) / (limit * want.f_s),
            "F_p": abs(f_p - want.f_p) / (limit * want.f_p + want.spread_p),
            "1-F_s": abs(t_s - (1 - want.f_s)) / (limit * (1 - want.f_s)),
            "1-F_p": abs(t_p - (1 - want.f_p)) / (limit * (1 - want.f_p)),
        }
        for name, share in found.items():
            worst[name] = max(worst.get(name, (0.0, None)), (float(share), (n, k, theta)))
    assert max(share for share, _ in worst.values()) < 1.0, f"in units of the bound: {worst}"


def test_reflectance_and_transmittance_add_up_to_one() -> None:
    for n, k, theta in domain(2000, 2):
        surf = surface(n, k, 0.5, 0.1)
        x, c = math.sin(theta), math.cos(theta)
        limit = 4.0 * EPS * exact(n, k, theta).condition
        for f, t in zip(reflectances(x, c, surf), transmittances(x, c, surf), strict=True):
            assert 0.0 <= f <= 1.0 + limit, (n, k, theta)
            assert 0.0 <= t <= 1.0 + limit, (n, k, theta)
            assert abs(f + t - 1.0) <= limit, (n, k, theta)


def test_p_never_reflects_more_than_s_without_absorption() -> None:
    for n, k, theta in domain(600, 3):
        if k == 0.0:
            f_s, f_p = reflectances(math.sin(theta), math.cos(theta), surface(n, k, 0.5, 0.1))
            assert f_p <= f_s * (1.0 + 4.0 * EPS)


@pytest.mark.parametrize(("n", "k"), [(1.0005, 0.0), (1.526, 0.193), (6.0, 10.0), (0.1, 8.0)])
def test_normal_incidence_is_the_closed_form_for_both_polarisations(n: float, k: float) -> None:
    f_s, f_p = reflectances(0.0, 1.0, surface(n, k, 0.5, 0.1))
    wanted = ((mp.mpf(n) - 1) ** 2 + mp.mpf(k) ** 2) / ((mp.mpf(n) + 1) ** 2 + mp.mpf(k) ** 2)
    assert f_s == f_p
    assert abs(f_s / wanted - 1) < 8.0 * EPS


@pytest.mark.parametrize(("n", "k"), [(1.0005, 0.0), (1.526, 0.193), (6.0, 10.0), (0.1, 8.0)])
def test_everything_is_reflected_at_ninety_degrees(n: float, k: float) -> None:
    surf = surface(n, k, 0.5, 0.1)
    assert reflectances(1.0, 0.0, surf) == pytest.approx(
        (1.0, 1.0), abs=4.0 * EPS * exact(n, k, 0.5 * math.pi).condition
    )
    assert transmittances(1.0, 0.0, surf) == (0.0, 0.0)


@pytest.mark.parametrize(("n", "k"), [(1.0005, 0.0), (1.5, 0.2), (6.0, 0.0), (0.1, 8.0)])
def test_grazing_transmittance_is_linear_in_the_cosine(n: float, k: float) -> None:
    """1 - F_s -> 4 c Re(c_t)/|c_t|^2 and 1 - F_p -> 4 c Re(m^2 conj(c_t))/|c_t|^2 at 90 deg."""
    surf = surface(n, k, 0.5, 0.1)
    m2 = complex(n, -k) ** 2
    c_t = np.sqrt(m2 - 1.0)
    slopes = 4.0 * c_t.real / abs(c_t) ** 2, 4.0 * (m2 * c_t.conjugate()).real / abs(c_t) ** 2
    for c in (1e-9, 1e-12):
        found = transmittances(math.sqrt(1.0 - c * c), c, surf)
        # the next order is smaller by c |m^2/c_t|; the slope has the rounding of m^2 - 1
        limit = 4.0 * c * max(abs(m2 / c_t), 1.0 / abs(c_t)) + 8.0 * EPS / abs(m2 - 1.0)
        assert found == pytest.approx((slopes[0] * c, slopes[1] * c), rel=limit, abs=0.0)


@pytest.mark.parametrize("n", [1.0005, 1.05, 1.5, 2.0, 4.0, 6.0])
def test_brewster_zero_is_zero_to_rounding(n: float) -> None:
    """tan(theta) = n makes c c_t = x^2; what is left is the square of its rounding error."""
    cosine = 1.0 / math.sqrt(1.0 + n * n)
    f_s, f_p = reflectances(n * cosine, cosine, surface(n, 0.0, 0.5, 0.1))
    condition = 1.0 + (n * n + n * n * cosine**2) / (n * n * n * n * cosine**2)
    assert 0.0 <= f_p <= f_s * (4.0 * EPS * condition) ** 2
    assert f_s > 0.0


def test_p_reflectance_changes_by_the_square_of_the_distance_from_brewster() -> None:
    n = 1.5
    theta = math.atan(n)
    surf = surface(n, 0.0, 0.5, 0.1)
    near, far = (
        reflectances(math.sin(theta + d), math.cos(theta + d), surf)[1] for d in (1e-5, 1e-4)
    )
    # F_p = a d^2 (1 + O(d)): the ratio is 100 up to the cubic term, some units times 1e-4
    assert far / near == pytest.approx(100.0, rel=1e-3, abs=0.0)


@pytest.mark.parametrize(("n", "k"), [(1.5, 0.0), (1.526, 0.193), (0.2, 3.0)])
@pytest.mark.parametrize("theta", [0.0, 0.4, 1.2, 1.55])
def test_lobes_are_the_ratio_of_equation_three(n: float, k: float, theta: float) -> None:
    """lobes() is written over common denominators; here it is as printed."""
    rho0, offset, h = 0.3, 0.11, 0.8
    surf = surface(n, k, 0.7, rho0)
    want = exact(n, k, theta)
    normal = exact(n, k, 0.0)
    x, c = math.sin(theta), math.cos(theta)
    for found, f in zip(lobes(x, c, offset, h, surf), (want.f_s, want.f_p), strict=True):
        rho = mp.mpf(rho0) * (1 - f) / (1 - normal.f_s)
        wanted = f / (mp.mpf(offset) ** 2 + mp.mpf(h) * rho**2)
        limit = 12.0 * EPS * want.condition * float(wanted)
        assert abs(found - wanted) <= limit + want.spread_p * float(wanted / f)
