"""Lobe widths scan by scan, held against the narrowing of Eq. (5): a diagnostic, as in Fig. 3.

Equation and figure numbers are those of Renhorn, Hallberg, Bergstrom, Boreman, "Four-parameter
model for polarization-resolved rough-surface BRDF", Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027.

The lobes take their width at the mean direction sine, so that the model has no width of an angle of
incidence. What a scan can have of its own is rho0: rho_q = rho0 (1 - F_q) / (1 - F_q(0)) at the
specular direction follows from it. Every scan gets the rho0 that fits it best together with a scale
of its own, everything else held at the MAP: with a scale the width is what the shape of the scan
says, and a wrong DHR or calibration does not pass for a width. The scale takes diffuse terms along.

Residuals of a scan hang together, and the standard errors allow for it. With v = w d, w the weights
and d the slope of ln BRDF by ln rho0 beside the scale, the estimate of ln rho0 has the variance
v' C v / (w d . d)^2. Where the run has a discrepancy, C is the covariance of that process at the
MAP and white noise. Where it has none, readings count as those of a first-order autoregression: the
variance of independent ones over (1 - r) / (1 + r), r the lag-1 correlation of the residuals of
this fit plus (2 + 4 r) / n, its bias for n readings with a level and a slope taken off (Kendall,
Biometrika 41, 403 (1954); Marriott, Pope, ibid. 390). White noise can hide a long correlation from
r: then only the former holds. n, k and sigma_N0 are held, so that their errors are not in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.residuals import (
    effective_share,
    lag1_of,
    row_shares,
    row_weights,
)
from pbrdf_bayes.measurement import Scan
from pbrdf_bayes.model.four_parameter import DOMAIN
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.quantities import POLARIZATIONS
from pbrdf_bayes.readings.observation import reading_law
from pbrdf_bayes.records.summary import ScanWidth
from pbrdf_bayes.results import QUANTILES

Array = NDArray[np.float64]

LEAST_READINGS = 5
"""Readings clear of the floor that a width and a scale ask for."""
THETA_I_DEG = np.arange(0.0, 86.0)
"""Where Eq. (5) is drawn."""
_RHO0 = 3
_COARSE, _FINE, _ZOOMS = 48, 11, 3
_DIGITS = 8.0
_CELLS = 400
"""Readings closer than a 400th of a scan count as one place of the discrepancy."""


@dataclass(frozen=True, eq=False)
class ScanWidths:
    """Widths of all scans, and Eq. (5) with its posterior.

    Attributes
    ----------
    scans : tuple of ScanWidth
    polarizations : tuple of str
        Those measured.
    theta_i_deg : ndarray, shape (n_theta,)
        [deg].
    band : ndarray, shape (n_polarizations, n_theta, n_quantile)
        Posterior quantiles of rho_q, for u of the mean of s and p [1].
    at_map : ndarray, shape (n_polarizations, n_theta)
    """

    scans: tuple[ScanWidth, ...]
    polarizations: tuple[str, ...]
    theta_i_deg: Array
    band: Array
    at_map: Array


def measure_widths(posterior: Posterior, draws: Array, x_map: Array) -> ScanWidths:
    """Width of every scan beside the curve of Eq. (5).

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Physical units; for the band.
    x_map : ndarray, shape (n_par,)
        Everything but rho0 and the scale is held there.

    Returns
    -------
    ScanWidths
    """
    finer = replace(posterior, digits=max(posterior.digits, _DIGITS))
    scans = posterior.measurement.scans
    angles = np.array([scan.theta_i_deg for scan in scans])
    at_scans = widths_at(posterior, x_map[None, :], angles)[:, 0]
    measured = {scan.polarization for scan in scans}
    rows = [i for i, q in enumerate(POLARIZATIONS) if q in measured]
    found = widths_at(posterior, draws, THETA_I_DEG)[rows]
    weight = row_weights(posterior, x_map)
    return ScanWidths(
        scans=tuple(
            _own_width(
                finer,
                x_map,
                scan,
                weight[scan.rows],
                float(at_scans[POLARIZATIONS.index(scan.polarization), i]),
            )
            for i, scan in enumerate(scans)
        ),
        polarizations=tuple(POLARIZATIONS[i] for i in rows),
        theta_i_deg=THETA_I_DEG,
        band=np.moveaxis(np.quantile(found, QUANTILES, axis=1), 0, -1),
        at_map=widths_at(posterior, x_map[None, :], THETA_I_DEG)[rows, 0],
    )


def widths_at(posterior: Posterior, x: Array, theta_i_deg: Array) -> Array:
    """rho_q at the specular direction, Eq. (5), with the exponent of ``narrowing`` if there is one.

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_sets, n_par)
        Physical units.
    theta_i_deg : ndarray, shape (n_theta,)
        [deg].

    Returns
    -------
    ndarray, shape (3, n_sets, n_theta)
        For s and p, and their mean for u, in direction cosine [1].
    """
    angles = np.deg2rad(np.concatenate([[0.0], theta_i_deg]))
    nothing = np.zeros(0)
    geometry = prepare_geometry(
        theta_i=nothing, theta_r=nothing, phi_r=nothing, polarization=np.zeros(0, np.str_),
        dhr_theta_i=np.tile(angles, 2), dhr_polarization=np.repeat(["s", "p"], angles.size),
    )  # fmt: skip
    bright = np.array(x, dtype=np.float64)
    bright[:, 2] = 1.0  # sigma_n0: the DHR is then the reflectance
    _, reflectance = evaluate(geometry, bright, posterior.digits)
    passed = 1.0 - np.moveaxis(reflectance.reshape(len(x), 2, angles.size), 1, 0)
    names = posterior.parameter_names
    power = x[:, names.index("narrowing")] if "narrowing" in names else np.ones(len(x))
    ratio = (passed[:, :, 1:] / passed[:, :, :1]) ** power[:, None]
    width = x[:, _RHO0, None] * ratio
    return np.concatenate([width, width.mean(axis=0, keepdims=True)])


def _own_width(
    posterior: Posterior, x_map: Array, scan: Scan, weight: Array, rho_model: float
) -> ScanWidth:
    """Width and scale of one scan by weighted least squares in ln BRDF."""
    y, h = posterior.rows.y[scan.rows], row_shares(posterior)[scan.rows]
    model, floor = _models_of(posterior, x_map, scan), posterior.config.brdf_floor
    missing = dict.fromkeys(("rho0", "u_rho0", "rho", "u_rho", "scale", "lag1"), float("nan"))

    def left(ln_rho0: Array) -> tuple[Array, Array]:
        """Residuals beside the scale, shape (n_sets, n_rows), and ln of the scale."""
        residual = y - reading_law(model(np.exp(ln_rho0)), floor).mean
        gain = np.sum(weight * h * residual, axis=1) / np.sum(weight * h * h)
        return residual - gain[:, None] * h, gain

    used = int(np.count_nonzero(weight))
    place = {"label": scan.label, "polarization": scan.polarization, "n": used}
    place |= {"theta_i_deg": scan.theta_i_deg, "rho_model": rho_model}
    best = None
    if used >= LEAST_READINGS:
        best = _least(lambda t: np.sum(weight * left(t)[0] ** 2, axis=1))
    if best is None:
        return ScanWidth(**place, **missing)  # type: ignore[arg-type]
    ln_rho0, step = best
    residuals, gains = left(ln_rho0 + np.array([-step, 0.0, step]))
    slope, residual = (residuals[2] - residuals[0]) / (2.0 * step), residuals[1]
    lag1 = lag1_of(residual, weight)
    if posterior.discrepancy is None:
        variance = _independent_variance(residual, slope, weight) / _share(lag1, used)
    else:
        variance = _variance_with_discrepancy(posterior, x_map, scan, slope, weight, h)
    u = float(np.sqrt(variance))
    rho0 = float(np.exp(ln_rho0))
    rho = rho_model * rho0 / float(x_map[_RHO0])
    return ScanWidth(
        **place, rho0=rho0, u_rho0=rho0 * u, rho=rho, u_rho=rho * u,  # type: ignore[arg-type]
        scale=float(np.exp(gains[1])), lag1=lag1,
    )  # fmt: skip


def _independent_variance(residual: Array, slope: Array, weight: Array) -> float:
    """Variance of ln rho0 if the residuals were independent."""
    freedom = np.count_nonzero(weight) - 2
    return float(np.sum(weight * residual**2) / freedom / np.sum(weight * slope**2))


def _share(lag1: float, n: int) -> float:
    """Effective share of readings, the lag-1 correlation freed from its bias."""
    return effective_share(min(lag1 + (2.0 + 4.0 * lag1) / n, 1.0) if lag1 > 0.0 else lag1)


def _variance_with_discrepancy(
    posterior: Posterior, x_map: Array, scan: Scan, slope: Array, weight: Array, h: Array
) -> float:
    """Variance of ln rho0 under the run's noise and discrepancy at the MAP."""
    names = posterior.parameter_names
    theta_r = posterior.measurement.brdf.theta_r_deg[scan.rows]
    tau, ell = x_map[names.index("tau")], x_map[names.index("ell_deg")]
    cells = np.minimum(_CELLS * (theta_r - theta_r[0]) / max(np.ptp(theta_r), 1e-9), _CELLS - 1)
    _, sums = np.unique(cells.astype(np.int64), return_inverse=True)
    v = np.bincount(sums, weight * h * slope)
    places = np.bincount(sums, theta_r) / np.bincount(sums)
    distance = np.abs(places[:, None] - places) / ell
    white = x_map[names.index(f"s_rel_{scan.polarization}")] ** 2
    curvature = np.sum(weight * slope**2)
    return float(white / curvature + tau**2 * (v @ _matern(posterior, distance) @ v) / curvature**2)


def _matern(posterior: Posterior, distance: Array) -> Array:
    """Correlation of the discrepancy over distances in its length."""
    if posterior.config.discrepancy == "matern-1/2":
        return np.asarray(np.exp(-distance))
    a = np.sqrt(3.0) * distance
    return np.asarray((1.0 + a) * np.exp(-a))


def _models_of(posterior: Posterior, x_map: Array, scan: Scan) -> Callable[[Array], Array]:
    """BRDF of the rows of a scan for widths (n_sets,), shape (n_sets, n_rows)."""
    brdf, rows = posterior.measurement.brdf, scan.rows
    geometry = prepare_geometry(
        theta_i=np.deg2rad(brdf.theta_i_deg[rows]), theta_r=np.deg2rad(brdf.theta_r_deg[rows]),
        phi_r=np.deg2rad(brdf.phi_r_deg[rows]), polarization=brdf.polarization[rows],
        dhr_theta_i=np.zeros(0), dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip

    def model(rho0: Array) -> Array:
        x = np.tile(x_map, (rho0.size, 1))
        x[:, _RHO0] = rho0
        return posterior.predict(x, geometry)[0]

    return model


def _least(cost: Callable[[Array], Array]) -> tuple[float, float] | None:
    """Minimum over ln rho0 and the last spacing; None where it lies at the end of the domain."""
    low, high = np.log(DOMAIN["rho0"])
    t = np.linspace(low, high, _COARSE)
    for _ in range(_ZOOMS):
        values, step = cost(t), t[1] - t[0]
        i = int(np.argmin(values))
        if i in (0, t.size - 1):
            return None
        bend = values[i - 1] - 2.0 * values[i] + values[i + 1]
        best = t[i] + 0.5 * step * (values[i - 1] - values[i + 1]) / bend if bend > 0.0 else t[i]
        t = np.linspace(t[i] - step, t[i] + step, _FINE)
    return float(best), float(step)
