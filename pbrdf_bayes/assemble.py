"""Put the results of the stages together as one `Analysis`, and take a measurement out of one."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes import __version__
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.data_checks import DataCheck
from pbrdf_bayes.inference.bands import Bands, Targets, replicate_brdf, replicate_dhr, scan_scales
from pbrdf_bayes.inference.diagnostics import (
    CONTRACTION_WARN,
    FAIL,
    WARN,
    Diagnostic,
    Identifiability,
    contraction,
    overall_verdict,
)
from pbrdf_bayes.inference.holdout import Holdout
from pbrdf_bayes.inference.map_fit import MapResult
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.residuals import Residuals
from pbrdf_bayes.inference.sampling import Draws
from pbrdf_bayes.io.config_toml import config_table, config_to_toml
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.results import QUANTILES, SCHEMA_VERSION, Analysis

Array = NDArray[np.float64]

_PACKAGES = (
    "numpy", "scipy", "numba", "emcee", "nlopt", "arviz-stats", "xarray", "matplotlib",
)  # fmt: skip
_N_PRIOR = 4000
_MAX_PREDICTIVE = 400_000


@dataclass(frozen=True, eq=False)
class Stages:
    """What the stages of a fit produced, before it is put together."""

    posterior: Posterior
    seed: int
    checks: tuple[DataCheck, ...]
    optima: MapResult
    draws: Draws
    least_squares: tuple[Array, float]
    residuals: Residuals
    best_dex: Array
    identifiability: Identifiability
    diagnostics: tuple[Diagnostic, ...]
    curves: tuple[Targets, NDArray[np.bool_], Bands]
    dhr_curves: tuple[Targets, NDArray[np.bool_], Bands]
    holdout: Holdout | None
    scales: Array | None
    normalisation_error: float
    microseconds: float
    timings: Mapping[str, float]


def assemble(stages: Stages) -> Analysis:
    """Summary, tree of arrays and resolved configuration of a finished fit."""
    return Analysis(
        summary=_summary(stages),
        draws=_tree(stages),
        config_toml=config_to_toml(stages.posterior.config),
    )


def _summary(s: Stages) -> dict[str, Any]:
    m, config = s.posterior.measurement, s.posterior.config
    verdict = overall_verdict([d.verdict for d in s.diagnostics] + [c.verdict for c in s.checks])
    return {
        "schema_version": SCHEMA_VERSION,
        "sample": m.sample,
        "wavelength_um": m.wavelength_um,
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "status": "done" if s.draws.converged else "not_converged",
        "verdict": verdict,
        "headline": _headline(s, verdict),
        "input": _input(s),
        "config": config_table(config),
        "versions": _versions(),
        "platform": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "seed": s.seed,
        "effects": list(config.effects),
        "line_shape": config.line_shape,
        "parameters": _parameters(s),
        "correlation": {
            "names": list(s.posterior.parameter_names),
            "matrix": np.corrcoef(s.draws.flat.T).tolist(),
        },
        "diagnostics": {
            d.name: {k: v for k, v in asdict(d).items() if k != "name"} for d in s.diagnostics
        },
        "fit": _fit(s),
        "map": _map(s),
        "sampling": _sampling(s.draws, config),
        "accuracy": {
            "level": config.accuracy,
            "rtol": config.rtol,
            "normalisation_error": s.normalisation_error,
            "microseconds_per_evaluation": s.microseconds,
        },
        "holdout": _holdout(s.holdout),
        "timings": dict(s.timings),
    }


def _headline(s: Stages, verdict: str) -> str:
    if not s.draws.converged:
        return "The sampler did not converge within its budget: these numbers are provisional."
    worst = [d for d in s.diagnostics if d.verdict == verdict]
    if verdict == FAIL and worst:
        return f"Not usable as material constants: {worst[0].statement}"
    if verdict == WARN and worst:
        return f"Usable with care: {worst[0].statement}"
    if verdict in (FAIL, WARN):
        check = next(c for c in s.checks if c.verdict == verdict)
        return f"Look at the data first: {check.statement}"
    rms = s.least_squares[1]
    if np.isnan(rms):
        return "The four-parameter model describes the DHR readings; see what they do not identify."
    return (
        f"The four-parameter model describes the readings to {rms:.3f} dex rms "
        f"({100 * (10**rms - 1):.1f} %), and every check passes."
    )


def _input(s: Stages) -> dict[str, Any]:
    m = s.posterior.measurement
    scans = [
        {
            "label": scan.label,
            "polarization": scan.polarization,
            "theta_i_deg": scan.theta_i_deg,
            "phi_r_deg": scan.phi_r_deg,
            "n": len(scan),
            "theta_r_min_deg": m.brdf.theta_r_deg[scan.rows].min(),
            "theta_r_max_deg": m.brdf.theta_r_deg[scan.rows].max(),
            "value_min": m.brdf.value[scan.rows].min(),
            "value_max": m.brdf.value[scan.rows].max(),
            "rms_dex": s.residuals.scan_rms[i],
            "bias_dex": s.residuals.scan_bias[i],
            "lag1": s.residuals.scan_lag1[i],
            "scale": 1.0 if s.scales is None else s.scales[:, i].mean(),
            "u_scale": 0.0 if s.scales is None else s.scales[:, i].std(),
        }
        for i, scan in enumerate(m.scans)
    ]
    return {
        "file": m.source,
        "sha256": m.sha256,
        "n_brdf": len(m.brdf),
        "n_dhr": len(m.dhr),
        "excluded": dict(m.excluded),
        "warnings": list(m.warnings),
        "checks": [asdict(check) for check in s.checks],
        "scans": scans,
    }


def _versions() -> dict[str, str]:
    found = {"pbrdf-bayes": __version__}
    for name in _PACKAGES:
        found[name] = metadata.version(name)
    return found


def _parameters(s: Stages) -> dict[str, Any]:
    flat, draws = s.draws.flat, s.draws
    honest = dict(zip(s.identifiability.names, s.identifiability.honest, strict=True))
    table = {}
    for i, spec in enumerate(s.posterior.specs):
        values = flat[:, i]
        q025, q05, median, q95, q975 = np.quantile(values, [0.025, 0.05, 0.5, 0.95, 0.975])
        prior_sd = spec.prior.standard_deviation
        explained = contraction(spec, values)
        table[spec.name] = {
            "symbol": spec.symbol, "unit": spec.unit, "description": spec.description,
            "kind": spec.kind, "mean": values.mean(), "sd": values.std(ddof=1),
            "median": median, "q05": q05, "q95": q95, "q025": q025, "q975": q975,
            "map": s.optima.best.x[i], "ess_bulk": draws.ess_bulk[i],
            "ess_tail": draws.ess_tail[i], "rhat": draws.rhat[i],
            "mcse_mean": draws.mcse_mean[i], "prior": spec.prior.describe(),
            "prior_sd": prior_sd, "contraction": explained,
            "identified": bool(honest.get(spec.name, explained) >= CONTRACTION_WARN),
        }  # fmt: skip
        if spec.name in honest:
            table[spec.name]["contraction_effective"] = honest[spec.name]
    return table


def _fit(s: Stages) -> dict[str, Any]:
    labels = [scan.label for scan in s.posterior.measurement.scans]
    x, rms = s.least_squares
    return {
        "rms_dex": {
            "overall": s.residuals.rms,
            "scans": dict(zip(labels, s.residuals.scan_rms, strict=True)),
        },
        "rms_dex_best": {
            "overall": rms,
            "parameters": dict(zip(s.posterior.parameter_names[:4], x[:4], strict=True)),
        },
        "lag1": {
            "overall": s.residuals.lag1,
            "scans": dict(zip(labels, s.residuals.scan_lag1, strict=True)),
        },
    }


def _map(s: Stages) -> dict[str, Any]:
    names = s.posterior.parameter_names
    return {
        "n_starts": s.optima.n_starts,
        "optima": [
            {
                "log_posterior": o.log_posterior,
                "delta": o.log_posterior - s.optima.best.log_posterior,
                "n_starts": o.n_starts,
                "parameters": dict(zip(names, o.x, strict=True)),
            }
            for o in s.optima.optima
        ],
    }


def _sampling(draws: Draws, config: RunConfig) -> dict[str, Any]:
    return {
        "method": draws.method,
        "n_ensembles": len(np.unique(draws.ensemble)),
        "n_walkers": config.n_walkers if draws.method == "emcee" else 1,
        "n_steps": draws.n_steps,
        "n_burn": draws.n_burn,
        "thin": draws.thin,
        "n_draws": draws.x.shape[0] * draws.x.shape[1],
        "acceptance": draws.acceptance.mean(),
        "autocorrelation_time": draws.autocorrelation_time,
        "k_hat": draws.k_hat,
        "moves": draws.moves,
        "n_evaluations": draws.n_evaluations,
    }


def _holdout(found: Holdout | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "fitted": found.fitted,
        "rms_dex": found.rms_dex,
        "coverage_90": found.coverage_90,
        "width_dex": found.width_dex,
        "statement": found.statement,
        "scans": list(found.scans),
    }


def _tree(s: Stages) -> xr.DataTree:
    names = s.posterior.parameter_names
    draws = s.draws
    prior = s.posterior.sample_prior(np.random.default_rng([s.seed, 4]), _N_PRIOR)
    chain_draw = ("chain", "draw")
    groups = {
        "posterior": xr.Dataset(
            {name: (chain_draw, draws.x[:, :, i]) for i, name in enumerate(names)},
            coords={**_index("chain", draws.x.shape[0]), **_index("draw", draws.x.shape[1]),
                    "ensemble": ("chain", draws.ensemble)},
            attrs={"sampling": draws.method, "units": "physical"},
        ),
        "sample_stats": xr.Dataset(
            {"lp": (chain_draw, draws.log_prob), "acceptance_rate": ("chain", draws.acceptance)},
            coords={**_index("chain", draws.x.shape[0]), **_index("draw", draws.x.shape[1])},
        ),
        "prior": xr.Dataset(
            {name: (chain_draw, prior[None, :, i]) for i, name in enumerate(names)},
            coords={**_index("chain", 1), **_index("draw", _N_PRIOR)},
        ),
        "posterior_predictive": _predictive(s),
        "observed_data": _observed(s.posterior.measurement),
        "constant_data": _constant(s),
        "curves": _curves(s),
        "dhr_curves": _dhr_curves(s),
    }  # fmt: skip
    if s.holdout is not None:
        groups["holdout"] = xr.Dataset(
            {
                "scan": ("holdout_obs", s.holdout.scan.astype(object)),
                "theta_r_deg": ("holdout_obs", s.holdout.theta_r_deg),
                "value": ("holdout_obs", s.holdout.value),
                "predictive_band": (("holdout_obs", "quantile"), s.holdout.predictive_band),
            },
            coords={"quantile": np.array(QUANTILES)},
        )
    return xr.DataTree.from_dict(groups)


def _index(name: str, size: int) -> dict[str, NDArray[np.int64]]:
    return {name: np.arange(size)}


def _predictive(s: Stages) -> xr.Dataset:
    """Replicated readings; as many draws as a file of bearable size allows, at most 100."""
    m = s.posterior.measurement
    rng = np.random.default_rng([s.seed, 5])
    n_draws = int(np.clip(_MAX_PREDICTIVE // max(m.n_obs, 1), 4, 100))
    picked = s.draws.flat[rng.choice(len(s.draws.flat), n_draws)]
    brdf, dhr = s.posterior.predict(picked)
    targets = Targets(m.brdf.polarization, m.brdf.theta_i_deg, m.brdf.theta_r_deg, m.brdf.phi_r_deg)
    scales = scan_scales(s.posterior, picked, rng)
    if scales is not None:
        scales = np.repeat(scales, [len(scan) for scan in m.scans], axis=1)
    brdf = replicate_brdf(s.posterior, picked, brdf, targets, rng, scales=scales)
    dhr = replicate_dhr(s.posterior, picked, dhr, m.dhr.polarization, rng)
    return xr.Dataset(
        {
            "brdf": (("chain", "draw", "brdf_obs"), brdf[None].astype(np.float32)),
            "dhr": (("chain", "draw", "dhr_obs"), dhr[None].astype(np.float32)),
        },
        coords={**_index("chain", 1), **_index("draw", n_draws)},
    )


def _observed(m: Measurement) -> xr.Dataset:
    return xr.Dataset({"brdf": ("brdf_obs", m.brdf.value), "dhr": ("dhr_obs", m.dhr.value)})


def _constant(s: Stages) -> xr.Dataset:
    m = s.posterior.measurement
    brdf, dhr = s.posterior.predict(s.optima.best.x[None, :])
    scan = np.repeat(np.arange(len(m.scans)), [len(scan) for scan in m.scans])
    best = m.brdf.value / 10.0**s.best_dex
    labels = np.array([scan.label for scan in m.scans], dtype=object)
    over_brdf = {
        "brdf_polarization": m.brdf.polarization.astype(object),
        "brdf_theta_i_deg": m.brdf.theta_i_deg,
        "brdf_theta_r_deg": m.brdf.theta_r_deg,
        "brdf_phi_r_deg": m.brdf.phi_r_deg,
        "brdf_scan": scan,
        "brdf_u": m.brdf.u_value,
        "brdf_repeated": m.brdf.repeated,
        "brdf_row": m.brdf.row,
        "brdf_map": brdf[0],
        "brdf_best": best,
    }
    over_dhr = {
        "dhr_polarization": m.dhr.polarization.astype(object),
        "dhr_theta_i_deg": m.dhr.theta_i_deg,
        "dhr_u": m.dhr.u_value,
        "dhr_row": m.dhr.row,
        "dhr_map": dhr[0],
    }
    return xr.Dataset(
        {name: ("brdf_obs", values) for name, values in over_brdf.items()}
        | {name: ("dhr_obs", values) for name, values in over_dhr.items()},
        coords={"scan": ("scan", labels)},
    )


def _curves(s: Stages) -> xr.Dataset:
    targets, measured, bands = s.curves
    n_angles = len(np.unique(targets.theta_r_deg))
    shape = (-1, n_angles)
    dims = ("curve", "theta_r_deg")

    def first(values: NDArray[Any]) -> NDArray[Any]:
        return values.reshape(shape)[:, 0] if values.size else values

    return xr.Dataset(
        {
            "model_band": ((*dims, "quantile"), bands.model.reshape(*shape, len(QUANTILES))),
            "predictive_band": (
                (*dims, "quantile"), bands.predictive.reshape(*shape, len(QUANTILES))),
            "map": (dims, bands.at_map.reshape(shape)),
        },
        coords={
            "theta_r_deg": targets.theta_r_deg[:n_angles],
            "quantile": np.array(QUANTILES),
            "curve_polarization": ("curve", first(targets.polarization).astype(object)),
            "curve_theta_i_deg": ("curve", first(targets.theta_i_deg)),
            "curve_phi_r_deg": ("curve", first(targets.phi_r_deg)),
            "curve_measured": ("curve", first(measured)),
        },
    )  # fmt: skip


def _dhr_curves(s: Stages) -> xr.Dataset:
    targets, _, bands = s.dhr_curves
    words = list(dict.fromkeys(targets.polarization.tolist()))
    shape = (len(words), -1)
    return xr.Dataset(
        {
            "model_band": (
                ("polarization", "theta_i_deg", "quantile"),
                bands.model.reshape(*shape, len(QUANTILES)),
            ),
            "predictive_band": (
                ("polarization", "theta_i_deg", "quantile"),
                bands.predictive.reshape(*shape, len(QUANTILES)),
            ),
            "map": (("polarization", "theta_i_deg"), bands.at_map.reshape(shape)),
        },
        coords={
            "polarization": np.array(words, dtype=object),
            "theta_i_deg": targets.theta_i_deg.reshape(shape)[0],
            "quantile": np.array(QUANTILES),
        },
    )


def measurement_of(analysis: Analysis) -> Measurement:
    """The measurement a run was made from, out of its arrays."""
    seen = analysis.draws["observed_data"].to_dataset()
    fixed = analysis.draws["constant_data"].to_dataset()
    n_brdf, n_dhr = seen["brdf"].size, seen["dhr"].size
    labels = [str(label) for label in fixed["scan"].values]
    scan = [labels[int(i)] for i in fixed["brdf_scan"].values]

    def both(name: str, dhr_fill: float | None = None) -> Array:
        dhr = np.full(n_dhr, dhr_fill) if dhr_fill is not None else fixed[f"dhr_{name}"].values
        return np.concatenate([fixed[f"brdf_{name}"].values, dhr])

    return measurement_from_columns(
        sample=str(analysis.summary["sample"]),
        wavelength_um=float(analysis.summary["wavelength_um"]),
        quantity=["brdf"] * n_brdf + ["dhr"] * n_dhr,
        polarization=both("polarization").astype(str),
        theta_i_deg=both("theta_i_deg"),
        theta_r_deg=both("theta_r_deg", np.nan),
        phi_r_deg=both("phi_r_deg", 0.0),
        value=np.concatenate([seen["brdf"].values, seen["dhr"].values]),
        sigma=both("u"),
        scan=scan + [""] * n_dhr,
        row=both("row"),
        source=str(analysis.summary["input"]["file"]),
        sha256=str(analysis.summary["input"]["sha256"]),
    )
