"""After few data: where a measurement tells so much that no draw explains it, nothing is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_prior, beliefs_of_run
from pbrdf_bayes.design.candidates import Candidate, list_candidates
from pbrdf_bayes.design.goals import parse_goal, values_of
from pbrdf_bayes.design.run import DesignChoices, DesignResult, design_measurements
from pbrdf_bayes.design.summary import summarise_design
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model.simulate import GREEN_PAINT
from pbrdf_bayes.results import draws_of_run

SCAN = np.arange(-80.0, 81.0, 8.0)
GOALS = tuple(parse_goal(text) for text in ("scan:p:70", "ratio:60:60", "dhr:s:70"))
BEST = "p scan at 70°"
KNOWN = {"tau": 0.005, "ell_deg": 20.0, "u_dhr": 0.0005}
CONFIG = pb.RunConfig(
    accuracy="draft", holdout=False, max_steps=1500,
    priors={name: {"kind": "fixed", "value": value} for name, value in KNOWN.items()},
)  # fmt: skip


def measured(*scans: tuple[str, float]) -> Measurement:
    """The published paint with 2 % noise, and DHR at 12.5 deg."""
    rng = np.random.default_rng(5)
    columns: dict[str, list[object]] = {
        key: [] for key in ("quantity", "polarization", "theta_i_deg", "theta_r_deg", "value")
    }
    for q, angle in scans:
        f = pb.brdf(GREEN_PAINT, angle, SCAN, q) * np.exp(0.02 * rng.standard_normal(SCAN.size))
        for theta_r, value in zip(SCAN, f, strict=True):
            for key, cell in zip(columns, ("brdf", q, angle, theta_r, value), strict=True):
                columns[key].append(cell)
    for q in "sp":
        dhr = float(pb.dhr(GREEN_PAINT, [12.5], q)[0]) * (1.0 + 0.01 * rng.standard_normal())
        for key, cell in zip(columns, ("dhr", q, 12.5, np.nan, dhr), strict=True):
            columns[key].append(cell)
    return measurement_from_columns(sample="few", wavelength_um=3.39, **columns)


def beliefs_after(*scans: tuple[str, float]) -> Beliefs:
    done = pb.fit(measured(*scans), CONFIG, seed=1)
    posterior = done.posterior()
    draws = draws_of_run(done, posterior.parameter_names)
    return beliefs_of_run(posterior, draws.reshape(-1, posterior.n_par))


@pytest.fixture(scope="module")
def few() -> Beliefs:
    return beliefs_after(("s", 12.5), ("p", 12.5))


@pytest.fixture(scope="module")
def result(few: Beliefs) -> DesignResult:
    options = list_candidates(
        quantities=("brdf", "dhr"), theta_i_deg=(12.5, 45.0, 55.0, 70.0), polarizations=("s", "p"),
        theta_r_deg=SCAN.tolist(),
    )  # fmt: skip
    small = DesignChoices(n_outer=120, n_inner=300, minutes=60.0, seed=3)
    return design_measurements(few, options, choices=small, goals=GOALS)


def test_every_candidate_is_told(result: DesignResult) -> None:
    found = summarise_design(result, None)
    assert len(found["candidates"]) == found["n_evaluated"] == found["n_candidates"] == 16
    for row in found["candidates"]:
        assert row["eig_low"] <= row["eig_nats"] <= row["eig_high"] + 1e-9
        assert all(ratio["ratio"] is not None for ratio in row["sd_ratio"].values())
    assert any(row["sd_method"] == "local" for row in found["candidates"])


def test_a_goal_has_its_own_scan_as_the_best_one(result: DesignResult) -> None:
    goal = summarise_design(result, None)["goals"][0]
    assert len(goal["candidates"]) == 16
    assert goal["candidates"][0]["label"] == BEST
    assert goal["candidates"][0]["method"] == "local"


def test_a_batch_and_a_pair_are_told(result: DesignResult) -> None:
    assert len(result.batch.members) > 2
    assert result.batch.gains[-1].method == "local"
    assert result.pairs is not None
    assert result.pairs.n_compared == 16 * 15 // 2


def test_the_linear_law_holds_the_simulated_gain_between_its_two_levels(
    result: DesignResult,
) -> None:
    """Below: what is known is taken for the local law. Above: what is left is taken for it.

    The upper one stands in where no draws are left; where some are it is more than the truth.
    """
    linear = result.linear[result.chosen]
    wide = [(e, low) for e, low in zip(result.evaluated, linear, strict=True) if e.local_nats]
    assert any(e.gain.method == "local" for e, _ in wide)
    for e, low in wide:
        assert e.local_nats is not None
        if e.gain.method == "nested":
            assert low - 3.0 * e.gain.se < e.gain.eig < e.local_nats + 3.0 * e.gain.se


def test_what_is_left_is_what_a_fit_leaves(few: Beliefs, result: DesignResult) -> None:
    """Really measured and fitted: one sample, whose width varies with the paint and its noise."""
    after = beliefs_after(("s", 12.5), ("p", 12.5), ("p", 70.0))
    names = summarise_design(result, None)["candidates"][0]["sd_ratio"]
    told = next(e for e in result.evaluated if e.candidate.label == BEST)
    ratio, _ = told.spread.sd_ratio()
    before, columns = values_of(few, GOALS, few.x[::4])
    left, _ = values_of(replace(after, about=few.about), GOALS, after.x[::4])
    for name, predicted in zip(names, ratio, strict=True):
        at = np.array(columns) == name
        really = np.sqrt(left[:, at].var(axis=0).mean() / before[:, at].var(axis=0).mean())
        assert 0.6 < predicted / really < 1.7, (name, predicted, really)


def test_cheap_readings_fill_the_budget(few: Beliefs) -> None:
    """Up to 20 under a budget and 4 without; a DHR may be repeated, with its gain shared."""
    options = [Candidate("dhr", q, 70.0, 3.0) for q in "sp"]
    members = {}
    for name, minutes, batch in (("usual", np.inf, None), ("budget", 24.0, None), ("few", 24.0, 2)):
        choices = DesignChoices(n_outer=60, n_inner=200, minutes=minutes, batch=batch, seed=3)
        found = summarise_design(design_measurements(few, options, choices=choices), None)
        members[name] = found["batch"]["members"]
        assert found["choices"]["batch"] == {"usual": 4, "budget": 20, "few": 2}[name]
    assert [len(rows) for rows in members.values()] == [4, 8, 2]
    added = [row["added_nats"] for row in members["budget"]]
    assert sum(added) == pytest.approx(members["budget"][-1]["cumulative_nats"])
    assert members["budget"][-1]["cumulative_minutes"] == 24.0
    assert members["budget"][-1]["method"] == "local"


def test_the_scan_of_a_goal_does_not_depend_on_the_candidates(few: Beliefs) -> None:
    small = DesignChoices(n_outer=40, n_inner=80, batch=1, seed=3)
    options = [
        Candidate("brdf", "s", 20.0, 5.0, theta_r_deg=tuple(scan))
        for scan in (np.arange(-20.0, 21.0, 20.0), np.arange(-70.0, 71.0, 35.0))
    ]
    goals = (parse_goal("scan:p:60"),)
    one, other = (
        design_measurements(few, order, choices=small, goals=goals).sd_before
        for order in (options, options[::-1])
    )
    np.testing.assert_array_equal(one, other)


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
