"""Posteriors with censored readings beside a discrepancy, or with Student-t noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.likelihood.filtered import (
    filtered_gradient,
    filtered_log_likelihood,
    prepare_filtered,
)
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import predict_bands, scan_scales, targets_at
from pbrdf_bayes.inference.prediction.innovations import filter_all, standardised_innovations
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.given import NOTHING_GIVEN

Array = NDArray[np.float64]
POINT = {
    "n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47, "s_rel_s": 0.02, "s_rel_p": 0.02,
    "tau": 0.05, "ell_deg": 20.0, "u_dhr": 0.0005,
}  # fmt: skip
FLOOR = 3e-3
"""Some tens of the readings lie below."""


def point(posterior: Posterior) -> Array:
    return np.array([POINT[name] for name in posterior.parameter_names])


def build(measurement: Measurement, **choices: Any) -> Posterior:
    return pb.build_posterior(measurement, pb.RunConfig(accuracy="draft", **choices))


def made(small: Measurement, seed: int, *, rough: bool = False, **choices: Any) -> Posterior:
    """Readings drawn from the likelihood itself at `POINT`, on the grid of `small`.

    Rows at or below the floor are left there: the reader would censor them.
    """
    rng = np.random.default_rng(seed)
    config = pb.RunConfig(
        accuracy="reference", discrepancy="matern-1/2" if rough else "matern-3/2", **choices
    )
    plain = pb.build_posterior(small, config)
    f = plain.predict(point(plain)[None])[0][0]
    tau = POINT["tau"] if config.noise == "correlated" else 0.0
    log_value = np.empty(f.size)
    for scan in small.scans:
        angle = small.brdf.theta_r_deg[scan.rows]
        a = np.abs(angle[:, None] - angle) / POINT["ell_deg"] * (1.0 if rough else np.sqrt(3.0))
        matrix = tau**2 * np.exp(-a) * (1.0 if rough else 1.0 + a) + config.u_brdf_cal**2
        path = linalg.cholesky(matrix + 1e-14 * np.eye(angle.size), lower=True)
        f2, b2 = f[scan.rows] ** 2, config.brdf_floor**2
        noise = rng.normal(size=angle.size)
        if config.tails == "student-t":
            noise = rng.standard_t(config.student_dof, angle.size)
        mean = 0.5 * np.log(f2 + b2) + path @ rng.normal(size=angle.size)
        log_value[scan.rows] = mean + noise * np.sqrt(0.02**2 + b2 / (f2 + b2))
    brdf = replace(small.brdf, value=np.exp(log_value))
    return pb.build_posterior(replace(small, brdf=brdf), config)


CASES: dict[str, dict[str, Any]] = {
    "censored": {"noise": "correlated", "brdf_floor": FLOOR},
    "student": {"noise": "correlated", "tails": "student-t"},
    "independent student": {"noise": "iid", "tails": "student-t", "u_brdf_cal": 0.05},
    "both": {
        "noise": "correlated", "tails": "student-t", "brdf_floor": FLOOR, "u_brdf_cal": 0.05,
        "student_dof": 6.0,
    },
    "relative": {"noise": "correlated", "brdf_floor": FLOOR, "brdf_scale": "relative"},
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_gradient(case: str, small: Measurement) -> None:
    posterior = build(small, **CASES[case])
    x = point(posterior) * np.linspace(0.97, 1.02, posterior.n_par)
    value, found = posterior.log_prob_gradient(x[None])
    assert value[0] == pytest.approx(posterior.log_prob(x[None])[0], rel=1e-12)
    steps = 1e-4 * np.diag(x)
    rise = [posterior.log_prob(x + h * steps) for h in (-2.0, -1.0, 1.0, 2.0)]
    wanted = (8.0 * (rise[2] - rise[1]) - (rise[3] - rise[0])) / 12.0
    by_log = found[0] * x
    np.testing.assert_allclose(by_log, wanted / 1e-4, atol=1e-6 * np.abs(by_log).max())


def test_only_the_groups_that_need_it_are_filtered(small: Measurement) -> None:
    floor = float(np.sort(small.brdf.value)[3])
    posterior = build(small, noise="correlated", brdf_floor=floor, u_brdf_cal=0.02)
    found = posterior.filtered
    assert found is not None
    assert found.sweep.row.size + found.exact_row.size == len(small.brdf)
    assert 0 < found.sweep.row.size < len(small.brdf)
    everything = filter_all(posterior)
    assert everything is not None
    assert not everything.exact_row.size
    args = (point(posterior)[None], posterior.digits)
    g, rows = posterior.geometry, posterior.rows
    one, other = (
        filtered_log_likelihood(g, rows, f, *args, NOTHING_GIVEN, posterior.errors[None])
        for f in (found, everything)
    )
    np.testing.assert_allclose(one, other, rtol=1e-11)
    one, other = (filtered_gradient(g, rows, f, *args)[1] for f in (found, everything))
    np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9 * np.abs(other).max())


@pytest.mark.parametrize("noise", ["iid", "correlated"])
def test_nothing_is_filtered_without_need(noise: str, small: Measurement) -> None:
    assert build(small, noise=noise).filtered is None
    assert build(small, noise="iid", brdf_floor=FLOOR).filtered is None


def test_censored_readings_without_misfit_are_those_of_independent_rows(small: Measurement) -> None:
    floored, plain = (
        build(small, noise=noise, brdf_floor=FLOOR) for noise in ("correlated", "iid")
    )
    assert floored.rows.censored.any()
    x = point(floored)
    x[floored.parameter_names.index("tau")] = 1e-5
    values = (
        posterior.log_likelihood(np.atleast_2d(at))
        for posterior, at in ((floored, x), (plain, point(plain)))
    )
    assert next(values)[0] == pytest.approx(next(values)[0], abs=2e-3)


def test_the_rough_discrepancy_can_be_chosen(small: Measurement) -> None:
    """The two likelihoods differ by as much as those by covariance matrices."""
    rough, smooth = (
        build(small, noise="correlated", discrepancy=law) for law in ("matern-1/2", "matern-3/2")
    )
    x = point(rough)
    residual = rough.rows.y - np.log(rough.predict(x[None])[0][0])
    wanted = 0.0
    for scan in small.scans:
        r, angle = residual[scan.rows], small.brdf.theta_r_deg[scan.rows]
        a = np.abs(angle[:, None] - angle) / 20.0
        b, white = np.sqrt(3.0) * a, 0.02**2 * np.eye(angle.size)
        wanted += stats.multivariate_normal.logpdf(r, cov=0.05**2 * np.exp(-a) + white)
        matrix = 0.05**2 * (1.0 + b) * np.exp(-b) + white
        wanted -= stats.multivariate_normal.logpdf(r, cov=matrix)
    found = rough.log_likelihood(x[None])[0] - smooth.log_likelihood(x[None])[0]
    assert found == pytest.approx(wanted, abs=1e-7)


@pytest.mark.parametrize(
    "choices",
    [
        {"noise": "iid"},
        {"noise": "iid", "brdf_floor": FLOOR, "u_brdf_cal": 0.05},
        {"noise": "correlated", "u_brdf_cal": 0.05},
        {"noise": "correlated", "rough": True},
        {"noise": "correlated", "brdf_floor": FLOOR},
        {"noise": "correlated", "tails": "student-t", "u_brdf_cal": 0.05},
        {"noise": "correlated", "tails": "student-t", "brdf_floor": FLOOR},
    ],
    ids=str,
)
def test_innovations_are_independent_and_uniform(
    choices: dict[str, Any], small: Measurement
) -> None:
    rng = np.random.default_rng(1)
    parts = []
    for seed in range(20):
        posterior = made(small, seed, **choices)
        parts.append(standardised_innovations(posterior, point(posterior), rng))
    u = np.concatenate(parts)
    assert u.shape == (20 * len(small.brdf),)
    assert ((u > 0.0) & (u < 1.0)).all()
    assert stats.kstest(u, "uniform").pvalue > 0.01
    z = stats.norm.ppf(np.stack(parts))
    inside = np.diff(small.brdf.theta_r_deg) > 0.0
    products = (z[:, 1:] * z[:, :-1])[:, inside].ravel()
    assert abs(products.mean()) < 4.0 / np.sqrt(products.size)


def test_innovations_tell_a_wrong_model(small: Measurement) -> None:
    """The negative control: misfit in the data, none in the model."""
    posterior = made(small, 0, noise="correlated")
    plain = build(posterior.measurement, noise="iid")
    u = standardised_innovations(plain, point(plain), np.random.default_rng(0))
    assert stats.kstest(u, "uniform").pvalue < 1e-6


def off(posterior: Posterior) -> tuple[Array, Array]:
    """MAP minus truth in Laplace standard deviations, of the physical parameters and all x."""
    optima = find_map(posterior, n_starts=4, seed=1)
    factor = laplace_mixture(posterior, optima).factors[0]
    sd = np.sqrt(np.sum(factor**2, axis=1)) * np.where(posterior.is_log, optima.best.x, 1.0)
    away = (optima.best.x - point(posterior)) / sd
    return away[:4], optima.best.x


@pytest.mark.parametrize("noise", ["iid", "correlated"])
def test_gross_outliers(noise: str, small: Measurement) -> None:
    """3 % of the readings at a third of their value: only Student's t finds the noise, 2 %."""
    rng = np.random.default_rng(5)
    value = made(small, 7, noise=noise).measurement.brdf.value.copy()
    value[rng.choice(value.size, round(0.03 * value.size), replace=False)] /= 3.0
    spoilt = replace(small, brdf=replace(small.brdf, value=value))
    robust, plain = (build(spoilt, noise=noise, tails=t) for t in ("student-t", "normal"))
    away, x = off(robust)
    assert np.abs(away).max() < 3.0
    at = [robust.parameter_names.index(name) for name in ("s_rel_s", "s_rel_p")]
    assert (x[at] < 0.03).all()
    _, x_plain = off(plain)
    assert x_plain[at].max() > 0.08
    truth = point(robust)[:4]
    assert np.abs(x[:4] / truth - 1.0).max() < 0.5 * np.abs(x_plain[:4] / truth - 1.0).max()


def test_censored_readings_beside_a_misfit(small: Measurement) -> None:
    posterior = made(small, 3, noise="correlated", brdf_floor=FLOOR)
    assert posterior.rows.censored.sum() >= 10
    away, _ = off(replace(posterior, digits=build(small).digits))
    assert np.abs(away).max() < 3.0


@pytest.mark.parametrize(
    "choices",
    [{"brdf_floor": FLOOR}, {"tails": "student-t"}, {"tails": "student-t", "brdf_floor": FLOOR}],
    ids=str,
)
def test_scales_of_scans(choices: dict[str, Any], small: Measurement) -> None:
    """A scan 30 % too bright is told as such, its readings below the floor and outliers aside."""
    base = made(small, 2, noise="correlated", **choices)
    value = base.measurement.brdf.value.copy()
    scan = base.measurement.scans[1]
    value[scan.rows] *= 1.3
    value[scan.rows][::12] *= 3.0 if "tails" in choices else 1.0
    bright = replace(base.measurement, brdf=replace(base.measurement.brdf, value=value))
    posterior = build(bright, noise="correlated", u_brdf_cal=0.3, **choices)
    draws = np.repeat(point(posterior)[None], 300, axis=0)
    scales = scan_scales(posterior, draws, np.random.default_rng(0))
    assert scales is not None
    logs = np.log(scales)
    centre, sd = logs.mean(axis=0), logs.std(axis=0)
    wanted = np.where(np.arange(len(bright.scans)) == 1, np.log(1.3), 0.0)
    assert (np.abs(centre - wanted) < 4.0 * sd).all()
    assert (sd < 0.25).all()  # the floor hides most of one


def test_predictive_band_has_the_tails(small: Measurement) -> None:
    """Its 90 % interval at a known curve is that of t with four degrees of freedom."""
    posterior = build(small, noise="iid", tails="student-t")
    draws = np.repeat(point(posterior)[None], 2000, axis=0)
    band = predict_bands(
        posterior, draws, draws[0], targets_at(small.brdf), np.random.default_rng(0)
    )
    width = np.log(band.predictive[:, -1] / band.at_map) / 0.02
    assert width.mean() == pytest.approx(stats.t.ppf(0.95, 4.0), rel=0.01)
    assert np.abs(width - width.mean()).max() < 0.3


def test_no_brdf_rows_need_no_filter(make_measurement: Any) -> None:
    m = make_measurement([("dhr", "s", 20.0, np.nan, 0.1), ("dhr", "p", 20.0, np.nan, 0.1)])
    posterior = build(m, tails="student-t")
    assert posterior.filtered is None
    assert prepare_filtered(m, posterior.rows, posterior.config, None, everything=True) is None
    x = np.array([POINT[name] for name in posterior.parameter_names])
    assert standardised_innovations(posterior, x, np.random.default_rng(0)).shape == (0,)
    assert np.isfinite(posterior.log_prob(x[None])).all()
