"""The hard cases by name, and properties over the whole domain.

A node count may change from one parameter set to the next; each value is within rtol of the exact
one, so that no jump of ln f can exceed 2 rtol.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.measurement import Measurement, measurement_from_columns

Array = NDArray[np.float64]
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
GRID = np.linspace(-80.0, 80.0, 65)


def scan_of(
    p: pb.Parameters, theta_i: float, q: str, theta_r: Array = GRID, copies: int = 1
) -> Measurement:
    """One noiseless scan, or several repeats of it."""
    values = pb.brdf(p, theta_i, theta_r, q)
    n = theta_r.size * copies
    return measurement_from_columns(
        sample="simulated", wavelength_um=1.0, quantity=["brdf"] * n, polarization=[q] * n,
        theta_i_deg=np.full(n, theta_i), theta_r_deg=np.tile(theta_r, copies),
        value=np.tile(np.maximum(values, 1e-30), copies),
        scan=np.repeat([f"run {i}" for i in range(copies)], theta_r.size),
    )  # fmt: skip


def log_likelihood(measurement: Measurement, p: pb.Parameters, **config: Any) -> float:
    """Log-likelihood at the parameters with 2 % noise."""
    posterior = pb.build_posterior(measurement, pb.RunConfig(**({"noise": "iid"} | config)))
    x = np.concatenate([p.as_array(), np.full(posterior.n_par - 4, 0.02)])
    return float(posterior.log_likelihood(x[None, :])[0])


def assert_sound(p: pb.Parameters, theta_i: float) -> None:
    """Values are finite and not negative over the hemisphere, with their peak not at the rim."""
    theta_r = np.concatenate([GRID, [-90.0, 90.0, theta_i]])
    for q in "spu":
        for phi_r in (0.0, 30.0, 90.0):
            values = pb.brdf(p, theta_i, theta_r, q, phi_r_deg=phi_r)
            assert np.all(np.isfinite(values)), (q, phi_r)
            assert np.all(values >= 0.0), (q, phi_r)
        assert 0.0 <= float(pb.dhr(p, theta_i, q)) <= 1.0


def test_brewster_zero() -> None:
    """k = 0 at the Brewster angle: DHR_p and the specular peak vanish, nothing else breaks."""
    p = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.9, rho0=0.1)
    theta_b = math.degrees(math.atan(1.5))
    assert_sound(p, theta_b)
    assert float(pb.dhr(p, theta_b, "p")) < 1e-28
    ordinary = float(pb.brdf(p, theta_b, theta_b, "s"))
    assert float(pb.brdf(p, theta_b, theta_b, "p")) < 1e-28 * ordinary
    measurement = scan_of(GREEN, theta_b, "p", np.append(GRID, theta_b))
    assert np.isfinite(log_likelihood(measurement, p))
    assert np.isfinite(log_likelihood(measurement, p, brdf_floor=1e-6))
    # with a floor the likelihood is also moderate: the null is a reading of the floor
    floored = log_likelihood(scan_of(p, theta_b, "p"), p, brdf_floor=1e-6)
    assert floored > -1e3


def test_n_to_one() -> None:
    """F ~ ((n - 1)/2)^2 at normal incidence keeps its relative accuracy."""
    for n in (1.0005, 1.001, 1.01):
        p = pb.Parameters(n=n, k=0.0, sigma_n0=1.0, rho0=0.2)
        for theta_i in (0.0, 45.0, 89.95):
            assert_sound(p, theta_i)
        exact = ((n - 1.0) / (n + 1.0)) ** 2  # n - 1 is exact in double precision
        assert float(pb.dhr(p, 0.0, "s")) == pytest.approx(exact, rel=1e-14, abs=0.0)


def test_grazing() -> None:
    for theta_i in (85.0, 89.0, 89.9, 89.95):
        for rho0 in (1e-3, 0.1, 4.0):
            assert_sound(pb.Parameters(n=1.5, k=0.1, sigma_n0=0.9, rho0=rho0), theta_i)
    near, far = (float(pb.dhr(pb.Parameters(n=1.5, k=0.1, sigma_n0=1.0, rho0=0.1), t, "s"))
                 for t in (89.95, 89.9))  # fmt: skip
    assert (1.0 - near) / (1.0 - far) == pytest.approx(0.5, rel=2e-3)  # 1 - F is linear in cos


def test_mirror_like_lobe() -> None:
    """rho0 = 1e-3: half width at half maximum is rho0 at normal incidence, Eq. (5)."""
    p = pb.Parameters(n=1.5, k=0.1, sigma_n0=0.9, rho0=1e-3)
    assert_sound(p, 30.0)
    edge = math.degrees(math.asin(p.rho0))
    peak, half = (float(v) for v in pb.brdf(p, 0.0, [0.0, edge], "s"))
    assert half / peak == pytest.approx(0.5, abs=5.0 * p.rho0**2)


def test_broad_lobe(textbook: Any) -> None:
    """rho0 = 4: no peak at the specular angle; the rise of F towards grazing shapes the curve."""
    p = pb.Parameters(n=1.5, k=0.1, sigma_n0=0.9, rho0=4.0)
    assert_sound(p, 30.0)
    for i, q in enumerate("sp"):
        values = pb.brdf(p, 30.0, GRID, q)
        wanted = textbook(p.n, p.k, p.sigma_n0, p.rho0).brdf(30.0, GRID)[i]
        np.testing.assert_allclose(values, wanted, rtol=1e-6)  # the plain rule's own error


def test_metal() -> None:
    for n, k in ((0.1, 1.0), (0.1, 8.0), (1.0, 8.0), (0.05, 12.0)):
        p = pb.Parameters(n=n, k=k, sigma_n0=1.0, rho0=0.05)
        for theta_i in (0.0, 60.0, 89.95):
            assert_sound(p, theta_i)
        closed = ((n - 1.0) ** 2 + k**2) / ((n + 1.0) ** 2 + k**2)
        assert float(pb.dhr(p, 0.0, "s")) == pytest.approx(closed, rel=1e-14, abs=0.0)


def test_sigma_n0_at_its_ends() -> None:
    dark = pb.Parameters(n=1.5, k=0.1, sigma_n0=0.0, rho0=0.3)
    np.testing.assert_array_equal(pb.brdf(dark, 20.0, GRID, "s"), 0.0)
    np.testing.assert_array_equal(pb.dhr(dark, GRID[33:], "p"), 0.0)
    tiny, full = (pb.Parameters(n=1.5, k=0.1, sigma_n0=s, rho0=0.3) for s in (1e-200, 1.0))
    ratio = pb.brdf(tiny, 20.0, GRID, "s") / pb.brdf(full, 20.0, GRID, "s")
    np.testing.assert_allclose(ratio, 1e-200, rtol=1e-12)  # ln f has |ln f| eps
    measurement = scan_of(GREEN, 20.0, "s")
    values = [log_likelihood(measurement, p) for p in (dark, tiny, full)]
    assert np.all(np.isfinite(values))
    assert values[0] <= values[1] < values[2]


def test_normal_incidence_degeneracy() -> None:
    """At theta_i = 0 two surfaces of the same F(0) still differ, and nothing is singular."""
    assert_sound(GREEN, 0.0)
    at_zero, beside = (pb.brdf(GREEN, t, GRID, "s") for t in (0.0, 1e-9))
    np.testing.assert_allclose(beside, at_zero, rtol=1e-8 + 4.0 * math.radians(1e-9) / GREEN.rho0)
    np.testing.assert_allclose(at_zero, at_zero[::-1], rtol=1e-14)


def test_repeated_scans() -> None:
    """Three copies of a scan weigh three times: the likelihood factorises over scans."""
    one, three = scan_of(GREEN, 20.0, "s"), scan_of(GREEN, 20.0, "s", copies=3)
    assert len(three.scans) == 3
    assert log_likelihood(three, GREEN) == pytest.approx(
        3.0 * log_likelihood(one, GREEN), rel=1e-13
    )
    other = pb.Parameters(n=1.6, k=0.2, sigma_n0=0.4, rho0=0.4)
    assert log_likelihood(three, other) == pytest.approx(
        3.0 * log_likelihood(one, other), rel=1e-13
    )


def test_one_point_per_scan() -> None:
    incidences = np.linspace(0.0, 80.0, 9)
    singles = measurement_from_columns(
        sample="simulated", wavelength_um=1.0, quantity=["brdf"] * 9, polarization=["s"] * 9,
        theta_i_deg=incidences, theta_r_deg=np.full(9, 30.0),
        value=pb.brdf(GREEN, incidences, 30.0, "s"),
    )  # fmt: skip
    assert [len(scan) for scan in singles.scans] == [1] * 9
    alone = [log_likelihood(scan_of(GREEN, a, "s", np.array([30.0])), GREEN) for a in incidences]
    assert log_likelihood(singles, GREEN) == pytest.approx(sum(alone), rel=1e-13)
    assert np.isfinite(log_likelihood(singles, GREEN, u_brdf_cal=0.05))


def test_a_hundred_thousand_points_per_scan() -> None:
    """The sum over rows does not lose digits: noiseless data give n times the constant term."""
    angles = np.linspace(-80.0, 80.0, 100_001)
    measurement = scan_of(GREEN, 20.0, "s", angles)
    posterior = pb.build_posterior(measurement, pb.RunConfig(noise="iid", accuracy="reference"))
    x = np.append(GREEN.as_array(), 0.02)[None, :]
    exact = -0.5 * angles.size * math.log(2.0 * math.pi * 0.02**2)
    # data at rtol 1e-8, model at 1e-10: residuals below 2e-8, chi^2 below 1e5 (2e-8/0.02)^2
    assert posterior.log_likelihood(x)[0] == pytest.approx(exact, rel=1e-12)


def test_dynamic_range_of_nine_decades() -> None:
    """A mirror-like metal: the peak is 1e9 above the far wing, both with their relative accuracy."""
    p = pb.Parameters(n=0.2, k=3.0, sigma_n0=1.0, rho0=1e-3)
    theta_r = np.array([-90.0, -60.0, 60.0, 75.0])
    fine, coarse = (pb.brdf(p, 60.0, theta_r, "s", phi_r_deg=0.0, rtol=r) for r in (1e-12, 1e-6))
    across = pb.brdf(p, 60.0, 60.0, "s", phi_r_deg=90.0, rtol=1e-12)
    assert fine[2] / across > 1e9
    np.testing.assert_allclose(coarse, fine, rtol=1e-6)


@pytest.mark.parametrize("rtol", [1e-5, 1e-6, 1e-8])
@pytest.mark.parametrize("name", ["n", "k", "rho0", "theta_i"])
def test_jumps_of_the_logarithm_stay_within_the_tolerance(name: str, rtol: float) -> None:
    """Along a path through the domain ln f(rtol) - ln f(exact) never jumps by more than 2 rtol."""
    ends: dict[str, tuple[float, float]] = {
        "n": (1.05, 3.5), "k": (1e-3, 2.0), "rho0": (2e-3, 3.0), "theta_i": (0.0, 85.0),
    }  # fmt: skip
    low, high = ends[name]
    path = np.geomspace(low, high, 400) if low > 0.0 else np.linspace(low, high, 400)
    base = {"n": 1.5, "k": 0.1, "rho0": 0.2}
    difference = []
    for value in path.tolist():
        theta_i = value if name == "theta_i" else 50.0
        p = pb.Parameters(**(base | ({} if name == "theta_i" else {name: value})), sigma_n0=0.5)
        rough, fine = (
            [float(pb.brdf(p, theta_i, 20.0, q, rtol=r)) for q in "sp"] for r in (rtol, 1e-12)
        )
        difference.append(np.log(rough) - np.log(fine))
    jumps = np.abs(np.diff(difference, axis=0))
    assert jumps.max() <= 2.0 * rtol, (
        f"{jumps.max():.2e} near {name} = {path[jumps.max(1).argmax()]}"
    )


# -------------------------------------------------------------------- properties over the domain


@st.composite
def surfaces(draw: Any) -> pb.Parameters:
    """Parameters over the domain where the accuracy is claimed."""
    if draw(st.booleans()):
        n = draw(st.floats(1.0005, 6.0))
        k = draw(st.one_of(st.just(0.0), st.floats(1e-6, 10.0)))
    else:
        n, k = draw(st.floats(0.1, 1.0)), draw(st.floats(1.0, 8.0))
    rho0 = 10.0 ** draw(st.floats(-3.0, math.log10(4.0)))
    sigma_n0 = draw(st.floats(1e-6, 1.0))
    return pb.Parameters(n=n, k=k, sigma_n0=sigma_n0, rho0=min(max(rho0, 1e-3), 4.0))


incidences = st.one_of(st.just(0.0), st.just(89.95), st.floats(0.0, 89.95))
scatterings = st.one_of(st.sampled_from([-90.0, 0.0, 90.0]), st.floats(-90.0, 90.0))
azimuths = st.one_of(st.just(0.0), st.floats(-180.0, 180.0))


@given(surfaces(), incidences, scatterings, azimuths, st.sampled_from("spu"))
@settings(max_examples=300, deadline=None)
@example(pb.Parameters(n=1.0005, k=0.0, sigma_n0=1e-6, rho0=1e-3), 0.0, 90.0, 90.0, "p")
@example(pb.Parameters(n=1.5, k=0.0, sigma_n0=1.0, rho0=1e-3), 56.309932474020215, 90.0, 0.0, "p")
def test_values_are_finite_and_not_negative(
    p: pb.Parameters, theta_i: float, theta_r: float, phi_r: float, q: str
) -> None:
    value = float(pb.brdf(p, theta_i, theta_r, q, phi_r_deg=phi_r))
    assert math.isfinite(value)
    assert value >= 0.0
    assert 0.0 <= float(pb.dhr(p, theta_i, q)) <= 1.0


@given(surfaces(), st.floats(0.0, 90.0), st.floats(-180.0, 180.0))
@settings(max_examples=200, deadline=None)
def test_normal_incidence_symmetry(p: pb.Parameters, theta_r: float, phi_r: float) -> None:
    """Within the tolerance, and what rounding phi_r and 90 - phi_r does to the direction."""
    s = float(pb.brdf(p, 0.0, theta_r, "s", phi_r_deg=phi_r))
    across = float(pb.brdf(p, 0.0, theta_r, "p", phi_r_deg=90.0 - phi_r))
    assert s == pytest.approx(across, rel=2e-8 + 1e-14 / p.rho0, abs=0.0)


@given(surfaces(), incidences, st.sampled_from("sp"), st.floats(1e-14, 1e-11))
@settings(max_examples=200, deadline=None)
def test_tiny_steps_make_tiny_changes(
    p: pb.Parameters, theta_i: float, q: str, step: float
) -> None:
    """|d ln f| <= 2 rtol + the slope of the model times the step.

    d ln f / d ln(x) is below 20 times the contrast's, n/(n - 1) <= 2001, over the domain.
    """
    assume(p.k == 0.0 or p.k > 1e-3)
    moved = pb.Parameters(
        n=min(p.n * (1.0 + step), 6.0), k=p.k * (1.0 - step), sigma_n0=p.sigma_n0,
        rho0=max(p.rho0 * (1.0 - step), 1e-3),
    )  # fmt: skip
    theta_r = np.array([0.0, 15.0, -70.0])  # away from the Brewster zero of most surfaces
    before, after = (pb.brdf(x, theta_i, theta_r, q, rtol=1e-6) for x in (p, moved))
    shares = before / np.maximum(before.max(), 1e-300)
    change = np.abs(np.log(after / before))[shares > 1e-6]
    assert np.all(change <= 2e-6 + 1e5 * step)


@given(surfaces(), st.floats(0.0, 70.0), st.sampled_from("sp"))
@settings(max_examples=25, deadline=None)
def test_disk_integral_is_the_dhr(p: pb.Parameters, theta_i: float, q: str) -> None:
    """Independent 2-D rule in polar coordinates, for lobes it resolves.

    Panels of 7.5 deg with 8 nodes put poles of width w at an ellipse parameter above 2 for w > 0.1:
    2^-16 a panel. The bound is the change from 15 deg panels.
    """
    broad = pb.Parameters(n=p.n, k=p.k, sigma_n0=p.sigma_n0, rho0=max(p.rho0, 0.6))
    totals = []
    for panel in (15.0, 7.5):
        nodes, weights = np.polynomial.legendre.leggauss(8)
        lower = np.arange(0.0, 90.0, panel)[:, None]
        theta = (lower + 0.5 * panel * (1.0 + nodes)).ravel()
        phi = np.concatenate([theta, theta + 90.0])
        w_theta = np.tile(0.5 * panel * weights, lower.size)
        w_theta = w_theta * np.sin(np.radians(theta)) * np.cos(np.radians(theta))
        values = pb.brdf(broad, theta_i, theta[:, None], q, phi_r_deg=phi)
        w_phi = np.tile(0.5 * panel * weights, 2 * lower.size)
        totals.append(2.0 * float(w_theta @ values @ w_phi) * math.radians(1.0) ** 2)
    wanted = float(pb.dhr(broad, theta_i, q))
    own = abs(totals[1] - totals[0])
    assume(own < 1e-3 * wanted)  # a lobe that the rule does not resolve says nothing
    assert abs(totals[1] - wanted) <= own + 1e-7 * wanted
