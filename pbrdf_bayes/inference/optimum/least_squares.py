"""The least-squares optimum of the model: how well it can follow the curves, whatever the noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.residuals import (
    beside_gains,
    calibrated_residuals,
    log_residuals,
    row_weights,
)
from pbrdf_bayes.physics.brdf import evaluate_gradient
from pbrdf_bayes.readings.observation import reading_law

Array = NDArray[np.float64]


def fit_least_squares(posterior: Posterior, starts: Array) -> tuple[Array, float]:
    """Parameters of the model that minimise the rms of ln(measured/model) over the BRDF rows.

    The calibration factor of a scan is free within its uncertainty, and readings count as they
    stand clear of the floor, see `calibrated_residuals`; no noise model, no discrepancy.

    Parameters
    ----------
    posterior : Posterior
    starts : ndarray, shape (n_starts, n_par)
        Parameters to start from, physical units; the noises of the first one are kept.

    Returns
    -------
    tuple of ndarray (n_par,) and float
        Parameters and the rms [dex]; NaN without BRDF rows.
    """
    rows = posterior.rows
    if rows.censored.all():
        return starts[0], float("nan")
    columns = posterior.of_model
    low, high = (bound[columns] for bound in coordinate_bounds(posterior))
    weight = row_weights(posterior, starts[0])
    freedom = starts[0][rows.noise_column] / np.sqrt(max(rows.u_cal2, 1e-300))

    def at(z: Array) -> Array:
        full = posterior.to_coordinates(starts[:1])
        full[0, columns] = z
        return posterior.from_coordinates(full)

    def weighted(values: Array) -> Array:
        """Weighted rows beside the gains of their scans, then the gains in their uncertainty."""
        left, gains = beside_gains(posterior, starts[0], values, weight)
        return np.concatenate([(left.T * np.sqrt(weight)).T, (gains.T * freedom).T])

    def residuals(z: Array) -> Array:
        return weighted(log_residuals(posterior, posterior.predict(at(z))[0][0]))

    def jacobian(z: Array) -> Array:
        x = at(z)
        log_f, _, slopes, _ = evaluate_gradient(posterior.geometry, x, posterior.digits)
        moved = posterior.free[columns]
        scale = np.where(posterior.is_log[columns], x[0, moved], 1.0)
        share = reading_law(np.exp(log_f[0]), posterior.config.brdf_floor).share
        return weighted(-slopes[0][:, moved] * scale * share[:, None])

    best_z, best_cost = posterior.to_coordinates(starts)[0, columns], np.inf
    for start in posterior.to_coordinates(starts)[:, columns]:
        margin = 1e-6 * np.minimum(high - low, 1.0)
        fit = least_squares(
            residuals, np.clip(start, low + margin, high - margin),
            jacobian if posterior.scene is None else "3-point",
            bounds=(low, high), x_scale=np.full(columns.size, 0.1), max_nfev=200,
        )  # fmt: skip
        if fit.cost < best_cost:
            best_z, best_cost = fit.x, fit.cost
    best = at(best_z)[0]
    return best, calibrated_residuals(posterior, best).rms
