"""The posterior: prior times likelihood as one callable on arrays of parameter sets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.inference.correlated_likelihood import (
    Discrepancy,
    correlated_gradient,
    correlated_log_likelihood,
    prepare_discrepancy,
)
from pbrdf_bayes.inference.filtered_likelihood import (
    Filtered,
    filtered_gradient,
    filtered_log_likelihood,
    prepare_filtered,
)
from pbrdf_bayes.inference.likelihood import iid_gradient, iid_log_likelihood
from pbrdf_bayes.inference.parameters import ParameterSpec, parameter_specs
from pbrdf_bayes.inference.rows import RELATIVE_SCALE, Rows, prepare_rows
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model import digits_of
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of the parameters of one measurement; build it with `build_posterior`.

    Attributes
    ----------
    specs : tuple of ParameterSpec
        What is inferred, in the order of the columns of ``x``.
    measurement : Measurement
    config : RunConfig
    geometry : Geometry
    rows : Rows
    digits : float
        Correct decimal digits of the normalisation.
    discrepancy : Discrepancy or None
        Which rows share a discrepancy of the model; None where they are independent.
    filtered : Filtered or None
        Groups of rows that need assumed-density filtering; None without any.
    weight : float
        Power of the likelihood, 1 for the posterior; see `tempered`.

    Notes
    -----
    ``x`` always has shape (n_sets, n_par) and physical units. The sampler and the optimiser move in
    ``z``: the same columns, with the logarithm where the specification says so.
    """

    specs: tuple[ParameterSpec, ...]
    measurement: Measurement
    config: RunConfig
    geometry: Geometry
    rows: Rows
    digits: float
    discrepancy: Discrepancy | None = None
    weight: float = 1.0
    filtered: Filtered | None = None

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of ``x``."""
        return tuple(spec.name for spec in self.specs)

    @property
    def n_par(self) -> int:
        """Number of parameters."""
        return len(self.specs)

    @cached_property
    def is_log(self) -> NDArray[np.bool_]:
        """Which columns of z are logarithms, shape (n_par,)."""
        return np.array([spec.log_coordinate for spec in self.specs])

    def log_prior(self, x: ArrayLike) -> Array:
        """Natural log of the normalised prior density, shape (n_sets,)."""
        columns = self._checked(x).T
        parts = [spec.prior.log_density(v) for spec, v in zip(self.specs, columns, strict=True)]
        return np.asarray(np.sum(parts, axis=0))

    def log_likelihood(self, x: ArrayLike) -> Array:
        """Natural log of the likelihood, shape (n_sets,).

        Only for parameters inside the support of the prior: the model is computed nowhere else.
        """
        g, rows, law, x = self.geometry, self.rows, self.discrepancy, self._checked(x)
        if self.filtered is not None:
            return self.weight * filtered_log_likelihood(g, rows, self.filtered, x, self.digits)
        if law is None:
            return self.weight * iid_log_likelihood(g, rows, x, self.digits)
        return self.weight * correlated_log_likelihood(g, rows, law, x, self.digits)

    def tempered(self, weight: float) -> Posterior:
        """The same posterior with the likelihood raised to a power: weaker evidence.

        With ``weight`` = effective over actual number of readings it shows what correlated readings
        can identify.
        """
        return replace(self, weight=weight)

    def log_prob(self, x: ArrayLike) -> Array:
        """Natural log of prior times likelihood, shape (n_sets,).

        -inf outside the support, and where the model gives NaN or infinity.
        """
        x = self._checked(x)
        result = self.log_prior(x)
        inside = np.isfinite(result)
        result[inside] += self.log_likelihood(x[inside])
        result[~(result < np.inf)] = -np.inf  # NaN and inf: no place to stay
        return result

    def log_prob_gradient(self, x: ArrayLike) -> tuple[Array, Array]:
        """`log_prob` and its derivatives by ``x``, shapes (n_sets,) and (n_sets, n_par).

        Analytic, from the same pass; zero slope where the density is zero.
        """
        x = self._checked(x)
        values = self.log_prior(x)
        slopes = np.stack(
            [spec.prior.slope(v) for spec, v in zip(self.specs, x.T, strict=True)], axis=1
        )
        inside = np.isfinite(values)
        g, rows, law = self.geometry, self.rows, self.discrepancy
        likelihood, likelihood_slopes = (
            filtered_gradient(g, rows, self.filtered, x[inside], self.digits)
            if self.filtered is not None
            else iid_gradient(g, rows, x[inside], self.digits)
            if law is None
            else correlated_gradient(g, rows, law, x[inside], self.digits)
        )
        values[inside] += self.weight * likelihood
        slopes[inside] += self.weight * likelihood_slopes
        values[~(values < np.inf)] = -np.inf
        return values, np.where(np.isfinite(values)[:, None], slopes, 0.0)

    def sample_prior(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws of the prior, shape (size, n_par)."""
        return self.prior_quantile(rng.random((size, self.n_par)))

    def prior_quantile(self, probability: Array) -> Array:
        """Parameters at cumulative prior probabilities, both of shape (n_sets, n_par)."""
        columns = zip(self.specs, probability.T, strict=True)
        return np.stack([spec.prior.quantile(p) for spec, p in columns], axis=1)

    def to_coordinates(self, x: Array) -> Array:
        """Sampling coordinates z of parameters, same shape."""
        return np.where(self.is_log, np.log(np.where(self.is_log, x, 1.0)), x)

    def from_coordinates(self, z: Array) -> Array:
        """Parameters at sampling coordinates z, same shape."""
        return np.where(self.is_log, np.exp(np.where(self.is_log, np.minimum(z, 300.0), 0.0)), z)

    def log_prob_coordinates(self, z: Array) -> Array:
        """Log-density in the coordinates z, the Jacobian included, shape (n_sets,)."""
        jacobian = z[:, self.is_log].sum(axis=1)
        return np.asarray(self.log_prob(self.from_coordinates(z)) + jacobian)

    def gradient_coordinates(self, z: Array) -> tuple[Array, Array]:
        """`log_prob` of the parameters at z, and its derivatives by z (no Jacobian)."""
        x = self.from_coordinates(z)
        values, slopes = self.log_prob_gradient(x)
        return values, np.where(self.is_log, slopes * x, slopes)

    def predict(self, x: ArrayLike, geometry: Geometry | None = None) -> tuple[Array, Array]:
        """Model BRDF [sr^-1] and DHR [1] of the rows, shapes (n_sets, n_brdf), (n_sets, n_dhr)."""
        return evaluate(geometry or self.geometry, self._checked(x), self.digits)

    def _checked(self, x: ArrayLike) -> Array:
        array = np.ascontiguousarray(x, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != self.n_par:
            names = ", ".join(self.parameter_names)
            msg = f"x has shape {array.shape}; wanted (n_sets, {self.n_par}): columns {names}"
            raise DataError(msg)
        return array


def build_posterior(measurement: Measurement, config: RunConfig) -> Posterior:
    """Posterior of a measurement under the choices of a run.

    Parameters
    ----------
    measurement : Measurement
    config : RunConfig

    Returns
    -------
    Posterior

    Raises
    ------
    ConfigError
        When the configuration does not fit the measurement.
    DataError
        When a BRDF reading is not positive and no floor is given.
    """
    specs = parameter_specs(measurement, config)
    columns = {spec.name: index for index, spec in enumerate(specs)}
    brdf, dhr = measurement.brdf, measurement.dhr
    if config.brdf_floor == 0.0 and (brdf.value <= 0.0).any():
        row = int(brdf.row[np.argmax(brdf.value <= 0.0)])
        msg = (
            f"{measurement.source or measurement.sample}, line {row}, column value: a BRDF reading "
            "that is not positive needs the instrument's floor (brdf_floor > 0), or a flag"
        )
        raise DataError(msg)
    if config.brdf_scale == "relative" and not len(dhr):
        msg = "brdf_scale = 'relative' needs DHR readings: without them no scale is known at all"
        raise ConfigError(msg)
    geometry = prepare_geometry(
        theta_i=np.deg2rad(brdf.theta_i_deg),
        theta_r=np.deg2rad(brdf.theta_r_deg),
        phi_r=np.deg2rad(brdf.phi_r_deg),
        polarization=brdf.polarization,
        dhr_theta_i=np.deg2rad(dhr.theta_i_deg),
        dhr_polarization=dhr.polarization,
    )
    rows = prepare_rows(
        measurement,
        noise_columns={
            q: columns[f"s_rel_{q}"] for q in ("s", "p", "u") if f"s_rel_{q}" in columns
        },
        dhr_noise_column=columns.get("u_dhr", -1),
        floor=config.brdf_floor,
        u_cal=RELATIVE_SCALE if config.brdf_scale == "relative" else config.u_brdf_cal,
        u_dhr_cal=config.u_dhr_cal,
    )
    discrepancy = None
    if "tau" in columns:
        discrepancy = prepare_discrepancy(
            measurement,
            rows,
            tau_column=columns["tau"],
            ell_column=columns["ell_deg"],
            rough=config.discrepancy == "matern-1/2",
        )
    return Posterior(
        specs, measurement, config, geometry, rows, digits_of(config.rtol), discrepancy,
        filtered=prepare_filtered(measurement, rows, config, discrepancy),
    )  # fmt: skip
