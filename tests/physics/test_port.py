"""Light inside a specular port: areas in closed form, and an independent adaptive integration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import pbrdf_bayes as pb
from pbrdf_bayes.physics.port import port_nodes


@pytest.mark.parametrize(
    ("theta_i", "half_angle"), [(0.0, 5.0), (20.0, 10.0), (60.0, 20.0), (80.0, 5.0), (45.0, 45.0)]
)
def test_area_of_the_port(theta_i: float, half_angle: float) -> None:
    """A cone above the horizon has the projected solid angle pi sin^2(psi) cos(theta)."""
    *_, weight = port_nodes(np.deg2rad(theta_i), np.deg2rad(half_angle), 0.1)
    area = np.pi * np.sin(np.deg2rad(half_angle)) ** 2 * np.cos(np.deg2rad(theta_i))
    assert weight.sum() == pytest.approx(area, rel=1e-13)


def test_area_of_a_port_at_the_horizon() -> None:
    """Against sampling of the disk on a fine grid."""
    *_, weight = port_nodes(np.deg2rad(85.0), np.deg2rad(10.0), 0.1)
    alpha = (np.arange(40_000) + 0.5) / 40_000
    least = np.cos(np.deg2rad(10.0)) - alpha * np.sin(np.deg2rad(85.0))
    gamma = np.maximum(least / np.cos(np.deg2rad(85.0)), 0.0)
    area = 2.0 * np.sqrt(np.maximum(1.0 - alpha**2 - gamma**2, 0.0)).mean()
    assert weight.sum() == pytest.approx(area, rel=1e-5)


def adaptive(p: pb.Parameters, theta_i: float, half_angle: float, q: str) -> float:
    """Nested adaptive quadrature over alpha = mid + half sin(t) and beta in geometric panels."""
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
        return float(2.0 * pb.brdf(p, theta_i, theta_r, q, phi_r_deg=phi_r, rtol=1e-10) @ w)

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


@pytest.mark.parametrize(
    ("rho0", "theta_i", "half_angle", "tolerance"),
    [
        (0.47, 8.0, 5.0, 1e-10), (0.47, 85.0, 10.0, 1e-9), (0.05, 60.0, 20.0, 1e-9),
        (2.0, 30.0, 2.0, 1e-10), (0.005, 60.0, 20.0, 1e-7), (0.001, 60.0, 20.0, 2e-6),
        (0.001, 30.0, 2.0, 1e-6),
    ],
)  # fmt: skip
@pytest.mark.parametrize("q", ["s", "p"])
def test_light_inside_the_port(
    rho0: float, theta_i: float, half_angle: float, tolerance: float, q: str
) -> None:
    p = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=rho0)
    theta_r, phi_r, weight = port_nodes(np.deg2rad(theta_i), np.deg2rad(half_angle), 0.1 * rho0)
    values = pb.brdf(
        p, theta_i, np.rad2deg(theta_r), q, phi_r_deg=np.rad2deg(phi_r), rtol=1e-10
    )  # fmt: skip
    error = values @ weight - adaptive(p, theta_i, half_angle, q)
    assert abs(error) < tolerance * float(pb.dhr(p, theta_i, q))
