"""The drift over samples: a closed form, brute force over all three unknowns, and coverage."""

import numpy as np
import pytest
from scipy import stats

from pbrdf_bayes.batch.trend import infer_trend


@pytest.mark.parametrize("n", [5, 8, 30])
def test_samples_known_exactly_give_students_law(n):
    """Least squares, whose error has n - 3 degrees of freedom under a flat law of tau."""
    rng = np.random.default_rng(n)
    x = np.arange(n, dtype=float)
    y = 2.0 + 0.3 * x + rng.normal(0.0, 1.0, n)
    (b, _), (square,), *_ = np.polyfit(x, y, 1, full=True)
    sd = np.sqrt(square / (n - 3) / np.sum((x - x.mean()) ** 2))
    wanted = stats.t(n - 3, b, sd).ppf([0.025, 0.5, 0.975])
    found = infer_trend(x, y, np.zeros(n))
    assert found is not None
    got = (found.slope_q025, found.slope_median, found.slope_q975)
    assert got == pytest.approx(wanted.tolist(), abs=2e-3 * (wanted[2] - wanted[0]))


def test_unequal_uncertainties_against_brute_force():
    """The joint density on a grid of intercept, slope and spread."""
    x, y = np.array([0.0, 1.0, 3.0, 4.0, 5.0, 7.0]), np.array([1.0, 1.6, 1.1, 2.6, 2.2, 3.9])
    s = np.array([0.2, 0.5, 0.3, 0.8, 0.4, 0.6])
    found = infer_trend(x, y, s)
    a = np.linspace(-6.0, 9.0, 301)[:, None, None]
    b = np.linspace(-2.0, 2.8, 481)[:, None]
    edges = np.geomspace(1e-4, 30.0, 241)
    tau = np.concatenate([[0.0], edges])
    density = np.ones((a.size, b.size, tau.size))
    for xi, yi, si in zip(x, y, s, strict=True):
        density *= stats.norm.pdf(yi, a + b * xi, np.hypot(si, tau))
    marginal = np.trapezoid(density.sum(axis=0), tau, axis=1)
    total = np.cumsum(marginal) - 0.5 * marginal
    wanted = np.interp(np.array([0.025, 0.5, 0.975]) * marginal.sum(), total, b.ravel())
    got = (found.slope_q025, found.slope_median, found.slope_q975)
    assert got == pytest.approx(wanted.tolist(), abs=4e-3)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_no_trend_is_seldom_seen_and_a_clear_one_mostly(share):
    rng = np.random.default_rng(11)
    seen = {0.0: 0, 0.5: 0}
    for slope in seen:
        for _ in range(300):
            s = rng.uniform(0.5, 1.5, 12) * share
            y = slope * np.arange(12) + rng.normal(0.0, np.hypot(1.0, s))
            seen[slope] += infer_trend(np.arange(12), y, s).is_seen
    # 5 % of 300 with a standard error of 1.3 %; the flat law of tau leans to the wide side
    assert seen[0.0] <= 0.09 * 300
    assert seen[0.5] >= 0.8 * 300


def test_too_few_or_all_alike_say_nothing():
    assert infer_trend(range(4), [1.0, 2.0, 3.0, 4.0], [0.1] * 4) is None
    assert infer_trend(range(6), [1.0] * 6, [0.0] * 6) is None
