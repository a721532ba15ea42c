"""The likelihood against dense covariance matrices and scipy's normal law.

The model values come from `pb.brdf` and `pb.dhr`, tested on their own; everything else - gains,
noise, floor, censoring, pooling - is written again here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.likelihood.independent import log_normal_cdf
from pbrdf_bayes.measurement import Measurement, Scan, select_scans
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]
X = pb.Parameters(n=1.6, k=0.25, sigma_n0=0.5, rho0=0.4)
GRID = np.linspace(-75.0, 75.0, 16)
MODEL = 1e-9
"""Relative agreement asked of ln L: model values at rtol 1e-10 in both, some hundred rows."""


def evaluate(measurement: Measurement, noise: dict[str, float], **config: Any) -> float:
    """Our log-likelihood."""
    posterior = pb.build_posterior(
        measurement, pb.RunConfig(noise="iid", accuracy="reference", **config)
    )
    assert posterior.parameter_names[4:] == tuple(noise)
    x = np.concatenate([X.as_array(), list(noise.values())])
    return float(posterior.log_likelihood(x[None, :])[0])


def model_of(measurement: Measurement, scan: Scan) -> Array:
    rows = scan.rows
    return pb.brdf(
        X, scan.theta_i_deg, measurement.brdf.theta_r_deg[rows], scan.polarization,
        phi_r_deg=scan.phi_r_deg, rtol=1e-10,
    )  # fmt: skip


def dense_scan(
    measurement: Measurement, scan: Scan, s_rel: float, *, u_cal: float = 0.0, floor: float = 0.0
) -> float:
    """ln N(y; 1/2 ln(f^2 + b^2), diag + u_cal^2 h h') of the uncensored rows, ln Phi of the others."""
    readings = measurement.brdf
    value, u = readings.value[scan.rows], readings.u_value[scan.rows].copy()
    f2 = model_of(measurement, scan) ** 2
    relative2 = np.nan_to_num((u / np.maximum(value, floor)) ** 2, nan=0.0)
    pooled = readings.repeated[scan.rows] & np.isfinite(u)
    relative2[pooled] = np.mean(relative2[pooled]) if pooled.any() else 0.0
    mean = 0.5 * np.log(f2 + floor**2)
    variance = s_rel**2 + relative2 + floor**2 / (f2 + floor**2)
    low, h = value <= floor, f2 / (f2 + floor**2)
    total = 0.0
    if np.any(~low):
        covariance = np.diag(variance[~low]) + u_cal**2 * np.outer(h, h)[np.ix_(~low, ~low)]
        total += float(
            stats.multivariate_normal(mean[~low], covariance).logpdf(np.log(value[~low]))
        )
    if np.any(low):
        deviation = np.sqrt(variance[low] + u_cal**2 * h[low] ** 2)
        total += float(np.sum(stats.norm.logcdf((math.log(floor) - mean[low]) / deviation)))
    return total


def dense_dhr(measurement: Measurement, u_dhr: float | None, u_gain: float) -> float:
    """ln N(D; model, diag + u_gain^2 model model') of each polarisation."""
    dhr = measurement.dhr
    total = 0.0
    for q in "spu":
        rows = dhr.polarization == q
        if rows.any():
            model = pb.dhr(X, dhr.theta_i_deg[rows], q)
            u = np.where(np.isnan(dhr.u_value[rows]), u_dhr or 0.0, dhr.u_value[rows])
            covariance = np.diag(u**2) + u_gain**2 * np.outer(model, model)
            total += float(stats.multivariate_normal(model, covariance).logpdf(dhr.value[rows]))
    return total


def dense(measurement: Measurement, noise: dict[str, float], **options: float) -> float:
    u_gain = options.pop("u_dhr_cal", 0.01)
    total = dense_dhr(measurement, noise.get("u_dhr"), u_gain) if len(measurement.dhr) else 0.0
    return total + sum(
        dense_scan(measurement, scan, noise[f"s_rel_{scan.polarization}"], **options)
        for scan in measurement.scans
    )


NOISE = {"s_rel_s": 0.03, "s_rel_p": 0.05, "u_dhr": 0.004}


@pytest.fixture(scope="module")
def readings() -> Measurement:
    return simulate_measurement(
        pb.Parameters(n=1.55, k=0.2, sigma_n0=0.48, rho0=0.42), seed=5, theta_i_deg=(0.0, 30.0, 70.0),
        theta_r_deg=GRID, relative_noise=0.05, dhr_noise=0.004, u_brdf_cal=0.05, u_dhr_cal=0.02,
    )  # fmt: skip


@pytest.mark.parametrize("u_brdf_cal", [0.0, 0.03, 1.0])
@pytest.mark.parametrize("u_dhr_cal", [0.0, 0.01, 0.3])
def test_gains_are_marginalised_like_a_dense_covariance(
    readings: Measurement, u_brdf_cal: float, u_dhr_cal: float
) -> None:
    found = evaluate(readings, NOISE, u_brdf_cal=u_brdf_cal, u_dhr_cal=u_dhr_cal)
    wanted = dense(readings, NOISE, u_cal=u_brdf_cal, u_dhr_cal=u_dhr_cal)
    assert found == pytest.approx(wanted, rel=MODEL)


def test_relative_scale_leaves_a_free_factor_to_each_scan(readings: Measurement) -> None:
    """A gain of ln-sd 10: doubling a whole scan changes next to nothing, and it is a dense law."""
    found = evaluate(readings, NOISE, brdf_scale="relative")
    assert found == pytest.approx(dense(readings, NOISE, u_cal=10.0), rel=MODEL)
    doubled = simulate_measurement(
        pb.Parameters(n=1.55, k=0.2, sigma_n0=0.48, rho0=0.42), seed=5, theta_i_deg=(0.0, 30.0, 70.0),
        theta_r_deg=GRID, relative_noise=0.05, dhr_noise=0.004, u_brdf_cal=0.05, u_dhr_cal=0.02,
    )  # fmt: skip
    doubled.brdf.value[doubled.scans[2].rows] *= 2.0
    change = abs(evaluate(doubled, NOISE, brdf_scale="relative") - found)
    # (c + ln 2)^2/(2 10^2) - c^2/(2 10^2) with |c| < 1 or so
    assert change < (2.0 * math.log(2.0) + math.log(2.0) ** 2) / 200.0
    assert abs(evaluate(doubled, NOISE) - evaluate(readings, NOISE)) > 100.0


def test_a_scan_weighs_the_same_whatever_the_others_are(readings: Measurement) -> None:
    """ln L is a sum over scans and DHR."""
    parts = 0.0
    for i, scan in enumerate(readings.scans):
        one = select_scans(readings, np.arange(len(readings.scans)) == i, dhr=False)
        name = f"s_rel_{scan.polarization}"
        parts += evaluate(one, {name: NOISE[name]}, u_brdf_cal=0.04)
    only_dhr = select_scans(readings, np.zeros(len(readings.scans), bool), dhr=True)
    parts += evaluate(only_dhr, {"u_dhr": 0.004})
    assert evaluate(readings, NOISE, u_brdf_cal=0.04) == pytest.approx(parts, rel=1e-12)


def test_unpolarised_readings_are_the_mean_of_s_and_p() -> None:
    unpolarised = simulate_measurement(
        X, seed=6, theta_i_deg=(40.0,), theta_r_deg=GRID, polarizations=("u",), dhr_noise=0.003
    )
    s, p = (pb.brdf(X, 40.0, GRID, q, rtol=1e-10) for q in "sp")
    brdf = stats.norm(np.log(0.5 * (s + p)), 0.03).logpdf(np.log(unpolarised.brdf.value)).sum()
    angles = unpolarised.dhr.theta_i_deg
    mean = 0.5 * (pb.dhr(X, angles, "s") + pb.dhr(X, angles, "p"))
    covariance = 0.004**2 * np.eye(angles.size) + 0.01**2 * np.outer(mean, mean)
    dhr = stats.multivariate_normal(mean, covariance).logpdf(unpolarised.dhr.value)
    found = evaluate(unpolarised, {"s_rel_u": 0.03, "u_dhr": 0.004})
    assert found == pytest.approx(float(brdf + dhr), rel=MODEL)


def test_dhr_alone(make_measurement: Callable[..., Measurement]) -> None:
    rows = [("dhr", q, a, np.nan, 0.02 + 1e-4 * a) for q in "sp" for a in (10.0, 40.0, 70.0)]
    m = make_measurement(rows)
    found = evaluate(m, {"u_dhr": 0.002})
    assert found == pytest.approx(dense_dhr(m, 0.002, 0.01), rel=1e-12)
    stated = make_measurement(rows, sigma=[0.001, 0.002, 0.003] * 2)
    assert evaluate(stated, {}) == pytest.approx(dense_dhr(stated, None, 0.01), rel=1e-12)
    partly = make_measurement(rows, sigma=[0.001, np.nan, 0.003] * 2)
    found = evaluate(partly, {"u_dhr": 0.002})
    assert found == pytest.approx(dense_dhr(partly, 0.002, 0.01), rel=1e-12)


def scan_rows(values: Array, theta_i: float = 30.0, q: str = "s") -> list[Any]:
    grid = np.linspace(-70.0, 70.0, len(values))
    return [("brdf", q, theta_i, r, v) for r, v in zip(grid.tolist(), values.tolist(), strict=True)]


@pytest.fixture(scope="module")
def noisy() -> Array:
    grid = np.linspace(-70.0, 70.0, 15)
    noise = np.random.default_rng(7).standard_normal(15)
    return pb.brdf(X, 30.0, grid, "s") * np.exp(0.1 * noise)


@pytest.mark.parametrize("u_brdf_cal", [0.0, 0.05])
def test_a_stated_uncertainty_adds_its_variance(
    noisy: Array, u_brdf_cal: float, make_measurement: Callable[..., Measurement]
) -> None:
    sigma = noisy * np.linspace(0.02, 0.2, 15)
    sigma[3] = np.nan
    m = make_measurement(scan_rows(noisy), sigma=sigma)
    found = evaluate(m, {"s_rel_s": 0.03}, u_brdf_cal=u_brdf_cal)
    assert found == pytest.approx(dense_scan(m, m.scans[0], 0.03, u_cal=u_brdf_cal), rel=MODEL)


def test_scatter_of_repeated_readings_is_pooled_over_the_scan(
    noisy: Array, make_measurement: Callable[..., Measurement]
) -> None:
    """Three readings: u = sigma/sqrt(3), its relative square averaged over the rows of the scan."""
    sigma = noisy * np.random.default_rng(8).uniform(0.01, 0.2, 15)
    m = make_measurement(scan_rows(noisy), sigma=sigma, n_repeats=np.full(15, 3))
    np.testing.assert_allclose(m.brdf.u_value, sigma / math.sqrt(3.0), rtol=1e-15)
    pooled = np.mean((sigma / noisy) ** 2) / 3.0
    wanted = stats.norm(
        np.log(model_of(m, m.scans[0])), math.sqrt(0.03**2 + pooled)
    ).logpdf(np.log(noisy)).sum()  # fmt: skip
    assert evaluate(m, {"s_rel_s": 0.03}) == pytest.approx(float(wanted), rel=MODEL)
    # rows read once keep their own uncertainty beside the pooled ones
    repeats = np.where(np.arange(15) < 5, 1, 3)
    mixed = make_measurement(scan_rows(noisy), sigma=sigma, n_repeats=repeats)
    wanted = dense_scan(mixed, mixed.scans[0], 0.03)
    assert evaluate(mixed, {"s_rel_s": 0.03}) == pytest.approx(wanted, rel=MODEL)


def test_pooling_does_not_reach_into_other_scans(
    noisy: Array, make_measurement: Callable[..., Measurement]
) -> None:
    rows = scan_rows(noisy) + scan_rows(noisy, 50.0) + scan_rows(noisy, 50.0, "p")
    sigma = np.concatenate([0.02 * noisy, 0.2 * noisy, 0.1 * noisy])
    m = make_measurement(rows, sigma=sigma, n_repeats=np.repeat([3, 3, 1], 15))
    noise = {"s_rel_s": 0.03, "s_rel_p": 0.04}
    wanted = sum(dense_scan(m, scan, noise[f"s_rel_{scan.polarization}"]) for scan in m.scans)
    assert evaluate(m, noise) == pytest.approx(wanted, rel=MODEL)


@pytest.mark.parametrize("u_brdf_cal", [0.0, 0.05])
@pytest.mark.parametrize("floor", [1e-6, 1e-3, 5e-3])
def test_a_floor_bends_mean_and_variance(
    noisy: Array, floor: float, u_brdf_cal: float, make_measurement: Callable[..., Measurement]
) -> None:
    m = make_measurement(scan_rows(np.hypot(noisy, 1.5 * floor)))
    assert np.all(m.brdf.value > floor)
    found = evaluate(m, {"s_rel_s": 0.03}, brdf_floor=floor, u_brdf_cal=u_brdf_cal)
    wanted = dense_scan(m, m.scans[0], 0.03, u_cal=u_brdf_cal, floor=floor)
    assert found == pytest.approx(wanted, rel=MODEL)


def test_a_tiny_floor_is_no_floor(
    noisy: Array, make_measurement: Callable[..., Measurement]
) -> None:
    m = make_measurement(scan_rows(noisy))
    without, tiny = (evaluate(m, {"s_rel_s": 0.03}, brdf_floor=b) for b in (0.0, 1e-12))
    assert tiny == pytest.approx(without, rel=1e-12)


@pytest.mark.parametrize("replacement", [1e-3, 1e-9, 0.0, -2e-4])
def test_readings_at_or_below_the_floor_are_censored(
    noisy: Array, replacement: float, make_measurement: Callable[..., Measurement]
) -> None:
    """They contribute ln Phi, whatever their value; the rest is as before."""
    floor = 1e-3
    values = noisy.copy()
    values[[0, 1, 14]] = replacement
    m = make_measurement(scan_rows(values))
    found = evaluate(m, {"s_rel_s": 0.03}, brdf_floor=floor)
    assert found == pytest.approx(dense_scan(m, m.scans[0], 0.03, floor=floor), rel=MODEL)


def test_a_scan_of_censored_readings_only(make_measurement: Callable[..., Measurement]) -> None:
    m = make_measurement(scan_rows(np.full(15, 1e-4)))
    found = evaluate(m, {"s_rel_s": 0.03}, brdf_floor=1e-3)
    assert found == pytest.approx(dense_scan(m, m.scans[0], 0.03, floor=1e-3), rel=MODEL)


@pytest.mark.parametrize("u_brdf_cal", [0.05, 0.3])
def test_censored_readings_know_the_gain_of_their_scan(
    noisy: Array, u_brdf_cal: float, make_measurement: Callable[..., Measurement]
) -> None:
    """The gain integrated by quadrature over censored and other rows together.

    Asked: a thousandth of a nat for each censored row, far below what moves a posterior.
    """
    floor, s_rel = 3e-3, 0.03
    m = make_measurement(scan_rows(noisy))
    low = m.brdf.value <= floor
    assert 2 <= low.sum() <= 8
    f2 = model_of(m, m.scans[0]) ** 2
    mean = 0.5 * np.log(f2 + floor**2)
    sd = np.sqrt(s_rel**2 + floor**2 / (f2 + floor**2))
    y, h = np.log(np.maximum(m.brdf.value, 1e-300)), f2 / (f2 + floor**2)

    def log_integrand(c: float) -> float:
        terms = stats.norm.logpdf(y[~low], mean[~low] + h[~low] * c, sd[~low]).sum()
        terms += stats.norm.logcdf((math.log(floor) - mean[low] - h[low] * c) / sd[low]).sum()
        return float(terms + stats.norm.logpdf(c, 0.0, u_brdf_cal))

    grid = np.linspace(-6.0 * u_brdf_cal, 6.0 * u_brdf_cal, 20_001)
    values = np.array([log_integrand(c) for c in grid[::20]])
    peak = values.max()
    total = integrate.simpson(np.exp(values - peak), x=grid[::20])
    wanted = peak + math.log(total)
    found = evaluate(m, {"s_rel_s": s_rel}, brdf_floor=floor, u_brdf_cal=u_brdf_cal)
    assert found == pytest.approx(wanted, abs=1e-3 * low.sum())


def test_one_row_per_scan(make_measurement: Callable[..., Measurement]) -> None:
    """A gain of its own for every row adds u_cal^2 to its variance."""
    rows = [("brdf", "s", a, 10.0, 0.01 + 1e-4 * a) for a in (0.0, 15.0, 30.0, 45.0)]
    m = make_measurement(rows)
    assert [len(scan) for scan in m.scans] == [1, 1, 1, 1]
    model = np.array([float(pb.brdf(X, a, 10.0, "s", rtol=1e-10)) for _, _, a, _, _ in rows])
    values = np.log([v for *_, v in rows])
    wanted = stats.norm(np.log(model), math.hypot(0.03, 0.07)).logpdf(values).sum()
    found = evaluate(m, {"s_rel_s": 0.03}, u_brdf_cal=0.07)
    assert found == pytest.approx(float(wanted), rel=MODEL)


def test_readings_out_of_plane(make_measurement: Callable[..., Measurement]) -> None:
    """Azimuth 90 deg is the plane across; rows of one scan share it."""
    grid = np.linspace(-60.0, 60.0, 9)
    rows = [("brdf", "p", 20.0, r, 0.01) for r in grid]
    m = make_measurement(rows, phi_r_deg=np.full(9, 90.0))
    model = pb.brdf(X, 20.0, grid, "p", phi_r_deg=90.0, rtol=1e-10)
    wanted = stats.norm(np.log(model), 0.03).logpdf(math.log(0.01)).sum()
    assert evaluate(m, {"s_rel_p": 0.03}) == pytest.approx(float(wanted), rel=MODEL)


def test_an_exact_null_of_the_model_stays_finite(
    make_measurement: Callable[..., Measurement],
) -> None:
    """sigma_n0 = 0: f = 0 at every row. With a floor the law is N(ln b, s^2 + 1) exactly."""
    m = make_measurement(scan_rows(np.full(15, 2e-3)))
    posterior = pb.build_posterior(m, pb.RunConfig(noise="iid", brdf_floor=1e-3))
    x = np.array([[1.5, 0.1, 0.0, 0.3, 0.03]])
    wanted = 15.0 * stats.norm(math.log(1e-3), math.hypot(0.03, 1.0)).logpdf(math.log(2e-3))
    assert posterior.log_likelihood(x)[0] == pytest.approx(wanted, rel=1e-9)
    without = pb.build_posterior(m, pb.RunConfig(noise="iid")).log_likelihood(x)[0]
    assert np.isfinite(without)
    assert without < -1e6


def test_the_log_of_the_normal_cdf_over_its_range() -> None:
    """Against 40 digits, across the switch to the asymptotic series at z = -20."""
    mp = mpmath.MPContext()
    mp.dps = 40
    points = np.concatenate([np.linspace(-40.0, 8.0, 97), [-20.0, -20.0001, -19.9999, -1e3, -1e8]])
    for z in points.tolist():
        wanted = mp.log(mp.erfc(-mp.mpf(z) / mp.sqrt(2)) / 2)
        # the series drops 945/z^10 < 1e-10; above it erfc is good to some eps of its value
        assert log_normal_cdf(z) == pytest.approx(float(wanted), rel=1e-12, abs=1e-10)


def test_doubling_every_reading_and_sigma_n0_changes_nothing(readings: Measurement) -> None:
    """Scale: BRDF and DHR are proportional to sigma_n0 and noises are relative (DHR: absolute)."""
    brdf_only = select_scans(readings, np.ones(len(readings.scans), bool), dhr=False)
    posterior = pb.build_posterior(brdf_only, pb.RunConfig(noise="iid"))
    x = np.array([[1.6, 0.25, 0.3, 0.4, 0.03, 0.05], [1.6, 0.25, 0.6, 0.4, 0.03, 0.05]])
    before = posterior.log_likelihood(x)
    brdf_only.brdf.value[:] *= 2.0
    after = pb.build_posterior(brdf_only, pb.RunConfig(noise="iid")).log_likelihood(x)
    assert after[1] == pytest.approx(before[0], rel=1e-12)
    brdf_only.brdf.value[:] /= 2.0


def test_a_row_at_a_time_or_all_sets_at_once(readings: Measurement) -> None:
    """Scratch memory shared between parameter sets leaks nothing from one to the next."""
    posterior = pb.build_posterior(readings, pb.RunConfig(noise="iid", u_brdf_cal=0.02))
    x = posterior.sample_prior(np.random.default_rng(9), 40)
    together = posterior.log_likelihood(x)
    alone = np.array([posterior.log_likelihood(row[None, :])[0] for row in x])
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(posterior.log_likelihood(x[::-1]), together[::-1])
