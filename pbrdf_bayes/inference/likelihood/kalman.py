"""The likelihood of log-BRDF residuals whose misfit is correlated along theta_r.

For the rows a of scan j(a) in group g(a), the scans of one angle of incidence, plane and
polarisation:

    r_a = y_a - mean_a = c_j + d_g(theta_r,a) + noise_a,
    c_j ~ N(0, u_cal^2),  noise_a ~ N(0, v_a),  d_g a Matérn process of amplitude tau, length ell

Repeats of a geometry share d_g. The covariance K of a group is that of the process and the noise,
K_0, plus u_cal^2 B B' with B the indicators of its scans. With A = B' K_0^-1 B and b = B' K_0^-1 r

    ln det K = ln det K_0 + ln det(I + u_cal^2 A),   r' K^-1 r = r' K_0^-1 r - b' M b,
    M = u_cal^2 (I + u_cal^2 A)^-1

are exact for any u_cal, and all of it comes from one Kalman filter of r and of B: see
`inference.likelihood.matern`. The cost is linear in the number of rows. Slopes follow from

    alpha = K^-1 r,   d ln L / d mean_a = alpha_a,   d ln L / d v_a = (alpha_a^2 - (K^-1)_aa) / 2.

Sensitivities to systematic errors go through the filter like the indicators, but are shared by all
groups: see `inference.likelihood.systematic`.
"""

from __future__ import annotations

from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood import matern
from pbrdf_bayes.inference.likelihood.groups import Groups, Work
from pbrdf_bayes.inference.likelihood.matern import LANES, MISSING
from pbrdf_bayes.inference.likelihood.systematic import marginalise, rotate
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

_LN_2PI = log(2.0 * pi)
_LOW, _HIGH = 1e-100, 1e100


@compiled()
def _begin(groups: Groups, block: int, work: Work, group_variance: Array, tau2: float) -> None:
    """State before the first reading; the determinant is counted in units of the first variance."""
    state, first = work.state, groups.start[block]
    state[:] = 0.0
    work.sequences[:] = 0.0
    work.products[:] = 0.0
    for lane in range(LANES):
        group = groups.group[block, lane]
        v = group_variance[group] if group >= 0 else 0.0
        extra = work.points[first, matern.EXTRA + lane]
        state[matern.P00 + lane] = tau2
        state[matern.P11 + lane] = tau2
        state[matern.BASE + lane] = v
        v += extra if extra < MISSING else 0.0
        state[matern.SCALE + lane] = 1.0 / v if v > 0.0 else 1.0
        state[matern.DET + lane] = 1.0


@compiled()
def _take_logarithm(groups: Groups, block: int, state: Array) -> float:
    """Logarithm of the determinants gathered so far, which start again at 1."""
    total = 0.0
    for lane in range(LANES):
        if groups.group[block, lane] >= 0:
            total += log(state[matern.DET + lane])
        state[matern.DET + lane] = 1.0
    return total


@compiled(inline=True)
def _is_extreme(state: Array, lanes: int) -> bool:
    """A product of determinants may soon leave the range of the numbers."""
    extreme = 0
    for i in range(min(lanes, LANES)):
        det = state[matern.DET + i]
        extreme += (det < _LOW) | (det > _HIGH)
    return extreme > 0


@compiled(inline=True)
def _keep_before(state: Array, sequences: Array, covariance: Array, means: Array, t: int) -> None:
    """What the smoother needs of a point, before its reading."""
    mean, mean_c = means[0, t], means[1, t]
    for i in range(3 * LANES):
        covariance[matern.T_P00 + i] = state[matern.P00 + i]
    for i in range(2 * LANES):
        mean[i] = state[matern.R0 + i]
        mean_c[i] = state[matern.C0 + i]
    for j in range(sequences.shape[0]):
        for i in range(2 * LANES):
            means[2 + j, t, i] = sequences[j, i]


@compiled(inline=True)
def _keep_after(state: Array, sequences: Array, covariance: Array, means: Array, t: int) -> None:
    """What the smoother needs of a point, after its reading."""
    for i in range(3 * LANES):
        covariance[matern.T_K0 + i] = state[matern.K0 + i]
    for i in range(LANES):
        means[0, t, matern.INNOVATION + i] = state[matern.R + i]
        means[1, t, matern.INNOVATION + i] = state[matern.C + i]
    for j in range(sequences.shape[0]):
        for i in range(LANES):
            means[2 + j, t, matern.INNOVATION + i] = sequences[j, matern.INNOVATION + i]


@compiled(inline=True)
def _add_products(state: Array, sequences: Array, products: Array, lanes: int) -> None:
    """Products of the innovations of different scans over S."""
    for j in range(sequences.shape[0]):
        for i in range(min(lanes, LANES)):
            weighted = state[matern.W + i] * sequences[j, matern.INNOVATION + i]
            products[0, 1 + j, i] += weighted * state[matern.C + i]
            for h in range(j):
                products[1 + h, 1 + j, i] += weighted * sequences[h, matern.INNOVATION + i]


@compiled(reassociate=True)
def _filter_block(groups: Groups, block: int, work: Work, tau2: float, keep: bool) -> float:
    """Filter residuals and indicators of a block; the logarithm of the determinants taken out."""
    state, sequences, lanes = work.state, work.sequences, groups.lanes[block]
    start, uniform = groups.start[block], not work.varied[block]
    others = work.gain.shape[0] - 1
    settled = False
    log_det = 0.0
    for k in range(start, groups.start[block + 1]):
        reading, point = work.readings[k], work.points[k]
        t = k - start if keep else 0
        if keep:
            _keep_before(state, sequences, work.covariances[t], work.means, t)
        if settled and groups.repeats[k]:
            matern.filter_settled_point(state, reading, point, lanes)
        else:
            move = work.moves[groups.transition[k]]
            moving = matern.filter_point(state, reading, point, move, lanes, tau2)
            settled = uniform and moving == 0
        for j in range(others):
            indicator = point[matern.ONES + LANES * (1 + j) :]
            matern.filter_sequence(sequences[j], state, indicator, lanes)
        for j in range(others, sequences.shape[0]):
            sensitivity = work.sensitivities[k, LANES * (j - others) :]
            matern.filter_sequence(sequences[j], state, sensitivity, lanes)
        if sequences.shape[0] > 0:
            _add_products(state, sequences, work.products, lanes)
        if keep:
            _keep_after(state, sequences, work.covariances[t], work.means, t)
        if k % 8 == 7 and _is_extreme(state, lanes):
            log_det += _take_logarithm(groups, block, state)
    return log_det + _take_logarithm(groups, block, state)


@compiled(reassociate=True)
def _filter_lone_scans(
    groups: Groups, block: int, state: Array, readings: Array, points: Array, moves: Array,
    transition: Index, repeats: Flags, uniform: bool, tau2: float,
) -> float:  # fmt: skip
    """The same where no group has more than one scan and no point is kept: the common case."""
    lanes = groups.lanes[block]
    settled = False
    log_det = 0.0
    for k in range(groups.start[block], groups.start[block + 1]):
        if settled and repeats[k]:
            matern.filter_settled_point(state, readings[k], points[k], lanes)
        else:
            move = moves[transition[k]]
            moving = matern.filter_point(state, readings[k], points[k], move, lanes, tau2)
            settled = uniform and moving == 0
        if k % 8 == 7 and _is_extreme(state, lanes):
            log_det += _take_logarithm(groups, block, state)
    return log_det + _take_logarithm(groups, block, state)


@compiled()
def _marginalise_gains(work: Work, lane: int, u_cal2: float) -> tuple[float, float]:
    """Logarithm of det(I + u_cal^2 A), and b' M b of a group.

    Minus the posterior means of the gains, -M b, go into ``gain`` and an upper triangle whose
    square is M into ``root``.
    """
    a, b, root, n = work.products, work.gain, work.root, work.gain.shape[0]
    a[0, 0, lane] = work.state[matern.CC + lane]
    b[0, lane] = work.state[matern.RC + lane]
    for j in range(1, n):
        a[j, j, lane] = work.sequences[j - 1, matern.SQUARE + lane]
        b[j, lane] = work.sequences[j - 1, matern.CROSS + lane]
    log_det = 0.0
    chi2 = 0.0
    lower = work.precision
    for j in range(n):  # Cholesky, and the inverse of its triangle row by row
        for i in range(j + 1):
            total = u_cal2 * a[i, j, lane] + (1.0 if i == j else 0.0)
            for h in range(i):
                total -= lower[i, h] * lower[j, h]
            lower[j, i] = sqrt(total) if i == j else total / lower[i, i]
        log_det += 2.0 * log(lower[j, j])
        root[j, j, lane] = sqrt(u_cal2) / lower[j, j]
        for i in range(j):
            total = 0.0
            for h in range(i, j):
                total -= lower[j, h] * root[i, h, lane]
            root[i, j, lane] = total / lower[j, j]
        whitened = 0.0
        for i in range(j + 1):
            whitened += root[i, j, lane] * b[i, lane]
        chi2 += whitened * whitened
    for i in range(n):
        lower[0, i] = b[i, lane]
        b[i, lane] = 0.0
    for j in range(n):
        whitened = 0.0
        for i in range(j + 1):
            whitened += root[i, j, lane] * lower[0, i]
        for i in range(j + 1):
            b[i, lane] -= root[i, j, lane] * whitened
    return log_det, chi2


@compiled()
def _add_errors(work: Work, lane: int) -> None:
    """Add a group's part of v and G, its gains marginalised; minus their means go to error_gain."""
    n, v, g, whitened = work.gain.shape[0], work.v, work.g, work.error_gain
    for m in range(v.size):
        products, sequence = work.products[:, n + m], work.sequences[n - 1 + m]
        v[m] += sequence[matern.CROSS + lane]
        for i in range(n):
            v[m] += work.gain[i, lane] * products[i, lane]
        for j in range(n):
            total = 0.0
            for i in range(j + 1):
                total += work.root[i, j, lane] * products[i, lane]
            whitened[m, j, lane] = total
        for h in range(m + 1):
            g[m, h] += sequence[matern.SQUARE + lane] if h == m else products[n + h, lane]
            for j in range(n):
                g[m, h] -= whitened[m, j, lane] * whitened[h, j, lane]
    for m in range(v.size):
        for i in range(n):
            total = 0.0
            for j in range(i, n):
                total -= work.root[i, j, lane] * whitened[m, j, lane]
            whitened[m, i, lane] = total


@compiled()
def _block_value(
    groups: Groups, block: int, work: Work, group_variance: Array, u_cal2: float, tau2: float,
    keep: bool,
) -> float:  # fmt: skip
    """Log-likelihood of the groups of a block, its readings in place."""
    _begin(groups, block, work, group_variance, tau2)
    if keep or work.sequences.shape[0] > 0:
        total = _filter_block(groups, block, work, tau2, keep)
    else:
        total = _filter_lone_scans(
            groups, block, work.state, work.readings, work.points, work.moves, groups.transition,
            groups.repeats, not work.varied[block], tau2,
        )  # fmt: skip
    for lane in range(LANES):
        group = groups.group[block, lane]
        if group >= 0:
            log_det, gained = _marginalise_gains(work, lane, u_cal2)
            n = groups.size[group]
            total += n * (_LN_2PI - log(work.state[matern.SCALE + lane])) + log_det
            total += work.state[matern.RR + lane] - gained
            _add_errors(work, lane)
    return -0.5 * total


@compiled()
def _fill(groups: Groups, work: Work, residual: Array, tau: float, ell: float) -> None:
    """Readings into their points, and the transitions."""
    readings = work.readings.reshape(-1)
    for i in range(residual.size):
        readings[groups.slot[i]] = residual[i]
    matern.fill_steps(groups.spacing, groups.rough, tau, ell, work.steps)
    matern.fill_transitions(work.steps, groups.step, groups.shared, work.moves)


@compiled()
def group_log_likelihood(
    groups: Groups, work: Work, residual: Array, group_variance: Array, u_cal2: float, tau: float,
    ell: float,
) -> float:  # fmt: skip
    """Log-likelihood of the rows of all groups.

    Parameters
    ----------
    groups : Groups
    work : Work
        From `workspace`; variances of single rows have been put there by `set_variances`.
    residual : ndarray, shape (n_rows,)
        y minus its mean.
    group_variance : ndarray, shape (n_groups,)
        s_rel^2 of the rows of each group.
    u_cal2 : float
        Variance of the gains of the scans, 0 to 1e12.
    tau, ell : float
        Amplitude [1] and length [deg] of the discrepancy.

    Returns
    -------
    float
        Without the errors of `set_errors`; ``work`` then holds their v and G.
    """
    _fill(groups, work, residual, tau, ell)
    work.v[:] = 0.0
    work.g[:] = 0.0
    total = 0.0
    for block in range(groups.lanes.size):
        total += _block_value(groups, block, work, group_variance, u_cal2, tau * tau, False)
    return total


@compiled(inline=True)
def _add_multiple(to: Array, factor: Array, of: Array) -> None:
    """Add a multiple of a filtered point to another, by lane."""
    for i in range(LANES):
        to[matern.M0 + i] += factor[i] * of[matern.M0 + i]
        to[matern.M1 + i] += factor[i] * of[matern.M1 + i]
        to[matern.INNOVATION + i] += factor[i] * of[matern.INNOVATION + i]


@compiled(inline=True)
def _multiply(mean: Array, factor: Array) -> None:
    """Multiply a filtered point, by lane."""
    for i in range(LANES):
        mean[matern.M0 + i] *= factor[i]
        mean[matern.M1 + i] *= factor[i]
        mean[matern.INNOVATION + i] *= factor[i]


@compiled(reassociate=True)
def _mix(means: Array, gain: Array, error_gain: Array, root: Array, n_points: int) -> None:
    """Take the gains out of residuals and sensitivities; rotate the indicators to unit variance."""
    n = gain.shape[0]
    for t in range(n_points):
        for j in range(n - 1, -1, -1):
            _add_multiple(means[0, t], gain[j], means[1 + j, t])
            for m in range(error_gain.shape[0]):
                _add_multiple(means[1 + n + m, t], error_gain[m, j], means[1 + j, t])
            _multiply(means[1 + j, t], root[j, j])
            for h in range(j):
                _add_multiple(means[1 + j, t], root[h, j], means[1 + h, t])


@compiled(reassociate=True)
def _smooth_block(groups: Groups, block: int, work: Work, tau2: float, out: Array) -> None:
    """Backward pass over a block."""
    state, rho, lanes = work.smoother, work.rho, groups.lanes[block]
    start, stop = groups.start[block], groups.start[block + 1]
    base = work.state[matern.BASE : matern.BASE + LANES]
    state[:] = 0.0
    rho[:] = 0.0
    for k in range(stop - 1, start - 1, -1):
        t = k - start
        move = work.moves[groups.transition[k]]
        matern.smooth_covariance(
            state, work.covariances[t], work.points[k], base, move, lanes, tau2
        )
        for j in range(rho.shape[0]):
            matern.smooth_sequence(rho[j], state, work.means[j, t], lanes)
        for lane in range(lanes):
            row = groups.row[k, lane]
            if row < 0:
                continue
            inverse, variance = state[matern.DIAGONAL + lane], state[matern.VARIANCE + lane]
            for j in range(1, rho.shape[0]):
                inverse -= rho[j, matern.U + lane] ** 2
                variance += rho[j, matern.SMOOTHED + lane] ** 2
            alpha = rho[0, matern.U + lane]
            out[0, row] = alpha
            out[1, row] = 0.5 * (alpha * alpha - inverse)
            out[2, row] = rho[0, matern.SMOOTHED + lane]
            out[3, row] = variance
    for lane in range(lanes):
        state[matern.TAU + lane] -= (
            0.5 * tau2 * (state[matern.N00 + lane] + state[matern.N11 + lane])
        )
        for j in range(rho.shape[0]):
            state[matern.TAU + lane] += 0.5 * tau2 * (rho[j, lane] ** 2 + rho[j, LANES + lane] ** 2)


@compiled()
def _take_errors_out(work: Work) -> None:
    """Readings less what the errors are expected to do; sensitivities rotated to T."""
    for k in range(work.readings.shape[0]):
        s = work.sensitivities[k].reshape(work.v.size, LANES)
        rotate(s, work.g)
        for j in range(work.v.size):
            for lane in range(LANES):
                work.readings[k, lane] -= work.v[j] * s[j, lane]


@compiled()
def group_gradient(
    groups: Groups, work: Work, residual: Array, group_variance: Array, u_cal2: float, tau: float,
    ell: float, out: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Log-likelihood of the rows of all groups, with errors, and its slopes by tau and ell.

    Parameters
    ----------
    groups, residual, group_variance, u_cal2, tau, ell
        As for `group_log_likelihood`.
    work : Work
        From `workspace` with slopes; any errors are set anew before each call.
    out : ndarray, shape (4, n_rows)
        Receives the slopes by the mean and by the variance of every row, and the posterior mean
        and variance of the discrepancy there.

    Returns
    -------
    tuple of float
    """
    tau2 = tau * tau
    _fill(groups, work, residual, tau, ell)
    beside = 0.0
    if work.v.size > 0:
        work.v[:] = 0.0
        work.g[:] = 0.0
        for block in range(groups.lanes.size):
            beside += _block_value(groups, block, work, group_variance, u_cal2, tau2, False)
        beside += marginalise(work.v, work.g)
        _take_errors_out(work)
    total = 0.0
    by_log_tau = 0.0
    by_ell = 0.0
    for block in range(groups.lanes.size):
        n_points = groups.start[block + 1] - groups.start[block]
        total += _block_value(groups, block, work, group_variance, u_cal2, tau2, True)
        _mix(work.means, work.gain, work.error_gain, work.root, n_points)
        _smooth_block(groups, block, work, tau2, out)
        for lane in range(LANES):
            if groups.group[block, lane] >= 0:
                by_log_tau += 2.0 * work.smoother[matern.TAU + lane]
                by_ell += work.smoother[matern.ELL + lane]
    value = beside if work.v.size > 0 else total
    return value, by_log_tau / tau if tau > 0.0 else 0.0, by_ell
