"""The self-reported error of the normalisation is honest over the whole domain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.model.four_parameter import digits_of
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.normalisation.plain import incidence, normalisation_integrals, workspace

HONESTY = 10.0
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)


def true_error(point: dict[str, Any], rtol: float) -> float:
    surf = surface(point["n"], point["k"], point["sigma_n0"], point["rho0"])
    theta_i = incidence(np.deg2rad(point["theta_i_deg"]))
    ours = normalisation_integrals(theta_i, surf, digits_of(rtol), workspace())
    exact = point["normalisation_integral_s"], point["normalisation_integral_p"]
    return max(abs(a / b - 1.0) for a, b in zip(ours, exact, strict=True))


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-12])
def test_true_error_is_below_ten_times_the_estimate(
    reference_points: list[dict[str, Any]], rtol: float
) -> None:
    for point in reference_points:
        p = pb.Parameters(**{name: point[name] for name in ("n", "k", "sigma_n0", "rho0")})
        estimate = float(pb.normalisation_error(p, point["theta_i_deg"], rtol))
        assert true_error(point, rtol) <= HONESTY * estimate, point


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_estimate_is_not_a_trivial_bound(
    reference_points: list[dict[str, Any]], rtol: float
) -> None:
    """Over the domain the estimate stays within a few tolerances: it says something."""
    estimates = [
        float(
            pb.normalisation_error(
                pb.Parameters(**{name: point[name] for name in ("n", "k", "sigma_n0", "rho0")}),
                point["theta_i_deg"],
                rtol,
            )
        )
        for point in reference_points
    ]
    assert max(estimates) <= HONESTY * rtol
    assert np.median(estimates) <= rtol


def test_shape_follows_the_angles() -> None:
    assert pb.normalisation_error(GREEN, [[0.0, 20.0], [60.0, 89.0]], 1e-6).shape == (2, 2)
    assert pb.normalisation_error(GREEN, 20.0).shape == ()


def test_angles_and_tolerances_outside_are_refused() -> None:
    with pytest.raises(pb.DomainError, match="theta_i_deg"):
        pb.normalisation_error(GREEN, 90.0)
    with pytest.raises(pb.DomainError, match="rtol"):
        pb.normalisation_error(GREEN, 20.0, rtol=1e-13)
