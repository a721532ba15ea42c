"""What came out for a sample: one row of the index, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pbrdf_bayes.batch.plan import Job
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.words import say

DONE, FAILED, SKIPPED = "done", "failed", "skipped"
"""What became of a sample; skipped: fitted by an earlier batch, a repeat, or not reached."""
Row = dict[str, Any]

_KEPT = ("symbol", "unit", "kind", "mean", "sd", "median", "q025", "q975", "identified")
RISKS = (
    "p_conformity", "u_p_conformity", "p_conformity_low", "p_conformity_high", "consumer_risk",
    "producer_risk",
)  # fmt: skip
"""Of a row: probability of conformity, its Monte Carlo error and 95 % limits, specific risks."""
_MOST_POINTS = 41
_CURVE_AT_DEG = 20.0


def failed_row(job: Job, error: str, *, seconds: float = 0.0, run: str | None = None) -> Row:
    """Row of a sample without a result."""
    return _row(job, FAILED, error=error, seconds=round(seconds, 3), run=run)


def open_row(job: Job, error: str) -> Row:
    """Row of a sample that was not reached; it is still to be done."""
    return _row(job, SKIPPED, error=error)


def repeat_row(job: Job) -> Row:
    """Row of a sample that has the readings of another and is not fitted again."""
    assert job.repeat_of is not None
    return _row(job, SKIPPED, error=job.error, repeat_of=job.repeat_of + 1)


def _row(job: Job, status: str, **found: Any) -> Row:
    m = job.measurement
    return {
        "sample": job.sample, "source": Path(job.source).name,
        "wavelength_um": job.wavelength_um, "n_brdf": None if m is None else len(m.brdf),
        "n_dhr": None if m is None else len(m.dhr), "curves": [] if m is None else curves_of(m),
        "status": status, "verdict": None, "headline": None, "run": None, "error": None,
        "notice": job.notice or None, "repeat_of": None, "seconds": 0.0, "rms_dex": None,
        "conformity": None, **dict.fromkeys(RISKS), "parameters": {}, **found,
    }  # fmt: skip


def noted(row: Row, notice: str) -> Row:
    """The row with one more thing that its reader should know."""
    return {**row, "notice": f"{row['notice']} {notice}" if row["notice"] else notice}


def finished_row(job: Job, summary: Mapping[str, Any], *, status: str, seconds: float) -> Row:
    """Row of a sample from the summary of its run.

    One that did not converge has failed: its numbers stay in its run folder.
    """
    if summary["status"] != "done":
        error = say("batch.not_converged", folder=job.folder)
        return failed_row(job, error, seconds=seconds, run=job.folder)
    row = _row(
        job, status, verdict=summary["verdict"], headline=summary["headline"], run=job.folder,
        seconds=round(seconds, 3), rms_dex=summary["fit"]["rms_dex_best"]["overall"],
        **_judged(summary.get("conformity")),
        parameters={
            name: {key: record[key] for key in _KEPT}
            for name, record in summary["parameters"].items()
            if record["kind"] != "nuisance"
        },
    )  # fmt: skip
    found: Row = plain(row)
    return found


def _judged(conformity: Mapping[str, Any] | None) -> dict[str, Any]:
    """Verdict, probability of conformity with its Monte Carlo error and limits, specific risks.

    The numbers are those of the limits that can be judged; none where no limit can be.
    """
    if not conformity:
        return {}
    if not any(limit["judged"] for limit in conformity["limits"]):
        return {"conformity": conformity["verdict"]}
    p = conformity["probability"]
    risks = (conformity["consumer_risk"], conformity["producer_risk"])
    values = (p["value"], p["u"], p["low"], p["high"], *risks)
    return {"conformity": conformity["verdict"], **dict(zip(RISKS, values, strict=True))}


def curves_of(m: Measurement) -> list[dict[str, Any]]:
    """Readings of one scan of each polarisation, the one nearest to 20 degrees, thinned.

    Returns
    -------
    list of dict
        ``polarization``, ``theta_i_deg`` [deg], ``theta_r_deg`` [deg], ``value`` [sr^-1].
    """
    found = []
    for q in dict.fromkeys(scan.polarization for scan in m.scans):
        own = [scan for scan in m.scans if scan.polarization == q]
        scan = min(own, key=lambda s: (s.phi_r_deg != 0.0, abs(s.theta_i_deg - _CURVE_AT_DEG)))
        picked = np.linspace(scan.start, scan.stop - 1, min(len(scan), _MOST_POINTS)).astype(int)
        found.append(
            {
                "polarization": q,
                "theta_i_deg": scan.theta_i_deg,
                "theta_r_deg": m.brdf.theta_r_deg[picked].tolist(),
                "value": [float(f"{v:.4g}") for v in m.brdf.value[picked]],
            }
        )
    return found
