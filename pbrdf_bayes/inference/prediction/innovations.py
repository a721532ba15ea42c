"""What the filter predicts of each reading, and knows of the gains, at one parameter set."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.inference.likelihood.filtered import (
    Filtered,
    filter_state,
    noise_mixture,
    prepare_filtered,
)
from pbrdf_bayes.inference.likelihood.row_evidence import fill_cdf
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]


def filter_all(posterior: Posterior) -> Filtered | None:
    """The filter over every BRDF row, whatever likelihood the posterior takes; None without any."""
    p = posterior
    return prepare_filtered(p.measurement, p.rows, p.config, p.discrepancy, everything=True)


def standardised_innovations(posterior: Posterior, x: ArrayLike, rng: np.random.Generator) -> Array:
    """Probability integral transform of each BRDF reading given those before it in the filter.

    The probability of a reading as low as this, given the readings of its group that the filter
    took before. Where the parameters and the model are right these are independent and uniform
    (Rosenblatt, Ann. Math. Stat. 23, 470 (1952), doi:10.1214/aoms/1177729394), but for what the
    filter approximates. A censored reading could be anywhere below the limit: a uniform number
    times the probability of falling there (Smith, J. Forecasting 4, 283 (1985),
    doi:10.1002/for.3980040305).

    Parameters
    ----------
    posterior : Posterior
    x : array_like, shape (n_par,)
        Physical units.
    rng : numpy.random.Generator
        Places of censored readings.

    Returns
    -------
    ndarray, shape (n_brdf,)
        In (0, 1), in the order of the rows of the measurement.
    """
    filtered = filter_all(posterior)
    if filtered is None:
        return np.zeros(0)
    point = np.ascontiguousarray(x, dtype=np.float64)
    rows = posterior.rows
    given = posterior.given(point[None, :])
    state = filter_state(posterior.geometry, rows, filtered, point, posterior.digits, given)
    result = np.empty(rows.y.size)
    mixture = noise_mixture(posterior.config)
    fill_cdf(state.innovation, state.predicted, state.variance, mixture, result)
    result[rows.censored] *= rng.random(int(rows.censored.sum()))
    return np.clip(result, np.finfo(np.float64).tiny, np.nextafter(1.0, 0.0))


def draw_gains(
    posterior: Posterior, filtered: Filtered, x: Array, rng: np.random.Generator
) -> Array:
    """One draw of the calibration factor of each scan given all readings, shape (n_scans,).

    From the state of the filter behind the last reading of the group: a censored or Student-t
    reading counts as the normal one that it was matched with.
    """
    g, rows, given = posterior.geometry, posterior.rows, posterior.given(x[None, :])
    state = filter_state(g, rows, filtered, x, posterior.digits, given)
    scan, mean = filtered.sweep.scan, state.gain.copy()
    present = scan >= 0
    blocks = state.gain_cov[scan[:, :, None], scan[:, None, :]]
    values, vectors = np.linalg.eigh(blocks * (present[:, :, None] & present[:, None, :]))
    normal = np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(values.shape)
    mean[scan[present]] += np.einsum("gij,gj->gi", vectors, normal)[present]
    return np.asarray(np.exp(mean))
