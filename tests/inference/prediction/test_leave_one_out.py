"""Readings left out, against dense normal laws, exact posteriors and ArviZ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.stats import gamma, norm

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.prediction.conditionals import brdf_conditionals, dhr_conditionals
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut, leave_each_out
from pbrdf_bayes.inference.prediction.residuals import white_noise_dex
from pbrdf_bayes.inference.sampling.pareto import leave_one_out, smooth_weights
from pbrdf_bayes.inference.sampling.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.simulate import simulate_measurement
from pbrdf_bayes.verdicts.applicability import find_repeatability
from pbrdf_bayes.verdicts.predictive_checks import judge_readings
from pbrdf_bayes.words import say

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
    return residual, covariance + shared * np.outer(h, h)


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


def test_a_stated_sigma_beyond_the_scatter_is_the_cause_of_narrow_residuals(
    small: Measurement,
) -> None:
    """Readings of 2 % noise that state 15 %: no scan inflates the noise of the others."""
    brdf = replace(small.brdf, u_value=0.15 * small.brdf.value)
    found, posterior = run(replace(small, brdf=brdf))
    noise = white_noise_dex(posterior, find_map(posterior, n_starts=2, seed=1).best.x)
    repeatability = find_repeatability(posterior.measurement, noise)
    verdict = next(d for d in judge_readings(found, repeatability) if d.name == "pit")
    assert set(verdict.scans) == {scan.label for scan in small.scans}
    said = say("pit.stated.advice", stated=0.15 / np.log(10.0), found=repeatability.neighbours_dex)
    assert verdict.advice == said
    without = next(d for d in judge_readings(found) if d.name == "pit")
    assert without.advice == say("pit.all_narrow.advice")
    few = replace(found, scans=(*found.scans, replace(found.scans[0], p_value=1.0)))
    verdict = next(d for d in judge_readings(few) if d.name == "pit")
    assert say("pit.narrow.advice") in verdict.advice


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


# Student-t noise ----------------------------------------------------------------------------------

DOF = 3.0


def outlying(green: pb.Parameters) -> Measurement:
    """Two scans, in each of which one reading is wrong by half."""
    m = few(green)
    value = m.brdf.value.copy()
    value[[2, 14]] *= 1.5
    return replace(m, brdf=replace(m.brdf, value=value))


def student_given_others(
    residual: Array, shared: Array, scale2: Array, i: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Ln density and distribution function of reading i, the weights of the others drawn.

    They are drawn from Gamma laws for residuals about the median, and weighed to their prior and to
    the evidence of the other readings: nothing is approximated but for the number of draws.
    """
    n = 40_000
    others = np.arange(residual.size) != i
    away2 = (residual - np.median(residual))[others] ** 2 / scale2[others]
    first = gamma(DOF / 2.0, scale=2.0 / DOF)
    taken = gamma((DOF + 1.0) / 2.0, scale=2.0 / (DOF + away2))
    weight = taken.rvs((n, residual.size - 1), random_state=rng)
    covariance = (
        shared[np.ix_(others, others)]
        + np.eye(residual.size - 1) * (scale2[others] / weight)[:, None, :]
    )
    r, c = residual[others], shared[others, i]
    solved = np.linalg.solve(covariance, np.broadcast_to(np.stack([r, c], 1), (n, r.size, 2)))
    evidence = -0.5 * (solved[:, :, 0] @ r) - 0.5 * np.linalg.slogdet(covariance)[1]
    evidence += np.sum(first.logpdf(weight) - taken.logpdf(weight), axis=1)
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    assert 1.0 / np.sum(share**2) > 1000.0
    mean, variance = solved[:, :, 0] @ c, shared[i, i] - solved[:, :, 1] @ c
    own = rng.gamma(DOF / 2.0, 2.0 / DOF, (n, 1))
    sd = np.sqrt(variance + scale2[i] / own[:, 0])
    law = norm(mean, sd)
    return float(np.log(share @ law.pdf(residual[i]))), float(share @ law.cdf(residual[i]))


@pytest.mark.parametrize("noise", ["iid", "correlated"])
def test_student_noise_of_the_others_and_of_the_reading(noise: str, green: pb.Parameters) -> None:
    """Against drawn weights: an outlier neither sways its neighbours nor is beyond belief."""
    config = pb.RunConfig(noise=noise, tails="student-t", student_dof=DOF, u_brdf_cal=0.05)
    posterior = build_posterior(outlying(green), config)
    names = posterior.parameter_names
    x = np.array([{"tau": 0.03, "ell_deg": 20.0, "u_dhr": 5e-4}.get(n, 0.02) for n in names])
    x[:4] = green.as_array()
    draws = np.tile(x, (200, 1))
    draws[:, 3] *= 1.0 + 1e-9 * np.random.default_rng(1).standard_normal(200)
    found = leave_each_out(posterior, draws, seed=1).pointwise
    residual, covariance = dense_brdf(posterior, x)
    scale2 = np.full(residual.size, 0.02**2)
    shared = covariance - np.diag(scale2)
    rng = np.random.default_rng(2)
    for i in (1, 2, 3, 8, 14, 15):
        scan = slice(9, 18) if i >= 9 else slice(0, 9)
        density, below = student_given_others(
            residual[scan], shared[scan, scan], scale2[scan], i - scan.start, rng
        )
        assert found.elpd[i] == pytest.approx(density, abs=0.2 if i in (2, 14) else 0.07)
        assert found.pit[i] == pytest.approx(below, abs=0.02)


def test_places_of_student_noise_are_uniform_in_its_own_law_only(green: pb.Parameters) -> None:
    """Four degrees of freedom; the normal law of the same scale calls it wrong."""
    m = simulate_measurement(
        green, seed=4, theta_i_deg=(20.0, 60.0), theta_r_deg=np.linspace(-80.0, 80.0, 161),
        dhr_theta_i_deg=(), relative_noise=1e-9,
    )  # fmt: skip
    noise = 0.02 * np.random.default_rng(5).standard_t(4.0, len(m.brdf))
    m = replace(m, brdf=replace(m.brdf, value=m.brdf.value * np.exp(noise)))
    spread = {}
    for tails in ("normal", "student-t"):
        posterior = build_posterior(m, pb.RunConfig(noise="iid", tails=tails, u_brdf_cal=0.02))
        draws = np.tile(np.append(green.as_array(), [0.02, 0.02]), (200, 1))
        draws[:, 3] *= 1.0 + 1e-9 * np.random.default_rng(1).standard_normal(200)
        found = leave_each_out(posterior, draws, seed=1)
        spread[tails] = found.pointwise.z[: len(m.brdf)].std()
        if tails == "student-t":
            assert min(scan.p_value for scan in found.scans) > 0.01 / len(m.scans)
    assert abs(spread["student-t"] - 1.0) < 4.0 / np.sqrt(2 * len(m.brdf))
    assert spread["normal"] > 1.2  # the variance of the law is twice its scale squared
