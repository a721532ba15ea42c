"""Made-up but plausible `Analysis` records, one per situation a report has to cope with.

Nothing here evaluates the package's model: curves are Lorentzians in direction cosine with a
Fresnel factor, draws are normal, bands follow from made-up relative uncertainties.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.results import QUANTILES, Analysis

Array = NDArray[np.float64]
Z90, Z50 = 1.6448536, 0.6744898
PHYSICAL = ("n", "k", "sigma_n0", "rho0")
SYMBOLS = {"n": "n", "k": "k", "sigma_n0": "σ_N0", "rho0": "ρ_0", "s_rel_s": "s_rel,s",
           "s_rel_p": "s_rel,p", "s_rel_u": "s_rel,u", "u_dhr": "u_DHR"}  # fmt: skip
DESCRIPTIONS = {
    "n": "refractive index",
    "k": "extinction coefficient",
    "sigma_n0": "scattering strength at normal incidence",
    "rho0": "half width at half maximum in direction cosine",
    "s_rel_s": "relative white noise, s scans",
    "s_rel_p": "relative white noise, p scans",
    "s_rel_u": "relative white noise, unpolarised scans",
    "u_dhr": "standard uncertainty of a DHR reading",
}
CENTRES = {"n": (1.526, 0.0012), "k": (0.193, 0.0021), "sigma_n0": (0.4528, 0.0017),
           "rho0": (0.47, 0.0006), "s_rel_s": (0.00993, 0.00018), "s_rel_p": (0.0101, 0.00019),
           "s_rel_u": (0.262, 0.0079), "u_dhr": (0.0021, 0.0004)}  # fmt: skip
PRIORS = {"n": "Normal(1.5, 0.2) on [1, 3]", "k": "HalfNormal(0.5)", "sigma_n0": "Uniform(0, 1)",
          "rho0": "LogUniform(0.001, 4)"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What a synthetic analysis looks like."""

    sample: str = "Green paint (simulated)"
    theta_i_deg: tuple[float, ...] = (0.0, 20.0, 40.0, 60.0, 80.0)
    polarizations: tuple[str, ...] = ("s", "p")
    n_points: int = 321
    dhr: bool = True
    holdout: bool = True
    status: str = "done"
    verdict: str = "PASS"
    misfit: float = 0.0
    unidentified: tuple[str, ...] = ()
    runs: int = 1
    method: str = "emcee"
    broken_values: bool = False
    label_suffix: str = ""
    warnings: tuple[str, ...] = ()
    excluded: Mapping[str, int] = field(default_factory=dict)


CASES: dict[str, Case] = {
    "demo": Case(excluded={"obscured": 12}),
    "misfit": Case(
        sample="aeroglaze_z307", theta_i_deg=(10.0, 30.0, 50.0, 70.0), polarizations=("u",),
        n_points=150, dhr=False, holdout=True, verdict="FAIL", misfit=0.26,
        unidentified=("n", "k"), excluded={"obscured": 44},
        warnings=("4 geometries were read more than once; every reading is used.",),
    ),
    "not_converged": Case(status="not_converged", verdict="FAIL", theta_i_deg=(20.0, 60.0)),
    "one_scan": Case(theta_i_deg=(20.0,), polarizations=("s",), dhr=False, holdout=False,
                     verdict="WARN", unidentified=("n",), method="psis"),
    "dhr_only": Case(theta_i_deg=(), holdout=False, verdict="WARN", unidentified=("rho0",)),
    "hostile": Case(
        sample="<script>alert('x')</script> & \"q\" $\\frac{a$ {{ 7*7 }} \x00\x1b[31m\u202e " + "W" * 260,
        theta_i_deg=(20.0,), label_suffix=" <img src=x onerror=alert(1)> " + "L" * 280,
        broken_values=True, verdict="WARN", warnings=("<b>bold</b> " + "w" * 300,),
        excluded={"<i>flag</i>": 3},
    ),
    "many_scans": Case(theta_i_deg=tuple(np.linspace(0, 81, 10).tolist()), runs=1),
    "many_points": Case(theta_i_deg=(30.0,), n_points=50_000, holdout=False),
    "repeats": Case(theta_i_deg=(20.0, 60.0), runs=10, n_points=81, holdout=False),
}  # fmt: skip


def analysis(name: str = "demo", *, seed: int = 7) -> Analysis:
    """Build the synthetic analysis of one of the `CASES`."""
    case = CASES[name]
    rng = np.random.default_rng(seed)
    names = _parameter_names(case)
    posterior, prior = _draws(case, names, rng)
    data = _readings(case, rng)
    groups = {
        "posterior": posterior,
        "prior": prior,
        "sample_stats": _sample_stats(posterior, rng),
        "observed_data": data["observed"],
        "constant_data": data["constant"],
        "curves": _curves(case),
        "dhr_curves": _dhr_curves(case),
    }
    if case.holdout:
        groups["holdout"] = _holdout(data)
    summary = _summary(case, names, posterior, prior, data)
    return Analysis(summary, xr.DataTree.from_dict(groups), _config_toml(case))


def lorentzian(pol: Any, theta_i_deg: Any, theta_r_deg: Any) -> Array:
    """Return a peak in direction cosine times a Fresnel-like factor [sr^-1]."""
    theta_i, theta_r = np.radians(theta_i_deg), np.radians(theta_r_deg)
    alpha_i, alpha = np.sin(theta_i), np.sin(theta_r)
    half = np.arcsin((alpha + alpha_i) / 2)
    width = 0.47 * (np.cos(theta_i) + np.cos(theta_r)) / 2
    return np.asarray(0.19 * fresnel(pol, half) / ((alpha - alpha_i) ** 2 + width**2 + 1e-3))


def fresnel(pol: Any, angle: Any) -> Array:
    """Power reflectance of a medium of index 1.526 - 0.193i."""
    m2 = (1.526 - 0.193j) ** 2
    cos, root = np.cos(angle), np.sqrt(m2 - np.sin(angle) ** 2)
    f_s = np.abs((cos - root) / (cos + root)) ** 2
    f_p = np.abs((m2 * cos - root) / (m2 * cos + root)) ** 2
    pol = np.asarray(pol)
    return np.asarray(np.where(pol == "s", f_s, np.where(pol == "p", f_p, (f_s + f_p) / 2)))


def _parameter_names(case: Case) -> list[str]:
    noise = [f"s_rel_{p}" for p in case.polarizations] if case.theta_i_deg else []
    return [*PHYSICAL, *noise, *(["u_dhr"] if case.dhr else [])]


def _draws(case: Case, names: list[str], rng: np.random.Generator) -> tuple[xr.Dataset, xr.Dataset]:
    n_chain, n_draw = (4, 250) if case.method == "psis" else (64, 50)
    common = rng.normal(size=(n_chain, n_draw))
    posterior, prior = {}, {}
    for index, name in enumerate(names):
        centre, spread = CENTRES[name]
        mix = (0.8, -0.6, -0.7, 0.3)[index] if index < 4 else 0.05
        z = mix * common + np.sqrt(1 - mix**2) * rng.normal(size=common.shape)
        values = centre + spread * z
        before = _prior_draws(name, centre, rng, common.shape)
        if name in case.unidentified:
            values = np.quantile(before, 0.5) + 0.85 * (before - np.quantile(before, 0.5))
        if case.status != "done":
            values = values + spread * np.repeat([-1.5, 0.2, 0.4, 1.8], n_chain // 4)[:, None]
        posterior[name] = (("chain", "draw"), values)
        prior[name] = (("chain", "draw"), before)
    ensemble = ("chain", np.arange(n_chain) // max(1, n_chain // 4))
    return xr.Dataset(posterior, coords={"ensemble": ensemble}), xr.Dataset(prior)


def _prior_draws(
    name: str, centre: float, rng: np.random.Generator, shape: tuple[int, ...]
) -> Array:
    if name == "n":
        return np.clip(rng.normal(1.5, 0.2, shape), 1.0, 3.0)
    if name == "k":
        return np.abs(rng.normal(0, 0.5, shape))
    if name == "sigma_n0":
        return rng.uniform(0, 1, shape)
    if name == "rho0":
        return np.asarray(np.exp(rng.uniform(np.log(1e-3), np.log(4), shape)))
    return np.asarray(centre * np.exp(1.5 * rng.normal(size=shape)))


def _sample_stats(posterior: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    shape = posterior["n"].shape
    return xr.Dataset(
        {
            "lp": (("chain", "draw"), 9000 + rng.normal(size=shape)),
            "acceptance_rate": ("chain", np.full(shape[0], 0.42)),
        }
    )


def _readings(case: Case, rng: np.random.Generator) -> dict[str, Any]:
    pol, theta_i, theta_r, index, labels, u = [], [], [], [], [], []
    grid = np.linspace(-80, 80, case.n_points)
    for angle in case.theta_i_deg:
        for p in case.polarizations:
            for run in range(case.runs):
                suffix = case.label_suffix + (f" run{run + 1}" if case.runs > 1 else "")
                index += [len(labels)] * case.n_points
                labels.append(f"{p} {angle:g} deg{suffix}")
                pol += [p] * case.n_points
                theta_i += [angle] * case.n_points
                theta_r.append(grid)
                u.append(np.full(case.n_points, np.nan))
    theta_r_all = np.concatenate(theta_r) if theta_r else np.zeros(0)
    pols, angles = np.asarray(pol, dtype=np.str_), np.asarray(theta_i, dtype=np.float64)
    model = lorentzian(pols, angles, theta_r_all)
    shape = case.misfit * np.cos(np.radians(3 * theta_r_all + angles))
    value = model * np.exp(shape + 0.01 * rng.normal(size=model.size))
    if case.broken_values and value.size > 40:
        value[5], value[17], model[30] = -1e-5, np.nan, np.nan
    d_pol = np.repeat(_dhr_polarizations(case), 8) if case.dhr else np.zeros(0, np.str_)
    d_theta = np.tile(np.arange(10.0, 81.0, 10.0), d_pol.size // 8)
    d_map = 0.4528 * fresnel(d_pol, np.radians(d_theta))
    d_value = d_map + 0.002 * rng.normal(size=d_map.size)
    obs, dhr = "brdf_obs", "dhr_obs"
    constant = xr.Dataset(
        {
            "brdf_polarization": (obs, pols), "brdf_theta_i_deg": (obs, angles),
            "brdf_theta_r_deg": (obs, theta_r_all), "brdf_phi_r_deg": (obs, 0 * angles),
            "brdf_scan": (obs, np.asarray(index, np.int64)),
            "brdf_u": (obs, np.concatenate(u) if u else np.zeros(0)),
            "brdf_row": (obs, np.arange(angles.size) + 2), "brdf_map": (obs, model),
            "brdf_best": (obs, model), "dhr_polarization": (dhr, d_pol),
            "dhr_theta_i_deg": (dhr, d_theta), "dhr_u": (dhr, np.full(d_map.size, 0.002)),
            "dhr_row": (dhr, np.arange(d_map.size)), "dhr_map": (dhr, d_map),
        },
        coords={"scan": ("scan", np.asarray(labels, dtype=np.str_))},
    )  # fmt: skip
    observed = xr.Dataset({"brdf": (obs, value), "dhr": (dhr, d_value)})
    return {"observed": observed, "constant": constant}


def _dhr_polarizations(case: Case) -> list[str]:
    return ["u"] if case.polarizations == ("u",) else ["s", "p"]


def _bands(curve: Array, u_model: Any, u_noise: float) -> tuple[Array, Array]:
    """Quantiles of the model and of the predictive band around a curve, last axis quantile."""
    z = np.array([-Z90, -Z50, 0.0, Z50, Z90])
    u_model = np.broadcast_to(u_model, curve.shape)[..., None]
    total = np.hypot(u_model, u_noise)
    return curve[..., None] * np.exp(z * u_model), curve[..., None] * np.exp(z * total)


def _curves(case: Case) -> xr.Dataset:
    between = [10.0, 30.0, 50.0, 70.0] if len(case.theta_i_deg) > 1 else [0.0, 45.0]
    angles = [(a, True) for a in case.theta_i_deg] + [(a, False) for a in between]
    pols = case.polarizations if case.polarizations != ("u",) else ("s", "p", "u")
    keys = [
        (p, a, m) for a, m in angles for p in pols if p == "u" or not m or pols != ("s", "p", "u")
    ]
    theta_r = np.arange(-85.0, 85.5, 0.5)
    pol = np.array([k[0] for k in keys])
    theta_i = np.array([k[1] for k in keys])
    curve = lorentzian(pol[:, None], theta_i[:, None], theta_r)
    away = np.abs(np.sin(np.radians(theta_r)) - np.sin(np.radians(theta_i))[:, None])
    u_model = 0.002 + 0.01 * away + 0.3 * (pol[:, None] != "u") * bool(case.unidentified)
    model, predictive = _bands(curve, u_model, 0.26 if case.misfit else 0.01)
    dims = ("curve", "theta_r_deg", "quantile")
    return xr.Dataset(
        {"model_band": (dims, model), "predictive_band": (dims, predictive), "map": (dims[:2], curve)},
        coords={
            "quantile": list(QUANTILES), "theta_r_deg": theta_r,
            "curve_polarization": ("curve", pol), "curve_theta_i_deg": ("curve", theta_i),
            "curve_phi_r_deg": ("curve", 0 * theta_i),
            "curve_measured": ("curve", np.array([k[2] for k in keys])),
        },
    )  # fmt: skip


def _dhr_curves(case: Case) -> xr.Dataset:
    theta_i = np.arange(0.0, 86.0, 1.0)
    pol = np.array(["s", "p"] if case.polarizations != ("u",) else ["s", "p", "u"])
    curve = 0.4528 * fresnel(pol[:, None], np.radians(theta_i))
    model, predictive = _bands(curve, 0.004 if case.dhr else 0.3, 0.01)
    dims = ("polarization", "theta_i_deg", "quantile")
    return xr.Dataset(
        {
            "model_band": (dims, model),
            "predictive_band": (dims, predictive),
            "map": (dims[:2], curve),
        },
        coords={"quantile": list(QUANTILES), "theta_i_deg": theta_i, "polarization": pol},
    )


def _holdout(data: dict[str, Any]) -> xr.Dataset:
    constant, value = data["constant"], data["observed"]["brdf"].values
    labels = constant["scan"].values[constant["brdf_scan"].values]
    rows = labels != labels[0]
    _, band = _bands(constant["brdf_map"].values[rows], 0.012, 0.011)
    return xr.Dataset(
        {
            "scan": ("holdout_obs", labels[rows]),
            "theta_r_deg": ("holdout_obs", constant["brdf_theta_r_deg"].values[rows]),
            "value": ("holdout_obs", value[rows]),
            "predictive_band": (("holdout_obs", "quantile"), band),
        },
        coords={"quantile": list(QUANTILES)},
    )


def _summary(
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
            "n_brdf": int(data["observed"]["brdf"].size), "n_dhr": int(data["observed"]["dhr"].size),
            "excluded": dict(case.excluded), "warnings": list(case.warnings),
            "checks": _input_checks(case), "scans": scans,
        },
        "config": _config(case),
        "versions": {"pbrdf_bayes": "0.1.0", "python": "3.11.7", "numpy": "2.4.6", "emcee": "3.1.6"},
        "platform": "Linux x86_64", "seed": 20110115, "effects": [], "line_shape": "lorentzian",
        "parameters": parameters,
        "correlation": {"names": names, "matrix": np.corrcoef(stacked).tolist()},
        "diagnostics": _diagnostics(case),
        "fit": {
            "rms_dex": {"overall": overall, "scans": rms},
            "rms_dex_best": {"overall": overall, "parameters": means},
            "lag1": {"overall": 0.99 if case.misfit else 0.02, "scans": {s["label"]: s["lag1"] for s in scans}},
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
        "timings": {"read": 0.12, "map": 1.9, "sampling": 12.4, "predictions": 1.1},
    }  # fmt: skip


HEADLINES = {
    "PASS": "The four-parameter model describes the readings within their noise; all four parameters are identified.",
    "WARN": "The fit is usable, but the data do not identify every parameter.",
    "FAIL": "The four-parameter model does not apply to these data: it leaves 0.114 dex rms, far above the noise.",
    "not_converged": "The sampler stopped before its thresholds were met; the numbers below are provisional.",
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
        lag1 = float(np.corrcoef(good[1:], good[:-1])[0, 1])
        records.append({
            "label": label, "polarization": label[0], "phi_r_deg": 0.0,
            "theta_i_deg": float(constant["brdf_theta_i_deg"].values[rows][0]),
            "n": int(rows.sum()), "theta_r_min_deg": -80.0, "theta_r_max_deg": 80.0,
            "value_min": float(np.nanmin(measured)), "value_max": float(np.nanmax(measured)),
            "rms_dex": float(np.sqrt(np.mean(good**2))), "bias_dex": float(good.mean()),
            "lag1": lag1 if not case.broken_values else None,
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
        "misfit": _check("Misfit of the strict model", 0.114 if case.misfit else 0.0043, 0.05, "dex",
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


def _config_toml(case: Case) -> str:
    def text(value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        return f'"{value}"' if isinstance(value, str) else str(value)

    lines = [f"{k} = {text(v)}" for k, v in _config(case).items() if not isinstance(v, Mapping)]
    return "\n".join([*lines, "", "[priors]", '# preset "paint"', ""])


def all_cases() -> dict[str, Callable[[], Analysis]]:
    """Every case as a function that builds it."""
    return {name: lambda name=name: analysis(name) for name in CASES}  # type: ignore[misc]
