"""Power scaling against a conjugate normal, whose scaled posteriors are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.stats import norm

from pbrdf_bayes.inference.arviz_adapter import power_scaling
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.power_scaling import PriorSensitivity, measure_sensitivity
from pbrdf_bayes.inference.sampling.sampling import Draws
from pbrdf_bayes.verdicts.predictive_checks import judge_prior
from pbrdf_bayes.words import say

Array = NDArray[np.float64]


def distance(p: Array, q: Array, x: Array) -> float:
    """Cumulative Jensen-Shannon distance of two distribution functions on a grid (Eq. 8)."""

    def one(a: Array, b: Array) -> float:
        return float(
            trapezoid(a * np.log2(a / (0.5 * (a + b))), x) + 0.5 / np.log(2) * trapezoid(b - a, x)
        )

    return float(((one(p, q) + one(q, p)) / trapezoid(p + q, x)) ** 0.5)


def exact(prior: tuple[float, float], likelihood: tuple[float, float], which: str) -> float:
    """Sensitivity of a normal mean: precisions add, a power multiplies one of them."""

    def law(power: float) -> Any:
        a = prior[1] ** -2 * (power if which == "prior" else 1.0)
        b = likelihood[1] ** -2 * (power if which == "likelihood" else 1.0)
        return norm((a * prior[0] + b * likelihood[0]) / (a + b), (a + b) ** -0.5)

    base = law(1.0)
    # from the first to the last draw, as an empirical distribution function ends there
    x = np.linspace(base.ppf(1e-5), base.ppf(1.0 - 1e-5), 40_001)
    found = []
    for power in (0.99, 1.01):
        up = distance(base.cdf(x), law(power).cdf(x), x)
        down = distance(base.sf(x), law(power).sf(x), x)
        found.append(max(up, down) / abs(np.log2(power)))
    return float(np.mean(found))


@pytest.mark.parametrize(
    ("prior", "likelihood"),
    [((0.0, 1.0), (3.0, 1.0)), ((0.0, 0.3), (0.2, 1.0)), ((0.0, 10.0), (0.0, 1.0))],
)
@pytest.mark.parametrize("which", ["prior", "likelihood"])
def test_a_conjugate_normal(
    which: str, prior: tuple[float, float], likelihood: tuple[float, float]
) -> None:
    precision = prior[1] ** -2 + likelihood[1] ** -2
    mean = (prior[0] * prior[1] ** -2 + likelihood[0] * likelihood[1] ** -2) / precision
    draws = np.random.default_rng(1).normal(mean, precision**-0.5, (4, 10_000))
    law = norm(*(prior if which == "prior" else likelihood))
    found = power_scaling(draws[:, :, None], law.logpdf(draws))[0]
    assert found == pytest.approx(exact(prior, likelihood, which), rel=0.05, abs=2e-3)


def test_a_flat_prior_has_no_power() -> None:
    draws = np.random.default_rng(1).standard_normal((4, 500, 2))
    np.testing.assert_array_equal(power_scaling(draws, np.full((4, 500), -1.3)), [0.0, 0.0])


def draws_of(x: Array, log_prob: Array) -> Draws:
    n = np.full(x.shape[2], 1000.0)
    return Draws(
        x=x, log_prob=log_prob, ensemble=np.arange(4), acceptance=np.ones(4), ess_bulk=n, ess_tail=n,
        rhat=n, mcse_mean=n, method="psis", converged=True, n_steps=1, n_burn=0, thin=1,
        autocorrelation_time=1.0, k_hat=0.1, n_evaluations=1, moves="",
    )  # fmt: skip


def test_draws_of_the_prior_are_the_priors(small_posterior: Posterior) -> None:
    """Without a likelihood nothing is sensitive to it, and n (normal) is to its prior."""
    x = small_posterior.sample_prior(np.random.default_rng(1), 8000)
    z = small_posterior.to_coordinates(x)
    jacobian = z[:, small_posterior.is_log].sum(axis=1)
    log_prob = small_posterior.log_prior(x) + jacobian
    found = measure_sensitivity(
        small_posterior, draws_of(x.reshape(4, 2000, -1), log_prob.reshape(4, 2000))
    )
    assert found.names == ("n", "k", "sigma_n0", "rho0")
    np.testing.assert_allclose(found.likelihood, 0.0, atol=1e-9)
    assert found.prior[0] > 0.05
    assert found.prior[1] > 0.05
    assert np.all(found.prior[2:] < 0.02), "flat in their coordinates"
    assert np.all(np.abs(found.displacement) < 0.3)
    verdict = judge_prior(found)
    assert verdict.verdict == "WARN"
    assert say("prior_sensitivity.dominated", names="n, k") in verdict.advice


ONE = PriorSensitivity(
    ("n", "k"), np.array([0.01, 0.01]), np.array([0.1, 0.1]), np.array([0.1, 0.1])
)


@pytest.mark.parametrize(
    ("changes", "verdict", "kind", "names"),
    [
        ({}, "PASS", "", ""),
        ({"prior": np.array([0.2, 0.0]), "likelihood": np.array([0.02, 0.1])}, "WARN", "dominated", "n"),
        ({"prior": np.array([0.0, 0.2]), "displacement": np.array([0.0, 3.0])}, "WARN", "pulled", "k"),
        ({"prior": np.array([0.2, 0.2])}, "WARN", "shared", "n, k"),
    ],
)  # fmt: skip
def test_verdicts_on_the_prior(
    changes: dict[str, Any], verdict: str, kind: str, names: str
) -> None:
    found = judge_prior(replace(ONE, **changes))
    assert found.verdict == verdict
    assert found.advice == (say(f"prior_sensitivity.{kind}", names=names) if kind else "")
