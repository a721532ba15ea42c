"""Each reading against what all the others say of it: density, influence, place in its law.

Draws of the full posterior are weighed as if a reading had not been there, by Pareto-smoothed
importance sampling; its density is that of `inference.prediction.conditionals`. The Pareto k-hat
says how far the posterior hangs on that one reading: above the limit its weights cannot be relied
on. The probability integral transform (PIT) of a reading, its place in the law predicted from the
others, is uniform on [0, 1] where model and noise are right (Gneiting, Balabdaoui and Raftery 2007,
doi:10.1111/j.1467-9868.2007.00587.x).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri
from scipy.stats import ks_1samp, uniform

from pbrdf_bayes.inference.likelihood.filtered import noise_mixture
from pbrdf_bayes.inference.likelihood.row_evidence import Mixture as NoiseMixture
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.conditionals import (
    Conditionals,
    brdf_conditionals,
    dhr_conditionals,
)
from pbrdf_bayes.inference.sampling.importance import k_hat_limit
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture
from pbrdf_bayes.inference.sampling.pareto import leave_one_out, smooth_weights
from pbrdf_bayes.readings.observation import reading_law
from pbrdf_bayes.records.summary import Influential, ScanPit

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MOST_DRAWS, _FEWEST_DRAWS = 600, 200
_MOST_NUMBERS = 6_000_000
_MOST_ROWS = 20_000
_CHUNK = 1000
_LISTED = 5
_LOST_SHARE = 0.01
"""Relative variance of the floor above which ln BRDF is not normal; such readings have no PIT."""
_MOST_REFINED = 12
_PROPOSALS, _COMPONENTS, _WIDER = 3000, 2, 1.25
_BLOCK = 500
"""Proposals at a time: all readings of each are computed, and few kept."""
_MOST_REFINEMENTS = 8_000_000
_LN_2PI = float(np.log(2.0 * np.pi))
_FARTHEST = 37.0
"""Standard deviations beyond which the probability of a tail is not a number any more."""


@dataclass(frozen=True, eq=False)
class Pointwise:
    """Each reading given the others, every array of shape (n_readings,), NaN where not scored.

    Attributes
    ----------
    elpd : ndarray
        Log predictive density: of ln BRDF, of DHR; of a censored reading its log probability.
    p_loo : ndarray
        Effective number of parameters it takes.
    k_hat : ndarray
    z : ndarray
        Place in the law predicted from the others, as the normal quantile that it is.
    """

    elpd: Array
    p_loo: Array
    k_hat: Array
    z: Array

    @property
    def pit(self) -> Array:
        """Probability integral transform, in [0, 1]."""
        return np.asarray(ndtr(self.z))


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Every reading left out in turn.

    Attributes
    ----------
    pointwise : Pointwise
        BRDF readings, then DHR readings.
    elpd, u_elpd, p_loo : float
        Sum of the log predictive densities, its standard error, effective number of parameters.
    n_readings, n_draws : int
        Readings scored, draws used.
    k_hat_limit : float
        Above it the importance weights of a reading are not reliable with this number of draws.
    n_influential : int
        Readings above the limit; those few with the largest k-hat were scored once more, with a
        wider sample of their own.
    most_influential, farthest : tuple of Influential
        By k-hat and by distance, largest first.
    scans : tuple of ScanPit
        Of the scans with readings that were scored.
    """

    pointwise: Pointwise
    elpd: float
    u_elpd: float
    p_loo: float
    n_readings: int
    n_draws: int
    k_hat_limit: float
    n_influential: int
    most_influential: tuple[Influential, ...]
    farthest: tuple[Influential, ...]
    scans: tuple[ScanPit, ...]

    @property
    def k_hat(self) -> float:
        """Largest of all readings."""
        return self.most_influential[0].k_hat


def leave_each_out(posterior: Posterior, draws: Array, *, seed: int) -> LeaveOneOut:
    """Score every reading by what the others say of it.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Physical units, equally weighted; some hundred of them are taken.
    seed : int

    Returns
    -------
    LeaveOneOut

    Notes
    -----
    Above 20 000 BRDF readings an even selection of that size is scored, each still given all the
    others. The place of a censored reading below the floor is drawn at random (Czado, Gneiting and
    Held 2009, doi:10.1111/j.1541-0420.2009.01191.x).
    """
    rng = np.random.default_rng([seed, 10])
    rows = posterior.rows
    wanted = _MOST_NUMBERS // max(rows.y.size + rows.dhr.size, 1)
    size = min(len(draws), int(np.clip(wanted, _FEWEST_DRAWS, _MOST_DRAWS)))
    picked = draws[rng.choice(len(draws), size, replace=False)]
    censored = np.concatenate([rows.censored, np.zeros(rows.dhr.size, dtype=bool)])
    found, brdf = _conditionals(posterior, picked)
    scored = _scored(found, rows.y.size)
    mixture = noise_mixture(posterior.config)
    out = _score(found, scored, censored, mixture, rng)
    limit = k_hat_limit(size)
    swaying = scored[np.argsort(-out.k_hat[scored], kind="stable")][:_MOST_REFINED]
    swaying = swaying[out.k_hat[swaying] > limit]
    n_influential = int(np.sum(out.k_hat[scored] > limit))
    if swaying.size:
        _refine(posterior, picked, swaying, censored, limit, mixture, out, rng)
    lost = reading_law(np.mean(brdf, axis=0), posterior.config.brdf_floor).variance > _LOST_SHARE
    out.z[: rows.y.size][lost] = np.nan
    return _gather(posterior, out, n_draws=size, limit=limit, n_influential=n_influential)


def _conditionals(posterior: Posterior, draws: Array) -> tuple[Conditionals, Array]:
    """BRDF readings, then DHR readings; and the BRDF of the model."""
    brdf, dhr = posterior.predict(draws)
    parts = brdf_conditionals(posterior, draws, brdf), dhr_conditionals(posterior, draws, dhr)
    return Conditionals(*(np.concatenate(p, axis=1) for p in zip(*parts, strict=True))), brdf


def _scored(found: Conditionals, n_brdf: int) -> Index:
    """Readings that are scored: all of them, or an even selection."""
    every = max(1, -(-n_brdf // _MOST_ROWS))
    n = found.error.shape[1]
    chosen = np.concatenate([np.arange(0, n_brdf, every), np.arange(n_brdf, n)])
    return chosen[np.isfinite(found.error[:, chosen]).all(axis=0)]


def _score(
    found: Conditionals, scored: Index, censored: NDArray[np.bool_], noise: NoiseMixture,
    rng: np.random.Generator,
) -> Pointwise:  # fmt: skip
    """Smooth the weights, reading by reading."""
    out = Pointwise(*(np.full(censored.size, np.nan) for _ in range(4)))
    for start in range(0, scored.size, _CHUNK):
        at = scored[start : start + _CHUNK]
        away, density = _compare(found, at, censored[at], noise)
        out.elpd[at], out.k_hat[at], out.p_loo[at], log_weights = leave_one_out(density)
        out.z[at] = _place(away, np.exp(log_weights), censored[at], rng)
    return out


def _compare(
    found: Conditionals, at: Index, censored: NDArray[np.bool_], noise: NoiseMixture
) -> tuple[Array, Array]:
    """Places and log densities of some readings, shape (n_readings, n_draws).

    A place is the normal quantile of the probability of a reading as low as that; with normal
    noise that is the standardised error.
    """
    error, variance, student = (part[:, at].T for part in found)
    sd = np.sqrt(variance)
    away = error / sd
    density = -0.5 * (away * away + _LN_2PI) - np.log(sd)
    if student.any():
        away, density = _compare_student(error, variance - student, student, noise)
    density[censored] = log_ndtr(away[censored])
    return away, density


def _compare_student(
    error: Array, known: Array, student: Array, noise: NoiseMixture
) -> tuple[Array, Array]:
    """The same beside noise that is a mixture of normal laws of variances times ``student``."""
    tail, density = np.zeros(error.shape), np.full(error.shape, -np.inf)
    for scale, log_weight in zip(noise.scale, noise.log_weight, strict=True):
        sd = np.sqrt(known + scale * student)
        away = error / sd
        tail += np.exp(log_weight) * ndtr(-np.abs(away))
        density = np.logaddexp(density, log_weight - 0.5 * (away * away + _LN_2PI) - np.log(sd))
    return np.sign(error) * np.minimum(-ndtri(tail), _FARTHEST), density


def _refine(
    posterior: Posterior, picked: Array, at: Index, censored: NDArray[np.bool_], limit: float,
    noise: NoiseMixture, out: Pointwise, rng: np.random.Generator,
) -> None:  # fmt: skip
    """Score readings that the draws hang on by a sample of their own, adapted to their absence."""
    z = posterior.to_coordinates(picked)
    first = fit_mixture(z, np.full(len(z), 1.0 / len(z)), _COMPONENTS, rng).widened(_WIDER)
    shared = _propose(posterior, first, at, rng)
    left = min(_MOST_REFINEMENTS // (_PROPOSALS * out.elpd.size), 3 * at.size)
    for place, i in enumerate(at.tolist()):
        proposal, one = shared, np.array([i])
        while True:
            away, density = _compare(proposal.found, np.array([place]), censored[one], noise)
            log_weights, k_hat = smooth_weights(proposal.log_weights - density)
            if k_hat[0] < out.k_hat[i]:
                out.k_hat[i] = k_hat[0]
                out.elpd[i] = logsumexp(log_weights + density)
                out.z[i] = _place(away, np.exp(log_weights), censored[one], rng)[0]
            if out.k_hat[i] <= limit or left <= 0:
                break
            left -= 1
            weights = np.exp(log_weights[0])
            mixture = fit_mixture(proposal.z, weights / weights.sum(), _COMPONENTS, rng)
            proposal = _propose(posterior, mixture, at, rng)


class _Proposal(NamedTuple):
    """Weighted draws from a mixture, and the readings that are refined there."""

    z: Array
    log_weights: Array
    found: Conditionals


def _propose(
    posterior: Posterior, mixture: Mixture, at: Index, rng: np.random.Generator
) -> _Proposal:
    z = mixture.sample(rng, _PROPOSALS)
    log_prob = posterior.log_prob_coordinates(z)
    inside = np.isfinite(log_prob)
    kept = z[inside]
    blocks = [
        [part[:, at] for part in _conditionals(posterior, posterior.from_coordinates(block))[0]]
        for block in np.array_split(kept, max(1, -(-len(kept) // _BLOCK)))
    ]
    found = Conditionals(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))
    return _Proposal(kept, log_prob[inside] - mixture.log_density(kept), found)


def _place(
    away: Array, weights: Array, censored: NDArray[np.bool_], rng: np.random.Generator
) -> Array:
    """Normal quantile of the weighted mean of Phi(away), exact far out on either side."""
    side = np.where(np.median(away, axis=1) < 0.0, -1.0, 1.0)
    side[censored] = -1.0
    tail = np.sum(weights * ndtr(-side[:, None] * away), axis=1) / weights.sum(axis=1)
    tail[censored] *= rng.random(int(censored.sum()))
    return np.asarray(-side * np.clip(ndtri(tail), -_FARTHEST, _FARTHEST))


def _gather(
    posterior: Posterior, out: Pointwise, *, n_draws: int, limit: float, n_influential: int
) -> LeaveOneOut:
    scored = np.isfinite(out.elpd)
    n = int(scored.sum())

    def largest(values: Array) -> tuple[Influential, ...]:
        order = np.argsort(-np.where(np.isfinite(values), values, -np.inf), kind="stable")
        chosen = order[: min(_LISTED, int(np.isfinite(values).sum()))].tolist()
        return tuple(_name(posterior, i, float(out.k_hat[i]), float(out.z[i])) for i in chosen)

    return LeaveOneOut(
        pointwise=out, elpd=float(out.elpd[scored].sum()),
        u_elpd=float(np.sqrt(n) * out.elpd[scored].std()), p_loo=float(np.nansum(out.p_loo)),
        n_readings=n, n_draws=n_draws, k_hat_limit=limit, n_influential=n_influential,
        most_influential=largest(out.k_hat), farthest=largest(np.abs(out.z)),
        scans=_scan_pits(posterior, out.z),
    )  # fmt: skip


def _name(posterior: Posterior, index: int, k_hat: float, z: float) -> Influential:
    """What a reading is called; BRDF readings come first."""
    m = posterior.measurement
    if index < len(m.brdf):
        label = next(scan.label for scan in m.scans if index < scan.stop)
        return Influential(
            label, float(m.brdf.theta_r_deg[index]), int(m.brdf.row[index]), k_hat, z
        )
    i = index - len(m.brdf)
    label = f"DHR {m.dhr.polarization[i]}"
    return Influential(label, float(m.dhr.theta_i_deg[i]), int(m.dhr.row[i]), k_hat, z)


def _scan_pits(posterior: Posterior, z: Array) -> tuple[ScanPit, ...]:
    found = []
    for scan in posterior.measurement.scans:
        known = z[scan.rows][np.isfinite(z[scan.rows])]
        if known.size:
            test = ks_1samp(ndtr(known), uniform.cdf)
            found.append(
                ScanPit(scan.label, known.size, float(test.statistic), float(test.pvalue),
                        float(known.mean()), float(known.std()))
            )  # fmt: skip
    return tuple(found)
