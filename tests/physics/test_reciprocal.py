"""The reciprocal normalisation: its energy by other quadratures, its symmetry, what it moves."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate

import pbrdf_bayes as pb
from pbrdf_bayes.model import reciprocity
from pbrdf_bayes.physics import reciprocal

Array = NDArray[np.float64]
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
SURFACES = {
    "green paint": GREEN,
    "glass, k = 0": pb.Parameters(n=1.5, k=0.0, sigma_n0=0.9, rho0=0.2),
    "mirror-like": pb.Parameters(n=1.526, k=0.193, sigma_n0=0.9, rho0=1e-3),
    "metal": pb.Parameters(n=0.2, k=3.0, sigma_n0=1.0, rho0=0.3),
    "almost no contrast": pb.Parameters(n=1.0005, k=0.0, sigma_n0=0.5, rho0=0.1),
    "high index, broad": pb.Parameters(n=6.0, k=0.1, sigma_n0=0.3, rho0=4.0),
    "absorbing": pb.Parameters(n=3.0, k=10.0, sigma_n0=0.7, rho0=1.0),
}
every_surface = pytest.mark.parametrize("name", SURFACES)


def graded(centre: float, width: float, low: float, high: float) -> list[float]:
    """Break points at distances from a point that double."""
    points = {low, high, min(max(centre, low), high)}
    while width < high - low:
        points |= {x for x in (centre - width, centre + width) if low < x < high}
        width *= 2.0
    return sorted(points)


def disk_integral(
    p: pb.Parameters, theta_i: float, q: str, order: int, rule: Callable[..., Any]
) -> float:
    """Integral of f d alpha d beta over the disk, alpha = sin t and beta = sin s, Gauss panels."""
    half_pi, t_i = 0.5 * math.pi, math.radians(theta_i)
    breaks = {*graded(t_i, 0.05, -half_pi, half_pi), 0.0}
    breaks |= {x for end in (-half_pi, half_pi) for x in graded(end, 1e-4, -half_pi, half_pi)}
    t, w_t = rule(np.array(sorted(breaks)), order)
    rows = []
    for angle in t.tolist():
        s, w_s = rule(np.array(graded(0.0, 0.25 * p.rho0, 0.0, half_pi - abs(angle))), order)
        rows.append((np.full(s.size, angle), s, w_s * np.cos(s)))
    t_all, s_all, weight = (np.concatenate(column) for column in zip(*rows, strict=True))
    weight *= np.repeat(w_t * np.cos(t), [len(r[0]) for r in rows])
    alpha, beta = np.sin(t_all), np.sin(s_all)
    theta_r = np.degrees(np.arcsin(np.minimum(np.hypot(alpha, beta), 1.0)))
    values = pb.reciprocal_brdf(
        p, theta_i, theta_r, q, phi_r_deg=np.degrees(np.arctan2(beta, alpha))
    )
    return float(2.0 * weight @ values)


@pytest.mark.parametrize("q", ["s", "p", "u"])
@pytest.mark.parametrize(
    ("name", "theta_i"),
    [("green paint", 0.0), ("green paint", 20.0), ("green paint", 57.0), ("metal", 60.0),
     ("absorbing", 45.0), ("high index, broad", 30.0)],
)  # fmt: skip
def test_the_disk_integral_is_the_dhr(
    name: str, theta_i: float, q: str, gauss_rule: Callable[..., Any]
) -> None:
    """A two-dimensional rule over what the public function gives, to 1e-8."""
    p = SURFACES[name]
    found = disk_integral(p, theta_i, q, 10, gauss_rule)
    assert found == pytest.approx(float(pb.dhr(p, theta_i, q)), rel=1e-8, abs=0.0)


class Across:
    """C_q'(b)/B_q'(0) by scipy from the textbook lobes, at any distance from grazing."""

    def __init__(self, model: Any, q: int) -> None:
        self.model, self.other = model, 1 - q
        self.peak = self.lobe(0.0)

    def lobe(self, s: float) -> float:
        beta = math.sin(s)
        f = self.model.reflectances(0.5 * beta)[self.other]
        rho = self.model.widths(0.5 * beta)[self.other]
        height = 0.25 * (1.0 + math.cos(s)) ** 2
        return float(f / (beta**2 + height * rho**2))

    def __call__(self, grazing: float) -> float:
        breaks = graded(0.0, self.model.rho0, 0.0, grazing)
        pieces = [
            integrate.quad(lambda s: self.lobe(s) * math.cos(s), a, b, epsabs=0.0, epsrel=1e-11)[0]
            for a, b in pairwise(breaks)
        ]
        return 2.0 * math.fsum(pieces) / self.peak


@pytest.mark.parametrize("q", ["s", "p"])
@pytest.mark.parametrize(
    ("name", "theta_i"),
    [("glass, k = 0", 0.0), ("glass, k = 0", 56.0), ("glass, k = 0", 80.0), ("green paint", 89.95),
     ("mirror-like", 0.0), ("mirror-like", 40.0), ("mirror-like", 85.0)],
)  # fmt: skip
def test_the_energy_of_hard_cases(
    name: str, theta_i: float, q: str, textbook: Any, gauss_rule: Callable[..., Any]
) -> None:
    """f(alpha, beta) = f(alpha, 0) B(beta)/B(0) leaves a line integral of in-plane values.

    Rounding of an angle of 90 deg, 1e-14 deg, over the width of the lobe: 1e-9 for the narrowest.
    """
    p = SURFACES[name]
    across = Across(textbook(p.n, p.k, p.sigma_n0, p.rho0), "sp".index(q))
    t_i, half_pi = math.radians(theta_i), 0.5 * math.pi
    width = 0.1 * p.rho0 * math.cos(t_i)
    breaks = {*graded(t_i, width, -half_pi, half_pi), 0.0}
    finest = 0.1 * (half_pi - t_i)
    breaks |= {x for end in (-half_pi, half_pi) for x in graded(end, finest, -half_pi, half_pi)}
    t, w_t = gauss_rule(np.array(sorted(breaks)), 10)
    values = pb.reciprocal_brdf(p, theta_i, np.degrees(t), q)
    strips = np.array([across(half_pi - abs(x)) for x in t.tolist()])
    found = float(np.sum(w_t * np.cos(t) * values * strips))
    assert found == pytest.approx(float(pb.dhr(p, theta_i, q)), rel=1e-8, abs=0.0)


@every_surface
def test_in_plane_it_is_reciprocal(name: str) -> None:
    """To 1e-8, forward and backward; the model with Eq. (4) is not."""
    p = SURFACES[name]
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0.0, 89.95, 200), rng.uniform(0.0, 89.95, 200)
    for q in "spu":
        for side in (1.0, -1.0):
            there = pb.reciprocal_brdf(p, a, side * b, q)
            back = pb.reciprocal_brdf(p, b, side * a, q)
            np.testing.assert_allclose(there, back, rtol=1e-8 if p.rho0 < 0.01 else 1e-10)


@pytest.mark.parametrize("name", sorted(set(SURFACES) - {"almost no contrast"}))
def test_it_is_a_product_of_factors(name: str, textbook: Any) -> None:
    """f / (A B) in plane is g(a) g(b): ratios of four values are 1, with the textbook's A and B."""
    p = SURFACES[name]
    model = textbook(p.n, p.k, p.sigma_n0, p.rho0)
    angles = np.array([5.0, 25.0, 50.0, 75.0])
    for i, q in enumerate("sp"):
        f = pb.reciprocal_brdf(p, angles[:, None], angles, q)
        shapes = np.array(
            [
                model.shape(math.sin(math.radians(x)), np.sin(np.radians(angles)), 0.0)[i]
                for x in angles
            ]
        )
        factors = f / shapes
        outer = np.sqrt(np.outer(np.diag(factors), np.diag(factors)))
        np.testing.assert_allclose(factors, outer, rtol=1e-9)


def test_one_scale_serves_the_paints_published_scans() -> None:
    """How far the curves move, as the docstring of `reciprocal_brdf` states."""
    theta_r = np.linspace(-80.0, 80.0, 321)
    theta_i = np.array([0.0, 20.0, 40.0, 60.0, 80.0])[:, None]
    for q, low, high in (("s", 0.59, 1.48), ("p", 0.083, 1.52)):
        ratio = pb.reciprocal_brdf(GREEN, theta_i, theta_r, q) / pb.brdf(GREEN, theta_i, theta_r, q)
        assert float(ratio.min()) == pytest.approx(low, rel=0.01)
        assert float(ratio.max()) == pytest.approx(high, rel=0.01)
    least = theta_r[np.unravel_index(ratio.argmin(), ratio.shape)[1]]
    assert abs(float(least)) == pytest.approx(57.0, abs=1.0)


def test_what_is_lost_at_normal_incidence() -> None:
    """s and p, which a surface without a direction cannot tell apart, differ; with Eq. (4) not."""
    s, p = (float(pb.reciprocal_brdf(GREEN, 0.0, 0.0, q)) for q in "sp")
    assert s / p == pytest.approx(0.92, abs=0.005)
    s, p = (float(pb.brdf(GREEN, 0.0, 0.0, q)) for q in "sp")
    assert s == pytest.approx(p, rel=1e-14)


def test_sigma_n0_is_a_scale_and_may_be_zero() -> None:
    half = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.2264, rho0=0.47)
    black = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.0, rho0=0.47)
    theta_r = np.linspace(-80.0, 80.0, 9)
    full = pb.reciprocal_brdf(GREEN, 20.0, theta_r)
    np.testing.assert_allclose(2.0 * pb.reciprocal_brdf(half, 20.0, theta_r), full, rtol=1e-15)
    assert np.all(pb.reciprocal_brdf(black, 20.0, theta_r) == 0.0)


def test_grazing_angles_follow_the_square_root() -> None:
    """f ~ sqrt(cos(theta_r)) towards grazing, 0 at 90 deg; one law on both sides of the change."""
    left = 10.0 ** np.arange(-1.0, -10.0, -1.0)
    values = pb.reciprocal_brdf(GREEN, 30.0, 90.0 - left, "s")
    ratio = values / np.sqrt(np.sin(np.radians(left)))
    np.testing.assert_allclose(ratio[3:] / ratio[4], 1.0, rtol=1e-4)
    assert np.all(pb.reciprocal_brdf(GREEN, [0.0, 30.0], [-90.0, 90.0], "u") == 0.0)


@every_surface
def test_values_are_finite_and_silent(name: str) -> None:
    theta_i = np.array([0.0, 1e-6, 45.0, 89.0, 89.95])[:, None]
    theta_r = np.array([-90.0, -89.95, -45.0, 0.0, 45.0, 89.95, 90.0])
    with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
        warnings.simplefilter("error")
        for phi_r in (0.0, 33.0, 90.0, 180.0):
            values = pb.reciprocal_brdf(SURFACES[name], theta_i, theta_r, "u", phi_r_deg=phi_r)
            assert np.all(np.isfinite(values))
            assert np.all(values >= 0.0)


def test_out_of_plane_the_halves_mirror_each_other() -> None:
    theta_r, phi_r = np.linspace(0.0, 90.0, 10), 40.0
    plus = pb.reciprocal_brdf(GREEN, 30.0, theta_r, "p", phi_r_deg=phi_r)
    minus = pb.reciprocal_brdf(GREEN, 30.0, theta_r, "p", phi_r_deg=-phi_r)
    np.testing.assert_array_equal(plus, minus)
    signed = pb.reciprocal_brdf(GREEN, 30.0, -theta_r, "p")
    turned = pb.reciprocal_brdf(GREEN, 30.0, theta_r, "p", phi_r_deg=180.0)
    np.testing.assert_allclose(turned[:-1], signed[:-1], rtol=1e-12)
    assert signed[-1] == 0.0
    assert 0.0 <= turned[-1] < 1e-7 * turned[-2]  # sqrt of the rounding of 180 deg


def test_what_does_not_converge_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reciprocal, "MAX_PANELS", 30)
    surface = pb.Parameters(n=1.51, k=0.0, sigma_n0=0.9, rho0=0.2)
    reciprocity._solved.cache_clear()
    with pytest.raises(pb.ConvergenceError, match=r"accurate to .* where 1\.0e-09 was wanted"):
        pb.reciprocal_brdf(surface, 20.0, 10.0)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((20.0, 10.0, "x"), {}, r"polarization = 'x' is not known"),
        ((90.0, 10.0), {}, r"theta_i_deg = 90\.0 is not allowed"),
        ((20.0, 91.0), {}, r"theta_r_deg = 91\.0 is not allowed"),
        ((20.0, 10.0), {"phi_r_deg": math.nan}, r"phi_r_deg = nan"),
        ((20.0, 10.0), {"rtol": 1e-10}, r"rtol = 1e-10 is not allowed here: give .* in \[1e-09, 1e-2\]"),
        ((20.0, 10.0), {"rtol": 0.1}, r"rtol = 0\.1 is not allowed"),
    ],
)  # fmt: skip
def test_what_is_not_allowed_is_refused(
    arguments: tuple[Any, ...], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(pb.DomainError, match=message):
        pb.reciprocal_brdf(GREEN, *arguments, **options)


def test_the_table_of_the_defect(textbook: Any) -> None:
    """[F(a)/I(a)] / [F(b)/I(b)] with the textbook's integrals; 1.20 and 5.70 for 20 and 60 deg."""
    angles = np.array([0.0, 20.0, 40.0, 60.0])
    table = pb.reciprocity_defect(GREEN, angles[:, None], angles)
    assert table.shape == (2, 4, 4)
    model = textbook(GREEN.n, GREEN.k, GREEN.sigma_n0, GREEN.rho0)
    sines = np.sin(np.radians(angles)).tolist()
    per_norm = np.array(
        [np.array(model.reflectances(x)) / np.array(model.norms(x)) for x in sines]
    ).T
    np.testing.assert_allclose(table, per_norm[:, :, None] / per_norm[:, None, :], rtol=1e-7)
    np.testing.assert_allclose(table[:, 1, 3], [1.202, 5.698], atol=5e-4)
    np.testing.assert_array_equal(table[:, range(4), range(4)], 1.0)
    np.testing.assert_allclose(table * table.swapaxes(1, 2), 1.0, rtol=1e-13)
    one = pb.reciprocity_ratio(GREEN, 20.0, 60.0, "p")
    assert float(pb.reciprocity_defect(GREEN, 20.0, 60.0)[1]) == one
    black = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.0, rho0=0.3)
    assert np.isnan(pb.reciprocity_defect(black, 20.0, 60.0)).all()
    with pytest.raises(pb.DomainError, match=r"theta_i_deg = -5\.0"):
        pb.reciprocity_defect(GREEN, -5.0, 20.0)
