"""Scans left out and predicted; first by the paper's own recipe: DHR and one scan are fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.parameters.table import parameter_specs
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.prediction.bands import Targets, inside_band, replicate_brdf, targets_at
from pbrdf_bayes.inference.prediction.discrepancy import Process, draw_prior_discrepancy
from pbrdf_bayes.inference.prediction.residuals import weight_beside_floor
from pbrdf_bayes.inference.sampling.ensembles import Checkpoint
from pbrdf_bayes.inference.sampling.importance import adapt_mixture, importance_sample, k_hat_limit
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement, Scan, select_scans
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.records.summary import HeldOutScan
from pbrdf_bayes.results import QUANTILES
from pbrdf_bayes.words import counted, say

Array = NDArray[np.float64]

_N_STARTS = 8
N_DRAWS = 400
_MAX_STEPS = 1500
_N_PROPOSALS = 2000
_FEWEST_EFFECTIVE = 100.0
_ATTEMPTS = 2
_GOOD_SHARE = 0.25
LEAST_SHARE = 0.05
"""Effective share of the proposals that is enough for a prediction's band."""


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
    scans : tuple of HeldOutScan
        The same three figures for each scan left out.
    kind : {"recipe", "angle", "polarization"}
    name : str
        What was left out, or what was fitted where that is less.
    expected_dex : float
        95 % quantile of the rms of readings that follow the prediction: errors that the readings
        share (of the curve, the gain, the discrepancy) are shared in it [dex].
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
    scans: tuple[HeldOutScan, ...]
    kind: str = "recipe"
    name: str = ""
    expected_dex: float = float("nan")

    @property
    def surprise(self) -> float:
        """The rms over what the prediction leads to expect of it; NaN where that is not known."""
        return self.rms_dex / self.expected_dex


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
    part = select_scans(measurement, keep, dhr=True)
    draft = draft_of(config, part)
    posterior = build_posterior(part, draft)
    optima = find_map(posterior, n_starts=_N_STARTS, seed=seed)
    mixture, z = laplace_mixture(posterior, optima), None
    if config.accuracy == "draft":
        _, z = draw_quickly(posterior, mixture, seed)
    rng = np.random.default_rng([seed, 3])
    if z is not None:
        picked = posterior.from_coordinates(z)
    else:
        draws = sample_posterior(
            posterior, mixture, draft, method="psis", seed=seed,
            checkpoint=checkpoint, least_share=LEAST_SHARE,
        )  # fmt: skip
        picked = draws.flat[rng.choice(len(draws.flat), N_DRAWS)]
    left_out = select_scans(measurement, other, dhr=False)
    found = score_prediction(posterior, picked, left_out, rng)
    label, n = scans[chosen].label, len(left_out.scans)
    shapes = "the shapes of " if config.brdf_scale == "relative" else ""
    return replace(
        found, name=f"scan {label}", fitted=f"DHR and the scan {label}",
        statement=say(
            "holdout.recipe", label=label, shapes=shapes, scans=counted(n, "other scan"),
            rms=found.rms_dex, percent=100.0 * found.coverage_90, width=found.width_dex,
        ),
    )  # fmt: skip


def draw_quickly(posterior: Posterior, start: Mixture, seed: int) -> tuple[Mixture, Array | None]:
    """Draws for the band of a prediction, from a proposal that is good enough for it.

    Returns
    -------
    tuple of Mixture and (ndarray of shape (N_DRAWS, n_free) or None)
        The adapted proposal, and draws in the coordinates z; None where the weights cannot be
        relied on.
    """
    mixture = start
    for attempt in range(_ATTEMPTS):
        mixture = adapt_mixture(posterior, mixture, seed=seed + attempt, good_share=_GOOD_SHARE)
        quick = importance_sample(
            posterior, mixture, n_proposals=_N_PROPOSALS, n_draws=N_DRAWS, seed=seed
        )
        if quick.k_hat < k_hat_limit(_N_PROPOSALS) and quick.ess > _FEWEST_EFFECTIVE:
            return mixture, quick.z
    return mixture, None


def draft_of(config: RunConfig, part: Measurement) -> RunConfig:
    """Configuration of the quick fit of a part of the readings.

    Without the priors of noises that this part does not have.
    """
    names = {spec.name for spec in parameter_specs(part, replace(config, priors={}))}
    priors = {name: table for name, table in config.priors.items() if name in names}
    steps = min(config.max_steps, _MAX_STEPS)
    return replace(config, accuracy="draft", priors=priors, max_steps=steps)


def score_prediction(
    posterior: Posterior, draws: Array, left_out: Measurement, rng: np.random.Generator
) -> Holdout:
    """Hold scans that were left out against their prediction.

    Parameters
    ----------
    posterior : Posterior
        Of the readings that were fitted.
    draws : ndarray, shape (n_draws, n_par)
        Its draws, physical units.
    left_out : Measurement
        Scans that were not.
    rng : numpy.random.Generator

    Returns
    -------
    Holdout
        Without its words.
    """
    config, brdf = posterior.config, left_out.brdf
    noise = float(np.median(draws[:, posterior.rows.noise_column[0]]))
    weight = weight_beside_floor(brdf.value, config.brdf_floor, noise)
    weight[brdf.value <= config.brdf_floor] = 0.0
    shapes_only = config.brdf_scale == "relative"
    if shapes_only:
        posterior = replace(posterior, rows=posterior.rows._replace(u_cal2=0.0))
    targets = targets_at(brdf)
    curves, _ = posterior.predict(draws, geometry_of(targets))
    readings = replicate_brdf(posterior, draws, curves, targets, rng)
    band = np.quantile(readings, QUANTILES, axis=0).T
    expected = _expected_rms(
        _joint_replicas(posterior, draws, curves, readings, left_out, rng), band[:, 2], weight,
        left_out if shapes_only else None,
    )  # fmt: skip
    if shapes_only:
        band = _scaled_to_scans(left_out, band, weight)
    inside = inside_band(brdf.value, band, config.brdf_floor, rng)
    return replace(_score(left_out, band, weight, inside), expected_dex=expected)


def geometry_of(targets: Targets) -> Geometry:
    """Prepared BRDF directions."""
    return prepare_geometry(
        theta_i=np.deg2rad(targets.theta_i_deg), theta_r=np.deg2rad(targets.theta_r_deg),
        phi_r=np.deg2rad(targets.phi_r_deg), polarization=targets.polarization,
        dhr_theta_i=np.zeros(0), dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip


def _joint_replicas(
    posterior: Posterior, draws: Array, curves: Array, readings: Array, left_out: Measurement,
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Replicated scans whose discrepancy is one path along each scan, shape of ``curves``."""
    names = posterior.parameter_names
    if "tau" not in names:
        return readings
    tau, ell = names.index("tau"), names.index("ell_deg")
    targets = targets_at(left_out.brdf)
    keys = [_geometry(scan) for scan in left_out.scans]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    group = np.repeat([number[key] for key in keys], [len(scan) for scan in left_out.scans])
    paths = [
        draw_prior_discrepancy(
            Process(x[tau], x[ell]), rng, theta_r_deg=targets.theta_r_deg, group=group
        )
        for x in draws
    ]
    return replicate_brdf(posterior, draws, curves, targets, rng, paths=np.stack(paths))


def _expected_rms(
    replicas: Array, median: Array, weight: Array, free_scales: Measurement | None
) -> float:
    """95 % quantile of the rms [dex] that the prediction leads to expect of such readings."""
    if not weight.sum() > 0.0:
        return float("nan")
    error = np.log10(replicas / median)
    for scan in () if free_scales is None else free_scales.scans:
        share = weight[scan.rows]
        if share.sum() > 0.0:
            error[:, scan.rows] -= np.average(error[:, scan.rows], axis=1, weights=share)[:, None]
    return float(np.quantile(np.sqrt(np.average(error**2, axis=1, weights=weight)), 0.95))


def _scaled_to_scans(left_out: Measurement, band: Array, weight: Array) -> Array:
    """Bands times the factor that brings the median of each scan onto its readings."""
    scaled = band.copy()
    error = np.log(np.where(weight > 0.0, left_out.brdf.value, band[:, 2]) / band[:, 2])
    for scan in left_out.scans:
        share = weight[scan.rows]
        if share.sum() > 0.0:
            scaled[scan.rows] *= np.exp(np.average(error[scan.rows], weights=share))
    return scaled


def _score(left_out: Measurement, band: Array, weight: Array, inside: Array) -> Holdout:
    value = np.where(weight > 0.0, left_out.brdf.value, band[:, 2])
    error = np.log10(value / band[:, 2])
    width = np.log10(band[:, 4] / band[:, 0])

    def figures(label: str, rows: slice) -> HeldOutScan:
        share = weight[rows].sum()
        square = np.sum(weight[rows] * error[rows] ** 2) / share if share > 0.0 else np.nan
        return HeldOutScan(
            label, float(np.sqrt(square)), float(np.mean(inside[rows])), float(np.mean(width[rows]))
        )

    everything = figures("all", slice(None))
    label = np.concatenate([np.full(len(scan), scan.label) for scan in left_out.scans])
    return Holdout(
        fitted="",
        statement="",
        scan=label,
        theta_r_deg=left_out.brdf.theta_r_deg,
        value=left_out.brdf.value,
        predictive_band=band,
        rms_dex=everything.rms_dex,
        coverage_90=everything.coverage_90,
        width_dex=everything.width_dex,
        scans=tuple(figures(scan.label, scan.rows) for scan in left_out.scans),
    )
