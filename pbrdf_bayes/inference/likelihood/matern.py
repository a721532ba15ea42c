"""The Matérn process in state space, one step of its Kalman filter and smoother at a time.

A stationary process d of amplitude tau and length ell has, for nu = 1/2 and 3/2, the covariance

    tau^2 exp(-a),  a = r/ell          and         tau^2 (1 + a) exp(-a),  a = sqrt(3) r/ell

and is the first component of a Markov chain x' = Phi x + noise(Q), cov(x) = tau^2 I, with (the
second component is the derivative times ell/sqrt(3))

    Phi = [[E + b, b], [-b, E - b]],   Q = [[q, 2 tau^2 b^2], [., q + 4 tau^2 E b]],
    E = exp(-a),  b = a E,  q = tau^2 (1 - (1 + 2a + 2a^2) exp(-2a))                    (nu = 3/2)

after Hartikainen and Särkkä, IEEE MLSP 2010, doi:10.1109/MLSP.2010.5589113. With b = 0 and
q = tau^2 (1 - exp(-2a)) the same formulas are those of nu = 1/2 (the second component is idle).

The filter is that of readings y = d + N(0, v). With L = Phi (I - K H) the backward recursions

    u = (e/S) - (Phi K)' rho',   rho = H e/S + L' rho',   N = H' H/S + L' N' L

give u = K_y^-1 y, its variance D = 1/S + (Phi K)' N' Phi K (the diagonal of K_y^-1), the smoothed
state m + P rho with covariance P - P N P, and the score: de Jong, Biometrika 76, 275 (1989),
doi:10.1093/biomet/76.2.275; Koopman and Shephard, Biometrika 79, 823 (1992),
doi:10.1093/biomet/79.4.823.

Every kernel works on up to `LANES` independent processes, stored side by side, so that the compiler
runs them on several numbers at once: a field of a row begins at the constant of its name. They are
pasted into the loop over points: calls would cost more than the arithmetic.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LANES = 16
MISSING = 1e60
"""Variance of a reading that is not there."""

# A row of transitions to the next point: E, b, q and their derivatives by ell.
E, B, Q, E_ELL, B_ELL, Q_ELL = (LANES * i for i in range(6))
N_TRANSITION = 6 * LANES

# A row of points: variance beyond the base, indicators of the scans.
EXTRA, ONES = (LANES * i for i in range(2))

# The filter: predicted P, means of the residual and of the first indicator; Phi; gains K and Phi K,
# 1/S, S over a scale; innovations; sums of squares and products of innovations over S.
P00, P01, P11, R0, R1, C0, C1, BASE, SCALE = (LANES * i for i in range(9))
A00, A01, A11, K0, K1, W, G0, G1, STRETCH = (LANES * i for i in range(9, 18))
R, C, DET, RR, RC, CC = (LANES * i for i in range(18, 24))
N_FILTER = 24 * LANES

# A filtered sequence: predicted mean and innovation; sums.
M0, M1, INNOVATION, CROSS, SQUARE = (LANES * i for i in range(5))
N_MEAN = 3 * LANES
N_SEQUENCE = 5 * LANES

# What the smoother needs of the covariance at a point: P, K, 1/S.
T_P00, T_P01, T_P11, T_K0, T_K1, T_W = (LANES * i for i in range(6))
N_COVARIANCE = 6 * LANES

# The smoother: N; L, Phi K, 1/S; slopes of Phi and Q by ell; Q; P; sums of tau and ell slopes;
# the diagonal of K_y^-1 and the smoothed variance of d.
N00, N01, N11, L00, L01, L10, L11, S_G0, S_G1, S_W = (LANES * i for i in range(10))
D00, D01, D11, QL00, QL01, QL11, Q00, Q01, Q11 = (LANES * i for i in range(10, 19))
S_P00, S_P01, S_P11, TAU, ELL, DIAGONAL, VARIANCE = (LANES * i for i in range(19, 26))
N_SMOOTHER = 26 * LANES

# A smoothed sequence: rho, u, smoothed d.
RHO0, RHO1, U, SMOOTHED = (LANES * i for i in range(4))
N_SMOOTHED = 4 * LANES

_SETTLED = 1e-14
_SQRT3 = sqrt(3.0)
_RECIPROCAL = tuple(1.0 / n for n in range(1, 20))


@compiled(inline=True)
def _exp_remainder(x: float) -> float:
    """exp(x) - 1 - x - x^2/2 over x^3/6 for 0 <= x <= 1, without cancellation."""
    t = 1.0
    for n in range(18, 2, -1):
        t = 1.0 + t * x * _RECIPROCAL[n]
    return t


@compiled()
def fill_steps(spacing: Array, rough: bool, tau: float, ell: float, out: Array) -> None:
    """E, b, q of every distinct spacing, and their derivatives by ell if ``out`` has 6 rows.

    ``rough`` selects nu = 1/2.
    """
    tau2 = tau * tau
    scale = (1.0 if rough else _SQRT3) / ell
    for i in range(spacing.size):
        a = min(scale * spacing[i], 345.0)
        e = exp(-a)
        b = 0.0 if rough else a * e
        x = 2.0 * a
        if rough:
            q = -np.expm1(-x)
        elif x < 1.0:
            q = e * e * _exp_remainder(x) * x * x * x / 6.0
        else:
            q = 1.0 - e * e * (1.0 + x + 0.5 * x * x)
        out[0, i] = e
        out[1, i] = b
        out[2, i] = tau2 * q
        if out.shape[0] == 3:
            continue
        by_ell = -a / ell
        out[3, i] = -e * by_ell
        out[4, i] = 0.0 if rough else (e - b) * by_ell
        out[5, i] = tau2 * (2.0 * e * e if rough else 4.0 * b * b) * by_ell


@compiled()
def fill_transitions(steps: Array, step: Index, shared: NDArray[np.bool_], out: Array) -> None:
    """Rows of transitions from the steps of their lanes, ``step`` (n_rows, LANES)."""
    for t in range(step.shape[0]):
        row = out[t]
        for field in range(steps.shape[0]):
            if shared[t]:
                value = steps[field, step[t, 0]]
                for i in range(LANES):
                    row[LANES * field + i] = value
            else:
                for i in range(LANES):
                    row[LANES * field + i] = steps[field, step[t, i]]


@compiled()
def _predict(m0: float, m1: float, a00: float, a01: float, a11: float) -> tuple[float, float]:
    """Phi m."""
    return a00 * m0 + a01 * m1, a11 * m1 - a01 * m0


@compiled(inline=True)
def filter_point(
    state: Array, reading: Array, point: Array, move: Array, lanes: int, tau2: float
) -> int:
    """One reading per lane: gains, innovations, sums; then the prediction of the next point.

    Returns in how many lanes the covariance still changes.
    """
    moving = 0
    for i in range(min(lanes, LANES)):
        p00, p01, p11 = state[P00 + i], state[P01 + i], state[P11 + i]
        e, b, q = move[E + i], move[B + i], move[Q + i]
        a00, a11 = e + b, e - b
        v = point[EXTRA + i] + state[BASE + i]
        s = p00 + v
        w = 1.0 / s
        k0, k1 = p00 * w, p01 * w
        f00, f01, f11 = v * k0, v * k1, p11 - k1 * p01
        h00, h10 = _predict(f00, f01, a00, b, a11)
        h01, h11 = _predict(f01, f11, a00, b, a11)
        n00 = a00 * h00 + b * h01 + q
        n01 = a11 * h01 - b * h00 + 2.0 * tau2 * b * b
        n11 = a11 * h11 - b * h10 + q + 4.0 * tau2 * e * b
        g0, g1 = _predict(k0, k1, a00, b, a11)
        stretch = s * state[SCALE + i] if v < MISSING else 1.0
        r = reading[i] - state[R0 + i]
        c = point[ONES + i] - state[C0 + i]
        r0, r1 = _predict(state[R0 + i], state[R1 + i], a00, b, a11)
        c0, c1 = _predict(state[C0 + i], state[C1 + i], a00, b, a11)
        state[P00 + i], state[P01 + i], state[P11 + i] = n00, n01, n11
        state[A00 + i], state[A01 + i], state[A11 + i] = a00, b, a11
        state[K0 + i], state[K1 + i], state[W + i] = k0, k1, w
        state[G0 + i], state[G1 + i], state[STRETCH + i] = g0, g1, stretch
        state[R0 + i], state[R1 + i], state[R + i] = r0 + g0 * r, r1 + g1 * r, r
        state[C0 + i], state[C1 + i], state[C + i] = c0 + g0 * c, c1 + g1 * c, c
        state[DET + i] *= stretch
        state[RR + i] += w * r * r
        state[RC + i] += w * r * c
        state[CC + i] += w * c * c
        moving += (abs(n00 - p00) > _SETTLED * p00) | (abs(n11 - p11) > _SETTLED * p11)
    return moving


@compiled(inline=True)
def filter_settled_point(state: Array, reading: Array, point: Array, lanes: int) -> None:
    """The same with the gains of the point before."""
    for i in range(min(lanes, LANES)):
        a00, b, a11 = state[A00 + i], state[A01 + i], state[A11 + i]
        g0, g1, w = state[G0 + i], state[G1 + i], state[W + i]
        r = reading[i] - state[R0 + i]
        c = point[ONES + i] - state[C0 + i]
        r0, r1 = _predict(state[R0 + i], state[R1 + i], a00, b, a11)
        c0, c1 = _predict(state[C0 + i], state[C1 + i], a00, b, a11)
        state[R0 + i], state[R1 + i], state[R + i] = r0 + g0 * r, r1 + g1 * r, r
        state[C0 + i], state[C1 + i], state[C + i] = c0 + g0 * c, c1 + g1 * c, c
        state[DET + i] *= state[STRETCH + i]
        state[RR + i] += w * r * r
        state[RC + i] += w * r * c
        state[CC + i] += w * c * c


@compiled(inline=True)
def filter_sequence(sequence: Array, state: Array, reading: Array, lanes: int) -> None:
    """One more sequence, say an indicator, through a point whose gains are known."""
    for i in range(min(lanes, LANES)):
        m0, m1 = sequence[M0 + i], sequence[M1 + i]
        c = reading[i] - m0
        m0, m1 = _predict(m0, m1, state[A00 + i], state[A01 + i], state[A11 + i])
        sequence[M0 + i] = m0 + state[G0 + i] * c
        sequence[M1 + i] = m1 + state[G1 + i] * c
        sequence[INNOVATION + i] = c
        sequence[CROSS + i] += state[W + i] * state[R + i] * c
        sequence[SQUARE + i] += state[W + i] * c * c


@compiled(inline=True)
def smooth_covariance(
    state: Array, tape: Array, point: Array, base: Array, move: Array, lanes: int, tau2: float
) -> None:
    """N, the diagonal of K_y^-1 and the log-determinant's slopes, from the next point to this."""
    for i in range(min(lanes, LANES)):
        n00, n01, n11 = state[N00 + i], state[N01 + i], state[N11 + i]
        p00, p01, p11 = tape[T_P00 + i], tape[T_P01 + i], tape[T_P11 + i]
        k0, k1, w = tape[T_K0 + i], tape[T_K1 + i], tape[T_W + i]
        e, b, q = move[E + i], move[B + i], move[Q + i]
        e_ell, b_ell, q_ell = move[E_ELL + i], move[B_ELL + i], move[Q_ELL + i]
        v = point[EXTRA + i] + base[i]
        a00, a11 = e + b, e - b
        g0, g1 = _predict(k0, k1, a00, b, a11)
        q01, q11 = 2.0 * tau2 * b * b, q + 4.0 * tau2 * e * b
        d00, d01, d11 = e_ell + b_ell, b_ell, e_ell - b_ell
        ql01, ql11 = 4.0 * tau2 * b * b_ell, q_ell + 4.0 * tau2 * (e_ell * b + e * b_ell)
        f00, f01, f11 = v * k0, v * k1, p11 - k1 * p01
        t00, t01 = n00 * a00 - n01 * b, n00 * b + n01 * a11
        t10, t11 = n01 * a00 - n11 * b, n01 * b + n11 * a11
        by_phi = (d00 * f00 + d01 * f01) * t00 + (d00 * f01 + d01 * f11) * t01
        by_phi += (d11 * f01 - d01 * f00) * t10 + (d11 * f11 - d01 * f01) * t11
        state[ELL + i] -= by_phi + 0.5 * (q_ell * n00 + ql11 * n11) + ql01 * n01
        state[TAU + i] -= 0.5 * (q * n00 + q11 * n11) + q01 * n01
        l00, l10 = a00 * v * w - b * k1, -b * v * w - a11 * k1
        state[DIAGONAL + i] = w + g0 * g0 * n00 + 2.0 * g0 * g1 * n01 + g1 * g1 * n11
        t00, t10 = n00 * l00 + n01 * l10, n01 * l00 + n11 * l10
        n11 = b * (n00 * b + n01 * a11) + a11 * (n01 * b + n11 * a11)
        n01 = b * t00 + a11 * t10
        n00 = w + l00 * t00 + l10 * t10
        x0, x1 = p00 * n00 + p01 * n01, p00 * n01 + p01 * n11
        state[VARIANCE + i] = p00 - (x0 * p00 + x1 * p01)
        state[N00 + i], state[N01 + i], state[N11 + i] = n00, n01, n11
        state[L00 + i], state[L01 + i], state[L10 + i], state[L11 + i] = l00, b, l10, a11
        state[S_G0 + i], state[S_G1 + i], state[S_W + i] = g0, g1, w
        state[D00 + i], state[D01 + i], state[D11 + i] = d00, d01, d11
        state[QL00 + i], state[QL01 + i], state[QL11 + i] = q_ell, ql01, ql11
        state[Q00 + i], state[Q01 + i], state[Q11 + i] = q, q01, q11
        state[S_P00 + i], state[S_P01 + i], state[S_P11 + i] = p00, p01, p11


@compiled(inline=True)
def smooth_sequence(rho: Array, state: Array, tape: Array, lanes: int) -> None:
    """Rho, u, the smoothed state and the sequence's share of the slopes, to this point."""
    for i in range(min(lanes, LANES)):
        r0, r1 = rho[RHO0 + i], rho[RHO1 + i]
        weighted = state[S_W + i] * tape[INNOVATION + i]
        u = weighted - state[S_G0 + i] * r0 - state[S_G1 + i] * r1
        s0 = weighted + state[L00 + i] * r0 + state[L10 + i] * r1
        s1 = state[L01 + i] * r0 + state[L11 + i] * r1
        x0 = tape[M0 + i] + state[S_P00 + i] * s0 + state[S_P01 + i] * s1
        x1 = tape[M1 + i] + state[S_P01 + i] * s0 + state[S_P11 + i] * s1
        d00, d01, d11 = state[D00 + i], state[D01 + i], state[D11 + i]
        by_phi = r0 * (d00 * x0 + d01 * x1) + r1 * (d11 * x1 - d01 * x0)
        by_q = 0.5 * (state[QL00 + i] * r0 * r0 + state[QL11 + i] * r1 * r1)
        state[ELL + i] += by_phi + by_q + state[QL01 + i] * r0 * r1
        by_q = 0.5 * (state[Q00 + i] * r0 * r0 + state[Q11 + i] * r1 * r1)
        state[TAU + i] += by_q + state[Q01 + i] * r0 * r1
        rho[RHO0 + i], rho[RHO1 + i], rho[U + i], rho[SMOOTHED + i] = s0, s1, u, x0
