"""The spread between samples: closed forms, brute force, and coverage by simulation."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import dblquad, quad
from scipy.optimize import brentq

from pbrdf_bayes.batch.between_samples import infer_spread
from pbrdf_bayes.batch.control_chart import draw_limits
from pbrdf_bayes.errors import DataError


@pytest.mark.parametrize("n", [3, 4, 8, 40])
def test_samples_known_exactly_give_the_ordinary_standard_deviation(n):
    """SS / tau^2 is then chi-squared with n - 2 degrees of freedom: p(tau) ~ tau^-(n-1) exp(..)."""
    y = np.random.default_rng(n).normal(5.0, 2.0, n)
    found = infer_spread(y, np.zeros(n))
    assert found.sd_mode == pytest.approx(y.std(ddof=1), rel=1e-6)
    square = np.sum((y - y.mean()) ** 2)
    for p, value in ((0.025, found.sd_q025), (0.5, found.sd_median), (0.975, found.sd_q975)):
        assert value == pytest.approx(np.sqrt(square / stats.chi2(n - 2).isf(p)), rel=2e-3)
    # the mean is then Student's t with n - 2 degrees of freedom
    scale = np.sqrt(square / (n - 2) / n)
    wanted = stats.t(n - 2, y.mean(), scale).ppf([0.025, 0.5, 0.975])
    mean = (found.mean_q025, found.mean_median, found.mean_q975)
    assert mean == pytest.approx(wanted.tolist(), abs=5e-3 * (wanted[2] - wanted[0]))


@pytest.mark.parametrize("s", [0.3, 1.0, 4.0])
def test_equal_uncertainties_come_off_the_variance(s):
    y = np.random.default_rng(1).normal(0.0, 2.0, 12)
    found = infer_spread(y, np.full(12, s))
    assert found.sd_mode == pytest.approx(np.sqrt(max(y.var(ddof=1) - s**2, 0.0)), abs=1e-6)
    square = np.sum((y - y.mean()) ** 2)

    def density(tau: float) -> float:
        v = s**2 + tau**2
        return v**-5.5 * np.exp(-0.5 * square / v)

    total = quad(density, 0.0, np.inf, epsabs=0.0, epsrel=1e-10)[0]

    def excess(tau: float, p: float) -> float:
        return quad(density, 0.0, tau, epsabs=0.0, epsrel=1e-10)[0] / total - p

    for p, value in ((0.025, found.sd_q025), (0.5, found.sd_median), (0.975, found.sd_q975)):
        assert value == pytest.approx(brentq(excess, 1e-6, 50.0, args=(p,)), rel=2e-3)


def test_unequal_uncertainties_against_brute_force():
    """The joint density of mu and tau, integrated over both by an independent rule."""
    y, s = np.array([1.0, 2.5, 2.0, 4.0]), np.array([0.2, 0.9, 0.4, 1.5])
    found = infer_spread(y, s)

    def joint(mu: float, tau: float) -> float:
        return float(np.prod(stats.norm.pdf(y, mu, np.hypot(s, tau))))

    def mass(high: float) -> float:
        return dblquad(joint, 0.0, high, -60.0, 60.0, epsabs=1e-10, epsrel=1e-7)[0]

    tail = 2.0e3  # beyond it: tau^-3, 1e-6 of the whole
    mu = np.linspace(-40.0, 45.0, 6001)
    tau = np.geomspace(1e-4, tail, 1501)
    grid = np.ones((tau.size, mu.size))
    for value, u in zip(y, s, strict=True):
        grid *= stats.norm.pdf(value, mu[None, :], np.hypot(u, tau)[:, None])
    marginal = np.trapezoid(grid, mu, axis=1)
    total = np.cumsum(np.concatenate([[0.0], np.diff(tau) * 0.5 * (marginal[1:] + marginal[:-1])]))
    wanted = np.interp(np.array([0.025, 0.5, 0.975]) * total[-1], total, tau)
    assert (found.sd_q025, found.sd_median) == pytest.approx(wanted[:2].tolist(), rel=0.01)
    assert found.sd_q975 == pytest.approx(wanted[2], rel=0.03)
    half = np.interp(1.0, tau, total) / np.interp(3.0, tau, total)
    assert half == pytest.approx(mass(1.0) / mass(3.0), rel=1e-3)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(200):
        s = rng.uniform(0.2, 2.0, 10)
        y = 3.0 + rng.normal(0.0, 1.0, 10) + rng.normal(0.0, s)
        found = infer_spread(y, s)
        inside.append(found.sd_q025 <= 1.0 <= found.sd_q975)
    # 95 % of 200 with a standard error of 1.5 %; the flat prior leans to large tau
    assert 0.90 <= np.mean(inside) <= 1.0


def test_no_spread_beyond_the_uncertainties_is_likeliest_zero():
    found = infer_spread([1.0, 1.01, 0.99, 1.0], [0.5] * 4)
    assert found.sd_mode == 0.0
    assert found.sd_q025 < 0.05 < found.sd_q975


@pytest.mark.parametrize(
    ("y", "s", "words"),
    [([1.0, 2.0], [0.1, 0.1], "at least 3"), ([1.0] * 3, [0.0] * 3, "no spread"),
     ([1.0, 2.0, np.nan], [0.1] * 3, "finite"), ([1.0, 2.0, 3.0], [0.1, 0.1, -1.0], "finite")],
)  # fmt: skip
def test_what_cannot_be_inferred_is_refused(y, s, words):
    with pytest.raises(DataError, match=words):
        infer_spread(y, s)


def test_limits_of_a_steady_process_are_those_of_its_scatter():
    rng = np.random.default_rng(3)
    x = rng.normal(10.0, 0.5, 20_000)
    chart = draw_limits(x, np.zeros(x.size), np.ones(x.size, bool))
    assert (chart.high - chart.centre) / 3.0 == pytest.approx(0.5, rel=0.02)
    assert np.mean(chart.beyond) == pytest.approx(0.0027, abs=0.0012)


def test_uncertainties_do_not_count_twice():
    """Equal ones are part of the scatter from sample to sample already: limits as without them."""
    x = np.random.default_rng(4).normal(0.0, 1.0, 50)
    bare = draw_limits(x, np.zeros(50), np.ones(50, bool))
    chart = draw_limits(x, np.full(50, 0.3), np.ones(50, bool))
    np.testing.assert_allclose(chart.sample_high, bare.sample_high, rtol=1e-12)
    wide = draw_limits(x, np.full(50, 3.0), np.ones(50, bool))
    assert wide.sigma_between == 0.0
    reach = 0.5 * (wide.sample_high - wide.sample_low)
    assert np.all((reach > 9.0 * np.sqrt(50 / 49)) & (reach < 9.3))


def test_limits_of_a_sample_are_made_from_the_others():
    """Written out sample by sample, with an even number of them and one that is not counted."""
    rng = np.random.default_rng(5)
    x, u = rng.normal(3.0, 1.0, 13), rng.uniform(0.2, 1.0, 13)
    counted = np.arange(13) != 4
    chart = draw_limits(x, u, counted)
    for i in range(13):
        others = [j for j in range(13) if counted[j] and j != i]
        y, v = x[others], u[others] ** 2
        r = len(others) - 1
        rho = (np.sqrt(3) / 2 + np.pi / 12 - 1) / (np.pi / 2 - 1)
        nu = 0.5 / ((np.pi / 2 - 1) / r * (1 + 2 * rho * (r - 1) / r))
        s2 = (np.mean(np.abs(y[1:] - y[:-1])) / 1.1283791670955126 * (1 - 0.25 / nu)) ** 2
        total = max(s2 - v.mean(), 0.0) + u[i] ** 2 + max(s2, v.mean()) / len(others)
        nu *= max(1.0, total / max(s2, 0.5 * v.mean())) ** 2
        reach = stats.t(nu).ppf(stats.norm.cdf(3.0)) * np.sqrt(total)
        wanted = (y.mean() - reach, y.mean() + reach)
        assert (chart.sample_low[i], chart.sample_high[i]) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("n", "share"), [(6, 0.0), (6, 0.5), (10, 0.5), (20, 0.0), (20, 2.0)])
def test_steady_samples_are_seldom_beyond(n, share):
    """Nominally 0.27 %, here within what 3000 charts tell: scatter is known from few ranges."""
    rng = np.random.default_rng(n)
    rates = []
    for _ in range(3000):
        u = rng.uniform(0.5, 1.5, n) * share
        x = rng.normal(0.0, 1.0, n) + rng.normal(0.0, 1.0, n) * u
        rates.append(draw_limits(x, u, np.ones(n, bool)).beyond.mean())
    assert np.mean(rates) <= 0.0065


@pytest.mark.parametrize(
    ("n", "shifts", "least"), [(8, (10.0,), 0.9), (12, (8.0,), 0.95), (20, (8.0, 8.0), 0.9), (20, (8.0, -8.0), 0.9)]
)  # fmt: skip
def test_samples_that_stick_out_do_not_hide_themselves(n, shifts, least):
    """In limits that are made with them, they would, mostly: the moving range grows by them."""
    rng = np.random.default_rng(n + len(shifts))
    found, hidden = [], []
    for _ in range(200):
        x = rng.normal(0.0, 1.0, n)
        at = rng.choice(n, len(shifts), replace=False)
        x[at] += shifts
        found.append(draw_limits(x, np.zeros(n), np.ones(n, bool)).beyond[at].mean())
        sigma = np.abs(np.diff(x)).mean() / 1.128
        hidden.append(np.mean(np.abs(x - x.mean())[at] < 3.0 * sigma))
    assert np.mean(found) >= least
    assert n > 8 or np.mean(hidden) > 0.5


def test_a_sample_that_is_not_counted_is_held_against_the_others():
    x = [1.0, 1.2, 0.9, 1.1, 1.0, 50.0]
    chart = draw_limits(x, [0.1] * 6, [True] * 5 + [False])
    assert chart.centre == pytest.approx(1.04)
    assert chart.beyond.tolist() == [False] * 5 + [True]
    assert chart.high < 2.0
    alike = draw_limits(x, [0.1] * 6, [True] * 6)  # counted, it is left out all the same
    assert (alike.centre, alike.high) == pytest.approx((chart.centre, chart.high))
    assert alike.beyond.tolist() == [False] * 5 + [True]
    assert draw_limits(x[:3], [0.1] * 3, [True] * 3) is None
