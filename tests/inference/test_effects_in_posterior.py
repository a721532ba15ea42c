"""Effects in the posterior: parameters, energy, slopes, fixed values."""

from __future__ import annotations

import numpy as np
import pytest

from pbrdf_bayes import (
    GREEN_PAINT,
    ConfigError,
    Effects,
    RunConfig,
    brdf,
    build_posterior,
    simulate_measurement,
)
from pbrdf_bayes.effects_table import EFFECTS
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.sampling import start_walkers

GRID = np.arange(-80.0, 81.0, 10.0)
FIXED_N = {"n": {"kind": "fixed", "value": 1.5}}


@pytest.fixture(scope="module")
def measurement():
    return simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0, 60.0), theta_r_deg=GRID,
        effects=Effects(lambert=0.02, volume=0.01),
    )  # fmt: skip


@pytest.mark.parametrize("name", EFFECTS)
def test_at_the_null_value_the_likelihood_is_that_without_the_effect(measurement, name):
    config = RunConfig(noise="iid", accuracy="reference")
    plain = build_posterior(measurement, config)
    posterior = build_posterior(measurement, RunConfig(**{**vars(config), "effects": (name,)}))
    x = plain.sample_prior(np.random.default_rng(1), 4)
    nulls = {spec.name: spec.null for spec in posterior.specs if spec.null is not None}
    columns = []
    for spec in posterior.specs:
        known = spec.name in plain.parameter_names
        values = x[:, plain.parameter_names.index(spec.name)] if known else nulls[spec.name]
        columns.append(np.broadcast_to(values, 4))
    found = posterior.log_likelihood(np.stack(columns, axis=1))
    np.testing.assert_allclose(found, plain.log_likelihood(x), rtol=1e-8)


@pytest.mark.parametrize("noise", ["iid", "correlated"])
@pytest.mark.parametrize(
    "choices",
    [{"effects": ("lambert", "volume")}, {"line_shape": "cauchy"}, {"effects": ("bulk",)}],
)
def test_slopes_agree_with_richardson_extrapolation(measurement, noise, choices):
    posterior = build_posterior(measurement, RunConfig(noise=noise, priors=FIXED_N, **choices))
    rng = np.random.default_rng(2)
    x = posterior.sample_prior(rng, 200)
    x = x[np.argmax(posterior.log_prob(x))][None, :]
    z = posterior.to_coordinates(x)[0]
    _, slopes = posterior.gradient_coordinates(z[None, :])

    def value(step, i):
        moved = z.copy()
        moved[i] += step
        return posterior.log_prob(posterior.from_coordinates(moved[None, :]))[0]

    for i in range(z.size):
        d = [(value(h, i) - value(-h, i)) / (2.0 * h) for h in (1e-3, 5e-4)]
        extrapolated = (4.0 * d[1] - d[0]) / 3.0
        assert slopes[0, i] == pytest.approx(extrapolated, rel=1e-3, abs=0.05)


def test_a_fixed_parameter_stays_where_it_is(measurement):
    posterior = build_posterior(measurement, RunConfig(priors=FIXED_N))
    assert "n" in posterior.parameter_names
    assert posterior.free.size == posterior.n_par - 1
    x = posterior.sample_prior(np.random.default_rng(1), 5)
    np.testing.assert_array_equal(x[:, 0], 1.5)
    z = posterior.to_coordinates(x)
    assert z.shape == (5, posterior.n_par - 1)
    np.testing.assert_allclose(posterior.from_coordinates(z), x, rtol=1e-14)
    moved = x.copy()
    moved[:, 0] = 1.6
    assert np.all(np.isneginf(posterior.log_prob(moved)))


def test_more_light_than_came_in_has_no_probability(measurement):
    posterior = build_posterior(measurement, RunConfig(effects=("lambert",), noise="iid"))
    x = posterior.sample_prior(np.random.default_rng(1), 500)
    assert np.all(np.isfinite(posterior.log_prior(x)))
    x[:, posterior.parameter_names.index("sigma_n0")] = 0.9
    x[:, posterior.parameter_names.index("lambert")] = 0.9
    assert np.all(np.isneginf(posterior.log_prior(x)))


def test_priors_that_leave_no_sample_are_refused(measurement):
    priors = {"lambert": {"kind": "fixed", "value": 1.0}}
    posterior = build_posterior(measurement, RunConfig(effects=("lambert",), priors=priors))
    with pytest.raises(ConfigError, match="reflect more than they receive"):
        posterior.sample_prior(np.random.default_rng(1), 4)


def test_something_has_to_be_left_to_infer(measurement):
    values = {"n": 1.5, "k": 0.1, "sigma_n0": 0.4, "rho0": 0.4}
    priors = {name: {"kind": "fixed", "value": v} for name, v in values.items()}
    with pytest.raises(ConfigError, match="every parameter of the sample is fixed"):
        build_posterior(measurement, RunConfig(priors=priors))
    assert build_posterior(measurement, RunConfig(priors=priors, effects=("lambert",))).n_par > 4


def test_walkers_start_anywhere_in_the_prior_where_no_other_place_is_found(measurement):
    posterior = build_posterior(measurement, RunConfig(priors=FIXED_N, effects=("lambert",)))
    n = posterior.free.size
    elsewhere = Mixture(np.full((1, n), 50.0), 1e-6 * np.eye(n)[None], np.ones(1))
    z = start_walkers(posterior, elsewhere, 8, 1)
    assert z.shape == (8, n)
    assert np.all(np.isfinite(posterior.log_prior(posterior.from_coordinates(z))))


def test_the_optimum_finds_what_was_simulated(measurement):
    config = RunConfig(noise="iid", effects=("lambert", "volume"))
    posterior = build_posterior(measurement, config)
    best = dict(zip(posterior.parameter_names, find_map(posterior, seed=1).best.x, strict=True))
    assert best["lambert"] == pytest.approx(0.02, abs=0.002)
    assert best["volume"] == pytest.approx(0.01, abs=0.003)
    assert best["rho0"] == pytest.approx(0.47, rel=0.05)


def test_prediction_is_that_of_the_model_itself(measurement):
    posterior = build_posterior(measurement, RunConfig(effects=("lambert",), accuracy="reference"))
    x = posterior.sample_prior(np.random.default_rng(1), 1)
    at = posterior.parameter_names.index("lambert")
    x[0, :4], x[0, at] = GREEN_PAINT.as_array(), 0.03
    found, _ = posterior.predict(x)
    scan = measurement.scans[0]
    expected = brdf(
        GREEN_PAINT, scan.theta_i_deg, measurement.brdf.theta_r_deg[scan.rows], scan.polarization,
        effects=Effects(lambert=0.03), rtol=1e-10,
    )  # fmt: skip
    np.testing.assert_allclose(found[0, scan.rows], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        (("lambert", "bulk"), "alternative"),
        (("lambert", "lambert"), "twice"),
        (("lambrt",), "Did you mean 'lambert'"),
        (("auto", "lambert"), "auto"),
    ],
)
def test_effects_that_cannot_be_asked_for(effects, words):
    with pytest.raises(ConfigError, match=words):
        RunConfig(effects=effects)
