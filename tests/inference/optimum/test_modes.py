"""Two separated modes of n and k: their weights against a dense grid.

One unpolarised DHR reading near normal incidence fixes a ring in the plane of n and k, from n < 1 to
n > 1; a prior of k cuts it into a metal-like (n < k) and a dielectric-like (n > k) mode.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.importance import adapt_mixture
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture
from pbrdf_bayes.inference.sampling.sampling import Draws, sample_posterior
from pbrdf_bayes.measurement import measurement_from_columns

Array = NDArray[np.float64]
EDGE = 2.0
"""n between the modes."""


@pytest.fixture(scope="module")
def ring() -> Posterior:
    """DHR 0.40 +- 0.02 at 8 degrees; k = 1 +- 0.25; sigma_N0 and rho0 as good as known."""
    m = measurement_from_columns(
        sample="ring", wavelength_um=3.39, quantity=["dhr"], polarization=["u"], theta_i_deg=[8.0],
        theta_r_deg=[np.nan], value=[0.4],
    )  # fmt: skip
    m = replace(m, dhr=replace(m.dhr, u_value=np.array([0.02])))
    priors = {
        "k": {"kind": "normal", "mean": 1.0, "sd": 0.25},
        "sigma_n0": {"kind": "uniform", "low": 0.94, "high": 0.96},
        "rho0": {"kind": "lognormal", "median": 0.5, "factor": 1.2},
    }
    config = pb.RunConfig(
        prior="metal", accuracy="draft", priors=priors, u_dhr_cal=0.0, threads=1, n_walkers=16,
        n_ensembles=8, max_steps=200,
    )  # fmt: skip
    return pb.build_posterior(m, config)


@pytest.fixture(scope="module")
def laplace(ring: Posterior) -> Mixture:
    return laplace_mixture(ring, find_map(ring, seed=1))


def reflectance(n: Array, k: Array) -> Array:
    """Unpolarised Fresnel reflectance at 8 degrees, from the textbook."""
    index = n - 1j * k
    cos, sin2 = np.cos(np.deg2rad(8.0)), np.sin(np.deg2rad(8.0)) ** 2
    root = np.sqrt(index**2 - sin2)
    r_s = (cos - root) / (cos + root)
    r_p = (index**2 * cos - root) / (index**2 * cos + root)
    return np.asarray(0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2))


def grid_weight(n_n: int, n_k: int) -> tuple[float, float]:
    """Weight of the metal-like mode, and the least over the greatest marginal density of n between.

    Midpoint rule over the support of n and k, sigma_N0 at nine points; rho0 does not enter.
    """
    n = 0.05 + 5.95 * (np.arange(n_n) + 0.5) / n_n
    k = 0.1 + 3.0 * (np.arange(n_k) + 0.5) / n_k
    f = reflectance(n[:, None], k[None, :])
    prior = np.exp(-0.5 * ((k - 1.0) / 0.25) ** 2)
    sigma = 0.94 + 0.02 * (np.arange(9) + 0.5) / 9
    likelihood = sum(np.exp(-0.5 * ((s * f - 0.4) / 0.02) ** 2) for s in sigma)
    marginal = np.sum(likelihood * prior, axis=1)
    between = marginal[(n > 1.0) & (n < 3.0)].min()
    return float(marginal[n < EDGE].sum() / marginal.sum()), float(between / marginal.max())


@pytest.fixture(scope="module")
def truth() -> float:
    """0.0976, known to 1e-4: the modes are far apart and neither is rare."""
    weight, gap = grid_weight(2000, 600)
    assert gap < 1e-3
    assert abs(weight - grid_weight(1000, 300)[0]) < 1e-4
    assert 0.09 < weight < 0.11
    return weight


def metal_like(draws: Draws) -> Array:
    """Share of the draws of each ensemble in the metal-like mode."""
    low = draws.x[:, :, 0] < EDGE
    return np.array([low[draws.ensemble == e].mean() for e in np.unique(draws.ensemble)])


def test_starts_find_both_modes(ring: Posterior) -> None:
    n = np.array([optimum.x[0] for optimum in find_map(ring, seed=1).optima])
    assert n.min() < 1.0
    assert n.max() > 4.0


def test_importance_sampling_weighs_both_modes(
    ring: Posterior, laplace: Mixture, truth: float
) -> None:
    """Each of six seeds within five errors of its own effective sample size."""
    config = replace(ring.config, max_steps=100)
    for seed in (1, 3, 4, 5, 6, 8):
        draws = sample_posterior(ring, laplace, config, method="psis", seed=seed)
        assert draws.method == "psis"
        found, error = metal_like(draws).mean(), np.sqrt(truth * (1 - truth) / draws.ess_bulk.min())
        assert abs(found - truth) < 5.0 * error, (seed, found, truth, error)


def test_emcee_moves_between_the_modes(ring: Posterior, laplace: Mixture, truth: float) -> None:
    """Error from eight independent ensembles; Student's t of 7 degrees: 5.4 is one in a thousand."""
    draws = sample_posterior(ring, laplace, ring.config, method="emcee", seed=1)
    shares = metal_like(draws)
    error = shares.std(ddof=1) / np.sqrt(len(shares))
    assert error < 0.02
    assert abs(shares.mean() - truth) < 5.4 * error, (shares, truth)
    low = draws.x[:, :, 0] < EDGE
    assert np.mean(np.any(low[:, 1:] != low[:, :-1], axis=1)) > 0.5  # most walkers changed mode


def test_a_fit_states_the_weights_of_both_modes(ring: Posterior, truth: float) -> None:
    """In the words of its diagnostic; 6 errors, as the word is rounded."""
    summary = pb.fit(ring.measurement, replace(ring.config, max_steps=100), seed=1).summary
    found = summary["diagnostics"]["modes"]
    assert found["verdict"] == "WARN"
    said = re.search(r"\(([\d.]+) ± ([\d.]+)\) % of the draws", found["statement"])
    assert said is not None, found["statement"]
    share, error = float(said[1]) / 100.0, float(said[2]) / 100.0
    assert min(abs(share - truth), abs(1.0 - share - truth)) < 6.0 * error


def test_every_optimum_stays_in_the_proposal(ring: Posterior, laplace: Mixture) -> None:
    """However the rounds went, a known share of the proposals goes to either mode."""
    for seed in range(1, 5):
        mixture = adapt_mixture(ring, laplace, seed=seed)
        n = mixture.sample(np.random.default_rng(seed), 4000)[:, 0]
        assert np.mean(n < EDGE) > 0.01
        assert np.mean(n > EDGE) > 0.01


def test_a_proposal_fits_inside_a_narrow_prior(ring: Posterior, laplace: Mixture) -> None:
    """sigma_N0 is flat between 0.94 and 0.96: no component is wider than the half of that."""
    widths = np.sqrt(np.einsum("cij,cij->ci", laplace.factors, laplace.factors))
    assert widths[:, 2].max() <= 0.01 * (1.0 + 1e-9)


def test_a_fit_to_one_repeated_point_ends() -> None:
    """All the weight on one centre: no second one, and no division by zero."""
    rng = np.random.default_rng(1)
    z = rng.standard_normal((50, 2))
    weights = np.zeros(50)
    weights[:2] = 0.5
    found = fit_mixture(z, weights, 4, rng)
    assert len(found.centres) <= 5
    assert np.isfinite(found.factors).all()
