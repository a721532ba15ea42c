"""ln Re w(x + iy) against mpmath and scipy.

The rule is good to 0.7 exp(-11 pi) = 7e-16; its sum of 12 positive terms, the logarithm and what
the poles add, which is at most a few times the result, take some ten roundings: 1e-14 of Re w or,
where that is larger, of the logarithm itself.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import voigt_profile, wofz

from pbrdf_bayes.physics.lobes.faddeeva import log_real_w

Array = NDArray[np.float64]
mp = mpmath.MPContext()
mp.dps = 50
BOUND = 1e-14


def exact_log(x: float, y: float) -> float:
    """By the complementary error function; far out by Laplace's continued fraction.

    Next to the axis to first order in y: Re w = exp(-x^2) - y Im w'(x), w' = 2i/sqrt(pi) - 2 z w.
    """
    z = mp.mpc(x, y)
    if abs(z) > 40:
        below = z
        for j in range(40, 0, -1):
            below = z - mp.mpf(j) / 2 / below
        real = (1j / mp.sqrt(mp.pi) / below).real + (mp.exp(-(mp.mpf(x) ** 2)) if y < 1 else 0)
    elif y < 1e-30:
        gauss = mp.exp(-(mp.mpf(x) ** 2))
        real = gauss + y * 2 * (mp.mpf(x) * gauss * mp.erfi(x) - 1 / mp.sqrt(mp.pi))
    else:
        with mp.workdps(100):  # Re w is as much as 1e-30 below |w|
            z = mp.mpc(x, y)
            real = (mp.exp(-z * z) * mp.erfc(-1j * z)).real
    return float(mp.log(real))


def excess(x: Array, y: Array, exact: Array) -> tuple[float, str]:
    """Largest error in units of the bound, and where."""
    found = np.array([log_real_w(a, b) for a, b in zip(x, y, strict=True)])
    errors = np.abs(found - exact) / (BOUND * np.maximum(np.abs(exact), 1.0))
    worst = int(np.argmax(errors))
    return float(errors[worst]), f"{errors[worst]:.2g} bounds at {x[worst]!r}, {y[worst]!r}"


def test_it_agrees_with_mpmath_near_the_real_axis_and_away_from_it() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(0.0, 12.0, 250), 10.0 ** rng.uniform(-3.0, 1.5, 100)])
    y = np.concatenate([rng.uniform(0.0, 8.0, 150), 10.0 ** rng.uniform(-300.0, 8.0, 200)])
    share, text = excess(x, y, np.array([exact_log(a, b) for a, b in zip(x, y, strict=True)]))
    assert share <= 1.0, text


def test_it_agrees_with_mpmath_at_the_nodes_and_between_them() -> None:
    """x at multiples of a quarter of the step, where the two rules take turns."""
    step = np.sqrt(np.pi / 12.0)
    x = np.repeat(0.25 * step * np.arange(1, 41), 6)
    y = np.tile(np.array([1e-300, 1e-20, 1e-8, 1e-3, 0.1, 1.0]), 40)
    share, text = excess(x, y, np.array([exact_log(a, b) for a, b in zip(x, y, strict=True)]))
    assert share <= 1.0, text


def test_far_out_it_is_a_lorentzian() -> None:
    """Re w = y / (sqrt(pi) |z|^2) to 1.5/|z|^2; up to the largest distances asked for."""
    x = np.repeat(10.0 ** np.array([9.0, 20.0, 60.0, 74.0]), 4)
    y = np.tile(np.array([1e-300, 1e-8, 1.0, 1e8]), 4)
    exact = np.log(y) - 0.5 * np.log(np.pi) - 2.0 * np.log(np.hypot(x, y))
    share, text = excess(x, y, exact)
    assert share <= 1.0, text


def test_on_the_axes_it_is_the_gaussian_and_erfcx() -> None:
    x = np.concatenate([[0.0], 10.0 ** np.linspace(-10.0, 150.0, 60)])
    assert [log_real_w(a, 0.0) for a in x] == [-a * a for a in x]
    y = 10.0 ** np.linspace(-12.0, 8.0, 80)
    exact = np.array([exact_log(0.0, b) for b in y])
    share, text = excess(np.zeros(80), y, exact)
    assert share <= 1.0, text


def test_it_agrees_with_scipy_on_a_dense_grid() -> None:
    """scipy's wofz promises 1e-13."""
    x, y = np.meshgrid(
        np.linspace(0.0, 30.0, 121), np.concatenate([[0.0], np.logspace(-16, 4, 81)])
    )
    x, y = x.ravel(), y.ravel()
    exact = wofz(x + 1j * y).real
    keep = exact > 1e-300
    found = np.array([log_real_w(a, b) for a, b in zip(x[keep], y[keep], strict=True)])
    worst = np.max(np.abs(found - np.log(exact[keep])) / np.maximum(np.abs(found), 1.0))
    assert worst < 2e-13


@pytest.mark.parametrize(("sigma", "gamma"), [(1.0, 0.01), (0.3, 1.0), (2.0, 5.0)])
def test_it_is_the_voigt_profile_of_scipy(sigma: float, gamma: float) -> None:
    u = np.linspace(0.0, 40.0 * sigma, 200)
    root = np.sqrt(2.0) * sigma
    found = [np.exp(log_real_w(a / root, gamma / root)) for a in u]
    np.testing.assert_allclose(
        np.array(found) / (sigma * np.sqrt(2.0 * np.pi)), voigt_profile(u, sigma, gamma), rtol=2e-13
    )
