"""Diffuse terms: hemispherical parts against adaptive integration, limits, reciprocity, energy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.special import ellipe

from pbrdf_bayes.physics.effects.backscatter import backscatter_brdf, backscatter_dhr
from pbrdf_bayes.physics.effects.bulk import bulk_brdf, bulk_dhr, escape
from pbrdf_bayes.physics.effects.lambert import lambert_brdf
from pbrdf_bayes.physics.effects.volume import elliptic_e, volume_brdf, volume_dhr
from pbrdf_bayes.physics.fresnel import surface

ANGLES = (0.0, 0.3, 1.0, 1.5)
HALF_PI = 0.5 * np.pi


def phase_cosine(theta_i, theta_r, phi):
    """Cosine of the angle between source and detector; phi = pi is the way back."""
    return np.cos(theta_i) * np.cos(theta_r) - np.sin(theta_i) * np.sin(theta_r) * np.cos(phi)


def hemisphere(f, theta_i, near):
    """Integral of f cos(theta_r) over the hemisphere, cut around the way back."""
    cuts = [0.0, max(theta_i - near, 0.0), theta_i, min(theta_i + near, HALF_PI), HALF_PI]

    def integrand(phi, theta_r):
        return 2.0 * f(theta_r, phi) * np.cos(theta_r) * np.sin(theta_r)

    return sum(
        dblquad(integrand, a, b, low, high, epsabs=1e-13, epsrel=1e-9)[0]
        for a, b in pairwise(cuts)
        if b > a
        for low, high in ((0.0, np.pi - near), (np.pi - near, np.pi))
    )


@pytest.mark.parametrize("theta_i", ANGLES)
@pytest.mark.parametrize("b", [0.0, 0.45, 0.95])
def test_volume_scatter_in_the_hemisphere(theta_i, b):
    def f(theta_r, phi):
        return volume_brdf(
            np.cos(theta_i), np.cos(theta_r), phase_cosine(theta_i, theta_r, phi), 0.3, b
        )

    assert volume_dhr(theta_i, 0.3, b) == pytest.approx(hemisphere(f, theta_i, 0.2), rel=1e-8)


@pytest.mark.parametrize("theta_i_deg", [88.0, 89.0, 89.5, 89.9, 89.95])
def test_volume_scatter_at_grazing_incidence(theta_i_deg):
    """Isotropic: 4 h [1 - c ln((1 + c)/c)]; b = 0.45: the azimuth by equal steps, theta by quad."""
    theta_i = np.deg2rad(theta_i_deg)
    c = np.cos(theta_i)
    isotropic = 4.0 * 0.3 * (1.0 - c * np.log((1.0 + c) / c))
    assert volume_dhr(theta_i, 0.3, 0.0) == pytest.approx(isotropic, rel=1e-8)

    phi = np.arange(64) * np.pi / 32.0

    def ring(from_horizon):
        theta_r = HALF_PI - from_horizon
        cosines = phase_cosine(theta_i, theta_r, phi)
        f = [volume_brdf(c, np.cos(theta_r), one, 0.3, 0.45) for one in cosines]
        return 2.0 * np.pi * np.mean(f) * np.cos(theta_r) * np.sin(theta_r)

    h = HALF_PI - theta_i
    cuts = [0.0, 0.1 * h, h, 4.0 * h, 20.0 * h, HALF_PI]
    parts = (quad(ring, a, b, epsrel=1e-11, limit=200)[0] for a, b in pairwise(cuts))
    assert volume_dhr(theta_i, 0.3, 0.45) == pytest.approx(sum(parts), rel=1e-8)


@pytest.mark.parametrize("theta_i", ANGLES)
@pytest.mark.parametrize("width", [0.005, 0.05, 0.3])
def test_backscatter_in_the_hemisphere(theta_i, width):
    def f(theta_r, phi):
        return backscatter_brdf(phase_cosine(theta_i, theta_r, phi), 0.3, width)

    expected = hemisphere(f, theta_i, min(10.0 * width, 0.2))
    assert backscatter_dhr(theta_i, 0.3, width) == pytest.approx(expected, rel=1e-8)


def fresnel_mean_transmittance(theta, n, k):
    """From the textbook's amplitude coefficients."""
    m, c = complex(n, -k), np.cos(theta)
    c_t = np.sqrt(m * m - np.sin(theta) ** 2)
    r_s, r_p = (c - c_t) / (c + c_t), (m * m * c - c_t) / (m * m * c + c_t)
    return 1.0 - 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2)


@pytest.mark.parametrize(
    ("n", "k", "rel"),
    [(1.5, 0.0, 1e-12), (4.0, 0.0, 1e-12), (1.2, 3.0, 1e-12), (1.0005, 0.0, 1e-9)],
)
def test_what_escapes_from_the_bulk(n, k, rel):
    def integrand(theta):
        return fresnel_mean_transmittance(theta, n, k) * 2.0 * np.sin(theta) * np.cos(theta)

    expected = quad(integrand, 0.0, HALF_PI, epsabs=1e-13, epsrel=1e-12, limit=500)[0]
    assert escape(surface(n, k, 1.0, 0.3)) == pytest.approx(expected, rel=rel)


def test_bulk_scatter_in_the_hemisphere():
    surf, theta_i = surface(1.5, 0.1, 1.0, 0.3), 1.2
    found = bulk_dhr(np.sin(theta_i), np.cos(theta_i), 0.4, escape(surf), surf)

    def integrand(theta_r, q):
        f = bulk_brdf(
            np.sin(theta_i), np.cos(theta_i), np.sin(theta_r), np.cos(theta_r), 0.4, surf
        )[q]
        return 2.0 * np.pi * f * np.cos(theta_r) * np.sin(theta_r)

    for q in (0, 1):
        expected = quad(integrand, 0.0, HALF_PI, args=(q,), epsrel=1e-12)[0]
        assert found[q] == pytest.approx(expected, rel=1e-11)


def test_at_normal_incidence_all_terms_are_strength_over_pi():
    surf = surface(1.5, 0.1, 1.0, 0.3)
    assert lambert_brdf(0.2) == pytest.approx(0.2 / np.pi)
    assert bulk_brdf(0.0, 1.0, 0.0, 1.0, 0.2, surf) == pytest.approx((0.2 / np.pi, 0.2 / np.pi))
    assert volume_brdf(1.0, 1.0, 1.0, 0.2, 0.6) == pytest.approx(0.2 / np.pi)
    assert backscatter_brdf(1.0, 0.2, 0.05) == pytest.approx(0.2 / np.pi)


def test_half_of_the_backscatter_peak_is_at_its_width():
    cos_g = np.cos(2.0 * np.arctan(0.05))
    assert backscatter_brdf(cos_g, 0.2, 0.05) == pytest.approx(0.1 / np.pi)


@pytest.mark.parametrize("b", [0.0, 0.45, 0.9])
def test_volume_scatter_is_reciprocal_and_peaks_backwards(b):
    there = volume_brdf(np.cos(0.3), np.cos(1.1), phase_cosine(0.3, 1.1, 0.7), 0.2, b)
    back = volume_brdf(np.cos(1.1), np.cos(0.3), phase_cosine(1.1, 0.3, 0.7), 0.2, b)
    assert there == pytest.approx(back)
    backwards = volume_brdf(np.cos(0.8), np.cos(0.8), phase_cosine(0.8, 0.8, np.pi), 0.2, b)
    forwards = volume_brdf(np.cos(0.8), np.cos(0.8), phase_cosine(0.8, 0.8, 0.0), 0.2, b)
    assert backwards > forwards or b == 0.0


def test_isotropic_volume_scatter_is_the_law_of_lommel_and_seeliger():
    found = volume_brdf(0.5, 0.8, 0.3, 0.2, 0.0)
    assert found == pytest.approx(0.2 / np.pi * 2.0 / (0.5 + 0.8))


def test_bulk_scatter_of_unpolarised_light_is_reciprocal():
    surf = surface(1.5, 0.1, 1.0, 0.3)
    there = bulk_brdf(np.sin(0.3), np.cos(0.3), np.sin(1.1), np.cos(1.1), 0.2, surf)
    back = bulk_brdf(np.sin(1.1), np.cos(1.1), np.sin(0.3), np.cos(0.3), 0.2, surf)
    assert np.mean(there) == pytest.approx(np.mean(back))
    assert there[1] > there[0]  # p enters more easily


def test_elliptic_integral():
    m = np.append(np.linspace(0.0, 0.99, 34), [0.999, 1.0 - 1e-6, 1.0 - 1e-12, 1.0])
    found = np.array([elliptic_e(v) for v in m])
    np.testing.assert_allclose(found, ellipe(m), rtol=1e-14)
