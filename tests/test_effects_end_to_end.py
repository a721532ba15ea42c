"""A sample with effects from its readings to report and prediction, by the command line alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import main

pytestmark = pytest.mark.slow

TRUTH = {
    "n": 1.5, "k": 0.2, "sigma_n0": 0.6, "rho0": 0.4, "lambert": 0.03, "volume": 0.05,
    "asymmetry": 0.45, "scale_p": 0.97,
}  # fmt: skip
CONFIG = """
line_shape = "gaussian"
effects = ["lambert", "volume", "scale_p"]
holdout = false

[priors.n]
kind = "fixed"
value = 1.5
"""
FIXED = {"n": 1.5, "asymmetry": 0.45}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated readings of such a sample, and the fit of them."""
    base = tmp_path_factory.mktemp("effects")
    (base / "truth.json").write_text(
        json.dumps(TRUTH | {"line_shape": "gaussian"}), encoding="utf-8"
    )
    (base / "pbrdf.toml").write_text(CONFIG, encoding="utf-8")
    csv, out = str(base / "sample.csv"), str(base / "run")
    angles = ["--theta-i", "20,50,70", "--theta-r=-80:80:4", "--dhr-theta-i", "20,50,70"]
    truth = ["--params", str(base / "truth.json"), "--seed", "2"]
    assert main(["simulate", *truth, *angles, "--out", csv]) == 0
    fitted = ["fit", csv, "--config", str(base / "pbrdf.toml"), "--accuracy", "draft"]
    assert main([*fitted, "--out", out, "--seed", "1"]) == 0
    return base


def test_the_fit_finds_what_was_simulated(folder: Path) -> None:
    summary = load_analysis(folder / "run").summary
    parameters = summary["parameters"]
    assert summary["model"] == (
        "four-parameter model with lambert, volume, scale_p, gaussian line shape"
    )
    assert {n: p["mean"] for n, p in parameters.items() if p["kind"] == "fixed"} == FIXED
    assert parameters["scale_p"]["kind"] == "instrument"
    for name in TRUTH.keys() - FIXED.keys():
        p = parameters[name]
        assert abs(p["mean"] - TRUTH[name]) < 4.0 * p["sd"], (name, p["mean"], p["sd"])


def test_correlations_are_those_of_the_free_parameters(folder: Path) -> None:
    found = load_analysis(folder / "run").summary["correlation"]
    matrix = np.array(found["matrix"])
    assert not FIXED.keys() & set(found["names"])
    assert np.isfinite(matrix).all()
    assert matrix.shape == (len(found["names"]),) * 2


def test_the_report_names_the_model_and_what_is_held(folder: Path) -> None:
    page = (folder / "run" / "report.html").read_text(encoding="utf-8")
    assert "four-parameter model with lambert, volume, scale_p, gaussian line shape" in page
    assert "Held fixed: n = 1.5, b = 0.45." in page
    for part in ("Physical parameters", "Instrument", "Noise and calibration", "Held fixed"):
        assert f">{part}</th>" in page


def test_predictions_hold_the_readings(folder: Path) -> None:
    """Nine of ten readings lie in the predictive band, within four standard errors."""
    out = folder / "predicted.csv"
    angles = ["--theta-i", "20,50,70", "--theta-r=-80:80:4"]
    assert main(["predict", str(folder / "run"), *angles, "--out", str(out)]) == 0
    keys = ["polarization", "theta_i_deg", "theta_r_deg"]
    readings = pd.read_csv(folder / "sample.csv", comment="#").query("quantity == 'brdf'")
    both = readings.merge(pd.read_csv(out, comment="#"), on=keys, suffixes=("_read", ""))
    assert len(both) == len(readings)
    inside = both.value_read.between(both.pred_q05, both.pred_q95).mean()
    assert abs(inside - 0.9) < 4.0 * np.sqrt(0.9 * 0.1 / len(both))
