"""Configuration files: nothing unknown passes, everything resolved comes back."""

from __future__ import annotations

import os
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes.config import ACCURACIES, RunConfig
from pbrdf_bayes.effects_table import LINE_SHAPES
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.config_toml import config_from_table, config_table, config_to_toml, read_config
from pbrdf_bayes.io.outside import MAX_TEXT_BYTES

FULL = """
noise = "iid"
discrepancy = "matern-1/2"
tails = "student-t"
student_dof = 6
effects = []
line_shape = "lorentzian"
fresnel_at = "mean-sine"
accuracy = "draft"
prior = "metal"
brdf_floor = 1e-6
angle_tolerance_deg = 0.1
brdf_scale = "relative"
u_brdf_cal = 0.03
u_dhr_cal = 0.02
predict_theta_i_deg = [10.0, 45]
holdout = false
n_ensembles = 6
n_walkers = 48
max_steps = 5000
threads = 1

[priors.n]
kind = "normal"
mean = 1.5
sd = 0.05

[priors.rho0]
kind = "uniform"
low = 0.1
high = 1
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_is_read(tmp_path: Path) -> None:
    found = read_config(write(tmp_path, FULL), {})
    assert set(tomllib.loads(FULL)) == {f.name for f in fields(RunConfig)}
    assert found == RunConfig(
        noise="iid", discrepancy="matern-1/2", tails="student-t", student_dof=6,
        accuracy="draft", prior="metal", brdf_floor=1e-6, angle_tolerance_deg=0.1, brdf_scale="relative", u_brdf_cal=0.03,
        u_dhr_cal=0.02, predict_theta_i_deg=(10.0, 45.0), holdout=False, n_ensembles=6, n_walkers=48,
        max_steps=5000, threads=1, priors={
            "n": {"kind": "normal", "mean": 1.5, "sd": 0.05},
            "rho0": {"kind": "uniform", "low": 0.1, "high": 1},
        },
    )  # fmt: skip


def test_an_empty_file_or_none_gives_the_defaults(tmp_path: Path) -> None:
    assert read_config(None, {}) == RunConfig()
    assert read_config(write(tmp_path, ""), {}) == RunConfig()
    assert read_config(write(tmp_path, "\ufeff# only a comment\r\n"), {}) == RunConfig()


def test_the_resolved_configuration_reads_back(tmp_path: Path) -> None:
    for config in (RunConfig(), read_config(write(tmp_path, FULL), {})):
        text = config_to_toml(config)
        assert read_config(write(tmp_path, text), {}) == config
        assert set(tomllib.loads(text)) >= {f.name for f in fields(RunConfig)} - {"priors"}
        assert config_from_table(config_table(config)) == config


numbers = st.floats(0.0, 1.0)


@given(
    floor=st.floats(0.0, 1e3), cal=numbers, dhr_cal=numbers,
    angles=st.lists(st.floats(0.0, 89.95), max_size=4), accuracy=st.sampled_from(sorted(ACCURACIES)),
    steps=st.integers(100, 10_000_000), holdout=st.booleans(), mean=st.floats(-1e6, 1e6),
    sd=st.floats(1e-9, 1e6),
)  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_round_trip_of_any_configuration(
    floor: float, cal: float, dhr_cal: float, angles: list[float], accuracy: str, steps: int,
    holdout: bool, mean: float, sd: float, tmp_path_factory: pytest.TempPathFactory,
) -> None:  # fmt: skip
    config = RunConfig(
        brdf_floor=floor, u_brdf_cal=cal, u_dhr_cal=dhr_cal, predict_theta_i_deg=tuple(angles),
        accuracy=accuracy, max_steps=steps, holdout=holdout,
        priors={"n": {"kind": "normal", "mean": mean, "sd": sd}},
    )  # fmt: skip
    path = tmp_path_factory.mktemp("config") / "run.toml"
    path.write_text(config_to_toml(config), encoding="utf-8")
    assert read_config(path, {}) == config


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, 'accuracy = "draft"\nholdout = false\n')
    found = read_config(path, {"accuracy": "reference", "effects": None})
    assert (found.accuracy, found.holdout, found.effects) == ("reference", False, ())


BAD = [
    ('accurracy = "draft"', r"run\.toml: unknown key 'accurracy'\. Did you mean 'accuracy'\?"),
    ("Priors = 1", r"unknown key 'Priors'\. Did you mean 'priors'\?"),
    ("zzz = 1", r"unknown key 'zzz'\. Known: noise, discrepancy"),
    ('accuracy = "drafft"', r"accuracy = 'drafft' is not known\. Did you mean 'draft'\?"),
    ('accuracy = "DRAFT"', r"Did you mean 'draft'\?"),
    ("accuracy = 3", r"accuracy = 3 is not allowed: give a word in quotes"),
    ('noise = "student"', r"noise = 'student' is not known"),
    ('discrepancy = "matern"', r"discrepancy = 'matern' is not known.*'matern-3/2', 'matern-1/2'"),
    ('tails = "student"', r"tails = 'student' is not known\. Did you mean 'student-t'\?"),
    ("student_dof = 0.5", r"student_dof = 0\.5 is not allowed: give a number in \[1, 30\]"),
    ("student_dof = inf", r"student_dof = inf is not allowed"),
    ('line_shape = "gauss"', r"line_shape = 'gauss' is not known"),
    ('effects = "lambert"', r"effects = 'lambert' is not allowed: give a list"),
    ('effects = ["no_such_effect"]', r"effects = 'no_such_effect' is not known"),
    ('prior = "glass"', r"prior = 'glass' is not known.*Allowed: 'paint', 'dielectric', 'metal'"),
    ("holdout = 1", r"holdout = 1 is not allowed: give true or false"),
    ('holdout = "yes"', r"holdout = 'yes' is not allowed: give true or false"),
    ("brdf_floor = -1.0", r"brdf_floor = -1\.0 is not allowed: give a number in \[0, 1000\]"),
    ("brdf_floor = nan", r"brdf_floor = nan is not allowed"),
    ("brdf_floor = inf", r"brdf_floor = inf is not allowed"),
    ('brdf_floor = "1e-6"', r"brdf_floor = '1e-6' is not allowed"),
    ("brdf_floor = true", r"brdf_floor = True is not allowed"),
    ("u_brdf_cal = 1.5", r"u_brdf_cal = 1\.5 is not allowed: give a number in \[0, 1\]"),
    ('brdf_scale = "free"', r"brdf_scale = 'free' is not known"),
    ("predict_theta_i_deg = 20.0", r"predict_theta_i_deg = 20\.0 is not allowed: give a list"),
    ("predict_theta_i_deg = [95.0]", r"predict_theta_i_deg = 95\.0 is not allowed"),
    ('predict_theta_i_deg = ["a"]', r"predict_theta_i_deg = 'a' is not allowed"),
    ("n_ensembles = 3", r"n_ensembles = 3 is not allowed: give a number in \[4, 64\]"),
    ("n_walkers = 32.0", r"n_walkers = 32\.0 is not allowed: give a whole number"),
    ("n_walkers = true", r"n_walkers = True is not allowed"),
    ("max_steps = 10", r"max_steps = 10 is not allowed"),
    ("threads = 0", r"threads = 0 is not allowed"),
    ("priors = 1", r"priors = 1 is not allowed: give a table"),
    ("[priors]\nn = 1.5", r"priors: give one table for each parameter, e\.g\. \[priors\.n\]"),
    ("accuracy = draft", r"run\.toml: not a TOML file"),
    ('accuracy = "draft"\naccuracy = "draft"', r"not a TOML file"),
    ("[accuracy]\nrtol = 1e-9", r"accuracy = .* is not allowed: give a word in quotes"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[text.split("\n")[-1] for text, _ in BAD])
def test_what_is_wrong_is_named_with_its_remedy(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match=message) as caught:
        read_config(path, {})
    assert "run.toml" in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.toml: cannot be read \(No such file"):
        read_config(tmp_path / "nothing.toml", {})
    with pytest.raises(ConfigError, match=r"cannot be read"):
        read_config(tmp_path, {})
    (tmp_path / "latin.toml").write_bytes(b'prior = "m\xe9tal"')
    with pytest.raises(ConfigError, match=r"latin\.toml: not a TOML file"):
        read_config(tmp_path / "latin.toml", {})


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_only_ordinary_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", Path("/dev/zero")):
        with pytest.raises(ConfigError, match=r"cannot be read \(a device or a pipe: write its"):
            read_config(path, {})


def test_a_file_without_end_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(b"#" * (MAX_TEXT_BYTES - 1) + b"\n")
    assert read_config(file, {}) == RunConfig()
    file.write_bytes(b"#" * MAX_TEXT_BYTES + b"\n")
    with pytest.raises(ConfigError, match=r"run\.toml: cannot be read \(larger than 1 MiB"):
        read_config(file, {})


@pytest.mark.parametrize("part", ["a", '"a b"', "'!'", '"\\""'])
@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "[[{}]]", "x = {{{} = 1}}"])
def test_a_key_that_would_take_hours_is_refused(tmp_path: Path, part: str, line: str) -> None:
    """What reads TOML takes the square of the parts of a key: half a megabyte is half a day."""
    file = tmp_path / "run.toml"
    file.write_text(line.format(" . ".join([part] * 50_000)))
    with pytest.raises(ConfigError, match="a key of more than 32 parts"):
        read_config(file, {})


@pytest.mark.parametrize("digits", ["9" * 4000, "0x" + "f" * 9000, str(2**63), str(-(2**63) - 1)])
def test_whole_numbers_have_64_bits(tmp_path: Path, digits: str) -> None:
    file = tmp_path / "run.toml"
    file.write_text(f"predict_theta_i_deg = [1, {digits}]\n".replace("0x-", "-0x"))
    with pytest.raises(ConfigError, match=r"run\.toml: predict_theta_i_deg\[2\] = .* 64 bits"):
        read_config(file, {})


def test_a_table_with_an_unknown_key_is_our_error() -> None:
    """For instance the configuration of a run made by a later version."""
    table: dict[str, Any] = {**config_table(RunConfig()), "chromatic": True}
    with pytest.raises(ConfigError, match="chromatic"):
        config_from_table(table)


@pytest.mark.parametrize(
    ("word", "place"),
    [
        *((shape, f'a line shape: give line_shape = "{shape}"') for shape in LINE_SHAPES),
        ("geometric-mean", 'give fresnel_at = "geometric-mean"'),
        ("depolarisation", "a key of a scene"),
        ("reciprocal", "--normalisation reciprocal"),
    ],
)
def test_a_word_that_is_no_effect_is_shown_its_place(tmp_path, word, place):
    """Beside it stand the file or the option, the key, and all that is allowed."""
    path = tmp_path / "run.toml"
    path.write_text(f"effects = ['{word}']\n", encoding="utf-8")
    cases = ((path, {}, str(path)), (None, {"effects": (word,)}, "--effects"))
    for file, options, where in cases:
        with pytest.raises(ConfigError) as one:
            read_config(file, options)
        message = str(one.value)
        assert message.startswith(f"{where}: effects = '{word}' is not known. It is ")
        assert place in message
        assert "Allowed: none (effects = [] in a configuration), 'auto' alone, or any" in message


def test_none_in_a_file_is_an_empty_list(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text('effects = ["none"]\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"run\.toml: effects = .* Give \[\]"):
        read_config(path, {})


def test_a_wrong_option_is_named_and_not_the_file(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text('effects = ["volume"]\n', encoding="utf-8")
    for file in (path, None):
        with pytest.raises(ConfigError, match=r"^--effects: effects = 'lambrt' .*'lambert'") as one:
            read_config(file, {"accuracy": "draft", "effects": ("lambrt",)})
        assert "run.toml" not in str(one.value)
    with pytest.raises(ConfigError, match=r"^--brdf-floor: brdf_floor = -1"):
        read_config(path, {"brdf_floor": -1.0})
    path.write_text('effects = ["lambrt"]\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"run\.toml: effects = 'lambrt'"):
        read_config(path, {"accuracy": "draft"})
