"""Readings drawn from a known truth: by the law of the likelihood, or with another misfit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.discrepancy import Process, draw_prior_discrepancy
from pbrdf_bayes.measurement import Measurement, measurement_from_columns

Array = NDArray[np.float64]

Misfit = Callable[[NDArray[np.float64], NDArray[np.int64]], Array]
"""Covariance of the misfit, shape (n, n), from the angles [deg] and the group of each row."""


@dataclass(frozen=True)
class Layout:
    """Which readings an experiment takes."""

    theta_i_deg: tuple[float, ...]
    theta_r_deg: tuple[float, ...]
    dhr_theta_i_deg: tuple[float, ...]
    polarizations: tuple[str, ...] = ("s", "p")

    def template(self) -> Measurement:
        """A measurement of these readings with made-up values."""
        scans = [(t, q) for t in self.theta_i_deg for q in self.polarizations]
        dhr = [(t, q) for t in self.dhr_theta_i_deg for q in self.polarizations]
        n = len(self.theta_r_deg)
        n_brdf = n * len(scans)
        return measurement_from_columns(
            sample="study_simulated",
            wavelength_um=1.0,
            quantity=["brdf"] * n_brdf + ["dhr"] * len(dhr),
            polarization=[q for _, q in scans for _ in range(n)] + [q for _, q in dhr],
            theta_i_deg=[t for t, _ in scans for _ in range(n)] + [t for t, _ in dhr],
            theta_r_deg=[*self.theta_r_deg] * len(scans) + [np.nan] * len(dhr),
            value=[0.1] * (n_brdf + len(dhr)),
        )


def rows_of(measurement: Measurement) -> tuple[Array, NDArray[np.int64]]:
    """Angle of each BRDF row [deg] and the number of its scan."""
    lengths = [len(scan) for scan in measurement.scans]
    return measurement.brdf.theta_r_deg, np.repeat(np.arange(len(lengths)), lengths)


def draw_readings(
    posterior: Posterior, x: Array, rng: np.random.Generator, *, misfit: Array | None = None
) -> Measurement:
    """Readings by the law of the posterior's own likelihood at ``x``, shape (n_par,).

    Parameters
    ----------
    posterior : Posterior
        Of a template: only its geometry and its choices count. No floor.
    x : ndarray, shape (n_par,)
        Physical units.
    rng : numpy.random.Generator
    misfit : ndarray, shape (n_brdf,), optional
        In ln BRDF, instead of the discrepancy of the law.

    Returns
    -------
    Measurement
    """
    m, rows, config = posterior.measurement, posterior.rows, posterior.config
    value = dict(zip(posterior.parameter_names, x.tolist(), strict=True))
    brdf, dhr = posterior.predict(x[None, :])
    theta_r, scan = rows_of(m)
    if misfit is None:
        misfit = np.zeros(theta_r.size)
        if posterior.discrepancy is not None:
            law = Process(value["tau"], value["ell_deg"], rough=posterior.discrepancy.groups.rough)
            misfit = draw_prior_discrepancy(law, rng, theta_r_deg=theta_r, group=scan)
    gain = config.u_brdf_cal * rng.standard_normal(len(m.scans))
    noise = x[rows.noise_column][scan] * rng.standard_normal(theta_r.size)
    readings = brdf[0] * np.exp(misfit + gain[scan] + noise)
    dhr_gain = 1.0 + config.u_dhr_cal * rng.standard_normal(3)
    u_dhr = value.get("u_dhr", 0.0)
    dhr_readings = dhr[0] * dhr_gain[rows.dhr_group] + u_dhr * rng.standard_normal(dhr.shape[1])
    return replace(m, brdf=replace(m.brdf, value=readings), dhr=replace(m.dhr, value=dhr_readings))


def matern(tau: float, ell: float) -> Misfit:
    """Matérn 3/2 of its own for every scan."""

    def covariance(theta_r: Array, scan: NDArray[np.int64]) -> Array:
        a = np.sqrt(3.0) * np.abs(theta_r[:, None] - theta_r) / ell
        same = scan[:, None] == scan
        return np.where(same, tau**2 * (1.0 + a) * np.exp(-a), 0.0)

    return covariance


def rough(tau: float, ell: float) -> Misfit:
    """Matérn 1/2, a broken path, of its own for every scan."""

    def covariance(theta_r: Array, scan: NDArray[np.int64]) -> Array:
        a = np.abs(theta_r[:, None] - theta_r) / ell
        return np.where(scan[:, None] == scan, tau**2 * np.exp(-a), 0.0)

    return covariance


def common(tau: float, ell: float) -> Misfit:
    """Matérn 3/2, one path for all scans: an error of the angle scale or of the detector."""
    alone = matern(tau, ell)

    def covariance(theta_r: Array, scan: NDArray[np.int64]) -> Array:
        return alone(theta_r, np.zeros_like(scan))

    return covariance


def smooth(tau: float, ell: float) -> Misfit:
    """Squared exponential, smoother than the likelihood expects, of its own for every scan."""

    def covariance(theta_r: Array, scan: NDArray[np.int64]) -> Array:
        a = (theta_r[:, None] - theta_r) / ell
        return np.where(scan[:, None] == scan, tau**2 * np.exp(-0.5 * a * a), 0.0)

    return covariance


def draw_misfit(covariance: Array, rng: np.random.Generator) -> Array:
    """One draw of a normal law with this covariance, shape (n,)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(
        vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
    )
