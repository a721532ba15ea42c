"""The observation law written down once more, dense, and held against every part that follows it.

Only model values come from the package. Mean, covariance and sensitivities are those of the formula
in `readings.observation`: one matrix for all BRDF rows, factorised by LAPACK.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, stats
from scipy.special import logsumexp

import pbrdf_bayes as pb
from pbrdf_bayes.inference.likelihood.filtered import FilterState, filter_state
from pbrdf_bayes.inference.likelihood.row_evidence import (
    N_OUT,
    A,
    W,
    normal_mixture,
    row_evidence,
    student_mixture,
)
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import replicate_brdf, scan_scales, targets_at
from pbrdf_bayes.inference.prediction.conditionals import brdf_conditionals
from pbrdf_bayes.inference.prediction.holdout import _joint_replicas
from pbrdf_bayes.inference.prediction.innovations import filter_all
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]
X = {
    "n": 1.6, "k": 0.25, "sigma_n0": 0.5, "rho0": 0.4, "s_rel_s": 0.03, "s_rel_p": 0.05,
    "tau": 0.05, "ell_deg": 20.0, "u_dhr": 0.004,
}  # fmt: skip
FLOOR = 1e-3
"""Beside the lowest readings, below all."""


@pytest.fixture(scope="module")
def readings() -> Measurement:
    """Two scans of one geometry that share most angles, and one of p at another."""
    rng = np.random.default_rng(3)
    columns: dict[str, list[Any]] = {
        name: [] for name in ("theta_i_deg", "theta_r_deg", "polarization", "value", "scan")
    }
    for theta_i, q, name, shift in [
        (30.0, "s", "a", 0.0),
        (30.0, "s", "b", 10.0),
        (60.0, "p", "", 1.0),
    ]:
        grid = np.linspace(-70.0, 70.0, 15) + shift
        model = pb.brdf(pb.Parameters(n=1.55, k=0.2, sigma_n0=0.48, rho0=0.42), theta_i, grid, q)
        noise = np.exp(0.05 * rng.standard_normal(grid.size) + 0.03 * rng.standard_normal())
        for angle, value in zip(grid, np.hypot(model * noise, 1.2 * FLOOR), strict=True):
            for key, item in zip(columns, (theta_i, angle, q, value, name), strict=True):
                columns[key].append(item)
    n = len(columns["value"])
    return measurement_from_columns(
        sample="made up", wavelength_um=1.0, quantity=["brdf"] * n, **columns
    )


def stated(m: Measurement) -> Measurement:
    n = len(m.brdf)
    return replace(m, brdf=replace(m.brdf, u_value=m.brdf.value * np.linspace(0.01, 0.06, n)))


def sensitivities(m: Measurement) -> Array:
    """A scale, a scale of p and a zero error, as large as the noise and more."""
    angle, p = np.deg2rad(m.brdf.theta_r_deg), m.brdf.polarization == "p"
    return np.stack([np.full(angle.size, 0.03), 0.02 * p, -0.05 * np.tan(0.9 * angle)])


class Dense(NamedTuple):
    """Residuals, h, the covariance over h and its part that is noise, in scan order."""

    residual: Array
    share: Array
    shared: Array
    noise: Array

    @property
    def covariance(self) -> Array:
        return self.shared * np.outer(self.share, self.share) + np.diag(self.noise)

    def log_density(self) -> float:
        return float(stats.multivariate_normal(cov=self.covariance).logpdf(self.residual))


def point(posterior: Posterior) -> Array:
    return np.array([X[name] for name in posterior.parameter_names])


def dense(posterior: Posterior, x: Array, s: Array | None = None) -> Dense:
    """The law of the formula."""
    m, config = posterior.measurement, posterior.config
    value = dict(zip(posterior.parameter_names, x.tolist(), strict=True))
    f2, b2 = posterior.predict(x[None])[0][0] ** 2, config.brdf_floor**2
    u_cal = 10.0 if config.brdf_scale == "relative" else config.u_brdf_cal
    number = np.repeat(np.arange(len(m.scans)), [len(scan) for scan in m.scans])
    shared = u_cal**2 * (number[:, None] == number).astype(float)
    if "tau" in value:
        a = np.abs(m.brdf.theta_r_deg[:, None] - m.brdf.theta_r_deg) / value["ell_deg"]
        smooth = (1.0 + 3**0.5 * a) * np.exp(-(3**0.5) * a)
        path = np.exp(-a) if config.discrepancy == "matern-1/2" else smooth
        group = np.stack([m.brdf.theta_i_deg, m.brdf.polarization == "p"])
        same = (group[:, :, None] == group[:, None, :]).all(axis=0)
        shared = shared + value["tau"] ** 2 * same * path
    if s is not None:
        shared = shared + s.T @ s
    white = np.array([value[f"s_rel_{q}"] for q in m.brdf.polarization]) ** 2
    u2 = np.nan_to_num(m.brdf.u_value / np.maximum(m.brdf.value, config.brdf_floor), nan=0.0) ** 2
    y = np.log(np.maximum(m.brdf.value, max(config.brdf_floor, 1e-280)))
    return Dense(
        y - 0.5 * np.log(f2 + b2), f2 / (f2 + b2), shared, white + u2 + b2 / (f2 + b2)
    )  # fmt: skip


LAWS: dict[str, dict[str, Any]] = {
    "iid": {"noise": "iid"},
    "iid, gain": {"noise": "iid", "u_brdf_cal": 0.05},
    "iid, floor": {"noise": "iid", "u_brdf_cal": 0.05, "brdf_floor": FLOOR},
    "correlated": {"noise": "correlated"},
    "correlated, gain": {"noise": "correlated", "u_brdf_cal": 0.05},
    "rough, floor": {
        "noise": "correlated", "u_brdf_cal": 0.05, "brdf_floor": FLOOR, "discrepancy": "matern-1/2",
    },
    "all": {"noise": "correlated", "u_brdf_cal": 0.05, "brdf_floor": FLOOR},
}  # fmt: skip


def build(m: Measurement, law: str, **more: Any) -> Posterior:
    return pb.build_posterior(m, pb.RunConfig(accuracy="reference", **LAWS[law], **more))


@pytest.mark.parametrize("errors", [False, True])
@pytest.mark.parametrize("with_u", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_likelihood_and_gradient(
    law: str, with_u: bool, errors: bool, readings: Measurement
) -> None:
    """Slopes against differences of the dense law of five points; model slopes are tested apart."""
    m = stated(readings) if with_u else readings
    posterior, s = build(m, law), sensitivities(m) if errors else None
    if s is not None:
        posterior = posterior.with_errors(s)
    x = point(posterior)
    found = posterior.log_likelihood(np.stack([x, 1.01 * x, x]))
    wanted = [dense(posterior, at, s).log_density() for at in (x, 1.01 * x)]
    np.testing.assert_allclose(found[:2], wanted, rtol=1e-9, atol=1e-9)
    assert found[2] == found[0]
    value, slopes = posterior._likelihood_gradient(x[None])
    assert value[0] == pytest.approx(found[0], rel=1e-12)
    for i in range(posterior.n_par):
        step = 1e-3 * x[i] * np.eye(posterior.n_par)[i]
        rise = [dense(posterior, x + h * step, s).log_density() for h in (-2.0, -1.0, 1.0, 2.0)]
        wanted_slope = (8.0 * (rise[2] - rise[1]) - (rise[3] - rise[0])) / (12.0 * 1e-3 * x[i])
        assert slopes[0, i] * x[i] == pytest.approx(wanted_slope * x[i], rel=1e-6, abs=1e-5)


def test_no_errors_cost_nothing(readings: Measurement) -> None:
    for law in LAWS:
        posterior = build(readings, law)
        x = point(posterior)[None]
        none = posterior.with_errors(np.zeros((0, len(readings.brdf))))
        assert none.log_likelihood(x)[0] == posterior.log_likelihood(x)[0]
        assert posterior.with_errors(0.0 * sensitivities(readings)).log_likelihood(
            x
        ) == pytest.approx(posterior.log_likelihood(x), rel=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_each_reading_given_the_others(law: str, readings: Measurement) -> None:
    posterior = build(stated(readings), law)
    x = point(posterior)[None]
    found = brdf_conditionals(posterior, x, posterior.predict(x)[0])
    d = dense(posterior, x[0])
    precision = linalg.inv(d.covariance)
    alone = 1.0 / np.diag(precision)
    np.testing.assert_allclose(found.variance[0], alone, rtol=1e-9)
    np.testing.assert_allclose(
        found.error[0], alone * (precision @ d.residual), rtol=1e-8, atol=1e-11
    )


@pytest.mark.parametrize("law", [name for name, c in LAWS.items() if "u_brdf_cal" in c])
def test_gains_of_the_scans(law: str, readings: Measurement) -> None:
    posterior = build(stated(readings), law)
    x = point(posterior)
    d = dense(posterior, x)
    b = np.repeat(np.eye(3), 15, axis=1) * d.share
    mean = 0.05**2 * b @ linalg.solve(d.covariance, d.residual)
    covariance = 0.05**2 * np.eye(3) - 0.05**4 * b @ linalg.solve(d.covariance, b.T)
    state = filtered_state(posterior, x)
    np.testing.assert_allclose(state.gain, mean, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(state.gain_cov, covariance, rtol=1e-8, atol=1e-12)
    drawn = scan_scales(posterior, np.tile(x, (2000, 1)), np.random.default_rng(1))
    assert drawn is not None
    away = (np.log(drawn).mean(axis=0) - mean) / np.sqrt(np.diag(covariance) / 2000)
    assert np.abs(away).max() < 4.0
    ratio = np.cov(np.log(drawn).T) / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    wanted = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(ratio, wanted, atol=0.15)


def moments_agree(drawn: Array, mean: Array, covariance: Array) -> None:
    """Means and covariances within five of their standard errors."""
    n, variance = len(drawn), np.diag(covariance)
    assert (np.abs(drawn.mean(axis=0) - mean) < 5.0 * np.sqrt(variance / n)).all()
    error = np.sqrt((np.outer(variance, variance) + covariance**2) / n)
    assert (np.abs(np.cov(drawn.T) - covariance) < 5.0 * error).all()


@pytest.mark.parametrize("law", ["iid, floor", "all"])
def test_replicated_readings(law: str, readings: Measurement) -> None:
    """Gains by scan; in a band the discrepancy of each point by itself."""
    posterior = build(readings, law)
    draws = np.tile(point(posterior), (8000, 1))
    d = dense(posterior, draws[0])
    drawn = replicate_brdf(
        posterior, draws, posterior.predict(draws)[0], targets_at(readings.brdf),
        np.random.default_rng(2),
    )  # fmt: skip
    y = np.log(readings.brdf.value) - d.residual
    variance = np.diag(d.covariance)
    away = np.log(drawn)
    assert (np.abs(away.mean(axis=0) - y) < 5.0 * np.sqrt(variance / 8000)).all()
    np.testing.assert_allclose(away.var(axis=0), variance, rtol=5.0 * (2.0 / 8000) ** 0.5)


def test_paths_of_a_held_out_scan(readings: Measurement) -> None:
    """Covariances between the readings: a gain of the geometry and a path along it."""
    posterior = build(readings, "all")
    draws = np.tile(point(posterior), (4000, 1))
    curves = posterior.predict(draws)[0]
    drawn = np.log(
        _joint_replicas(posterior, draws, curves, curves, readings, np.random.default_rng(4))
    )
    d = dense(posterior, draws[0])
    last = slice(30, 45)  # one scan to its geometry
    y = (np.log(readings.brdf.value) - d.residual)[last]
    moments_agree(drawn[:, last], y, d.covariance[last, last])


def test_simulated_readings() -> None:
    truth = pb.Parameters(n=1.6, k=0.25, sigma_n0=0.5, rho0=0.4)
    grid = np.linspace(-70.0, 70.0, 8)
    drawn = np.stack([
        np.log(simulate_measurement(
            truth, seed=seed, theta_i_deg=(30.0,), theta_r_deg=grid, dhr_theta_i_deg=(),
            polarizations=("s",), relative_noise=0.03, u_brdf_cal=0.05, brdf_floor=FLOOR,
        ).brdf.value)
        for seed in range(2000)
    ])  # fmt: skip
    f2 = pb.brdf(truth, 30.0, grid, "s") ** 2
    h = f2 / (f2 + FLOOR**2)
    covariance = 0.05**2 * np.outer(h, h) + np.diag(0.03**2 + 1.0 - h)
    moments_agree(drawn, 0.5 * np.log(f2 + FLOOR**2), covariance)


# --- rows that are not normal


NOT_NORMAL: dict[str, dict[str, Any]] = {
    "censored": {"noise": "correlated", "u_brdf_cal": 0.05, "brdf_floor": 3e-3},
    "censored, iid": {"noise": "iid", "u_brdf_cal": 0.05, "brdf_floor": 3e-3},
    "student": {"noise": "correlated", "u_brdf_cal": 0.05, "tails": "student-t"},
    "student, iid": {"noise": "iid", "u_brdf_cal": 0.05, "tails": "student-t"},
    "both": {"noise": "correlated", "tails": "student-t", "brdf_floor": 3e-3},
}  # fmt: skip


def not_normal(m: Measurement, case: str) -> Posterior:
    posterior = pb.build_posterior(m, pb.RunConfig(accuracy="reference", **NOT_NORMAL[case]))
    assert ("censored" in case or case == "both") == posterior.rows.censored.any()
    return posterior


def filtered_state(posterior: Posterior, x: Array, order: Posterior | None = None) -> FilterState:
    """With the rows in the order of another posterior, whose readings choose it."""
    filtered, p = filter_all(order or posterior), posterior
    assert filtered is not None
    return filter_state(p.geometry, p.rows, filtered, x, p.digits, p.given(x[None]))


def sites_of(
    posterior: Posterior, x: Array, shift: Array, order: Posterior | None = None
) -> tuple[Array, Array]:
    """Residuals and variances, over h, of the normal rows that the filter puts in their places.

    ``shift`` has been taken from the readings over h.
    """
    state, d = filtered_state(posterior, x, order), dense(posterior, x)
    student = posterior.config.tails == "student-t"
    mixture = student_mixture(posterior.config.student_dof) if student else normal_mixture()
    reading, variance = np.empty(d.residual.size), np.empty(d.residual.size)
    out, work = np.zeros(N_OUT), np.zeros((6, mixture.scale.size))
    for i, (e, s) in enumerate(zip(state.innovation, state.predicted, strict=True)):
        v, hidden = d.noise[i] / d.share[i] ** 2, bool(posterior.rows.censored[i])
        row_evidence(e, s, v, hidden, mixture, False, work, out)
        reading[i] = d.residual[i] / d.share[i] - shift[i] - e + out[A] / out[W]
        variance[i] = 1.0 / out[W] - s
    return reading, variance


def less(posterior: Posterior, x: Array, shift: Array) -> Posterior:
    """The same with ``shift`` over h taken from all readings and limits, and without errors."""
    y = posterior.rows.y - dense(posterior, x).share * shift
    free = posterior.with_errors(np.zeros((1, y.size)))  # censored rows by the filter as well
    return replace(free, rows=free.rows._replace(y=y))


@pytest.mark.parametrize("case", NOT_NORMAL)
def test_gains_beside_sites(case: str, readings: Measurement) -> None:
    """Those of the sites' covariance matrix, which pins the sites."""
    posterior = not_normal(readings, case)
    x, u2 = point(posterior), posterior.rows.u_cal2
    reading, variance = sites_of(posterior, x, np.zeros(45))
    k = dense(posterior, x).shared + np.diag(variance)
    wanted = u2 * np.repeat(np.eye(3), 15, axis=1) @ linalg.solve(k, reading)
    np.testing.assert_allclose(filtered_state(posterior, x).gain, wanted, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("case", NOT_NORMAL)
def test_errors_beside_sites(case: str, readings: Measurement) -> None:
    """v and G of the sites' covariance matrix, sites at z = 0 and then at E(z|y)."""
    posterior, s, z, wanted = not_normal(readings, case), sensitivities(readings), np.zeros(3), 0.0
    x = point(posterior)
    for _ in range(2):
        shifted = less(posterior, x, z @ s)
        reading, variance = sites_of(shifted, x, z @ s, posterior)
        k = dense(posterior, x).shared + np.diag(variance)
        v, g = s @ linalg.solve(k, reading) - z, np.eye(3) + s @ linalg.solve(k, s.T)
        wanted = shifted.log_likelihood(x[None])[0] - 0.5 * z @ z
        wanted += 0.5 * v @ linalg.solve(g, v) - 0.5 * np.linalg.slogdet(g)[1]
        z = z + linalg.solve(g, v)
    found = posterior.with_errors(s).log_likelihood(x[None])[0]
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("case", NOT_NORMAL)
def test_gradient_beside_sites(case: str, readings: Measurement) -> None:
    """By differences: within what these leave."""
    posterior = not_normal(readings, case).with_errors(sensitivities(readings))
    x = point(posterior)
    value, slopes = posterior._likelihood_gradient(x[None])
    assert value[0] == posterior.log_likelihood(x[None])[0]
    step = 1e-4 * np.diag(x)
    rise = [posterior.log_likelihood(x + h * step) for h in (-1.0, 1.0)]
    by_log = (rise[1] - rise[0]) / 2e-4
    np.testing.assert_allclose(slopes[0] * x, by_log, atol=1e-4 * np.abs(by_log).max())


def error_of_the_sites(posterior: Posterior, s: Array) -> float:
    """Against the integral over one error z of the same filter's likelihood, y - h S z for y."""
    x, z = point(posterior), np.linspace(-6.0, 6.0, 121)
    logs = np.array([less(posterior, x, s * at).log_likelihood(x[None])[0] for at in z])
    exact = logsumexp(logs + stats.norm.logpdf(z)) + np.log(z[1] - z[0])
    return float(posterior.with_errors(s[None]).log_likelihood(x[None])[0] - exact)


@pytest.mark.parametrize("case", ["censored", "censored, iid"])
def test_error_of_censored_sites(case: str, readings: Measurement) -> None:
    for s in sensitivities(readings):
        assert abs(error_of_the_sites(not_normal(readings, case), s)) < 1e-3


@pytest.mark.parametrize("noise", ["iid", "correlated"])
@pytest.mark.parametrize("seed", [1, 3])
def test_error_of_student_sites(noise: str, seed: int) -> None:
    """Readings that follow the law, an error as large as the noise."""
    m = simulate_measurement(
        pb.Parameters(n=1.6, k=0.25, sigma_n0=0.5, rho0=0.4), seed=seed, theta_i_deg=(20.0, 60.0),
        theta_r_deg=np.linspace(-64.0, 64.0, 33), relative_noise=0.0, u_brdf_cal=0.02,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    noises = 0.03 * (rng.standard_t(4.0, len(m.brdf)) + rng.standard_normal())
    m = replace(m, brdf=replace(m.brdf, value=m.brdf.value * np.exp(noises)))
    config = pb.RunConfig(noise=noise, tails="student-t", u_brdf_cal=0.02, accuracy="reference")
    posterior = pb.build_posterior(m, config)
    assert abs(error_of_the_sites(posterior, np.full(len(m.brdf), 0.03))) < 0.05


PINNED: list[tuple[dict[str, Any], float]] = [
    ({"noise": "iid"}, -5161.880702881225),
    ({"noise": "iid", "u_brdf_cal": 0.04}, 99.05182309403622),
    ({"noise": "iid", "brdf_scale": "relative"}, 170.96545668688134),
    ({"noise": "correlated"}, 92.84139649319343),
    ({"noise": "correlated", "u_brdf_cal": 0.04}, 268.96640226555405),
    ({"noise": "correlated", "u_brdf_cal": 0.04, "discrepancy": "matern-1/2"}, 284.95692225548896),
    ({"noise": "iid", "u_brdf_cal": 0.04, "tails": "student-t"}, 235.24306224754733),
    ({"noise": "correlated", "tails": "student-t"}, 148.28193443462453),
    ({"noise": "iid", "brdf_floor": 3e-3}, -515.9175931080022),
    ({"noise": "correlated", "u_brdf_cal": 0.04, "brdf_floor": 1e-4}, 285.0249865609816),
    ({"noise": "correlated", "u_brdf_cal": 0.04, "brdf_floor": 3e-3}, 5.702099213717997),
    ({"noise": "correlated", "u_brdf_cal": 0.04, "tails": "student-t", "brdf_floor": 3e-3}, -2.9406730439392135),
]  # fmt: skip
"""Log-likelihoods as they were before there was one law, where that changed nothing."""


@pytest.mark.parametrize(("choices", "wanted"), PINNED)
def test_values_stay(choices: dict[str, Any], wanted: float) -> None:
    m = simulate_measurement(
        pb.Parameters(n=1.55, k=0.2, sigma_n0=0.48, rho0=0.42), seed=5,
        theta_i_deg=(0.0, 30.0, 70.0), theta_r_deg=np.linspace(-75.0, 75.0, 41),
        relative_noise=0.05, dhr_noise=0.004, u_brdf_cal=0.05, u_dhr_cal=0.02,
    )  # fmt: skip
    posterior = pb.build_posterior(m, pb.RunConfig(accuracy="reference", **choices))
    found = posterior.log_likelihood(point(posterior)[None])[0]
    assert found == pytest.approx(wanted, rel=1e-11)
