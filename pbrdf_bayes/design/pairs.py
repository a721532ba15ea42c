"""Log-likelihood of many simulated scans under many parameter sets.

For set m the reading at the row a of scan j is

    y_a = mean_ma + h_ma (c_j + d(theta_a)) + N(0, v_ma),   c_j ~ N(0, u_cal^2),

d the Matérn process of `inference.likelihood.matern` with amplitude tau_m and length ell_m. The
gains of the Kalman filter depend on the set alone: they are computed once and serve all simulated
scans, whose innovations run side by side. Gains c of the scans are integrated out by their
regression on the innovations of their indicators.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LN_2PI = float(np.log(2.0 * np.pi))


@compiled()
def _filter_gains(
    gap: Array, scan: Index, share: Array, variance: Array, tau: float, ell: float, rough: bool,
    u_cal2: float, steps: Array, regressors: Array, information: Array,
) -> float:  # fmt: skip
    """Fill what the filter of one set needs for any readings; returns the log-determinant.

    ``steps`` (7, n_rows): transition (4), gain (2), 1/S. ``regressors`` (n_scans, n_rows): the
    innovations of the indicators. ``information`` (n_scans, n_scans): I + u^2 B' K^-1 B.
    """
    n_rows, n_scans = gap.size, regressors.shape[0]
    p00 = p11 = tau * tau
    p01 = 0.0
    log_det = 0.0
    state = np.zeros((n_scans, 2))
    information[:, :] = 0.0
    for a in range(n_rows):
        f00, f01, f10, f11 = 1.0, 0.0, 0.0, 1.0
        if gap[a] > 0.0:
            r = gap[a] / ell if rough else np.sqrt(3.0) * gap[a] / ell
            e = np.exp(-r)
            b = 0.0 if rough else r * e
            f00, f01, f10, f11 = e + b, b, -b, e - b
            s00 = f00 * p00 + f01 * p01
            s01 = f00 * p01 + f01 * p11
            s10 = f10 * p00 + f11 * p01
            s11 = f10 * p01 + f11 * p11
            away00 = 1.0 - (f00 * f00 + f01 * f01)
            away01 = -(f00 * f10 + f01 * f11)
            away11 = 1.0 - (f10 * f10 + f11 * f11)
            p00 = s00 * f00 + s01 * f01 + tau * tau * away00
            p01 = s00 * f10 + s01 * f11 + tau * tau * away01
            p11 = s10 * f10 + s11 * f11 + tau * tau * away11
        h = share[a]
        s = p00 + variance[a] / (h * h)
        k0, k1 = p00 / s, p01 / s
        steps[0, a], steps[1, a], steps[2, a], steps[3, a] = f00, f01, f10, f11
        steps[4, a], steps[5, a], steps[6, a] = k0, k1, 1.0 / s
        log_det += _LN_2PI + np.log(s) + 2.0 * np.log(h)
        for j in range(n_scans):
            m0 = f00 * state[j, 0] + f01 * state[j, 1]
            m1 = f10 * state[j, 0] + f11 * state[j, 1]
            innovation = (1.0 if scan[a] == j else 0.0) - m0
            state[j, 0], state[j, 1] = m0 + k0 * innovation, m1 + k1 * innovation
            regressors[j, a] = innovation
        for j in range(n_scans):
            for i in range(n_scans):
                information[j, i] += u_cal2 * regressors[j, a] * regressors[i, a] / s
        p11 -= k1 * p01
        p01 -= k1 * p00
        p00 -= k0 * p00
    for j in range(n_scans):
        information[j, j] += 1.0
    return log_det


@compiled()
def _factorise(matrix: Array) -> float:
    """Cholesky factor in place (lower); returns the log-determinant."""
    log_det = 0.0
    for j in range(matrix.shape[0]):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        matrix[j, j] = np.sqrt(matrix[j, j])
        log_det += 2.0 * np.log(matrix[j, j])
        for i in range(j + 1, matrix.shape[0]):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    return log_det


@compiled(nogil=True)
def pair_log_likelihoods(
    y: Array, theta_r: Array, scan: Index, mean: Array, share: Array, variance: Array, tau: Array,
    ell: Array, rough: bool, u_cal2: float,
) -> Array:  # fmt: skip
    """Log-density of every simulated set of readings under every parameter set.

    Parameters
    ----------
    y : ndarray, shape (n_rows, n_simulated)
        ln of the readings, rows in the order of ``theta_r``.
    theta_r : ndarray, shape (n_rows,)
        Not falling [deg].
    scan : ndarray of int, shape (n_rows,)
        Which gain a row has, from 0 on.
    mean, share, variance : ndarray, shape (n_sets, n_rows)
        Mean of ln of a reading, h of `readings.observation`, white variance.
    tau, ell : ndarray, shape (n_sets,)
        Discrepancy: amplitude [1], length [deg].
    rough : bool
        Matérn 1/2 instead of 3/2.
    u_cal2 : float
        Variance of a gain.

    Returns
    -------
    ndarray, shape (n_simulated, n_sets)
    """
    n_rows, n_simulated = y.shape
    n_scans = scan.max() + 1 if u_cal2 > 0.0 and n_rows > 0 else 0
    result = np.empty((n_simulated, mean.shape[0]))
    gap = np.zeros(n_rows)
    for a in range(1, n_rows):
        gap[a] = theta_r[a] - theta_r[a - 1]
    steps = np.empty((7, n_rows))
    regressors = np.empty((n_scans, n_rows))
    information = np.empty((n_scans, n_scans))
    first, second = np.empty(n_simulated), np.empty(n_simulated)
    chi2, left = np.empty(n_simulated), np.empty(n_simulated)
    cross = np.empty((n_scans, n_simulated))
    for m in range(mean.shape[0]):
        log_det = _filter_gains(
            gap, scan, share[m], variance[m], tau[m], ell[m], rough, u_cal2, steps, regressors,
            information,
        )  # fmt: skip
        log_det += _factorise(information)
        first[:], second[:], chi2[:] = 0.0, 0.0, 0.0
        cross[:, :] = 0.0
        for a in range(n_rows):
            f00, f01, f10, f11 = steps[0, a], steps[1, a], steps[2, a], steps[3, a]
            k0, k1, precision = steps[4, a], steps[5, a], steps[6, a]
            centre, scale = mean[m, a], 1.0 / share[m, a]
            row = y[a]
            for i in range(n_simulated):
                m0 = f00 * first[i] + f01 * second[i]
                m1 = f10 * first[i] + f11 * second[i]
                innovation = (row[i] - centre) * scale - m0
                chi2[i] += innovation * innovation * precision
                first[i] = m0 + k0 * innovation
                second[i] = m1 + k1 * innovation
                left[i] = innovation
            for j in range(n_scans):
                weight = regressors[j, a] * precision
                for i in range(n_simulated):
                    cross[j, i] += weight * left[i]
        for i in range(n_simulated):
            explained = 0.0
            for j in range(n_scans):
                value = cross[j, i]
                for k in range(j):
                    value -= information[j, k] * cross[k, i]
                cross[j, i] = value / information[j, j]
                explained += cross[j, i] * cross[j, i]
            result[i, m] = -0.5 * (chi2[i] - u_cal2 * explained + log_det)
    return result


@compiled(nogil=True)
def matched_log_likelihoods(
    y: Array, theta_r: Array, scan: Index, mean: Array, share: Array, variance: Array, tau: Array,
    ell: Array, rough: bool, u_cal2: float,
) -> Array:  # fmt: skip
    """Log-density of every simulated set of readings under parameter sets of its own.

    As `pair_log_likelihoods`, but the n_sets = n_simulated * n_own sets belong to the simulated
    readings one after the other.

    Returns
    -------
    ndarray, shape (n_simulated, n_own)
    """
    n_simulated = y.shape[1]
    n_own = mean.shape[0] // n_simulated
    result = np.empty((n_simulated, n_own))
    for i in range(n_simulated):
        a, b = i * n_own, (i + 1) * n_own
        found = pair_log_likelihoods(
            y[:, i : i + 1].copy(), theta_r, scan, mean[a:b], share[a:b], variance[a:b], tau[a:b],
            ell[a:b], rough, u_cal2,
        )  # fmt: skip
        result[i] = found[0]
    return result
