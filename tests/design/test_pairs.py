"""Log-likelihoods of many scans under many sets, against dense normal densities of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pbrdf_bayes.design.pairs import matched_log_likelihoods, pair_log_likelihoods

N_ROWS, N_SETS, N_SIMULATED = 20, 4, 3


def case(rng: np.random.Generator, n_scans: int) -> dict[str, np.ndarray]:
    theta = np.sort(rng.uniform(-80.0, 80.0, N_ROWS))
    theta[5] = theta[4]  # an old reading at the angle of a new one
    scan = rng.integers(0, n_scans, N_ROWS)
    scan[:n_scans] = np.arange(n_scans)
    shape = (N_SETS, N_ROWS)
    tau = rng.uniform(0.02, 0.1, N_SETS)
    tau[0] = 0.0
    mean = rng.normal(size=shape)
    return {
        "y": mean[0][:, None] + 0.1 * rng.normal(size=(N_ROWS, N_SIMULATED)), "theta_r": theta,
        "scan": scan, "mean": mean, "share": rng.uniform(0.3, 1.0, shape),
        "variance": rng.uniform(1e-3, 1e-2, shape), "tau": tau,
        "ell": rng.uniform(5.0, 40.0, N_SETS),
    }  # fmt: skip


def dense(c: dict[str, np.ndarray], m: int, rough: bool, u_cal2: float) -> np.ndarray:
    gap = np.abs(c["theta_r"][:, None] - c["theta_r"])
    a = gap / c["ell"][m] if rough else np.sqrt(3.0) * gap / c["ell"][m]
    path = c["tau"][m] ** 2 * (np.exp(-a) if rough else (1.0 + a) * np.exp(-a))
    common = path + u_cal2 * (c["scan"][:, None] == c["scan"])
    return c["share"][m][:, None] * common * c["share"][m] + np.diag(c["variance"][m])


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize(
    ("u_cal2", "n_scans", "tolerance"), [(0.0, 1, 1e-12), (0.01, 1, 1e-12), (100.0, 3, 1e-9)]
)
def test_against_dense_densities(
    rough: bool, u_cal2: float, n_scans: int, tolerance: float
) -> None:
    c = case(np.random.default_rng(5), n_scans)
    found = pair_log_likelihoods(**c, rough=rough, u_cal2=u_cal2)
    wanted = [
        [
            multivariate_normal.logpdf(c["y"][:, i], c["mean"][m], dense(c, m, rough, u_cal2))
            for m in range(N_SETS)
        ]
        for i in range(N_SIMULATED)
    ]
    np.testing.assert_allclose(found, wanted, rtol=tolerance)


def test_matched_sets_are_those_of_each_scan() -> None:
    c = case(np.random.default_rng(6), 1)
    every = pair_log_likelihoods(**c, rough=False, u_cal2=0.01)
    twice = {k: np.concatenate([v, v, v]) if v.shape[0] == N_SETS else v for k, v in c.items()}
    found = matched_log_likelihoods(**twice, rough=False, u_cal2=0.01)
    np.testing.assert_allclose(found, every, rtol=1e-13)
