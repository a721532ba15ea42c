"""Line shapes against their formulas in mpmath and scipy's Voigt profile."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import voigt_profile

from pbrdf_bayes.physics.lobes.line_shapes import (
    CAUCHY,
    GAUSSIAN,
    LINE_SHAPES,
    LORENTZIAN,
    VOIGT,
    line_shape,
    log_line_shape,
)

mp = mpmath.MPContext()
mp.dps = 40
SHAPES = [
    (LORENTZIAN, 1.0),
    (GAUSSIAN, 1.0),
    *((VOIGT, eta) for eta in (0.0, 1e-300, 1e-6, 0.1, 0.3, 0.7, 0.999, 1.0 - 1e-7, 1.0)),
    *((CAUCHY, nu) for nu in (0.6, 0.8, 1.0, 1.3, 2.0, 6.0)),
]
U2 = np.concatenate([[0.0], 10.0 ** np.linspace(-20.0, 300.0, 161)])
each_shape = pytest.mark.parametrize(("code", "parameter"), SHAPES)


def exact_log(code: int, parameter: float, u2: float) -> float:
    u2_ = mp.mpf(u2)
    if code == GAUSSIAN:
        return float(-u2_ * mp.log(2))
    nu = mp.mpf(parameter if code == CAUCHY else 1)
    return float(-nu * mp.log1p((mp.mpf(2) ** (1 / nu) - 1) * u2_))


def test_names_have_the_codes() -> None:
    assert LINE_SHAPES == {"lorentzian": 0, "gaussian": 1, "voigt": 2, "cauchy": 3}


@each_shape
def test_half_of_the_centre_at_one_half_width(code: int, parameter: float) -> None:
    """The half width of the Voigt shape is found where logarithms of 40 roundings at most agree."""
    shape = line_shape(code, parameter)
    assert log_line_shape(0.0, shape) == 0.0
    assert np.exp(log_line_shape(1.0, shape)) == pytest.approx(0.5, rel=1e-14)


@pytest.mark.parametrize(("code", "parameter"), [s for s in SHAPES if s[0] != VOIGT])
def test_closed_forms_over_all_distances(code: int, parameter: float) -> None:
    """A few roundings, of the shape or of its logarithm."""
    shape = line_shape(code, parameter)
    for u2 in U2:
        exact = exact_log(code, parameter, u2)
        assert abs(log_line_shape(u2, shape) - exact) <= 4e-15 * max(abs(exact), 1.0)


@pytest.mark.parametrize("eta", [0.02, 0.3, 0.5, 0.7, 0.95, 0.999])
def test_voigt_is_the_profile_of_scipy(eta: float) -> None:
    """Half widths as eta to 1 - eta, the scale found by bisection; scipy is good to 1e-13."""

    def profile(u: float, scale: float) -> float:
        sigma = (1.0 - eta) * scale / np.sqrt(2.0 * np.log(2.0))
        return float(voigt_profile(u, sigma, eta * scale) / voigt_profile(0.0, sigma, eta * scale))

    scale = brentq(lambda s: profile(1.0, s) - 0.5, 0.3, 3.0, xtol=1e-15, rtol=1e-15)
    shape = line_shape(VOIGT, eta)
    for u in np.linspace(0.0, 20.0, 81):
        found = np.exp(log_line_shape(u * u, shape))
        assert found == pytest.approx(profile(u, scale), rel=2e-12)


def test_ends_of_the_mixtures() -> None:
    for u2 in U2:
        lorentzian = log_line_shape(u2, line_shape(LORENTZIAN, 1.0))
        gaussian = log_line_shape(u2, line_shape(GAUSSIAN, 1.0))
        assert log_line_shape(u2, line_shape(VOIGT, 1.0)) == lorentzian
        assert log_line_shape(u2, line_shape(VOIGT, 0.0)) == gaussian
        nearly = log_line_shape(u2, line_shape(VOIGT, 1.0 - 2e-8))
        assert abs(nearly - lorentzian) <= 1e-13 * max(abs(lorentzian), 1.0)
        cauchy = log_line_shape(u2, line_shape(CAUCHY, 1.0))
        assert abs(cauchy - lorentzian) <= 4e-15 * max(abs(lorentzian), 1.0)


@pytest.mark.parametrize("eta", [1e-300, 1e-9, 0.1, 0.7, 0.999])
def test_voigt_wings_are_lorentzian(eta: float) -> None:
    shape = line_shape(VOIGT, eta)
    far = log_line_shape(1e22, shape)
    assert log_line_shape(1e300, shape) == pytest.approx(far - 278.0 * np.log(10.0), rel=1e-14)


@given(
    code=st.integers(0, 3),
    eta=st.floats(0.0, 1.0),
    nu=st.floats(0.6, 6.0),
    u2=st.floats(0.0, 1e300),
    factor=st.floats(1.0, 4.0),
)
def test_shapes_fall_and_stay_finite(
    code: int, eta: float, nu: float, u2: float, factor: float
) -> None:
    shape = line_shape(code, eta if code == VOIGT else nu)
    near, far = log_line_shape(u2, shape), log_line_shape(min(u2 * factor, 1e300), shape)
    assert np.isfinite(near)
    assert near <= 1e-14
    assert far <= near + 1e-13 * max(abs(near), 1.0)
