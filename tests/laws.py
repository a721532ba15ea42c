"""Small measurements, and posteriors whose law is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.inference.parameters.table import ParameterSpec
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)


@pytest.fixture(scope="session")
def green() -> pb.Parameters:
    """Published parameters of the green paint."""
    return GREEN


@pytest.fixture(scope="session")
def small() -> Measurement:
    """Two angles, s and p, 33 points a scan, and DHR, with 2 % noise."""
    return simulate_measurement(
        GREEN, seed=3, theta_i_deg=(20.0, 60.0), theta_r_deg=np.linspace(-80.0, 80.0, 33),
        dhr_noise=0.0005,
    )  # fmt: skip


@pytest.fixture(scope="session")
def small_posterior(small: Measurement) -> Posterior:
    """Its posterior at draft accuracy."""
    return pb.build_posterior(small, pb.RunConfig(noise="iid", accuracy="draft"))


Columns = list[tuple[str, str, float, float, float]]


def measure(rows: Columns, **columns: Any) -> Measurement:
    """Measurement of (quantity, polarisation, theta_i, theta_r, value) rows."""
    quantity, polarization, theta_i, theta_r, value = zip(*rows, strict=True)
    return measurement_from_columns(
        sample="made up", wavelength_um=1.0, quantity=quantity, polarization=polarization,
        theta_i_deg=theta_i, theta_r_deg=theta_r, value=value, **columns,
    )  # fmt: skip


@pytest.fixture(scope="session")
def make_measurement() -> Callable[..., Measurement]:
    """The function `measure`."""
    return measure


def known_law(
    density: Callable[[Array], Array],
    low: Sequence[float],
    high: Sequence[float],
    *,
    log_coordinate: Sequence[bool] | None = None,
) -> Posterior:
    """A posterior with flat priors on a box and any likelihood: a target of known law."""
    n_par = len(low)
    is_log = log_coordinate or [False] * n_par
    specs = tuple(
        ParameterSpec(
            name=f"x{i}", symbol="x", unit="1", description="", kind="physical",
            prior=Prior(kind="loguniform" if flag else "uniform", low=a, high=b),
            log_coordinate=flag,
        )
        for i, (a, b, flag) in enumerate(zip(low, high, is_log, strict=True))
    )  # fmt: skip

    class Law(Posterior):
        def log_likelihood(self, x: Any) -> Array:
            return self.weight * density(np.asarray(x, dtype=np.float64))

        def log_prob_gradient(self, x: Any) -> tuple[Array, Array]:
            x = np.asarray(x, dtype=np.float64)
            slopes = np.empty(x.shape)
            for i in range(n_par):
                step = np.zeros(n_par)
                step[i] = 1e-6
                up, down = self.log_prob(x + step), self.log_prob(x - step)
                both = np.isfinite(up) & np.isfinite(down)
                rise = np.subtract(up, down, where=both, out=np.zeros(len(x)))
                slopes[:, i] = rise / 2e-6
            return self.log_prob(x), slopes

    nowhere: Any = None
    row = [("dhr", "s", 0.0, np.nan, 0.1)]
    return Law(specs, measure(row), pb.RunConfig(accuracy="draft"), nowhere, nowhere, 6.0)


@pytest.fixture(scope="session")
def make_law() -> Callable[..., Posterior]:
    """The function `known_law`."""
    return known_law
