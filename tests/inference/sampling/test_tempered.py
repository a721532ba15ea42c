"""Tempered particles have the law of the posterior, from the prior alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.sampling import Draws, sample_posterior
from pbrdf_bayes.inference.sampling.tempered import _Straight, tempered_particles

Array = NDArray[np.float64]
N = 1_000


def normal(x: Array) -> Array:
    return np.asarray(-0.5 * ((x[:, 0] - 0.3) / 0.01) ** 2 - 0.5 * ((x[:, 1] + 0.2) / 0.1) ** 2)


def banana(x: Array) -> Array:
    return np.asarray(-0.5 * (x[:, 0] / 0.4) ** 2 - 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.02) ** 2)


def two_modes(x: Array) -> Array:
    low, high = (-0.5 * ((x - centre) / 0.05) ** 2 for centre in (-0.6, 0.6))
    return np.asarray(np.logaddexp(np.log(0.25) + low.sum(1), np.log(0.75) + high.sum(1)))


def test_a_narrow_normal_law(make_law: Callable[..., Posterior]) -> None:
    z = tempered_particles(make_law(normal, [-1.0, -1.0], [1.0, 1.0]), seed=1)
    error = np.array([0.01, 0.1]) / np.sqrt(0.2 * N)  # moves leave some correlation
    assert z.shape == (N, 2)
    np.testing.assert_array_less(np.abs(z.mean(axis=0) - [0.3, -0.2]), 4.0 * error)
    np.testing.assert_allclose(z.std(axis=0), [0.01, 0.1], rtol=0.15)


def test_both_arms_of_a_banana(make_law: Callable[..., Posterior]) -> None:
    z = tempered_particles(make_law(banana, [-1.5, -1.5], [1.5, 1.5]), seed=2)
    assert z[:, 0].std() == pytest.approx(0.4, rel=0.15)
    assert np.std(z[:, 1] - z[:, 0] ** 2) == pytest.approx(0.02, rel=0.15)


def test_two_modes_keep_their_shares(make_law: Callable[..., Posterior]) -> None:
    z = tempered_particles(make_law(two_modes, [-1.0, -1.0], [1.0, 1.0]), seed=3)
    assert np.mean(z[:, 0] > 0.0) == pytest.approx(0.75, abs=0.1)


def test_the_seed_decides_and_threads_do_not(make_law: Callable[..., Posterior]) -> None:
    law = make_law(normal, [-1.0, -1.0], [1.0, 1.0])
    one = tempered_particles(law, seed=5)
    np.testing.assert_array_equal(one, tempered_particles(law, seed=5, threads=2))
    assert (one != tempered_particles(law, seed=6)).any()


def test_straight_coordinates_keep_the_density(small_posterior: Posterior) -> None:
    """Ln sigma_N0 F(0) for sigma_N0: the Jacobian by differences, and back again."""
    straight = _Straight(small_posterior, 1)
    x = small_posterior.sample_prior(np.random.default_rng(1), 5)
    z = small_posterior.to_coordinates(x)
    w = straight.from_z(z)
    np.testing.assert_allclose(straight.to_z(w), z, rtol=1e-13)
    reflectance = ((x[:, 0] - 1) ** 2 + x[:, 1] ** 2) / ((x[:, 0] + 1) ** 2 + x[:, 1] ** 2)
    np.testing.assert_allclose(np.exp(w[:, 2]), x[:, 2] * reflectance, rtol=1e-13)
    found = straight.evaluate(w)
    shift = found.log_prior + found.log_likelihood - small_posterior.log_prob_coordinates(z)
    step = np.zeros(w.shape[1])
    step[2] = 1e-6
    slope = (straight.to_z(w + step) - straight.to_z(w - step))[:, 2] / 2e-6
    np.testing.assert_allclose(shift, np.log(slope), atol=1e-7)


def fitted(measurement: pb.Measurement, method: str, **choices: object) -> Draws:
    posterior = pb.build_posterior(measurement, pb.RunConfig(accuracy="draft", **choices))  # type: ignore[arg-type]
    laplace = laplace_mixture(posterior, find_map(posterior, n_starts=8, seed=1))
    return sample_posterior(posterior, laplace, posterior.config, method=method, seed=1)


@pytest.mark.slow
def test_few_readings_come_out_as_a_long_walk_has_them() -> None:
    """One s scan and the s DHR: n, k and sigma_N0 lie on a thin curved sheet."""
    measurement = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=4, theta_i_deg=(0.0,), polarizations=("s",),
        theta_r_deg=np.linspace(-80.0, 80.0, 81),
    )  # fmt: skip
    quick, walk = fitted(measurement, "psis"), fitted(measurement, "emcee")
    assert (quick.method, walk.method) == ("psis", "emcee")
    assert walk.converged
    assert quick.n_evaluations <= 8_000
    sd = walk.flat.std(axis=0)
    error = np.hypot(1.0 / np.sqrt(quick.ess_bulk), walk.mcse_mean / sd)
    apart = np.abs(quick.flat.mean(axis=0) - walk.flat.mean(axis=0)) / sd
    np.testing.assert_array_less(apart, 4.0 * error)
    np.testing.assert_allclose(quick.flat.std(axis=0) / sd, 1.0, atol=0.15)
