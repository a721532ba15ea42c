"""Tier 2: nested Monte Carlo whose inner draws are made for each simulated reading.

Where a reading tells much, next to none of the draws of tier 1 explains it, and the bracket is
wide. Here p(y) is estimated with draws of a t mixture that adapts to the posterior after y,

    p(y) = E_q[ p(x)/q(x) p(y | x) ],

and p(y | theta) with such draws of the nuisance. Bracket and expectation are those of
`pbrdf_bayes.design.nested`, with p(x)/q(x) as the share of a draw: the mixture follows from y and
from draws that have nothing to do with the one that y came from, which is all that is needed.

Source of the adaptation: Cornuet et al., Scand. J. Stat. 39, 798 (2012),
doi:10.1111/j.1467-9469.2011.00756.x; of Laplace-like inner sampling: Beck et al., Comput. Methods
Appl. Mech. Eng. 334, 523 (2018), doi:10.1016/j.cma.2018.01.053.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import DrawnSets, draw_sets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.evaluate import Stage, bright_readings
from pbrdf_bayes.design.hemispherical import (
    draw_hemispherical,
    gain_law,
    hemispherical_log_likelihoods,
    hemispherical_values,
)
from pbrdf_bayes.design.nested import REFINED, Gain, bracket
from pbrdf_bayes.design.peaks import peak_of
from pbrdf_bayes.design.scans import draw_scans, law_of_rows, plan_scan, scan_log_likelihoods
from pbrdf_bayes.inference.sampling.importance import effective_size, tempered_weights
from pbrdf_bayes.inference.sampling.mixture import Mixture, fit_mixture

Array = NDArray[np.float64]
Density = Callable[[Array], tuple[Array, Array]]
"""Log-density of the law before the reading, but for a constant, and log-likelihood, at z."""

_MOST_ROUNDS, _KEPT_ROUNDS, _ROUND_SIZE = 48, 4, 400
_GOOD_SHARE, _SETTLED = 0.3, 4
"""Effective share of a round that is enough, and rounds without tempering that must be."""
_TURNS, _FEWEST_LEFT = 3, 8.0
"""Adapted anew with rounds of twice the size where fewer effective draws are left."""
_MOST_CLIMBS, _APART = 4, 1.5
"""Climbs to the highest peak, and how far they begin from each other, in standard deviations."""
_COMPONENTS = 3
_WIDENING, _LAST_WIDENING = 1.3, 1.1
_FEWEST = 5.0
"""Effective draws for each dimension that a fit of the mixture needs."""
_READINGS = (8, 40)
_OF_HEMISPHERE = {"dhr": 25, "ddr": 700}
"""What a reading costs, in values of a scan."""
_USUAL_SETS = 5_000
"""Evaluated for one simulated reading, mostly."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One simulated reading: its likelihood under any sets, and under the one it came from."""

    log_likelihood: Callable[[DrawnSets], Array]
    own: float


def simulate_readings(stage: Stage, candidate: Candidate, n: int) -> list[Reading]:
    """Readings of the first outer sets, those of tier 1."""
    b, outer = stage.beliefs, stage.outer.take(slice(0, n))
    if candidate.quantity != "brdf":
        return _hemispherical(stage, candidate, outer)
    planned = plan_scan(b, candidate, bright_readings(stage, candidate))

    def likelihood(y: Array) -> Callable[[DrawnSets], Array]:
        def under(sets: DrawnSets) -> Array:
            brdf, _ = b.posterior.predict(sets.x, planned.geometry)
            law = law_of_rows(b, planned, sets, brdf)
            return np.asarray(scan_log_likelihoods(b, planned, y, law, matched=False)[0])

        return under

    law = law_of_rows(b, planned, outer, b.posterior.predict(outer.x, planned.geometry)[0])
    y = draw_scans(b, planned, law, seed=stage.seed)
    own = scan_log_likelihoods(b, planned, y, law, matched=True)[:, 0]
    columns = [np.ascontiguousarray(y[:, i : i + 1]) for i in range(n)]
    return [Reading(likelihood(c), float(v)) for c, v in zip(columns, own, strict=True)]


def _hemispherical(stage: Stage, candidate: Candidate, outer: DrawnSets) -> list[Reading]:
    b, q = stage.beliefs, candidate.polarization

    def under(y: Array, sets: DrawnSets, *, matched: bool) -> Array:
        value = hemispherical_values(b.posterior, candidate, sets.x)
        gain = gain_law(b, q, sets)
        return hemispherical_log_likelihoods([y], [value], gain, sets, matched=matched)

    value = hemispherical_values(b.posterior, candidate, outer.x)
    y = draw_hemispherical(
        value, gain_law(b, q, outer), outer, seed=(stage.seed, 33), key=candidate.geometry
    )
    own = under(y, outer, matched=True)[:, 0]

    def likelihood(reading: Array) -> Callable[[DrawnSets], Array]:
        return lambda sets: under(reading, sets, matched=False)[0]

    return [Reading(likelihood(y[i : i + 1]), float(own[i])) for i in range(len(outer))]


def work_of(stage: Stage, candidate: Candidate) -> int:
    """Values of the model that one set costs: of the candidate and of what was measured."""
    m = stage.beliefs.posterior.measurement
    so_far = len(m.brdf) + _OF_HEMISPHERE["dhr"] * len(m.dhr) if stage.beliefs.measured else 0
    return so_far + _OF_HEMISPHERE.get(candidate.quantity, candidate.n_readings)


def least_work(stage: Stage, candidate: Candidate) -> int:
    """Values that the fewest readings of a candidate mostly cost."""
    return _READINGS[0] * _USUAL_SETS * work_of(stage, candidate)


def refined_gain(
    stage: Stage, candidate: Candidate, *, n_inner: int, most_work: float = np.inf,
    n_outer: int = _READINGS[1],
) -> Gain:  # fmt: skip
    """Expected information gain by tier 2.

    Parameters
    ----------
    stage : Stage
    candidate : Candidate
        A scan with at least one reading above the floor, a DHR or a DDR.
    n_inner : int
        Inner draws made for each simulated reading.
    most_work : float
        Values of the model after which no further reading is simulated, but for the fewest that
        make an average. A count, not a time: the result does not depend on the machine.
    n_outer : int
        Simulated readings at most.

    Returns
    -------
    Gain
        ``ess`` is the median effective number of the inner draws.
    """
    b = stage.beliefs
    n = min(n_outer, len(stage.outer))
    rng = np.random.default_rng([stage.seed, 60])
    z_outer = b.posterior.to_coordinates(stage.outer.x[:n])
    z_inner = b.posterior.to_coordinates(stage.inner.x)
    about = b.columns_about
    other = np.setdiff1d(np.arange(z_inner.shape[1]), about)
    level = log_norm(lambda z: _density(stage, z), z_inner, rng) if b.measured else 0.0
    lows, highs, effective = [], [], []
    spent, each = 0, work_of(stage, candidate)
    for i, reading in enumerate(simulate_readings(stage, candidate, n)):
        if i >= _READINGS[0] and spent * each >= most_work:
            break

        def of_all(z: Array, reading: Reading = reading) -> tuple[Array, Array]:
            return _evaluate(stage, reading, z)

        found = _terms(of_all, z_inner, z_outer[i], reading.own, level, n_inner, rng)
        low, high = found[0], found[1]
        effective.append(found[2])
        spent += found[3]
        if other.size:

            def of_nuisance(
                e: Array, reading: Reading = reading, z: Array = z_outer[i]
            ) -> tuple[Array, Array]:
                return _evaluate(stage, reading, _with(z, other, e))

            def density(e: Array, z: Array = z_outer[i]) -> Array:
                return _density(stage, _with(z, other, e))

            near = _near(z_inner, z_outer[i], about, other)
            norm = log_norm(density, near, rng)
            least, most, _, more = _terms(
                of_nuisance, near, z_outer[i][other], reading.own, norm, n_inner, rng
            )
            low, high = low - most, high - least
            spent += more
        lows.append(low)
        highs.append(high)
    low_terms, high_terms = np.array(lows), np.array(highs)
    terms = 0.5 * (low_terms + high_terms)
    return Gain(
        eig=float(terms.mean()), se=float(terms.std(ddof=1) / np.sqrt(len(terms))),
        low=float(low_terms.mean()), high=float(high_terms.mean()),
        ess=float(np.median(effective)), terms=terms, method=REFINED,
    )  # fmt: skip


def _with(z: Array, other: NDArray[np.int64], nuisance: Array) -> Array:
    """Sets with the given parameters of interest and any nuisance."""
    full = np.repeat(z[None, :], len(nuisance), axis=0)
    full[:, other] = nuisance
    return full


def _near(z: Array, centre: Array, about: NDArray[np.int64], other: NDArray[np.int64]) -> Array:
    """Nuisance of the draws, moved to where the parameters of interest are, by regression."""
    s = np.cov(z, rowvar=False)
    slope = np.linalg.solve(s[np.ix_(about, about)], s[np.ix_(about, other)])
    return np.asarray(z[:, other] + (centre[about] - z[:, about]) @ slope)


def _density(stage: Stage, z: Array) -> Array:
    return stage.beliefs.log_density(stage.beliefs.posterior.from_coordinates(z))


def _evaluate(stage: Stage, reading: Reading, z: Array) -> tuple[Array, Array]:
    """Log-density and log-likelihood at z; -inf and 0 where the prior has nothing."""
    x = stage.beliefs.posterior.from_coordinates(z)
    density = stage.beliefs.log_density(x)
    likelihood = np.zeros(len(z))
    inside = np.isfinite(density)
    if inside.any():
        sets = draw_sets(stage.beliefs, x[inside], np.random.default_rng([stage.seed, 61]))
        likelihood[inside] = reading.log_likelihood(sets)
    return density, likelihood


def _terms(
    of: Density, start: Array, own: Array, own_likelihood: float, level: float, n: int,
    rng: np.random.Generator,
) -> tuple[float, float, float, int]:  # fmt: skip
    """Both estimates of ln p(y | own) - ln p(y), effective draws, and sets evaluated."""
    spent = 1
    density_at_own = of(own[None])[0][0]
    least = density_at_own + own_likelihood
    for turn in range(_TURNS):
        mixture, more = _adapted(of, start, least, rng, _ROUND_SIZE * 2**turn)
        z = mixture.sample(rng, n)
        density, likelihood = of(z)
        spent += more + n
        share = density - level - mixture.log_density(z)
        if effective_size((share + likelihood)[np.isfinite(share)]) >= _FEWEST_LEFT:
            break
    at_own = density_at_own - level - mixture.log_density(own[None])[0]
    log_p = np.append(likelihood, own_likelihood)[None]
    low, high, weights = bracket(log_p, np.append(share, at_own)[None], np.ones(log_p.shape))
    return float(low[0]), float(high[0]), float(1.0 / np.sum(weights**2)), spent


def _adapted(
    of: Density, start: Array, least: float, rng: np.random.Generator, size: int
) -> tuple[Mixture, int]:
    """A t mixture like the law after the reading, from draws of the law before it.

    In rounds of so many draws; with the number of sets evaluated.
    """
    first, spent = _first(of, start, least, rng)
    proposals = [first]
    drawn: list[Array] = []
    values: list[Array] = []
    settled = 0
    for _ in range(_MOST_ROUNDS):
        z = proposals[-1].sample(rng, size)
        density, likelihood = of(z)
        spent += len(z)
        drawn = [*drawn, z][-_KEPT_ROUNDS:]
        values = [*values, density + likelihood][-_KEPT_ROUNDS:]
        proposals = proposals[-_KEPT_ROUNDS:]
        every = np.concatenate(drawn)
        below = np.logaddexp.reduce([q.log_density(every) for q in proposals], axis=0)
        log_weights = np.concatenate(values) - below
        inside = np.isfinite(log_weights)
        if not inside.any():
            return proposals[-1], spent
        last = log_weights[-size:]
        if settled == _SETTLED or effective_size(last) > _GOOD_SHARE * size:
            break
        proposal, power = _fitted(every[inside], log_weights[inside], 1, rng)
        proposals.append(proposal)
        settled = settled + 1 if power == 1.0 else 0
    fitted, _ = _fitted(every[inside], log_weights[inside], _COMPONENTS, rng)
    return fitted.widened(_LAST_WIDENING), spent


def _first(
    of: Density, start: Array, least: float, rng: np.random.Generator
) -> tuple[Mixture, int]:
    """About the highest peak above the draws; with the number of sets evaluated.

    A peak below ``least``, the height at the set that the reading came from, is not the highest
    one: there are more climbs then, from the best draws away from where the others began.
    """
    density, likelihood = of(start)
    usable = np.isfinite(density)
    points, log_weights = start[usable], likelihood[usable]
    scale = points.std(axis=0)
    height, spent = density[usable] + log_weights, len(start)
    best: tuple[float, Array, Array] | None = None
    for _ in range(_MOST_CLIMBS):
        begin = points[np.argmax(height)]
        if (peak := peak_of(lambda z: np.add(*of(z)), begin, scale)) is not None:
            centre, covariance, more = peak
            top = float(np.add(*of(centre[None]))[0])
            spent += more + 1
            if best is None or top > best[0]:
                best = top, centre, covariance
            if top >= least:
                break
        near = np.linalg.norm((points - begin) / scale, axis=1) < _APART
        height = np.where(near, -np.inf, height)
    if best is None:
        return _fitted(points, log_weights, 1, rng)[0], spent
    factor = np.asarray(_WIDENING * np.linalg.cholesky(best[2]), dtype=np.float64)
    return Mixture(best[1][None], factor[None], np.ones(1)), spent


def _fitted(
    points: Array, log_weights: Array, n_components: int, rng: np.random.Generator
) -> tuple[Mixture, float]:
    """Mixture fitted with the largest power of the weights that leaves enough effective points.

    With that power.
    """
    needed = min(_FEWEST * points.shape[1], 0.5 * len(points))
    weights, power = tempered_weights(log_weights, needed)
    if np.sum(weights**2) * needed > 2.0:  # too uneven for any power: the best ones alike
        best = np.argsort(-log_weights)[: int(needed)]
        weights = np.bincount(best, minlength=len(points)) / len(best)
    if n_components > 1 and power == 1.0:
        return fit_mixture(points, weights, n_components, rng), power
    centre = weights @ points
    away = points - centre
    covariance = (weights[:, None] * away).T @ away
    covariance[np.diag_indices_from(covariance)] *= 1.0 + 1e-6
    covariance[np.diag_indices_from(covariance)] += 1e-14
    factor = np.asarray(_WIDENING * np.linalg.cholesky(covariance), dtype=np.float64)
    return Mixture(centre[None], factor[None], np.ones(1)), power


def log_norm(density: Callable[[Array], Array], start: Array, rng: np.random.Generator) -> float:
    """Natural log of the integral of a density whose draws are about ``start``."""
    mixture, _ = _fitted(start, np.zeros(len(start)), _COMPONENTS, rng)
    z = mixture.sample(rng, 8 * _ROUND_SIZE)
    return float(np.logaddexp.reduce(density(z) - mixture.log_density(z)) - np.log(len(z)))


def with_refined(gain: Gain, refined: Gain) -> Gain:
    """The refined gain where its bracket is the narrower one; ``ess`` stays that of tier 1."""
    if refined.high - refined.low >= gain.high - gain.low:
        return gain
    return replace(refined, ess=gain.ess)
