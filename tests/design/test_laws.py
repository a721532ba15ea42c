"""Laws of readings that could be taken: repeats, gains, additivity, against dense algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_prior, beliefs_of_run, draw_sets
from pbrdf_bayes.design.candidates import Candidate, list_candidates, usual_scan, was_measured
from pbrdf_bayes.design.evaluate import Stage, nested_estimate, set_stage, told_by
from pbrdf_bayes.design.hemispherical import (
    draw_hemispherical,
    gain_law,
    hemispherical_log_likelihoods,
    hemispherical_values,
)
from pbrdf_bayes.design.linear import linear_law
from pbrdf_bayes.design.run import DesignChoices, design_measurements
from pbrdf_bayes.design.scans import draw_scans, law_of_rows, plan_scan, scan_log_likelihoods
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

SCAN = tuple(float(a) for a in range(-60, 61, 10))
CENTRE = {
    "n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47, "s_rel_s": 0.02, "s_rel_p": 0.03,
    "tau": 0.05, "ell_deg": 25.0, "u_dhr": 0.0006,
}  # fmt: skip


def posterior_of(**choices: object) -> Posterior:
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0, 60.0), theta_r_deg=np.arange(-60.0, 61.0, 5.0),
        dhr_theta_i_deg=(10.0, 50.0),
    )  # fmt: skip
    config = pb.RunConfig(u_brdf_cal=0.03, accuracy="draft", **choices)  # type: ignore[arg-type]
    return build_posterior(m, config)


def beliefs(n: int = 400, spread: float = 0.03, **choices: object) -> Beliefs:
    """Draws about known values: any law of draws will do for laws of readings."""
    posterior = posterior_of(**choices)
    centre = np.array([CENTRE[name] for name in posterior.parameter_names])
    noise = np.random.default_rng(2).standard_normal((n, centre.size))
    return beliefs_of_run(posterior, centre * np.exp(spread * noise))


def scan_of(q: str, theta_i: float, scan: tuple[float, ...] = SCAN) -> Candidate:
    return Candidate("brdf", q, theta_i, 10.0, theta_r_deg=scan)


def joint_covariance(b: Beliefs, planned, sets, i: int) -> np.ndarray:
    """From the formula of `readings.observation`."""
    f2 = b.posterior.predict(sets.x[i : i + 1], planned.geometry)[0][0] ** 2
    h = f2 / (f2 + b.posterior.config.brdf_floor**2)
    gap = np.abs(planned.theta_r_deg[:, None] - planned.theta_r_deg)
    a = np.sqrt(3.0) * gap / sets.ell_deg[i]
    same = planned.scan[:, None] == planned.scan
    common = sets.tau[i] ** 2 * (1.0 + a) * np.exp(-a) + b.posterior.rows.u_cal2 * same
    return common * np.outer(h, h) + np.diag(sets.variance[planned.polarization][i] + 1.0 - h)


@pytest.mark.parametrize(
    ("theta_i", "floor"), [(20.0, 0.0), (20.6, 0.0), (40.0, 0.0), (20.0, 2e-3), (40.0, 2e-3)]
)
def test_law_of_a_scan_given_what_was_measured_there(theta_i: float, floor: float) -> None:
    """Dense conditional normal densities; at 40 deg nothing was measured, 20.6 repeats 20."""
    b = beliefs(brdf_floor=floor)
    candidate = scan_of("p", theta_i)
    planned = plan_scan(b, candidate, np.ones(len(SCAN), dtype=bool))
    assert planned.new.all() == (theta_i == 40.0)
    sets = draw_sets(b, b.x[:4], np.random.default_rng(3))
    law = law_of_rows(b, planned, sets, b.posterior.predict(sets.x, planned.geometry)[0])
    y = draw_scans(b, planned, law, seed=4)
    found = scan_log_likelihoods(b, planned, y, law, matched=False)
    new, old = planned.new, ~planned.new
    paint = pb.Parameters(**dict(zip(PHYSICAL, sets.x[0, :4].tolist(), strict=True)))
    for rows, angle in ((new, theta_i), (old, 20.0)):
        at = pb.brdf(paint, angle, planned.theta_r_deg[rows], "p")
        np.testing.assert_allclose(law.mean[0, rows], np.log(np.hypot(at, floor)), atol=1e-4)
    for i in range(4):
        for m in range(4):
            k, mean = joint_covariance(b, planned, sets, m), law.mean[m]
            gain = np.linalg.solve(k[np.ix_(old, old)], k[np.ix_(old, new)]).T
            centre = mean[new] + gain @ (planned.y[old] - mean[old])
            rest = k[np.ix_(new, new)] - gain @ k[np.ix_(old, new)]
            wanted = multivariate_normal.logpdf(y[new, i], centre, rest)
            assert found[i, m] == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize(("theta_i", "floor"), [(20.0, 0.0), (40.0, 0.0), (20.0, 2e-3)])
def test_drawn_scans_have_their_law(theta_i: float, floor: float) -> None:
    """Squared Mahalanobis distances of draws from one set are chi-squared."""
    b = beliefs(brdf_floor=floor)
    planned = plan_scan(b, scan_of("s", theta_i), np.ones(len(SCAN), dtype=bool))
    sets = draw_sets(b, np.repeat(b.x[:1], 1500, axis=0), np.random.default_rng(5))
    law = law_of_rows(b, planned, sets, b.posterior.predict(sets.x, planned.geometry)[0])
    y = draw_scans(b, planned, law, seed=6)
    new, old = planned.new, ~planned.new
    k = joint_covariance(b, planned, sets, 0)
    gain = np.linalg.solve(k[np.ix_(old, old)], k[np.ix_(old, new)]).T
    centre = law.mean[0][new] + gain @ (planned.y[old] - law.mean[0][old])
    rest = k[np.ix_(new, new)] - gain @ k[np.ix_(old, new)]
    white = np.linalg.solve(np.linalg.cholesky(rest), y[new] - centre[:, None])
    assert np.abs(white.mean(axis=1)).max() < 4.5 / np.sqrt(1500)
    assert np.abs(np.cov(white) - np.eye(len(SCAN))).max() < 0.15
    np.testing.assert_array_equal(y[old], np.repeat(planned.y[old][:, None], 1500, axis=1))


def test_readings_that_share_a_gain() -> None:
    """Two hemispherical readings after those taken: the dense conditional law."""
    b = beliefs()
    sets = draw_sets(b, b.x[:5], np.random.default_rng(7))
    two = [Candidate("dhr", "s", 70.0, 3.0), Candidate("ddr", "s", 20.0, 3.0, port_deg=8.0)]
    values = [hemispherical_values(b.posterior, c, sets.x) for c in two]
    gain = gain_law(b, "s", sets)
    y = [draw_hemispherical(v, gain, sets, seed=(8, i)) for i, v in enumerate(values)]
    found = hemispherical_log_likelihoods(y, values, gain, sets, matched=False)
    m, rows = b.posterior.measurement, b.posterior.rows
    here = np.flatnonzero(m.dhr.polarization == "s")
    for j in range(5):
        old = b.posterior.predict(sets.x[j : j + 1])[1][0, here]
        d = np.array([*old, *(v[j] for v in values)])
        k = rows.dhr_cal2 * np.outer(d, d) + sets.dhr_variance[j] * np.eye(d.size)
        n = len(here)
        weight = np.linalg.solve(k[:n, :n], k[:n, n:]).T
        centre = d[n:] + weight @ (rows.dhr[here] - old)
        rest = k[n:, n:] - weight @ k[:n, n:]
        for i in range(5):
            wanted = multivariate_normal.logpdf([y[0][i], y[1][i]], centre, rest)
            assert found[i, j] == pytest.approx(wanted, rel=1e-8)


def stage_of(b: Beliefs, **sizes: int) -> Stage:
    numbers = {"n_outer": 100, "n_inner": 250, "n_nuisance": 8} | sizes
    return set_stage(b, seed=9, **numbers)


def gain_of(stage: Stage, candidate: Candidate) -> tuple[float, float]:
    own, inner = stage.outer.x[:, :4], stage.inner.x[:, :4]
    found, _ = nested_estimate(stage, candidate, own, inner)
    return found.eig, found.se


def linear_gain_of(stage: Stage, candidate: Candidate) -> float:
    return float(linear_law(stage.paints).gain([told_by(stage, candidate)]).mean())


def test_repeating_an_exact_measurement_tells_nothing() -> None:
    """Without white noise and gain a scan shows model times discrepancy: again the same one."""
    priors = {f"s_rel_{q}": {"kind": "fixed", "value": 1e-4} for q in "sp"}
    posterior = replace(posterior_of(priors=priors), measurement=posterior_of().measurement)
    centre = np.array([CENTRE[n] for n in posterior.parameter_names])
    centre[[posterior.parameter_names.index(f"s_rel_{q}") for q in "sp"]] = 1e-4
    noise = np.random.default_rng(2).standard_normal((400, centre.size)) * 0.01
    noise[:, [posterior.parameter_names.index(f"s_rel_{q}") for q in "sp"]] = 0.0
    posterior = replace(posterior, rows=posterior.rows._replace(u_cal2=0.0))
    b = beliefs_of_run(posterior, centre * np.exp(noise))
    # a measurement that the draws themselves would give: otherwise none of them explains it
    stage = stage_of(b)
    same = tuple(posterior.measurement.brdf.theta_r_deg[posterior.measurement.scans[0].rows])
    repeat = linear_gain_of(stage, scan_of("s", 20.0, same))
    other = linear_gain_of(stage, scan_of("s", 40.0, same))
    assert repeat < 1e-3
    assert other > 0.05


def test_parts_of_a_scan_add_up_where_readings_are_independent() -> None:
    """Chain rule with the model itself: without gain and discrepancy the halves are the whole."""
    b = beliefs(noise="iid")
    b = replace(b, posterior=replace(b.posterior, rows=b.posterior.rows._replace(u_cal2=0.0)))
    planned = plan_scan(b, scan_of("s", 40.0), np.ones(len(SCAN), dtype=bool))
    sets = draw_sets(b, b.x[:20], np.random.default_rng(3))
    law = law_of_rows(b, planned, sets, b.posterior.predict(sets.x, planned.geometry)[0])
    y = draw_scans(b, planned, law, seed=4)
    whole = scan_log_likelihoods(b, planned, y, law, matched=False)
    parts = 0.0
    for part in (SCAN[:6], SCAN[6:]):
        half = plan_scan(b, scan_of("s", 40.0, part), np.ones(len(part), dtype=bool))
        rows = np.isin(SCAN, part)
        law_half = law_of_rows(b, half, sets, b.posterior.predict(sets.x, half.geometry)[0])
        parts = parts + scan_log_likelihoods(
            b, half, np.ascontiguousarray(y[rows]), law_half, matched=False
        )
    np.testing.assert_allclose(parts, whole, rtol=1e-10)


def test_the_gain_does_not_depend_on_the_sampling_coordinate() -> None:
    """k in its logarithm, sigma_n0 too: the same draws, the same gain within its error."""
    b = beliefs(spread=0.02)
    specs = tuple(
        replace(s, log_coordinate=not s.log_coordinate) if s.name in ("k", "sigma_n0") else s
        for s in b.posterior.specs
    )
    moved = replace(b, posterior=replace(b.posterior, specs=specs))
    candidate = scan_of("p", 45.0)
    for tier in (
        lambda s: (linear_gain_of(s, candidate), 0.005),
        lambda s: gain_of(s, candidate),
    ):
        one, error = tier(stage_of(b))
        two, _ = tier(stage_of(moved))
        assert one == pytest.approx(two, abs=max(3.0 * error, 0.02 * one))


def test_both_estimates_agree_where_everything_is_nearly_linear() -> None:
    b = beliefs(n=1500, spread=0.004)
    for candidate in (scan_of("p", 45.0), scan_of("s", 75.0)):
        # the draws are no posterior of the readings: these do not count, and only information
        # about all parameters has no nuisance to be weighed
        every = replace(b, about=b.free_names, measured=False)
        stage = set_stage(every, n_outer=400, n_inner=1000, n_nuisance=2, seed=9)
        eig, se = gain_of(stage, candidate)
        linear = linear_gain_of(stage, candidate)
        assert eig == pytest.approx(linear, abs=4.0 * se + 0.15 * linear)


def test_candidates_are_checked() -> None:
    with pytest.raises(ConfigError, match=r"theta_i_deg = 95.*\[0, 89.95\]"):
        Candidate("dhr", "s", 95.0, 1.0)
    with pytest.raises(ConfigError, match=r"polarization = 'x' is not known. Allowed: s, p, u"):
        Candidate("dhr", "x", 5.0, 1.0)
    with pytest.raises(ConfigError, match=r"port_deg = 0.0 is not allowed"):
        Candidate("ddr", "s", 5.0, 1.0)
    with pytest.raises(ConfigError, match="a scan has 1 to 2000 readings, not 0"):
        Candidate("brdf", "s", 5.0, 1.0)
    with pytest.raises(ConfigError, match="there is no candidate"):
        design_measurements(beliefs(), [])
    with pytest.raises(ConfigError, match="n_outer = 3 is not allowed"):
        DesignChoices(n_outer=3)


def test_usual_scan_and_repeats() -> None:
    m = posterior_of().measurement
    assert usual_scan(m) == tuple(np.arange(-60.0, 61.0, 5.0))
    assert was_measured(scan_of("s", 20.0), m)
    assert was_measured(scan_of("s", 20.9), m)
    assert not was_measured(scan_of("s", 21.0), m)
    assert not was_measured(scan_of("u", 20.0), m)
    assert was_measured(Candidate("dhr", "p", 50.0, 1.0), m)
    assert not was_measured(Candidate("ddr", "p", 50.0, 1.0, port_deg=5.0), m)


def test_one_candidate_and_a_seed() -> None:
    small = DesignChoices(n_outer=50, n_inner=100, n_nuisance=4, batch=2, seed=3)
    one = [scan_of("p", 45.0)]
    first = design_measurements(beliefs(), one, choices=small)
    again = design_measurements(beliefs(), one, choices=replace(small, threads=1))
    assert first.evaluated[0].gain.eig == again.evaluated[0].gain.eig
    assert first.by_gain.p_best.tolist() == [1.0]
    assert first.pairs is None


def test_before_any_reading() -> None:
    """From the prior: a reading tells something, and brackets hold the middle."""
    options = list_candidates(
        quantities=("dhr", "ddr"), theta_i_deg=(10.0, 60.0), polarizations=("s", "u"),
        theta_r_deg=SCAN,
    )  # fmt: skip
    b = beliefs_of_prior(pb.RunConfig(), options, n_draws=1500, seed=1)
    small = DesignChoices(n_outer=200, n_inner=1000, n_nuisance=8, batch=1)
    result = design_measurements(b, options, choices=small)
    for e in result.evaluated:
        assert 0.5 < e.gain.eig < 5.0
        assert e.gain.low < e.gain.eig < e.gain.high
    assert not result.repeats.any()
