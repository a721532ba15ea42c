"""The committed comparison of samplers has all its rows, and its script still runs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "reports" / "samplers"


@pytest.fixture(scope="module")
def make() -> ModuleType:
    spec = importlib.util.spec_from_file_location("samplers_make", FOLDER / "make.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look for it there
    spec.loader.exec_module(module)
    return module


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
