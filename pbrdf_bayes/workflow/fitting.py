"""The stages from a file to a report; the only module that knows all others."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.config import ACCURACIES, AUTO, RunConfig
from pbrdf_bayes.inference.effects_choice.choose import choose_effects, time_likelihood
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.least_squares import fit_least_squares
from pbrdf_bayes.inference.optimum.map_fit import MapResult, find_map
from pbrdf_bayes.inference.parameters.effects import before_choice
from pbrdf_bayes.inference.posterior import Posterior, build_posterior, normalisation_change
from pbrdf_bayes.inference.prediction.bands import scan_scales
from pbrdf_bayes.inference.prediction.holdout import run_holdout
from pbrdf_bayes.inference.prediction.holdout_cases import (
    list_cases,
    run_cases,
    why_no_angle_left_out,
)
from pbrdf_bayes.inference.prediction.leave_one_out import leave_each_out
from pbrdf_bayes.inference.prediction.residuals import (
    calibrated_residuals,
    compute_residuals,
    effective_share,
    white_noise_dex,
)
from pbrdf_bayes.inference.prediction.scan_widths import measure_widths
from pbrdf_bayes.inference.prior_support import (
    refuse_impossible_priors,
    refuse_untold_instrument,
)
from pbrdf_bayes.inference.sampling.ensembles import Checkpoint
from pbrdf_bayes.inference.sampling.power_scaling import measure_sensitivity
from pbrdf_bayes.inference.sampling.sampling import Draws, Progress, sample_posterior
from pbrdf_bayes.io import run_folder
from pbrdf_bayes.io.checkpoint import Checkpoints, open_checkpoints, remove_checkpoints
from pbrdf_bayes.io.config_toml import config_to_toml
from pbrdf_bayes.io.tidy_csv import read_measurement
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.readings.checks import check_measurement
from pbrdf_bayes.readings.mistakes import find_mistakes
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import EffectsChoice
from pbrdf_bayes.report.page import render_report
from pbrdf_bayes.results import N_BAND_DRAWS
from pbrdf_bayes.verdicts.applicability import (
    expected_rms,
    find_repeatability,
    held_out_rms,
    judge_applicability,
    list_assumed,
    list_only_bounded,
)
from pbrdf_bayes.verdicts.common_misfit import compare_misfits
from pbrdf_bayes.verdicts.dhr_misfit import measure_dhr_misfit
from pbrdf_bayes.verdicts.diagnostics import assess_identifiability, run_diagnostics
from pbrdf_bayes.verdicts.discrepancy_size import measure_discrepancy
from pbrdf_bayes.verdicts.reciprocity_size import measure_reciprocity
from pbrdf_bayes.workflow.compile_ahead import WITH_EFFECTS, compile_ahead, likelihood_to_compile
from pbrdf_bayes.workflow.curves import count_covered, predict_curves, predict_dhr
from pbrdf_bayes.workflow.paperwork import Paperwork, amend_folder, complete, write_pdf
from pbrdf_bayes.workflow.resume import (
    as_finished,
    can_walk_on,
    finished_summary,
    going_on,
    history,
    run_identity,
    stage_checkpoint,
)
from pbrdf_bayes.workflow.stages import Stages
from pbrdf_bayes.workflow.summary import summarise
from pbrdf_bayes.workflow.tree import build_tree

Array = NDArray[np.float64]

DEFAULT_SEED = 1


@dataclass(frozen=True)
class Observer:
    """Who is told how far a fit is; by default nobody."""

    stage: Callable[[str], None] = field(default=lambda _: None)
    progress: Callable[[Progress], None] | None = None


@dataclass
class _Clock:
    """Times the stages and keeps the log."""

    observer: Observer
    timings: dict[str, float] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.observer.stage(name)
        started = time.perf_counter()
        yield
        self.timings[name] = time.perf_counter() - started
        stamp = datetime.now(UTC).strftime("%H:%M:%S")
        self.log.append(f"{stamp}Z {name}: {self.timings[name]:.2f} s")


def fit(
    measurement: Measurement,
    config: RunConfig | None = None,
    *,
    seed: int = DEFAULT_SEED,
    observer: Observer | None = None,
) -> Analysis:
    """Posterior of the four parameters from a measurement, with diagnostics and predictions.

    Parameters
    ----------
    measurement : Measurement
    config : RunConfig, optional
    seed : int
        The draws are a function of it.
    observer : Observer, optional
        Told about stages and the sampler's progress.

    Returns
    -------
    Analysis
        ``summary["status"]`` is ``"not_converged"`` when the sampler's budget ran out first.

    Raises
    ------
    ConfigError, DataError
        Choices and readings that do not fit together.
    FitError
        No start has a finite posterior density.
    """
    clock = _Clock(observer or Observer())
    config, choice = _chosen_effects(measurement, config or RunConfig(), seed, clock)
    with clock.stage("check"):
        checks = check_measurement(measurement)
        posterior = build_posterior(measurement, config)
        refuse_impossible_priors(posterior)
        refuse_untold_instrument(posterior)
    return _fit_posterior(posterior, checks, seed, clock, choice=choice)


def _chosen_effects(
    measurement: Measurement, config: RunConfig, seed: int, clock: _Clock
) -> tuple[RunConfig, EffectsChoice | None]:
    """The configuration with its effects named, and how they were chosen if they were."""
    if config.effects != AUTO:
        return config, None
    with clock.stage("compile"):
        compile_ahead("iid" + WITH_EFFECTS)
    with clock.stage("choose effects"):
        return choose_effects(measurement, config, seed=seed, told=clock.observer.stage)


def _fit_posterior(
    posterior: Posterior, checks: tuple[Check, ...], seed: int, clock: _Clock,
    checkpoints: Checkpoints | None = None, choice: EffectsChoice | None = None,
) -> Analysis:  # fmt: skip
    config = posterior.config
    checkpoint = partial(stage_checkpoint, checkpoints)
    with clock.stage("optimise"):
        optima = find_map(posterior, seed=seed)
        best_x, best_rms = fit_least_squares(posterior, np.array([o.x for o in optima.optima]))
        residuals = compute_residuals(posterior, optima.best.x)
        best = calibrated_residuals(posterior, best_x)
    with clock.stage("sample"):
        draws = _sample(posterior, optima, seed, clock.observer.progress, checkpoint("sample"))
    with clock.stage("identify"):
        share = effective_share(best.lag1) if posterior.discrepancy is None else 1.0
        tempered = _tempered_draws(posterior, draws, share, seed, checkpoint("identify"))
        identifiability = assess_identifiability(
            posterior, draws.flat, tempered, share, (optima.best.x, best_x)
        )
        discrepancy = measure_discrepancy(posterior, draws.flat, seed=seed)
        sensitivity = measure_sensitivity(posterior, draws)
        common = compare_misfits(posterior, optima.best.x, seed=seed)
    with clock.stage("predict"):
        rng = np.random.default_rng([seed, 6])
        picked = draws.flat[rng.choice(len(draws.flat), N_BAND_DRAWS)]
        curves = predict_curves(posterior, picked, optima.best.x, rng)
        dhr_curves = predict_dhr(posterior, picked, optima.best.x, rng)
        scales = scan_scales(posterior, picked, rng)
        widths = measure_widths(posterior, picked, optima.best.x)
        reciprocity = measure_reciprocity(posterior, picked)
        covered = count_covered(posterior, picked, optima.best.x, scales, rng)
    with clock.stage("leave one out"):
        leave_one_out = leave_each_out(posterior, draws.flat, seed=seed)
    with clock.stage("hold out"):
        m, wanted = posterior.measurement, config.holdouts
        holdout = None
        if wanted != "none":
            holdout = run_holdout(m, config, seed=seed, checkpoint=checkpoint("holdout"))
        cases = list_cases(m) if wanted == "all" else ()
        holdouts = run_cases(posterior, optima.best.x, cases, seed=seed)
    noise = white_noise_dex(posterior, best_x)
    repeatability = find_repeatability(m, noise, config.brdf_floor)
    told = dict(zip(identifiability.names, identifiability.honest.tolist(), strict=True))
    applicability = judge_applicability(
        best_rms_dex=best_rms, repeatability=repeatability, at_bound=identifiability.at_bound,
        held_out={**(choice.held_out if choice is not None else {}), **held_out_rms(holdouts)},
        expected=expected_rms(holdouts),
        untested=why_no_angle_left_out(m, wanted),
        assumed=list_assumed(posterior.specs, config.priors, told)
        + list_only_bounded(identifiability.null_at),
        extended=choice is not None or bool(config.additions),
    )  # fmt: skip
    diagnostics = run_diagnostics(
        config=config, draws=draws, optima=optima, residuals=best, best_rms_dex=best_rms,
        repeatability=repeatability, identifiability=identifiability,
        covered=covered, holdout=holdout, discrepancy=discrepancy,
        leave_one_out=leave_one_out, sensitivity=sensitivity, holdouts=holdouts,
        applicability=applicability, common=common,
        dhr_misfit=measure_dhr_misfit(posterior, optima.best.x),
    )  # fmt: skip
    stages = Stages(
        posterior=posterior, seed=seed, checks=checks,
        findings=find_mistakes(posterior.measurement), optima=optima, draws=draws,
        least_squares=(best_x, best_rms), residuals=residuals, best_dex=best.dex,
        identifiability=identifiability, diagnostics=diagnostics, curves=curves,
        dhr_curves=dhr_curves, sensitivity=sensitivity, leave_one_out=leave_one_out,
        holdout=holdout, holdouts=holdouts, scales=scales, discrepancy=discrepancy,
        normalisation_error=normalisation_change(posterior, optima.best.x),
        microseconds=time_likelihood(posterior, optima.best.x), timings=clock.timings,
        effects_choice=choice, applicability=applicability, reciprocity=reciprocity,
        widths=widths,
    )  # fmt: skip
    return Analysis(
        summary=summarise(stages),
        draws=build_tree(stages),
        config_toml=config_to_toml(config),
        fitted=posterior,
    )


def _sample(
    posterior: Posterior, optima: MapResult, seed: int,
    progress: Callable[[Progress], None] | None, checkpoint: Checkpoint,
) -> Draws:  # fmt: skip
    method = ACCURACIES[posterior.config.accuracy].method
    mixture = laplace_mixture(posterior, optima)
    return sample_posterior(
        posterior, mixture, posterior.config, method=method, seed=seed, progress=progress,
        checkpoint=checkpoint,
    )  # fmt: skip


def _tempered_draws(
    posterior: Posterior, draws: Draws, share: float, seed: int, checkpoint: Checkpoint
) -> Array:
    """Draws with the likelihood weakened to the effective number of readings."""
    if share == 1.0:
        return draws.flat
    draft = replace(posterior.config, accuracy="draft", max_steps=2000)
    weak = replace(posterior.tempered(share), config=draft)
    optima = find_map(weak, n_starts=4, seed=seed)
    mixture = laplace_mixture(weak, optima)
    return sample_posterior(
        weak, mixture, draft, method="psis", seed=seed, checkpoint=checkpoint
    ).flat


@dataclass(frozen=True)
class FitRun:
    """A fit as a run folder on disk; ``notice`` says why it was fitted again, if it was."""

    folder: Path
    status: str
    verdict: str
    notice: str = ""


def fit_file(
    csv: Path,
    config: RunConfig,
    *,
    sample: str | None = None,
    wavelength_um: float | None = None,
    out: Path | None = None,
    seed: int = DEFAULT_SEED,
    resume: bool = False,
    paperwork: Paperwork | None = None,
    observer: Observer | None = None,
) -> FitRun:
    """From the CSV of a sample to its run folder and report.

    Parameters
    ----------
    csv : Path
    config : RunConfig
    sample : str, optional
        Needed where the file holds several samples.
    wavelength_um : float, optional
        Needed where the sample has several wavelengths [um].
    out : Path, optional
        The run folder itself; reports/<sample>/<time> by default.
    seed : int
    resume : bool
        A finished run in ``out`` is returned as it is. A run whose files were damaged is fitted
        again, and ``notice`` says so. An unfinished one goes on from its
        checkpoint, to the draws that it would have had without the interruption; so does one that
        did not converge, where ``max_steps`` is larger now.
    paperwork : Paperwork, optional
        Limits to be judged, items of the report, and the report as PDF; for a finished run too.
    observer : Observer, optional

    Returns
    -------
    FitRun

    Raises
    ------
    DataError, ConfigError
        Nothing was written.
    RunFolderError
        ``out`` holds a run already or a different one, is in use by another process, has a damaged
        checkpoint, or cannot be written.
    """
    observer = observer or Observer()
    if paperwork is not None:
        paperwork.check()
    observer.stage("read")
    measurement = read_measurement(
        csv,
        sample=sample,
        wavelength_um=wavelength_um,
        brdf_floor=config.brdf_floor,
        angle_tolerance_deg=config.angle_tolerance_deg,
    )
    folder = out or run_folder.new_run_folder(Path("reports"), measurement.sample)
    return fit_into(
        folder,
        measurement,
        config,
        seed=seed,
        resume=resume,
        observer=observer,
        paperwork=paperwork,
    )


def fit_into(
    folder: Path, measurement: Measurement, config: RunConfig, *, seed: int = DEFAULT_SEED,
    resume: bool = False, observer: Observer | None = None, paperwork: Paperwork | None = None,
    brief: bool = False,
) -> FitRun:  # fmt: skip
    """From a measurement to its run folder and report; see `fit_file`.

    ``brief`` makes the report with one figure alone; `rebuild_report` draws the others.
    """
    clock, wanted = _Clock(observer or Observer()), paperwork or Paperwork()
    with clock.stage("check"):
        wanted.check_for(measurement)
        checks = check_measurement(measurement)
        posterior = build_posterior(measurement, before_choice(config))
        refuse_impossible_priors(posterior)
        refuse_untold_instrument(posterior)
    if not (resume and folder.is_dir()):
        run_folder.refuse_other_content(
            folder, what="the folder of the run", remedy="Add --resume, or give another --out"
        )
    notice = ""
    if resume and run_folder.is_finished(folder):
        summary = finished_summary(folder, as_finished(posterior, config, folder), seed)
        damage = run_folder.damage_of(folder, summary)
        if damage:
            notice = f"{folder}: the run was damaged ({damage}), and was fitted again"
        elif not can_walk_on(folder, summary, config):
            if wanted.amends or wanted.pdf:
                amend_folder(folder, wanted)
            return FitRun(folder, summary["status"], summary["verdict"])
    with run_folder.locked(folder):
        config, choice = _chosen_effects(measurement, config, seed, clock)
        if choice is not None:
            posterior = build_posterior(measurement, config)
        missing = likelihood_to_compile(posterior)
        if missing is not None:
            with clock.stage("compile"):
                compile_ahead(missing)
        checkpoints = open_checkpoints(folder, run_identity(posterior, seed))
        with going_on(checkpoints):
            analysis = _fit_posterior(posterior, checks, seed, clock, checkpoints, choice)
            analysis = _completed(analysis, wanted, clock)
            with clock.stage("report"):
                report = render_report(analysis, brief=brief)
        told = [notice] * bool(notice) + [f"sample {measurement.sample!r}, seed {seed}"]
        log = "\n".join([*told, *clock.log, *history(checkpoints, analysis.summary), ""])
        run_folder.save_analysis(analysis, folder, report=report, log=log)
        if analysis.summary["status"] == "done":
            remove_checkpoints(folder)
        if wanted.pdf:
            with clock.stage("print"):
                write_pdf(folder, report)
    return FitRun(folder, analysis.summary["status"], analysis.summary["verdict"], notice)


def _completed(analysis: Analysis, wanted: Paperwork, clock: _Clock) -> Analysis:
    if not wanted.amends:
        return analysis
    with clock.stage("judge limits" if wanted.specification is not None else "fill in"):
        return complete(analysis, wanted)
