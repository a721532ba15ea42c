"""Whether 90 % intervals hold the truth when the model is wrong along theta_r.

Each simulation draws a paint, adds a misfit of one shape to the logarithm of its BRDF, and fits
with the likelihood that allows for a discrepancy and with the one of independent readings. Widths
are compared with those of a likelihood that knows the misfit's covariance (linearised at the truth,
prior included).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.physics.brdf import evaluate_gradient
from pbrdf_bayes.workflow.fitting import fit
from tools.validation.experiments import (
    Layout,
    Misfit,
    common,
    draw_misfit,
    draw_readings,
    matern,
    rough,
    rows_of,
    smooth,
)
from tools.validation.line_shape import cauchy_log_ratio

Array = NDArray[np.float64]

LAYOUT = Layout(
    theta_i_deg=(20.0, 60.0),
    theta_r_deg=tuple(np.arange(-80.0, 81.0, 4.0).tolist()),
    dhr_theta_i_deg=(10.0, 30.0, 50.0, 70.0),
)
SIZE = 0.05
MISFITS: Mapping[str, Misfit] = {
    "own path for each scan": matern(SIZE, 25.0),
    "one path common to all scans": common(SIZE, 25.0),
    "smooth": smooth(SIZE, 20.0),
    "rough": rough(SIZE, 25.0),
}
"""Shapes of the misfit, 5 % each."""
LINE_SHAPE = "wrong line shape"
EXPONENT = 1.3
NOISE, U_DHR = 0.01, 0.002
_TWO_SIDED_90 = 2.0 * 1.6448536269514722


def coverage_config(noise: str) -> RunConfig:
    """Choices of the study."""
    return RunConfig(noise=noise, accuracy="draft", holdout=False, threads=1)


def draw_paint(rng: np.random.Generator) -> Array:
    """A paint's n, k, sigma_N0, rho0, shape (4,)."""
    return np.array([
        rng.uniform(1.4, 1.65), rng.uniform(0.05, 0.4), rng.uniform(0.3, 0.8),
        np.exp(rng.uniform(np.log(0.2), np.log(0.7))),
    ])  # fmt: skip


def simulate_coverage(seed: int, shape: str) -> dict[str, Any]:
    """One simulation: for both likelihoods, which parameters are covered and how wide."""
    rng = np.random.default_rng([seed, 43])
    template = build_posterior(LAYOUT.template(), coverage_config("iid"))
    truth = np.array([*draw_paint(rng), NOISE, NOISE, U_DHR])
    theta_r, scan = rows_of(template.measurement)
    if shape == LINE_SHAPE:
        misfit, known = cauchy_log_ratio(template.measurement, truth[:4], EXPONENT), None
    else:
        covariance = MISFITS[shape](theta_r, scan)
        misfit, known = draw_misfit(covariance, rng), _known_sd(template, truth, covariance)
    readings = draw_readings(template, truth, rng, misfit=misfit)
    found: dict[str, Any] = {"seed": seed, "shape": shape}
    for noise in ("correlated", "iid"):
        summary = fit(readings, coverage_config(noise), seed=seed).summary
        table = [summary["parameters"][name] for name in PHYSICAL]
        width = np.array([p["q95"] - p["q05"] for p in table])
        found[noise] = {
            "covered": [
                bool(p["q05"] <= t <= p["q95"]) for p, t in zip(table, truth, strict=False)
            ],
            "width": width.tolist(),
            "width_ratio": None if known is None else (width / (_TWO_SIDED_90 * known)).tolist(),
            "verdict": summary["verdict"],
            "tau": summary["parameters"].get("tau", {}).get("median"),
            "failed": [n for n, d in summary["diagnostics"].items() if d["verdict"] != "PASS"],
        }
    return found


def _known_sd(posterior: Posterior, truth: Array, misfit: Array) -> Array:
    """Standard deviations where the covariance of all errors is known, shape (4,)."""
    _, dhr, log_f_slopes, dhr_slopes = evaluate_gradient(
        posterior.geometry, truth[None, :], posterior.digits
    )
    rows, config = posterior.rows, posterior.config
    brdf_covariance = misfit + NOISE**2 * np.eye(len(misfit))
    same = rows.dhr_group[:, None] == rows.dhr_group
    gain = config.u_dhr_cal**2 * np.where(same, np.outer(dhr[0], dhr[0]), 0.0)
    dhr_covariance = U_DHR**2 * np.eye(dhr.shape[1]) + gain
    information = np.zeros((4, 4))
    for slopes, covariance in ((log_f_slopes[0], brdf_covariance), (dhr_slopes[0], dhr_covariance)):
        information += slopes.T @ np.linalg.solve(covariance, slopes)
    for i, spec in enumerate(posterior.specs[:4]):
        if spec.prior.kind == "normal":
            information[i, i] += 1.0 / spec.prior.sd**2
    return np.sqrt(np.diag(np.linalg.inv(information)))


def tabulate(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Coverage and widths by shape and likelihood."""
    table = []
    for shape in dict.fromkeys(r["shape"] for r in results):
        mine = [r for r in results if r["shape"] == shape]
        for noise in ("correlated", "iid"):
            covered = np.array([r[noise]["covered"] for r in mine])
            ratios = [r[noise]["width_ratio"] for r in mine if r[noise]["width_ratio"]]
            verdicts = [r[noise]["verdict"] for r in mine]
            table.append({
                "shape": shape, "noise": noise, "n": len(mine),
                "covered": dict(zip(PHYSICAL, covered.mean(axis=0).tolist(), strict=True)),
                "covered_mean": float(covered.mean()),
                "width_ratio": (
                    dict(zip(PHYSICAL, np.median(ratios, axis=0).tolist(), strict=True))
                    if ratios else None
                ),
                "flagged": float(np.mean([v != "PASS" for v in verdicts])),
                "failed": float(np.mean([v == "FAIL" for v in verdicts])),
            })  # fmt: skip
    return table
