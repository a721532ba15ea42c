"""Light inside a specular port: areas in closed form, and an independent adaptive integration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import pbrdf_bayes as pb
from pbrdf_bayes.model.diffuse_directional import port_light
from pbrdf_bayes.physics.port import lobe_widths, port_nodes

GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)


def area(theta_i: float, half_angle: float) -> float:
    """Projected solid angle of the port [sr], by its nodes."""
    *_, weight = port_nodes(np.deg2rad(theta_i), np.deg2rad(half_angle), width=0.1, rho0=0.1)
    return float(weight.sum())


@pytest.mark.parametrize(
    ("theta_i", "half_angle"),
    [(0.0, 5.0), (20.0, 10.0), (60.0, 20.0), (80.0, 5.0), (45.0, 45.0), (89.0, 0.5)],
)
def test_area_of_the_port(theta_i: float, half_angle: float) -> None:
    """A cone above the horizon has the projected solid angle pi sin^2(psi) cos(theta)."""
    wanted = np.pi * np.sin(np.deg2rad(half_angle)) ** 2 * np.cos(np.deg2rad(theta_i))
    assert area(theta_i, half_angle) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("theta_i", "half_angle"), [(85.0, 10.0), (60.0, 45.0), (89.0, 2.0)])
def test_area_of_a_port_at_the_horizon(theta_i: float, half_angle: float) -> None:
    """A cone whose lower part is below the horizon: what is above, by an adaptive integral.

    Of the ellipse in which the cone projects, and the half disk beyond the chord of the horizon.
    """
    centre, cosine = np.sin(np.deg2rad(theta_i)), np.cos(np.deg2rad(theta_i))
    rim = np.cos(np.deg2rad(half_angle))

    def across(alpha: float) -> float:
        least = max(0.0, (rim - alpha * centre) / cosine)
        return float(2.0 * np.sqrt(max(0.0, 1.0 - alpha**2 - least**2)))

    start = np.sin(np.deg2rad(theta_i - half_angle))
    wanted, _ = quad(across, start, 1.0, points=[rim / centre], epsabs=1e-11, limit=400)
    assert area(theta_i, half_angle) == pytest.approx(wanted, rel=1e-6)


def adaptive(
    p: pb.Parameters, theta_i: float, half_angle: float, q: str, effects: pb.Effects | None
) -> float:
    """Nested quadrature: adaptive over alpha = mid + half sin(t), beta in geometric panels."""
    centre, cosine = np.sin(np.deg2rad(theta_i)), np.cos(np.deg2rad(theta_i))
    rim = np.cos(np.deg2rad(half_angle))
    node, weight = np.polynomial.legendre.leggauss(12)

    def across(alpha: float) -> float:
        reach2 = 1.0 - alpha**2 - max(0.0, (rim - alpha * centre) / cosine) ** 2
        if reach2 <= 0.0:
            return 0.0
        reach = np.sqrt(reach2)
        edges = np.append(0.0, np.geomspace(min(0.04 * p.rho0, 0.1 * reach), reach, 16))
        low, high = edges[:-1, None], edges[1:, None]
        beta = (0.5 * (low + high) + 0.5 * (high - low) * node).ravel()
        w = (0.5 * (high - low) * weight).ravel()
        theta_r = np.rad2deg(np.arcsin(np.minimum(np.hypot(alpha, beta), 1.0)))
        phi_r = np.rad2deg(np.arctan2(beta, alpha))
        f = pb.brdf(p, theta_i, theta_r, q, phi_r_deg=phi_r, effects=effects, rtol=1e-10)
        return float(2.0 * f @ w)

    total = 0.0
    ends = [np.sin(np.deg2rad(min(90.0, theta_i + d))) for d in (-half_angle, 0.0, half_angle)]
    kink = rim / centre if centre > 0.0 and theta_i + half_angle > 90.0 else ends[1]
    stops = sorted({*ends, kink})
    for low, high in pairwise(stops):
        mid, half = 0.5 * (low + high), 0.5 * (high - low)
        total += quad(
            lambda t, m=mid, h=half: across(m + h * np.sin(t)) * h * np.cos(t),
            -0.5 * np.pi, 0.5 * np.pi, epsabs=1e-12, epsrel=1e-8, limit=200,
        )[0]  # fmt: skip
    return total


CASES = [
    (0.47, 8.0, 5.0, None), (0.47, 85.0, 10.0, None), (0.05, 60.0, 20.0, None),
    (2.0, 30.0, 2.0, None), (0.005, 60.0, 20.0, None), (0.001, 60.0, 20.0, None),
    (0.001, 30.0, 2.0, None), (0.02, 60.0, 45.0, None),
    (0.3, 20.0, 8.0, pb.Effects(lambert=0.02, volume=0.01)),
    (0.1, 50.0, 15.0, pb.Effects(line_shape="gaussian")),
    (0.1, 50.0, 15.0, pb.Effects(line_shape="cauchy", nu=1.5, narrowing=2.0, bulk=0.01)),
]  # fmt: skip


@pytest.mark.parametrize(("rho0", "theta_i", "port", "effects"), CASES)
@pytest.mark.parametrize("q", ["s", "p"])
def test_light_inside_the_port(
    rho0: float, theta_i: float, port: float, effects: pb.Effects | None, q: str
) -> None:
    """A millionth of the DHR: the adaptive integration itself is no better for narrow lobes."""
    p = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=rho0)
    whole = pb.dhr(p, theta_i, q, effects=effects)
    found = pb.ddr(p, theta_i, q, port_deg=port, effects=effects)
    wanted = whole - adaptive(p, theta_i, port, q, effects)
    assert abs(float(found - wanted)) < 1e-6 * float(whole)


@pytest.mark.parametrize("rho0", [1e-3, 0.02, 0.3, 4.0])
@pytest.mark.parametrize("theta_i", [0.0, 60.0, 85.0, 89.0])
@pytest.mark.parametrize("metal", [False, True])
def test_the_quadrature_has_converged(rho0: float, theta_i: float, metal: bool) -> None:
    """Against many more nodes, also where wider lobes use the nodes of narrow ones."""
    n, k = (0.5, 3.0) if metal else (1.526, 0.193)
    p = pb.Parameters(n=n, k=k, sigma_n0=0.4528, rho0=rho0)
    angle = float(np.deg2rad(theta_i))
    (width,) = lobe_widths(p.as_array()[None, :], angle, np.ones(1))
    for port in (0.1, 2.0, 20.0, 45.0):
        for q in "sp":

            def inside(share: float, digits: float, port: float = port, q: str = q) -> float:
                theta_r, phi_r, weight = port_nodes(
                    angle, float(np.deg2rad(port)), width=share * width, rho0=share * rho0,
                    digits=digits,
                )  # fmt: skip
                f = pb.brdf(
                    p, theta_i, np.rad2deg(theta_r), q, phi_r_deg=np.rad2deg(phi_r), rtol=1e-9
                )
                return float(f @ weight)

            fine = inside(0.5, 13.0)
            for share in (1.0, 1.0 / 16.0):
                assert abs(inside(share, 8.0) - fine) < 1e-6 * float(pb.dhr(p, theta_i, q))


def test_unpolarised_light_is_the_mean_of_s_and_p() -> None:
    s, p, u = (pb.ddr(GREEN, [5.0, 50.0], q, port_deg=10.0) for q in "spu")
    np.testing.assert_allclose(u, 0.5 * (s + p), rtol=1e-12)


def test_a_smooth_paint_loses_its_lobe_and_a_wide_port_more_of_it() -> None:
    smooth = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=2e-3)
    small, large = (float(pb.ddr(smooth, 30.0, "s", port_deg=d)) for d in (2.0, 10.0))
    assert 0.0 < large < small < 0.2 * float(pb.dhr(smooth, 30.0, "s"))


def test_many_sets_share_nodes_and_lose_nothing() -> None:
    rng = np.random.default_rng(3)
    x = np.column_stack([
        rng.uniform(1.2, 2.0, 12), rng.uniform(0.0, 0.5, 12), rng.uniform(0.1, 1.0, 12),
        np.exp(rng.uniform(np.log(1e-3), np.log(4.0), 12)),
    ])  # fmt: skip
    paints = [pb.Parameters(n=n, k=k, sigma_n0=s, rho0=r) for n, k, s, r in x.tolist()]

    def light(theta_r, phi_r, weight, sets):
        angles = {"theta_r_deg": np.rad2deg(theta_r), "phi_r_deg": np.rad2deg(phi_r)}
        return np.array(
            [pb.brdf(paints[i], 40.0, polarization="s", **angles) @ weight for i in sets]
        )

    together = port_light(x, np.ones(12), 40.0, 8.0, light)
    alone = [float(pb.dhr(p, 40.0, "s") - pb.ddr(p, 40.0, "s", port_deg=8.0)) for p in paints]
    np.testing.assert_allclose(together, alone, atol=1e-6 * 0.5)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"theta_i_deg": 90.0}, "theta_i_deg"), ({"port_deg": 0.0}, "port_deg"),
        ({"port_deg": 60.0}, "port_deg"), ({"polarization": "x"}, "polarization"),
    ],
)  # fmt: skip
def test_what_is_refused(wrong: dict[str, object], told: str) -> None:
    asked = {"theta_i_deg": 20.0, "polarization": "s", "port_deg": 5.0} | wrong
    with pytest.raises(pb.DomainError, match=told):
        pb.ddr(GREEN, **asked)  # type: ignore[arg-type]
