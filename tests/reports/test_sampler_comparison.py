"""The committed comparison of samplers has all its rows, and its script still runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[2] / "reports" / "samplers"


@pytest.fixture(scope="module")
def make(make_of: Callable[[str], ModuleType]) -> ModuleType:
    return make_of("samplers")


@pytest.fixture(scope="module")
def committed() -> dict[str, Any]:
    return json.loads((FOLDER / "samplers.json").read_text(encoding="utf-8"))


def test_every_sampler_has_a_row_on_every_posterior(
    make: ModuleType, committed: dict[str, Any]
) -> None:
    wanted = [make.OURS, make.OURS_DRAFT, *make.RIVAL_MOVES, "dynesty", "nautilus"]
    assert set(committed["posteriors"]) == set(make.POSTERIORS)
    for found in committed["posteriors"].values():
        assert [row["sampler"] for row in found["rows"]] == wanted
        for row in found["rows"]:
            assert row["ess_per_second"] == pytest.approx(row["ess"] / row["seconds"])
            per_1000 = 1e3 * row["ess"] / row["evaluations"]
            assert row["ess_per_1000_evaluations"] == pytest.approx(per_1000, rel=1e-3)
            assert min(row["error_mean"], row["error_sd"]) >= 0.0


def test_ours_gives_more_effective_draws_a_second_than_the_stretch_move(
    make: ModuleType, committed: dict[str, Any]
) -> None:
    for found in committed["posteriors"].values():
        assert make.gain(found["rows"]) > 1.0


def test_ours_is_right_and_not_only_fast(make: ModuleType, committed: dict[str, Any]) -> None:
    """Of nine parameters the worst of two runs: four errors of either side."""
    for found in committed["posteriors"].values():
        row = next(r for r in found["rows"] if r["sampler"] == make.OURS)
        error = np.hypot(row["ess"] ** -0.5, found["reference"]["ess"] ** -0.5)
        assert row["error_mean"] < 4.0 * error


def test_the_goals_are_stated_for_both_likelihoods(
    make: ModuleType, committed: dict[str, Any]
) -> None:
    assert {g["noise"] for g in committed["goals"]} == set(make.GOALS)
    for g in committed["goals"]:
        assert g["goal_seconds"] == make.GOALS[g["noise"]]
        assert g["converged"]
        assert g["ess"] >= 2000.0
        assert g["rhat"] < 1.01


def test_the_page_has_a_row_for_every_sampler_and_goal() -> None:
    page = (FOLDER / "index.html").read_text(encoding="utf-8")
    assert page.count("<tr>") >= 7 * 2 + 2


def test_kish_counts_equal_weights_fully(make: ModuleType) -> None:
    assert make.kish(np.full(50, 0.02)) == pytest.approx(50.0)
    assert make.kish(np.array([1.0, 0.0, 0.0])) == 1.0


def test_a_walk_reports_its_draws_and_evaluations(make: ModuleType) -> None:
    """Two stretch ensembles of a few steps on a small posterior."""
    posterior = make.build("easy", "iid", points=9)
    x = posterior.sample_prior(np.random.default_rng(1), 400)
    z = posterior.to_coordinates(x[np.argsort(-posterior.log_prob(x))[:64]])
    walk = make.Walk(posterior, make.RIVAL_MOVES[make.STRETCH], [z[:32], z[32:]], 1)
    walk.go_on(0.05)
    found = walk.found()
    assert found.x.shape[1] == posterior.n_par
    assert found.weights.sum() == pytest.approx(1.0)
    assert walk.evaluations == 64 + 64 * sum(len(s.get_chain()) for s in walk.samplers) // 2
    assert 0.0 < found.ess <= len(found.x)
    row = make.row("stretch", [found], found)
    assert row["error_mean"] == row["error_sd"] == 0.0
    assert row["ess_per_second"] == pytest.approx(found.ess / found.seconds)
