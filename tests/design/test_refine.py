"""Tier 2 against closed forms and against tier 1 where both can be trusted."""

from __future__ import annotations

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import beliefs_of_prior
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.evaluate import evaluate, set_stage
from pbrdf_bayes.design.ranking import rank
from pbrdf_bayes.design.refine import _terms, log_norm, refined_gain, work_of
from pbrdf_bayes.design.run import DesignChoices, design_measurements
from pbrdf_bayes.design.summary import summarise_design


@pytest.mark.parametrize("noise", [1.0, 0.05, 1e-4])
def test_a_normal_reading_of_normal_parameters(noise: float) -> None:
    """ln p(y | x) - ln p(y) in closed form, from half a nat to nine."""
    rng = np.random.default_rng(1)
    truth = rng.standard_normal((30, 2))
    y = truth[:, 0] + noise * rng.standard_normal(30)
    found, wanted = [], []
    for own, reading in zip(truth, y, strict=True):

        def likelihood(z: np.ndarray, reading: float = reading) -> np.ndarray:
            return -0.5 * ((reading - z[:, 0]) / noise) ** 2 - np.log(noise)

        def of(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return 7.0 - 0.5 * np.sum(z**2, axis=1), likelihood(z)

        level = 7.0 + np.log(2.0 * np.pi)
        start = rng.standard_normal((400, 2))
        at_own = float(likelihood(own[None])[0])
        low, high, _, _ = _terms(of, start, own, at_own, level, 400, rng)
        found.append((low, high))
        of_y = -0.5 * (reading**2 / (1.0 + noise**2) + np.log(1.0 + noise**2))
        spread = noise**2 / (1.0 + noise**2)  # E over x | y of ln p(y | x)
        mean = reading / (1.0 + noise**2)
        given = -0.5 * ((reading - mean) ** 2 + spread) / noise**2 - np.log(noise)
        wanted.append(given - of_y)
    low, high = np.mean(found, axis=0)
    assert low - 0.02 <= np.mean(wanted) <= high + 0.02
    assert high - low < 0.1
    assert np.mean([low, high]) == pytest.approx(np.mean(wanted), abs=0.03)


def test_norm_of_a_density() -> None:
    rng = np.random.default_rng(2)
    start = rng.standard_normal((500, 3)) * [1.0, 0.1, 5.0]

    def density(z: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum((z / [1.0, 0.1, 5.0]) ** 2, axis=1)

    wanted = np.log(0.5) + 1.5 * np.log(2.0 * np.pi)
    assert log_norm(density, start, rng) == pytest.approx(wanted, abs=0.05)


def test_both_tiers_agree_on_a_first_dhr() -> None:
    candidate = Candidate("dhr", "s", 30.0, 3.0)
    beliefs = beliefs_of_prior(pb.RunConfig(), [candidate], n_draws=2000, seed=1)
    stage = set_stage(beliefs, n_outer=200, n_inner=1500, n_nuisance=64, seed=2)
    own, inner = stage.outer.x[:, :4], stage.inner.x[:, :4]
    first = evaluate(stage, candidate, own, inner, keep=False).gain
    second = refined_gain(stage, candidate, n_outer=40, n_inner=400)
    assert first.high - first.low < 0.15
    error = np.hypot(first.se, second.se) + 0.5 * (second.high - second.low)
    assert abs(first.eig - second.eig) < 3.0 * error


def test_a_first_scan_is_bracketed() -> None:
    """Where tier 1 knows no more than 2 to 14 nat."""
    candidate = Candidate("brdf", "s", 60.0, 10.0, theta_r_deg=tuple(range(-80, 81, 16)))
    beliefs = beliefs_of_prior(pb.RunConfig(), [candidate], n_draws=1500, seed=1)
    stage = set_stage(beliefs, n_outer=100, n_inner=800, n_nuisance=64, seed=2)
    own, inner = stage.outer.x[:, :4], stage.inner.x[:, :4]
    first = evaluate(stage, candidate, own, inner, keep=False).gain
    second = refined_gain(stage, candidate, n_outer=12, n_inner=400)
    assert first.high - first.low > 4.0
    assert second.high - second.low < 2.0
    assert first.low < second.eig < first.high


def test_a_design_with_wide_brackets_from_end_to_end() -> None:
    """Refined and plain candidates in one ranking, batch and pair."""
    scan = tuple(range(-80, 81, 20))
    options = [
        Candidate("brdf", "s", 20.0, 10.0, theta_r_deg=scan),
        Candidate("brdf", "p", 60.0, 10.0, theta_r_deg=scan),
        Candidate("dhr", "s", 30.0, 3.0),
    ]
    beliefs = beliefs_of_prior(pb.RunConfig(), options, n_draws=1000, seed=1)
    small = DesignChoices(n_outer=60, n_inner=400, batch=2, seed=3)
    result = design_measurements(beliefs, options, choices=small)
    found = summarise_design(result, None)
    by_label = {row["label"]: row for row in found["candidates"]}
    assert by_label["p scan at 60°"]["eig_nats"] > by_label["DHR_s at 30°"]["eig_nats"] > 0.5
    assert found["candidates"][0]["label"] == "p scan at 60°"
    members = found["batch"]["members"]
    assert [row["label"] for row in members] == ["p scan at 60°", "s scan at 20°"]
    assert members[0]["cumulative_nats"] == found["candidates"][0]["eig_nats"]
    assert members[1]["method"] == "local"
    assert 0.0 < members[1]["added_nats"] < by_label["s scan at 20°"]["eig_nats"]
    assert found["pairs"]["method"] == "local"
    for row in found["candidates"]:
        assert row["eig_low"] <= row["eig_nats"] <= row["eig_high"]
        assert all(ratio["ratio"] is not None for ratio in row["sd_ratio"].values())


def test_work_is_bounded_by_a_count() -> None:
    """Readings stop once the sets evaluated reach the budget; a machine's speed has no say."""
    candidate = Candidate("dhr", "s", 30.0, 3.0)
    beliefs = beliefs_of_prior(pb.RunConfig(), [candidate], n_draws=1000, seed=1)
    stage = set_stage(beliefs, n_outer=60, n_inner=400, n_nuisance=64, seed=2)
    each = work_of(stage, candidate)
    few = refined_gain(stage, candidate, n_inner=100, most_work=1.0)
    assert few.terms.size == 8
    more = refined_gain(stage, candidate, n_inner=100, most_work=400_000.0 * each)
    assert 8 < more.terms.size < 40
    assert more.terms[:8].tolist() == few.terms.tolist()


def test_candidates_with_wide_brackets_are_ranked_by_their_overlap() -> None:
    """Bounds 5 to 30 and 4 to 9 overlap, 1 to 1.1 lies below both."""
    terms = np.array([[4.9, 5.1, 5.0], [3.9, 4.1, 4.0], [0.9, 1.1, 1.0]])
    reach = np.array([[0.0, 25.0], [0.0, 5.0], [0.0, 0.0]])
    minutes = np.array([10.0, 10.0, 1.0])
    known = rank(terms, minutes, per_minute=False, seed=1)
    assert known.p_best.tolist() == [1.0, 0.0, 0.0]
    found = rank(terms, minutes, per_minute=False, seed=1, reach=reach)
    assert found.tied.tolist() == [True, True, False]
    assert found.p_best.tolist() == [0.5, 0.5, 0.0]
    assert found.n_readings == 3
    apart = rank(terms, minutes, per_minute=False, seed=1, reach=0.02 * reach)
    assert apart.tied.tolist() == [True, False, False]
    assert apart.p_best.tolist() == [1.0, 0.0, 0.0]
