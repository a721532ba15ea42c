"""Every verdict, made to pass and to fire."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.map_fit import MapResult, Optimum
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.residuals import Residuals
from pbrdf_bayes.inference.sampling.sampling import Draws
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import DiscrepancySize
from pbrdf_bayes.verdict import overall_verdict
from pbrdf_bayes.verdicts.applicability import Repeatability
from pbrdf_bayes.verdicts.common_misfit import CommonMisfit
from pbrdf_bayes.verdicts.diagnostics import (
    Identifiability,
    assess_identifiability,
    run_diagnostics,
)
from pbrdf_bayes.words import say

Array = NDArray[np.float64]
NAMES = ("n", "k", "sigma_n0", "rho0")


def good_draws() -> Draws:
    four = np.full(4, 5000.0)
    return Draws(
        x=np.zeros((8, 10, 4)), log_prob=np.zeros((8, 10)), ensemble=np.repeat(np.arange(4), 2),
        acceptance=np.full(8, 0.5), ess_bulk=four, ess_tail=four, rhat=np.full(4, 1.001),
        mcse_mean=np.full(4, 1e-3), method="emcee", converged=True, n_steps=1000, n_burn=200, thin=1,
        autocorrelation_time=5.0, k_hat=0.3, n_evaluations=8000, moves="some",
    )  # fmt: skip


def optima(*gaps: float) -> MapResult:
    found = [Optimum(np.full(4, float(i)), 100.0 - gap, 4) for i, gap in enumerate((0.0, *gaps))]
    return MapResult(tuple(found), 16, 0)


def residuals(lag1: float = 0.05) -> Residuals:
    one = np.array([0.01])
    return Residuals(np.zeros(10), 0.01, lag1, one, one, np.array([lag1]))


def identified(
    honest: tuple[float, ...] = (0.99,) * 4,
    bound: tuple[float, ...] = (0.0,) * 4,
    share: float = 1.0,
) -> Identifiability:
    return Identifiability(
        NAMES, np.arange(4), np.full(4, 0.99), np.array(honest), share, np.array(bound)
    )


def holdout(rms: float, coverage: float) -> Holdout:
    none = np.zeros(0)
    return Holdout("a", "It says so.", none.astype(str), none, none, none, rms, coverage, 0.1, ())


def repeats(dex: float) -> Repeatability:
    return Repeatability(dex, "stated")


GOOD: dict[str, Any] = {
    "config": pb.RunConfig(), "draws": good_draws(), "optima": optima(), "residuals": residuals(),
    "best_rms_dex": 0.0087, "repeatability": repeats(0.0087), "identifiability": identified(),
    "covered": (900, 1000), "holdout": holdout(0.01, 0.9),
}  # fmt: skip


def verdicts(**changes: Any) -> dict[str, Check]:
    return {d.name: d for d in run_diagnostics(**(GOOD | changes))}


def test_noise_is_no_misfit() -> None:
    """Readings of 60 % noise about the right curve, and of 6 %."""
    assert verdicts(best_rms_dex=0.275, repeatability=repeats(0.269))["misfit"].verdict == "PASS"
    assert verdicts(best_rms_dex=0.027, repeatability=repeats(0.026))["misfit"].verdict == "PASS"


def test_bands_with_a_discrepancy_of_new_scans_may_hold_all_fitted_readings() -> None:
    size = DiscrepancySize(0.01, 20.0, 160.0, 0.01, 0.004, 1.0, {"n": 0.1}, {"n": 0.05})
    assert verdicts(covered=(990, 1000), discrepancy=size)["coverage"].verdict == "PASS"
    assert verdicts(covered=(750, 1000), discrepancy=size)["coverage"].verdict == "WARN"


def test_a_good_run_passes_everything_without_advice() -> None:
    found = verdicts()
    assert list(found) == [
        "misfit", "residual_correlation", "rhat", "ess", "chain_length", "modes", "identifiability",
        "bounds", "coverage", "holdout",
    ]  # fmt: skip
    for diagnostic in found.values():
        assert diagnostic.verdict == "PASS", diagnostic
        assert diagnostic.advice == ""
        assert diagnostic.statement.endswith(".")
        assert diagnostic.title


FIRING: list[tuple[str, dict[str, Any], str]] = [
    ("misfit", {"best_rms_dex": 0.03}, "WARN"),
    ("misfit", {"best_rms_dex": 0.06, "repeatability": repeats(0.02)}, "WARN"),
    ("misfit", {"best_rms_dex": 0.275, "repeatability": repeats(0.2)}, "FAIL"),
    ("misfit", {"best_rms_dex": 0.114, "repeatability": repeats(0.01)}, "FAIL"),
    ("dhr_misfit", {"dhr_misfit": 0.12}, "WARN"),
    ("dhr_misfit", {"dhr_misfit": 0.4}, "FAIL"),
    ("common_misfit", {"common": CommonMisfit(0.9, 0.003, 4, 2.0)}, "WARN"),
    ("residual_correlation", {"residuals": residuals(0.3)}, "WARN"),
    ("residual_correlation", {"residuals": residuals(0.97)}, "FAIL"),
    ("rhat", {"draws": replace(good_draws(), rhat=np.array([1.0, 1.0, 1.02, 1.0]))}, "FAIL"),
    ("ess", {"draws": replace(good_draws(), ess_bulk=np.array([5e3, 900.0, 5e3, 5e3]))}, "FAIL"),
    ("ess", {"draws": replace(good_draws(), ess_tail=np.array([5e3, 5e3, 5e3, 20.0]))}, "FAIL"),
    ("chain_length", {"draws": replace(good_draws(), autocorrelation_time=40.0)}, "FAIL"),
    ("modes", {"optima": optima(3.0)}, "WARN"),
    ("identifiability", {"identifiability": identified((0.99, 0.3, 0.99, 0.99))}, "WARN"),
    ("bounds", {"identifiability": identified(bound=(0.9, 0.0, 0.0, 0.0))}, "FAIL"),
    ("bounds", {"identifiability": replace(identified(), optimum_at=("rho0",))}, "FAIL"),
    ("coverage", {"covered": (750, 1000)}, "WARN"),
    ("coverage", {"covered": (990, 1000)}, "WARN"),
    ("holdout", {"holdout": holdout(0.07, 0.9)}, "WARN"),
    ("holdout", {"holdout": holdout(0.2, 0.9)}, "FAIL"),
    ("holdout", {"holdout": holdout(0.01, 0.5)}, "WARN"),
]


@pytest.mark.parametrize(("name", "changes", "verdict"), FIRING)
def test_each_verdict_fires_with_advice(name: str, changes: dict[str, Any], verdict: str) -> None:
    found = verdicts(**changes)
    assert found[name].verdict == verdict, found[name]
    assert found[name].advice.endswith((".", ")."))
    others = {other: d.verdict for other, d in found.items() if other != name}
    assert set(others.values()) == {"PASS"}, others


def test_every_diagnostic_is_seen_to_fire() -> None:
    everything = verdicts(dhr_misfit=0.01, common=CommonMisfit(0.0, 0.5, 4, 2.0))
    assert {name for name, *_ in FIRING} == set(everything)


def test_values_and_thresholds_are_reported() -> None:
    found = verdicts(
        best_rms_dex=0.12, draws=replace(good_draws(), rhat=np.array([1.0, 1.03, 1.0, 1.0])),
        identifiability=identified((0.99, 0.2, 0.4, 0.9), share=0.05), residuals=residuals(0.9),
    )  # fmt: skip
    assert found["misfit"].value == 0.12
    for number in ("0.120", "32", "0.009", say("repeats.stated")):  # 10^0.12 = 1.318
        assert number in found["misfit"].statement
    assert (found["rhat"].value, found["rhat"].threshold) == (1.03, 1.01)
    assert found["identifiability"].value == 0.2
    basis = say("identifiability.basis", percent=5.0)
    weak = say("identifiability.weak", listed="k (0.20), sigma_n0 (0.40)", basis=basis)
    assert found["identifiability"].statement == weak
    assert "4.5" in found["residual_correlation"].advice  # 0.05^-1/2


def test_a_rival_far_below_is_no_rival() -> None:
    found = verdicts(optima=optima(20.0))["modes"]
    assert found.verdict == "PASS"
    assert math.isnan(found.value)


def test_modes_are_told_by_the_parameters_of_the_sample_wherever_they_stand() -> None:
    """Column 0 is fixed, column 3 a noise; the optima differ in column 2 alone."""
    found = identified()
    some = replace(
        found,
        names=NAMES[1:3],
        columns=np.array([1, 2]),
        honest=found.honest[1:3],
        bound_share=np.zeros(2),
    )
    draws = np.random.default_rng(1).normal(size=(8, 10, 4)) * [0.0, 1.0, 0.1, 1.0]
    places = [np.zeros(4), np.array([0.0, 0.0, 5.0, 0.0]), np.array([0.0, 0.0, 0.0, 50.0])]
    peaks = tuple(Optimum(x, 100.0 - i, 4) for i, x in enumerate(places))
    told = verdicts(
        identifiability=some, draws=replace(GOOD["draws"], x=draws), optima=MapResult(peaks, 16, 0)
    )["modes"]
    assert told.verdict == "WARN"
    assert told.value == 1.0


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_weights_of_separate_modes_are_stated(share: float) -> None:
    """Modes at 0 and 1, ten of their widths apart; each of eight chains has the same share.

    At equal weights the standard deviation of all draws is half the distance: that is no reason to
    call the modes one.
    """
    rng = np.random.default_rng(1)
    centre = (np.arange(200) < 200 * share).astype(float)[None, :, None]
    both = replace(good_draws(), x=centre + 0.1 * rng.standard_normal((8, 200, 4)))
    found = verdicts(draws=both, optima=optima(3.0))["modes"]
    error = 100.0 * math.sqrt(share * (1.0 - share) / 5000.0)
    assert found.verdict == "WARN"
    assert say("modes.share", percent=100.0 * share, error=error) in found.statement


def test_a_mode_without_draws_is_said_to_have_no_known_weight() -> None:
    assert say("modes.no_draw") in verdicts(optima=optima(3.0))["modes"].statement


def test_two_optima_on_one_flat_ridge_are_no_rivals() -> None:
    """Draws uniform between and beyond them."""
    rng = np.random.default_rng(1)
    ridge = replace(good_draws(), x=rng.uniform(-0.2, 1.2, (8, 200, 1)) * np.ones(4))
    assert verdicts(draws=ridge, optima=optima(0.5))["modes"].verdict == "PASS"


def test_importance_draws_have_their_own_check() -> None:
    found = verdicts(draws=replace(good_draws(), method="psis", autocorrelation_time=math.nan))
    assert "chain_length" not in found
    assert found["k_hat"].verdict == "PASS"
    assert found["k_hat"].value == 0.3


def test_without_brdf_or_holdout_their_checks_are_left_out() -> None:
    found = verdicts(
        best_rms_dex=math.nan, residuals=residuals(math.nan), covered=(0, 0), holdout=None
    )
    assert set(found) == {"rhat", "ess", "chain_length", "modes", "identifiability", "bounds"}


def test_values_that_are_not_numbers_do_not_pass() -> None:
    """A statistic that could not be computed is no evidence of health."""
    stuck = replace(
        good_draws(), rhat=np.full(4, math.nan), ess_bulk=np.full(4, math.nan),
        autocorrelation_time=math.nan,
    )  # fmt: skip
    found = verdicts(draws=stuck)
    for name in ("rhat", "ess", "chain_length"):
        assert found[name].verdict == "FAIL", found[name]


def test_the_worst_verdict_counts() -> None:
    assert overall_verdict(["PASS", "WARN", "PASS"]) == "WARN"
    assert overall_verdict(["FAIL", "WARN", "PASS"]) == "FAIL"
    assert overall_verdict(["PASS", "SKIP"]) == "PASS"
    assert overall_verdict([]) == "PASS"


def test_draws_of_the_prior_are_not_identified(small_posterior: Posterior) -> None:
    """Contraction 1 - var/var: zero within five errors of a variance from 20 000 draws."""
    draws = small_posterior.sample_prior(np.random.default_rng(1), 20_000)
    found = assess_identifiability(small_posterior, draws, draws, 1.0)
    assert found.names == NAMES
    # kurtosis of the four priors is below 9
    assert np.all(np.abs(found.contraction) < 5.0 * math.sqrt(8.0 / 20_000))
    np.testing.assert_array_equal(found.contraction, found.honest)
    assert np.all(found.bound_share < 0.02)  # 1 % on either side, the fuller one


def test_narrow_draws_are_identified_and_tempered_ones_less(small_posterior: Posterior) -> None:
    rng = np.random.default_rng(2)
    prior = small_posterior.to_coordinates(
        small_posterior.prior_quantile(np.tile((np.arange(4000)[:, None] + 0.5) / 4000, 7))
    )
    middle, sd = prior.mean(axis=0), prior.std(axis=0)
    narrow, wide = (
        small_posterior.from_coordinates(middle + f * sd * rng.standard_normal((5000, 7)))
        for f in (0.01, 0.6)
    )
    found = assess_identifiability(small_posterior, narrow, wide, 0.1)
    # a variance of 5000 normal draws: 2 %
    np.testing.assert_allclose(1.0 - found.contraction, 0.01**2, rtol=0.1)
    np.testing.assert_allclose(1.0 - found.honest, 0.6**2, rtol=0.1)
    assert found.share == 0.1


def test_draws_at_a_bound_are_noticed(small_posterior: Posterior) -> None:
    draws = small_posterior.sample_prior(np.random.default_rng(3), 4000)
    draws[:, 0] = 2.99  # n pressed against 3
    draws[:, 1] = 1e-6  # k at zero is physical: no absorption
    draws[:, 2] = 0.9999  # sigma_N0 at one
    found = assess_identifiability(small_posterior, draws, draws, 1.0)
    assert found.bound_share[0] == 1.0
    assert found.bound_share[1] == 0.0
    assert found.bound_share[2] == 1.0
    assert found.bound_share[3] < 0.02


def pressed(posterior: Posterior, **optimum: float) -> Identifiability:
    """Narrow draws far from any bound, and an optimum with these values."""
    middle = np.array([1.5, 0.2, 0.4, 0.5, 0.02, 0.02, 5e-4])
    draws = middle * (1.0 + 1e-3 * np.random.default_rng(3).standard_normal((4000, 7)))
    x = middle.copy()
    for name, value in optimum.items():
        x[posterior.parameter_names.index(name)] = value
    return assess_identifiability(posterior, draws, draws, 1.0, (middle, x))


@pytest.mark.parametrize(
    ("name", "at", "off"),
    [("n", 3.0, 2.99), ("sigma_n0", 1.0, 0.99), ("rho0", 3.92, 3.85), ("rho0", 1e-3, 1.1e-3)],
)
def test_an_optimum_at_a_bound_counts_where_no_draw_is(
    small_posterior: Posterior, name: str, at: float, off: float
) -> None:
    """rho0 moves in its logarithm: 3.92 of 4 is a bound that the readings do not tell from 4."""
    found = pressed(small_posterior, **{name: at})
    assert found.bound_share.max() == 0.0
    assert found.at_bound == (name,)
    said = verdicts(identifiability=found)["bounds"]
    assert (said.verdict, said.value) == ("FAIL", 1.0)
    assert say("bounds.optimum", name=name, percent=0.0) in said.statement
    assert pressed(small_posterior, **{name: off}).at_bound == ()


def test_an_optimum_at_a_bound_says_nothing_of_what_is_not_identified(
    small_posterior: Posterior,
) -> None:
    draws = small_posterior.sample_prior(np.random.default_rng(1), 4000)
    x = np.array([3.0, 0.2, 1.0, 4.0, 0.02, 0.02, 5e-4])
    assert assess_identifiability(small_posterior, draws, draws, 1.0, (x,)).at_bound == ()


def test_k_at_zero_is_a_dielectric_and_no_bound(small_posterior: Posterior) -> None:
    found = pressed(small_posterior, k=1e-12)
    assert found.at_bound == ()
    said = verdicts(identifiability=found)["bounds"]
    assert said.verdict == "PASS"
    assert say("bounds.dielectric") in said.statement
    assert say("bounds.dielectric") not in verdicts()["bounds"].statement


def test_a_small_value_that_is_well_known_is_not_at_the_bound(small_posterior: Posterior) -> None:
    """sigma_N0 of a black paint, 0.0086 with an error of a tenth of it, on a prior from 0 to 1."""
    rng = np.random.default_rng(3)
    draws = small_posterior.sample_prior(rng, 4000)
    draws[:, 2] = rng.normal(0.0086, 0.0009, 4000)
    assert assess_identifiability(small_posterior, draws, draws, 1.0).bound_share[2] == 0.0
    draws[:, 2] = rng.exponential(0.002, 4000)  # pressed against zero
    assert assess_identifiability(small_posterior, draws, draws, 1.0).bound_share[2] > 0.9


@pytest.mark.parametrize(
    ("covered", "verdict"),
    [
        ((8, 8), "PASS"),
        ((1, 1), "PASS"),
        ((6, 10), "PASS"),
        ((4, 10), "WARN"),
        ((160, 160), "WARN"),
    ],
)
def test_few_readings_say_little_about_coverage(covered: tuple[int, int], verdict: str) -> None:
    """P(8 of 8) = 0.43, P(<= 6 of 10) = 0.013, P(<= 4 of 10) = 1e-4, P(160 of 160) = 5e-8."""
    assert verdicts(covered=covered)["coverage"].verdict == verdict


def test_correlated_readings_are_fewer_readings() -> None:
    """72 of 100 readings is rare; of five effective readings it is one that missed."""
    assert verdicts(covered=(72, 100))["coverage"].verdict == "WARN"
    few = residuals(lag1=0.905)  # (1 - 0.905)/(1 + 0.905) of the number, five
    assert verdicts(covered=(72, 100), residuals=few)["coverage"].verdict == "PASS"


def test_scans_of_one_point_have_no_neighbours_and_no_nan_in_their_words() -> None:
    found = verdicts(residuals=residuals(math.nan), repeatability=repeats(math.nan))
    assert "residual_correlation" not in found
    assert not any("nan" in d.statement for d in found.values())


def test_a_prediction_that_announces_its_uncertainty_is_no_failure() -> None:
    """0.2 dex missed by a band 1 dex wide that covers 90 %; not so by one of 0.1 dex."""
    vague = replace(holdout(0.2, 0.9), width_dex=1.0)
    assert verdicts(holdout=vague)["holdout"].verdict == "PASS"
    assert verdicts(holdout=holdout(0.2, 0.9))["holdout"].verdict == "FAIL"
