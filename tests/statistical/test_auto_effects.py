"""Nothing is added to a paint that the four parameters describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.inference.choose_effects import choose_effects
from pbrdf_bayes.validation.coverage import draw_paint

NAMES = ("n", "k", "sigma_n0", "rho0")


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_nothing_is_added_to_a_strict_paint(seed: int) -> None:
    """Four angles of unpolarised light; a false alarm is expected in less than one of twenty."""
    drawn = draw_paint(np.random.default_rng([seed, 5])).tolist()
    paint = replace(pb.Parameters(**dict(zip(NAMES, drawn, strict=True))), n=1.5)
    measurement = pb.simulate_measurement(
        paint, seed=seed, theta_i_deg=(10.0, 30.0, 50.0, 70.0),
        theta_r_deg=np.arange(-80.0, 81.0, 4.0), polarizations=("u",), dhr_theta_i_deg=(),
    )  # fmt: skip
    config, choice = choose_effects(
        measurement, pb.RunConfig(effects=("auto",), accuracy="draft"), seed=1
    )
    assert config.additions == ()
    assert choice is not None
    assert len(choice.candidates) >= 7
