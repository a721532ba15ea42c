"""The density of each reading given all the others, parameter set by parameter set.

Readings y of one measurement are jointly normal given the parameters, with residuals r and the
covariance K (gains and discrepancy marginalised). Given all other readings, reading i is normal
with

    mean_i = y_i - alpha_i / (K^-1)_ii,   var_i = 1 / (K^-1)_ii,   alpha = K^-1 r

(Sundararajan and Keerthi 2001, doi:10.1162/08997660151134343; Buerkner, Gabry and Vehtari 2020,
doi:10.1007/s00180-020-01045-4). Where gains are all that readings share, K is a diagonal plus a
rank-one matrix, and the same follows from the gain that the other readings leave.

Student-t noise of scale v_j^(1/2) is normal noise of variance v_j/w_j, w_j ~ Gamma(nu/2, nu/2).
What the other readings say of gain and discrepancy is taken with their w_j at

    w_j = (nu + 1) / (nu + E[noise_j^2] / v_j),

the fixed point of the variational law that has w and the rest independent (Tipping and Lawrence
2005, doi:10.1016/j.neucom.2005.02.016); the noise of reading i itself stays Student's. Log
densities are right to some hundredths, those of readings twenty scales off to 0.15.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.groups import set_variances, workspace
from pbrdf_bayes.inference.likelihood.kalman import group_gradient
from pbrdf_bayes.inference.likelihood.matern import MISSING
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.residuals import law_of_rows, scan_of_rows
from pbrdf_bayes.readings.observation import Law

Array = NDArray[np.float64]

_TINY = 1e-280
_PASSES = 8
"""Until the weights of Student-t noise are found."""


class Conditionals(NamedTuple):
    """Readings against their means given all others, both of shape (n_draws, n_readings).

    ``error`` is y_i - mean_i (of a censored reading: the floor minus it), ``variance`` var_i, and
    ``student`` what of it is the square of a scale of Student-t noise; zero where all is normal.
    """

    error: Array
    variance: Array
    student: Array


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
    law = law_of_rows(posterior, draws, brdf)
    residual = rows.y - law.mean
    if posterior.discrepancy is not None:
        return _beside_discrepancy(posterior, draws, residual, law)
    dof = _student_dof(posterior)
    found = Conditionals(*(np.zeros(residual.shape) for _ in range(3)))
    for scan in posterior.measurement.scans:
        of = scan.rows
        found.error[:, of], found.variance[:, of] = _given_others(
            residual[:, of], law.variance[:, of], law.share[:, of], rows.u_cal2,
            rows.censored[of], dof,
        )  # fmt: skip
    if np.isfinite(dof):
        found.student[:] = law.variance
    return found


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
    return Conditionals(error, variance, np.zeros(dhr.shape))


def _student_dof(posterior: Posterior) -> float:
    """Degrees of freedom of the noise, infinite where it is normal."""
    config = posterior.config
    return config.student_dof if config.tails == "student-t" else np.inf


def _given_others(
    residual: Array, own: Array, effect: Array, u2: float, censored: NDArray[np.bool_],
    dof: float = np.inf,
) -> tuple[Array, Array]:  # fmt: skip
    """Readings of variances ``own`` that share a gain N(0, u2) times ``effect``."""
    known = np.where(censored, 0.0, 1.0 / own)
    squares, crosses = known * effect * effect, known * effect * residual
    for _ in range(_PASSES if np.isfinite(dof) and u2 > 0.0 else 0):
        spread = u2 / (1.0 + u2 * squares.sum(axis=1, keepdims=True))
        left = residual - effect * spread * crosses.sum(axis=1, keepdims=True)
        weight = known * _student_weight(left * left + effect * effect * spread, own, dof)
        squares, crosses = weight * effect * effect, weight * effect * residual
    others = squares.sum(axis=1, keepdims=True) - squares
    spread = u2 / (1.0 + u2 * np.maximum(others, 0.0))
    gain = spread * (crosses.sum(axis=1, keepdims=True) - crosses)
    return residual - gain * effect, own + spread * effect * effect


def _student_weight(noise2: Array, own: Array, dof: float) -> Array:
    """Expected w of noise whose expected square is ``noise2``."""
    return (dof + 1.0) / (dof + noise2 / own)


def _beside_discrepancy(
    posterior: Posterior, draws: Array, residual: Array, readings: Law
) -> Conditionals:
    """From alpha and the diagonal of K^-1, as a backward pass of the filter gives them."""
    rows, law = posterior.rows, posterior.discrepancy
    assert law is not None
    work = workspace(law.groups, True)
    by_row = np.empty((4, rows.y.size))
    dof, scan = _student_dof(posterior), scan_of_rows(posterior)
    found = Conditionals(*(np.zeros(residual.shape) for _ in range(3)))
    left_out = np.where(rows.censored, MISSING, 0.0)
    for i, x in enumerate(draws):
        group_variance = x[law.noise_column] ** 2
        s2, h = x[rows.noise_column][scan] ** 2, readings.share[i]
        own, weight = readings.variance[i] / (h * h), np.ones(s2.size)
        for _ in range(_PASSES if np.isfinite(dof) else 1):
            noise = own / weight
            set_variances(law.groups, work, noise - s2 + left_out)
            group_gradient(
                law.groups, work, residual[i] / h, group_variance, rows.u_cal2,
                x[law.tau_column], x[law.ell_column], by_row,
            )  # fmt: skip
            alpha = by_row[0]
            precision = np.maximum(alpha * alpha - 2.0 * by_row[1], _TINY)
            noise2 = noise + noise * noise * (alpha * alpha - precision)
            weight = _student_weight(noise2, own, dof) if np.isfinite(dof) else weight
        found.error[i] = h * alpha / precision
        found.variance[i] = h * h * (1.0 / precision - noise + own)
        found.student[i] = h * h * own if np.isfinite(dof) else 0.0
    found.error[:, rows.censored] = found.variance[:, rows.censored] = np.nan
    return found
