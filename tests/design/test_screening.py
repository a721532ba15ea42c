"""Of many candidates the promising ones are simulated: for the gain, each minute and each goal."""

from __future__ import annotations

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import beliefs_of_run
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.goals import parse_goal
from pbrdf_bayes.design.run import DesignChoices, DesignResult, design_measurements
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

SCAN = tuple(float(a) for a in range(-60, 61, 10))
CENTRE = {
    "s_rel_s": 0.02, "s_rel_p": 0.03, "tau": 0.05, "ell_deg": 25.0, "u_dhr": 0.0006,
}  # fmt: skip
OPTIONS = [
    Candidate("brdf", q, a, 10.0, theta_r_deg=SCAN)
    for q, a in (("p", 45.0), ("p", 50.0), ("p", 55.0), ("p", 60.0), ("p", 65.0), ("s", 70.0))
]


@pytest.fixture(scope="module")
def results() -> list[DesignResult]:
    """All of them, and no more than 2: without and with a goal."""
    m = simulate_measurement(
        GREEN_PAINT,
        seed=1,
        theta_i_deg=(20.0,),
        theta_r_deg=np.array(SCAN),
        dhr_theta_i_deg=(10.0,),
    )
    posterior = build_posterior(m, pb.RunConfig(accuracy="draft"))
    paint = dict(zip(("n", "k", "sigma_n0", "rho0"), GREEN_PAINT.as_array(), strict=True))
    centre = np.array([(CENTRE | paint)[name] for name in posterior.parameter_names])
    noise = np.random.default_rng(2).standard_normal((400, centre.size))
    b = beliefs_of_run(posterior, centre * np.exp(0.03 * noise))
    small = DesignChoices(n_outer=60, n_inner=150, n_nuisance=4, batch=1, seed=3)
    goals = (parse_goal("dhr:s:80"),)
    with pytest.MonkeyPatch.context() as patch:
        found = [design_measurements(b, OPTIONS, choices=small, goals=goals)]
        patch.setattr("pbrdf_bayes.design.run._MOST_EVALUATED", 2)
        found += [design_measurements(b, OPTIONS, choices=small, goals=g) for g in ((), goals)]
    return found


def labels(result: DesignResult) -> set[str]:
    return {e.candidate.label for e in result.evaluated}


def test_the_best_for_a_goal_is_kept(results: list[DesignResult]) -> None:
    """The one that is best of all for it, though the linear estimate of the gain leaves it out."""
    every, without, with_goal = results
    best = every.evaluated[int(np.argmin(every.goals[0].left))].candidate.label
    assert best == "p scan at 65°"
    assert best not in labels(without)
    assert best in labels(with_goal)
    assert len(with_goal.evaluated) == len(without.evaluated) == 2


def test_the_best_by_the_linear_estimate_are_kept_too(results: list[DesignResult]) -> None:
    _, without, with_goal = results
    first = OPTIONS[int(np.argmax(without.linear))].label
    assert first in labels(without) & labels(with_goal)
