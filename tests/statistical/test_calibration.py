"""Are the intervals what they say? Simulated studies, a dense grid and another sampler.

Small on purpose; the committed study under reports/ is the large one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import dynesty
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.sampling import Draws, sample_posterior
from pbrdf_bayes.measurement import Measurement, measurement_from_columns, select_scans
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]
pytestmark = pytest.mark.slow

N_SIMULATIONS = 40
GRID = np.linspace(-70.0, 70.0, 15)
PHYSICAL = ("n", "k", "sigma_n0", "rho0")
NAMES = (*PHYSICAL, "s_rel_s", "s_rel_p", "u_dhr")
PRIORS: dict[str, Any] = {
    "n": {"kind": "normal", "mean": 1.5, "sd": 0.1},
    "k": {"kind": "uniform", "low": 0.0, "high": 0.5},
    "sigma_n0": {"kind": "uniform", "low": 0.2, "high": 0.9},
    "rho0": {"kind": "loguniform", "low": 0.1, "high": 1.0},
    "s_rel_s": {"kind": "lognormal", "median": 0.02, "factor": 1.5},
    "s_rel_p": {"kind": "lognormal", "median": 0.02, "factor": 1.5},
    "u_dhr": {"kind": "lognormal", "median": 0.002, "factor": 1.5},
}


def config(**priors: Any) -> pb.RunConfig:
    return pb.RunConfig(
        noise="iid", accuracy="draft", priors=PRIORS | priors, threads=1, u_brdf_cal=0.02,
        u_dhr_cal=0.01,
    )  # fmt: skip


def config_for(*names: str) -> pb.RunConfig:
    """With the priors of these parameters only."""
    priors = {name: PRIORS[name] for name in names}
    return pb.RunConfig(
        noise="iid", accuracy="draft", priors=priors, threads=1, u_brdf_cal=0.02, u_dhr_cal=0.01
    )


def experiment(truth: Array, seed: int) -> Measurement:
    """Two scans of 15 readings and six of DHR, with gains and noise as the likelihood has them."""
    n, k, sigma_n0, rho0, s_s, s_p, u_dhr = truth.tolist()
    p = pb.Parameters(n=n, k=k, sigma_n0=sigma_n0, rho0=rho0)
    rng = np.random.default_rng([seed, 99])
    parts = {
        q: simulate_measurement(
            p, seed=int(rng.integers(2**31)), theta_i_deg=(30.0,), theta_r_deg=GRID, polarizations=(q,),
            dhr_theta_i_deg=(10.0, 40.0, 70.0), relative_noise=noise, dhr_noise=u_dhr,
            u_brdf_cal=0.02, u_dhr_cal=0.01,
        )
        for q, noise in (("s", s_s), ("p", s_p))
    }  # fmt: skip

    def column(name: str) -> Array:
        both = [getattr(m.brdf, name) for m in parts.values()]
        both += [getattr(m.dhr, name) for m in parts.values()]
        return np.concatenate(both)

    return measurement_from_columns(
        sample="simulated", wavelength_um=1.0, quantity=["brdf"] * 30 + ["dhr"] * 6,
        polarization=column("polarization"), theta_i_deg=column("theta_i_deg"),
        theta_r_deg=column("theta_r_deg"), value=column("value"),
    )  # fmt: skip


def draw(posterior: Posterior, seed: int, method: str = "psis") -> Draws:
    mixture = laplace_mixture(posterior, find_map(posterior, n_starts=4, seed=seed))
    return sample_posterior(posterior, mixture, posterior.config, method=method, seed=seed)


def ranks(fitted: pb.RunConfig, n: int, first_seed: int) -> Array:
    """Share of the draws below the truth, for truths drawn from the prior: shape (n, 7).

    Uniform where likelihood, prior and sampler fit together (Talts et al. 2018, arXiv:1804.06788).
    """
    found = []
    for seed in range(first_seed, first_seed + n):
        rng = np.random.default_rng([seed, 77])
        template = pb.build_posterior(experiment(np.array([1.5, *[0.1] * 5, 0.001]), 0), config())
        truth = template.sample_prior(rng, 1)[0]
        posterior = pb.build_posterior(experiment(truth, seed), fitted)
        assert posterior.parameter_names == NAMES
        found.append(np.mean(draw(posterior, seed).flat < truth, axis=0))
    return np.array(found)


@pytest.fixture(scope="module")
def honest_ranks() -> Array:
    return ranks(config(), N_SIMULATIONS, 1000)


def covered(share: Array) -> Array:
    """How often the central 90 % interval held the truth."""
    return np.sum((share > 0.05) & (share < 0.95), axis=0)


def test_ninety_per_cent_intervals_cover_ninety_per_cent(honest_ranks: Array) -> None:
    """Each of seven counts within the 99.98 % range of Binomial(40, 0.9): 28 to 40."""
    low, high = stats.binom(N_SIMULATIONS, 0.9).ppf([1e-4, 1.0 - 1e-4])
    counts = covered(honest_ranks)
    assert np.all((counts >= low) & (counts <= high)), dict(zip(NAMES, counts, strict=True))


def test_ranks_of_the_truth_are_uniform(honest_ranks: Array) -> None:
    p_values = {
        name: float(stats.kstest(column, "uniform").pvalue)
        for name, column in zip(NAMES, honest_ranks.T, strict=True)
    }
    assert min(p_values.values()) > 1e-4, p_values


def test_negative_control_a_likelihood_that_is_too_sure_is_found() -> None:
    """Noise held at a quarter of the truth: intervals too narrow, and the study says so."""
    sure = {"kind": "lognormal", "median": 0.005, "factor": 1.001}
    wrong = config(
        s_rel_s=sure, s_rel_p=sure, u_dhr={"kind": "lognormal", "median": 5e-4, "factor": 1.001}
    )
    n = 30
    counts = covered(ranks(wrong, n, 5000))[:4]
    assert counts.min() < stats.binom(n, 0.9).ppf(1e-4), counts


# --------------------------------------------------------------------- against other integrations


@pytest.fixture(scope="module")
def four() -> Posterior:
    """n, k, sigma_N0 and rho0 alone: the noise of the scan is held within 0.1 %."""
    m = experiment(np.array([1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 0.0005]), 3)
    fixed = {"kind": "lognormal", "median": 0.03, "factor": 1.001}
    noise = {"kind": "lognormal", "median": 5e-4, "factor": 1.001}
    choices = config(s_rel_s=fixed, s_rel_p=fixed, u_dhr=noise)
    return pb.build_posterior(m, replace(choices, u_brdf_cal=0.0, u_dhr_cal=0.0))


def grid_moments(posterior: Posterior, half_width: float, n: int) -> tuple[Array, Array]:
    """Means and standard deviations of the physical parameters by the trapezoidal rule.

    The grid stands in the principal axes of the draws' own covariance, so that its step is a
    fraction of a standard deviation in every direction; the noises stay at their medians.
    """
    optimum = find_map(posterior, n_starts=4, seed=1).best.x
    z0 = posterior.to_coordinates(optimum[None, :])[0]
    draws = posterior.to_coordinates(draw(posterior, 11).flat)[:, :4]
    centre, factor = draws.mean(axis=0), np.linalg.cholesky(np.cov(draws.T))
    axis = np.linspace(-half_width, half_width, n)
    steps = np.stack(np.meshgrid(*[axis] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    z = np.tile(z0, (len(steps), 1))
    z[:, :4] = centre + steps @ factor.T
    for i, spec in enumerate(posterior.specs[4:], start=4):
        z[:, i] = np.log(spec.prior.quantile(np.array([0.5])))
    log_prob = posterior.log_prob_coordinates(z)
    weights = np.exp(log_prob - log_prob.max())
    weights /= weights.sum()
    x = posterior.from_coordinates(z)[:, :4]
    mean = weights @ x
    return mean, np.sqrt(weights @ (x - mean) ** 2)


@pytest.fixture(scope="module")
def dense_grid(four: Posterior) -> tuple[Array, Array, Array]:
    """Means, standard deviations, and the error of the means in standard deviations.

    15^4 points over +-5 standard deviations; the error from 12^4 points.
    """
    (coarse, _), (mean, sd) = grid_moments(four, 5.0, 12), grid_moments(four, 5.0, 15)
    return mean, sd, np.abs(mean - coarse) / sd


@pytest.mark.parametrize("method", ["psis", "emcee"])
def test_moments_are_those_of_a_dense_grid(
    four: Posterior, dense_grid: tuple[Array, Array, Array], method: str
) -> None:
    """Where importance sampling does not do, both are emcee's draws."""
    mean, sd, own = dense_grid
    assert own.max() < 0.02
    draws = draw(four, 21, method)
    flat = draws.flat[:, :4]
    ess = np.minimum(draws.ess_bulk[:4], len(flat))
    assert np.all(np.abs(flat.mean(axis=0) - mean) / sd < 5.0 / np.sqrt(ess) + 2.0 * own)
    ratio = flat.std(axis=0) / sd
    # kurtosis up to 5 or so: variance of a standard deviation (k - 1)/4n
    assert np.all(np.abs(ratio - 1.0) < 5.0 / np.sqrt(ess) + 0.02), ratio


def test_another_sampler_agrees() -> None:
    """dynesty on the same log-density: nested sampling from the prior, no start, no proposal.

    One scan and stated DHR uncertainties leave five parameters. With 400 live points a mean is
    known to some sd/sqrt(400): five of those, and five of ours.
    """
    m = experiment(np.array([1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 0.002]), 3)
    m = select_scans(m, np.array([True, False]), dhr=True)
    m = replace(m, dhr=replace(m.dhr, u_value=np.full(6, 0.002)))
    posterior = pb.build_posterior(m, config_for("n", "k", "sigma_n0", "rho0", "s_rel_s"))

    def transform(u: Array) -> Array:
        return posterior.prior_quantile(np.clip(u, 1e-12, 1.0 - 1e-12)[None, :])[0]

    def log_likelihood(x: Array) -> float:
        return float(posterior.log_likelihood(x[None, :])[0])

    sampler = dynesty.NestedSampler(
        log_likelihood, transform, posterior.n_par, nlive=400, sample="rwalk",
        rstate=np.random.default_rng(5),
    )  # fmt: skip
    sampler.run_nested(dlogz=0.5, print_progress=False)
    weights = sampler.results.importance_weights()
    x = sampler.results.samples
    mean = weights @ x
    sd = np.sqrt(weights @ (x - mean) ** 2)
    draws = draw(posterior, 31, "emcee")
    error = 5.0 / np.sqrt(400.0) + 5.0 / np.sqrt(draws.ess_bulk)
    assert np.all(np.abs(draws.flat.mean(axis=0) - mean) / sd < error)
    assert np.all(np.abs(draws.flat.std(axis=0) / sd - 1.0) < error)
