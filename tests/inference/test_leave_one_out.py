"""Readings left out, against dense normal laws, exact posteriors and ArviZ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.stats import norm

import pbrdf_bayes as pb
from pbrdf_bayes.inference.conditionals import brdf_conditionals, dhr_conditionals
from pbrdf_bayes.inference.laplace import laplace_mixture
from pbrdf_bayes.inference.leave_one_out import LeaveOneOut, leave_each_out
from pbrdf_bayes.inference.map_fit import find_map
from pbrdf_bayes.inference.pareto import leave_one_out, smooth_weights
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.predictive_checks import judge_readings
from pbrdf_bayes.inference.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.simulate import simulate_measurement

Array = NDArray[np.float64]
THETA_R = np.linspace(-60.0, 60.0, 9)


def few(green: pb.Parameters, **choices: Any) -> Measurement:
    return simulate_measurement(
        green, seed=4, theta_i_deg=(20.0, 60.0), theta_r_deg=THETA_R, dhr_theta_i_deg=(20.0, 50.0, 70.0),
        **choices,
    )  # fmt: skip


def dense_brdf(posterior: Posterior, x: Array) -> tuple[Array, Array]:
    """Residuals of ln BRDF and their covariance, row by row from the laws in the docstrings."""
    m, config = posterior.measurement, posterior.config
    value = dict(zip(posterior.parameter_names, x.tolist(), strict=True))
    f = posterior.predict(x[None, :])[0][0]
    b2 = config.brdf_floor**2
    residual = np.log(m.brdf.value) - 0.5 * np.log(f**2 + b2)
    scan = np.repeat(np.arange(len(m.scans)), [len(s) for s in m.scans])
    noise = np.array([value[f"s_rel_{q}"] for q in m.brdf.polarization.tolist()])
    stated = np.nan_to_num(m.brdf.u_value / m.brdf.value)
    covariance = np.diag(noise**2 + stated**2 + b2 / (f**2 + b2))
    shared = config.u_brdf_cal**2 * (scan[:, None] == scan)
    if "tau" in value:  # the scans here are one to a geometry
        away = np.abs(m.brdf.theta_r_deg[:, None] - m.brdf.theta_r_deg) * 3**0.5 / value["ell_deg"]
        shared += value["tau"] ** 2 * (1 + away) * np.exp(-away) * (scan[:, None] == scan)
        h = f**2 / (f**2 + b2)  # what a factor on f does beside the floor
        shared *= np.outer(h, h)
    return residual, covariance + shared


def given_others(residual: Array, covariance: Array) -> tuple[Array, Array]:
    """Error and variance of each reading from a law without it: one solution for each."""
    error, variance = np.empty(residual.size), np.empty(residual.size)
    for i in range(residual.size):
        others = np.arange(residual.size) != i
        gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, i])
        error[i] = residual[i] - gain @ residual[others]
        variance[i] = covariance[i, i] - gain @ covariance[others, i]
    return error, variance


@pytest.mark.parametrize("noise", ["iid", "correlated"])
@pytest.mark.parametrize(
    "choices", [{}, {"u_brdf_cal": 0.05}, {"u_brdf_cal": 0.05, "brdf_floor": 1e-4}]
)
def test_conditionals_are_those_of_the_dense_law(
    noise: str, choices: dict[str, float], green: pb.Parameters
) -> None:
    m = few(green)
    stated = replace(m.brdf, u_value=0.03 * m.brdf.value)
    posterior = build_posterior(replace(m, brdf=stated), pb.RunConfig(noise=noise, **choices))
    draws = posterior.sample_prior(np.random.default_rng(1), 3)
    draws[:, :4] = green.as_array()
    found = brdf_conditionals(posterior, draws, posterior.predict(draws)[0])
    for i, x in enumerate(draws):
        error, variance = given_others(*dense_brdf(posterior, x))
        np.testing.assert_allclose(found.variance[i], variance, rtol=1e-7)
        np.testing.assert_allclose(found.error[i], error, rtol=1e-6, atol=1e-9)


def test_dhr_readings_share_a_gain_that_multiplies(green: pb.Parameters) -> None:
    posterior = build_posterior(few(green), pb.RunConfig(u_dhr_cal=0.02))
    draws = posterior.sample_prior(np.random.default_rng(2), 2)
    draws[:, :4] = green.as_array()
    _, dhr = posterior.predict(draws)
    found = dhr_conditionals(posterior, draws, dhr)
    of = posterior.measurement.dhr.polarization
    for i, x in enumerate(draws):
        for q in "sp":
            model = dhr[i][of == q]
            noise = x[posterior.parameter_names.index("u_dhr")]
            covariance = noise**2 * np.eye(model.size) + 0.02**2 * np.outer(model, model)
            error, variance = given_others(posterior.rows.dhr[of == q] - model, covariance)
            np.testing.assert_allclose(found.error[i][of == q], error, rtol=1e-9)
            np.testing.assert_allclose(found.variance[i][of == q], variance, rtol=1e-9)


def test_censored_readings_have_the_probability_of_the_floor(green: pb.Parameters) -> None:
    """Without a gain nothing is shared: ln P(reading < floor) averaged over nearly equal draws."""
    m = few(green)
    values = m.brdf.value.copy()
    values[:2] = 0.0
    posterior = build_posterior(
        replace(m, brdf=replace(m.brdf, value=values)), pb.RunConfig(noise="iid", brdf_floor=2e-3)
    )
    one = np.append(green.as_array(), [0.02, 0.02, 0.0005])
    draws = np.tile(one, (300, 1)) * (
        1.0 + 1e-7 * np.random.default_rng(1).standard_normal((300, 7))
    )
    found = leave_each_out(posterior, draws, seed=1)
    f = posterior.predict(one[None, :])[0][0][:2]
    mean = 0.5 * np.log(f**2 + 2e-3**2)
    sd = np.sqrt(0.02**2 + 2e-3**2 / (f**2 + 2e-3**2))
    wanted = norm.logcdf((np.log(2e-3) - mean) / sd)
    np.testing.assert_allclose(found.pointwise.elpd[:2], wanted, rtol=1e-4)
    assert np.isnan(found.pointwise.z[:2]).all(), "in the floor there is no PIT"


@pytest.mark.parametrize("n_draws", [150, 600])
def test_weights_are_those_of_arviz(n_draws: int) -> None:
    rng = np.random.default_rng(1)
    rows = [rng.normal(0.0, spread, (6, n_draws)) for spread in (1e-3, 0.3, 1.0, 5.0)]
    log_weights = np.concatenate([*rows, rng.standard_t(3, (6, n_draws))])
    smoothed, k_hat = smooth_weights(log_weights)
    wanted, wanted_k = array_stats.psislw(-log_weights)
    np.testing.assert_allclose(smoothed, wanted, atol=1e-12)
    np.testing.assert_allclose(k_hat, wanted_k, atol=1e-12)
    elpd, _, p_loo, _ = leave_one_out(-log_weights)
    theirs, _, p_theirs = array_stats.loo(-log_weights, chain_axis=None, draw_axis=-1)
    np.testing.assert_allclose(elpd, theirs, rtol=1e-10)
    np.testing.assert_allclose(p_loo, p_theirs, rtol=1e-8, atol=1e-10)


def test_elpd_of_a_normal_mean_is_the_exact_one() -> None:
    """y ~ N(mu, 1), flat prior: y_i given the others is N(mean of the others, 1 + 1/(n - 1))."""
    rng = np.random.default_rng(3)
    n = 40
    y = rng.standard_normal(n)
    mu = y.mean() + rng.standard_normal(20_000) / n**0.5
    elpd, _, p_loo, _ = leave_one_out(norm.logpdf(y[:, None], mu[None, :]))
    others = (y.sum() - y) / (n - 1)
    np.testing.assert_allclose(elpd, norm.logpdf(y, others, (1 + 1 / (n - 1)) ** 0.5), atol=0.01)
    assert p_loo.sum() == pytest.approx(np.mean((y - y.mean()) ** 2), rel=0.15)  # of 1 parameter


def run(m: Measurement, **choices: Any) -> tuple[LeaveOneOut, Posterior]:
    config = pb.RunConfig(accuracy="draft", threads=1, **choices)
    posterior = build_posterior(m, config)
    optima = find_map(posterior, n_starts=4, seed=1)
    draws = sample_posterior(
        posterior, laplace_mixture(posterior, optima), config, method="psis", seed=1
    )
    return leave_each_out(posterior, draws.flat, seed=1), posterior


def scaled(m: Measurement, rows: Any, factor: float) -> Measurement:
    value = m.brdf.value.copy()
    value[rows] *= factor
    return replace(m, brdf=replace(m.brdf, value=value))


@pytest.mark.parametrize("noise", ["iid", "correlated"])
def test_of_true_data_the_places_are_uniform(noise: str, small: Measurement) -> None:
    """p_loo near the seven parameters; four scans, each uniform at the level of one in a thousand."""
    found, posterior = run(small, noise=noise)
    assert 3.0 < found.p_loo < posterior.n_par + 2.0
    assert found.n_readings == len(small.brdf) + len(small.dhr)
    assert all(s.p_value > 1e-3 for s in found.scans)
    z = found.pointwise.z
    assert z.std() == pytest.approx(1.0, abs=4.0 / (2 * z.size) ** 0.5)
    assert {d.verdict for d in judge_readings(found)} == {"PASS"}


def test_an_outlier_is_named(small: Measurement) -> None:
    found, _ = run(scaled(small, 40, 1.5))
    verdicts = {d.name: d for d in judge_readings(found)}
    assert verdicts["outliers"].verdict == "WARN"
    angle = f"{small.brdf.theta_r_deg[40]:g} deg"
    assert angle in verdicts["outliers"].statement
    assert found.n_influential >= 1
    assert found.farthest[0].z > 5.0


def test_a_scan_off_its_level_is_named(small: Measurement) -> None:
    """A third of the readings 10 % high; the noise of 2 % becomes that of the polarisation."""
    found, _ = run(scaled(small, small.scans[2].rows, 1.1), noise="iid")
    verdict = next(d for d in judge_readings(found) if d.name == "pit")
    assert verdict.verdict == "WARN"
    assert "s 60 deg" in verdict.statement or "s 20 deg" in verdict.statement
    assert "residuals" in verdict.statement


def test_without_scans_only_dhr_is_scored(make_measurement: Callable[..., Measurement]) -> None:
    rng = np.random.default_rng(1)
    rows = [
        ("dhr", q, a, np.nan, float(v + 0.0005 * rng.standard_normal()))
        for q in "sp"
        for a, v in zip(
            range(10, 90, 10), pb.dhr(pb.Parameters(n=1.5, k=0.2, sigma_n0=0.5, rho0=0.5), range(10, 90, 10), q),
            strict=True,
        )
    ]  # fmt: skip
    found, _ = run(make_measurement(rows))
    assert found.scans == ()
    assert [d.name for d in judge_readings(found)] == ["loo", "outliers"]
