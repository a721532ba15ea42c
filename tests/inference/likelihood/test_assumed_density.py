"""The assumed-density filter against exact sums, orthant probabilities, quadrature and simulation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import integrate, linalg, special, stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.likelihood.assumed_density import sweep_log_likelihood
from pbrdf_bayes.inference.likelihood.assumed_density_slopes import sweep_gradient
from pbrdf_bayes.inference.likelihood.groups import prepare_groups, set_variances, workspace
from pbrdf_bayes.inference.likelihood.kalman import group_gradient
from pbrdf_bayes.inference.likelihood.row_evidence import (
    N_OUT,
    Mixture,
    normal_mixture,
    normal_tail,
    row_evidence,
    student_mixture,
)
from pbrdf_bayes.inference.likelihood.sweeps import make_tape, prepare_sweep

Array = NDArray[np.float64]
NORMAL, STUDENT = normal_mixture(), student_mixture(4.0)


def _seeded(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def scan_covariance(angle: Array, u_cal: float, tau: float, ell: float = 20.0) -> Array:
    """Matérn 3/2 and a gain, of one scan."""
    a = np.sqrt(3.0) * np.abs(angle[:, None] - angle) / ell
    return np.asarray(tau**2 * (1.0 + a) * np.exp(-a) + u_cal**2)


def filtered(
    angle: Array, residual: Array, variance: Array, *, u_cal: float, tau: float,
    censored: Any = None, mixture: Mixture = NORMAL, ell: float = 20.0,
) -> float:  # fmt: skip
    """Log-likelihood of one scan by the filter."""
    zero = np.zeros(angle.size, dtype=np.int64)
    hidden = np.zeros(angle.size, dtype=bool) if censored is None else censored
    sweep = prepare_sweep(angle, zero, zero, residual, hidden, mixture, groups=[0])
    tape = make_tape(sweep, False)
    return float(sweep_log_likelihood(sweep, tape, residual, variance, hidden, u_cal**2, tau, ell))


# --- noise and evidence of one reading


@pytest.mark.parametrize("dof", [1.0, 2.0, 4.0, 10.0, 30.0])
def test_the_mixture_is_student_t(dof: float) -> None:
    """Density within 1.5e-4 up to 300 scales, total variation below 1e-4."""
    mixture = student_mixture(dof)
    weight = np.exp(mixture.log_weight)
    assert weight.sum() == pytest.approx(1.0, abs=1e-13)
    x = np.concatenate([np.linspace(0.0, 10.0, 2001), np.geomspace(10.0, 300.0, 300)])
    density = (weight * stats.norm.pdf(x[:, None], scale=np.sqrt(mixture.scale))).sum(axis=1)
    exact = stats.t.pdf(x, dof)
    np.testing.assert_allclose(density, exact, rtol=1.5e-4)
    assert 2.0 * integrate.trapezoid(np.abs(density - exact), x) < 1e-4


@pytest.mark.parametrize("z", [-1e4, -100.0, -40.0, -20.0, -5.0, -4.0, -3.9, -1.0, 0.0, 2.0, 8.0])
def test_tail_of_the_normal_law(z: float) -> None:
    with mpmath.workdps(60):
        cdf = mpmath.erfc(-mpmath.mpf(z) / mpmath.sqrt(2)) / 2
        hazard = mpmath.npdf(z) / cdf
        excess = hazard + z
        wanted = [float(v) for v in (mpmath.log(cdf), hazard, excess, 1 - hazard * excess)]
    np.testing.assert_allclose(normal_tail(z), wanted, rtol=1e-12)


@pytest.mark.parametrize("censored", [False, True])
@pytest.mark.parametrize("mixture", [NORMAL, STUDENT], ids=["normal", "student"])
@pytest.mark.parametrize("e", [0.3, -0.3, -3.0])
def test_evidence_and_its_derivatives(e: float, mixture: Mixture, censored: bool) -> None:
    out = np.zeros(N_OUT)
    s, v = 0.01, 0.0025
    row_evidence(e, s, v, censored, mixture, True, np.zeros((6, mixture.scale.size)), out)

    def log_z(mu: Any, s: Any, v: Any) -> Any:
        total = mpmath.mpf(0)
        for scale, log_weight in zip(mixture.scale, mixture.log_weight, strict=True):
            sd = mpmath.sqrt(s + v * mpmath.mpf(scale))
            z = (mpmath.mpf(e) - mu) / sd
            part = mpmath.erfc(-z / mpmath.sqrt(2)) / 2 if censored else mpmath.npdf(z) / sd
            total += mpmath.exp(mpmath.mpf(log_weight)) * part
        return mpmath.log(total)

    with mpmath.workdps(50):
        at = (mpmath.mpf(0), mpmath.mpf(s), mpmath.mpf(v))
        orders = [(2, 0, 0), (3, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
        orders += [(0, 0, 1), (1, 0, 1), (2, 0, 1)]
        second, third, *rest = (mpmath.diff(log_z, at, n) for n in orders)
        for i in (2, 5):
            rest[i] = -rest[i]
        first = [log_z(*at), mpmath.diff(log_z, at, (1, 0, 0)), -second, 1 + s * second, -third]
        wanted = np.array([float(value) for value in first + rest])
    np.testing.assert_allclose(out, wanted, rtol=1e-9, atol=1e-12 * np.abs(wanted).max())


# --- exact where it has to be


def made_up(seed: int, n: int = 200) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Angles, some repeated, groups of one to three scans."""
    rng = _seeded(seed)
    group = rng.integers(0, 4, n)
    return rng.uniform(-80, 80, n).round(0), group, group * 3 + rng.integers(0, 1 + group % 3)


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize(("u_cal", "tau"), [(0.0, 0.05), (0.02, 0.3), (10.0, 0.05), (0.05, 0.0)])
def test_normal_rows_have_the_exact_likelihood(u_cal: float, tau: float, rough: bool) -> None:
    angle, group, scan = made_up(0)
    rng = _seeded(1)
    residual, extra = 0.1 + 0.05 * rng.normal(size=200), rng.uniform(0.0, 1e-3, 200)
    base = rng.uniform(1e-4, 1e-3, 4)
    groups = prepare_groups(angle, group, scan, rough=rough)
    work, by_row = workspace(groups, True), np.empty((4, 200))
    set_variances(groups, work, extra)
    wanted = group_gradient(groups, work, residual, base, u_cal**2, tau, 20.0, by_row)
    none = np.zeros(200, dtype=bool)
    sweep = prepare_sweep(angle, group, scan, residual, none, NORMAL, groups=range(4), rough=rough)
    variance, out = base[group] + extra, np.empty((2, 200))
    args = (residual, variance, none, u_cal**2, tau, 20.0)
    found = sweep_gradient(sweep, make_tape(sweep, True), *args, out)
    value = sweep_log_likelihood(sweep, make_tape(sweep, False), *args)
    np.testing.assert_allclose([*found, value], [*wanted, wanted[0]], rtol=1e-10, atol=1e-12)
    for found_row, wanted_row in zip(out, by_row[:2], strict=True):
        np.testing.assert_allclose(found_row, wanted_row, atol=1e-10 * np.abs(wanted_row).max())


@pytest.mark.parametrize("u_cal", [0.05, 1.0, 10.0])
def test_one_censored_reading_beside_a_gain(u_cal: float) -> None:
    """At the end of the sweep: exact."""
    angle, residual = np.arange(5.0), np.array([-0.2, 0.1, 0.12, 0.08, 0.05])
    variance = np.array([0.01, 4e-4, 9e-4, 4e-4, 1e-4])
    hidden = angle == 0.0
    found = filtered(angle, residual, variance, u_cal=u_cal, tau=0.0, censored=hidden)
    seen = ~hidden
    precision = 1.0 / u_cal**2 + np.sum(1.0 / variance[seen])
    mean, sd = np.sum(residual[seen] / variance[seen]) / precision, precision**-0.5
    normal = stats.norm.logpdf(residual[seen], mean, np.sqrt(variance[seen])).sum()
    normal += stats.norm.logpdf(mean, 0.0, u_cal) - stats.norm.logpdf(mean, mean, sd)
    tail, _ = integrate.quad(
        lambda c: stats.norm.pdf(c, mean, sd) * stats.norm.cdf((residual[0] - c) / 0.1),
        mean - 12.0 * sd, mean + 12.0 * sd, epsabs=0.0, epsrel=1e-13,
    )  # fmt: skip
    assert found == pytest.approx(normal + np.log(tail), abs=1e-10)


@pytest.mark.parametrize("e", [0.0, 0.1, 3.0])
def test_one_student_reading(e: float) -> None:
    """With a discrepancy and a gain: the noise and a normal law convolved, in one dimension."""
    one = np.ones(1)
    found = filtered(one, e * one, 4e-4 * one, u_cal=0.03, tau=0.04, mixture=STUDENT)
    exact, _ = integrate.quad(
        lambda g: stats.norm.pdf(g, 0.0, 0.05) * stats.t.pdf((e - g) / 0.02, 4.0) / 0.02,
        -0.6, 0.6, points=[0.0, min(e, 0.59)], epsrel=1e-12, limit=500,
    )  # fmt: skip
    assert found == pytest.approx(np.log(exact), abs=1.5e-4)  # of the mixture


def test_independent_student_readings_are_exact() -> None:
    residual = 0.02 * _seeded(2).standard_t(4.0, 30)
    found = filtered(np.arange(30.0), residual, np.full(30, 4e-4), u_cal=0.0, tau=0.0,
                     mixture=STUDENT)  # fmt: skip
    assert found == pytest.approx(stats.t.logpdf(residual, 4.0, scale=0.02).sum(), abs=5e-3)


# --- the error, shown


def orthant(
    angle: Array, residual: Array, variance: Array, hidden: NDArray[np.bool_], *, u_cal: float,
    tau: float,
) -> float:  # fmt: skip
    """Exact log-likelihood of a scan with a few censored readings."""
    matrix = scan_covariance(angle, u_cal, tau) + np.diag(variance)
    seen = ~hidden
    across = linalg.solve(matrix[np.ix_(seen, seen)], matrix[np.ix_(seen, hidden)]).T
    rest = matrix[np.ix_(hidden, hidden)] - across @ matrix[np.ix_(seen, hidden)]
    value = stats.multivariate_normal.logpdf(residual[seen], cov=matrix[np.ix_(seen, seen)])
    below = stats.multivariate_normal.cdf(
        residual[hidden] - across @ residual[seen], cov=rest, abseps=1e-9, releps=1e-7,
        maxpts=2_000_000, rng=_seeded(0),
    )  # fmt: skip
    return float(value + np.log(below))


def smooth_scan(seed: int, u_cal: float, tau: float, n: int = 33) -> tuple[Array, Array]:
    """Angles and residuals with 2 % noise."""
    rng = _seeded(seed)
    angle = np.linspace(-80.0, 80.0, n)
    matrix = scan_covariance(angle, min(u_cal, 1.0), tau) + 1e-12 * np.eye(n)
    return angle, linalg.cholesky(matrix, lower=True) @ rng.normal(size=n) + 0.02 * rng.normal(
        size=n
    )


@pytest.mark.parametrize(("u_cal", "tau"), [(0.0, 0.05), (0.05, 0.05), (0.05, 0.2), (10.0, 0.2)])
@pytest.mark.parametrize(
    ("hidden", "noise2", "bound"),
    [
        ([0, 1, 2, 31, 32], 0.5, 1e-6),
        ([0, 1, 2, 3, 4, 5, 27, 28, 29, 30, 31, 32], 0.5, 1e-3),
        ([0, 1, 2, 31, 32], 4e-4, 0.1),
        ([10, 11, 12, 13, 14], 4e-4, 0.35),
    ],
    ids=["floor", "much below the floor", "no floor noise", "no floor noise, in the middle"],
)
def test_a_few_censored_readings(
    u_cal: float, tau: float, hidden: list[int], noise2: float, bound: float
) -> None:
    """Readings with the noise of a floor, 1/2; others with 2 %, which no floor has."""
    below = np.isin(np.arange(33), hidden)
    for seed in range(2):
        angle, residual = smooth_scan(seed, u_cal, tau)
        if noise2 == 0.5:
            residual[below] = np.linspace(0.5, -1.0, below.sum())
        variance = np.where(below, noise2, 4e-4)
        found = filtered(angle, residual, variance, u_cal=u_cal, tau=tau, censored=below)
        wanted = orthant(angle, residual, variance, below, u_cal=u_cal, tau=tau)
        assert abs(found - wanted) < bound


def all_components(
    angle: Array, residual: Array, v: float, *, u_cal: float, tau: float, shift: Any = 0.0
) -> Array:
    """Exact log-likelihood of a few Student-t readings: the sum over all 27^n components.

    One value for each shift of the mean.
    """
    n = angle.size
    scales = np.stack(np.meshgrid(*[STUDENT.scale] * n, indexing="ij"), axis=-1).reshape(-1, n)
    weights = sum(np.meshgrid(*[STUDENT.log_weight] * n, indexing="ij")).ravel()
    keep = weights > -40.0
    matrix = scan_covariance(angle, u_cal, tau) + v * scales[keep][:, :, None] * np.eye(n)
    inverse, log_det = np.linalg.inv(matrix), np.linalg.slogdet(matrix)[1]
    values = []
    for by in np.atleast_1d(shift):
        r = residual - by
        chi2 = np.einsum("i,kij,j->k", r, inverse, r)
        exponents = weights[keep] - 0.5 * (chi2 + log_det + n * np.log(2.0 * np.pi))
        values.append(special.logsumexp(exponents))
    return np.array(values)


STUDENT_ROWS = {
    "clean": np.array([0.01, -0.01, 0.02, 0.0]),
    "outlier first": np.array([0.5, 0.01, 0.0, 0.02]),
    "outlier last": np.array([0.01, 0.0, 0.02, -0.4]),
    "two camps": np.array([0.1, 0.1, 0.0, 0.01]),
}


@pytest.mark.parametrize("rows", STUDENT_ROWS)
@pytest.mark.parametrize(("u_cal", "tau"), [(0.0, 0.05), (0.05, 0.05), (0.05, 0.2)])
def test_four_student_readings(rows: str, u_cal: float, tau: float) -> None:
    angle = np.array([0.0, 3.0, 6.0, 10.0])
    residual = STUDENT_ROWS[rows]
    found = filtered(angle, residual, np.full(4, 4e-4), u_cal=u_cal, tau=tau, mixture=STUDENT)
    wanted = all_components(angle, residual, 4e-4, u_cal=u_cal, tau=tau)[0]
    assert abs(found - wanted) < 0.2


def particle_filter(
    angle: Array, residual: Array, v: float, *, u_cal: float, tau: float, n: int, seed: int
) -> float:
    """Log-likelihood of Student-t readings: components drawn, the rest exact (unbiased in Z)."""
    rng = _seeded(seed)
    matrix = scan_covariance(angle, u_cal, tau)
    chosen = np.empty((n, 0))
    total = 0.0
    for i in range(angle.size):
        mean, s = np.zeros(n), np.full(n, matrix[i, i])
        if i:
            inner = matrix[:i, :i] + v * chosen[:, :, None] * np.eye(i)
            weight = np.linalg.solve(inner, np.broadcast_to(matrix[:i, i, None], (n, i, 1)))[..., 0]
            mean, s = weight @ residual[:i], matrix[i, i] - weight @ matrix[:i, i]
        variance = s[:, None] + v * STUDENT.scale
        exponents = STUDENT.log_weight - 0.5 * (
            (residual[i] - mean)[:, None] ** 2 / variance + np.log(2.0 * np.pi * variance)
        )
        evidence = special.logsumexp(exponents, axis=1)
        total += special.logsumexp(evidence) - np.log(n)
        shares = np.cumsum(np.exp(exponents - evidence[:, None]), axis=1)
        pick = np.minimum((shares < rng.random((n, 1))).sum(axis=1), STUDENT.scale.size - 1)
        chosen = np.column_stack([chosen, STUDENT.scale[pick]])
        places = np.cumsum(np.exp(evidence - evidence.max()))
        at = np.searchsorted(places / places[-1], (np.arange(n) + rng.random()) / n)
        chosen = chosen[np.minimum(at, n - 1)]
    return float(total)


@pytest.mark.parametrize("u_cal", [0.05, 10.0])
def test_a_scan_with_student_noise(u_cal: float) -> None:
    """33 readings, one of them an outlier; the reference is known to about 0.03."""
    angle, residual = smooth_scan(4, u_cal, 0.05)
    residual[20] += 0.5
    found = filtered(angle, residual, np.full(33, 4e-4), u_cal=u_cal, tau=0.05, mixture=STUDENT)
    runs = [
        particle_filter(angle, residual, 4e-4, u_cal=u_cal, tau=0.05, n=600, seed=seed)
        for seed in range(3)
    ]
    assert np.std(runs) < 0.1
    assert abs(found - np.mean(runs)) < 0.4


def test_an_outlier_at_the_first_angle_of_a_scan_with_a_free_scale() -> None:
    """The sweep does not start with it: a start there would cost 60 nats."""
    angle, residual = smooth_scan(5, 0.0, 0.05)
    args: dict[str, Any] = {"u_cal": 10.0, "tau": 0.05, "mixture": STUDENT}
    clean = filtered(angle, residual, np.full(33, 4e-4), **args)
    residual[0] += 0.5
    cost = clean - filtered(angle, residual, np.full(33, 4e-4), **args)
    assert 4.0 < cost < 20.0  # ln of the ratio of t densities at 25 scales and at 0: 14


def moments(shift: Array, values: Array) -> tuple[float, float]:
    weight = np.exp(values - values.max())
    mean = float(np.sum(weight * shift) / weight.sum())
    return mean, float(np.sqrt(np.sum(weight * (shift - mean) ** 2) / weight.sum()))


def test_what_the_error_does_to_an_estimate() -> None:
    """Posterior of a common shift of the mean under a flat prior, in its standard deviations."""
    shift = np.linspace(-0.3, 0.4, 71)
    angle = np.array([0.0, 3.0, 6.0, 10.0])
    for residual in STUDENT_ROWS.values():
        variance = np.full(4, 4e-4)
        found = [
            filtered(angle, residual - by, variance, u_cal=0.0, tau=0.05, mixture=STUDENT)
            for by in shift
        ]
        mean, sd = moments(shift, np.array(found))
        exact = all_components(angle, residual, 4e-4, u_cal=0.0, tau=0.05, shift=shift)
        wanted, wanted_sd = moments(shift, exact)
        assert abs(mean - wanted) < 0.03 * wanted_sd
        assert sd == pytest.approx(wanted_sd, rel=0.05)
    angle, residual = smooth_scan(3, 0.0, 0.05)
    hidden = np.isin(np.arange(33), [0, 1, 32])
    variance = np.where(hidden, 0.5, 4e-4)
    pairs = [
        (
            filtered(angle, residual - by, variance, u_cal=0.0, tau=0.05, censored=hidden),
            orthant(angle, residual - by, variance, hidden, u_cal=0.0, tau=0.05),
        )
        for by in shift[::3]
    ]
    (mean, sd), (wanted, wanted_sd) = (
        moments(shift[::3], np.array(values)) for values in zip(*pairs, strict=True)
    )
    assert abs(mean - wanted) < 1e-4 * wanted_sd
    assert sd == pytest.approx(wanted_sd, rel=1e-4)


# --- slopes, order, range


def slope(function: Any, x: float, step: float) -> float:
    """Central difference of fourth order."""
    near, far = (function(x + h) - function(x - h) for h in (step, 2.0 * step))
    return float((8.0 * near - far) / (12.0 * step))


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("u_cal", [0.0, 0.05, 10.0])
@pytest.mark.parametrize("mixture", [NORMAL, STUDENT], ids=["normal", "student"])
def test_slopes_of_the_sweep(mixture: Mixture, u_cal: float, rough: bool) -> None:
    angle, group, scan = made_up(3)
    rng = _seeded(4)
    residual, hidden = 0.05 * rng.normal(size=200), rng.random(200) < 0.15
    residual[::17] += 0.5
    sweep = prepare_sweep(
        angle, group, scan, residual, hidden, mixture, groups=range(4), rough=rough
    )
    tape, out = make_tape(sweep, False), np.empty((2, 200))

    def value(r: Array, v: Array, tau: float = 0.05, ell: float = 20.0) -> float:
        return float(sweep_log_likelihood(sweep, tape, r, v, hidden, u_cal**2, tau, ell))

    v = np.full(200, 4e-4)
    found = sweep_gradient(
        sweep, make_tape(sweep, True), residual, v, hidden, u_cal**2, 0.05, 20.0, out
    )
    assert found[0] == pytest.approx(value(residual, v), rel=1e-13)
    by_tau = slope(lambda t: value(residual, v, tau=t), 0.05, 1e-4)
    by_ell = slope(lambda t: value(residual, v, ell=t), 20.0, 1e-2)
    np.testing.assert_allclose(found[1:], [by_tau, by_ell], rtol=1e-7)
    for i in range(0, 200, 7):
        one = np.eye(200)[i]
        by_mean = -slope(lambda t, one=one: value(residual + t * one, v), 0.0, 1e-4)
        by_v = slope(lambda t, one=one: value(residual, v + t * one), 0.0, 1e-7)
        assert out[0, i] == pytest.approx(by_mean, abs=1e-8 * np.abs(out[0]).max())
        assert out[1, i] == pytest.approx(by_v, abs=1e-8 * np.abs(out[1]).max())


def test_the_order_of_the_rows_does_not_matter() -> None:
    angle, group, scan = made_up(5)
    rng = _seeded(6)
    residual, hidden = 0.05 * rng.normal(size=200), rng.random(200) < 0.2
    variance = rng.uniform(1e-4, 1e-3, 200)
    values = []
    for order in (np.arange(200), rng.permutation(200)):
        columns = [c[order] for c in (angle, group, scan, residual, hidden)]
        sweep = prepare_sweep(*columns, STUDENT, groups=range(4))
        tape = make_tape(sweep, False)
        args = (columns[3], variance[order], columns[4], 0.01, 0.05, 20.0)
        values.append(sweep_log_likelihood(sweep, tape, *args))
    for one, other in pairwise(values):
        assert one == other


@given(
    seed=st.integers(0, 10_000), n=st.integers(1, 40), hidden=st.floats(0.0, 1.0),
    noise=st.floats(-6.0, 0.5), tau=st.floats(-5.0, 0.3), ell=st.floats(-0.3, 2.7),
    u_cal=st.sampled_from([0.0, 1e-3, 0.05, 1.0, 10.0]), size=st.floats(-6.0, 2.5),
    student=st.booleans(), rough=st.booleans(),
)  # fmt: skip
@settings(max_examples=300, deadline=None)
def test_always_finite(
    seed: int, n: int, hidden: float, noise: float, tau: float, ell: float, u_cal: float,
    size: float, student: bool, rough: bool,
) -> None:  # fmt: skip
    """Over the support of the priors: noise from 1e-6, tau to 2, residuals to 300."""
    rng = _seeded(seed)
    group = rng.integers(0, 2, n)
    scan = 2 * group + rng.integers(0, 2, n)
    residual, censored = 10.0**size * rng.normal(size=n), rng.random(n) < hidden
    sweep = prepare_sweep(
        rng.uniform(-80, 80, n).round(1), group, scan, residual, censored,
        STUDENT if student else NORMAL, groups=np.unique(group), rough=rough,
    )  # fmt: skip
    out = np.empty((2, n))
    args = (residual, np.full(n, 10.0 ** (2 * noise)), censored, u_cal**2, 10.0**tau, 10.0**ell)
    value = sweep_log_likelihood(sweep, make_tape(sweep, False), *args)
    found = sweep_gradient(sweep, make_tape(sweep, True), *args, out)
    assert np.isfinite([value, *found]).all()
    assert np.isfinite(out).all()


def test_degrees_of_freedom_have_a_range() -> None:
    with pytest.raises(pb.ConfigError, match=r"student_dof = 31 is not allowed: give a number in"):
        pb.RunConfig(tails="student-t", student_dof=31)
