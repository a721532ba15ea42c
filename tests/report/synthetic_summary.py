"""The summary of a synthetic analysis: the records of ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from tests.report.synthetic_cases import CENTRES, DESCRIPTIONS, PHYSICAL, PRIORS, SYMBOLS, Case

Array = NDArray[np.float64]


def summary_of(
    case: Case, names: list[str], posterior: xr.Dataset, prior: xr.Dataset, data: dict[str, Any]
) -> dict[str, Any]:
    scans = _scan_records(case, data)
    parameters = {
        n: _parameter_record(n, case, posterior[n].values, prior[n].values) for n in names
    }
    stacked = np.array([posterior[n].values.ravel() for n in names])
    rms = {s["label"]: s["rms_dex"] for s in scans}
    overall = float(np.sqrt(np.mean(np.square(list(rms.values()))))) if rms else None
    means = {n: parameters[n]["mean"] for n in names}
    other = {n: 1.1 * value for n, value in means.items()}
    return {
        "schema_version": 1, "sample": case.sample, "wavelength_um": 3.39,
        "created_utc": "2026-01-15T09:30:00+00:00", "status": case.status, "verdict": case.verdict,
        "headline": HEADLINES[case.verdict if case.status == "done" else case.status],
        "input": {
            "file": "measurement.csv", "sha256": "3f2a9c0d" * 8,
            "n_brdf": int(data["observed"]["brdf"].size),
            "n_dhr": int(data["observed"]["dhr"].size),
            "excluded": dict(case.excluded), "warnings": list(case.warnings),
            "checks": _input_checks(case), "scans": scans,
        },
        "config": _config(case),
        "versions": {"pbrdf_bayes": "0.1.0", "numpy": "2.4.6", "emcee": "3.1.6"},
        "platform": "Linux x86_64", "seed": 20110115,
        "model": "four-parameter model", "effects": [], "line_shape": "lorentzian",
        "effects_choice": None,
        "applicability": {
            "verdict": "applies", "reasons": [], "limit_dex": 0.03,
            "statement": "Nothing speaks against the model for this material.", "advice": "",
            "repeatability_dex": 0.01, "repeatability": "stated by the column sigma",
            "held_out": "angles left out are predicted to 0.020 dex", "caveats": [],
        },
        "parameters": parameters,
        "correlation": {"names": names, "matrix": np.corrcoef(stacked).tolist()},
        "diagnostics": _diagnostics(case),
        "fit": {
            "rms_dex": {"overall": overall, "scans": rms},
            "rms_dex_best": {"overall": overall, "parameters": means},
            "lag1": {
                "overall": 0.99 if case.misfit else 0.02,
                "scans": {s["label"]: s["lag1"] for s in scans},
            },
        },
        "map": {"n_starts": 24, "optima": [
            {"log_posterior": 9123.456, "delta": 0.0, "n_starts": 22, "parameters": means},
            {"log_posterior": 8011.2, "delta": -1112.256, "n_starts": 2, "parameters": other},
        ]},
        "sampling": {
            "method": case.method, "n_ensembles": 4, "n_walkers": 64, "n_steps": 2000,
            "n_burn": 600, "thin": 8, "n_draws": int(posterior["n"].size), "acceptance": 0.42,
            "autocorrelation_time": 11.3, "moves": "0.5 KDE + 0.5 DE", "n_evaluations": 512_000,
        },
        "accuracy": {"level": "standard", "rtol": 1e-6, "normalisation_error": 2.1e-8,
                     "microseconds_per_evaluation": 41.2},
        "holdout": _holdout_record(scans) if case.holdout else None,
        **({"leave_one_out": _leave_one_out(scans)} if scans else {}),
        "holdouts": _holdouts() if case.holdout else [],
        "scan_widths": _scan_widths(case, scans),
        "reciprocity": _reciprocity(scans),
        "timings": {"read": 0.12, "map": 1.9, "sampling": 12.4, "predictions": 1.1},
    }  # fmt: skip


def _leave_one_out(scans: list[dict[str, Any]]) -> dict[str, Any]:
    reading = {"label": scans[0]["label"], "angle_deg": 20.0, "row": 12, "k_hat": 0.31, "z": -2.4}
    pit = [
        {"label": s["label"], "n": s["n"], "distance": 0.05, "p_value": 0.4, "mean": 0.0, "sd": 1.0}
        for s in scans
    ]
    return {
        "elpd": 8176.4, "u_elpd": 41.0, "p_loo": 6.3, "n": 3226, "n_draws": 600, "k_hat": 0.31,
        "k_hat_limit": 0.64, "n_influential": 1, "most_influential": [reading],
        "farthest": [reading], "pit": pit,
    }  # fmt: skip


def eq5(p: str, theta_i_deg: Any) -> Any:
    """A made-up narrowing of the lobes."""
    grazing = 1.0 - np.cos(np.radians(theta_i_deg))
    return 0.47 * (1.0 - {"s": 0.6, "p": 0.2, "u": 0.4}[p] * grazing)


def _scan_widths(case: Case, scans: list[dict[str, Any]]) -> list[dict[str, Any]]:
    found = []
    for i, s in enumerate(scans):
        model, away = (
            float(eq5(s["polarization"], s["theta_i_deg"])),
            1.0 + 0.01 * (i % 3 + (i == 2)),
        )
        record = {
            "rho0": 0.47 * away, "u_rho0": 0.004, "rho": model * away, "u_rho": 0.008 * model,
            "scale": 1.02, "lag1": 0.1,
        }  # fmt: skip
        if case.broken_values:
            record = dict.fromkeys(record)
        found.append({
            "label": s["label"], "polarization": s["polarization"], "n": s["n"],
            "theta_i_deg": s["theta_i_deg"], "rho_model": model, **record,
        })  # fmt: skip
    return found


def _reciprocity(scans: list[dict[str, Any]]) -> dict[str, Any]:
    """Ratios of a made-up h(a) / h(b), with a hole where nothing is reflected."""
    angles = [10.0 * i for i in range(9)]
    steepness = {"s": 0.01, "p": -0.02}
    factors: dict[str, Any] = {
        q: [[float(np.exp(c * (b - a))) for b in angles] for a in angles]
        for q, c in steepness.items()
    }
    factors["p"][2][7] = None
    low, high = (
        {q: [[f and f * away for f in row] for row in table] for q, table in factors.items()}
        for away in (0.9, 1.1)
    )
    largest = {
        "polarization": "p", "theta_a_deg": 80.0, "theta_b_deg": -20.0, "factor": 3.32,
        "q05": 2.9, "q95": 3.9,
    }  # fmt: skip
    return {
        "theta_deg": angles, "factors": factors, "q05": low, "q95": high, "n_draws": 50,
        "largest": largest if scans else None,
    }  # fmt: skip


def _holdouts() -> list[dict[str, Any]]:
    one = {
        "rms_dex": 0.009,
        "rms_expected_dex": 0.011,
        "coverage_90": 0.91,
        "width_dex": 0.03,
        "n": 99,
    }
    kinds = {"recipe": "scan s 20 deg", "angle": "60 deg", "polarization": "p from s"}
    return [
        {
            "kind": kind,
            "name": name,
            "fitted": "the others",
            "statement": "So.",
            "verdict": "PASS",
            **one,
        }
        for kind, name in kinds.items()
    ]


HEADLINES = {
    "PASS": "The four-parameter model describes the readings within their noise.",
    "WARN": "The fit is usable, but the data do not identify every parameter.",
    "FAIL": "The four-parameter model does not apply: it leaves 0.114 dex rms.",
    "not_converged": "The sampler stopped before its thresholds were met.",
}


def _scan_records(case: Case, data: dict[str, Any]) -> list[dict[str, Any]]:
    constant, value = data["constant"], data["observed"]["brdf"].values
    records = []
    for index, label in enumerate(constant["scan"].values.tolist()):
        rows = constant["brdf_scan"].values == index
        measured, model = value[rows], constant["brdf_map"].values[rows]
        with np.errstate(invalid="ignore"):
            residual = np.log10(measured / model)
        good = residual[np.isfinite(residual)]
        lag1 = float(np.corrcoef(good[1:], good[:-1])[0, 1]) if good.size > 4 else 0.0
        records.append({
            "label": label, "polarization": label[0], "phi_r_deg": 0.0,
            "theta_i_deg": float(constant["brdf_theta_i_deg"].values[rows][0]),
            "n": int(rows.sum()), "theta_r_min_deg": -80.0, "theta_r_max_deg": 80.0,
            "value_min": float(np.nanmin(measured)), "value_max": float(np.nanmax(measured)),
            "rms_dex": float(np.sqrt(np.mean(good**2))), "bias_dex": float(good.mean()),
            "lag1": lag1 if not case.broken_values else None,
            "scale": 0.97 if not case.broken_values else None,
            "u_scale": 0.012 if not case.broken_values else None,
        })  # fmt: skip
    return records


def _parameter_record(name: str, case: Case, draws: Array, prior: Array) -> dict[str, Any]:
    q025, q05, median, q95, q975 = np.quantile(draws, [0.025, 0.05, 0.5, 0.95, 0.975]).tolist()
    prior_sd = float(np.std(prior))
    return {
        "symbol": SYMBOLS[name], "unit": "1", "description": DESCRIPTIONS[name],
        "kind": "physical" if name in PHYSICAL else "nuisance", "mean": float(draws.mean()),
        "sd": float(draws.std()), "median": median, "q05": q05, "q95": q95, "q025": q025,
        "q975": q975, "map": float(CENTRES[name][0]), "ess_bulk": 2381.0, "ess_tail": 1904.0,
        "rhat": 1.62 if case.status != "done" else 1.0013,
        "mcse_mean": float(draws.std() / 48), "prior": PRIORS.get(name, "LogNormal(ln 0.02, 1.5)"),
        "prior_sd": None if case.broken_values else prior_sd,
        "contraction": None if case.broken_values else 1 - float(draws.var()) / prior_sd**2,
        "identified": name not in case.unidentified,
    }  # fmt: skip


def _check(title: str, value: Any, threshold: Any, unit: str, verdict: str, statement: str,
           advice: str = "") -> dict[str, Any]:  # fmt: skip
    return {"title": title, "value": value, "threshold": threshold, "unit": unit,
            "verdict": verdict, "statement": statement, "advice": advice}  # fmt: skip


def _input_checks(case: Case) -> list[dict[str, Any]]:
    level = _check(
        "BRDF level against DHR",
        0.013 if case.dhr else None,
        0.1,
        "relative",
        "PASS" if case.dhr else "SKIP",
        "The in-plane BRDF and the DHR agree." if case.dhr else "There are no DHR readings.",
    )
    symmetry = _check(
        "Symmetry at normal incidence",
        0.002,
        0.02,
        "dex",
        "PASS",
        "Forward and backward halves agree.",
    )
    return [{"name": "dhr_level", **level}, {"name": "symmetry", **symmetry}]  # fmt: skip


def _diagnostics(case: Case) -> dict[str, Any]:
    converged = case.status == "done"
    found = {
        "rhat": _check("R-hat between ensembles", 1.0013 if converged else 1.62, 1.01, "",
                       "PASS" if converged else "FAIL",
                       "The ensembles agree." if converged else "The ensembles disagree.",
                       "" if converged else "Raise max_steps, or run with --resume."),
        "ess": _check("Effective sample size", 1904.0, 1000.0, "", "PASS", "Enough for the tails."),
        "misfit": _check("Misfit of the model", 0.114 if case.misfit else 0.0043, 0.05, "dex",
                         "FAIL" if case.misfit else "PASS",
                         "The curve is off by more than the repeatability of the instrument."
                         if case.misfit else "The residuals are of the size of the noise.",
                         "Add a diffuse effect, e.g. --effects auto." if case.misfit else ""),
        "autocorrelation": _check("Lag-1 autocorrelation", 0.99 if case.misfit else 0.02, 0.3, "",
                                  "WARN" if case.misfit else "PASS",
                                  "Neighbouring residuals are alike: intervals are too narrow."
                                  if case.misfit else "Residuals are independent along theta_r.",
                                  "Use the correlated likelihood." if case.misfit else ""),
    }  # fmt: skip
    if case.unidentified:
        names = ", ".join(SYMBOLS[n] for n in case.unidentified)
        found["identification"] = _check(
            "Contraction of the prior", 0.12, 0.5, "", "WARN",
            f"The data say little about {names}: its interval is that of the prior.",
            "Measure s and p scans and DHR readings, or fix the index by another method.",
        )  # fmt: skip
    return found


def _holdout_record(scans: list[dict[str, Any]]) -> dict[str, Any]:
    rows = [
        {"label": s["label"], "rms_dex": s["rms_dex"], "coverage_90": 0.905, "width_dex": 0.0231}
        for s in scans[1:]
    ]
    return {
        "fitted": f"DHR readings and the scan {scans[0]['label']}", "rms_dex": 0.0048,
        "coverage_90": 0.905, "width_dex": 0.0231, "scans": rows,
        "statement": "The scans left out are predicted within the 90 % predictive band.",
    }  # fmt: skip


def _config(case: Case) -> dict[str, Any]:
    config = {name: getattr(RunConfig(), name) for name in RunConfig.__dataclass_fields__}
    config["effects"], config["predict_theta_i_deg"] = [], []
    return {**config, "priors": {}, "accuracy": "draft" if case.method == "psis" else "standard"}


def config_toml(case: Case) -> str:
    def text(value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        return f'"{value}"' if isinstance(value, str) else str(value)

    lines = [f"{k} = {text(v)}" for k, v in _config(case).items() if not isinstance(v, Mapping)]
    return "\n".join([*lines, "", "[priors]", '# preset "paint"', ""])
