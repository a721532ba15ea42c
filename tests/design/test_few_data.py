"""After few data: where a measurement tells so much that no draw explains it, nothing is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_run
from pbrdf_bayes.design.candidates import Candidate, list_candidates
from pbrdf_bayes.design.evaluate import Evaluated
from pbrdf_bayes.design.goals import parse_goal, values_of
from pbrdf_bayes.design.nested import Gain
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
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pbrdf_bayes.design.run._WORK_REFINED", 1.0)  # the fewest readings of two
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


def test_both_ways_to_a_gain_agree(result: DesignResult) -> None:
    """Tier 2 against the determinants, where both are there."""
    both = [e for e in result.evaluated if e.gain.method == "refined" and e.gain.ess < 10.0]
    assert both
    for e in both:
        assert e.local_nats is not None
        error = np.hypot(e.gain.se, 0.5 * (e.gain.high - e.gain.low))
        assert abs(e.local_nats - e.gain.eig) < 3.0 * error + 0.3, e.candidate.label


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


@pytest.fixture(scope="module")
def corrected(few: Beliefs) -> tuple[DesignResult, set[str]]:
    """Tier 2 finds 1.0 and 1.1 nat in turn less than the local law; whom it was asked for."""
    local: dict[str, float] = {}
    asked: list[str] = []

    def refined(_stage: object, candidate: Candidate, **_: object) -> Gain:
        less = 1.0 + 0.1 * (len(asked) % 2)
        asked.append(candidate.label)
        terms = local.get(candidate.label, 0.0) - less + 0.1 * np.tile([1.0, -1.0], 20)
        reach = 0.01 if local else 1e3
        eig = float(terms.mean())
        return Gain(eig, 0.02, eig - reach, eig + reach, 50.0, terms, method="refined")

    options = list_candidates(
        quantities=("brdf",), theta_i_deg=tuple(range(40, 76, 5)), polarizations=("p",),
        theta_r_deg=SCAN.tolist(),
    )  # fmt: skip
    small = DesignChoices(n_outer=120, n_inner=300, batch=1, seed=3, threads=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pbrdf_bayes.design.run._WORK_REFINED", 1.0)
        patch.setattr("pbrdf_bayes.design.run.refined_gain", refined)
        alone = design_measurements(few, options, choices=small)
        local |= {e.candidate.label: e.local_nats or 0.0 for e in alone.evaluated}
        asked.clear()
        return design_measurements(few, options, choices=small), set(asked)


def test_the_best_one_is_not_that_of_the_coarser_estimate(
    corrected: tuple[DesignResult, set[str]],
) -> None:
    """Those that tier 2 did not take are compared as it would see them."""
    result, asked = corrected
    assert 2 <= len(asked) < len(result.evaluated)
    best = result.evaluated[int(np.argmax(result.by_gain.value))]
    assert best.candidate.label in asked
    assert best.gain.method == "refined"


def test_a_local_gain_is_moved_by_what_tier_2_finds(
    corrected: tuple[DesignResult, set[str]],
) -> None:
    """By the mean of its differences, with their scatter as an error of its own."""
    result, _ = corrected
    by_method: dict[str, list[Evaluated]] = {"refined": [], "local": []}
    for e in result.evaluated:
        if e.gain.ess < 10.0:
            by_method[e.gain.method].append(e)
    beyond = [e.gain.eig - (e.local_nats or 0.0) for e in by_method["refined"]]
    wanted = np.std(beyond, ddof=1) * np.sqrt(1.0 + 1.0 / len(beyond))
    assert by_method["local"]
    for e in by_method["local"]:
        moved = (e.local_nats or 0.0) + np.mean(beyond)
        assert e.gain.eig == pytest.approx(np.clip(moved, e.gain.low, e.gain.high))
        assert e.gain.alone == pytest.approx(wanted)
        assert e.gain.se >= e.gain.alone


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
