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
from pbrdf_bayes.physics.hemispherical import conserves_energy
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
    """A peak back to the source is lost at grazing, bulk scatter is most at Brewster's angle."""
    paint = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.01, rho0=0.3)
    bulk = pb.Effects(bulk=0.9)
    peak = pb.Effects(backscatter=0.4, backscatter_width=0.3)
    both = replace(bulk, backscatter=0.4, backscatter_width=0.3)
    with pytest.raises(
        pb.DomainError, match=r"bulk = 0\.9, backscatter = 0\.4: of [sp]"
    ) as refused:
        pb.dhr(paint, [0.0, 80.0], "s", effects=both)
    told = re.search(r"at (\S+) deg .* reflect (\S+) times", str(refused.value))
    assert told is not None
    angle, total = float(told[1]), float(told[2])
    parts = [float(pb.dhr(paint, angle, "p", effects=e)) for e in (bulk, peak)]
    assert total == pytest.approx(sum(parts) - float(pb.dhr(paint, angle, "p")), rel=1e-4)
    assert total > 1.01
    assert str(refused.value).endswith("Lower sigma_n0 or bulk or backscatter")


def bulk_p(n: float, sigma_n0: float, strength: float, theta_deg: float) -> float:
    """DHR of p light from textbooks' Fresnel and a sum over the directions of escape."""

    def transmitted(c: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        inside = np.sqrt(1.0 - (1.0 - np.square(c)) / n**2)
        return 1.0 - ((c - n * inside) / (c + n * inside)) ** 2, 1.0 - (
            (n * c - inside) / (n * c + inside)
        ) ** 2

    x, w = np.polynomial.legendre.leggauss(200)
    mu = 0.5 * (1.0 + x)
    escaped = np.sum(0.5 * w * mu * np.sum(transmitted(mu), axis=0))
    t_p = float(transmitted(np.cos(np.deg2rad(theta_deg)))[1])
    return sigma_n0 * (1.0 - t_p) + strength * t_p * escaped / transmitted(1.0)[0] ** 2


@pytest.mark.parametrize("asked", [0.0, 20.0, 71.5, 89.0])
def test_bulk_scatter_is_judged_at_brewsters_angle_whatever_is_asked(asked: float) -> None:
    """n = 3: of p light more leaves at 71.6 deg than enters, and less at normal incidence."""
    paint = pb.Parameters(n=3.0, k=0.0, sigma_n0=0.5, rho0=0.3)
    most = 1.0 / bulk_p(3.0, 0.0, 1.0, np.rad2deg(np.arctan(3.0)))
    assert bulk_p(3.0, 0.5, most, 0.0) < 0.95
    assert bulk_p(3.0, 0.5, most, 89.95) < 0.95
    for ask in (pb.dhr, lambda p, a, q, effects: pb.brdf(p, a, 0.0, q, effects=effects)):
        ask(paint, asked, "p", effects=pb.Effects(bulk=most - 1e-5))
        with pytest.raises(pb.DomainError, match=r"of p light at 71\.5\d* deg"):
            ask(paint, asked, "p", effects=pb.Effects(bulk=most + 1e-5))


@pytest.mark.parametrize("k", [0.0, 0.5])
def test_no_fit_admits_a_sample_that_a_prediction_would_refuse(k: float) -> None:
    """Readings at one angle of incidence say nothing of the others: the prior does."""
    measurement = pb.simulate_measurement(GREEN, seed=1, theta_i_deg=(0.0,))
    priors = {"n": {"kind": "uniform", "low": 2.0, "high": 3.0}, "k": {"kind": "fixed", "value": k}}
    config = pb.RunConfig(effects=("bulk",), noise="iid", prior="dielectric", priors=priors)
    posterior = pb.build_posterior(measurement, config)
    rng = np.random.default_rng(3)
    x = posterior.prior_quantile(rng.random((400, posterior.n_par)))
    allowed = np.isfinite(posterior.log_prior(x))
    assert 50 < allowed.sum() < 350
    column = {name: i for i, name in enumerate(posterior.parameter_names)}
    for row in x[allowed]:
        n, sigma, strength = (row[column[name]] for name in ("n", "sigma_n0", "bulk"))
        paint = pb.Parameters(n=n, k=k, sigma_n0=sigma, rho0=0.3)
        effects = pb.Effects(bulk=strength)
        assert np.max(pb.dhr(paint, np.arange(0.0, 89.0, 0.5), "p", effects=effects)) <= 1.0


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_rule_of_the_prior(seed: int) -> None:
    """The same samples are refused that have no probability in a fit."""
    rng = np.random.default_rng(seed)
    names = ("lambert", "volume", "backscatter")
    scene = make_scene("lorentzian", "mean-sine", ("", "", "", "", *names))
    kept = 0
    for _ in range(40):
        strengths = rng.uniform(0.01, 0.5, 3)
        paint = pb.Parameters(n=1.5, k=0.1, sigma_n0=float(rng.uniform(0.0, 0.8)), rho0=0.3)
        allowed = conserves_energy(scene, np.append(paint.as_array(), strengths)[None])[0]
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
