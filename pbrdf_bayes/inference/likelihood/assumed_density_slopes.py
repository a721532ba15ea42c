"""Slopes of the assumed-density filter's log-likelihood: its recursion backwards.

With a bar for the slope of the log-likelihood by a quantity, the adjoint of an update at a reading
with h'x ~ N(mu, s), z = P h, a = L', w = -L'' is

    a_bar = z'm_bar,  w_bar = -z'P_bar z,  z_bar = a m_bar - 2 w P_bar z,
    mu_bar = a - w a_bar + w_mu w_bar,  s_bar = L_s + a_s a_bar + w_s w_bar,
    m_bar <- m_bar + mu_bar h,  P_bar <- P_bar + s_bar h h' + (z_bar h' + h z_bar')/2

and that of a prediction m = Phi m0, P = Phi P0 Phi' + Q is m_bar <- Phi'm_bar,
P_bar <- Phi'P_bar Phi, with the slopes m_bar m0' + 2 P_bar Phi P0 by Phi and P_bar by Q. mu_bar and
v_bar are the slopes by the mean and by the variance of the reading. Griewank and Walther,
Evaluating Derivatives, SIAM 2008, doi:10.1137/1.9780898717761.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.assumed_density import predict_row, sweep_group, transpose
from pbrdf_bayes.inference.likelihood.matern import fill_steps
from pbrdf_bayes.inference.likelihood.row_evidence import (
    A_S,
    A_V,
    LOG_Z_S,
    LOG_Z_V,
    W_MU,
    W_S,
    W_V,
    A,
    W,
)
from pbrdf_bayes.inference.likelihood.sweeps import Sweep, Tape
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled()
def _pull_update(
    mean_bar: Array, cov_bar: Array, tape: Tape, at: int, c: int
) -> tuple[float, float]:
    """Adjoint of a reading; returns the slopes by its mean and by its variance."""
    found, z, n = tape.found[at], tape.scratch[0], mean_bar.size
    pulled, z_bar = tape.scratch[1], tape.scratch[2]
    predict_row(tape.mean[at], tape.cov[at], c, z)
    a_bar, w_bar = 0.0, 0.0
    for i in range(n):
        pulled[i] = 0.0
        for j in range(n):
            pulled[i] += cov_bar[i, j] * z[j]
        a_bar += z[i] * mean_bar[i]
        w_bar -= z[i] * pulled[i]
    for i in range(n):
        z_bar[i] = found[A] * mean_bar[i] - 2.0 * found[W] * pulled[i]
    by_mu = found[A] - a_bar * found[W] + w_bar * found[W_MU]
    by_s = found[LOG_Z_S] + a_bar * found[A_S] + w_bar * found[W_S]
    by_v = found[LOG_Z_V] + a_bar * found[A_V] + w_bar * found[W_V]
    for h in (0, c):
        mean_bar[h] += by_mu
        for i in range(n):
            cov_bar[h, i] += 0.5 * z_bar[i]
            cov_bar[i, h] += 0.5 * z_bar[i]
        cov_bar[h, 0] += by_s
        cov_bar[h, c] += by_s
    return by_mu, by_v


@compiled()
def _pull_move(
    mean_bar: Array, cov_bar: Array, mean: Array, cov: Array, steps: Array, t: int, tau2: float,
    work: Array,
) -> tuple[float, float]:  # fmt: skip
    """Adjoint of a prediction from the state (mean, cov); returns the slopes by ln tau and ell."""
    e, b, q = steps[0, t], steps[1, t], steps[2, t]
    e_ell, b_ell, q_ell = steps[3, t], steps[4, t], steps[5, t]
    by_phi = work[:2]
    for i in range(2):
        for j in range(2):
            m0, m1 = (e + b) * cov[0, j] + b * cov[1, j], (e - b) * cov[1, j] - b * cov[0, j]
            total = cov_bar[i, 0] * m0 + cov_bar[i, 1] * m1
            for k in range(2, mean.size):
                total += cov_bar[i, k] * cov[k, j]
            by_phi[i, j] = 2.0 * total + mean_bar[i] * mean[j]
    b00, b01, b11 = cov_bar[0, 0], cov_bar[0, 1], cov_bar[1, 1]
    by_ell = by_phi[0, 0] * (e_ell + b_ell) + by_phi[1, 1] * (e_ell - b_ell)
    by_ell += (by_phi[0, 1] - by_phi[1, 0]) * b_ell
    by_ell += b00 * q_ell + 8.0 * tau2 * b01 * b * b_ell
    by_ell += b11 * (q_ell + 4.0 * tau2 * (e_ell * b + e * b_ell))
    by_tau = 2.0 * (b00 * q + 4.0 * tau2 * b01 * b * b + b11 * (q + 4.0 * tau2 * e * b))
    mean_bar[0], mean_bar[1] = (
        (e + b) * mean_bar[0] - b * mean_bar[1],
        b * mean_bar[0] + (e - b) * mean_bar[1],
    )
    for _ in range(2):
        for j in range(mean.size):
            p0, p1 = cov_bar[0, j], cov_bar[1, j]
            cov_bar[0, j] = (e + b) * p0 - b * p1
            cov_bar[1, j] = b * p0 + (e - b) * p1
        transpose(cov_bar)
    return by_tau, by_ell


@compiled()
def _pull_turn(mean_bar: Array, cov_bar: Array) -> None:
    """Adjoint of `_turn`."""
    mean_bar[2], mean_bar[3] = mean_bar[0], -mean_bar[1]
    mean_bar[:2] = 0.0
    for _ in range(2):
        for j in range(mean_bar.size):
            cov_bar[2, j] = cov_bar[0, j]
            cov_bar[3, j] = -cov_bar[1, j]
            cov_bar[0, j] = 0.0
            cov_bar[1, j] = 0.0
        transpose(cov_bar)


@compiled()
def sweep_gradient(
    sweep: Sweep, tape: Tape, residual: Array, variance: Array, censored: Flags, u_cal2: float,
    tau: float, ell: float, out: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Log-likelihood of the rows of the groups that are swept, and its slopes by tau and ell.

    Parameters
    ----------
    sweep, residual, variance, censored, u_cal2, tau, ell
        As for `sweep_log_likelihood`.
    tape : Tape
        From `make_tape` with slopes.
    out : ndarray, shape (>= 2, n_rows)
        Receives the slopes by the mean and by the variance of every row that is swept.

    Returns
    -------
    tuple of float
    """
    fill_steps(sweep.spacing, sweep.rough, tau, ell, tape.steps)
    mean_bar, cov_bar, tau2 = tape.mean_bar, tape.cov_bar, tau * tau
    nothing = np.empty((2, 0))
    total, by_log_tau, by_ell = 0.0, 0.0, 0.0
    for g in range(sweep.group.size):
        total += sweep_group(
            sweep, g, tape, residual, variance, censored, u_cal2, tau2, True, nothing
        )
        mean_bar[:] = 0.0
        cov_bar[:] = 0.0
        for t in range(sweep.start[g + 1] - 1, sweep.start[g] - 1, -1):
            at, row = t - sweep.start[g], sweep.row[t]
            out[0, row], out[1, row] = _pull_update(mean_bar, cov_bar, tape, at, sweep.gain[t])
            if at:
                by_step = _pull_move(
                    mean_bar, cov_bar, tape.moved_mean[at], tape.moved_cov[at], tape.steps, t,
                    tau2, tape.scratch,
                )  # fmt: skip
                by_log_tau += by_step[0]
                by_ell += by_step[1]
            if t == sweep.turn[g]:
                _pull_turn(mean_bar, cov_bar)
        for i in range(2):
            by_log_tau += 2.0 * tau2 * (cov_bar[i, i] + cov_bar[i + 2, i + 2])
            by_log_tau += 4.0 * tau2 * cov_bar[i, i + 2]
    return total, by_log_tau / tau if tau > 0.0 else 0.0, by_ell
