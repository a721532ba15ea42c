"""Effects chosen by what they predict: nothing on a strict paint, what is there on another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from pbrdf_bayes import (
    GREEN_PAINT,
    ConfigError,
    Effects,
    Parameters,
    RunConfig,
    build_posterior,
    simulate_measurement,
)
from pbrdf_bayes import brdf as brdf_of
from pbrdf_bayes.effects_table import INSTRUMENT_EFFECTS
from pbrdf_bayes.inference.effects_choice import choose as choosing
from pbrdf_bayes.inference.effects_choice.candidates import grown
from pbrdf_bayes.inference.effects_choice.choose import choose_effects
from pbrdf_bayes.measurement import select_scans
from pbrdf_bayes.words import say

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
    assert choice.statement == say("effects.none", base="four parameters", held="")
    assert {c.line_shape for c in choice.candidates} == {"lorentzian", "cauchy"}


def test_diffuse_scatter_is_found():
    config, choice = choose_effects(simulated(3, Effects(lambert=0.02)), AUTO, seed=1)
    assert config.effects in (("lambert",), ("bulk",))
    chosen = next(c for c in choice.candidates if c.chosen)
    base = next(c for c in choice.candidates if c.name == "four parameters")
    assert chosen.held_out_dex < 0.5 * base.held_out_dex
    assert len(choice.cases) == 5  # three angles, p from s, s from p


def test_priors_of_effects_hold_where_these_are_tried():
    """A prior of what is not chosen is left out of the configuration that the run goes on with."""
    priors = {
        "lambert": {"kind": "uniform", "low": 0.0, "high": 0.05},
        "asymmetry": {"kind": "uniform", "low": 0.0, "high": 0.95},
    }
    asked = replace(AUTO, priors=priors)
    config, choice = choose_effects(simulated(3, Effects(lambert=0.02)), asked, seed=1)
    sizes = {c.name: c.n_free for c in choice.candidates}
    assert sizes["volume"] == sizes["lambert"] + 1  # the asymmetry is free
    assert config.effects in (("lambert",), ("bulk",))
    assert config.priors == ({"lambert": priors["lambert"]} if "lambert" in config.effects else {})


def test_a_misspelt_prior_is_refused_before_anything_is_tried():
    asked = replace(AUTO, priors={"asymetry": {"kind": "uniform", "low": 0.0, "high": 0.95}})
    with pytest.raises(ConfigError, match=r"priors\.asymetry: no such parameter"):
        choose_effects(simulated(3), asked, seed=1)


def test_one_angle_and_one_polarisation_leave_nothing_to_choose_by():
    measurement = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=GRID, polarizations=("s",)
    )
    config, choice = choose_effects(measurement, AUTO, seed=1)
    assert config.effects == ()
    assert choice.candidates == ()
    assert choice.caution == say("effects.no_statistics")


def test_readings_of_the_dhr_alone_are_not_called_one_angle():
    """Four angles of incidence, and no curve to be left out and predicted."""
    whole = simulated(1)
    alone = select_scans(whole, np.zeros(len(whole.scans), dtype=bool), dhr=True)
    assert np.unique(alone.dhr.theta_i_deg).size > 3
    config, choice = choose_effects(alone, AUTO, seed=1)
    assert config.effects == ()
    assert choice.caution == say("effects.no_statistics")


def test_candidates_never_hold_an_effect_of_the_instrument():
    """Readings of one polarisation or without DHR could not tell them."""
    reached, new = set(), [RunConfig()]
    while new:
        larger = {c.effects: c for one in new for c in grown(one)}
        new = [c for c in larger.values() if frozenset(c.effects) not in reached]
        reached |= {frozenset(c.effects) for c in new}
    assert reached
    assert not set().union(*reached) & set(INSTRUMENT_EFFECTS)


def test_the_score_of_angles_is_kept_for_the_verdict(gains):
    gains(0.0)
    _, choice = choose_effects(simulated(2), AUTO, seed=1)
    logs = 1e-3 * np.arange(5)  # three angles, then the two polarisations
    for kind, part in (("angle", logs[:3]), ("polarization", logs[3:])):
        assert choice.held_out[kind] == pytest.approx(np.sqrt(np.mean(np.exp(2.0 * part))))
    chosen = next(c for c in choice.candidates if c.chosen)
    assert chosen.held_out_dex == pytest.approx(np.sqrt(np.mean(np.exp(2.0 * logs))))
    assert chosen.mean_held_out_dex == pytest.approx(np.mean(np.exp(logs)))
    assert choice.symbols == {"rho0": "ρ_0"}


def test_stated_uncertainties_have_no_say_in_the_choice(monkeypatch):
    """The score counts all readings alike; fits that do not are scored for what they did not fit.

    The chosen optimum is then that of least squares, here of scipy's on the plain model.
    """
    measurement = simulated(4)
    rng, brdf = np.random.default_rng(1), measurement.brdf
    stated = replace(brdf, u_value=brdf.value * rng.uniform(0.01, 1.0, len(brdf)))
    dhr = measurement.dhr
    none = replace(measurement, dhr=replace(dhr, **{
        name: getattr(dhr, name)[:0] for name in dhr.__dataclass_fields__
    }), brdf=stated)  # fmt: skip
    monkeypatch.setattr(choosing, "grown", lambda _: iter(()))
    _, choice = choose_effects(none, AUTO, seed=1)

    def residuals(x):
        paint = Parameters(n=x[0], k=x[1], sigma_n0=x[2], rho0=x[3])
        found = [
            brdf_of(paint, brdf.theta_i_deg, brdf.theta_r_deg, q, rtol=1e-5) for q in ("s", "p")
        ]
        return np.log10(brdf.value / np.where(brdf.polarization == "s", *found))

    best = least_squares(
        residuals, [1.5, 0.2, 0.5, 0.4], bounds=([1.01, 0.0, 0.01, 0.01], [3.0, 3.0, 1.0, 4.0])
    )
    rms = np.sqrt(np.mean(best.fun**2))
    assert choice.candidates[0].rms_dex == pytest.approx(rms, rel=2e-4)


def test_named_effects_are_left_alone():
    config = RunConfig(effects=("lambert",))
    assert choose_effects(simulated(1), config, seed=1) == (config, None)


def test_a_posterior_needs_effects_by_name():
    with pytest.raises(ConfigError, match="effects = auto"):
        build_posterior(simulated(1), AUTO)


@pytest.fixture
def gains(monkeypatch):
    """Nothing is fitted: another line shape gains what is given, an effect loses."""

    def patch(gain):
        def scored(config, whole, best, cases):
            better = gain * (config.line_shape != "lorentzian") - 0.1 * len(config.effects)
            return choosing._Tried(
                config=config, names=whole.parameter_names, optimum=best,
                n_free=len(whole.of_model), rms_dex=0.1,
                log_rms=-better + 1e-3 * np.arange(len(cases)), at_bound=("rho0",), microseconds=1.0,
            )  # fmt: skip

        monkeypatch.setattr(choosing, "_try", scored)
        monkeypatch.setattr(choosing, "_optimum", lambda whole, _: np.zeros(whole.n_par))
        monkeypatch.setattr(choosing, "_highest", lambda _, starts: starts[0])

    return patch


def test_two_cases_are_called_hardly_any_statistics(gains):
    gains(0.0)
    measurement = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(10.0, 50.0), theta_r_deg=GRID, polarizations=("u",)
    )
    _, choice = choose_effects(measurement, AUTO, seed=1)
    assert len(choice.cases) == 2
    assert choice.caution == say("effects.few", n=2)


@pytest.mark.parametrize(("gain", "tried"), [
    (0.5, {"lorentzian", "cauchy", "gaussian", "voigt"}),
    (0.01, {"lorentzian", "cauchy"}),
    (-0.5, {"lorentzian", "cauchy"}),
])  # fmt: skip
def test_other_line_shapes_are_tried_where_the_cauchy_shape_gains(gains, gain, tried):
    """And the Gaussian, which needs no parameter more, is taken where it does as well."""
    gains(gain)
    config, choice = choose_effects(simulated(2), AUTO, seed=1)
    assert {c.line_shape for c in choice.candidates} == tried
    assert config.line_shape == ("gaussian" if gain == 0.5 else "lorentzian")
    assert choice.caution == ""
