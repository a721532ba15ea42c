"""Residual statistics on series whose numbers are known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.residuals import (
    compute_residuals,
    effective_share,
    white_noise_dex,
)
from pbrdf_bayes.measurement import Measurement, measurement_from_columns

Array = NDArray[np.float64]
LN10 = math.log(10.0)


def with_residuals(green: pb.Parameters, dex: dict[float, Array], **config: float) -> Posterior:
    """Scans at the angles of incidence whose log10(measured/model) at the truth is given."""
    theta_i, theta_r, value = [], [], []
    for angle, residual in dex.items():
        grid = np.linspace(-70.0, 70.0, residual.size)
        value.append(pb.brdf(green, angle, grid, "s", rtol=1e-10) * 10.0**residual)
        theta_i.append(np.full(residual.size, angle))
        theta_r.append(grid)
    n = sum(r.size for r in dex.values())
    measurement = measurement_from_columns(
        sample="made up", wavelength_um=1.0, quantity=["brdf"] * n, polarization=["s"] * n,
        theta_i_deg=np.concatenate(theta_i), theta_r_deg=np.concatenate(theta_r),
        value=np.concatenate(value),
    )  # fmt: skip
    return pb.build_posterior(
        measurement, pb.RunConfig(noise="iid", accuracy="reference", **config)
    )  # type: ignore[arg-type]


def at(green: pb.Parameters) -> Array:
    return np.append(green.as_array(), 0.02)


def test_residuals_are_log10_of_measured_over_model(green: pb.Parameters) -> None:
    rng = np.random.default_rng(1)
    given = {20.0: rng.normal(0.0, 0.02, 25), 50.0: rng.normal(0.01, 0.05, 40)}
    found = compute_residuals(with_residuals(green, given), at(green))
    everything = np.concatenate(list(given.values()))
    np.testing.assert_allclose(found.dex, everything, atol=1e-9)
    assert found.rms == pytest.approx(math.sqrt(np.mean(everything**2)), rel=1e-7)
    for i, r in enumerate(given.values()):
        assert found.scan_rms[i] == pytest.approx(math.sqrt(np.mean(r**2)), rel=1e-7)
        assert found.scan_bias[i] == pytest.approx(r.mean(), rel=1e-6)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, -0.5])
def test_lag_one_correlation_of_an_autoregression(phi: float, green: pb.Parameters) -> None:
    """Estimated from 4000 values: error sqrt((1 - phi^2)/4000), five of them allowed."""
    rng = np.random.default_rng(2)
    white = rng.normal(0.0, 0.02, 4000)
    series = np.empty(4000)
    series[0] = white[0] / math.sqrt(1.0 - phi**2)
    for i in range(1, 4000):
        series[i] = phi * series[i - 1] + white[i]
    found = compute_residuals(with_residuals(green, {20.0: series}), at(green))
    error = math.sqrt((1.0 - phi**2) / 4000)
    assert abs(found.lag1 - phi) < 5.0 * error
    assert found.scan_lag1[0] == pytest.approx(found.lag1, rel=1e-12)


def test_correlation_does_not_run_across_scans(green: pb.Parameters) -> None:
    """Scans of constant residuals +a and -a: fully correlated within each, pooled 1."""
    given = {20.0: np.full(30, 0.05), 50.0: np.full(30, -0.05)}
    found = compute_residuals(with_residuals(green, given), at(green))
    assert found.lag1 == pytest.approx(1.0, rel=1e-6)
    np.testing.assert_allclose(found.scan_bias, [0.05, -0.05], rtol=1e-6)


def test_alternating_residuals_have_correlation_minus_one(green: pb.Parameters) -> None:
    found = compute_residuals(
        with_residuals(green, {20.0: 0.05 * (-1.0) ** np.arange(31)}), at(green)
    )
    assert found.lag1 == pytest.approx(-1.0, rel=1e-6)


def test_white_noise_is_found_under_a_smooth_misfit(green: pb.Parameters) -> None:
    """Second differences cancel the curve and the misfit: 321 values give 6 % error."""
    rng = np.random.default_rng(3)
    smooth = 0.2 * np.sin(np.linspace(0.0, 6.0, 321))
    noise = 0.01
    given = {a: smooth + rng.normal(0.0, noise, 321) for a in (20.0, 40.0, 60.0)}
    assert white_noise_dex(with_residuals(green, given), at(green)) == pytest.approx(
        noise, rel=0.15
    )


@pytest.mark.parametrize("rho0", [0.01, 0.02, 0.1, 0.47])
def test_the_curvature_of_a_narrow_peak_is_no_noise(rho0: float) -> None:
    """Steps of 1 deg over a lobe of 0.6 deg; a smooth misfit of 12 % beside the noise."""
    paint = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=rho0)
    rng = np.random.default_rng(5)
    smooth = 0.05 * np.sin(np.linspace(0.0, 6.0, 141))
    given = {a: smooth + rng.normal(0.0, 0.0087, 141) for a in (20.0, 40.0, 60.0)}
    found = white_noise_dex(with_residuals(paint, given), at(paint))
    assert found == pytest.approx(0.0087, rel=0.15)


def test_a_model_that_is_off_adds_no_noise(green: pb.Parameters) -> None:
    """Residuals about a peak that is not there are bent more than the readings."""
    rng = np.random.default_rng(6)
    given = {a: rng.normal(0.0, 0.0087, 141) for a in (20.0, 40.0, 60.0)}
    sharp = np.append(pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.01).as_array(), 0.02)
    found = white_noise_dex(with_residuals(green, given), sharp)
    assert found == pytest.approx(0.0087, rel=0.15)


def test_white_noise_is_the_median_over_scans(green: pb.Parameters) -> None:
    rng = np.random.default_rng(4)
    given = {a: rng.normal(0.0, s, 2000) for a, s in ((20.0, 0.01), (40.0, 0.02), (60.0, 0.3))}
    assert white_noise_dex(with_residuals(green, given), at(green)) == pytest.approx(0.02, rel=0.1)


def test_short_scans_tell_nothing_about_noise(
    green: pb.Parameters, make_measurement: Callable[..., Measurement]
) -> None:
    assert math.isnan(white_noise_dex(with_residuals(green, {20.0: np.zeros(4)}), at(green)))
    dhr = make_measurement([("dhr", "s", 20.0, math.nan, 0.05)])
    posterior = pb.build_posterior(dhr, pb.RunConfig(noise="iid"))
    assert math.isnan(white_noise_dex(posterior, at(green)))
    found = compute_residuals(posterior, at(green))
    assert math.isnan(found.rms)
    assert math.isnan(found.lag1)
    assert found.dex.size == 0


def test_censored_readings_have_no_residual(green: pb.Parameters) -> None:
    given = np.zeros(31)
    given[[3, 4, 20]] = -3.0
    posterior = with_residuals(green, {20.0: given}, brdf_floor=1e-4)
    found = compute_residuals(posterior, at(green))
    assert np.flatnonzero(np.isnan(found.dex)).tolist() == [3, 4, 20]
    assert found.rms == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(
    ("lag1", "share"),
    [(0.0, 1.0), (-0.3, 1.0), (math.nan, 1.0), (0.5, 1.0 / 3.0), (0.9, 1.0 / 19.0), (1.0, 1e-3), (1.01, 1e-3)],
)  # fmt: skip
def test_effective_share_is_that_of_an_autoregression(lag1: float, share: float) -> None:
    """var(mean) of an AR(1) series is larger by (1 + phi)/(1 - phi)."""
    assert effective_share(lag1) == pytest.approx(share, rel=1e-12)
