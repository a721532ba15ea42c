"""Paths of the discrepancy given readings, against the conditional normal law by dense algebra."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest

from pbrdf_bayes.inference.prediction.discrepancy import Process, draw_paths_given


def matern(a: np.ndarray, b: np.ndarray, tau: float, ell: float, rough: bool) -> np.ndarray:
    r = np.abs(a[:, None] - b) / ell
    if rough:
        return np.asarray(tau**2 * np.exp(-r))
    r = np.sqrt(3.0) * r
    return np.asarray(tau**2 * (1.0 + r) * np.exp(-r))


@pytest.mark.parametrize(("u_cal", "rough"), [(0.0, False), (0.05, False), (0.05, True)])
def test_mean_and_covariance_of_the_paths(u_cal: float, rough: bool) -> None:
    tau, ell, s = 0.08, 15.0, 0.02
    read = np.array([-30.0, -10.0, 0.0, 5.0, 20.0, -30.0, 0.0, 20.0])
    scan = np.array([3, 3, 3, 3, 3, 8, 8, 8])
    wanted = np.array([-60.0, -20.0, 2.0, 20.0, 45.0])
    residual = np.array([0.1, 0.05, -0.06, -0.02, 0.03, 0.12, -0.02, 0.05])
    n = 20_000
    paths = draw_paths_given(
        [Process(tau, ell, u_cal, rough)] * n, repeat(np.random.default_rng(5)), read_deg=read, scan=scan,
        residual=np.tile(residual, (n, 1)), variance=np.full((n, read.size), s**2),
        wanted_deg=wanted,
    )  # fmt: skip
    k = matern(read, read, tau, ell, rough) + s**2 * np.eye(read.size)
    k += u_cal**2 * (scan[:, None] == scan)
    cross = matern(wanted, read, tau, ell, rough)
    mean = cross @ np.linalg.solve(k, residual)
    covariance = matern(wanted, wanted, tau, ell, rough) - cross @ np.linalg.solve(k, cross.T)
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(paths.mean(axis=0) - mean) < 4.5 * sd / n**0.5)
    found = np.cov(paths.T)
    error = np.sqrt((np.outer(sd, sd) ** 2 + covariance**2) / n)
    assert np.all(np.abs(found - covariance) < 4.5 * error)
