"""Line shapes against their formulas in mpmath and scipy's Voigt profile."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import voigt_profile

from pbrdf_bayes.effects_table import EFFECT_PARAMETERS, LINE_SHAPES
from pbrdf_bayes.physics.directions import fill_directions
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.lobes.line_shapes import (
    CAUCHY,
    GAUSSIAN,
    LORENTZIAN,
    VOIGT,
    line_shape,
    log_line_shape,
)
from pbrdf_bayes.physics.lobes.shaped import MEAN_SINE, lobe, shaped_log_lobes
from pbrdf_bayes.physics.normalisation.plain import incidence
from pbrdf_bayes.physics.normalisation.shaped import (
    shaped_cumulative,
    shaped_integrals,
    shaped_workspace,
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


def cases_of_the_table() -> list[tuple[int, float]]:
    """Every line shape that is declared, across the range of its parameter."""
    found = []
    for code, shape in enumerate(LINE_SHAPES.values()):
        ends = EFFECT_PARAMETERS[shape.parameter].domain if shape.parameter else (1.0, 1.0)
        found += [(code, float(v)) for v in np.unique(np.linspace(*ends, 6)[:-1])]
    return found


def test_names_have_the_codes() -> None:
    codes = {"lorentzian": LORENTZIAN, "gaussian": GAUSSIAN, "voigt": VOIGT, "cauchy": CAUCHY}
    assert {name: list(LINE_SHAPES).index(name) for name in codes} == codes


@pytest.mark.parametrize(("code", "parameter"), cases_of_the_table())
def test_every_declared_shape_is_one(code: int, parameter: float) -> None:
    """1 at the centre, 1/2 at one half width, falling, finite far away, and not the Lorentzian."""
    shape = line_shape(code, parameter)
    logs = np.array([log_line_shape(u2, shape) for u2 in U2])
    assert shape.code == code or parameter in EFFECT_PARAMETERS["eta"].domain
    assert logs[0] == 0.0
    assert log_line_shape(1.0, shape) == pytest.approx(-np.log(2.0), abs=1e-13)
    assert np.all(np.isfinite(logs))
    assert np.all(np.diff(logs) <= 1e-15)
    away = abs(log_line_shape(100.0, shape) - log_line_shape(100.0, line_shape(LORENTZIAN, 1.0)))
    assert (away < 1e-12) == (code == LORENTZIAN)


@pytest.mark.parametrize(("code", "parameter"), cases_of_the_table())
@pytest.mark.parametrize("theta_i", [0.0, 0.7])
def test_the_quadrature_normalises_every_declared_shape(
    code: int, parameter: float, theta_i: float, gauss_rule: Any
) -> None:
    """Against a product of Gauss rules over the disk, for lobes that are not narrow."""
    surf, shaped = surface(1.5, 0.2, 0.8, 0.5), lobe(code, parameter, 1.0, MEAN_SINE)
    work, inc = shaped_workspace(), incidence(theta_i)
    found = shaped_integrals(
        inc, surf, shaped, shaped_cumulative(surf, shaped, 9.0, work), 9.0, work
    )
    theta, w_theta = gauss_rule(np.linspace(0.0, 0.5 * np.pi, 13), 12)
    phi, w_phi = gauss_rule(np.linspace(0.0, np.pi, 13), 12)
    at = np.repeat(theta, phi.size)
    there = np.empty((8, at.size))
    fill_directions(np.full(at.size, theta_i), at, np.tile(phi, theta.size), there)
    weight = 2.0 * np.repeat(w_theta, phi.size) * np.tile(w_phi, theta.size)
    weight *= np.sin(at) * np.cos(at)
    total = np.zeros(2)
    for w, g in zip(weight, there.T, strict=True):
        along, across = (shaped_log_lobes(*g[i : i + 4], surf, shaped) for i in (0, 4))
        total += w * np.exp(np.add(along, across[::-1]))
    np.testing.assert_allclose(found, total, rtol=1e-7)


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
