"""Verdicts on draws made by hand, against closed forms."""

from __future__ import annotations

import re
from math import asin, inf, pi

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from pbrdf_bayes.conform.conformity import (
    ACCEPT,
    REJECT,
    UNDECIDED,
    Measurand,
    count_probability,
    judge_limits,
    smallest_risk,
)
from pbrdf_bayes.specification import DecisionRule

SHAPE = (4, 2500)
N = 10_000.0


def of_normal(mean: float, sd: float, seed: int = 1, **limits: float) -> Measurand:
    rng = np.random.default_rng(seed)
    ends = {"lower": -inf, "upper": inf, **limits}
    return Measurand(mean + sd * rng.standard_normal((*SHAPE, 1)), ends["lower"], ends["upper"])


def test_probability_of_a_normal_measurand() -> None:
    for lower, upper in ((-inf, 1.0), (-0.5, inf), (-1.0, 2.0)):
        (found,), overall = judge_limits(
            [of_normal(0.3, 0.8, lower=lower, upper=upper)], DecisionRule(), ess_least=N
        )
        p = norm.cdf(upper, 0.3, 0.8) - norm.cdf(lower, 0.3, 0.8)
        assert found.probability.value == pytest.approx(p, abs=4.0 * found.probability.u)
        assert found.probability.u == pytest.approx((p * (1 - p) / N) ** 0.5, rel=0.25)
        assert overall.probability == found.probability


@pytest.mark.parametrize("rho", [-0.8, 0.0, 0.6, 0.95])
def test_limits_are_joint_not_multiplied(rho: float) -> None:
    """Both of two correlated measurands above zero: the orthant probability 1/4 + asin(rho)/2pi."""
    rng = np.random.default_rng(7)
    x = rng.multivariate_normal([0, 0], [[1, rho], [rho, 1]], size=SHAPE)
    limits = [Measurand(x[..., [i]], 0.0, inf) for i in range(2)]
    _, overall = judge_limits(limits, DecisionRule(), ess_least=N)
    assert overall.probability.value == pytest.approx(
        0.25 + asin(rho) / (2 * pi), abs=4 * overall.probability.u
    )
    (band,), _ = judge_limits([Measurand(x, 0.0, inf)], DecisionRule(), ess_least=N)
    assert band.probability == overall.probability  # a band is judged as a whole


def test_a_band_of_three_angles_against_the_normal_integral() -> None:
    angle = np.array([0.0, 10.0, 25.0])
    covariance = np.exp(-np.abs(angle[:, None] - angle) / 20.0)
    x = np.random.default_rng(3).multivariate_normal([0.2, 0.0, -0.4], covariance, size=SHAPE)
    (found,), _ = judge_limits([Measurand(x, -inf, 0.9)], DecisionRule(), ess_least=N)
    exact = multivariate_normal([0.2, 0.0, -0.4], covariance).cdf([0.9, 0.9, 0.9])
    assert found.probability.value == pytest.approx(exact, abs=4 * found.probability.u)
    assert found.probability.value < found.inside.min()
    assert found.worst == 0


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_monte_carlo_error_is_calibrated(phi: float) -> None:
    """Over 300 seeds, for independent draws and for a chain with autocorrelation."""
    inside, z = [], []
    for seed in range(300):
        e = np.random.default_rng(seed).standard_normal((4, 500))
        x = e.copy()
        for i in range(1, 500):
            x[:, i] = phi * x[:, i - 1] + (1 - phi**2) ** 0.5 * e[:, i]
        found = count_probability(x < 1.2, 2000.0)
        p = norm.cdf(1.2)
        inside.append(found.low <= p <= found.high)
        z.append((found.value - p) / found.u)
    assert np.mean(inside) > 0.92
    assert 0.85 < np.std(z) < 1.2


def test_no_count_is_a_bound_and_not_certainty() -> None:
    none = count_probability(np.zeros((4, 100), dtype=bool), 300.0)
    assert (none.value, none.u, none.low) == (0.0, 0.0, 0.0)
    assert none.high == pytest.approx(1.0 - 0.025 ** (1 / 300))


def test_largest_risk() -> None:
    rule = DecisionRule(rule="risk", max_consumer_risk=0.05, max_producer_risk=0.10)
    for mean, verdict in ((-3.0, ACCEPT), (0.0, UNDECIDED), (2.0, REJECT)):
        (found,), overall = judge_limits([of_normal(mean, 1.0, upper=0.0)], rule, ess_least=N)
        assert found.verdict == overall.verdict == verdict
        p = norm.cdf(0.0, mean, 1.0)
        if verdict == ACCEPT:
            assert found.consumer_risk == pytest.approx(1 - p, abs=0.002)
        if verdict == REJECT:
            assert found.producer_risk == pytest.approx(p, abs=0.01)
        assert bool(found.reason) == (verdict == UNDECIDED)


def test_what_few_draws_leave_open_is_undecided() -> None:
    m = of_normal(-1.8, 1.0, upper=0.0)  # p_c = 0.964
    (many,), _ = judge_limits([m], DecisionRule(), ess_least=N)
    (few,), _ = judge_limits([m], DecisionRule(), ess_least=150.0)
    assert (many.verdict, few.verdict) == (ACCEPT, UNDECIDED)
    assert "Monte Carlo" in few.reason


@pytest.mark.parametrize(
    ("ess", "finest", "risk", "said"),
    [
        (1000.0, 10_000.0, 0.0037, ""),  # 3.69 / n
        (1000.0, 10_000.0, 0.0030, "below 0.0037, and 0.003 is allowed: fit with --accuracy ref"),
        (1000.0, 10_000.0, 0.0001, "accuracy reference, and allow 0.00037 or more"),
        (10_000.0, 10_000.0, 0.0001, "is allowed: allow 0.00037 or more"),
    ],
)
def test_the_smallest_risk_that_draws_can_show(
    ess: float, finest: float, risk: float, said: str
) -> None:
    """No draw of n is outside: with a risk r that has the probability (1 - r)**n."""
    assert (1.0 - smallest_risk(ess)) ** ess == pytest.approx(0.025)
    m = of_normal(-9.0, 1.0, upper=0.0)
    rule = DecisionRule(max_consumer_risk=risk)
    (found,), overall = judge_limits([m], rule, ess_least=ess, ess_finest=finest)
    assert found.verdict == overall.verdict == (UNDECIDED if said else ACCEPT)
    assert said in found.reason
    assert found.reason == overall.reason


def test_no_higher_accuracy_is_advised_where_there_is_none() -> None:
    m = of_normal(0.0, 1.0)
    m = Measurand(m.values, -inf, float(np.quantile(m.values, 0.952)))
    (found,), _ = judge_limits([m], DecisionRule(), ess_least=N, ess_finest=N)
    assert found.verdict == UNDECIDED
    assert "no --accuracy makes more draws" in found.reason


def test_a_decision_more_likely_wrong_than_right_says_so() -> None:
    """Each of five independent angles is inside with 84 %, all of them with 42 %."""
    x = np.random.default_rng(2).standard_normal((*SHAPE, 5))
    rule = DecisionRule(rule="simple")
    (band,), overall = judge_limits([Measurand(x, -inf, 1.0)], rule, ess_least=N)
    assert band.verdict == overall.verdict == ACCEPT
    exact = 100.0 * (1.0 - norm.cdf(1.0) ** 5)
    said = re.search(r"consumer's risk of this decision is (\d+) %", band.remark)
    assert said is not None
    assert float(said[1]) == pytest.approx(exact, abs=2.5)
    assert overall.remark == band.remark
    (one,), _ = judge_limits([Measurand(x[..., :1], -inf, 1.0)], rule, ess_least=N)
    assert (one.verdict, one.remark) == (ACCEPT, "")


@pytest.mark.parametrize(
    ("mean", "simple", "guarded"),
    [(8.0, ACCEPT, ACCEPT), (9.5, ACCEPT, UNDECIDED), (10.5, REJECT, UNDECIDED),
     (12.0, REJECT, REJECT), (10.0, UNDECIDED, UNDECIDED)],
)  # fmt: skip
def test_simple_acceptance_and_guard_bands(mean: float, simple: str, guarded: str) -> None:
    """u = 0.5, upper limit 10: the guard band of 1.645 u ends at 9.18 and at 10.82."""
    m = of_normal(0.0, 0.5, upper=10.0)
    m = Measurand(m.values - m.values.mean() + mean, m.lower, m.upper)
    for rule, verdict in (("simple", simple), ("guard", guarded)):
        (found,), _ = judge_limits([m], DecisionRule(rule=rule), ess_least=N)
        assert found.verdict == verdict, rule
    stated = Measurand(m.values, m.lower, m.upper, guard=3.0)
    (found,), _ = judge_limits([stated], DecisionRule(rule="guard"), ess_least=N)
    assert found.guard.tolist() == [3.0]
    assert found.verdict != ACCEPT


def test_a_guard_band_of_1645_u_leaves_five_per_cent() -> None:
    """At the acceptance limit the specific consumer's risk of a normal law is 5 %."""
    m = of_normal(10.0 - 1.645 * 0.5, 0.5, upper=10.0)
    (found,), _ = judge_limits([m], DecisionRule(rule="guard"), ess_least=N)
    assert 1 - found.probability.value == pytest.approx(0.05, abs=4 * found.probability.u)


def test_a_reservation_bars_acceptance_and_not_rejection() -> None:
    good = of_normal(-5.0, 1.0, upper=0.0)
    bad = of_normal(5.0, 1.0, upper=0.0)
    reserved = Measurand(good.values, good.lower, good.upper, reservation="no true value")
    judged, overall = judge_limits([good, reserved], DecisionRule(), ess_least=N)
    assert [one.verdict for one in judged] == [ACCEPT, UNDECIDED]
    assert overall.verdict == UNDECIDED
    _, overall = judge_limits([bad, reserved], DecisionRule(), ess_least=N)
    assert overall.verdict == REJECT
    _, overall = judge_limits([reserved], DecisionRule(), ess_least=N)
    assert (overall.verdict, overall.reason) == (UNDECIDED, "no limit can be judged")
