"""A sample that reflects more than it receives is refused wherever effects are given."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scattering import conserves_energy
from pbrdf_bayes.physics.scene import make_scene

pytestmark = pytest.mark.usefixtures("signals_as_before")

GREEN = pb.GREEN_PAINT
SCENE = 'theta_i_deg = 20\ntheta_r_deg = "-80:80:5"\n'


def fresnel_s(n: complex, theta_deg: float) -> float:
    """|r_s|^2 as it stands in textbooks."""
    cosine = np.cos(np.deg2rad(theta_deg))
    inside = np.sqrt(n * n - np.sin(np.deg2rad(theta_deg)) ** 2)
    return float(abs((cosine - inside) / (cosine + inside)) ** 2)


MOST = 1.0 - GREEN.sigma_n0 * fresnel_s(GREEN.n - 1j * GREEN.k, 89.95)
"""Albedo with which s light that grazes leaves as it came."""


@pytest.mark.parametrize("ask", [
    lambda e: pb.brdf(GREEN, 20.0, [0.0, 10.0], "p", effects=e),
    lambda e: pb.dhr(GREEN, [20.0, 40.0], "p", effects=e),
    lambda e: pb.predict_scene(GREEN, pb.Scene(dhr_theta_i_deg=(20.0,)), effects=e),
    lambda e: pb.predict_scene(
        GREEN, pb.Scene(theta_i_deg=(20.0,), theta_r_deg=(0.0,)), effects=e
    ),
    lambda e: pb.simulate_measurement(GREEN, seed=1, theta_i_deg=[20.0], effects=e),
    lambda e: pb.reciprocity_defect(GREEN, 20.0, 60.0, effects=e),
])  # fmt: skip
def test_the_bound_is_where_the_dhr_at_grazing_is_one(ask) -> None:
    ask(pb.Effects(lambert=MOST - 1e-6))
    with pytest.raises(pb.DomainError) as refused:
        ask(pb.Effects(lambert=MOST + 1e-4))
    text = str(refused.value)
    assert f"{GREEN.sigma_n0:g} with lambert = {MOST + 1e-4:g}: of s light at 89.95 deg" in text
    assert "would reflect 1.0001 times" in text
    assert "Allowed: at most 1. Lower sigma_n0 or lambert" in text


def test_the_total_and_the_angle_are_told() -> None:
    """A peak back to the source is lost at grazing: the excess is at 20 degrees."""
    paint = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.01, rho0=0.3)
    bulk = pb.Effects(bulk=1.0)
    peak = pb.Effects(backscatter=0.4, backscatter_width=0.3)
    parts = [pb.dhr(paint, 20.0, "p", effects=e) for e in (bulk, peak)]
    total = float(sum(parts) - pb.dhr(paint, 20.0, "p"))
    both = replace(bulk, backscatter=0.4, backscatter_width=0.3)
    with pytest.raises(
        pb.DomainError, match=r"bulk = 1, backscatter = 0\.4: of p light at 20 deg"
    ) as refused:
        pb.dhr(paint, [20.0, 80.0], "s", effects=both)
    told = re.search(r"reflect (\S+) times", str(refused.value))
    assert told is not None
    assert float(told[1]) == pytest.approx(total, rel=1e-5)
    assert total > 1.05
    assert str(refused.value).endswith("Lower sigma_n0 or bulk or backscatter")


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_rule_of_the_prior(seed: int) -> None:
    """The same samples are refused that have no probability in a fit."""
    rng = np.random.default_rng(seed)
    names = ("lambert", "volume", "backscatter")
    scene = make_scene("lorentzian", "mean-sine", ("", "", "", "", *names))
    geometry = prepare_geometry(
        theta_i=np.deg2rad([35.0]), theta_r=np.zeros(1), phi_r=np.zeros(1),
        polarization=np.array(["s"]), dhr_theta_i=np.zeros(0), dhr_polarization=np.zeros(0, "U1"),
    )  # fmt: skip
    kept = 0
    for _ in range(40):
        strengths = rng.uniform(0.01, 0.5, 3)
        paint = pb.Parameters(n=1.5, k=0.1, sigma_n0=float(rng.uniform(0.0, 0.8)), rho0=0.3)
        allowed = conserves_energy(geometry, scene, np.append(paint.as_array(), strengths)[None])[0]
        effects = pb.Effects(**dict(zip(names, strengths.tolist(), strict=True)))
        try:
            pb.brdf(paint, 35.0, 0.0, effects=effects)
        except pb.DomainError:
            assert not allowed
        else:
            assert allowed
            kept += 1
    assert 0 < kept < 40


def test_instrument_effects_may_read_more() -> None:
    offset = pb.Effects(lambert=MOST - 1e-6, dhr_offset=0.05)
    assert float(pb.dhr(GREEN, 89.95, "s", effects=offset)) > 1.0


@pytest.mark.parametrize("verb", ["predict", "simulate", "scene", "scene alone"])
def test_the_command_line_says_so_and_writes_nothing(here, capsys, verb: str) -> None:
    values = {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}
    effects = {} if verb == "scene alone" else {"lambert": 0.7}
    table = "[effects]\nlambert = 0.7\n" * (verb == "scene alone")
    Path("scene.toml").write_text(SCENE + table, encoding="utf-8")
    options = ["--scene", "scene.toml"] * verb.startswith("scene")
    name = verb if verb == "simulate" else "predict"
    assert main([name, "--params", json.dumps(values | effects), *options, "--out", "o"]) == 2
    captured = capsys.readouterr()
    assert "at 89.95 deg the sample would reflect 1.15151 times what it receives" in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert not Path("o").exists()
