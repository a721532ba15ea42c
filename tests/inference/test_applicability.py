"""Whether the parameters may be read as those of a material: each criterion by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pbrdf_bayes import GREEN_PAINT, Measurement, simulate_measurement
from pbrdf_bayes.inference.applicability import judge_applicability, repeatability_dex
from pbrdf_bayes.inference.holdout import Holdout
from pbrdf_bayes.inference.parameters import PHYSICAL


def judge(rms=0.01, repeatability=0.01, at_bound=None, held_out=0.01, kind="angle"):
    none = np.zeros(0)
    held = Holdout(
        "DHR", "", np.zeros(0, np.str_), none, none, none, held_out, 0.9, 0.1, (), kind=kind
    )
    share = [1.0 if name == at_bound else 0.0 for name in (*PHYSICAL, "narrowing")]
    return judge_applicability(
        best_rms_dex=rms, repeatability=repeatability, bound_share=share,
        names=(*PHYSICAL, "narrowing"), holdouts=[held],
    )  # fmt: skip


def test_nothing_speaks_against_a_good_fit():
    found = judge()
    assert (found.verdict, found.reasons) == ("applies", ())


def test_three_times_the_repeatability_is_descriptive_only():
    assert judge(rms=0.0299).verdict == "applies"
    found = judge(rms=0.0301)
    assert found.verdict == "descriptive only"
    assert "not material constants" in found.statement


@pytest.mark.parametrize("kind", ["angle", "polarization"])
def test_readings_left_out_that_are_badly_predicted(kind):
    assert judge(held_out=0.099, kind=kind).verdict == "applies"
    assert judge(held_out=0.101, kind=kind).verdict == "does not apply"


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


def test_repeats_that_scatter_more_than_neighbours(measurement: Measurement):
    assert repeatability_dex(measurement, 0.01) == pytest.approx(0.01)
    brdf = measurement.brdf
    repeated = replace(brdf, u_value=0.1 * brdf.value, repeated=np.ones(len(brdf), dtype=bool))
    found = repeatability_dex(replace(measurement, brdf=repeated), 0.01)
    assert found == pytest.approx(0.1 / np.log(10.0))
