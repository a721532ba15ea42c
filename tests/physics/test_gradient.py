"""Analytic derivatives of ln BRDF and DHR against extended precision."""

import json
from pathlib import Path

import numpy as np
import pytest

from pbrdf_bayes.physics.brdf import evaluate_gradient
from pbrdf_bayes.physics.geometry import prepare_geometry

POINTS = json.loads(
    (Path(__file__).parents[1] / "reference" / "gradient_values.json").read_text(encoding="utf-8")
)["points"]
TOLERANCE = 1e-7


def _evaluate(point, q):
    theta_r = np.deg2rad(point["theta_r_deg"])
    theta_i = np.deg2rad(point["theta_i_deg"])
    geometry = prepare_geometry(
        theta_i=np.full(theta_r.size, theta_i),
        theta_r=theta_r,
        phi_r=np.deg2rad(point["phi_r_deg"]),
        polarization=np.full(theta_r.size, q),
        dhr_theta_i=np.array([theta_i]),
        dhr_polarization=np.array([q]),
    )
    x = np.array([[point["n"], point["k"], point["sigma_n0"], point["rho0"]]])
    _, _, log_brdf, dhr = evaluate_gradient(geometry, x, 12.0)
    return log_brdf[0], dhr[0, 0]


@pytest.mark.parametrize("q", ["s", "p"])
@pytest.mark.parametrize("index", range(len(POINTS)))
def test_derivatives_agree_with_extended_precision(index, q):
    point = POINTS[index]
    log_brdf, dhr = _evaluate(point, q)
    expected = np.array(point[f"d_ln_brdf_{q}"])
    # a derivative that nearly vanishes is held against the size it has elsewhere in the domain
    scale = np.maximum(np.abs(expected), 1e-3)
    assert np.max(np.abs(log_brdf - expected) / scale) < TOLERANCE
    expected_dhr = np.array(point[f"d_dhr_{q}"])
    assert np.max(np.abs(dhr - expected_dhr) / np.maximum(np.abs(expected_dhr), 1e-3)) < TOLERANCE
