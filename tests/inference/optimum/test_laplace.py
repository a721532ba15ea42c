"""Laplace approximation, mixtures and importance sampling on laws known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import MapResult, Optimum, find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.importance import (
    ImportanceDraws,
    adapt_mixture,
    importance_sample,
    k_hat_limit,
)
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture

Array = NDArray[np.float64]
MakeLaw = Callable[..., Posterior]
MEAN = np.array([0.4, -1.0, 2.0])
COVARIANCE = np.array([[0.04, 0.018, 0.0], [0.018, 0.01, 0.002], [0.0, 0.002, 0.09]])


def gaussian(mean: Array, covariance: Array) -> Callable[[Array], Array]:
    law = stats.multivariate_normal(mean, covariance)
    return lambda x: np.atleast_1d(law.logpdf(x))


@pytest.fixture(scope="module")
def normal_law(make_law: MakeLaw) -> Posterior:
    """A correlated normal posterior far from its bounds: log-density up to 3 ln 10 of the prior."""
    return make_law(gaussian(MEAN, COVARIANCE), [-5.0] * 3, [5.0] * 3)


@pytest.fixture(scope="module")
def normal_mixture(normal_law: Posterior) -> Mixture:
    return laplace_mixture(normal_law, find_map(normal_law, seed=1))


def within_error(draws: Array, ess: float, mean: Array, covariance: Array) -> None:
    """Mean and variances within five Monte Carlo standard errors of normal draws."""
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5.0 * sd / math.sqrt(ess))
    spread = draws.var(axis=0) / sd**2
    assert np.all(np.abs(spread - 1.0) < 5.0 * math.sqrt(2.0 / ess))


def test_laplace_is_exact_on_a_normal_posterior(normal_mixture: Mixture) -> None:
    """Scale matrix = covariance; second differences of a quadratic are exact but for rounding:

    eps |ln p| / step^2 = 1e-15/4e-8 in units of the inverse variance of about 100.
    """
    assert normal_mixture.weights.tolist() == [1.0]
    np.testing.assert_allclose(normal_mixture.centres[0], MEAN, atol=1e-4)
    factor = normal_mixture.factors[0]
    np.testing.assert_array_equal(np.triu(factor, 1), 0.0)
    np.testing.assert_allclose(factor @ factor.T, COVARIANCE, rtol=1e-4, atol=1e-6)


def test_laplace_uses_logarithmic_coordinates(make_law: MakeLaw) -> None:
    """A log-normal posterior is normal in z: density in x with the prior 1/x undone."""
    law = make_law(
        lambda x: -0.5 * ((np.log(x[:, 0]) - math.log(0.2)) / 0.3) ** 2, [1e-4], [1e2],
        log_coordinate=[True],
    )  # fmt: skip
    mixture = laplace_mixture(law, find_map(law, seed=1))
    # the MAP in x is at mu - sigma^2, where the curvature in z is still 1/sigma^2
    assert mixture.factors[0][0, 0] == pytest.approx(0.3, rel=1e-4)
    assert mixture.centres[0][0] == pytest.approx(math.log(0.2) - 0.09, abs=1e-3)


def test_a_direction_without_curvature_is_as_wide_as_its_density(make_law: MakeLaw) -> None:
    """As k at 0: exp(-(x/w)^4) on x >= 0 has the root mean square w sqrt(Gamma(3/4)/Gamma(1/4))."""
    w = 1e-3
    law = make_law(
        lambda x: -0.5 * (x[:, 0] / 0.1) ** 2 - (x[:, 1] / w) ** 4, [-5.0, 0.0], [5.0, 5.0]
    )
    at_bound = MapResult((Optimum(np.array([0.0, 0.0]), 0.0, 1),), 1, 0)
    factor = laplace_mixture(law, at_bound).factors[0]
    sd = np.sqrt(np.diag(factor @ factor.T))
    assert sd[0] == pytest.approx(0.1, rel=1e-3)
    spread = w * math.sqrt(math.gamma(0.75) / math.gamma(0.25))
    assert sd[1] == pytest.approx(spread, rel=0.3)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (5.0, 5.0), (0.0, 5.0)])
def test_a_corner_of_the_support_has_a_width(
    make_law: MakeLaw, corner: tuple[float, float]
) -> None:
    """No axis stays inside on either side: those of the Hessian lie between the coordinates."""
    law = make_law(
        lambda x: -0.5 * ((x[:, 0] - corner[0]) - (x[:, 1] - corner[1])) ** 2 / 0.01**2,
        [0.0, 0.0], [5.0, 5.0],
    )  # fmt: skip
    at_corner = MapResult((Optimum(np.array(corner), 0.0, 1),), 1, 0)
    factor = laplace_mixture(law, at_corner).factors[0]
    sd = np.sqrt(np.diag(factor @ factor.T))
    assert np.all(sd > 1e-3)


def test_a_flat_direction_gets_a_finite_width(make_law: MakeLaw) -> None:
    law = make_law(lambda x: -0.5 * (x[:, 0] / 0.1) ** 2, [-5.0, -5.0], [5.0, 5.0])
    mixture = laplace_mixture(law, find_map(law, seed=1))
    sd = np.sqrt(np.diag(mixture.factors[0] @ mixture.factors[0].T))
    assert sd[0] == pytest.approx(0.1, rel=1e-3)
    assert 1.0 <= sd[1] <= 10.0


def test_components_weigh_by_their_mass(make_law: MakeLaw) -> None:
    """Two normals of weights 0.8 and 0.2 and different widths: density times volume."""
    wide, narrow = stats.norm(-2.0, 0.6), stats.norm(2.0, 0.15)
    law = make_law(
        lambda x: np.logaddexp(math.log(0.8) + wide.logpdf(x[:, 0]), math.log(0.2) + narrow.logpdf(x[:, 0])),
        [-6.0], [6.0],
    )  # fmt: skip
    mixture = laplace_mixture(law, find_map(law, seed=1))
    by_place = {
        round(float(c[0])): w for c, w in zip(mixture.centres, mixture.weights, strict=True)
    }
    assert by_place[-2] == pytest.approx(0.8, abs=1e-3)
    assert by_place[2] == pytest.approx(0.2, abs=1e-3)


def test_far_optima_are_left_out(normal_law: Posterior) -> None:
    optima = MapResult((Optimum(MEAN, 0.0, 10), Optimum(MEAN + 1.0, -13.0, 6)), 16, 0)
    assert len(laplace_mixture(normal_law, optima).weights) == 1


# -------------------------------------------------------------------------------------- mixtures


def test_mixture_density_is_that_of_scipy() -> None:
    rng = np.random.default_rng(1)
    factors = np.array([np.linalg.cholesky(COVARIANCE), 0.5 * np.eye(3)])
    mixture = Mixture(np.array([MEAN, -MEAN]), factors, np.array([0.3, 0.7]))
    z = rng.normal(size=(50, 3)) * 3.0
    wanted = np.logaddexp.reduce([
        math.log(w) + stats.multivariate_t(c, f @ f.T, df=6).logpdf(z)
        for w, c, f in zip(mixture.weights, mixture.centres, factors, strict=True)
    ], axis=0)  # fmt: skip
    np.testing.assert_allclose(mixture.log_density(z), wanted, rtol=1e-10, atol=1e-10)


def test_mixture_draws_follow_its_density() -> None:
    """One dimension: Kolmogorov-Smirnov against the mixture of t distribution functions."""
    mixture = Mixture(
        np.array([[-1.0], [2.0]]), np.array([[[0.5]], [[1.5]]]), np.array([0.25, 0.75])
    )
    draws = mixture.sample(np.random.default_rng(2), 20_000)[:, 0]

    def cdf(x: Array) -> Array:
        return np.asarray(0.25 * stats.t(6, -1.0, 0.5).cdf(x) + 0.75 * stats.t(6, 2.0, 1.5).cdf(x))

    assert stats.kstest(draws, cdf).pvalue > 1e-3


def test_a_fitted_mixture_has_the_moments_of_its_points() -> None:
    rng = np.random.default_rng(3)
    z = rng.multivariate_normal(MEAN, COVARIANCE, 4000)
    weights = np.full(4000, 1.0 / 4000)
    mixture = fit_mixture(z, weights, 3, rng)
    assert mixture.weights.sum() == pytest.approx(1.0, abs=1e-12)
    draws = mixture.sample(rng, 40_000)
    sd = np.sqrt(np.diag(COVARIANCE))
    # 4000 points fix a mean to sd/63; the defensive component and the t tails widen, never narrow
    assert np.all(np.abs(draws.mean(axis=0) - MEAN) < 0.1 * sd)
    ratio = draws.std(axis=0) / sd
    assert np.all((ratio > 0.95) & (ratio < 1.8))


def test_importance_weights_of_the_points_count() -> None:
    """Points drawn twice as wide, weighted back: the fit is that of the narrow law."""
    rng = np.random.default_rng(4)
    z = rng.normal(0.0, 2.0, size=(20_000, 2))
    log_weights = stats.norm(0.0, 1.0).logpdf(z).sum(axis=1) - stats.norm(0.0, 2.0).logpdf(z).sum(
        axis=1
    )
    weights = np.exp(log_weights - np.logaddexp.reduce(log_weights))
    reference = fit_mixture(rng.normal(size=(20_000, 2)), np.full(20_000, 5e-5), 2, rng)
    found = fit_mixture(z, weights, 2, rng)
    spreads = [m.sample(np.random.default_rng(5), 40_000).std(axis=0) for m in (found, reference)]
    np.testing.assert_allclose(spreads[0], spreads[1], rtol=0.1)


# --------------------------------------------------------------------------- importance sampling


def test_resampled_draws_have_the_moments_of_the_posterior(
    normal_law: Posterior, normal_mixture: Mixture
) -> None:
    found = importance_sample(normal_law, normal_mixture, n_proposals=8000, n_draws=4000, seed=1)
    assert found.z.shape == (4000, 3)
    assert found.k_hat < 0.5
    assert found.usable(1000)
    assert 4000 < found.ess <= 8000
    assert found.n_evaluations == 8000
    within_error(found.z, min(found.ess, 4000.0), MEAN, COVARIANCE)
    np.testing.assert_allclose(found.log_prob, normal_law.log_prob_coordinates(found.z), rtol=1e-12)


def test_resampling_corrects_a_shifted_proposal(normal_law: Posterior) -> None:
    """Half a standard deviation off and 1.3 times too wide: corrected within the error."""
    factor = 1.3 * np.linalg.cholesky(COVARIANCE)
    shifted = Mixture((MEAN + 0.5 * np.sqrt(np.diag(COVARIANCE)))[None], factor[None], np.ones(1))
    found = importance_sample(normal_law, shifted, n_proposals=8000, n_draws=4000, seed=2)
    assert found.k_hat < 0.7
    within_error(found.z, min(found.ess, 4000.0), MEAN, COVARIANCE)


@pytest.mark.parametrize("fault", ["too narrow", "beside"])
def test_k_hat_flags_a_bad_proposal(fault: str, normal_law: Posterior) -> None:
    factor = np.linalg.cholesky(COVARIANCE)
    bad = {
        "too narrow": Mixture(MEAN[None], 0.1 * factor[None], np.ones(1)),
        "beside": Mixture((MEAN + [1.5, 0.8, -2.0])[None], 0.5 * factor[None], np.ones(1)),  # noqa: RUF005
    }[fault]
    found = importance_sample(normal_law, bad, n_proposals=8000, n_draws=4000, seed=3)
    assert found.k_hat > 0.7
    assert not found.usable(100)


def test_a_proposal_outside_the_support_is_not_usable(normal_law: Posterior) -> None:
    outside = Mixture(np.full((1, 3), 50.0), 1e-3 * np.eye(3)[None], np.ones(1))
    found = importance_sample(normal_law, outside, n_proposals=500, n_draws=100, seed=4)
    assert found.k_hat == math.inf
    assert found.ess == 0.0
    assert not found.usable(1)


def test_draws_are_a_function_of_the_seed(normal_law: Posterior, normal_mixture: Mixture) -> None:
    runs = [
        importance_sample(normal_law, normal_mixture, n_proposals=1000, n_draws=500, seed=s).z
        for s in (5, 5, 6)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_k_hat_limit_is_that_of_the_literature() -> None:
    """min(1 - 1/log10 S, 0.7): Vehtari et al. 2024."""
    assert k_hat_limit(100) == pytest.approx(0.5)
    assert k_hat_limit(1000) == pytest.approx(2.0 / 3.0)
    assert k_hat_limit(10_000) == 0.7
    for k_hat, ess, usable in ((0.66, 500.0, True), (0.67, 500.0, False), (0.1, 399.0, False)):
        draws = ImportanceDraws(np.zeros((1, 1)), np.zeros(1), k_hat, ess, 1000)
        assert draws.usable(400) is usable


def banana(x: Array) -> Array:
    """x ~ N(0, 1), y | x ~ N(x^2, 0.1^2)."""
    return -0.5 * x[:, 0] ** 2 - 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.1) ** 2


def test_a_banana_is_better_covered_but_not_taken_for_a_mixture(make_law: MakeLaw) -> None:
    """E x^2 = 1. The arms, 5 % of the mass, are rarely met: no k-hat tells, the share of effective
    draws does.
    """
    law = make_law(banana, [-8.0, -8.0], [8.0, 40.0])
    start = laplace_mixture(law, find_map(law, seed=1))
    plain = importance_sample(law, start, n_proposals=8000, n_draws=4000, seed=1)
    mixture = adapt_mixture(law, start, seed=1)
    found = importance_sample(law, mixture, n_proposals=8000, n_draws=4000, seed=1)
    assert plain.k_hat > 0.7
    assert found.k_hat < 0.7
    assert found.ess > 1000.0
    assert np.mean(found.z[:, 0] ** 2) < 0.95
    assert not found.usable(400)


def test_adaptation_keeps_both_modes(make_law: MakeLaw) -> None:
    def two(x: Array) -> Array:
        first = math.log(0.7) - 0.5 * np.sum(((x + 2.0) / 0.4) ** 2, axis=1)
        second = math.log(0.3) - 0.5 * np.sum(((x - 2.0) / 0.4) ** 2, axis=1)
        return np.asarray(np.logaddexp(first, second))

    law = make_law(two, [-6.0] * 2, [6.0] * 2)
    mixture = adapt_mixture(law, laplace_mixture(law, find_map(law, seed=2)), seed=2)
    found = importance_sample(law, mixture, n_proposals=8000, n_draws=4000, seed=2)
    assert found.usable(1000)
    share = float(np.mean(found.z[:, 0] < 0.0))
    assert abs(share - 0.7) < 5.0 * math.sqrt(0.21 / min(found.ess, 4000.0))


def test_adaptation_from_a_hopeless_start_gives_the_start_back(normal_law: Posterior) -> None:
    """Nothing inside the support: no fit is made of nothing."""
    outside: Any = Mixture(np.full((1, 3), 500.0), 1e-3 * np.eye(3)[None], np.ones(1))
    assert adapt_mixture(normal_law, outside, seed=1) is outside
