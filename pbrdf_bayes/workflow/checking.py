"""The text of the ``check`` verb: what a file holds and what is odd about it."""

from __future__ import annotations

import json
from pathlib import Path

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.io.tidy_csv import read_samples
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.readings.checks import check_measurement, find_problems
from pbrdf_bayes.readings.mistakes import find_mistakes
from pbrdf_bayes.records.checks import Findings
from pbrdf_bayes.records.values import plain

_MARK = {"PASS": "ok  ", "WARN": "WARN", "FAIL": "FAIL", "SKIP": "-   "}


def describe_file(path: Path, config: RunConfig) -> tuple[str, bool]:
    """Summary of every sample of a tidy CSV, and whether there are any and nothing is wrong.

    Parameters
    ----------
    path : Path
    config : RunConfig
        Its floor and its tolerance of angles count.

    Returns
    -------
    tuple of str and bool

    Raises
    ------
    DataError
        When the file as a whole cannot be read.
    """
    content = read_samples(
        path, brdf_floor=config.brdf_floor, angle_tolerance_deg=config.angle_tolerance_deg
    )
    blocks = [f"{content.source}: {content.n_rows} rows, sha256 {content.sha256[:12]}"]
    blocks += [f"warning: {text}" for text in content.warnings]
    blocks += [_describe(m, set(content.warnings)) for m in content.measurements.values()]
    blocks += [f"{name}: not usable\n{text}" for name, text in content.errors.items()]
    if content.message and not content.errors:
        blocks.append(content.message)
    return "\n\n".join(blocks), bool(content.measurements) and not content.message


def find_in_file(path: Path, config: RunConfig) -> tuple[str, str]:
    """Findings about every usable sample of a tidy CSV, and why others are not usable.

    Parameters
    ----------
    path : Path
    config : RunConfig
        Its floor and its tolerance of angles count.

    Returns
    -------
    tuple of str
        JSON of `pbrdf_bayes.records.checks.Findings`, and a message that may be empty.

    Raises
    ------
    DataError
        When the file as a whole cannot be read.
    """
    content = read_samples(
        path, brdf_floor=config.brdf_floor, angle_tolerance_deg=config.angle_tolerance_deg
    )
    found = tuple(
        f for m in content.measurements.values() for f in (*find_mistakes(m), *find_problems(m))
    )
    text = json.dumps(plain(Findings(findings=found)), indent=1, ensure_ascii=False)
    return text, content.message


def _describe(m: Measurement, said: set[str]) -> str:
    lines = [
        f"{m.sample}, {m.wavelength_um:g} um: {len(m.brdf)} BRDF and {len(m.dhr)} DHR readings"
    ]
    for scan in m.scans:
        theta, value = m.brdf.theta_r_deg[scan.rows], m.brdf.value[scan.rows]
        lines.append(
            f"  scan {scan.label:<16} {len(scan):5d} rows  theta_r {theta.min():g} to "
            f"{theta.max():g} deg  BRDF {value.min():.3g} to {value.max():.3g} sr^-1"
        )
    for q in dict.fromkeys(m.dhr.polarization.tolist()):
        rows = m.dhr.polarization == q
        angle, value = m.dhr.theta_i_deg[rows], m.dhr.value[rows]
        lines.append(
            f"  DHR  {q:<16} {rows.sum():5d} rows  theta_i {angle.min():g} to {angle.max():g} deg  "
            f"DHR {value.min():.3g} to {value.max():.3g}"
        )
    lines += [f"  excluded by flag {flag!r}: {count} rows" for flag, count in m.excluded.items()]
    lines += [f"  warning: {text}" for text in m.warnings if text not in said]
    for finding in find_mistakes(m):
        lines.append(f"  {_MARK[finding.verdict]} {finding.statement}")
        lines.append(f"       {finding.remedy}")
    for check in check_measurement(m):
        lines.append(f"  {_MARK[check.verdict]} {check.title}: {check.statement}")
        if check.advice and check.verdict in ("WARN", "FAIL"):
            lines.append(f"       {check.advice}")
    if len(m.brdf):
        span = m.brdf.value.max() / max(m.brdf.value[m.brdf.value > 0.0].min(initial=1e99), 1e-99)
        lines.append(f"  dynamic range of the BRDF: {span:.3g}")
    return "\n".join(lines)
