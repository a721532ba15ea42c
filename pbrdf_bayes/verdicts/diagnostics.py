"""Verdicts on a run: each with its value, its threshold, what it means and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.optimum.bounds import (
    at_bound,
    at_null,
    pressed,
    share_at_bound,
)
from pbrdf_bayes.inference.optimum.map_fit import MapResult
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut
from pbrdf_bayes.inference.prediction.residuals import Residuals, effective_share
from pbrdf_bayes.inference.rejected import Rejected, together
from pbrdf_bayes.inference.sampling.power_scaling import PriorSensitivity
from pbrdf_bayes.inference.sampling.sampling import AUTOCORRELATION_TIMES, RHAT_LIMIT, Draws
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import Applicability, DiscrepancySize
from pbrdf_bayes.verdict import (
    CONTRACTION_WARN,
    COVERAGE_CHANCE,
    COVERAGE_WARN,
    FAIL,
    K_HAT_LIMIT,
    LAG1_FAIL,
    LAG1_WARN,
    MISFIT_FAIL_DEX,
    MISFIT_WARN_DEX,
    PASS,
    RIVAL_NATS,
    WARN,
    beside_noise,
    grade,
    misfit_limit_dex,
)
from pbrdf_bayes.verdicts.applicability import Repeatability, applicability_diagnostic
from pbrdf_bayes.verdicts.common_misfit import CommonMisfit, judge_common
from pbrdf_bayes.verdicts.dhr_misfit import judge_dhr
from pbrdf_bayes.verdicts.discrepancy_size import judge_size
from pbrdf_bayes.verdicts.predictive_checks import (
    judge_families,
    judge_prior,
    judge_readings,
    judge_recipe,
)
from pbrdf_bayes.words import judged, say

Array = NDArray[np.float64]


RIVAL_SD = 3.0
_VALLEY_SD = 1.5
_VALLEY_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Identifiability:
    """How far the data moved the prior of each physical parameter.

    Attributes
    ----------
    names : tuple of str
    columns : ndarray of int, shape (n_physical,)
        Where they are among all parameters.
    contraction : ndarray, shape (n_physical,)
        1 - var(posterior)/var(prior), the readings taken as independent.
    honest : ndarray, shape (n_physical,)
        The same with the likelihood weakened to the effective number of readings.
    share : float
        Effective over actual number of readings.
    bound_share : ndarray, shape (n_physical,)
        Posterior probability of the outermost 1 % of the prior on the fuller side.
    optimum_at, null_at : tuple of str
        Parameters that an optimum has on a bound, of those that the readings identify; and at
        their null value.
    """

    names: tuple[str, ...]
    columns: NDArray[np.int64]
    contraction: Array
    honest: Array
    share: float
    bound_share: Array
    optimum_at: tuple[str, ...] = ()
    null_at: tuple[str, ...] = ()

    @property
    def shares(self) -> dict[str, float]:
        """Posterior probability at the bound, by parameter."""
        return dict(zip(self.names, self.bound_share.tolist(), strict=True))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Parameters that are pressed against a bound."""
        return pressed(self.shares, self.optimum_at)


def contraction(spec: ParameterSpec, values: Array) -> float:
    """1 - var(posterior)/var(prior), in the logarithm where the sampler moves in it."""
    prior = spec.prior.quantile((np.arange(4000) + 0.5) / 4000)
    if spec.log_coordinate:
        prior, values = np.log(prior), np.log(values)
    return float(1.0 - np.var(values) / np.var(prior))


def assess_identifiability(
    posterior: Posterior, draws: Array, tempered: Array, share: float,
    optima: Sequence[Array] = (),
) -> Identifiability:  # fmt: skip
    """Contraction of the physical parameters, and those at a bound.

    Parameters
    ----------
    posterior : Posterior
    draws, tempered : ndarray, shape (n_draws, n_par)
        Physical units; the second with the likelihood weakened to the share of the readings.
    share : float
        Effective over actual number of readings.
    optima : sequence of ndarray, shape (n_par,)
        Of the posterior and of least squares. Where the readings do not identify a parameter, an
        optimum of it on a bound says that, and nothing against the model.
    """
    columns = [i for i, spec in enumerate(posterior.specs) if spec.kind == "physical"]
    specs = [posterior.specs[i] for i in columns]
    parts = list(zip(specs, draws[:, columns].T, tempered[:, columns].T, strict=True))
    honest = np.array([contraction(spec, weak) for spec, _, weak in parts])
    told = [s.name for s, c in zip(specs, honest, strict=True) if c >= CONTRACTION_WARN]
    found = {name for x in optima for name in at_bound(posterior, x)}
    null = {name for x in optima for name in at_null(posterior, x)}
    return Identifiability(
        names=tuple(spec.name for spec in specs), columns=np.array(columns),
        contraction=np.array([contraction(spec, values) for spec, values, _ in parts]),
        honest=honest, share=share,
        bound_share=np.array([share_at_bound(spec, values) for spec, values, _ in parts]),
        optimum_at=tuple(name for name in told if name in found),
        null_at=tuple(name for name in PHYSICAL if name in null),
    )  # fmt: skip


def run_diagnostics(
    *,
    config: RunConfig,
    draws: Draws,
    optima: MapResult,
    residuals: Residuals,
    best_rms_dex: float,
    repeatability: Repeatability,
    identifiability: Identifiability,
    covered: tuple[int, int],
    holdout: Holdout | None,
    discrepancy: DiscrepancySize | None = None,
    leave_one_out: LeaveOneOut | None = None,
    sensitivity: PriorSensitivity | None = None,
    holdouts: tuple[Holdout, ...] = (),
    applicability: Applicability | None = None,
    common: CommonMisfit | None = None,
    dhr_misfit: float = np.nan,
) -> tuple[Check, ...]:
    """All verdicts on a run, in the order of the report; no record, no verdict."""
    checks = [
        _rhat(draws),
        _ess(draws, config),
        _chain_length(draws),
        _modes(optima, draws, identifiability.columns),
        _identified(identifiability),
        _bounds(identifiability),
    ]
    if sensitivity is not None:
        checks.append(judge_prior(sensitivity))
    if discrepancy is not None:
        checks.insert(0, judge_size(discrepancy))
    elif np.isfinite(residuals.lag1):
        checks.insert(0, _correlation(residuals, identifiability.share))
    if np.isfinite(best_rms_dex):
        checks.insert(0, _misfit(best_rms_dex, repeatability))
    if np.isfinite(dhr_misfit):
        checks.append(judge_dhr(dhr_misfit))
    if common is not None:
        checks.append(judge_common(common))
    if applicability is not None:
        checks.append(applicability_diagnostic(applicability, best_rms_dex))
    if covered[1]:
        share, correlated = effective_share(residuals.lag1), discrepancy is not None
        checks.append(_coverage(*covered, share, correlated=correlated))
    if leave_one_out is not None:
        checks.extend(judge_readings(leave_one_out, repeatability))
    if holdout is not None:
        checks.append(judge_recipe(holdout))
    rejected = together(optima.rejected, draws.rejected)
    if rejected.n:
        checks.append(_not_finite(rejected, identifiability))
    return (*checks, *judge_families(holdouts))


def _percent(dex: float) -> float:
    return float(100.0 * (10.0**dex - 1.0))


def _misfit(rms: float, repeatability: Repeatability) -> Check:
    noise = repeatability.dex
    fail = beside_noise(MISFIT_FAIL_DEX, noise)
    warn = min(beside_noise(MISFIT_WARN_DEX, noise), misfit_limit_dex(noise))
    known = np.isfinite(noise)
    repeats = say(
        "misfit.repeats" if known else "misfit.unknown", dex=noise, source=repeatability.words
    )
    return judged(
        "misfit", rms, fail, grade(rms, warn, fail), percent=_percent(rms), repeats=repeats
    )


def _correlation(residuals: Residuals, share: float) -> Check:
    return judged(
        "residual_correlation", residuals.lag1, LAG1_FAIL,
        grade(residuals.lag1, LAG1_WARN, LAG1_FAIL), share=100.0 * share, factor=share**-0.5,
    )  # fmt: skip


def _rhat(draws: Draws) -> Check:
    value = float(draws.rhat.max())
    verdict = PASS if value < RHAT_LIMIT else FAIL
    return judged("rhat", value, RHAT_LIMIT, verdict, n=len(np.unique(draws.ensemble)))


def _ess(draws: Draws, config: RunConfig) -> Check:
    value = float(min(draws.ess_bulk.min(), draws.ess_tail.min()))
    return judged("ess", value, config.ess_target, PASS if value >= config.ess_target else FAIL)


def _chain_length(draws: Draws) -> Check:
    if draws.method == "psis":
        return judged("k_hat", draws.k_hat, K_HAT_LIMIT, PASS)
    value = (draws.n_steps - draws.n_burn) / draws.autocorrelation_time
    verdict = PASS if value >= AUTOCORRELATION_TIMES else FAIL
    return judged(
        "chain_length", value, AUTOCORRELATION_TIMES, verdict, time=draws.autocorrelation_time
    )


def _modes(optima: MapResult, draws: Draws, physical: NDArray[np.int64]) -> Check:
    """Rivals differ in the physical parameters; how noises share their roles does not count."""
    x = draws.flat[:, physical]
    places = np.array([optimum.x[physical] for optimum in optima.optima])
    gaps = np.array([optima.best.log_posterior - o.log_posterior for o in optima.optima])
    apart = np.array([_apart(x, places[0], place) for place in places])
    rival = apart & (gaps < RIVAL_NATS)
    n_rivals = int(rival.sum())
    rivals = say("modes.none")
    if n_rivals:
        share = _share_of_rivals(draws, physical, places, rival)
        rivals = say("modes.rivals", n=n_rivals, limit=RIVAL_NATS, share=share)
    return judged(
        "modes", float(gaps[rival][0]) if n_rivals else np.nan, RIVAL_NATS,
        WARN if n_rivals else PASS, n_best=optima.best.n_starts, n_starts=optima.n_starts,
        rivals=rivals,
    )  # fmt: skip


def _apart(x: Array, best: Array, other: Array) -> bool:
    """Two optima farther apart than the draws are wide, or with a valley of draws between them.

    Where the draws hold both modes their standard deviation holds the distance between them.
    """
    step, sd = other - best, x.std(axis=0)
    if np.any(np.abs(step) > RIVAL_SD * sd):
        return True
    if not np.any(np.abs(step) > _VALLEY_SD * sd):
        return False
    scaled = step / sd**2
    along = (x - best) @ scaled / (step @ scaled)
    return bool(np.mean((along > 1.0 / 3.0) & (along < 2.0 / 3.0)) < _VALLEY_SHARE)


def _share_of_rivals(
    draws: Draws, physical: NDArray[np.int64], places: Array, rival: NDArray[np.bool_]
) -> str:
    """How many draws are nearest to a rival, and how far the ensembles agree on that."""
    x = draws.x[..., physical]
    sd = draws.flat[:, physical].std(axis=0)
    sd = np.where(sd > 0.0, sd, 1.0)
    distances = [np.sum(((x - place) / sd) ** 2, axis=-1) for place in places]
    near = rival[np.argmin(distances, axis=0)]
    share = float(near.mean())
    if share == 0.0:
        return say("modes.no_draw")
    each = [near[draws.ensemble == e].mean() for e in np.unique(draws.ensemble)]
    # ensembles made by importance sampling share their weights: they agree too well
    scatter = np.std(each, ddof=1) / np.sqrt(len(each))
    error = max(float(scatter), float(np.sqrt(share * (1.0 - share) / draws.ess_bulk.min())))
    return say("modes.share", percent=100.0 * share, error=100.0 * error)


def _identified(found: Identifiability) -> Check:
    value = float(found.honest.min())
    weak = [
        f"{name} ({c:.2f})"
        for name, c in zip(found.names, found.honest, strict=True)
        if c < CONTRACTION_WARN
    ]
    correlated = found.share < 1.0
    basis = say("identifiability.basis", percent=100.0 * found.share) if correlated else ""
    return judged(
        "identifiability", value, CONTRACTION_WARN, WARN if weak else PASS, basis=basis,
        percent=min(np.floor(1000.0 * value) / 10.0, 99.9),
        statement=say("identifiability.weak", listed=", ".join(weak), basis=basis) if weak else "",
    )  # fmt: skip


def _bounds(found: Identifiability) -> Check:
    """K = 0 is a material without absorption, the end of the possible and not of the prior."""
    shares = found.shares
    active = [
        say(
            "bounds.optimum" if name in found.optimum_at else "bounds.share", name=name,
            percent=100.0 * shares[name],
        )
        for name in found.at_bound
    ]  # fmt: skip
    name, share = max(shares.items(), key=lambda item: item[1])
    most = say("bounds.most", percent=100.0 * share, name=name) if share >= 0.005 else ""
    return judged(
        "bounds", float(len(active)), 0.0, FAIL if active else PASS, most=most,
        more=say("bounds.dielectric") if "k" in found.null_at else "",
        statement=say("bounds.pressed", listed=", ".join(active)) if active else "",
    )  # fmt: skip


def _coverage(inside: int, n: int, share: float, *, correlated: bool) -> Check:
    """Outside the limits, and farther from 90 % than the effective number of readings explains.

    A band for new scans has a discrepancy of their own. The fitted ones have shown theirs, and may
    all lie inside.
    """
    coverage = inside / n
    n_effective = max(round(n * share), 1)
    count = round(coverage * n_effective)
    chance = min(binom.cdf(count, n_effective, 0.9), binom.sf(count - 1, n_effective, 0.9))
    within = COVERAGE_WARN[0] <= coverage <= (1.0 if correlated else COVERAGE_WARN[1])
    verdict = PASS if within or chance > COVERAGE_CHANCE else WARN
    return judged("coverage", coverage, 0.9, verdict, percent=100.0 * coverage, n=n)


def _not_finite(rejected: Rejected, physical: Identifiability) -> Check:
    """Points that the model and not the prior rejects."""
    values = rejected.examples[0][physical.columns]
    first = ", ".join(f"{n} = {x:.6g}" for n, x in zip(physical.names, values, strict=True))
    return judged("not_finite", float(rejected.n), 0.0, WARN, first=first)
