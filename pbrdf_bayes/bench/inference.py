"""What an error of the quadrature does to a posterior, and what each way of sampling buys."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.bench.speed import paper_posterior
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.importance import adapt_mixture, importance_sample
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.sampling import sample_posterior

Array = NDArray[np.float64]

RTOLS = tuple(10.0**-i for i in range(2, 10))
FINE_DIGITS = 10.0
PHYSICAL = 4
_SEED = 5
_INTERVAL = (0.025, 0.975)


def posterior_shift(*, quick: bool) -> dict[str, Any]:
    """Shift of the posterior means, in posterior sd, at each tolerance.

    The draws of the posterior at rtol = 1e-10 are weighted by the exponential of the difference of
    the two log-posteriors: no noise of another run enters.

    Returns
    -------
    dict
        parameters, n_draws and rows of rtol, shift (n_par,), largest_sd_change (relative),
        largest_difference of the log-posterior up to a constant [nat].
    """
    fine = replace(paper_posterior(), digits=FINE_DIGITS)
    mixture = adapt_mixture(fine, laplace_mixture(fine, find_map(fine, seed=1)), seed=_SEED)
    n = 2_000 if quick else 8_000
    z = importance_sample(fine, mixture, n_proposals=2 * n, n_draws=n, seed=_SEED).z
    x, base = fine.from_coordinates(z), fine.log_prob_coordinates(z)
    mean, sd = x.mean(axis=0), x.std(axis=0)
    rows = []
    for rtol in RTOLS:
        coarse = replace(fine, digits=float(-np.log10(rtol)))
        difference = coarse.log_prob_coordinates(z) - base
        difference -= difference.mean()
        weights = np.exp(difference - difference.max())
        weights /= weights.sum()
        moved = weights @ x
        spread = np.sqrt(weights @ (x - moved) ** 2)
        rows.append(
            {
                "rtol": rtol,
                "shift": ((moved - mean) / sd).tolist(),
                "largest_sd_change": float(np.max(np.abs(spread / sd - 1.0))),
                "largest_difference": float(np.abs(difference).max()),
            }
        )
    return {"parameters": list(fine.parameter_names), "n_draws": n, "rows": rows}


def inference_ladder(*, quick: bool) -> dict[str, Any]:
    """Error of mean, sd and 95 % interval against seconds, from Laplace to long emcee runs.

    Returns
    -------
    dict
        parameters, reference (method, n_draws, ess, mean, sd) and rows of method, seconds,
        evaluations, error_mean, error_sd, error_interval: the largest over n, k, sigma_n0 and rho0,
        in posterior sd of the reference.
    """
    posterior = paper_posterior()
    started = perf_counter()
    optima = find_map(posterior, seed=1)
    laplace = laplace_mixture(posterior, optima)
    seconds_map = perf_counter() - started
    reference, record = _reference(posterior, laplace, quick=quick)
    judge = _Judge(reference)
    rows = [judge.row("MAP + Laplace", _gaussian(posterior, laplace), seconds_map, 0)]
    for n in (1_000, 4_000) if quick else (1_000, 4_000, 16_000, 64_000):
        started = perf_counter()
        mixture = adapt_mixture(posterior, laplace, seed=_SEED)
        found = importance_sample(posterior, mixture, n_proposals=n, n_draws=n, seed=_SEED)
        seconds = seconds_map + perf_counter() - started
        rows.append(judge.row(f"PSIS, {n} draws", posterior.from_coordinates(found.z), seconds, n))
    for steps in (100, 200) if quick else (100, 200, 400, 800):
        row, converged = _emcee_row(posterior, laplace, steps, seconds_map, judge)
        rows.append(row)
        if converged:
            break
    names = list(posterior.parameter_names[:PHYSICAL])
    return {"parameters": names, "reference": record, "rows": rows}


def _emcee_row(
    posterior: Posterior, laplace: Mixture, steps: int, seconds_map: float, judge: _Judge
) -> tuple[dict[str, Any], bool]:
    """A run of so many steps, or fewer where it reached its target before."""
    config = replace(posterior.config, accuracy="reference", max_steps=steps, threads=1)
    started = perf_counter()
    draws = sample_posterior(posterior, laplace, config, method="emcee", seed=_SEED)
    seconds = seconds_map + perf_counter() - started
    name = f"emcee, {draws.n_steps} steps"
    return judge.row(name, draws.flat, seconds, draws.n_evaluations), draws.converged


def _reference(
    posterior: Posterior, laplace: Mixture, *, quick: bool
) -> tuple[Array, dict[str, Any]]:
    """A long run of other seeds to compare with."""
    n = 40_000 if quick else 400_000
    mixture = adapt_mixture(posterior, laplace, seed=_SEED + 1)
    found = importance_sample(posterior, mixture, n_proposals=n, n_draws=n, seed=_SEED + 1)
    x = posterior.from_coordinates(found.z)
    record = {
        "method": "importance sampling with an adapted mixture",
        "n_proposals": n,
        "ess": found.ess,
        "k_hat": found.k_hat,
        "mean": x.mean(axis=0).tolist(),
        "sd": x.std(axis=0).tolist(),
    }
    return x, record


def _gaussian(posterior: Posterior, mixture: Mixture) -> Array:
    """Draws of the Gaussian at the best optimum, antithetic."""
    best = int(np.argmax(mixture.weights))
    half = np.random.default_rng(_SEED).standard_normal((50_000, posterior.n_par))
    steps = np.concatenate([half, -half]) @ mixture.factors[best].T
    return posterior.from_coordinates(mixture.centres[best] + steps)


class _Judge:
    """Errors of draws against the reference, in its posterior sd."""

    def __init__(self, reference: Array) -> None:
        self.summary = _summary(reference)

    def row(self, method: str, x: Array, seconds: float, evaluations: int) -> dict[str, Any]:
        mean, sd, low, high = _summary(x)
        mean_0, sd_0, low_0, high_0 = self.summary
        ends = np.maximum(np.abs(low - low_0), np.abs(high - high_0)) / sd_0
        return {
            "method": method,
            "seconds": seconds,
            "evaluations": int(evaluations),
            "error_mean": float(np.max(np.abs(mean - mean_0) / sd_0)),
            "error_sd": float(np.max(np.abs(sd / sd_0 - 1.0))),
            "error_interval": float(np.max(ends)),
        }


def _summary(x: Array) -> tuple[Array, Array, Array, Array]:
    y = x[:, :PHYSICAL]
    low, high = np.quantile(y, _INTERVAL, axis=0)
    return y.mean(axis=0), y.std(axis=0), low, high
