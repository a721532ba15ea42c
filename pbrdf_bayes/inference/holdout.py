"""The paper's own recipe as a test: DHR and one scan are fitted, the other scans are predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.bands import inside_band, predict_bands, targets_at
from pbrdf_bayes.inference.ensembles import Checkpoint
from pbrdf_bayes.inference.laplace import laplace_mixture
from pbrdf_bayes.inference.map_fit import find_map
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.inference.residuals import weight_beside_floor
from pbrdf_bayes.inference.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement, Scan, select_scans

Array = NDArray[np.float64]

_N_STARTS = 8
_N_DRAWS = 400
_MAX_STEPS = 1500
_LEAST_SHARE = 0.05


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
        Of log10(measured/predicted median), readings weighted down as they come near the floor;
        of the 90 % predictive band; its mean width. Where the scale of a scan is free, its median
        is brought onto its readings first.
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
    """Scan that the recipe fits: in plane, s or unpolarised, off normal, not grazing.

    None where there is no DHR, or no scan of another geometry to predict.
    """
    if len({_geometry(scan) for scan in measurement.scans}) < 2 or not len(measurement.dhr):
        return None

    def merit(index: int) -> tuple[bool, bool, bool, float]:
        scan = measurement.scans[index]
        off_plane, normal = scan.phi_r_deg != 0.0, scan.theta_i_deg == 0.0
        return (off_plane, scan.polarization == "p", normal, abs(scan.theta_i_deg - 20.0))

    return min(range(len(measurement.scans)), key=merit)


def _geometry(scan: Scan) -> tuple[str, float, float]:
    return scan.polarization, scan.theta_i_deg, scan.phi_r_deg


def run_holdout(
    measurement: Measurement,
    config: RunConfig,
    *,
    seed: int,
    checkpoint: Checkpoint | None = None,
) -> Holdout | None:
    """Fit DHR and one scan, predict the others; None where there is no DHR or only one scan."""
    chosen = choose_scan(measurement)
    if chosen is None:
        return None
    scans = measurement.scans
    keep = np.arange(len(scans)) == chosen
    other = np.array([_geometry(scan) != _geometry(scans[chosen]) for scan in scans])
    priors = _applicable(config, measurement, chosen)
    steps = min(config.max_steps, _MAX_STEPS)
    draft = replace(config, accuracy="draft", priors=priors, max_steps=steps)
    posterior = build_posterior(select_scans(measurement, keep, dhr=True), draft)
    optima = find_map(posterior, n_starts=_N_STARTS, seed=seed)
    draws = sample_posterior(
        posterior, laplace_mixture(posterior, optima), draft, method="psis", seed=seed,
        checkpoint=checkpoint,
    )  # fmt: skip
    rng = np.random.default_rng([seed, 3])
    picked = draws.flat[rng.choice(len(draws.flat), _N_DRAWS)]
    left_out = select_scans(measurement, other, dhr=False)
    brdf = left_out.brdf
    noise = float(optima.best.x[posterior.rows.noise_column[0]])
    weight = weight_beside_floor(brdf.value, config.brdf_floor, noise)
    weight[brdf.value <= config.brdf_floor] = 0.0
    shapes_only = config.brdf_scale == "relative"
    if shapes_only:
        posterior = replace(posterior, rows=posterior.rows._replace(u_cal2=0.0))
    band = predict_bands(posterior, picked, optima.best.x, targets_at(brdf), rng).predictive
    if shapes_only:
        band = _scaled_to_scans(left_out, band, weight)
    inside = inside_band(brdf.value, band, config.brdf_floor, rng)
    return _score(left_out, band, weight, inside, scans[chosen].label, shapes_only=shapes_only)


def _scaled_to_scans(left_out: Measurement, band: Array, weight: Array) -> Array:
    """Bands times the factor that brings the median of each scan onto its readings."""
    scaled = band.copy()
    error = np.log(np.where(weight > 0.0, left_out.brdf.value, band[:, 2]) / band[:, 2])
    for scan in left_out.scans:
        share = weight[scan.rows]
        if share.sum() > 0.0:
            scaled[scan.rows] *= np.exp(np.average(error[scan.rows], weights=share))
    return scaled


def _applicable(
    config: RunConfig, measurement: Measurement, chosen: int
) -> dict[str, Mapping[str, Any]]:
    """The user's priors without those of noises that the one scan does not have."""
    other = {f"s_rel_{q}" for q in "spu"} - {f"s_rel_{measurement.scans[chosen].polarization}"}
    return {name: table for name, table in config.priors.items() if name not in other}


def _score(
    left_out: Measurement, band: Array, weight: Array, inside: Array, fitted: str,
    *, shapes_only: bool,
) -> Holdout:  # fmt: skip
    value = np.where(weight > 0.0, left_out.brdf.value, band[:, 2])
    error = np.log10(value / band[:, 2])
    width = np.log10(band[:, 4] / band[:, 0])

    def figures(rows: slice) -> dict[str, float | str]:
        share = weight[rows].sum()
        square = np.sum(weight[rows] * error[rows] ** 2) / share if share > 0.0 else np.nan
        return {
            "rms_dex": float(np.sqrt(square)),
            "coverage_90": float(np.mean(inside[rows])),
            "width_dex": float(np.mean(width[rows])),
        }

    everything = figures(slice(None))
    label = np.concatenate([np.full(len(scan), scan.label) for scan in left_out.scans])
    n = len(left_out.scans)
    rms, coverage = float(everything["rms_dex"]), float(everything["coverage_90"])
    return Holdout(
        fitted=f"DHR and the scan {fitted}",
        statement=(
            f"Fitted to DHR and the scan {fitted} alone, the model predicts "
            f"{'the shapes of ' * shapes_only}{n} other scan{'s' * (n != 1)} within {rms:.3f} dex "
            f"rms; {100 * coverage:.0f} % of their readings lie inside the 90 % predictive band."
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
