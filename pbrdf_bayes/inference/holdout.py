"""The paper's own recipe as a test: DHR and one scan are fitted, the other scans are predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.bands import Targets, predict_bands
from pbrdf_bayes.inference.laplace import laplace_mixture
from pbrdf_bayes.inference.map_fit import find_map
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.inference.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement, select_scans

Array = NDArray[np.float64]

_N_STARTS = 8
_N_DRAWS = 400


@dataclass(frozen=True, eq=False)
class Holdout:
    """Prediction of the scans that were left out.

    Attributes
    ----------
    fitted, statement : str
    scan : ndarray of str, shape (n_obs,)
    theta_r_deg, value : ndarray, shape (n_obs,)
        Angles [deg] and readings [sr^-1] left out.
    predictive_band : ndarray, shape (n_obs, n_quantiles)
    rms_dex, coverage_90, width_dex : float
        Of log10(measured/predicted median), of the 90 % predictive band, and its mean width.
    scans : tuple of dict
        The same three figures for each scan left out, with its ``label``.
    """

    fitted: str
    statement: str
    scan: NDArray[np.str_]
    theta_r_deg: Array
    value: Array
    predictive_band: Array
    rms_dex: float
    coverage_90: float
    width_dex: float
    scans: tuple[dict[str, float | str], ...]


def choose_scan(measurement: Measurement) -> int | None:
    """Scan that the recipe fits: s or unpolarised, off normal, not grazing; None if impossible."""
    if len(measurement.scans) < 2 or not len(measurement.dhr):
        return None

    def merit(index: int) -> tuple[bool, bool, float]:
        scan = measurement.scans[index]
        return (scan.polarization == "p", scan.theta_i_deg == 0.0, abs(scan.theta_i_deg - 20.0))

    return min(range(len(measurement.scans)), key=merit)


def run_holdout(measurement: Measurement, config: RunConfig, *, seed: int) -> Holdout | None:
    """Fit DHR and one scan, predict the others; None where there is no DHR or only one scan."""
    chosen = choose_scan(measurement)
    if chosen is None:
        return None
    keep = np.arange(len(measurement.scans)) == chosen
    draft = replace(config, accuracy="draft", priors=_applicable(config, measurement, chosen))
    posterior = build_posterior(select_scans(measurement, keep, dhr=True), draft)
    optima = find_map(posterior, n_starts=_N_STARTS, seed=seed)
    draws = sample_posterior(
        posterior, laplace_mixture(posterior, optima), draft, method="psis", seed=seed
    )
    rng = np.random.default_rng([seed, 3])
    picked = draws.flat[rng.choice(len(draws.flat), _N_DRAWS)]
    left_out = select_scans(measurement, ~keep, dhr=False)
    brdf = left_out.brdf
    targets = Targets(brdf.polarization, brdf.theta_i_deg, brdf.theta_r_deg, brdf.phi_r_deg)
    bands = predict_bands(posterior, picked, optima.best.x, targets, rng)
    return _score(left_out, bands.predictive, measurement.scans[chosen].label)


def _applicable(
    config: RunConfig, measurement: Measurement, chosen: int
) -> dict[str, Mapping[str, Any]]:
    """The user's priors without those of noises that the one scan does not have."""
    other = {f"s_rel_{q}" for q in "spu"} - {f"s_rel_{measurement.scans[chosen].polarization}"}
    return {name: table for name, table in config.priors.items() if name not in other}


def _score(left_out: Measurement, band: Array, fitted: str) -> Holdout:
    positive = np.where(left_out.brdf.value > 0.0, left_out.brdf.value, np.nan)
    error = np.log10(positive / band[:, 2])
    inside = (left_out.brdf.value >= band[:, 0]) & (left_out.brdf.value <= band[:, 4])
    width = np.log10(band[:, 4] / band[:, 0])

    def figures(rows: slice) -> dict[str, float | str]:
        return {
            "rms_dex": float(np.sqrt(np.nanmean(error[rows] ** 2))),
            "coverage_90": float(np.mean(inside[rows])),
            "width_dex": float(np.mean(width[rows])),
        }

    everything = figures(slice(None))
    label = np.concatenate([np.full(len(scan), scan.label) for scan in left_out.scans])
    rms, coverage = float(everything["rms_dex"]), float(everything["coverage_90"])
    return Holdout(
        fitted=f"DHR and the scan {fitted}",
        statement=(
            f"Fitted to DHR and the scan {fitted} alone, the model predicts the other "
            f"{len(left_out.scans)} scans within {rms:.3f} dex rms; {100 * coverage:.0f} % of "
            "their readings lie inside the 90 % predictive band."
        ),
        scan=label,
        theta_r_deg=left_out.brdf.theta_r_deg,
        value=left_out.brdf.value,
        predictive_band=band,
        rms_dex=rms,
        coverage_90=coverage,
        width_dex=float(everything["width_dex"]),
        scans=tuple({"label": scan.label, **figures(scan.rows)} for scan in left_out.scans),
    )
