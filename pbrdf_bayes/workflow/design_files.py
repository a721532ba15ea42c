"""The verb ``design``: a run folder or a configuration in, JSON, page and plan out."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.run import DesignChoices
from pbrdf_bayes.io.run_folder import (
    DESIGN,
    DESIGN_PAGE,
    PLAN,
    REPORT,
    locked,
    refuse_other_content,
    validate_design,
    write_text,
)
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.workflow.candidates_csv import Wanted
from pbrdf_bayes.workflow.next_measurement import Told, answer, ask

COLUMNS = (
    "order", "quantity", "polarization", "theta_i_deg", "theta_r_lo_deg", "theta_r_hi_deg",
    "theta_r_step_deg", "port_deg", "readings", "minutes", "cumulative_minutes",
    "expected_gain_nats",
)  # fmt: skip
"""Columns of the plan."""


@dataclass(frozen=True, kw_only=True)
class DesignRequest:
    """What ``design`` is asked for.

    Attributes
    ----------
    folder : Path, optional
        A finished run; without one the priors of ``config`` are designed from.
    config : RunConfig
    wanted : Wanted
    goals, about : sequence of str
    choices : DesignChoices
    out : Path, optional
        Folder to write into; the run's own by default. Without both nothing is written.
    """

    folder: Path | None = None
    config: RunConfig = field(default_factory=RunConfig)
    wanted: Wanted = field(default_factory=Wanted)
    goals: Sequence[str] = ()
    about: Sequence[str] = ()
    choices: DesignChoices = field(default_factory=DesignChoices)
    out: Path | None = None


def run_design(request: DesignRequest, told: Told = lambda *_: None) -> dict[str, Any]:
    """Compute a design and write it, each file whole or not at all.

    Parameters
    ----------
    request : DesignRequest
    told : callable
        Told the stage, and how many of how many candidates are done.

    Returns
    -------
    dict
        The content of ``design.json``.

    Raises
    ------
    ConfigError, DataError
        Nothing was written.
    RunFolderError
        Not a finished run, in use by another process, or a folder that holds something else.
    """
    folder = request.folder
    out = request.out or folder
    at_home = folder is not None and out is not None and out.resolve() == folder.resolve()
    if out is not None and not at_home:
        refuse_other_content(
            out, known=(DESIGN, DESIGN_PAGE, PLAN), what="a folder", remedy="Give another --out"
        )
    source = request.config if folder is None else load_analysis(folder)
    question = ask(
        source, request.wanted, goals=request.goals, about=request.about, choices=request.choices
    )
    with nullcontext() if out is None else locked(out):
        design: dict[str, Any] = plain(answer(question, told))
        if out is not None:
            _write(design, out)
            if at_home and isinstance(source, Analysis):
                _rebuild_report(source, design, out)
    return design


def _write(design: Mapping[str, Any], out: Path) -> None:
    """The JSON comes last: it marks the others as complete."""
    from pbrdf_bayes.report.design_page import render_design  # loads the plots

    validate_design(design, where=str(out))
    page = render_design(design)
    write_text(out / PLAN, plan_csv(design))
    write_text(out / DESIGN_PAGE, page)
    write_text(out / DESIGN, json.dumps(design, indent=1, ensure_ascii=False) + "\n")


def _rebuild_report(analysis: Analysis, design: Mapping[str, Any], folder: Path) -> None:
    from pbrdf_bayes.report.page import render_report

    write_text(folder / REPORT, render_report(replace(analysis, design=design)))


def plan_csv(design: Mapping[str, Any]) -> str:
    """The batch as CSV, in the order in which to take it.

    Its columns are those of candidates and some more, so that it can be given to ``--candidates``.

    Parameters
    ----------
    design : mapping
        The content of ``design.json``.
    """
    lines = [",".join(COLUMNS)]
    for i, row in enumerate(design["batch"]["members"], start=1):
        cells = row | {
            "order": i,
            "readings": row["n_readings"],
            "minutes": round(row["minutes"], 4),
            "cumulative_minutes": round(row["cumulative_minutes"], 4),
            "expected_gain_nats": round(row["added_nats"], 4),
        }
        lines.append(",".join("" if cells[c] is None else f"{cells[c]}" for c in COLUMNS))
    return "\n".join(lines) + "\n"
