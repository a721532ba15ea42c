"""``predict --normalisation reciprocal``: the other normalisation, where it applies."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main

pytestmark = pytest.mark.usefixtures("signals_as_before")

PARAMS = '{"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}'


def predict(capsys, *arguments: object) -> list[dict[str, str]]:
    given = ["predict", "--params", PARAMS, "--normalisation", "reciprocal", *map(str, arguments)]
    assert main(given) == 0
    return list(csv.DictReader(io.StringIO(capsys.readouterr().out)))


def test_there_and_back_are_the_same(here, capsys):
    table = {}
    for a, b in ((20, 60), (60, 20)):
        for row in predict(capsys, "--theta-i", a, "--theta-r", b, "--dhr-theta-i", a):
            table[row["quantity"], row["polarization"], a] = float(row["value"])
    for q in "sp":
        assert table["brdf", q, 20] == pytest.approx(table["brdf", q, 60], rel=1e-8)
        for a, b in ((20, 60), (60, 20)):
            wanted = float(pb.reciprocal_brdf(pb.GREEN_PAINT, a, b, q))
            assert table["brdf", q, a] == pytest.approx(wanted, rel=1e-8)
            assert table["dhr", q, a] == pytest.approx(float(pb.dhr(pb.GREEN_PAINT, a, q)))
    ratio = pb.reciprocity_ratio(pb.GREEN_PAINT, 20.0, 60.0, "p")
    assert ratio > 5.0  # with that of the paper


@pytest.mark.parametrize(("more", "message"), [
    (["--params", PARAMS.replace("}", ', "lambert": 0.01}')], "leave the effects out"),
    (["--params", PARAMS, "--phi-r", "30"], "phi_r_deg = 30: out of plane the reciprocal"),
    (["--params", PARAMS, "--scene", "scene.toml", "--out", "o"], "--normalisation with --scene"),
    (["--params", PARAMS, "--rtol", "1e-11"], "rtol = 1e-11 is not allowed here"),
])  # fmt: skip
def test_where_it_does_not_apply_it_is_refused(here, capsys, more, message):
    Path("scene.toml").write_text("theta_i_deg = 20\ntheta_r_deg = 0\n", encoding="utf-8")
    assert main(["predict", "--normalisation", "reciprocal", *more]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.out == ""
    assert not Path("o").exists()


def test_a_run_keeps_the_normalisation_it_was_fitted_with(here, capsys, finished_run):
    assert main(["predict", str(finished_run), "--normalisation", "reciprocal"]) == 2
    assert "was fitted with that of the paper" in capsys.readouterr().err
