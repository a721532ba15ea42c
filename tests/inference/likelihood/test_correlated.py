"""The correlated likelihood against covariance matrices, written down without a filter."""

from __future__ import annotations

from typing import Any, NamedTuple

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, stats

from pbrdf_bayes.inference.likelihood.groups import (
    Groups,
    Work,
    prepare_groups,
    set_variances,
    workspace,
)
from pbrdf_bayes.inference.likelihood.kalman import group_gradient, group_log_likelihood
from pbrdf_bayes.inference.prediction.discrepancy import (
    Process,
    draw_prior_discrepancy,
    smoother,
)
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
GRID = np.linspace(-80.0, 80.0, 321)


class Case(NamedTuple):
    """Rows of groups."""

    angle: Array
    group: NDArray[np.int64]
    scan: NDArray[np.int64]
    extra: Array


def _seeded(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def regular() -> Case:
    group = np.repeat(np.arange(4), GRID.size)
    return Case(np.tile(GRID, 4), group, group, np.zeros(group.size))


def gaps() -> Case:
    """Scans with the readings near retro-reflection missing, at other angles in each."""
    parts = [GRID[np.abs(GRID + centre) > 3.0] for centre in (20.0, 40.0, 60.0)]
    group = np.repeat(np.arange(3), [len(p) for p in parts])
    return Case(np.concatenate(parts), group, group, np.zeros(group.size))


def irregular() -> Case:
    """Repeated angles, variances of their own, more groups than fit side by side."""
    rng = _seeded(1)
    group = np.concatenate([np.arange(20), rng.integers(0, 20, 480)])
    return Case(rng.uniform(-80, 80, 500).round(0), group, group, rng.uniform(0.0, 1e-2, 500))


def repeats() -> Case:
    """One to four scans in a group, some at the same angles, rows in any order."""
    rng = _seeded(2)
    group = np.concatenate([np.arange(19), rng.integers(0, 19, 681)])
    return Case(
        rng.uniform(-80, 80, 700).round(0), group, rng.integers(0, 1 + group % 4), np.zeros(700)
    )


def thrice() -> Case:
    """Three scans on one grid and a lone one."""
    scan = np.repeat(np.arange(4), GRID.size)
    return Case(np.tile(GRID, 4), np.minimum(scan, 2) // 2, scan, np.zeros(scan.size))


def one_point() -> Case:
    zero = np.zeros(1, dtype=np.int64)
    return Case(np.array([10.0]), zero, zero, np.zeros(1))


def uneven() -> Case:
    """A group of one row beside one of many."""
    group = np.array([0] + [1] * 50)
    return Case(np.append(3.0, np.linspace(0.0, 70.0, 50)), group, group, np.zeros(51))


CASES = [regular, gaps, irregular, repeats, thrice, one_point, uneven]


def readings(case: Case, seed: int = 7) -> tuple[Array, Array]:
    """Residuals with a common offset, and variances of the groups."""
    rng = _seeded(seed)
    n_groups = int(case.group.max()) + 1
    return 0.1 + 0.05 * rng.normal(size=case.angle.size), rng.uniform(1e-4, 1e-3, n_groups)


def correlation(distance: Any, ell: Any, rough: bool) -> Any:
    if rough:
        return np.exp(-distance / ell)
    a = np.sqrt(type(ell)(3.0)) * distance / ell
    return (1.0 + a) * np.exp(-a)


def covariance(case: Case, variance: Any, u_cal: float, tau: Any, ell: Any, rough: bool) -> Any:
    same = case.group[:, None] == case.group
    distance = np.abs(case.angle[:, None] - case.angle).astype(type(ell))
    shared = same & (case.scan[:, None] == case.scan)
    return same * tau**2 * correlation(distance, ell, rough) + np.diag(variance) + shared * u_cal**2


def exact_log_density(matrix: Any, residual: Any) -> Any:
    """ln N(residual; 0, matrix) by a Cholesky factor in the precision of the matrix."""
    lower, z = matrix.copy(), residual.astype(matrix.dtype)
    for i in range(len(z)):
        lower[i:, i] /= np.sqrt(lower[i, i])
        z[i] /= lower[i, i]
        z[i + 1 :] -= lower[i + 1 :, i] * z[i]
        lower[i + 1 :, i + 1 :] -= np.outer(lower[i + 1 :, i], lower[i + 1 :, i])
    two_pi = 2.0 * np.arccos(z.dtype.type(-1.0))
    return -0.5 * np.sum(z * z + np.log(two_pi)) - np.sum(np.log(np.diag(lower)))


def differences(values: Any, scan: NDArray[np.int64]) -> Any:
    """Each row less the one before it in its scan, the first as it is: T of determinant 1.

    A gain then enters one row of each scan only, and no precision is lost to a large u_cal.
    """
    result = values.copy()
    for s in np.unique(scan):
        rows = np.flatnonzero(scan == s)
        result[rows[1:]] -= values[rows[:-1]]
    return result


def turned(case: Case, variance: Any, u_cal: float, tau: Any, ell: Any, rough: bool) -> Any:
    """T K T', scans told apart by their numbers alone."""
    matrix = covariance(case, variance, 0.0, tau, ell, rough)
    matrix = differences(differences(matrix, case.scan).T, case.scan)
    first = np.unique(case.scan, return_index=True)[1]
    matrix[first, first] += type(ell)(u_cal) ** 2
    return matrix


def exact(
    case: Case, residual: Array, variance: Array, u_cal: float, tau: float, ell: float, rough: bool
) -> float:
    """Log-likelihood group by group, in extended precision."""
    total = np.longdouble(0.0)
    for g in np.unique(case.group):
        rows = case.group == g
        part = Case(*(column[rows] for column in case))
        wide = [np.longdouble(x) for x in (tau, ell)]
        matrix = turned(part, variance[rows].astype(np.longdouble), u_cal, *wide, rough)
        total += exact_log_density(matrix, differences(residual[rows], part.scan))
    return float(total)


@compiled()
def evaluate_sets(
    groups: Groups, work: Work, residual: Array, variance: Array, u_cal2: float, x: Array
) -> Array:
    """Rows of (tau, ell), as a likelihood of parameter sets would do it."""
    result = np.empty(x.shape[0])
    for j in range(x.shape[0]):
        result[j] = group_log_likelihood(groups, work, residual, variance, u_cal2, x[j, 0], x[j, 1])
    return result


def value(
    case: Case, residual: Array, group_variance: Array, *, u_cal: float = 0.0, tau: float = 0.05,
    ell: float = 20.0, rough: bool = False,
) -> float:  # fmt: skip
    groups = prepare_groups(case.angle, case.group, case.scan, rough=rough)
    work = workspace(groups, False)
    set_variances(groups, work, case.extra)
    x = np.array([[tau, ell]])
    return float(evaluate_sets(groups, work, residual, group_variance, u_cal**2, x)[0])


def gradient(
    case: Case, residual: Array, group_variance: Array, *, u_cal: float = 0.0, tau: float = 0.05,
    ell: float = 20.0, rough: bool = False,
) -> tuple[float, float, float, Array]:  # fmt: skip
    groups = prepare_groups(case.angle, case.group, case.scan, rough=rough)
    work = workspace(groups, True)
    set_variances(groups, work, case.extra)
    out = np.empty((4, residual.size))
    found = group_gradient(groups, work, residual, group_variance, u_cal**2, tau, ell, out)
    return *found, out


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("u_cal", "rough"), [(0.0, True), (0.0, False), (0.02, False), (1e3, True), (1e6, False)]
)
def test_value_is_that_of_the_covariance_matrix(case: Any, u_cal: float, rough: bool) -> None:
    rows = case()
    residual, group_variance = readings(rows)
    variance = group_variance[rows.group] + rows.extra
    found = value(rows, residual, group_variance, u_cal=u_cal, rough=rough)
    wanted = exact(rows, residual, variance, u_cal, 0.05, 20.0, rough)
    assert found == pytest.approx(wanted, rel=1e-11)


@pytest.mark.parametrize(("tau", "ell"), [(0.3, 400.0), (1.0, 3.0), (1e-3, 0.01), (0.05, 1e6)])
@pytest.mark.parametrize("s_rel", [1e-8, 1e-3, 1.0])
@pytest.mark.parametrize("rough", [False, True])
def test_extreme_parameters(tau: float, ell: float, s_rel: float, rough: bool) -> None:
    rows = uneven()
    residual, _ = readings(rows)
    v = np.full(2, s_rel**2)
    found = value(rows, residual, v, u_cal=0.02, tau=tau, ell=ell, rough=rough)
    wanted = exact(rows, residual, v[rows.group], 0.02, tau, ell, rough)
    # The matrix itself is known to about 1e-19 tau^2/s_rel^2.
    assert found == pytest.approx(wanted, rel=1e-10 + 1e-17 * tau**2 / s_rel**2)


def test_one_scan_of_3000_angles() -> None:
    rng = _seeded(5)
    zero = np.zeros(3000, dtype=np.int64)
    rows = Case(np.sort(rng.uniform(-80, 80, 3000)), zero, zero, rng.uniform(1e-4, 1e-3, 3000))
    residual = 0.05 * rng.normal(size=3000)
    matrix = covariance(rows, rows.extra + 4e-4, 0.02, 0.05, 20.0, False)
    lower = linalg.cholesky(matrix, lower=True)
    z = linalg.solve_triangular(lower, residual, lower=True)
    wanted = -0.5 * z @ z - np.log(np.diag(lower)).sum() - 1500.0 * np.log(2.0 * np.pi)
    found = value(rows, residual, np.array([4e-4]), u_cal=0.02)
    assert found == pytest.approx(wanted, rel=1e-10)


def test_against_many_digits_where_doubles_fail() -> None:
    """Crowded angles, a repeated one, noise 1e-7 of the amplitude, a free gain."""
    angle = np.array([0.0, 1e-3, 2e-3, 2e-3, 0.5, 0.6, 40.0])
    zero = np.zeros(7, dtype=np.int64)
    residual = np.array([0.30, 0.31, 0.30, 0.29, 0.33, 0.35, 0.10])
    with mpmath.workdps(60):
        tau, ell, u = mpmath.mpf(0.05), mpmath.mpf(20.0), mpmath.mpf(1e3)
        matrix = mpmath.matrix(7, 7)
        for i in range(7):
            for j in range(7):
                a = mpmath.sqrt(3) * abs(mpmath.mpf(angle[i]) - mpmath.mpf(angle[j])) / ell
                matrix[i, j] = tau**2 * (1 + a) * mpmath.exp(-a) + u**2
            matrix[i, i] += mpmath.mpf(2.5e-17)
        r = mpmath.matrix(residual.tolist())
        chi2 = (r.T * mpmath.lu_solve(matrix, r))[0]
        log_det = mpmath.log(mpmath.det(matrix))
        wanted = float(-(chi2 + log_det + 7 * mpmath.log(2 * mpmath.pi)) / 2)
    rows = Case(angle, zero, zero, np.zeros(7))
    found = value(rows, residual, np.array([2.5e-17]), u_cal=1e3)
    assert found == pytest.approx(wanted, rel=1e-9)


def recursion(angle: Array, residual: Array, v: float, u_cal: float, tau: float, ell: float) -> Any:
    """Matérn 1/2 with a gain as a third state of an extended-precision filter, square by square."""
    wide = np.longdouble
    mean, total = np.zeros(2, wide), wide(0.0)
    p00, p01, p11 = wide(tau) ** 2, wide(0.0), wide(u_cal) ** 2
    for k in range(angle.size):
        s = p00 + 2 * p01 + p11 + v
        k0, k1 = (p00 + p01) / s, (p01 + p11) / s
        e = residual[k] - mean[0] - mean[1]
        total += e * e / s + np.log(s)
        mean = mean + np.array([k0, k1]) * e
        p00, p01, p11 = p00 - k0 * k0 * s, p01 - k0 * k1 * s, p11 - k1 * k1 * s
        if k + 1 < angle.size:
            phi = np.exp(-(wide(angle[k + 1]) - wide(angle[k])) / wide(ell))
            mean[0] *= phi
            p00, p01 = phi * phi * p00 + wide(tau) ** 2 * (1 - phi * phi), phi * p01
    return float(-0.5 * (total + angle.size * np.log(2.0 * np.arccos(wide(-1.0)))))


@pytest.mark.slow
def test_a_hundred_thousand_points() -> None:
    rng = _seeded(6)
    n = 100_000
    zero = np.zeros(n, dtype=np.int64)
    angle = np.linspace(-80.0, 80.0, n)
    rows = Case(angle, zero, zero, np.zeros(n))
    residual = 0.1 + 0.03 * rng.normal(size=n)
    found = value(rows, residual, np.array([9e-4]), u_cal=0.02, rough=True)
    assert found == pytest.approx(recursion(angle, residual, 9e-4, 0.02, 0.05, 20.0), rel=1e-10)


@pytest.mark.parametrize("u_cal", [0.0, 0.05])
def test_no_discrepancy_is_the_independent_law(u_cal: float) -> None:
    rows = repeats()
    residual, group_variance = readings(rows)
    variance = group_variance[rows.group]
    wanted = 0.0
    for g, s in {*zip(rows.group.tolist(), rows.scan.tolist(), strict=True)}:
        one = (rows.group == g) & (rows.scan == s)
        matrix = np.diag(variance[one]) + u_cal**2
        wanted += stats.multivariate_normal(np.zeros(one.sum()), matrix).logpdf(residual[one])
    for tau in (0.0, 1e-12):
        found = value(rows, residual, group_variance, u_cal=u_cal, tau=tau)
        assert found == pytest.approx(wanted, rel=1e-12)
        by_tau, by_ell = gradient(rows, residual, group_variance, u_cal=u_cal, tau=tau)[1:3]
        assert abs(tau * by_tau) < 1e-12
        assert abs(by_ell) < 1e-12


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("u_cal", [0.0, 0.02, 1e3])
@pytest.mark.parametrize("rough", [False, True])
def test_slopes_by_rows_are_those_of_the_matrix(case: Any, u_cal: float, rough: bool) -> None:
    rows = case()
    residual, group_variance = readings(rows)
    variance = group_variance[rows.group] + rows.extra
    total, _, _, out = gradient(rows, residual, group_variance, u_cal=u_cal, rough=rough)
    assert total == value(rows, residual, group_variance, u_cal=u_cal, rough=rough)
    apart = rows._replace(scan=1000 * rows.group + rows.scan)
    matrix = turned(apart, variance, u_cal, 0.05, 20.0, rough)
    turn = differences(np.eye(residual.size), apart.scan)
    inverse = turn.T @ linalg.cho_solve(linalg.cho_factor(matrix), turn)
    alpha = inverse @ residual
    by_v = 0.5 * (alpha**2 - np.diag(inverse))
    loss = 1e-12 / variance.min()
    np.testing.assert_allclose(out[0], alpha, rtol=1e-8, atol=loss * np.abs(residual).max())
    np.testing.assert_allclose(out[1], by_v, rtol=1e-8, atol=loss)


@pytest.mark.parametrize("case", [gaps, repeats, irregular, uneven, one_point])
@pytest.mark.parametrize(("u_cal", "rough"), [(0.0, True), (0.02, False), (1e3, False)])
def test_slopes_by_tau_and_ell(case: Any, u_cal: float, rough: bool) -> None:
    """Central differences of the extended-precision law, extrapolated once."""
    rows = case()
    residual, group_variance = readings(rows)
    variance = group_variance[rows.group] + rows.extra
    _, by_tau, by_ell, _ = gradient(rows, residual, group_variance, u_cal=u_cal, rough=rough)

    def slope(step: float, tau: float, ell: float) -> float:
        def at(h: float) -> float:
            return exact(
                rows, residual, variance, u_cal, 0.05 * (1 + h * tau), 20.0 * (1 + h * ell), rough
            )

        once, half = (at(step) - at(-step)) / 2, (at(step / 2) - at(-step / 2))
        return (4.0 * half - once) / (3.0 * step)

    step = 2e-3
    scale = 1e-7 * rows.angle.size
    assert 0.05 * by_tau == pytest.approx(slope(step, 1.0, 0.0), rel=1e-7, abs=scale * 1e-2)
    assert 20.0 * by_ell == pytest.approx(slope(step, 0.0, 1.0), rel=1e-7, abs=scale * 1e-2)


def test_every_set_of_parameters_starts_afresh() -> None:
    """The same sets in another order, and twice, give the same numbers bit for bit."""
    rows = repeats()
    residual, group_variance = readings(rows)
    groups = prepare_groups(rows.angle, rows.group, rows.scan)
    work = workspace(groups, False)
    x = np.array([[0.05, 20.0], [0.1, 5.0], [0.0, 1.0], [0.05, 20.0]])
    found = evaluate_sets(groups, work, residual, group_variance, 4e-4, x)
    assert found[0] == found[3]
    np.testing.assert_array_equal(
        evaluate_sets(groups, work, residual, group_variance, 4e-4, x[::-1].copy()), found[::-1]
    )


def test_order_of_rows_does_not_matter() -> None:
    rows = repeats()
    residual, group_variance = readings(rows)
    order = _seeded(3).permutation(residual.size)
    shuffled = Case(*(column[order] for column in rows))
    wanted = value(rows, residual, group_variance, u_cal=0.02)
    found = value(shuffled, residual[order], group_variance, u_cal=0.02)
    assert found == pytest.approx(wanted, rel=1e-12)


def dense_posterior(
    rows: Case, residual: Array, process: Process, at: Array, at_group: Array
) -> tuple[Array, Array]:
    """Mean and covariance of the process at other angles."""
    matrix = covariance(rows, rows.extra, process.u_cal, process.tau, process.ell, process.rough)

    def prior(a: Array, ga: Array, b: Array, gb: Array) -> Array:
        distance = np.abs(a[:, None] - b)
        same = ga[:, None] == gb
        return np.asarray(same * process.tau**2 * correlation(distance, process.ell, process.rough))

    cross = prior(at, at_group, rows.angle, rows.group)
    mean = cross @ linalg.solve(matrix, residual)
    spread = prior(at, at_group, at, at_group) - cross @ linalg.solve(matrix, cross.T)
    return mean, spread


@pytest.mark.parametrize("u_cal", [0.0, 0.02, 10.0])
@pytest.mark.parametrize("rough", [False, True])
def test_smoothed_discrepancy(u_cal: float, rough: bool) -> None:
    """At angles measured and not, beyond the scans, and in a group without readings."""
    rows = repeats()
    residual, group_variance = readings(rows)
    rows = rows._replace(extra=group_variance[rows.group])
    process = Process(0.05, 20.0, u_cal, rough)
    at = np.tile(np.linspace(-120.0, 120.0, 49), 20)
    at_group = np.repeat(np.arange(20), 49)
    smooth = smoother(
        rows.angle, rows.group, rows.scan, wanted_deg=at, wanted_group=at_group, rough=rough
    )
    mean, sd = smooth(residual, rows.extra, process)
    wanted, spread = dense_posterior(rows, residual, process, at, at_group)
    np.testing.assert_allclose(mean, wanted, rtol=1e-8, atol=1e-9 * max(1.0, u_cal))
    np.testing.assert_allclose(sd, np.sqrt(np.diag(spread)), rtol=1e-7)


@pytest.mark.parametrize("rough", [False, True])
def test_draws_have_the_law_of_the_process(rough: bool) -> None:
    """Means and covariances of thousands of draws in standard errors.

    `test_discrepancy_paths` does the same for draws given readings.
    """
    angle = np.array([-20.0, 0.0, 5.0, 5.0, 30.0, 5.0])
    group = np.array([0, 0, 0, 0, 0, 1])
    process, rng, n = Process(0.05, 10.0, 0.03, rough), _seeded(11), 8_000
    draws = np.array(
        [draw_prior_discrepancy(process, rng, theta_r_deg=angle, group=group) for _ in range(n)]
    )
    np.testing.assert_array_almost_equal(draws[:, 2], draws[:, 3], decimal=12)
    distance = np.abs(angle[:, None] - angle)
    spread = (group[:, None] == group) * 0.05**2 * correlation(distance, 10.0, rough)
    variance = np.diag(spread)
    assert np.all(np.abs(draws.mean(axis=0)) < 5.0 * np.sqrt(variance / n))
    error = np.sqrt((np.outer(variance, variance) + spread**2) / n)
    assert np.all(np.abs(np.cov(draws.T) - spread) < 5.0 * error)
