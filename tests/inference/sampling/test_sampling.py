"""The sampler on known laws: moves keep them invariant, draws have their moments, seeds decide.

Invariance is tested exactly: walkers that start as independent draws of the target are
independent draws of it after any number of correct moves, so that their distribution can be held
against the target's without regard to autocorrelation. A wrong acceptance factor must show.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds, find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.importance import ImportanceDraws
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.moves import choose_moves, independence_move
from pbrdf_bayes.inference.sampling.sampling import (
    Draws,
    Progress,
    sample_posterior,
    start_walkers,
)

Array = NDArray[np.float64]
MakeLaw = Callable[..., Posterior]
N_WALKERS = 1000
CENTRE, SPREAD, TILT = 0.5, 0.3, 0.8


class Target:
    """Independent draws, log-density, two standard uniforms, and a proposal that is not the law."""

    def __init__(self, draw: Any, log_density: Any, to_uniform: Any, proposal: Mixture) -> None:
        self.draw, self.log_density, self.to_uniform = draw, log_density, to_uniform
        self.proposal = proposal


def two_bumps(first: list[float], second: list[float], width: float) -> Mixture:
    """A tilted component of weight 0.6 and a round one."""
    tilted, round_ = [[1.0, 0.0], [0.4, 1.0]], [[1.2, 0.0], [0.0, 1.2]]
    return Mixture(
        np.array([first, second]), width * np.array([tilted, round_]), np.array([0.6, 0.4])
    )


def _correlated() -> Target:
    covariance = np.array([[1.0, TILT], [TILT, 1.0]])
    law = stats.multivariate_normal([CENTRE, -CENTRE], SPREAD**2 * covariance)

    def to_uniform(z: Array) -> Array:
        a = (z[:, 0] - CENTRE) / SPREAD
        b = ((z[:, 1] + CENTRE) / SPREAD - TILT * a) / math.sqrt(1.0 - TILT**2)
        return np.asarray(stats.norm.cdf(np.stack([a, b], axis=1)))

    proposal = two_bumps([0.3, -0.7], [0.9, -0.2], 0.25)
    return Target(lambda rng, n: law.rvs(n, random_state=rng), law.logpdf, to_uniform, proposal)


def _banana() -> Target:
    def draw(rng: np.random.Generator, n: int) -> Array:
        x = rng.standard_normal(n)
        return np.stack([x, x**2 + 0.5 * rng.standard_normal(n)], axis=1)

    def log_density(z: Array) -> Array:
        return np.asarray(-0.5 * z[:, 0] ** 2 - 2.0 * (z[:, 1] - z[:, 0] ** 2) ** 2)

    def to_uniform(z: Array) -> Array:
        return np.asarray(
            stats.norm.cdf(np.stack([z[:, 0], (z[:, 1] - z[:, 0] ** 2) / 0.5], axis=1))
        )

    return Target(draw, log_density, to_uniform, two_bumps([0.3, 0.0], [0.5, 1.0], 1.0))


def _truncated() -> Target:
    """A normal cut at 0 and an exponential cut at 1: mass piled up against bounds."""
    first, second = stats.truncnorm(0.0, np.inf), stats.truncexpon(2.0, scale=0.5)

    def draw(rng: np.random.Generator, n: int) -> Array:
        return np.stack([first.rvs(n, random_state=rng), second.rvs(n, random_state=rng)], axis=1)

    def log_density(z: Array) -> Array:
        return np.asarray(first.logpdf(z[:, 0]) + second.logpdf(z[:, 1]))

    def to_uniform(z: Array) -> Array:
        return np.stack([first.cdf(z[:, 0]), second.cdf(z[:, 1])], axis=1)

    return Target(draw, log_density, to_uniform, two_bumps([0.3, 0.0], [0.5, 1.0], 0.8))


TARGETS = {"correlated": _correlated(), "banana": _banana(), "truncated": _truncated()}
GOOD = ImportanceDraws(np.zeros((1, 2)), np.zeros(1), 0.1, 7000.0, 8000)
POOR = ImportanceDraws(np.zeros((1, 2)), np.zeros(1), 0.9, 10.0, 8000)


def p_values(target: Target, moves: Any, n_steps: int, seed: int) -> Array:
    """Kolmogorov-Smirnov p-values of both uniforms and of their product after some steps."""
    start = target.draw(np.random.default_rng(seed), N_WALKERS)
    sampler = emcee.EnsembleSampler(N_WALKERS, 2, target.log_density, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    with np.errstate(divide="ignore"):
        state = sampler.run_mcmc(start, n_steps, skip_initial_state_check=True)
    assert sampler.acceptance_fraction.mean() > 0.05  # moves that move nothing prove nothing
    uniform = target.to_uniform(state.coords)
    joint = uniform[:, 0] * uniform[:, 1]

    def of_product(t: Array) -> Array:
        return np.asarray(t * (1.0 - np.log(np.maximum(t, 1e-300))))

    return np.array(
        [stats.kstest(u, "uniform").pvalue for u in uniform.T]
        + [stats.kstest(joint, of_product).pvalue]
    )


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("choice", ["adapted", "general"])
def test_chosen_moves_leave_the_target_invariant(name: str, choice: str) -> None:
    """As the sampler mixes them."""
    target = TARGETS[name]
    moves, words = choose_moves(target.proposal, GOOD if choice == "adapted" else POOR)
    assert words.startswith("0.70 independence" if choice == "adapted" else "0.50 independence")
    assert sum(share for _, share in moves) == pytest.approx(1.0)
    assert p_values(target, moves, 20, 1).min() > 1e-4


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("choice", ["adapted", "general"])
def test_each_chosen_move_alone_leaves_the_target_invariant(name: str, choice: str) -> None:
    """A wrong move of a small share biases a little: alone it cannot hide.

    emcee 3.1.6: its DESnookerMove divides by the root of the distance and fails this.
    """
    target = TARGETS[name]
    moves, _ = choose_moves(target.proposal, GOOD if choice == "adapted" else POOR)
    found = {type(move).__name__: float(p_values(target, move, 12, 3).min()) for move, _ in moves}
    assert min(found.values()) > 1e-4, found


def test_the_independence_move_proposes_from_the_mixture() -> None:
    """On a flat target every proposal of weight above the last is accepted: q is sampled as is."""
    target = TARGETS["correlated"]
    flat = Target(
        target.draw, lambda z: target.proposal.log_density(z), None, target.proposal
    )  # the target is the proposal: all accepted
    sampler = emcee.EnsembleSampler(
        50, 2, flat.log_density, moves=independence_move(flat.proposal), vectorize=True
    )
    sampler.random_state = np.random.RandomState(1).get_state()
    start = flat.proposal.sample(np.random.default_rng(1), 50)
    sampler.run_mcmc(start, 20, skip_initial_state_check=True)
    assert sampler.acceptance_fraction.min() == 1.0


class ForgottenFactor(emcee.moves.MHMove):
    """The independence move without the ratio of its proposal densities: wrong."""

    def __init__(self, mixture: Mixture) -> None:
        def propose(z: Array, random: Any) -> tuple[Array, Array]:
            rng = np.random.default_rng(random.randint(0, 2**31 - 1, size=4))
            return mixture.sample(rng, len(z)), np.zeros(len(z))

        super().__init__(propose)


class ReversedFactor(emcee.moves.MHMove):
    """The same with the sign of the factor turned: wrong."""

    def __init__(self, mixture: Mixture) -> None:
        def propose(z: Array, random: Any) -> tuple[Array, Array]:
            rng = np.random.default_rng(random.randint(0, 2**31 - 1, size=4))
            new = mixture.sample(rng, len(z))
            return new, mixture.log_density(new) - mixture.log_density(z)

        super().__init__(propose)


@pytest.mark.parametrize("wrong", [ForgottenFactor, ReversedFactor])
@pytest.mark.parametrize("name", TARGETS)
def test_negative_control_a_wrong_factor_is_found(name: str, wrong: Any) -> None:
    target = TARGETS[name]
    assert p_values(target, wrong(target.proposal), 12, 3).min() < 1e-6


# -------------------------------------------------------------------------------- the whole way

MEAN = np.array([0.4, 2.0])


def box_law(x: Array) -> Array:
    """x normal, cut at its mean from below; y log-normal: moments in closed form."""
    return np.asarray(
        -0.5 * ((x[:, 0] - MEAN[0]) / 0.2) ** 2 - 0.5 * (np.log(x[:, 1] / MEAN[1]) / 0.5) ** 2
    )


@pytest.fixture(scope="module")
def law(make_law: MakeLaw) -> Posterior:
    """x in [0.4, 5], prior 1/y on [1e-3, 1e3]: p(y) is LogNormal(ln 2, 0.5)."""
    return make_law(box_law, [MEAN[0], 1e-3], [5.0, 1e3], log_coordinate=[False, True])


@pytest.fixture(scope="module")
def start(law: Posterior) -> Mixture:
    return laplace_mixture(law, find_map(law, seed=1))


def config(**choices: Any) -> pb.RunConfig:
    return pb.RunConfig(**({"accuracy": "draft", "n_walkers": 16, "threads": 1} | choices))


def draw(law: Posterior, start: Mixture, method: str, seed: int = 1, **choices: Any) -> Draws:
    return sample_posterior(law, start, config(**choices), method=method, seed=seed)


@pytest.mark.parametrize("method", ["psis", "emcee"])
def test_draws_have_the_moments_of_the_law(law: Posterior, start: Mixture, method: str) -> None:
    """Mean, deviation and tail probabilities within five errors from the reported sample size."""
    draws = draw(law, start, method)
    assert draws.converged
    assert draws.method == method
    x, y = draws.flat.T
    half, log_normal = stats.halfnorm(MEAN[0], 0.2), stats.lognorm(0.5, scale=2.0)
    for values, wanted, ess, tail in (
        (x, half, draws.ess_bulk[0], draws.ess_tail[0]),
        (y, log_normal, draws.ess_bulk[1], draws.ess_tail[1]),
    ):
        ess = min(ess, float(values.size))
        assert abs(values.mean() - wanted.mean()) < 5.0 * wanted.std() / math.sqrt(ess)
        kurtosis = float(wanted.stats("k")) + 3.0
        spread = math.sqrt((kurtosis - 1.0) / ess)
        assert abs(values.var() / wanted.var() - 1.0) < 5.0 * spread
        for probability in (0.05, 0.95):
            found = np.mean(values < wanted.ppf(probability))
            assert abs(found - probability) < 5.0 * math.sqrt(0.0475 / min(tail, values.size))


@pytest.mark.parametrize(("k_hat", "ess"), [(0.8, 5000.0), (0.2, 100.0), (math.inf, 0.0)])
def test_psis_falls_through_to_the_sampler(
    k_hat: float, ess: float, law: Posterior, start: Mixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Pareto shape above its limit or too few effective draws: neither is used as it is."""
    from pbrdf_bayes.inference.sampling import sampling

    def poor(*_: Any, **__: Any) -> ImportanceDraws:
        return ImportanceDraws(np.zeros((4000, 2)), np.zeros(4000), k_hat, ess, 8000)

    monkeypatch.setattr(sampling, "importance_sample", poor)
    draws = draw(law, start, "psis", max_steps=100)
    assert draws.method == "emcee"
    assert draws.k_hat == k_hat
    assert not np.any(draws.x[:, :, 1] == 1.0)  # exp(0): none of the poor draws


def test_walkers_that_never_move_end_as_not_converged(make_law: MakeLaw) -> None:
    """Every point is far worse than all before it: no proposal is ever accepted."""
    calls = [0.0]

    def ever_worse(x: Array) -> Array:
        calls[0] -= 1e6
        return np.full(len(x), calls[0])

    stuck = make_law(ever_worse, [-1.0, -1.0], [1.0, 1.0])
    start = Mixture(np.zeros((1, 2)), 0.1 * np.eye(2)[None], np.ones(1))
    draws = sample_posterior(stuck, start, config(max_steps=100), method="emcee", seed=1)
    assert not draws.converged
    assert draws.acceptance.max() == 0.0


@pytest.mark.parametrize("method", ["psis", "emcee"])
def test_same_seed_same_draws_bit_for_bit_whatever_the_threads(
    law: Posterior, start: Mixture, method: str
) -> None:
    first, again, threaded, other = (
        draw(law, start, method, seed=seed, threads=threads, max_steps=100)
        for seed, threads in ((1, 1), (1, 1), (1, 2), (2, 1))
    )
    for same in (again, threaded):
        np.testing.assert_array_equal(first.x, same.x)
        np.testing.assert_array_equal(first.log_prob, same.log_prob)
        assert first.n_steps == same.n_steps
    assert first.x.shape != other.x.shape or np.all(first.x[:, -1] != other.x[:, -1])


def test_ensembles_do_not_repeat_each_other(law: Posterior, start: Mixture) -> None:
    draws = draw(law, start, "emcee", max_steps=100)
    assert sorted(set(draws.ensemble.tolist())) == [0, 1, 2, 3]
    last = draws.x[:, -1, 0].reshape(4, -1)
    assert np.unique(last).size > 0.9 * last.size


def test_a_record_of_draws_is_consistent(law: Posterior, start: Mixture) -> None:
    draws = draw(law, start, "emcee", n_ensembles=5)
    n_chains, n_draws, n_par = draws.x.shape
    assert (n_chains, n_par) == (5 * 16, 2)
    assert draws.log_prob.shape == (n_chains, n_draws)
    assert draws.ensemble.tolist() == np.repeat(np.arange(5), 16).tolist()
    assert draws.flat.shape == (n_chains * n_draws, 2)
    assert 0.0 < draws.acceptance.min() <= draws.acceptance.max() <= 1.0
    for array in (draws.ess_bulk, draws.ess_tail, draws.rhat, draws.mcse_mean):
        assert array.shape == (2,)
    assert draws.n_burn + n_draws * draws.thin >= draws.n_steps > draws.n_burn
    assert draws.n_evaluations == draws.n_steps * n_chains
    assert np.all(draws.x[..., 0] >= MEAN[0])
    z = law.to_coordinates(draws.flat)
    np.testing.assert_allclose(law.log_prob_coordinates(z), draws.log_prob.ravel(), rtol=1e-9)


def test_a_budget_that_is_too_small_ends_as_not_converged(law: Posterior, start: Mixture) -> None:
    draws = draw(law, start, "emcee", max_steps=100, accuracy="reference")
    assert not draws.converged
    assert draws.n_steps == 100
    assert np.all(np.isfinite(draws.x))


def test_convergence_needs_two_rounds_in_a_row(law: Posterior, start: Mixture) -> None:
    """It is not declared at the first look, whatever that shows."""
    seen: list[Progress] = []
    draws = sample_posterior(law, start, config(), method="emcee", seed=1, progress=seen.append)
    assert draws.converged
    assert len(seen) >= 2
    assert seen[-1].n_steps == draws.n_steps
    assert [p.n_steps for p in seen] == sorted({p.n_steps for p in seen})
    assert all(p.ess_target == 400 for p in seen)
    assert all(p.seconds_left >= 0.0 for p in seen)
    for p in seen[-2:]:
        assert p.ess >= 400.0
        assert p.rhat < 1.01


def test_reported_errors_of_resampled_means_are_honest(law: Posterior, start: Mixture) -> None:
    """Scatter of the mean over seeds in units of the reported standard error.

    Of 40 seeds and two parameters the ratio is known to 1/sqrt(156) = 0.08: below 1 + 3 x 0.08.
    """
    runs = [draw(law, start, "psis", seed=seed) for seed in range(10, 50)]
    assert {run.method for run in runs} == {"psis"}
    scatter = np.std([run.flat.mean(axis=0) for run in runs], axis=0, ddof=1)
    reported = np.mean([run.mcse_mean for run in runs], axis=0)
    assert np.sqrt(np.mean((scatter / reported) ** 2)) < 1.24, scatter / reported


def test_no_more_effective_draws_than_draws(law: Posterior, start: Mixture) -> None:
    """Resampled draws: however good the weights, n draws are worth no more than n."""
    draws = draw(law, start, "psis")
    assert draws.ess_bulk.max() <= len(draws.flat)


def test_walkers_start_overdispersed_and_inside(law: Posterior, start: Mixture) -> None:
    walkers = start_walkers(law, start, 400, seed=5)
    low, high = coordinate_bounds(law)
    assert walkers.shape == (400, 2)
    assert np.all((walkers > low) & (walkers < high))
    assert np.all(np.isfinite(law.log_prob_coordinates(walkers)))
    assert walkers[:, 1].std() > 1.5 * 0.5
    np.testing.assert_array_equal(walkers, start_walkers(law, start, 400, seed=5))


def test_walkers_are_found_even_where_the_proposal_is_useless(law: Posterior) -> None:
    """Filled up from the prior."""
    elsewhere = Mixture(np.array([[-500.0, 900.0]]), 1e-3 * np.eye(2)[None], np.ones(1))
    walkers = start_walkers(law, elsewhere, 32, seed=5)
    assert walkers.shape == (32, 2)
    assert np.all(np.isfinite(law.log_prob_coordinates(walkers)))


def test_global_random_state_is_neither_used_nor_touched(law: Posterior, start: Mixture) -> None:
    np.random.seed(0)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # type: ignore[index, union-attr]  # noqa: NPY002
    first = draw(law, start, "emcee", max_steps=100)
    after = np.random.get_state()[1]  # type: ignore[index]  # noqa: NPY002
    np.testing.assert_array_equal(before, after)
    np.random.seed(99)  # noqa: NPY002
    np.testing.assert_array_equal(draw(law, start, "emcee", max_steps=100).x, first.x)


def test_a_dielectric_is_fitted() -> None:
    """k = 0 is the end of its support, where the Hessian knows nothing of the width of k."""
    paint = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.4, rho0=0.3)
    measurement = pb.simulate_measurement(paint, seed=3)
    analysis = pb.fit(measurement, pb.RunConfig(accuracy="draft", holdout=False))
    assert analysis.summary["status"] == "done"
    assert analysis.summary["sampling"]["method"] == "psis"
    for name, truth in (("n", 1.5), ("sigma_n0", 0.4), ("rho0", 0.3)):
        found = analysis.summary["parameters"][name]
        assert abs(found["mean"] - truth) < 4.0 * found["sd"]
    assert analysis.summary["parameters"]["k"]["q025"] < 1e-4
