"""Widths of single scans against truths, independent fits and repeated noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import pbrdf_bayes as pb
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.scan_widths import THETA_I_DEG, measure_widths, widths_at
from pbrdf_bayes.model.simulate import simulate_measurement
from tests.laws import GREEN

THETA_R = np.linspace(-80.0, 80.0, 81)
X_IID = np.array([1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 5e-4])
X_CORRELATED = np.array([1.526, 0.193, 0.4528, 0.47, 0.01, 0.01, 0.05, 30.0, 5e-4])


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    """Two angles, s and p, 2 degrees apart; independent readings."""
    m = simulate_measurement(GREEN, seed=1, theta_i_deg=(0.0, 60.0), theta_r_deg=THETA_R)
    return pb.build_posterior(m, pb.RunConfig(noise="iid"))


def with_log(posterior: Posterior, y) -> Posterior:
    return replace(posterior, rows=posterior.rows._replace(y=np.asarray(y)))


def exact(posterior: Posterior, x):
    return np.log(posterior.predict(x[None, :])[0][0])


def reflectance(q, sine):
    """Textbook Fresnel equations."""
    m = 1.526 - 0.193j
    cos, root = np.sqrt(1.0 - sine**2), np.sqrt(m**2 - sine**2)
    r = (cos - root) / (cos + root) if q == "s" else (m**2 * cos - root) / (m**2 * cos + root)
    return np.abs(r) ** 2


def test_a_scan_of_another_width_and_scale_is_found(posterior: Posterior) -> None:
    own = {"s 0 deg": (0.47, 1.0), "p 0 deg": (0.05, 3.0), "s 60 deg": (0.6, 0.8),
           "p 60 deg": (1.9, 1.3)}  # fmt: skip
    y = np.zeros(len(posterior.measurement.brdf))
    for scan in posterior.measurement.scans:
        rho0, scale = own[scan.label]
        surface = replace(GREEN, rho0=rho0)
        f = pb.brdf(surface, scan.theta_i_deg, THETA_R, scan.polarization, rtol=1e-10)
        y[scan.rows] = np.log(scale * f)
    for found in measure_widths(with_log(posterior, y), X_IID[None, :], X_IID).scans:
        rho0, scale = own[found.label]
        assert found.rho0 == pytest.approx(rho0, rel=1e-4)
        assert found.scale == pytest.approx(scale, rel=1e-4)
        assert found.u_rho0 < 1e-3 * rho0
        sine = np.sin(np.deg2rad(found.theta_i_deg))
        q = found.polarization
        narrowed = (1.0 - reflectance(q, sine)) / (1.0 - reflectance(q, 0.0))
        assert found.rho == pytest.approx(rho0 * narrowed, rel=1e-4)
        assert found.rho_model == pytest.approx(0.47 * narrowed, rel=1e-9)


def test_a_fit_by_another_way_finds_the_same(posterior: Posterior) -> None:
    """Two free parameters by scipy on the public BRDF, standard error from its Jacobian."""
    scan = posterior.measurement.scans[-1]
    found = measure_widths(posterior, X_IID[None, :], X_IID).scans[-1]
    y = np.log(posterior.measurement.brdf.value[scan.rows])

    def residuals(p):
        surface = replace(GREEN, rho0=float(np.exp(p[0])))
        return y - p[1] - np.log(pb.brdf(surface, 60.0, THETA_R, "p", rtol=1e-10))

    fit = least_squares(residuals, [np.log(0.4), 0.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * 2.0 * fit.cost / (y.size - 2)
    assert found.rho0 == pytest.approx(np.exp(fit.x[0]), rel=1e-5)
    assert found.scale == pytest.approx(np.exp(fit.x[1]), rel=1e-5)
    assert found.lag1 < 0.1, "independent readings: nothing is added to the error"
    assert found.u_rho0 / found.rho0 == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)


def autoregressive(n, share):
    return share ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))


def matern(ell):
    a = np.sqrt(3.0) * np.abs(np.subtract.outer(THETA_R, THETA_R)) / ell
    return (1.0 + a) * np.exp(-a)


@pytest.mark.parametrize(
    ("noise", "covariance", "x", "within"),
    [
        ("iid", 0.02**2 * np.eye(81), X_IID, (0.85, 1.2)),
        ("iid", 0.02**2 * autoregressive(81, 0.8), X_IID, (0.85, 1.35)),
        ("correlated", 0.05**2 * matern(30.0) + 0.01**2 * np.eye(81), X_CORRELATED, (0.85, 1.2)),
    ],
)
def test_stated_errors_are_those_of_repeated_noise(noise, covariance, x, within) -> None:
    """Scatter of the widths over their stated errors, 240 scans; the interval is 3 sd of that."""
    m = simulate_measurement(GREEN, seed=1, theta_i_deg=(0.0, 60.0), theta_r_deg=THETA_R)
    posterior = pb.build_posterior(m, pb.RunConfig(noise=noise))
    clean, root = exact(posterior, x), np.linalg.cholesky(covariance + 1e-14 * np.eye(81))
    rng, pulls = np.random.default_rng(3), []
    for _ in range(60):
        y = clean.copy()
        for scan in posterior.measurement.scans:
            y[scan.rows] += root @ rng.standard_normal(81)
        found = measure_widths(with_log(posterior, y), x[None, :], x).scans
        pulls += [(s.rho0 - 0.47) / s.u_rho0 for s in found]
    assert within[0] < np.sqrt(np.mean(np.square(pulls))) < within[1]


def test_eq5_is_drawn_with_the_posterior_and_the_exponent(posterior: Posterior) -> None:
    draws = np.tile(X_IID, (5, 1))
    draws[:, 3] = [0.4, 0.45, 0.5, 0.55, 0.6]
    found = measure_widths(posterior, draws, X_IID)
    assert found.polarizations == ("s", "p")
    sine = np.sin(np.deg2rad(THETA_I_DEG))
    for i, q in enumerate("sp"):
        narrowed = (1.0 - reflectance(q, sine)) / (1.0 - reflectance(q, 0.0))
        np.testing.assert_allclose(found.at_map[i], 0.47 * narrowed, rtol=1e-9)
        np.testing.assert_allclose(found.band[i][:, 2], 0.5 * narrowed, rtol=1e-9)
        np.testing.assert_allclose(found.band[i][:, 0], 0.41 * narrowed, rtol=1e-9)
    config = pb.RunConfig(noise="iid", effects=("narrowing",))
    steeper = pb.build_posterior(posterior.measurement, config)
    x = np.insert(X_IID, steeper.parameter_names.index("narrowing"), 2.0)
    squared = widths_at(steeper, x[None, :], np.array([60.0]))[:, 0, 0]
    plain = widths_at(posterior, X_IID[None, :], np.array([60.0]))[:, 0, 0]
    np.testing.assert_allclose(squared[:2], plain[:2] ** 2 / 0.47, rtol=1e-12)
    assert plain[2] == pytest.approx(0.5 * (plain[0] + plain[1]))


def test_effects_are_held_where_they_are(posterior: Posterior) -> None:
    config = pb.RunConfig(noise="iid", effects=("lambert",))
    with_lambert = pb.build_posterior(posterior.measurement, config)
    x = np.insert(X_IID, with_lambert.parameter_names.index("lambert"), 0.01)
    measured = with_log(with_lambert, exact(with_lambert, x))
    for scan in measure_widths(measured, x[None, :], x).scans:
        assert scan.rho0 == pytest.approx(0.47, rel=1e-4)


def test_no_width_where_there_is_none_to_find(make_measurement) -> None:
    """Four readings are too few; a scan that rises away from the peak has no width."""
    angles = np.linspace(-20.0, 60.0, 9)
    rows = [("brdf", "s", 20.0, t, 0.01 * np.exp((t - 20.0) ** 2 / 400.0)) for t in angles]
    rows += [("brdf", "p", 20.0, t, 0.01) for t in angles[:4]]
    posterior = pb.build_posterior(make_measurement(rows), pb.RunConfig(noise="iid"))
    x = X_IID[: posterior.n_par]
    for scan in measure_widths(posterior, x[None, :], x).scans:
        assert np.isnan([scan.rho0, scan.u_rho0, scan.rho, scan.u_rho, scan.scale]).all()
        assert scan.rho_model > 0.0


def test_unpolarised_scans_have_a_curve_of_their_own(make_measurement) -> None:
    values = pb.brdf(replace(GREEN, rho0=0.3), 50.0, THETA_R, "u")
    rows = [("brdf", "u", 50.0, t, f) for t, f in zip(THETA_R, values, strict=True)]
    posterior = pb.build_posterior(make_measurement(rows), pb.RunConfig(noise="iid"))
    x = X_IID[: posterior.n_par]
    found = measure_widths(posterior, x[None, :], x)
    assert found.polarizations == ("u",)
    assert found.scans[0].rho0 == pytest.approx(0.3, rel=1e-4)
    assert found.scans[0].rho / found.scans[0].rho_model == pytest.approx(0.3 / 0.47, rel=1e-4)
    assert found.scans[0].rho_model == pytest.approx(found.at_map[0, 50], rel=1e-9)
