"""The density of each reading given all the others, parameter set by parameter set.

Readings y of one measurement are jointly normal given the parameters, with residuals r and the
covariance K (gains and discrepancy marginalised). Given all other readings, reading i is normal
with

    mean_i = y_i - alpha_i / (K^-1)_ii,   var_i = 1 / (K^-1)_ii,   alpha = K^-1 r

(Sundararajan and Keerthi 2001, doi:10.1162/08997660151134343; Buerkner, Gabry and Vehtari 2020,
doi:10.1007/s00180-020-01045-4). Where gains are all that readings share, K is a diagonal plus a
rank-one matrix, and the same follows from the gain that the other readings leave.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.correlated import group_gradient
from pbrdf_bayes.inference.correlated_likelihood import divide_by_share
from pbrdf_bayes.inference.groups import set_variances, workspace
from pbrdf_bayes.inference.matern import MISSING
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.residuals import floored

Array = NDArray[np.float64]

_TINY = 1e-280


class Conditionals(NamedTuple):
    """Readings against their means given all others, both of shape (n_draws, n_readings).

    ``error`` is y_i - mean_i (of a censored reading: the floor minus it), ``variance`` var_i.
    """

    error: Array
    variance: Array


def brdf_conditionals(posterior: Posterior, draws: Array, brdf: Array) -> Conditionals:
    """Every BRDF reading given the others, in ln BRDF.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Physical units.
    brdf : ndarray, shape (n_draws, n_brdf)
        Model there [sr^-1], as `Posterior.predict` gives it.

    Returns
    -------
    Conditionals

    Notes
    -----
    Censored readings tell nothing to the others here. Beside a correlated discrepancy they have no
    conditional of their own either: NaN.
    """
    rows = posterior.rows
    log_f = np.log(np.maximum(brdf, _TINY))
    residual = rows.y - floored(log_f, rows.floor2)
    share = rows.floor2 / (brdf * brdf + rows.floor2) if rows.floor2 > 0.0 else 0.0 * brdf[:, :1]
    if posterior.discrepancy is not None:
        return _beside_discrepancy(posterior, draws, residual, brdf)
    error, variance = np.empty(residual.shape), np.empty(residual.shape)
    for scan, column in enumerate(rows.noise_column.tolist()):
        a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
        own = draws[:, [column]] ** 2 + rows.u2[a:b]
        own = own + (share[:, a:b] if rows.floor2 > 0.0 else share)
        error[:, a:b], variance[:, a:b] = _given_others(
            residual[:, a:b], own, np.ones(b - a), rows.u_cal2, rows.censored[a:b]
        )
    return Conditionals(error, variance)


def dhr_conditionals(posterior: Posterior, draws: Array, dhr: Array) -> Conditionals:
    """Every DHR reading given the others of its polarisation.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
    dhr : ndarray, shape (n_draws, n_dhr)
        Model there [1].

    Returns
    -------
    Conditionals
    """
    rows = posterior.rows
    own = np.broadcast_to(rows.dhr_u2, dhr.shape)
    if rows.dhr_noise_column >= 0:
        own = np.where(own < 0.0, draws[:, [rows.dhr_noise_column]] ** 2, own)
    error, variance = np.empty(dhr.shape), np.empty(dhr.shape)
    for group in np.unique(rows.dhr_group):
        of = rows.dhr_group == group
        error[:, of], variance[:, of] = _given_others(
            (rows.dhr - dhr)[:, of], own[:, of], dhr[:, of], rows.dhr_cal2, np.zeros(of.sum(), bool)
        )
    return Conditionals(error, variance)


def _given_others(
    residual: Array, own: Array, effect: Array, u2: float, censored: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Readings of variances ``own`` that share a gain N(0, u2) times ``effect``."""
    weight = np.where(censored, 0.0, 1.0 / own)
    squares, crosses = weight * effect * effect, weight * effect * residual
    others = squares.sum(axis=1, keepdims=True) - squares
    spread = u2 / (1.0 + u2 * np.maximum(others, 0.0))
    gain = spread * (crosses.sum(axis=1, keepdims=True) - crosses)
    return residual - gain * effect, own + spread * effect * effect


def _beside_discrepancy(
    posterior: Posterior, draws: Array, residual: Array, brdf: Array
) -> Conditionals:
    """From alpha and the diagonal of K^-1, as one backward pass of the filter gives them."""
    rows, law = posterior.rows, posterior.discrepancy
    assert law is not None
    work = workspace(law.groups, True)
    by_row = np.empty((4, rows.y.size))
    error, variance = np.empty(residual.shape), np.empty(residual.shape)
    left_out = np.where(rows.censored, MISSING, 0.0)
    for i, x in enumerate(draws):
        group_variance = x[law.noise_column] ** 2
        s2 = np.repeat(x[rows.noise_column] ** 2, np.diff(rows.scan_start))
        h, extra = divide_by_share(rows, law, s2, brdf[i])
        set_variances(law.groups, work, extra + left_out)
        group_gradient(
            law.groups, work, residual[i] / h, group_variance, rows.u_cal2,
            x[law.tau_column], x[law.ell_column], by_row,
        )  # fmt: skip
        alpha = by_row[0]
        precision = np.maximum(alpha * alpha - 2.0 * by_row[1], _TINY)
        error[i], variance[i] = h * alpha / precision, h * h / precision
    error[:, rows.censored] = variance[:, rows.censored] = np.nan
    return Conditionals(error, variance)
