"""Nothing is added to a paint that the four parameters describe, and to others what they have.

Of twenty strict paints, ten of them unpolarised, and of three coatings of other kinds:
python tests/statistical/test_auto_effects.py
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.inference.effects_choice.choose import choose_effects
from tools.validation.coverage import draw_paint

pytestmark = pytest.mark.slow

NAMES = ("n", "k", "sigma_n0", "rho0")
COATINGS = {
    "bead-like": (
        pb.Parameters(n=1.5, k=0.1, sigma_n0=0.05, rho0=0.6),
        pb.Effects(line_shape="cauchy", nu=2.0, narrowing=0.0, lambert=0.02),
    ),
    "anodised": (
        pb.Parameters(n=1.5, k=0.3, sigma_n0=0.2, rho0=0.25),
        pb.Effects(line_shape="cauchy", nu=0.75, narrowing=0.0, volume=0.01),
    ),
    "sintered PTFE": (
        pb.Parameters(n=1.35, k=0.001, sigma_n0=0.1, rho0=1.5), pb.Effects(bulk=0.85),
    ),
}  # fmt: skip
"""Line shapes and effects that such coatings call for, unpolarised."""


def added_to_strict_paint(seed: int) -> tuple[str, ...]:
    """What is added where nothing should be; even seeds are measured with unpolarised light."""
    drawn = draw_paint(np.random.default_rng([seed, 5])).tolist()
    paint = pb.Parameters(**dict(zip(NAMES, drawn, strict=True)))
    angles = (10.0, 30.0, 50.0, 70.0)
    polarized = seed % 2 == 1
    measurement = pb.simulate_measurement(
        paint if polarized else replace(paint, n=1.5), seed=seed, theta_i_deg=angles,
        theta_r_deg=np.arange(-80.0, 81.0, 4.0), polarizations=("s", "p") if polarized else ("u",),
        dhr_theta_i_deg=angles if polarized else (), dhr_noise=0.001,
    )  # fmt: skip
    config, choice = choose_effects(
        measurement, pb.RunConfig(effects=("auto",), accuracy="draft"), seed=1
    )
    assert choice is not None
    assert len(choice.candidates) >= 7
    return config.additions


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_nothing_is_added_to_a_strict_paint(seed: int) -> None:
    """Four angles of unpolarised light; a false alarm is expected in less than one of twenty."""
    assert added_to_strict_paint(seed) == ()


def added_to_coating(name: str) -> set[str]:
    """What is added to a coating at four angles of unpolarised light, noise of 2 %."""
    paint, effects = COATINGS[name]
    measurement = pb.simulate_measurement(
        paint, effects=effects, seed=3, theta_i_deg=(10.0, 30.0, 50.0, 70.0), dhr_theta_i_deg=(),
        theta_r_deg=np.arange(-80.0, 81.0, 2.0), polarizations=("u",),
    )  # fmt: skip
    config, _ = choose_effects(
        measurement, pb.RunConfig(effects=("auto",), accuracy="draft"), seed=1
    )
    return set(config.additions)


def test_bulk_scatter_is_found() -> None:
    """Of the strict model's kind otherwise: nothing else is added."""
    assert added_to_coating("sintered PTFE") == {"bulk"}


if __name__ == "__main__":
    for coating, (_, has) in COATINGS.items():
        sys.stdout.write(f"{coating}: {sorted(added_to_coating(coating))}, made with {has}\n")
    found = [added_to_strict_paint(seed) for seed in range(20)]
    sys.stdout.write(f"nothing added to {found.count(())} of {len(found)} paints: {set(found)}\n")
