"""Going on with a run: what makes it the same run, and what its samplers go on from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pbrdf_bayes.config import AUTO, RunConfig
from pbrdf_bayes.inference.effects_choice.choose import as_chosen
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.sampling.ensembles import (
    Checkpoint,
    SamplerState,
    state_from_arrays,
    state_to_arrays,
)
from pbrdf_bayes.io.checkpoint import Checkpoints, has_checkpoints, remove_checkpoints
from pbrdf_bayes.io.config_toml import config_table
from pbrdf_bayes.io.run_folder import load_summary, locked, refuse_difference
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.workflow.summary import versions

_DECISIVE = ("pbrdf-bayes", "numpy", "scipy", "numba", "emcee", "nlopt", "arviz-stats")
"""Packages another version of which may draw something else."""
_NOT_DECISIVE = ("threads", "max_steps")
"""Choices that the steps of a walk do not depend on, but for how many there are."""


def run_identity(posterior: Posterior, seed: int) -> dict[str, Any]:
    """All that the draws of a run are a function of, as plain values.

    Parameters
    ----------
    posterior : Posterior
    seed : int
    """
    m, config = posterior.measurement, plain(config_table(posterior.config))
    return {
        "data": m.sha256, "sample": m.sample, "wavelength_um": m.wavelength_um, "seed": seed,
        "parameters": list(posterior.parameter_names),
        **_decisive(config), **_versions(versions()),
    }  # fmt: skip


def finished_summary(folder: Path, posterior: Posterior, seed: int) -> dict[str, Any]:
    """Summary of the finished run that is there, if it is the one that was asked for.

    Versions of packages do not count: nothing is drawn any more.

    Raises
    ------
    RunFolderError
        With what differs, where it is another one.
    """
    summary = load_summary(folder)
    found = {
        "data": summary["input"]["sha256"], "sample": summary["sample"],
        "wavelength_um": summary["wavelength_um"], "seed": summary["seed"],
        "parameters": list(summary["parameters"]), **_decisive(summary["config"]),
    }  # fmt: skip
    wanted = {key: value for key, value in run_identity(posterior, seed).items() if key in found}
    refuse_difference(
        found, wanted, what=f"{folder}: holds the run",
        remedy="Give another --out",
    )  # fmt: skip
    if summary["status"] == "done" and has_checkpoints(folder):  # ended before this
        with locked(folder):
            remove_checkpoints(folder)
    return summary


def can_walk_on(folder: Path, summary: Mapping[str, Any], config: RunConfig) -> bool:
    """A run that ended for want of steps, and has more of them now."""
    ended = summary["status"] != "done" and config.max_steps > summary["config"]["max_steps"]
    return bool(ended and has_checkpoints(folder))


def as_finished(posterior: Posterior, config: RunConfig, folder: Path) -> Posterior:
    """The posterior with effects as the finished run chose them, if it was left to choose."""
    if config.effects != AUTO:
        return posterior
    found = load_summary(folder)
    if found["effects_choice"] is None:  # it was not: that differs
        return replace(posterior, config=config)
    chosen = as_chosen(
        posterior.measurement, config,
        effects=tuple(found["effects"]), line_shape=found["line_shape"],
    )  # fmt: skip
    return build_posterior(posterior.measurement, chosen)


def _decisive(config: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in config.items() if key not in _NOT_DECISIVE}


def _versions(table: Mapping[str, str]) -> dict[str, str | None]:
    return {f"version of {name}": table.get(name) for name in _DECISIVE}


def stage_checkpoint(checkpoints: Checkpoints | None, stage: str) -> Checkpoint:
    """What the sampler of a stage needs of the checkpoints of a run folder, if there is one."""
    if checkpoints is None:
        return Checkpoint()

    def keep(state: SamplerState, at_once: bool) -> None:
        checkpoints.keep(stage, state_to_arrays(state), at_once=at_once)

    arrays = checkpoints.found.get(stage)
    return Checkpoint(None if arrays is None else state_from_arrays(arrays), keep)


@contextmanager
def going_on(checkpoints: Checkpoints) -> Iterator[None]:
    """Store the last state when the run is interrupted, and note how it can be finished."""
    try:
        with checkpoints.kept_when_interrupted():
            yield
    except BaseException as stop:
        stop.add_note(f"go on with: --out {checkpoints.folder} --resume")
        raise


def history(checkpoints: Checkpoints, summary: Mapping[str, Any]) -> list[str]:
    """Lines of the log: where the run went on from, and the points that the model rejected."""
    lines = [
        f"{stage}: gone on from step {arrays['z'].shape[1]} of a checkpoint"
        for stage, arrays in checkpoints.found.items()
    ]
    rejected = summary["rejected"]
    if rejected["n"]:
        lines.append(f"{rejected['n']} points rejected: the model gave no finite density, e.g. at")
        lines += [f"  {point}" for point in rejected["examples"]]
    return lines
