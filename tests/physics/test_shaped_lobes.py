"""General lobes and their norms against extended precision, their limits, and other quadratures.

Reference: ``tests/reference/generate_shaped.py``. What is asked of a norm is rtol, and 2e-12 at
rtol = 1e-12.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from pbrdf_bayes.effects_table import FRESNEL_AT, LINE_SHAPES
from pbrdf_bayes.physics.directions import prepare_directions
from pbrdf_bayes.physics.fresnel import lobes, reflectances, surface
from pbrdf_bayes.physics.lobes.line_shapes import CAUCHY, GAUSSIAN, LORENTZIAN, VOIGT
from pbrdf_bayes.physics.lobes.shaped import (
    GEOMETRIC_MEAN,
    MEAN_ANGLE,
    MEAN_SINE,
    Lobe,
    lobe,
    shaped_log_lobes,
)
from pbrdf_bayes.physics.normalisation.plain import incidence, normalisation_integrals, workspace
from pbrdf_bayes.physics.normalisation.shaped import (
    shaped_cumulative,
    shaped_integrals,
    shaped_workspace,
)

Point = dict[str, Any]
REFERENCE = Path(__file__).parents[1] / "reference" / "shaped_values.json"
RTOLS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
WORKSPACE = shaped_workspace()
STRICT_WORKSPACE = workspace()


@pytest.fixture(scope="module")
def points() -> list[Point]:
    found: list[Point] = json.loads(REFERENCE.read_text(encoding="utf-8"))["points"]
    return found


def lobe_of(point: Point) -> Lobe:
    shape = list(LINE_SHAPES).index(point["shape"])
    at = FRESNEL_AT.index(point["fresnel_at"])
    return lobe(shape, point["shape_parameter"], point["narrowing"], at)


def norms(
    n: float, k: float, rho0: float, theta_i: float, shaped: Lobe, digits: float
) -> tuple[float, float]:
    """I_s and I_p at one angle [rad]."""
    surf = surface(n, k, 0.8, rho0)
    found = shaped_cumulative(surf, shaped, digits, WORKSPACE)
    return shaped_integrals(incidence(theta_i), surf, shaped, found, digits, WORKSPACE)


def norms_at(point: Point, digits: float) -> tuple[float, float]:
    theta_i = np.radians(point["theta_i_deg"])
    return norms(point["n"], point["k"], point["rho0"], theta_i, lobe_of(point), digits)


def where(point: Point) -> str:
    names = ("shape", "shape_parameter", "narrowing", "fresnel_at", "n", "k", "rho0", "theta_i_deg")
    return ", ".join(f"{name} {point[name]}" for name in names)


@pytest.mark.parametrize("rtol", RTOLS)
def test_norms_reach_the_tolerance(rtol: float, points: list[Point]) -> None:
    found = []
    for point in points:
        for q, value in zip("sp", norms_at(point, -np.log10(rtol)), strict=True):
            error = abs(value / point[f"normalisation_integral_{q}"] - 1.0)
            found.append((error / max(rtol, 2e-12), f"{q}, {where(point)}"))
    assert len(found) >= 2 * 60
    assert max(found)[0] <= 1.0, sorted(found)[-4:]


def test_lobes_agree_with_extended_precision(points: list[Point]) -> None:
    """What rounding does to the angle and to the distance u, d ln S/du du, is allowed.

    At alpha = +-1 the cosine is 1e-16 wrong; ln A is at most a hundred roundings of terms of a few
    hundred, F_p near its zero and u^2 ln 2 of the Gaussian have more.
    """
    for point in points:
        shaped = lobe_of(point)
        surf = surface(point["n"], point["k"], 0.8, point["rho0"])
        theta_r = np.radians(np.array(point["theta_r_deg"]))
        theta_i = np.full(theta_r.shape, np.radians(point["theta_i_deg"]))
        along = prepare_directions(theta_i, theta_r, np.zeros(theta_r.shape))
        for i in range(theta_r.size):
            args = (along.x[i], along.c[i], along.offset[i], along.h[i])
            found = shaped_log_lobes(*args, surf, shaped)
            for q, value in zip("sp", found, strict=True):
                exact = point[f"log_a_{q}"][i]
                assert abs(value - exact) <= 3e-12 * max(abs(exact), 1.0), where(point)
        for i, beta in enumerate(point["beta"]):
            root = np.sqrt((1.0 - beta) * (1.0 + beta))
            c = np.sqrt((1.0 - 0.5 * beta) * (1.0 + 0.5 * beta))
            found = shaped_log_lobes(0.5 * beta, c, beta, 0.25 * (1.0 + root) ** 2, surf, shaped)
            for q, value in zip("sp", found, strict=True):
                exact = point[f"log_b_{q}"][i]
                assert abs(value - exact) <= 1e-12 * max(abs(exact), 1.0), where(point)


SURFACES = [
    (1.5, 0.2, 0.47), (1.05, 0.0, 1e-3), (4.0, 4.0, 4.0), (2.0, 0.0, 0.01), (0.3, 3.0, 0.1),
]  # fmt: skip


@pytest.mark.parametrize(("n", "k", "rho0"), SURFACES)
@pytest.mark.parametrize(
    ("code", "parameter"), [(LORENTZIAN, 1.0), (CAUCHY, 1.0), (VOIGT, 1.0), (VOIGT, 1.0 - 2e-8)]
)
def test_null_parameters_are_the_strict_model(
    n: float, k: float, rho0: float, code: int, parameter: float
) -> None:
    surf, shaped = surface(n, k, 0.8, rho0), lobe(code, parameter, 1.0, MEAN_SINE)
    for theta_i in np.radians([0.0, 20.0, 60.0, 80.0, 89.0, 89.95]):
        strict = normalisation_integrals(incidence(theta_i), surf, 11.0, STRICT_WORKSPACE)
        ours = norms(n, k, rho0, theta_i, shaped, 11.0)
        np.testing.assert_allclose(ours, strict, rtol=1e-10)
        args = prepare_directions(*(np.array([a]) for a in (theta_i, -0.4, 0.0)))
        x, c, offset, h = args.x[0], args.c[0], args.offset[0], args.h[0]
        log_lobes = shaped_log_lobes(x, c, offset, h, surf, shaped)
        np.testing.assert_allclose(np.exp(log_lobes), lobes(x, c, offset, h, surf), rtol=1e-12)


@pytest.mark.parametrize("place", [MEAN_SINE, GEOMETRIC_MEAN, MEAN_ANGLE])
def test_voigt_without_lorentzian_is_the_gaussian(place: int) -> None:
    for n, k, rho0 in SURFACES:
        for theta_i in (0.0, 0.7, 1.5):
            gaussian = norms(n, k, rho0, theta_i, lobe(GAUSSIAN, 1.0, 0.5, place), 11.0)
            for eta, rtol in ((0.0, 0.0), (1e-13, 1e-10)):
                voigt = norms(n, k, rho0, theta_i, lobe(VOIGT, eta, 0.5, place), 11.0)
                np.testing.assert_allclose(voigt, gaussian, rtol=rtol)


def test_the_factor_at_normal_incidence_and_direction_is_the_same_for_every_place() -> None:
    surf = surface(1.7, 0.3, 0.8, 0.2)
    f_s, f_p = reflectances(0.0, 1.0, surf)
    for place in (MEAN_SINE, GEOMETRIC_MEAN, MEAN_ANGLE):
        found = np.exp(shaped_log_lobes(0.0, 1.0, 0.0, 1.0, surf, lobe(GAUSSIAN, 1.0, 1.0, place)))
        np.testing.assert_allclose(found, np.array([f_s, f_p]) / 0.04, rtol=1e-13)


@pytest.mark.parametrize("k", [0.0, 1e-9, 1e-4])
def test_geometric_mean_at_brewster_incidence_converges(k: float) -> None:
    """F_p(alpha_i) is nearly zero, a factor of the whole norm; sqrt(F_p) has a kink at theta_i."""
    theta_b = np.arctan(1.6)
    for code in (LORENTZIAN, GAUSSIAN):
        shaped = lobe(code, 1.0, 1.0, GEOMETRIC_MEAN)
        for theta_i in (theta_b, theta_b + 1e-7, np.pi / 2 - theta_b):
            fine = norms(1.6, k, 0.05, theta_i, shaped, 13.0)
            for digits in (4.0, 6.0, 8.0, 10.0):
                coarse = norms(1.6, k, 0.05, theta_i, shaped, digits)
                np.testing.assert_allclose(coarse, fine, rtol=10.0**-digits)


def graded_norms(n: float, rho0: float, theta_i: float, shaped: Lobe) -> tuple[float, float]:
    """I_s and I_p by Gauss rules on panels that halve towards every angle that is special."""
    surf, brewster = surface(n, 0.0, 0.8, rho0), np.arctan(n)
    x, w = np.polynomial.legendre.leggauss(12)
    special = np.unique([0.0, theta_i, brewster, 0.5 * np.pi - brewster, 0.5 * np.pi])
    cuts = []
    for a, b in pairwise(special):
        steps = (b - a) * 0.5 ** np.arange(1.0, 14.0)
        cuts += [a, *(a + steps), *(b - steps)]
    cuts = np.unique([*cuts, 0.5 * np.pi])

    def lobes_at(t_i: float, t: np.ndarray, transverse: bool) -> np.ndarray:
        d = prepare_directions(np.full(t.size, t_i), t, np.full(t.size, 0.5 * np.pi * transverse))
        rows = (d.beta_x, d.beta_c, d.beta_offset, d.beta_h) if transverse else d[:4]
        return np.exp([shaped_log_lobes(*row, surf, shaped) for row in zip(*rows, strict=True)])

    def rule(a: float, b: float) -> tuple[np.ndarray, np.ndarray]:
        return 0.5 * (a + b) + 0.5 * (b - a) * x, 0.5 * (b - a) * w

    def across(a: float, b: float) -> np.ndarray:
        s, weight = rule(a, b)
        return 2.0 * (weight * np.cos(s)) @ lobes_at(0.0, s, transverse=True)

    whole = np.array([across(a, b) for a, b in pairwise(cuts)])
    before = np.vstack([np.zeros(2), np.cumsum(whole, axis=0)])
    total = np.zeros(2)
    for a, b in pairwise(cuts):
        t, weight = rule(a, b)
        s = 0.5 * np.pi - t
        piece = np.searchsorted(cuts, s) - 1
        c = np.array([before[j] + across(cuts[j], one) for j, one in zip(piece, s, strict=True)])
        both = lobes_at(theta_i, t, transverse=False) + lobes_at(theta_i, -t, transverse=False)
        total += (weight * np.cos(t)) @ (both * c[:, ::-1])
    return float(total[0]), float(total[1])


@pytest.mark.parametrize(("n", "rho0"), [(1.0005, 4.0), (1.002, 1.0), (1.02, 0.1)])
@pytest.mark.parametrize("theta_i_deg", [45.0, 80.0])
def test_geometric_mean_near_an_index_of_one(n: float, rho0: float, theta_i_deg: float) -> None:
    """Fresnel's root at sin t = m is then close to grazing, for B close to t = 0."""
    theta_i = np.deg2rad(theta_i_deg)
    shaped = lobe(LORENTZIAN, 1.0, 1.0, GEOMETRIC_MEAN)
    expected = graded_norms(n, rho0, theta_i, shaped)
    for digits in (6.0, 8.0):
        found = norms(n, 0.0, rho0, theta_i, shaped, digits)
        np.testing.assert_allclose(found, expected, rtol=10.0**-digits)


@njit
def _spread(shaped: Lobe, domain: np.ndarray, digits: float, ws: Any) -> np.ndarray:
    """I_s and I_p for rows n, k, rho0, theta_i."""
    out = np.empty((domain.shape[0], 2))
    for i in range(domain.shape[0]):
        surf = surface(domain[i, 0], domain[i, 1], 0.8, domain[i, 2])
        found = shaped_cumulative(surf, shaped, digits, ws)
        inc = incidence(domain[i, 3])
        out[i, 0], out[i, 1] = shaped_integrals(inc, surf, shaped, found, digits, ws)
    return out


@pytest.mark.parametrize("place", [MEAN_SINE, GEOMETRIC_MEAN, MEAN_ANGLE])
@pytest.mark.parametrize("digits", [4.0, 6.0, 8.0, 10.0])
def test_every_shape_converges_over_the_domain(place: int, digits: float) -> None:
    """Against the norm with 14 digits, which the reference values confirm, on 60 surfaces each."""
    rng = np.random.default_rng(int(digits) + 100 * place)
    kinds = [
        (GAUSSIAN, 1.0),
        (VOIGT, 0.1),
        (VOIGT, 0.5),
        (CAUCHY, 0.6),
        (CAUCHY, 2.0),
        (CAUCHY, 6.0),
    ]
    for code, parameter in kinds:
        for narrowing in (0.0, 1.0, 2.0):
            domain = np.stack([
                rng.uniform(1.05, 4.0, 20),
                np.where(rng.random(20) < 0.4, 0.0, 4.0 * rng.random(20) ** 3),
                10.0 ** rng.uniform(-3.0, 0.6, 20),
                np.radians(np.where(rng.random(20) < 0.2, 0.0, rng.uniform(0.0, 89.0, 20))),
            ], axis=1)  # fmt: skip
            shaped = lobe(code, parameter, narrowing, place)
            coarse, fine = (_spread(shaped, domain, d, WORKSPACE) for d in (digits, 14.0))
            worst = np.max(np.abs(coarse / fine - 1.0), axis=1)
            i = int(np.argmax(worst))
            assert worst[i] <= 10.0**-digits, (code, parameter, narrowing, domain[i], worst[i])


@settings(max_examples=200)
@given(
    code=st.integers(0, 3),
    eta=st.floats(0.0, 1.0),
    nu=st.floats(0.6, 6.0),
    narrowing=st.floats(0.0, 2.0),
    place=st.integers(0, 2),
    n=st.floats(1.0005, 6.0),
    k=st.floats(0.0, 10.0),
    log_rho0=st.floats(-3.0, 0.6),
    theta_i=st.floats(0.0, np.radians(89.95)),
    theta_r=st.floats(-np.pi / 2, np.pi / 2),
)
def test_norms_and_lobes_are_finite_everywhere(
    code: int, eta: float, nu: float, narrowing: float, place: int, n: float, k: float,
    log_rho0: float, theta_i: float, theta_r: float,
) -> None:  # fmt: skip
    shaped = lobe(code, eta if code == VOIGT else nu, narrowing, place)
    found = norms(n, k, 10.0**log_rho0, theta_i, shaped, 6.0)
    assert np.all(np.isfinite(found))
    assert min(found) > 0.0
    args = prepare_directions(*(np.array([a]) for a in (theta_i, theta_r, 0.0)))
    surf = surface(n, k, 0.8, 10.0**log_rho0)
    log_lobes = shaped_log_lobes(args.x[0], args.c[0], args.offset[0], args.h[0], surf, shaped)
    assert np.all(np.isfinite(log_lobes))
