"""Which rows each hold-out fits and predicts, and how a miss is judged."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.holdout_cases import list_cases, run_cases
from pbrdf_bayes.measurement import Measurement, select_scans
from pbrdf_bayes.verdicts.predictive_checks import judge_families, judge_holdout

TRUTH = [1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 0.0005]


def test_every_angle_and_both_polarisations(small: Measurement) -> None:
    cases = list_cases(small)
    assert [c.name for c in cases] == ["20 deg", "60 deg", "p from s", "s from p"]
    labels = np.array([scan.label for scan in small.scans])
    for case in cases[:2]:
        assert set(labels[case.predict]) == {f"s {case.name}", f"p {case.name}"}
        np.testing.assert_array_equal(case.keep, ~case.predict)
        assert case.dhr.all()
    for case in cases[2:]:
        predicted, fitted = case.name.split(" from ")
        assert {label[0] for label in labels[case.keep]} == {fitted}
        assert {label[0] for label in labels[case.predict]} == {predicted}
        kept = select_scans(small, case.keep, dhr=case.dhr).dhr
        assert set(kept.polarization.tolist()) == {fitted}
        assert len(kept) == 8


@pytest.mark.parametrize(
    ("scans", "names"),
    [
        ([("s", 20.0)], []),
        ([("s", 20.0), ("p", 20.0)], ["p from s", "s from p"]),
        ([("s", 20.0), ("s", 60.0)], ["20 deg", "60 deg"]),
        ([("u", 20.0), ("u", 60.0), ("s", 60.0)], ["20 deg", "60 deg"]),
        ([], []),
    ],
)
def test_what_does_not_apply_is_left_out(
    scans: list[tuple[str, float]], names: list[str], make_measurement: Callable[..., Measurement]
) -> None:
    rows: list[Any] = [("brdf", q, a, r, 0.01) for q, a in scans for r in (-5.0, 5.0)]
    m = make_measurement([*rows, ("dhr", "s", 20.0, math.nan, 0.05)])
    assert [c.name for c in list_cases(m)] == names


def test_of_many_angles_an_even_choice(make_measurement: Callable[..., Measurement]) -> None:
    m = make_measurement([("brdf", "s", float(a), 5.0, 0.01) for a in range(0, 60, 3)])
    names = [c.name for c in list_cases(m)]
    assert len(names) == 8
    assert (names[0], names[-1]) == ("0 deg", "57 deg")


@pytest.fixture(scope="module")
def predictions(small: Measurement) -> tuple[Holdout, ...]:
    posterior = build_posterior(small, pb.RunConfig(noise="iid", accuracy="draft", threads=1))
    return run_cases(posterior, np.array(TRUTH), list_cases(small), seed=1)


def test_true_data_are_predicted(predictions: tuple[Holdout, ...]) -> None:
    for found in predictions:
        assert found.surprise < 1.5, found.name
        assert judge_holdout(found) == "PASS"
        assert found.coverage_90 > 0.6
        assert found.name in found.statement
    assert [d.name for d in judge_families(predictions)] == [
        "holdout_angles",
        "holdout_polarization",
    ]


def test_a_polarisation_of_another_scale_is_not(small: Measurement) -> None:
    """p 30 % high, 0.114 dex, where s is known to a hundredth."""
    value = small.brdf.value.copy()
    value[small.brdf.polarization == "p"] *= 1.3
    wrong = replace(small, brdf=replace(small.brdf, value=value))
    posterior = build_posterior(wrong, pb.RunConfig(noise="iid", accuracy="draft", threads=1))
    found = judge_families(run_cases(posterior, np.array(TRUTH), list_cases(wrong)[2:], seed=1))
    assert found[0].verdict in ("WARN", "FAIL")
    assert found[0].name == "holdout_polarization"


def holdout(rms: float, coverage: float, expected: float, kind: str = "angle") -> Holdout:
    none = np.zeros(0)
    return Holdout(
        "a", "So.", none.astype(str), none, none, none, rms, coverage, 0.1, (), kind, "20 deg", expected
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rms", "coverage", "expected", "verdict"),
    [
        (0.2, 0.0, 0.15, "PASS"),  # announced: errors that all readings share
        (0.2, 0.0, 0.05, "FAIL"),
        (0.07, 0.9, 0.01, "WARN"),
        (0.02, 0.3, 0.01, "WARN"),
        (0.02, 0.9, 0.01, "PASS"),
    ],
)
def test_a_miss_counts_where_it_was_not_to_be_expected(
    rms: float, coverage: float, expected: float, verdict: str
) -> None:
    found = replace(holdout(rms, coverage, expected), width_dex=0.03)
    assert judge_holdout(found) == verdict
    family = judge_families([found, holdout(0.01, 0.9, 0.01)])[0]
    assert family.verdict == verdict
    assert bool(family.advice) == (verdict != "PASS")


def test_the_words_of_the_configuration() -> None:
    assert pb.RunConfig().holdouts == "all"
    assert pb.RunConfig(accuracy="draft").holdouts == "recipe"
    assert pb.RunConfig(holdout=False).holdouts == "none"
    for word in ("none", "recipe", "all"):
        assert pb.RunConfig(holdout=word, accuracy="draft").holdouts == word
    for wrong in (1, "yes", None):
        with pytest.raises(ConfigError, match="true or false, or one of 'none', 'recipe', 'all'"):
            pb.RunConfig(holdout=wrong)  # type: ignore[arg-type]
