"""Predicted curves with two kinds of bands, never mixed.

The model band holds the uncertainty of the parameters only: where the curve of the model is. The
predictive band adds calibration and noise: where a new reading would be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from pbrdf_bayes.inference.likelihood.filtered import noise_mixture
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.innovations import draw_gains, filter_all
from pbrdf_bayes.measurement import Measurement, Readings
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.readings.observation import draw_readings, reading_law
from pbrdf_bayes.results import QUANTILES

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bands:
    """Quantiles of predictions, axis order (..., quantile), and the curve at the MAP.

    Attributes
    ----------
    model, predictive : ndarray, shape (n_points, n_quantiles)
    at_map : ndarray, shape (n_points,)
    """

    model: Array
    predictive: Array
    at_map: Array


@dataclass(frozen=True, eq=False)
class Targets:
    """Where predictions are wanted, one array element each; angles [deg]."""

    polarization: NDArray[np.str_]
    theta_i_deg: Array
    theta_r_deg: Array
    phi_r_deg: Array

    @property
    def hemispherical(self) -> bool:
        """DHR instead of BRDF: there is no scattering direction."""
        return bool(np.isnan(self.theta_r_deg).all())


def targets_at(readings: Readings, *, every: int = 1) -> Targets:
    """The directions of readings, or of every so manyth one."""
    return Targets(
        readings.polarization[::every], readings.theta_i_deg[::every],
        readings.theta_r_deg[::every], readings.phi_r_deg[::every],
    )  # fmt: skip


def expand_scales(
    scales: Array | None, measurement: Measurement, *, every: int = 1
) -> Array | None:
    """Factors of scans, shape (n_draws, n_scans), at the BRDF readings, or every so manyth."""
    if scales is None:
        return None
    return np.repeat(scales, [len(scan) for scan in measurement.scans], axis=1)[:, ::every]


def predict_bands(
    posterior: Posterior, draws: Array, x_map: Array, targets: Targets, rng: np.random.Generator,
    *, scales: Array | None = None,
) -> Bands:  # fmt: skip
    """Bands of the model and of new readings at the targets.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Posterior draws, physical units; a few hundred are enough for 5 % and 95 % quantiles.
    x_map : ndarray, shape (n_par,)
    targets : Targets
        All BRDF [sr^-1] or all DHR [1].
    rng : numpy.random.Generator
        Noise of the predictive band.
    scales : ndarray, shape (n_draws, n_points), optional
        Calibration factors of the scans that the points belong to, see `scan_scales`; those of
        other scans are drawn from what is known of a scan not yet measured.

    Returns
    -------
    Bands
    """
    n = targets.theta_i_deg.size
    none = np.zeros(0)
    hemispherical = targets.hemispherical
    radians = [np.deg2rad(a) for a in (targets.theta_i_deg, targets.theta_r_deg, targets.phi_r_deg)]
    no_words = np.zeros(0, np.str_)
    geometry = prepare_geometry(
        theta_i=none if hemispherical else radians[0],
        theta_r=none if hemispherical else radians[1],
        phi_r=none if hemispherical else radians[2],
        polarization=no_words if hemispherical else targets.polarization,
        dhr_theta_i=radians[0] if hemispherical else none,
        dhr_polarization=targets.polarization if hemispherical else no_words,
    )
    which = 1 if hemispherical else 0
    curves = posterior.predict(draws, geometry)[which]
    readings = (
        replicate_dhr(posterior, draws, curves, targets.polarization, rng)
        if hemispherical
        else replicate_brdf(posterior, draws, curves, targets, rng, scales=scales)
    )
    return Bands(
        model=np.quantile(curves, QUANTILES, axis=0).T.reshape(n, -1),
        predictive=np.quantile(readings, QUANTILES, axis=0).T.reshape(n, -1),
        at_map=posterior.predict(x_map[None, :], geometry)[which][0],
    )


def inside_band(value: Array, band: Array, floor: float, rng: np.random.Generator) -> Array:
    """Which readings lie inside the 90 % band.

    A censored reading, at or below the floor, lies somewhere there: its place in the predictive
    distribution is drawn among those that the band has below the floor.

    Parameters
    ----------
    value : ndarray, shape (n_points,)
        Readings [sr^-1].
    band : ndarray, shape (n_points, n_quantiles)
        Predictive quantiles `QUANTILES`.
    floor : float
        Noise-equivalent BRDF [sr^-1].
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of bool, shape (n_points,)
    """
    inside = (value >= band[:, 0]) & (value <= band[:, -1])
    if floor > 0.0:
        for i in np.flatnonzero(value <= floor):
            below = np.interp(floor, band[i], QUANTILES, left=0.0, right=1.0)
            inside[i] = QUANTILES[0] <= below * rng.random() <= QUANTILES[-1]
    return np.asarray(inside)


def stratified_normal(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Standard normal numbers, each column a random order of evenly spaced quantiles.

    Quantiles over the rows are then smooth with a few hundred rows.
    """
    quantiles = ndtri((np.arange(shape[0]) + 0.5) / shape[0])
    return np.asarray(rng.permuted(np.tile(quantiles[:, None], (1, shape[1])), axis=0))


def replicate_brdf(
    posterior: Posterior, draws: Array, curves: Array, targets: Targets, rng: np.random.Generator,
    *, scales: Array | None = None, paths: Array | None = None,
) -> Array:  # fmt: skip
    """New readings [sr^-1] for curves of shape (n_draws, n_points), by `readings.observation`.

    Without ``paths`` of the discrepancy, of the same shape, that of each point is drawn by itself,
    as a band point by point needs it.
    A polarisation without a scan of its own takes the largest noise of the others.
    """
    if not targets.polarization.size:
        return curves
    names = posterior.parameter_names
    inferred = {n[-1]: draws[:, i] for i, n in enumerate(names) if n.startswith("s_rel_")}
    largest = np.max(list(inferred.values()), axis=0) if inferred else np.zeros(len(draws))
    noise = np.stack([inferred.get(q, largest) for q in targets.polarization.tolist()], axis=1)
    keys = np.stack([targets.theta_i_deg, targets.phi_r_deg], axis=1)
    _, scan = np.unique(keys, axis=0, return_inverse=True)
    scan = 3 * scan.ravel() + np.searchsorted(["p", "s", "u"], targets.polarization)
    gains = stratified_normal(rng, (len(draws), int(scan.max(initial=0)) + 1))
    gain: Array | float = min(np.sqrt(posterior.rows.u_cal2), 1.0) * gains[:, scan]
    if scales is not None:
        gain = np.log(scales)
    if paths is None and "tau" in names:
        paths = draws[:, [names.index("tau")]] * stratified_normal(rng, curves.shape)
    white = noise**2 + _stated_variance(posterior, targets.polarization)
    law = reading_law(curves, posterior.config.brdf_floor, white)
    normal: Array | float = 1.0
    if posterior.config.tails == "student-t":
        normal = _draw_widths(posterior, curves.shape, rng)
    normal = normal * stratified_normal(rng, curves.shape)
    return np.exp(draw_readings(law, gain if paths is None else gain + paths, normal))


def _draw_widths(posterior: Posterior, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Widths of the normal laws that Student's t is a mixture of, stratified in each column."""
    mixture = noise_mixture(posterior.config)
    levels = np.tile(((np.arange(shape[0]) + 0.5) / shape[0])[:, None], (1, shape[1]))
    below = np.cumsum(np.exp(mixture.log_weight))[:-1]
    widths = np.sqrt(mixture.scale[np.searchsorted(below, levels)])
    return np.asarray(rng.permuted(widths, axis=0))


def _stated_variance(posterior: Posterior, polarization: NDArray[np.str_]) -> Array:
    """Relative variance that the laboratory states for a reading: the median of a polarisation."""
    measured = posterior.measurement.brdf.polarization
    variance = np.zeros(polarization.size)
    for q in np.unique(polarization):
        of_q = posterior.rows.u2[measured == q]
        variance[polarization == q] = np.median(of_q) if of_q.size else 0.0
    return variance


def scan_scales(posterior: Posterior, draws: Array, rng: np.random.Generator) -> Array | None:
    """Posterior draws of the calibration factor of each scan, shape (n_draws, n_scans).

    None where the scale is taken as exact. See `draw_gains`.
    """
    filtered = filter_all(posterior)
    if posterior.rows.u_cal2 == 0.0 or filtered is None:
        return None
    return np.stack([draw_gains(posterior, filtered, x, rng) for x in draws])


def replicate_dhr(
    posterior: Posterior, draws: Array, curves: Array, polarization: NDArray[np.str_],
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    """New DHR readings [1] for curves of shape (n_draws, n_points): gain and noise."""
    names = posterior.parameter_names
    stated = posterior.measurement.dhr.u_value
    if "u_dhr" in names:
        noise = draws[:, names.index("u_dhr")][:, None]
    elif stated.size:
        noise = np.full((len(draws), 1), np.median(stated))
    else:
        noise = np.zeros((len(draws), 1))
    group = np.searchsorted(["p", "s", "u"], polarization)
    gain = posterior.config.u_dhr_cal * stratified_normal(rng, (len(draws), 3))[:, group]
    return np.asarray(curves * (1.0 + gain) + noise * stratified_normal(rng, curves.shape))
