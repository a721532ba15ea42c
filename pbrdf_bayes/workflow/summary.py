"""The summary of a run: every number and sentence that is not an array."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import numpy as np
from msgspec import UNSET

from pbrdf_bayes import __version__
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut
from pbrdf_bayes.inference.rejected import together
from pbrdf_bayes.inference.sampling.sampling import Draws
from pbrdf_bayes.io.config_toml import config_table
from pbrdf_bayes.records.summary import (
    Accuracy,
    Best,
    CorrelationMatrix,
    Fit,
    Input,
    LeaveOneOutSummary,
    Map,
    OptimumSummary,
    OverScans,
    Parameter,
    Prediction,
    RecipeHoldout,
    RejectedPoints,
    Sampling,
    ScanSummary,
    Summary,
)
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.verdict import CONTRACTION_WARN, FAIL, WARN, overall_verdict
from pbrdf_bayes.verdicts.diagnostics import contraction
from pbrdf_bayes.verdicts.predictive_checks import judge_holdout
from pbrdf_bayes.words import say
from pbrdf_bayes.workflow.stages import Stages

_PACKAGES = (
    "numpy", "scipy", "numba", "emcee", "nlopt", "arviz-stats", "xarray", "matplotlib",
)  # fmt: skip


def summarise(s: Stages) -> dict[str, Any]:
    """The content of ``summary.json``, plain values of `pbrdf_bayes.records.summary.Summary`."""
    m, config = s.posterior.measurement, s.posterior.config
    checked = [c.verdict for c in (*s.diagnostics, *s.checks)]
    verdict = overall_verdict([*checked, *(f.verdict for f in s.findings)])
    summary = Summary(
        sample=m.sample,
        wavelength_um=m.wavelength_um,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        status="done" if s.draws.converged else "not_converged",
        verdict=verdict,
        headline=_headline(s, verdict),
        applicability=s.applicability,
        findings=s.findings,
        input=_input(s),
        config=config_table(config),
        versions=versions(),
        platform=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        seed=s.seed,
        model=config.model_name,
        effects=tuple(config.effects),
        line_shape=config.line_shape,
        effects_choice=s.effects_choice,
        parameters=_parameters(s),
        correlation=_correlation(s),
        diagnostics={d.name: d for d in s.diagnostics},
        fit=_fit(s),
        discrepancy=s.discrepancy,
        map=_map(s),
        sampling=_sampling(s.draws),
        rejected=_rejected(s),
        accuracy=Accuracy(config.accuracy, config.rtol, s.normalisation_error, s.microseconds),
        holdout=_holdout(s.holdout),
        holdouts=_holdouts(s),
        leave_one_out=_leave_one_out(s.leave_one_out),
        scan_widths=s.widths.scans,
        reciprocity=s.reciprocity,
        timings=s.timings,
    )
    found: dict[str, Any] = plain(summary)
    return found


def _headline(s: Stages, verdict: str) -> str:
    if not s.draws.converged:
        return say("headline.not_converged")
    if s.findings:
        first = min(s.findings, key=lambda f: f.verdict != FAIL)
        return say("headline.readings", statement=first.statement)
    worst = next((d for d in s.diagnostics if d.verdict == verdict), None)
    if worst and verdict in (FAIL, WARN):
        return say(f"headline.{verdict.lower()}", statement=worst.statement)
    if verdict in (FAIL, WARN):
        check = next(c for c in s.checks if c.verdict == verdict)
        return say("headline.readings", statement=check.statement)
    rms, model = s.least_squares[1], s.posterior.config.model_name
    if np.isnan(rms):
        return say("headline.dhr_alone", model=model)
    return say("headline.pass", model=model, rms=rms, percent=100.0 * (10**rms - 1.0))


def _input(s: Stages) -> Input:
    m = s.posterior.measurement
    scans = tuple(
        ScanSummary(
            label=scan.label,
            polarization=scan.polarization,
            theta_i_deg=scan.theta_i_deg,
            phi_r_deg=scan.phi_r_deg,
            n=len(scan),
            theta_r_min_deg=m.brdf.theta_r_deg[scan.rows].min(),
            theta_r_max_deg=m.brdf.theta_r_deg[scan.rows].max(),
            value_min=m.brdf.value[scan.rows].min(),
            value_max=m.brdf.value[scan.rows].max(),
            rms_dex=s.residuals.scan_rms[i],
            bias_dex=s.residuals.scan_bias[i],
            lag1=s.residuals.scan_lag1[i],
            scale=1.0 if s.scales is None else s.scales[:, i].mean(),
            u_scale=0.0 if s.scales is None else s.scales[:, i].std(),
        )
        for i, scan in enumerate(m.scans)
    )
    return Input(
        file=m.source,
        sha256=m.sha256,
        n_brdf=len(m.brdf),
        n_dhr=len(m.dhr),
        excluded=m.excluded,
        warnings=tuple(m.warnings),
        checks=s.checks,
        scans=scans,
    )


def versions() -> dict[str, str]:
    """Version of this package and of those that its numbers and pages depend on."""
    found = {"pbrdf-bayes": __version__}
    for name in _PACKAGES:
        found[name] = metadata.version(name)
    return found


def _parameters(s: Stages) -> dict[str, Parameter]:
    flat, draws = s.draws.flat, s.draws
    honest = dict(zip(s.identifiability.names, s.identifiability.honest, strict=True))
    by_prior = dict(zip(s.sensitivity.names, s.sensitivity.prior, strict=True))
    by_readings = dict(zip(s.sensitivity.names, s.sensitivity.likelihood, strict=True))
    table = {}
    for i, spec in enumerate(s.posterior.specs):
        name, values = spec.name, flat[:, i]
        q025, q05, median, q95, q975 = np.quantile(values, [0.025, 0.05, 0.5, 0.95, 0.975])
        mean, sd = (values[0], 0.0) if spec.is_fixed else (values.mean(), values.std(ddof=1))
        explained = np.nan if spec.is_fixed else contraction(spec, values)
        table[name] = Parameter(
            symbol=spec.symbol, unit=spec.unit, description=spec.description, kind=spec.kind,
            mean=mean, sd=sd, median=median, q05=q05, q95=q95, q025=q025, q975=q975,
            map=s.optima.best.x[i], ess_bulk=draws.ess_bulk[i], ess_tail=draws.ess_tail[i],
            rhat=draws.rhat[i], mcse_mean=draws.mcse_mean[i], prior=spec.prior.describe(),
            prior_sd=spec.prior.standard_deviation, contraction=explained,
            identified=bool(honest.get(name, explained) >= CONTRACTION_WARN),
            contraction_effective=honest.get(name, UNSET),
            prior_sensitivity=by_prior.get(name, UNSET),
            likelihood_sensitivity=by_readings.get(name, UNSET),
        )  # fmt: skip
    return table


def _correlation(s: Stages) -> CorrelationMatrix:
    free = s.posterior.free
    names = tuple(s.posterior.parameter_names[i] for i in free)
    matrix: list[list[float]] = np.atleast_2d(np.corrcoef(s.draws.flat[:, free].T)).tolist()
    return CorrelationMatrix(names, matrix)


def _fit(s: Stages) -> Fit:
    labels = [scan.label for scan in s.posterior.measurement.scans]
    x, rms = s.least_squares
    found, specs = s.residuals, s.posterior.specs
    best = {spec.name: v for spec, v in zip(specs, x, strict=True) if spec.kind != "nuisance"}
    return Fit(
        OverScans(found.rms, dict(zip(labels, found.scan_rms, strict=True))),
        Best(rms, best),
        OverScans(found.lag1, dict(zip(labels, found.scan_lag1, strict=True))),
    )


def _map(s: Stages) -> Map:
    names, top = s.posterior.parameter_names, s.optima.best.log_posterior
    return Map(
        s.optima.n_starts,
        tuple(
            OptimumSummary(
                o.log_posterior, o.log_posterior - top, o.n_starts,
                dict(zip(names, o.x, strict=True)),
            )
            for o in s.optima.optima
        ),
    )  # fmt: skip


def _sampling(draws: Draws) -> Sampling:
    n_ensembles = len(np.unique(draws.ensemble))
    return Sampling(
        method=draws.method, n_ensembles=n_ensembles, n_walkers=len(draws.x) // n_ensembles,
        n_steps=draws.n_steps, n_burn=draws.n_burn, thin=draws.thin,
        n_draws=draws.x.shape[0] * draws.x.shape[1], acceptance=draws.acceptance.mean(),
        autocorrelation_time=draws.autocorrelation_time, k_hat=draws.k_hat, moves=draws.moves,
        n_evaluations=draws.n_evaluations,
    )  # fmt: skip


def _rejected(s: Stages) -> RejectedPoints:
    found = together(s.optima.rejected, s.draws.rejected)
    names = s.posterior.parameter_names
    examples = tuple(dict(zip(names, x.tolist(), strict=True)) for x in found.examples)
    return RejectedPoints(found.n, examples)


def _holdout(found: Holdout | None) -> RecipeHoldout | None:
    if found is None:
        return None
    return RecipeHoldout(
        fitted=found.fitted, rms_dex=found.rms_dex, coverage_90=found.coverage_90,
        width_dex=found.width_dex, statement=found.statement, scans=found.scans,
    )  # fmt: skip


def _holdouts(s: Stages) -> tuple[Prediction, ...]:
    """Every prediction of scans left out, the recipe first."""
    recipe = () if s.holdout is None else (s.holdout,)
    return tuple(
        Prediction(
            kind=h.kind, name=h.name, fitted=h.fitted, n=h.value.size, rms_dex=h.rms_dex,
            rms_expected_dex=h.expected_dex, coverage_90=h.coverage_90, width_dex=h.width_dex,
            statement=h.statement, verdict=judge_holdout(h),
        )
        for h in (*recipe, *s.holdouts)
    )  # fmt: skip


def _leave_one_out(found: LeaveOneOut) -> LeaveOneOutSummary:
    return LeaveOneOutSummary(
        elpd=found.elpd, u_elpd=found.u_elpd, p_loo=found.p_loo, n=found.n_readings,
        n_draws=found.n_draws, k_hat=found.k_hat, k_hat_limit=found.k_hat_limit,
        n_influential=found.n_influential, most_influential=found.most_influential,
        farthest=found.farthest, pit=found.scans,
    )  # fmt: skip
