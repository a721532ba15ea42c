"""Simulation-based calibration through the public ``fit``: ranks of the truth are uniform.

Truths come from the prior, readings from the law of the likelihood at the truth. If prior,
likelihood and sampler fit together, the truth's rank among the posterior draws is uniform for every
quantity: Talts, Betancourt, Simpson, Vehtari, Gelman 2018, arXiv:1804.06788. The band around the
ranks' distribution function covers it as a whole: Säilynoja, Bürkner, Vehtari 2022,
doi:10.1007/s11222-022-10090-6.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.model.four_parameter import Parameters, brdf, dhr
from pbrdf_bayes.workflow.fitting import fit
from tools.validation.experiments import Layout, draw_readings

Array = NDArray[np.float64]

LAYOUT = Layout(
    theta_i_deg=(20.0, 60.0),
    theta_r_deg=tuple(np.arange(-72.0, 73.0, 8.0).tolist()),
    dhr_theta_i_deg=(10.0, 40.0, 70.0),
)
PRIORS: Mapping[str, Mapping[str, Any]] = {
    "n": {"kind": "normal", "mean": 1.5, "sd": 0.15},
    "k": {"kind": "halfnormal", "sd": 0.3},
    "sigma_n0": {"kind": "uniform", "low": 0.1, "high": 0.95},
    "rho0": {"kind": "loguniform", "low": 0.05, "high": 1.5},
    "s_rel_s": {"kind": "lognormal", "median": 0.02, "factor": 1.5},
    "s_rel_p": {"kind": "lognormal", "median": 0.02, "factor": 1.5},
    "tau": {"kind": "lognormal", "median": 0.05, "factor": 1.6},
    "ell_deg": {"kind": "lognormal", "median": 30.0, "factor": 1.5},
    "u_dhr": {"kind": "lognormal", "median": 0.003, "factor": 1.5},
}
OVERCONFIDENT: Mapping[str, Mapping[str, Any]] = {
    "s_rel_s": {"kind": "lognormal", "median": 0.005, "factor": 1.001},
    "s_rel_p": {"kind": "lognormal", "median": 0.005, "factor": 1.001},
    "tau": {"kind": "lognormal", "median": 0.0125, "factor": 1.001},
    "u_dhr": {"kind": "lognormal", "median": 0.00075, "factor": 1.001},
}
"""Noises held at a quarter of their medians: the negative control."""
_RANKED_DRAWS = 100
DHR_AT, BRDF_AT = ("s", 60.0), ("p", 40.0, 20.0)


def sbc_config(*, overconfident: bool = False) -> RunConfig:
    """Choices of the study, or of its negative control."""
    priors = {**PRIORS, **OVERCONFIDENT} if overconfident else PRIORS
    return RunConfig(
        accuracy="draft", holdout=False, threads=1, u_brdf_cal=0.01, u_dhr_cal=0.01, priors=priors
    )


def quantities(posterior: Posterior, x: Array) -> dict[str, Array]:
    """What is ranked, each of shape (n_sets,): parameters, log-likelihood, predictions."""
    found = dict(zip(posterior.parameter_names, x.T, strict=True))
    found["log_likelihood"] = posterior.log_likelihood(x)
    surfaces = [Parameters(**dict(zip(PHYSICAL, row[:4].tolist(), strict=True))) for row in x]
    q, angle = DHR_AT
    found["DHR_s(60)"] = np.array([float(dhr(p, angle, q)) for p in surfaces])
    q, angle, out = BRDF_AT
    found["BRDF_p(40, 20)"] = np.array([float(brdf(p, angle, out, q)) for p in surfaces])
    return found


def simulate_rank(seed: int, *, overconfident: bool = False) -> dict[str, Any]:
    """One simulation: rank of the truth in [0, 1] for every quantity, and how the fit went."""
    rng = np.random.default_rng([seed, 41])
    template = build_posterior(LAYOUT.template(), sbc_config())
    truth = template.sample_prior(rng, 1)
    readings = draw_readings(template, truth[0], rng)
    config = sbc_config(overconfident=overconfident)
    analysis = fit(readings, config, seed=seed)
    posterior = build_posterior(readings, config)
    draws = analysis.draws["posterior"].to_dataset()
    flat = np.stack([draws[name].values.ravel() for name in posterior.parameter_names], axis=1)
    picked = flat[rng.choice(len(flat), _RANKED_DRAWS, replace=False)]
    at_truth, at_draws = quantities(template, truth), quantities(template, picked)
    ranks = {
        name: float((np.sum(values < at_truth[name][0]) + rng.random()) / (_RANKED_DRAWS + 1))
        for name, values in at_draws.items()
    }
    return {
        "seed": seed,
        "ranks": ranks,
        "status": analysis.summary["status"],
        "verdict": analysis.summary["verdict"],
        "method": analysis.summary["sampling"]["method"],
    }


@cache
def envelope_level(n: int, coverage: float = 0.99, n_simulations: int = 4000) -> float:
    """Pointwise level at which a band around n uniform numbers covers all of them together."""
    rng = np.random.default_rng(n)
    grid = np.arange(1, n) / n
    uniform = np.sort(rng.random((n_simulations, n)), axis=1)
    smallest = np.empty(n_simulations)
    for i, values in enumerate(uniform):
        counts = np.searchsorted(values, grid, side="right")
        tails = np.minimum(binom.cdf(counts, n, grid), binom.sf(counts - 1, n, grid))
        smallest[i] = tails.min()
    return float(np.quantile(smallest, 1.0 - coverage))


def envelope(n: int, grid: Array, coverage: float = 0.99) -> tuple[Array, Array]:
    """Lower and upper limits of the share of n uniform numbers below each point of ``grid``."""
    level = envelope_level(n, coverage)
    inner = np.clip(grid, 0.0, 1.0)
    low, high = (np.asarray(binom.ppf(p, n, inner)) / n for p in (level, 1.0 - level))
    return low, high


def outside_envelope(ranks: Array, coverage: float = 0.99) -> bool:
    """The distribution function of the ranks leaves the band somewhere."""
    n = ranks.size
    grid = np.arange(1, n) / n
    counts = np.searchsorted(np.sort(ranks), grid, side="right")
    tails = np.minimum(binom.cdf(counts, n, grid), binom.sf(counts - 1, n, grid))
    return bool(tails.min() < envelope_level(n, coverage))
