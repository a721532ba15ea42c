"""Whether the parameters may be read as those of a material: each criterion by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pbrdf_bayes import (
    GREEN_PAINT,
    Measurement,
    RunConfig,
    build_posterior,
    simulate_measurement,
)
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.holdout_cases import why_no_angle_left_out
from pbrdf_bayes.verdicts.applicability import (
    Repeatability,
    find_repeatability,
    held_out_rms,
    judge_applicability,
    list_assumed,
    list_only_bounded,
)
from pbrdf_bayes.words import NOT_CONSTANTS, say


def judge(rms=0.01, repeatability=0.01, at_bound=None, held_out=0.01, kind="angle", assumed=()):
    none = np.zeros(0)
    held = Holdout(
        "DHR", "", np.zeros(0, np.str_), none, none, none, held_out, 0.9, 0.1, (), kind=kind
    )
    return judge_applicability(
        best_rms_dex=rms, repeatability=Repeatability(repeatability, "stated"),
        at_bound=[at_bound] if at_bound else [], held_out=held_out_rms([held]), assumed=assumed,
    )  # fmt: skip


def test_nothing_speaks_against_a_good_fit():
    found = judge()
    assert (found.verdict, found.reasons) == ("applies", ())


def test_three_times_the_repeatability_is_descriptive_only():
    assert judge(rms=0.0299).verdict == "applies"
    found = judge(rms=0.0301)
    assert found.verdict == "descriptive only"
    assert NOT_CONSTANTS in found.statement


@pytest.mark.parametrize("kind", ["angle", "polarization"])
def test_readings_left_out_that_are_badly_predicted(kind):
    assert judge(held_out=0.099, kind=kind).verdict == "applies"
    assert judge(held_out=0.101, kind=kind).verdict == "does not apply"


def test_few_readings_predict_badly_without_speaking_against_the_model():
    few = {
        "best_rms_dex": 0.01,
        "repeatability": Repeatability(0.01, "inferred", 0.01),
        "at_bound": [],
    }
    held = {"held_out": {"angle": 0.2}}
    assert judge_applicability(**few, **held, expected={"angle": 0.21}).verdict == "applies"
    assert judge_applicability(**few, **held, expected={"angle": 0.19}).verdict == "does not apply"


@pytest.mark.parametrize("name", PHYSICAL)
def test_one_of_the_four_on_its_bound(name):
    found = judge(at_bound=name)
    assert found.verdict == "does not apply"
    assert name in found.statement


def test_an_effect_on_its_bound_says_nothing_about_n_and_k():
    assert judge(at_bound="narrowing").verdict == "applies"


def test_readings_without_noise_and_readings_without_repeats():
    assert judge(rms=0.01, repeatability=0.0).verdict == "descriptive only"
    assert judge(rms=0.001, repeatability=0.0).verdict == "applies"
    assert judge(rms=0.5, repeatability=float("nan")).verdict == "applies"
    assert judge(rms=float("nan"), repeatability=float("nan")).verdict == "applies"


@pytest.fixture
def measurement() -> Measurement:
    return simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=(20.0,))


@pytest.mark.parametrize("repeated", [True, False])
def test_a_stated_sigma_that_is_more_than_the_scatter_of_neighbours(measurement, repeated: bool):
    """Of repeats or of the laboratory: their mean is smooth where whole scans differ by a gain."""
    plain = replace(measurement.brdf, u_value=np.full(len(measurement.brdf), np.nan))
    inferred = find_repeatability(replace(measurement, brdf=plain), 0.01)
    assert inferred.dex == pytest.approx(0.01)
    assert inferred.source == "inferred"
    relative = np.where(np.arange(len(plain)) % 2, 0.05, 0.15)
    told = np.full(len(plain), repeated)
    brdf = replace(plain, u_value=relative * plain.value, repeated=told)
    found = find_repeatability(replace(measurement, brdf=brdf), 0.01)
    assert found.dex == pytest.approx(np.sqrt(np.mean(relative**2)) / np.log(10.0))
    assert found.source == "stated"
    small = find_repeatability(replace(measurement, brdf=brdf), 0.5)
    assert small.dex == pytest.approx(0.5)
    assert small.source == "above_stated"


def test_the_statement_says_which_repeatability_was_used():
    said = judge(rms=0.5).statement
    for number in ("0.500", "0.010", say("repeats.stated")):
        assert number in said


def test_angles_that_were_not_left_out_are_not_passed_over_in_silence():
    found = judge(kind="polarization")
    assert found.held_out == say("applicability.untested", why="")
    (caveat,) = found.caveats
    assert caveat.lower() == f"{found.held_out}."
    assert found.statement.endswith(caveat)
    assert caveat in judge(kind="polarization", rms=0.5).statement
    assert judge().held_out == say("applicability.tested", rms=0.01)
    assert judge().caveats == ()
    measurement = simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=(20.0, 60.0))
    assert why_no_angle_left_out(measurement, "recipe") == say("applicability.not_asked")
    one = simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=(20.0,))
    assert why_no_angle_left_out(one, "all") == say("applicability.one_angle")
    assert why_no_angle_left_out(measurement, "all") == ""


def test_a_dielectric_has_a_limit_of_k_and_no_value():
    assert list_only_bounded(("sigma_n0",)) == ()
    found = judge(assumed=list_only_bounded(("k",)))
    assert found.verdict == "applies"
    assert found.caveats == (say("assumed.k_bounded"),)


def test_what_was_assumed_is_no_finding():
    """n fixed, k by a prior of the configuration that the readings hardly narrow."""
    measurement = simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=(20.0,))
    priors = {
        "n": {"kind": "fixed", "value": 1.5},
        "k": {"kind": "normal", "mean": 0.2, "sd": 0.01},
        "rho0": {"kind": "lognormal", "median": 0.5, "factor": 2.0},
    }
    specs = build_posterior(measurement, RunConfig(priors=priors)).specs
    told = {"k": 0.1, "sigma_n0": 0.1, "rho0": 0.99}
    assumed = list_assumed(specs, priors, told)
    assert assumed == (
        say("assumed.fixed", name="n", value=1.5),
        say("assumed.prior", name="k", prior="Normal(0.2, 0.01) on [0, 12]"),
    )
    found = judge(assumed=assumed)
    assert found.verdict == "applies"
    assert found.statement == " ".join([say("applicability.applies"), *assumed])
    assert assumed[0] in judge(assumed=assumed, rms=0.5).statement
