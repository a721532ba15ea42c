"""Assumed-density filtering of scans with censored readings or Student-t noise.

The law is that of `pbrdf_bayes.inference.likelihood.correlated`, in state space as in
`inference.likelihood.matern`, with the gains c_j of a group's scans in the state beside the
discrepancy d and its scaled derivative d':

    x = (d, d', d_0, d_0', c_1 .. c_m),   y_a = mean_a + h_a'x + noise_a,   h_a'x = d + c_j(a)

At each reading h'x ~ N(mu, s). Where the noise is not normal, or a reading only known to lie at or
below the floor, the posterior of x is replaced by the normal law of the same mean and covariance:

    m <- m + P h L',   P <- P + P h h'P L''

with L = ln Z(mu, s) the evidence of the reading (`inference.likelihood.row_evidence`); the
log-likelihood is the sum of L. Kushner, IEEE Trans. Autom. Control 12, 546 (1967),
doi:10.1109/TAC.1967.1098671; Maybeck, Stochastic Models, Estimation and Control 2 (1982), ch. 12;
Minka, Expectation Propagation, UAI 2001, arXiv:1301.2294. It is exact for normal readings and
where a group has one other reading, and that the last.

What is lost depends on how well x is known when such a reading comes. The sweep therefore starts
within the longest run of readings that are not censored, goes on to the last angle, returns to its
start, whose state (d_0, d_0') it kept, and goes to the first: the Matérn process is the same
backwards in theta_r, d' changing sign.

The error of the log-likelihood, against exact sums, orthant probabilities and a particle filter
(``test_assumed_density.py``), tau 0.05 to 0.2, u_cal 0 to 10, white noise 2 %:

    5 of 33 readings at or below the floor, with the noise of the floor there   1e-6 nats
    12 of 33, likewise                                                          1e-3 nats
    5 of 33 with a noise of 2 % there, which no floor has                       0.35 nats
    Student-t noise of 4 degrees of freedom: 4 readings; a scan of 33           0.2; 0.4 nats

The posterior mean of an offset of such scans moves by less than 0.03 standard deviations. Beyond
it: a scan whose gain is free and whose readings near the start of the sweep are all outliers.

Each reading has become a normal one of precision 1/(-1/L'' - s) at mu - L'/L''. Sensitivities to
systematic errors go through the filter of these, whose innovations i_c of them give

    v_c = sum i_c L',   G_cd = -sum i_c i_d L''          (`inference.likelihood.systematic`).

Against the integral over an error as large as the noise (``test_observation_law.py``), 4 scans of
33: 1e-3 nats with censored readings; 0.05 with Student-t noise, 1.3 by a single pass.

The gradient is that of this recursion: `pbrdf_bayes.inference.likelihood.assumed_density_slopes`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.matern import fill_steps
from pbrdf_bayes.inference.likelihood.row_evidence import KEPT, LOG_Z, A, W, row_evidence
from pbrdf_bayes.inference.likelihood.sweeps import FIRST_GAIN, Sweep, Tape
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled()
def _begin(mean: Array, cov: Array, tau2: float, u_cal2: float) -> None:
    """State before the first reading: its angle is the one that is kept."""
    mean[:] = 0.0
    cov[:] = 0.0
    for i in range(mean.size):
        cov[i, i] = tau2 if i < FIRST_GAIN else u_cal2
    for i in range(2):
        cov[i, i + 2] = tau2
        cov[i + 2, i] = tau2


@compiled()
def _turn_mean(mean: Array) -> None:
    """The mean back at the state that was kept, to go the other way."""
    mean[0], mean[1] = mean[2], -mean[3]
    mean[2] = 0.0
    mean[3] = 0.0


@compiled()
def _turn(mean: Array, cov: Array) -> None:
    """Back to the state that was kept, to go the other way."""
    _turn_mean(mean)
    for _ in range(2):  # rows, then columns
        for j in range(mean.size):
            cov[0, j] = cov[2, j]
            cov[1, j] = -cov[3, j]
            cov[2, j] = 0.0
            cov[3, j] = 0.0
        transpose(cov)


@compiled()
def transpose(matrix: Array) -> None:
    """Transpose in place."""
    for i in range(matrix.shape[0]):
        for j in range(i):
            matrix[i, j], matrix[j, i] = matrix[j, i], matrix[i, j]


@compiled()
def _move_mean(mean: Array, steps: Array, t: int) -> None:
    """Prediction of the mean at the next point."""
    e, b = steps[0, t], steps[1, t]
    mean[0], mean[1] = (e + b) * mean[0] + b * mean[1], (e - b) * mean[1] - b * mean[0]


@compiled()
def _move(mean: Array, cov: Array, steps: Array, t: int, tau2: float) -> None:
    """Prediction of the next point."""
    e, b, q = steps[0, t], steps[1, t], steps[2, t]
    _move_mean(mean, steps, t)
    for _ in range(2):
        for j in range(mean.size):
            p0, p1 = cov[0, j], cov[1, j]
            cov[0, j] = (e + b) * p0 + b * p1
            cov[1, j] = (e - b) * p1 - b * p0
        transpose(cov)
    cov[0, 0] += q
    cov[0, 1] += 2.0 * tau2 * b * b
    cov[1, 0] += 2.0 * tau2 * b * b
    cov[1, 1] += q + 4.0 * tau2 * e * b


@compiled()
def predict_row(mean: Array, cov: Array, c: int, z: Array) -> tuple[float, float]:
    """Mean and variance of d + c_j; its covariance with the state goes into ``z``."""
    for j in range(mean.size):
        z[j] = cov[0, j] + cov[c, j]
    return mean[0] + mean[c], max(z[0] + z[c], 0.0)


@compiled()
def _update(mean: Array, cov: Array, c: int, z: Array, s: float, found: Array) -> None:
    """The normal law with the moments of the posterior.

    The row of d, or of the gain while that is the less known, follows from that of their sum, whose
    new covariances are the old times KEPT: differences would cancel where a reading tells much.
    """
    last = c if cov[c, c] > cov[0, 0] else 0
    other = c - last
    for i in range(mean.size):
        mean[i] += z[i] * found[A]
        for j in range(mean.size):
            if i != last and j != last:
                cov[i, j] -= found[W] * z[i] * z[j]
    for i in range(mean.size):
        if i != last:
            cov[i, last] = found[KEPT] * z[i] - cov[i, other]
            cov[last, i] = cov[i, last]
    cov[last, last] = found[KEPT] * (s - 2.0 * z[other]) + cov[other, other]


@compiled()
def _filter_errors(sweep: Sweep, g: int, t: int, tape: Tape, z: Array, found: Array) -> None:
    """Sensitivities through step ``t``; its part of v and of the lower triangle of G."""
    row, c, innovation = sweep.row[t], sweep.gain[t], tape.error_innovation
    for j in range(tape.v.size):
        mean = tape.error_mean[j]
        if t == sweep.start[g]:
            mean[:] = 0.0
        else:
            if t == sweep.turn[g]:
                _turn_mean(mean)
            _move_mean(mean, tape.steps, t)
        innovation[j] = tape.sensitivities[j, row] - mean[0] - mean[c]
        tape.v[j] += innovation[j] * found[A]
        for h in range(j + 1):
            tape.g[j, h] += innovation[j] * innovation[h] * found[W]
        for i in range(mean.size):
            mean[i] += z[i] * found[W] * innovation[j]


@compiled()
def sweep_group(
    sweep: Sweep, g: int, tape: Tape, residual: Array, variance: Array, censored: Flags,
    u_cal2: float, tau2: float, keep: bool, moments: Array,
) -> float:  # fmt: skip
    """Log-likelihood of a group; the state after it is left in the last used row of the tape."""
    z = tape.scratch[0]
    at = 0
    _begin(tape.mean[0], tape.cov[0], tau2, u_cal2)
    total = 0.0
    for t in range(sweep.start[g], sweep.start[g + 1]):
        if keep and t > sweep.start[g]:
            tape.mean[at + 1] = tape.mean[at]
            tape.cov[at + 1] = tape.cov[at]
            at += 1
        mean, cov, found = tape.mean[at], tape.cov[at], tape.found[at]
        if keep and t > sweep.start[g]:
            before, c = tape.found[at - 1], sweep.gain[t - 1]
            _, s = predict_row(mean, cov, c, z)
            _update(mean, cov, c, z, s, before)
        if t == sweep.turn[g]:
            _turn(mean, cov)
        if t > sweep.start[g]:
            if keep:
                tape.moved_mean[at] = mean
                tape.moved_cov[at] = cov
            _move(mean, cov, tape.steps, t, tau2)
        row, c = sweep.row[t], sweep.gain[t]
        mu, s = predict_row(mean, cov, c, z)
        e, v = residual[row] - mu, variance[row]
        row_evidence(e, s, v, censored[row], sweep.mixture, keep, tape.shares, found)
        total += found[LOG_Z]
        if moments.shape[1] > 0:
            moments[0, row] = e
            moments[1, row] = s
        if not keep:
            _filter_errors(sweep, g, t, tape, z, found)
            _update(mean, cov, c, z, s, found)
    return total


@compiled()
def sweep_log_likelihood(
    sweep: Sweep, tape: Tape, residual: Array, variance: Array, censored: Flags, u_cal2: float,
    tau: float, ell: float,
) -> float:  # fmt: skip
    """Log-likelihood of the rows of the groups that are swept.

    Parameters
    ----------
    sweep : Sweep
    tape : Tape
        From `make_tape`.
    residual : ndarray, shape (n_rows,)
        y minus its mean, of all rows of the measurement.
    variance : ndarray, shape (n_rows,)
        v of the noise of each row, positive.
    censored : ndarray of bool, shape (n_rows,)
    u_cal2 : float
        Variance of the gains.
    tau, ell : float
        Amplitude [1] and length [deg] of the discrepancy.

    Returns
    -------
    float
        Without the errors of ``tape.sensitivities``, whose v and G it then holds.
    """
    fill_steps(sweep.spacing, sweep.rough, tau, ell, tape.steps)
    tape.v[:] = 0.0
    tape.g[:] = 0.0
    total = 0.0
    nothing = np.empty((2, 0))
    for g in range(sweep.group.size):
        total += sweep_group(
            sweep, g, tape, residual, variance, censored, u_cal2, tau * tau, False, nothing
        )
    return total


@compiled()
def sweep_state(
    sweep: Sweep, tape: Tape, residual: Array, variance: Array, censored: Flags, u_cal2: float,
    tau: float, ell: float, moments: Array, gain: Array, gain_cov: Array,
) -> None:  # fmt: skip
    """What the filter predicts of every reading, and knows of the gains in the end.

    Parameters
    ----------
    sweep, tape, residual, variance, censored, u_cal2, tau, ell
        As for `sweep_log_likelihood`.
    moments : ndarray, shape (2, n_rows)
        Receives each reading minus its predicted mean, and the variance of the prediction without
        the noise of the reading.
    gain, gain_cov : ndarray, shapes (n_scans,) and (n_scans, n_scans)
        Receive the means and covariances of the logarithms of the gains.
    """
    fill_steps(sweep.spacing, sweep.rough, tau, ell, tape.steps)
    for g in range(sweep.group.size):
        sweep_group(sweep, g, tape, residual, variance, censored, u_cal2, tau * tau, False, moments)
        for i in range(sweep.scan.shape[1]):
            for j in range(sweep.scan.shape[1]):
                a, b = sweep.scan[g, i], sweep.scan[g, j]
                if a >= 0 and b >= 0:
                    gain[a] = tape.mean[0, FIRST_GAIN + i]
                    gain_cov[a, b] = tape.cov[0, FIRST_GAIN + i, FIRST_GAIN + j]
