"""Which effects the data call for: by what is predicted of readings left out, never by the fit.

Candidates grow by one effect at a time, from the four-parameter model; where the Cauchy line shape
gains, the Gaussian and the Voigt shape stand beside it. Each is fitted with every angle of
incidence left out, and each polarisation where both were measured; its score is the mean of ln(rms
of the readings left out) over these cases. All readings count alike in the score, and so they do in
these fits: stated uncertainties of the BRDF have no say. Each step has to gain more than
`LEAST_GAIN`, and more than the standard error of the paired difference times Student's t for a
chance of 5 %: for a step the rule of one standard error of Breiman, Friedman, Olshen, Stone,
Classification and Regression Trees (1984), section 3.4.3, is not enough; with five cases and the
best of six candidates it added an effect to two of three simulated paints that had none. Where the
steps have come to, that rule has its place: the smallest candidate is taken that is within one
standard error of the last step. Lambertian and bulk scatter are alternatives: what was grown with
one is tried with the other, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t
from threadpoolctl import threadpool_limits

from pbrdf_bayes.config import AUTO, RunConfig
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.inference.effects_choice.candidates import (
    alternatives,
    caution,
    grown,
    in_words,
    nothing_left_out,
    of_other_shapes,
)
from pbrdf_bayes.inference.optimum.bounds import at_bound
from pbrdf_bayes.inference.optimum.map_fit import climb, coordinate_bounds, find_map
from pbrdf_bayes.inference.parameters.effects import with_own_priors
from pbrdf_bayes.inference.parameters.table import parameter_specs
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.prediction.holdout import draft_of
from pbrdf_bayes.inference.prediction.holdout_cases import Case, list_cases
from pbrdf_bayes.inference.prediction.residuals import calibrated_residuals
from pbrdf_bayes.inference.prior_support import possible_samples
from pbrdf_bayes.measurement import Measurement, select_scans
from pbrdf_bayes.records.summary import EffectsChoice, Scored
from pbrdf_bayes.words import say

Array = NDArray[np.float64]

LEAST_GAIN = 0.02
"""Relative decrease of the errors of prediction that is worth a parameter."""
TYPICAL_N = 1.5
"""Where n is held while effects are compared on data without contrast of s and p."""
_N_STARTS = 4
_ADDED_AT = 0.2
"""Quantile of its prior at which the parameter of an added effect starts."""
_CHANCE = 0.05


@dataclass(frozen=True, eq=False)
class _Tried:
    config: RunConfig
    names: tuple[str, ...]
    optimum: Array
    n_free: int
    rms_dex: float
    log_rms: Array
    at_bound: tuple[str, ...]
    microseconds: float

    @property
    def score(self) -> float:
        return float(self.log_rms.mean())


def choose_effects(
    measurement: Measurement, config: RunConfig, *, seed: int,
    told: Callable[[str], None] = lambda _: None,
) -> tuple[RunConfig, EffectsChoice | None]:  # fmt: skip
    """Replace ``effects = auto`` by the effects that the data call for.

    Parameters
    ----------
    measurement : Measurement
    config : RunConfig
    seed : int
        Of the starts of the optimiser.
    told : callable
        Told which candidate is tried.

    Returns
    -------
    tuple of RunConfig and EffectsChoice or None
        The configuration to go on with. None where nothing was to be chosen.
    """
    if config.effects != AUTO:
        return config, None
    measurement = _counted_alike(measurement)
    cases = list_cases(measurement)
    base = as_chosen(measurement, config, effects=(), line_shape=config.line_shape)
    parameter_specs(measurement, base)  # refuses priors of what there is not
    if not cases:
        words = say("effects.nothing_left_out", why=nothing_left_out(measurement))
        return base, EffectsChoice((), (), words, caution(0))
    start = replace(base, priors={**config.priors, **base.priors})  # those of effects to be tried
    tried, accepted = _grow(measurement, start, cases, seed, told)
    best = min(tried, key=lambda t: t.score)
    chosen = _smallest_as_good(tried, accepted)
    scored = [_score(t, best, chosen=t is chosen) for t in tried]
    scored.sort(key=lambda s: (s.n_free, s.score))
    names = tuple(case.name for case in cases)
    words = _statement(chosen, tried[0], config)
    held_out = {
        kind: float(np.sqrt(np.mean(np.exp(2.0 * chosen.log_rms[[c.kind == kind for c in cases]]))))
        for kind in dict.fromkeys(case.kind for case in cases)
    }
    symbols = {
        spec.name: spec.symbol
        for one in tried
        for spec in parameter_specs(measurement, with_own_priors(one.config))
        if spec.name in one.at_bound
    }
    return with_own_priors(chosen.config), EffectsChoice(
        tuple(scored), names, words, caution(len(names)), held_out, symbols
    )


def _counted_alike(measurement: Measurement) -> Measurement:
    """Readings without the stated uncertainties of the BRDF: least squares of what is scored."""
    brdf = measurement.brdf
    unknown, single = np.full(len(brdf), np.nan), np.zeros(len(brdf), dtype=np.bool_)
    return replace(measurement, brdf=replace(brdf, u_value=unknown, repeated=single))


def compare_configs(
    measurement: Measurement, configs: Sequence[RunConfig], *, seed: int,
    cases: Sequence[Case] | None = None,
) -> tuple[tuple[Scored, bool], ...]:  # fmt: skip
    """Score given configurations by what they predict of readings left out.

    Those with the same parameters also start from each other's optimum: a weak lobe beside diffuse
    scatter can be lost from the few starts of a comparison, and the others tell where it is.

    Parameters
    ----------
    measurement : Measurement
    configs : sequence of RunConfig
        With their effects named.
    seed : int
        Of the starts of the optimiser.
    cases : sequence of Case, optional
        What is left out; every angle of incidence and polarisation by default.

    Returns
    -------
    tuple of (Scored, bool)
        In the order given; with each whether the best of them beats it, as for `choose_effects`.

    Raises
    ------
    DataError
        Where nothing can be left out.
    """
    cases = list_cases(measurement) if cases is None else cases
    if not cases:
        msg = "one angle of incidence and one polarisation: nothing can be left out and predicted"
        raise DataError(msg)
    posteriors = [_quick_posterior(measurement, config) for config in configs]
    tried = [
        _try(config, posterior, optimum, cases)
        for config, posterior, optimum in zip(
            configs, posteriors, _shared_optima(posteriors, seed), strict=True
        )
    ]
    best = min(tried, key=lambda t: t.score)
    return tuple(
        (_score(t, best, chosen=t is best), t is not best and _is_better(best, t)) for t in tried
    )


def _shared_optima(posteriors: Sequence[Posterior], seed: int) -> list[Array]:
    """Optimum of each posterior; those of the others with the same parameters are starts."""
    found = [_optimum(posterior, seed) for posterior in posteriors]
    return [
        _highest(one, [
            x for x, other in zip(found, posteriors, strict=True)
            if other.parameter_names == one.parameter_names
        ])
        for one in posteriors
    ]  # fmt: skip


def _optimum(posterior: Posterior, seed: int) -> Array:
    return find_map(posterior, n_starts=_N_STARTS, seed=seed).best.x


def _highest(posterior: Posterior, starts: Sequence[Array]) -> Array:
    """Where the highest of the climbs from parameter sets (n_par,) ends."""
    low, high = coordinate_bounds(posterior)
    ends = [climb(posterior, z, low, high) for z in posterior.to_coordinates(np.array(starts))]
    top = max(ends, key=lambda end: end[1])[0]
    return np.asarray(posterior.from_coordinates(top[None, :])[0])


def as_chosen(
    measurement: Measurement, config: RunConfig, *, effects: tuple[str, ...], line_shape: str
) -> RunConfig:
    """The configuration that a choice made of one with ``effects = auto``."""
    base = _with_typical_n(measurement, config) if list_cases(measurement) else config
    return with_own_priors(replace(base, effects=effects, line_shape=line_shape))


def _with_typical_n(measurement: Measurement, config: RunConfig) -> RunConfig:
    """Hold n where neither contrast of s and p nor DHR could tell it."""
    polarizations = {scan.polarization for scan in measurement.scans}
    if {"s", "p"} <= polarizations or len(measurement.dhr) or "n" in config.priors:
        return config
    return replace(config, priors={**config.priors, "n": {"kind": "fixed", "value": TYPICAL_N}})


def _grow(
    measurement: Measurement, base: RunConfig, cases: Sequence[Case], seed: int,
    told: Callable[[str], None],
) -> tuple[list[_Tried], _Tried]:  # fmt: skip
    """The base and what grows from the best of each size, until nothing is gained; the last one."""
    whole = _quick_posterior(measurement, base)
    tried = [_try(base, whole, _optimum(whole, seed), cases)]
    best = tried[0]

    def attempt(configs: Iterable[RunConfig]) -> list[_Tried]:
        found = []
        for larger in configs:
            whole = _quick_posterior(measurement, larger)
            if not len(possible_samples(whole)):  # beside a fixed parameter there is no room for it
                continue
            told(in_words(larger))
            starts = [_optimum(whole, seed), _begun_from(best, whole)]
            found.append(_try(larger, whole, _highest(whole, starts), cases))
        return found

    while True:
        larger = attempt(grown(best.config))
        for one in [t for t in larger if t.config.line_shape != best.config.line_shape]:
            if _is_better(one, best):
                larger += attempt(of_other_shapes(one.config))
        next_best = min(larger, key=lambda t: t.score, default=best)
        larger += attempt(
            c for c in alternatives(next_best.config) if c not in [t.config for t in larger]
        )
        tried += larger
        next_best = min(larger, key=lambda t: t.score, default=best)
        if not _is_better(next_best, best):
            return tried, best
        best = next_best


def _begun_from(smaller: _Tried, larger: Posterior) -> Array:
    """A start at the optimum of the candidate that this one grows from.

    A weak lobe beside diffuse scatter can be lost from the few starts.
    """
    known = dict(zip(smaller.names, smaller.optimum.tolist(), strict=True))
    start = larger.prior_quantile(np.full((1, larger.n_par), _ADDED_AT))[0]
    at_quantile = zip(larger.parameter_names, start.tolist(), strict=True)
    return np.array([known.get(name, value) for name, value in at_quantile])


def _try(config: RunConfig, whole: Posterior, best: Array, cases: Sequence[Case]) -> _Tried:
    """Leave each case out, from the optimum of all readings."""

    def left_out(case: Case) -> float:
        return _log_rms(whole, best, case)

    with threadpool_limits(limits=1, user_api="blas"), ThreadPoolExecutor(config.threads) as pool:
        log_rms = np.array(list(pool.map(left_out, cases)))
    return _Tried(
        config=config,
        names=whole.parameter_names,
        optimum=best,
        n_free=len(whole.of_model),
        rms_dex=calibrated_residuals(whole, best).rms,
        log_rms=log_rms,
        at_bound=at_bound(whole, best),
        microseconds=time_likelihood(whole, best),
    )


def _quick_posterior(measurement: Measurement, config: RunConfig) -> Posterior:
    """That of a draft with independent readings."""
    plain = replace(config, noise="iid", tails="normal")
    return build_posterior(measurement, draft_of(plain, measurement))


def time_likelihood(posterior: Posterior, x: Array) -> float:
    """Time of one likelihood evaluation in a call of 32 sets, the shortest of four [us].

    ``x`` has the shape (n_par,).
    """
    sets, times = np.tile(x, (32, 1)), []
    for _ in range(4):
        started = time.perf_counter()
        posterior.log_likelihood(sets)
        times.append(time.perf_counter() - started)
    return min(times) / len(sets) * 1e6


def _log_rms(whole: Posterior, best: Array, case: Case) -> float:
    """Ln of the rms [dex] of the scans of a case, predicted by a fit without them."""
    part = select_scans(whole.measurement, case.keep, dhr=case.dhr)
    posterior = _quick_posterior(part, whole.config)
    columns = [whole.parameter_names.index(name) for name in posterior.parameter_names]
    low, high = coordinate_bounds(posterior)
    start = posterior.to_coordinates(best[columns][None, :])[0]
    top, _ = climb(posterior, start, low, high)
    x = best.copy()
    x[columns] = posterior.from_coordinates(top[None, :])[0]
    residuals = calibrated_residuals(whole, x)
    lengths = np.array([len(scan) for scan in whole.measurement.scans], dtype=np.float64)
    out = case.predict & np.isfinite(residuals.scan_rms)
    mean_square = np.sum(lengths[out] * residuals.scan_rms[out] ** 2) / np.sum(lengths[out])
    return float(0.5 * np.log(mean_square))


def _paired(one: _Tried, other: _Tried) -> tuple[float, float]:
    """Mean of the differences of ln rms over the cases, and its standard error."""
    difference = one.log_rms - other.log_rms
    n = difference.size
    spread = float(difference.std(ddof=1) / np.sqrt(n)) if n > 1 else float("inf")
    return float(difference.mean()), spread


def _is_better(one: _Tried, other: _Tried) -> bool:
    """By more than chance would have it, and by enough to matter."""
    difference, u = _paired(one, other)
    quantile = float(student_t.ppf(1.0 - _CHANCE, one.log_rms.size - 1)) if np.isfinite(u) else 1.0
    return -difference > max(quantile * u, LEAST_GAIN)


def _smallest_as_good(tried: Sequence[_Tried], accepted: _Tried) -> _Tried:
    """The smallest within one standard error of the one accepted last; the better of equals."""

    def as_good(one: _Tried) -> bool:
        difference, u = _paired(one, accepted)
        return difference <= max(u if np.isfinite(u) else 0.0, LEAST_GAIN)

    smaller = [t for t in tried if t.n_free < accepted.n_free and as_good(t)]
    return min([accepted, *smaller], key=lambda t: (t.n_free, t.score))


def _score(tried: _Tried, best: _Tried, *, chosen: bool) -> Scored:
    difference, u = (0.0, 0.0) if tried is best else _paired(tried, best)
    return Scored(
        name=in_words(tried.config), effects=tried.config.effects,
        line_shape=tried.config.line_shape, n_free=tried.n_free, rms_dex=tried.rms_dex,
        held_out_dex=float(np.sqrt(np.mean(np.exp(2.0 * tried.log_rms)))),
        mean_held_out_dex=float(np.mean(np.exp(tried.log_rms))), score=tried.score,
        difference=difference, u_difference=u, at_bound=tried.at_bound,
        microseconds=tried.microseconds, chosen=chosen,
    )  # fmt: skip


def _statement(chosen: _Tried, base: _Tried, asked: RunConfig) -> str:
    held = ""
    if "n" in chosen.config.priors and "n" not in asked.priors:
        held = say("effects.held", n=TYPICAL_N)
    if chosen is base:
        return say("effects.none", base=in_words(base.config), held=held)
    change = 1.0 - np.exp(chosen.score - base.score)
    share = "more than 99" if change > 0.99 else f"{100 * change:.0f}"
    return say(
        "effects.best", model=in_words(chosen.config), percent=share, base=in_words(base.config),
        held=held,
    )  # fmt: skip
