"""Priors that leave no sample are named and refused, and nothing is left behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.prior_support import (
    possible_samples,
    refuse_impossible_priors,
    refuse_untold_instrument,
)
from pbrdf_bayes.io.tidy_writer import write_tidy_csv

pytestmark = pytest.mark.usefixtures("signals_as_before")


def fixed(**values: float) -> dict[str, dict[str, object]]:
    return {name: {"kind": "fixed", "value": value} for name, value in values.items()}


BAD = [
    (
        ("lambert",), fixed(sigma_n0=1.0, lambert=0.5),
        r"priors: sigma_n0 fixed at 1, lambert fixed at 0\.5: of 16384 samples .* Lower one of them",
    ),
    (("volume", "bulk"), {"bulk": {"kind": "uniform", "low": 0.99}, **fixed(volume=0.9)},
     r"sigma_n0 Uniform\[0, 1\], volume fixed at 0\.9, bulk Uniform\[0\.99, 1\]"),
    ((), fixed(n=1.0, k=0.0), r"priors: n fixed at 1, k fixed at 0: that is no surface"),
    ((), fixed(sigma_n0=0.0), r"priors: sigma_n0 fixed at 0: such a sample reflects nothing"),
    (("lambert",), fixed(sigma_n0=0.0, lambert=0.0), r"such a sample reflects nothing"),
]  # fmt: skip


@pytest.mark.parametrize(("effects", "priors", "message"), BAD)
def test_impossible_priors_are_named(small_csv, effects, priors, message) -> None:
    config = pb.RunConfig(effects=effects, priors=priors, accuracy="draft")
    with pytest.raises(pb.ConfigError, match=message):
        pb.fit(pb.read_measurement(small_csv), config)


def test_the_program_ends_with_two_and_no_folder(here, capsys, small_csv) -> None:
    text = 'effects = ["lambert"]\n[priors]\n'
    text += "".join(
        f'{name} = {{ kind = "fixed", value = {value} }}\n'
        for name, value in (("sigma_n0", 1.0), ("lambert", 0.5))
    )
    Path("run.toml").write_text(text, encoding="utf-8")
    assert main(["fit", str(small_csv), "--config", "run.toml", "--out", "o", "--quiet"]) == 2
    captured = capsys.readouterr()
    assert "priors: sigma_n0 fixed at 1, lambert fixed at 0.5" in captured.err
    assert captured.out == ""
    assert [path.name for path in here.iterdir()] == ["run.toml"]


UNTOLD = [
    ("scale_p", {"polarizations": ("s",)}, r"'scale_p' needs s and p scans .* no p scans"),
    ("leakage", {"polarizations": ("p",)}, r"'leakage' needs s and p scans .* no s scans"),
    ("leakage", {"polarizations": ("u",)}, r"'leakage' needs s and p .* no s scans and p scans"),
    ("dhr_offset", {"dhr_theta_i_deg": ()}, r"'dhr_offset' needs DHR readings"),
]  # fmt: skip


def scans_of(**choices: object) -> pb.Measurement:
    return pb.simulate_measurement(
        pb.GREEN_PAINT, seed=1, theta_i_deg=(20.0, 60.0), theta_r_deg=[-40.0, 0.0, 40.0], **choices
    )


@pytest.mark.parametrize(("effect", "choices", "message"), UNTOLD)
def test_effects_of_the_instrument_that_nothing_could_tell(effect, choices, message) -> None:
    """A value that is known, fixed by its prior, corrects the readings all the same."""
    measurement = scans_of(**choices)
    with pytest.raises(pb.ConfigError, match=message):
        pb.fit(measurement, pb.RunConfig(effects=(effect,), accuracy="draft"))
    known = pb.RunConfig(effects=(effect,), priors=fixed(**{effect: 0.0 + (effect == "scale_p")}))
    refuse_untold_instrument(pb.build_posterior(measurement, known))


@pytest.mark.parametrize("effect", ["scale_p", "leakage", "dhr_offset", "aperture", "volume"])
def test_effects_that_readings_can_tell_are_fitted(effect: str) -> None:
    refuse_untold_instrument(pb.build_posterior(scans_of(), pb.RunConfig(effects=(effect,))))


@pytest.mark.parametrize("effect", ["scale_p", "leakage"])
def test_the_program_writes_nothing_for_an_effect_that_nothing_could_tell(
    here, capsys, effect: str
) -> None:
    write_tidy_csv(scans_of(polarizations=("s",)), Path("s.csv"))
    assert main(["fit", "s.csv", "--effects", effect, "--out", "o", "--quiet"]) == 2
    captured = capsys.readouterr()
    assert f"effects: '{effect}' needs s and p scans" in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert not Path("o").exists()


def test_a_black_surface_over_diffuse_scatter_is_possible(small_csv) -> None:
    config = pb.RunConfig(effects=("lambert",), priors=fixed(sigma_n0=0.0))
    refuse_impossible_priors(pb.build_posterior(pb.read_measurement(small_csv), config))


def test_a_sliver_of_the_prior_is_enough(small_csv) -> None:
    """Beside sigma_n0 = 1 an albedo below 0.004 is left: one sample of the prior in 250."""
    config = pb.RunConfig(effects=("lambert",), priors=fixed(sigma_n0=1.0), noise="iid")
    posterior = pb.build_posterior(pb.read_measurement(small_csv), config)
    column = posterior.parameter_names.index("lambert")
    refuse_impossible_priors(posterior)
    assert 0 < len(possible_samples(posterior)) < 200
    draws = posterior.sample_prior(np.random.default_rng(1), 4000)[:, column]
    assert draws.max() < 0.02
    assert np.unique(draws).size == 4000
    best = find_map(posterior, n_starts=2, seed=0).best
    assert best.x[column] < 0.02
