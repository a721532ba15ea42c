"""The arrays of a run as one tree."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes.inference.prediction.bands import (
    expand_scales,
    replicate_brdf,
    replicate_dhr,
    scan_scales,
    targets_at,
)
from pbrdf_bayes.inference.prediction.scan_widths import ScanWidths
from pbrdf_bayes.io.measurement_arrays import measurement_datasets
from pbrdf_bayes.results import QUANTILES
from pbrdf_bayes.workflow.stages import Stages

Array = NDArray[np.float64]

_N_PRIOR = 4000
_MAX_PREDICTIVE = 400_000


def build_tree(s: Stages) -> xr.DataTree:
    """The content of ``posterior.nc``, see `pbrdf_bayes.results`."""
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
        **_measured(s),
        "leave_one_out": _leave_one_out(s),
        "curves": _curves(s),
        "dhr_curves": _dhr_curves(s),
        "widths": _widths(s.widths),
    }  # fmt: skip
    if s.holdout is not None:
        groups["holdout"] = xr.Dataset(
            {
                "scan": ("holdout_obs", s.holdout.scan),
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
    scales = expand_scales(scan_scales(s.posterior, picked, rng), m)
    brdf = replicate_brdf(s.posterior, picked, brdf, targets_at(m.brdf), rng, scales=scales)
    dhr = replicate_dhr(s.posterior, picked, dhr, m.dhr.polarization, rng)
    return xr.Dataset(
        {
            "brdf": (("chain", "draw", "brdf_obs"), brdf[None].astype(np.float32)),
            "dhr": (("chain", "draw", "dhr_obs"), dhr[None].astype(np.float32)),
        },
        coords={**_index("chain", 1), **_index("draw", n_draws)},
    )


def _measured(s: Stages) -> dict[str, xr.Dataset]:
    """The measurement, and the model at its rows: at the MAP, at the least-squares optimum."""
    groups = measurement_datasets(s.posterior.measurement)
    brdf, dhr = s.posterior.predict(s.optima.best.x[None, :])
    best = s.posterior.measurement.brdf.value / 10.0**s.best_dex
    groups["constant_data"] = groups["constant_data"].assign(
        brdf_map=("brdf_obs", brdf[0]), brdf_best=("brdf_obs", best), dhr_map=("dhr_obs", dhr[0])
    )
    return groups


def _leave_one_out(s: Stages) -> xr.Dataset:
    found, n = s.leave_one_out.pointwise, len(s.posterior.measurement.brdf)
    columns = {"elpd": found.elpd, "k_hat": found.k_hat, "pit": found.pit}
    return xr.Dataset(
        {f"brdf_{name}": ("brdf_obs", values[:n]) for name, values in columns.items()}
        | {f"dhr_{name}": ("dhr_obs", values[n:]) for name, values in columns.items()}
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
            "curve_polarization": ("curve", first(targets.polarization)),
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
            "polarization": np.array(words),
            "theta_i_deg": targets.theta_i_deg.reshape(shape)[0],
            "quantile": np.array(QUANTILES),
        },
    )


def _widths(found: ScanWidths) -> xr.Dataset:
    dims = ("polarization", "theta_i_deg")
    return xr.Dataset(
        {"model_band": ((*dims, "quantile"), found.band), "map": (dims, found.at_map)},
        coords={
            "polarization": np.array(found.polarizations),
            "theta_i_deg": found.theta_i_deg,
            "quantile": np.array(QUANTILES),
        },
    )
