"""What every declared effect owes: it acts, its DHR is the integral of its BRDF, it is bounded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pbrdf_bayes import GREEN_PAINT, Effects
from pbrdf_bayes.effects_table import DIFFUSE, EFFECT_PARAMETERS, EFFECTS, LINE_SHAPES
from pbrdf_bayes.model.effects import scene_and_columns
from pbrdf_bayes.physics.effects.diffuse import (
    diffuse_dhr,
    fill_diffuse,
    most_diffuse,
    shared_by_angles,
)
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scattering import evaluate_with_effects
from pbrdf_bayes.physics.scene import effects_of

ANGLES = np.deg2rad([0.0, 20.0, 45.0, 70.0, 85.0])
ENTRIES = [(e.name, "lorentzian", e.parameters) for e in EFFECTS.values()]
ENTRIES += [("", s.name, s.parameters) for s in list(LINE_SHAPES.values())[1:]]


def readings(effects: Effects) -> tuple[np.ndarray, np.ndarray]:
    """BRDF and DHR of s, p and u as they are read."""
    words, theta_r = np.repeat(["s", "p", "u"], 9), np.tile(np.deg2rad(np.arange(-60, 61, 15)), 3)
    geometry = prepare_geometry(
        theta_i=np.full(27, 0.5), theta_r=theta_r, phi_r=np.zeros(27), polarization=words,
        dhr_theta_i=np.full(3, 0.5), dhr_polarization=np.array(["s", "p", "u"]),
    )  # fmt: skip
    return evaluate_with_effects(geometry, *scene_and_columns(effects, GREEN_PAINT.as_array()), 8.0)


@pytest.mark.parametrize(("name", "shape", "parameters"), ENTRIES)
def test_every_parameter_that_is_declared_acts(
    name: str, shape: str, parameters: tuple[str, ...]
) -> None:
    """A kernel that does not know a parameter, or a line shape, would leave the readings alone."""
    values = {p: EFFECT_PARAMETERS[p].typical for p in parameters}
    there = readings(Effects(line_shape=shape, **values))
    plain = readings(Effects())
    assert any(np.any(np.abs(a - b) > 1e-9) for a, b in zip(there, plain, strict=True))
    for p in parameters[1:]:
        low, high = EFFECT_PARAMETERS[p].domain
        moved = readings(Effects(**(values | {p: 0.5 * (low + high)})))
        assert any(np.any(a != b) for a, b in zip(moved, there, strict=True)), p
    if name in DIFFUSE:
        assert np.all(there[1] > plain[1])


def strengthened(name: str) -> Any:
    """The kernels' values with one diffuse term of strength 0.3."""
    values = {p: EFFECT_PARAMETERS[p].typical for p in EFFECTS[name].parameters} | {name: 0.3}
    scene, x = scene_and_columns(Effects(**values), GREEN_PAINT.as_array())
    return effects_of(scene, x[0])


@pytest.mark.parametrize("theta_i", ANGLES)
@pytest.mark.parametrize("name", DIFFUSE)
def test_the_dhr_is_the_integral_of_the_brdf(name: str, theta_i: float, gauss_rule: Any) -> None:
    """Gauss rules on panels that close in on the way back to the source, and on grazing angles."""
    effects, surf = strengthened(name), surface(*GREEN_PAINT.as_array())
    steps = 0.5 * np.pi * 0.6 ** np.arange(16)
    edges = np.unique(
        np.clip(
            [0.0, theta_i, *(theta_i - steps), *(theta_i + steps), *(0.5 * np.pi - steps)],
            0.0,
            0.5 * np.pi,
        )
    )
    theta, w_theta = gauss_rule(edges[np.diff(edges, prepend=-1.0) > 1e-9], 10)
    phi, w_phi = gauss_rule(np.unique([0.0, *(np.pi - 2.0 * steps), np.pi]), 10)
    at, azimuth = np.repeat(theta, phi.size), np.tile(phi, theta.size)
    c_i, s_i = np.cos(theta_i), np.sin(theta_i)
    phase = c_i * np.cos(at) - s_i * np.sin(at) * np.cos(azimuth)
    f = np.empty((2, at.size))
    fill_diffuse(
        s_i, c_i, np.stack([np.sin(at), np.cos(at), phase]), 0, at.size, effects, surf, (f[0], f[1])
    )
    weight = 2.0 * np.repeat(w_theta, phi.size) * np.tile(w_phi, theta.size)
    whole = f @ (weight * np.sin(at) * np.cos(at))
    found = diffuse_dhr(theta_i, s_i, c_i, effects, surf, shared_by_angles(effects, surf))
    np.testing.assert_allclose(found, whole, rtol=2e-6)
    assert max(found) <= most_diffuse(effects, surf)
