"""Laws the model must obey, and one it does not, whatever its numbers."""

from __future__ import annotations

import importlib.util
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb

Array = NDArray[np.float64]
EPS = 2.0**-52
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
SURFACES = {
    "green paint": GREEN,
    "clear, mirror-like": pb.Parameters(n=1.5, k=0.0, sigma_n0=0.9, rho0=0.01),
    "metal": pb.Parameters(n=0.2, k=3.0, sigma_n0=1.0, rho0=0.2),
    "almost no contrast": pb.Parameters(n=1.0005, k=0.0, sigma_n0=0.5, rho0=0.1),
    "high index, broad": pb.Parameters(n=6.0, k=0.1, sigma_n0=0.3, rho0=4.0),
    "absorbing": pb.Parameters(n=3.0, k=10.0, sigma_n0=0.7, rho0=1.0),
}


def rounding(*values: Array) -> float:
    """A few eps of ln f, relative to f: the kernels work with logarithms."""
    return 4.0 * EPS * (1.0 + max(float(np.abs(np.log(v)).max()) for v in values))


every_surface = pytest.mark.parametrize("name", SURFACES)


@every_surface
def test_normal_incidence_swaps_s_and_p_with_the_axes(name: str) -> None:
    """f_s(0; alpha, beta) = f_p(0; beta, alpha): a turn by 90 degrees about the normal.

    phi_r and 90 - phi_r are rounded on their own: the directions agree to some eps, and so do the
    values, but for the slope of the lobe, d ln f / d alpha < 2/rho0 at rho0 > 0.
    """
    p = SURFACES[name]
    rng = np.random.default_rng(1)
    theta_r, phi_r = rng.uniform(0.0, 90.0, 300), rng.uniform(-180.0, 180.0, 300)
    s = pb.brdf(p, 0.0, theta_r, "s", phi_r_deg=phi_r)
    q = pb.brdf(p, 0.0, theta_r, "p", phi_r_deg=90.0 - phi_r)
    np.testing.assert_allclose(s, q, rtol=64.0 * EPS * (1.0 + 2.0 / p.rho0))
    # in the plane and across it no angle is rounded differently
    theta_r = np.linspace(-90.0, 90.0, 37)
    across = pb.brdf(p, 0.0, theta_r, "p", phi_r_deg=90.0)
    limit = 64.0 * EPS * (1.0 + 2.0 / p.rho0)
    np.testing.assert_allclose(pb.brdf(p, 0.0, theta_r, "s"), across, rtol=limit)


@every_surface
def test_normal_incidence_has_one_dhr_and_one_peak(name: str) -> None:
    p = SURFACES[name]
    assert float(pb.dhr(p, 0.0, "s")) == pytest.approx(
        float(pb.dhr(p, 0.0, "p")), rel=4.0 * EPS, abs=0.0
    )
    peaks = [float(pb.brdf(p, 0.0, 0.0, q)) for q in "spu"]
    assert peaks[0] == pytest.approx(peaks[1], rel=64.0 * EPS, abs=0.0)
    assert peaks[2] == pytest.approx(peaks[1], rel=64.0 * EPS, abs=0.0)


def test_in_plane_s_and_p_differ_at_normal_incidence_as_stated(textbook: Any) -> None:
    """9 % at 20 deg and 77 % at 60 deg on the published paint: s above p."""
    for theta_r, percent in ((20.0, 9.0), (60.0, 77.0)):
        ratio = pb.brdf(GREEN, 0.0, theta_r, "s") / pb.brdf(GREEN, 0.0, theta_r, "p")
        assert 100.0 * (float(ratio) - 1.0) == pytest.approx(percent, abs=0.5)
        s, p = textbook(1.526, 0.193, 0.4528, 0.47).brdf(0.0, theta_r)
        assert ratio == pytest.approx(float(s / p), rel=1e-7, abs=0.0)


@pytest.mark.parametrize("q", ["s", "p", "u"])
@every_surface
def test_the_two_halves_of_the_disk_mirror_each_other(name: str, q: str) -> None:
    rng = np.random.default_rng(2)
    theta_i, theta_r = rng.uniform(0.0, 89.95, 200), rng.uniform(0.0, 90.0, 200)
    phi_r = rng.uniform(0.0, 180.0, 200)
    plus = pb.brdf(SURFACES[name], theta_i, theta_r, q, phi_r_deg=phi_r)
    minus = pb.brdf(SURFACES[name], theta_i, theta_r, q, phi_r_deg=-phi_r)
    np.testing.assert_array_equal(plus, minus)


@pytest.mark.parametrize("q", ["s", "p", "u"])
def test_a_negative_angle_is_the_other_side_of_the_plane(q: str) -> None:
    """sin(-t) cos(0) = sin(t) cos(180 deg) but for sin(pi) = 1.2e-16 across."""
    theta_r = np.linspace(0.0, 90.0, 46)
    signed = pb.brdf(GREEN, 35.0, -theta_r, q)
    turned = pb.brdf(GREEN, 35.0, theta_r, q, phi_r_deg=180.0)
    np.testing.assert_allclose(turned, signed, rtol=1e-13)


@every_surface
def test_unpolarised_is_the_mean_of_s_and_p(name: str) -> None:
    p = SURFACES[name]
    theta_r = np.linspace(-85.0, 85.0, 35)
    s, q, u = (pb.brdf(p, 40.0, theta_r, word) for word in "spu")
    np.testing.assert_allclose(u, 0.5 * (s + q), rtol=rounding(s, q))
    s, q, u = (pb.dhr(p, np.array([10.0, 60.0, 85.0]), word) for word in "spu")
    np.testing.assert_allclose(u, 0.5 * (s + q), rtol=2.0 * EPS)


@every_surface
def test_scale_is_sigma_n0(name: str) -> None:
    p = SURFACES[name]
    half = pb.Parameters(n=p.n, k=p.k, sigma_n0=0.5 * p.sigma_n0, rho0=p.rho0)
    theta_r = np.linspace(-80.0, 80.0, 33)
    for q in "sp":
        low, full = pb.brdf(half, 25.0, theta_r, q), pb.brdf(p, 25.0, theta_r, q)
        np.testing.assert_allclose(2.0 * low, full, rtol=rounding(low))


def polar_integral(
    p: pb.Parameters, theta_i: float, q: str, panel_deg: float, rule: Callable[..., Any]
) -> float:
    """Integral of brdf cos(theta_r) d Omega_r over the hemisphere, product of Gauss rules.

    For lobes broader than a panel.
    """
    theta, w_theta = rule(np.arange(0.0, 90.0 + 0.5 * panel_deg, panel_deg), 8)
    phi, w_phi = rule(np.arange(-180.0, 180.0 + 0.5 * panel_deg, panel_deg), 8)
    values = pb.brdf(p, theta_i, theta[:, None], q, phi_r_deg=phi, rtol=1e-10)
    weight = w_theta * np.sin(np.radians(theta)) * np.cos(np.radians(theta))
    return float(np.einsum("i,ij,j", weight, values, w_phi) * np.radians(1.0) ** 2)


@pytest.mark.parametrize("q", ["s", "p", "u"])
@pytest.mark.parametrize(
    ("name", "theta_i"),
    [("green paint", 0.0), ("green paint", 20.0), ("green paint", 70.0), ("metal", 30.0),
     ("high index, broad", 60.0), ("absorbing", 45.0)],
)  # fmt: skip
def test_disk_integral_of_broad_lobes_is_the_dhr(
    name: str, theta_i: float, q: str, gauss_rule: Callable[..., Any]
) -> None:
    """The rule's own error is the change when its panels are halved."""
    p = SURFACES[name]
    coarse, fine = (polar_integral(p, theta_i, q, panel, gauss_rule) for panel in (15.0, 7.5))
    own = abs(coarse - fine)
    wanted = float(pb.dhr(p, theta_i, q))
    assert own < 1e-4 * wanted
    assert abs(fine - wanted) <= own + 1e-9 * wanted
    assert 0.0 <= wanted <= 1.0


def graded(centre: float, width: float, low: float, high: float) -> list[float]:
    """Break points at geometrically growing distances from a peak."""
    points = {low, high, min(max(centre, low), high)}
    while width < high - low:
        points |= {x for x in (centre - width, centre + width) if low < x < high}
        width *= 3.0
    return sorted(points)


def cartesian_integral(
    p: pb.Parameters, theta_i: float, q: str, width: float, order: int, rule: Callable[..., Any]
) -> float:
    """The same over alpha = sin t and beta = sin s with panels graded towards the lobe."""
    t_i = math.radians(theta_i)
    half_pi = 0.5 * math.pi
    breaks = sorted({*graded(t_i, width, -half_pi, half_pi), 0.0})
    t, w_t = rule(np.array(breaks), order)
    rows = []
    for angle in t.tolist():
        s, w_s = rule(np.array(graded(0.0, p.rho0, 0.0, half_pi - abs(angle))), order)
        rows.append((np.full(s.size, angle), s, w_s * np.cos(s)))
    t_all, s_all, weight = (np.concatenate(column) for column in zip(*rows, strict=True))
    weight *= np.repeat(w_t * np.cos(t), [len(r[0]) for r in rows])
    alpha, beta = np.sin(t_all), np.sin(s_all)
    theta_r = np.degrees(np.arcsin(np.minimum(np.hypot(alpha, beta), 1.0)))
    values = pb.brdf(
        p, theta_i, theta_r, q, phi_r_deg=np.degrees(np.arctan2(beta, alpha)), rtol=1e-10
    )
    return float(2.0 * weight @ values)


@pytest.mark.parametrize("q", ["s", "p"])
@pytest.mark.parametrize(
    ("name", "theta_i"),
    [("clear, mirror-like", 30.0), ("clear, mirror-like", 75.0), ("metal", 80.0),
     ("almost no contrast", 40.0), ("green paint", 85.0)],
)  # fmt: skip
def test_disk_integral_of_narrow_lobes_is_the_dhr(
    name: str, theta_i: float, q: str, gauss_rule: Callable[..., Any]
) -> None:
    """Own error from two orders of the rule; arcsin and arctan2 round directions to some eps.

    With a slope of the lobe of at most 2/width that is 1e-14/width relative.
    """
    p = SURFACES[name]
    f = float(pb.dhr(p, theta_i, q)) / p.sigma_n0
    normal = float(pb.dhr(p, 0.0, q)) / p.sigma_n0
    width = 0.5 * p.rho0 * (1.0 - f) / (1.0 - normal)
    coarse, fine = (cartesian_integral(p, theta_i, q, width, m, gauss_rule) for m in (8, 12))
    own = abs(coarse - fine)
    wanted = float(pb.dhr(p, theta_i, q))
    assert own < 1e-4 * wanted
    assert abs(fine - wanted) <= own + (1e-9 + 1e-13 / width) * wanted


def test_dhr_stays_between_zero_and_one_over_the_domain() -> None:
    rng = np.random.default_rng(3)
    angles = np.concatenate([rng.uniform(0.0, 89.95, 50), [0.0, 89.95]])
    for _ in range(300):
        n = float(rng.uniform(0.1, 6.0))
        k = float(rng.uniform(1.0, 8.0) if n < 1.0 else rng.uniform(0.0, 10.0))
        p = pb.Parameters(n=n, k=k, sigma_n0=1.0, rho0=0.3)
        for q in "spu":
            values = pb.dhr(p, angles, q)
            assert np.all((values >= 0.0) & (values <= 1.0 + 8.0 * EPS)), (n, k, q)


@pytest.mark.parametrize(("n", "theta_i"), [(1.3, 50.0), (1.5, 50.0), (2.5, 75.0)])
def test_brewster_zero_of_the_brdf(n: float, theta_i: float) -> None:
    """A_p vanishes where the mean direction sine is the Brewster one; s does not."""
    p = pb.Parameters(n=n, k=0.0, sigma_n0=1.0, rho0=0.2)
    brewster = math.sin(math.atan(n))
    theta_r = math.degrees(math.asin(2.0 * brewster - math.sin(math.radians(theta_i))))
    s, at_zero = (float(pb.brdf(p, theta_i, theta_r, q)) for q in "sp")
    beside = float(pb.brdf(p, theta_i, theta_r - 5.0, "p"))
    assert 0.0 <= at_zero < 1e-24 * s  # the square of the rounding of the angles, some 1e-15 each
    assert beside > 1e-6 * s


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    path = Path(__file__).parents[1] / "reference" / "generate.py"
    spec = importlib.util.spec_from_file_location("reference_generator", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("q", "published"), [("s", 1.20), ("p", 5.70)])
def test_reciprocity_defect_of_the_published_paint(
    q: str, published: float, generator: ModuleType
) -> None:
    """A and B are symmetric in the two directions, so that f(a -> b)/f(b -> a) is
    [F(a)/I(a)] / [F(b)/I(b)]: here with integrals and reflectances at 40 digits.
    """
    surf = generator.Surface(1.526, 0.193, 0.47)
    quotients = []
    for angle in (20.0, 60.0):
        inc = generator.incidence(angle)
        norms, _ = generator.normalisation(surf, inc, generator.grid())
        i = "sp".index(q)
        quotients.append(surf.fresnel(inc.sine)[i] / norms[i])
    wanted = float(quotients[0] / quotients[1])
    found = pb.reciprocity_ratio(GREEN, 20.0, 60.0, q)
    assert found == pytest.approx(wanted, rel=2e-8, abs=0.0)  # two BRDF values at rtol = 1e-8
    assert found == pytest.approx(published, abs=0.005)
    assert pb.reciprocity_ratio(GREEN, 60.0, 20.0, q) == pytest.approx(
        1.0 / wanted, rel=2e-8, abs=0.0
    )
    assert pb.reciprocity_ratio(GREEN, 45.0, 45.0, q) == 1.0


def test_broadcasting_and_shapes() -> None:
    assert pb.brdf(GREEN, 20.0, 10.0).shape == ()
    assert pb.brdf(GREEN, 20.0, [10.0, 20.0]).shape == (2,)
    table = pb.brdf(GREEN, [[0.0], [20.0], [40.0]], np.linspace(-80, 80, 7))
    assert table.shape == (3, 7)
    assert table.dtype == np.float64
    cube = pb.brdf(GREEN, np.zeros((2, 1, 1)), np.zeros((3, 1)), "u", phi_r_deg=np.zeros(4))
    assert cube.shape == (2, 3, 4)
    one = pb.brdf(GREEN, 20.0, np.linspace(-80, 80, 7)[3])
    assert table[1, 3] == one
    assert pb.brdf(GREEN, 20.0, []).shape == (0,)
    assert pb.dhr(GREEN, 10.0).shape == ()
    assert pb.dhr(GREEN, [[10.0, 20.0]], "p").shape == (1, 2)
    assert pb.dhr(GREEN, []).shape == (0,)


def test_a_value_does_not_depend_on_its_companions() -> None:
    """Order, repetition and other angles in the call change nothing but roundings."""
    rng = np.random.default_rng(4)
    theta_i = rng.choice([0.0, 20.0, 60.0, 89.0], 200)
    theta_r, phi_r = rng.uniform(-90.0, 90.0, 200), rng.choice([0.0, 30.0, 90.0], 200)
    together = pb.brdf(GREEN, theta_i, theta_r, "p", phi_r_deg=phi_r)
    alone = [
        float(pb.brdf(GREEN, i, r, "p", phi_r_deg=phi))
        for i, r, phi in zip(theta_i, theta_r, phi_r, strict=True)
    ]
    # B(0) is taken into the scale where a whole scan lies in the plane: a rounding apart
    np.testing.assert_allclose(together, alone, rtol=rounding(together))


def test_integers_and_lists_are_taken_as_numbers() -> None:
    assert pb.brdf(GREEN, 20, [10]) == pb.brdf(GREEN, 20.0, np.array([10.0]))


def test_no_warning_anywhere_on_a_wide_sweep() -> None:
    rng = np.random.default_rng(5)
    with warnings.catch_warnings(), np.errstate(all="raise"):
        warnings.simplefilter("error")
        for _ in range(200):
            n = float(rng.uniform(0.1, 6.0))
            p = pb.Parameters(
                n=n, k=float(rng.uniform(1.0, 8.0) if n < 1.0 else rng.choice([0.0, 1e-6, 3.0])),
                sigma_n0=float(rng.choice([0.0, 0.3, 1.0])), rho0=float(10.0 ** rng.uniform(-3, 0.6)),
            )  # fmt: skip
            theta_i = float(rng.choice([0.0, 45.0, 89.95]))
            values = pb.brdf(p, theta_i, [-90.0, -theta_i, 0.0, theta_i, 90.0], "u")
            assert np.all(np.isfinite(values))
            assert np.all(values >= 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n": 0.04}, r"n = 0\.04 is outside the model's domain \[0\.05, 6\]"),
        ({"n": 6.01}, r"n = 6\.01 is outside"),
        ({"k": -1e-9}, r"k = -1e-09 is outside the model's domain \[0, 12\]"),
        ({"k": 12.5}, r"k = 12\.5 is outside"),
        ({"sigma_n0": -0.1}, r"sigma_n0 = -0\.1 is outside the model's domain \[0, 1\]"),
        ({"sigma_n0": 1.0000001}, r"sigma_n0 = 1\.0000001 is outside"),
        ({"rho0": 9e-4}, r"rho0 = 0\.0009 is outside the model's domain \[0\.001, 4\]"),
        ({"rho0": 4.1}, r"rho0 = 4\.1 is outside"),
        ({"n": math.nan}, r"n = nan is outside"),
        ({"k": math.inf}, r"k = inf is outside"),
        ({"rho0": "0.4"}, r"rho0 = '0\.4' is outside"),
        ({"n": None}, r"n = None is outside"),
        ({"n": 1.0, "k": 0.0}, r"n = 1 with k = 0 is no surface"),
        ({"n": 0.9, "k": 0.01}, r"reflects totally beyond a critical angle"),
    ],
)
def test_parameters_outside_the_domain_are_refused(changes: dict[str, Any], message: str) -> None:
    values = {"n": 1.5, "k": 0.1, "sigma_n0": 0.5, "rho0": 0.3} | changes
    with pytest.raises(pb.DomainError, match=message):
        pb.Parameters(**values)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((-0.1, 0.0), {}, r"theta_i_deg = -0\.1 is not allowed: give degrees in \[0, 89\.95\]"),
        ((89.96, 0.0), {}, r"theta_i_deg = 89\.96 is not allowed"),
        ((math.nan, 0.0), {}, r"theta_i_deg = nan \(not a finite number\) is not allowed"),
        ((20.0, 90.001), {}, r"theta_r_deg = 90\.001 is not allowed: give degrees in \[-90, 90\]"),
        ((20.0, [0.0, -91.0]), {}, r"theta_r_deg = -91\.0 is not allowed"),
        ((20.0, math.inf), {}, r"theta_r_deg = inf \(not a finite number\)"),
        ((20.0, 0.0), {"phi_r_deg": 361.0}, r"phi_r_deg = 361\.0 is not allowed"),
        ((20.0, 0.0, "x"), {}, r"polarization = 'x' is not known\. Allowed: 's', 'p', 'u'"),
        ((20.0, 0.0), {"rtol": 1e-13}, r"rtol = 1e-13 is not allowed"),
        ((20.0, 0.0), {"rtol": 0.1}, r"rtol = 0\.1 is not allowed"),
        ((20.0, 0.0), {"rtol": math.nan}, r"rtol = nan is not allowed"),
    ],
)
def test_brdf_refuses_what_is_out_of_range(
    arguments: tuple[Any, ...], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(pb.DomainError, match=message):
        pb.brdf(GREEN, *arguments, **options)


@pytest.mark.parametrize(
    ("angle", "q", "message"),
    [
        (90.0, "s", r"theta_i_deg = 90\.0 is not allowed"),
        (-1.0, "s", r"theta_i_deg = -1\.0 is not allowed"),
        (math.nan, "s", r"theta_i_deg = nan \(not a finite number\)"),
        (20.0, "S", r"polarization = 'S' is not known"),
    ],
)
def test_dhr_refuses_what_is_out_of_range(angle: float, q: str, message: str) -> None:
    with pytest.raises(pb.DomainError, match=message):
        pb.dhr(GREEN, angle, q)


def test_a_domain_error_is_a_value_error_and_ours() -> None:
    with pytest.raises(ValueError, match="rho0"):
        pb.Parameters(n=1.5, k=0.0, sigma_n0=0.5, rho0=-1.0)
    assert issubclass(pb.DomainError, pb.PbrdfError)


def test_everything_is_compiled() -> None:
    """No object-mode fallback: every kernel has only nopython signatures."""
    from pbrdf_bayes.physics import brdf, fresnel, normalisation

    pb.brdf(GREEN, 20.0, 10.0, phi_r_deg=5.0)
    kernels = [
        value
        for module in (brdf, fresnel, normalisation)
        for value in vars(module).values()
        if hasattr(value, "nopython_signatures")
    ]
    assert len(kernels) > 10
    for kernel in kernels:
        assert len(kernel.nopython_signatures) == len(kernel.signatures), kernel
