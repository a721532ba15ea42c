"""Values of effects: which do nothing, and are refused where they look as if they did."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main
from pbrdf_bayes.effects_table import EFFECTS, LINE_SHAPES
from pbrdf_bayes.inference.parameters.effects import effect_spec
from pbrdf_bayes.model.effects import effects_of_fit
from pbrdf_bayes.workflow.parameters_json import read_parameters

pytestmark = pytest.mark.usefixtures("signals_as_before")

GREEN = {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}
IDLE: list[tuple[dict[str, Any], str]] = [
    ({"nu": 2.0}, r"nu = 2\.0 does nothing without line_shape = 'cauchy': give that, or leave nu"),
    ({"line_shape": "gaussian", "nu": 2}, r"nu = 2 does nothing without line_shape = 'cauchy'"),
    ({"line_shape": "cauchy", "nu": 2.0, "eta": 0.5}, r"eta = 0\.5 .* line_shape = 'voigt'"),
    ({"asymmetry": 0.6}, r"asymmetry = 0\.6 does nothing without volume > 0"),
    ({"backscatter_width": 0.1}, r"backscatter_width = 0\.1 does nothing without backscatter > 0"),
]


@pytest.mark.parametrize(("given", "message"), IDLE)
def test_what_does_nothing_is_refused(here, capsys, given: dict[str, Any], message: str) -> None:
    with pytest.raises(pb.DomainError, match=message):
        pb.Effects(**given)
    with pytest.raises(pb.DomainError, match=message):
        read_parameters(json.dumps(GREEN | given))
    assert main(["predict", "--params", json.dumps(GREEN | given), "--out", "o.csv"]) == 2
    assert "does nothing without" in capsys.readouterr().err
    assert not list(here.iterdir())


def test_what_is_used_or_null_is_taken() -> None:
    pb.Effects(line_shape="cauchy", nu=2.0)
    pb.Effects(line_shape="voigt", eta=0.5)
    pb.Effects(volume=0.01, asymmetry=0.6, backscatter=0.01, backscatter_width=0.1)
    assert pb.Effects(nu=1.0, eta=1.0, asymmetry=0.45, backscatter_width=0.05).is_null


def test_a_fit_may_end_at_a_strength_of_zero() -> None:
    """Its summary is read all the same."""
    rows = {name: {"map": value} for name, value in GREEN.items()}
    rows |= {"volume": {"map": 0.0}, "asymmetry": {"map": 0.6}, "nu": {"map": 1.4}}
    rows |= {"backscatter": {"map": 0.01}, "backscatter_width": {"map": 0.2}}
    text = json.dumps({"parameters": rows, "line_shape": "cauchy"})
    _, effects = read_parameters(text)
    wanted = pb.Effects(line_shape="cauchy", nu=1.4, backscatter=0.01, backscatter_width=0.2)
    assert effects == wanted
    assert effects_of_fit({"eta": 0.3}).is_null


def test_the_readme_states_the_prior_of_every_parameter() -> None:
    text = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    section = text.split("## Effects")[1].split("\n## ")[0]

    def prior(name: str) -> str:
        return effect_spec(name).prior.describe()

    rows = re.findall(r"^\| `.*\|$", section, re.MULTILINE)
    for name, effect in EFFECTS.items():
        row = next(line for line in rows if f"`{name}`" in line.split("|")[1])
        stated = row.split("|")[4].strip()
        assert stated == "; ".join(dict.fromkeys(map(prior, effect.parameters))), name
    for name in (name for shape in LINE_SHAPES.values() for name in shape.parameters):
        assert re.search(rf"`{name}`\s(?:has\s)?{re.escape(prior(name))}", section)
