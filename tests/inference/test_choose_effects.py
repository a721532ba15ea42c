"""Effects chosen by what they predict: nothing on a strict paint, what is there on another."""

from __future__ import annotations

import numpy as np
import pytest

from pbrdf_bayes import (
    GREEN_PAINT,
    ConfigError,
    Effects,
    RunConfig,
    build_posterior,
    simulate_measurement,
)
from pbrdf_bayes.inference.choose_effects import choose_effects

AUTO = RunConfig(effects=("auto",))
GRID = np.arange(-80.0, 81.0, 8.0)


def simulated(seed, effects=None, theta_i_deg=(10.0, 35.0, 60.0)):
    return simulate_measurement(
        GREEN_PAINT, seed=seed, effects=effects, theta_i_deg=theta_i_deg, theta_r_deg=GRID,
        relative_noise=0.03,
    )  # fmt: skip


@pytest.mark.parametrize("seed", [2])
def test_nothing_is_added_to_a_strict_paint(seed):
    config, choice = choose_effects(simulated(seed), AUTO, seed=1)
    assert config.effects == ()
    assert config.line_shape == "lorentzian"
    assert [c.name for c in choice.candidates if c.chosen] == ["four parameters"]
    assert "Nothing beyond" in choice.statement


def test_diffuse_scatter_is_found():
    config, choice = choose_effects(simulated(3, Effects(lambert=0.02)), AUTO, seed=1)
    assert config.effects in (("lambert",), ("bulk",))
    chosen = next(c for c in choice.candidates if c.chosen)
    base = next(c for c in choice.candidates if c.name == "four parameters")
    assert chosen.held_out_dex < 0.5 * base.held_out_dex
    assert len(choice.cases) == 5  # three angles, p from s, s from p


def test_one_angle_and_one_polarisation_leave_nothing_to_choose_by():
    measurement = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=GRID, polarizations=("s",)
    )
    config, choice = choose_effects(measurement, AUTO, seed=1)
    assert config.effects == ()
    assert choice.candidates == ()


def test_named_effects_are_left_alone():
    config = RunConfig(effects=("lambert",))
    assert choose_effects(simulated(1), config, seed=1) == (config, None)


def test_a_posterior_needs_effects_by_name():
    with pytest.raises(ConfigError, match="effects = auto"):
        build_posterior(simulated(1), AUTO)
