"""The posterior: prior times likelihood as one callable on arrays of parameter sets."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.inference.likelihood.correlated import (
    Discrepancy,
    correlated_gradient,
    correlated_log_likelihood,
    prepare_discrepancy,
)
from pbrdf_bayes.inference.likelihood.filtered import (
    Filtered,
    filtered_gradient,
    filtered_log_likelihood,
    prepare_filtered,
)
from pbrdf_bayes.inference.likelihood.iid import iid_gradient, iid_log_likelihood
from pbrdf_bayes.inference.likelihood.rows import RELATIVE_SCALE, Rows, prepare_rows
from pbrdf_bayes.inference.parameters.effects import build_scene
from pbrdf_bayes.inference.parameters.prior_density import PriorTable, tabulate
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.parameters.table import parameter_specs
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.four_parameter import digits_of
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.physics.given import NOTHING_GIVEN, Given
from pbrdf_bayes.physics.hemispherical import conserves_energy
from pbrdf_bayes.physics.scattering import evaluate_scene, evaluate_with_effects
from pbrdf_bayes.physics.scene import Scene
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

_FINER_DIGITS = 4.0
_STEP = 1e-5
_REDRAWS = (50, 250)
_BATCH = 16_384


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
    scene : Scene or None
        Line shape and effects; None for exactly the four-parameter model.
    errors : ndarray, shape (n_errors, n_brdf)
        Sensitivities S of `readings.observation` to the systematic errors; without rows for none.
        Set them by `with_errors`.

    Notes
    -----
    ``x`` always has shape (n_sets, n_par) and physical units. The sampler and the optimiser move in
    ``z``: the columns that are not fixed, with the logarithm where the specification says so.
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
    scene: Scene | None = None
    errors: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of ``x``."""
        return tuple(spec.name for spec in self.specs)

    @property
    def n_par(self) -> int:
        """Number of parameters."""
        return len(self.specs)

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Columns of x that are not fixed, in the order of those of z, shape (n_free,)."""
        return np.flatnonzero([not spec.is_fixed for spec in self.specs])

    @cached_property
    def of_model(self) -> NDArray[np.int64]:
        """Columns of z that the model and not the noise depends on."""
        return np.flatnonzero([self.specs[i].kind != "nuisance" for i in self.free])

    @cached_property
    def is_log(self) -> NDArray[np.bool_]:
        """Which columns of z are logarithms, shape (n_free,)."""
        return np.array([self.specs[i].log_coordinate for i in self.free])

    @cached_property
    def _priors(self) -> PriorTable:
        return tabulate([spec.prior for spec in self.specs])

    def log_prior(self, x: ArrayLike) -> Array:
        """Natural log of the normalised prior density, shape (n_sets,).

        With effects -inf where the sample would reflect more than it receives; the mass lost there
        is not put back into the norm.
        """
        x = self._checked(x)
        found = self._priors.log_density(x)
        if self.scene is not None:
            inside = np.isfinite(found)
            allowed = conserves_energy(self.scene, x[inside])
            found[inside] = np.where(allowed, found[inside], -np.inf)
        return found

    def log_likelihood(self, x: ArrayLike) -> Array:
        """Natural log of the likelihood, shape (n_sets,).

        Only for parameters inside the support of the prior: the model is computed nowhere else.
        """
        x = self._checked(x)
        return self.weight * self._log_likelihood(x, self.digits, self.given(x))

    def _log_likelihood(self, x: Array, digits: float, given: Given) -> Array:
        """With weight 1, by the likelihood of the run."""
        g, rows, law, s = self.geometry, self.rows, self.discrepancy, self.errors[None]
        if self.filtered is not None:
            return filtered_log_likelihood(g, rows, self.filtered, x, digits, given, s)
        if law is None:
            return iid_log_likelihood(g, rows, x, digits, given, s)
        return correlated_log_likelihood(g, rows, law, x, digits, given, s)

    def given(self, x: Array, digits: float | None = None) -> Given:
        """Values of a model with effects at the rows, nothing for the four-parameter model.

        ``x`` has the shape (n_sets, n_par); ``digits`` are those of the posterior by default.
        """
        if self.scene is None:
            return NOTHING_GIVEN
        return Given(*evaluate_scene(self.geometry, self.scene, x, digits or self.digits))

    def with_errors(self, sensitivities: ArrayLike) -> Posterior:
        """The same posterior beside systematic errors that the scans share.

        Parameters
        ----------
        sensitivities : array_like, shape (n_errors, n_brdf)
            Change of ln BRDF of each row with one standard uncertainty of each error.

        Raises
        ------
        DataError
            When the shape is another.
        """
        s = np.ascontiguousarray(sensitivities, dtype=np.float64)
        if s.ndim != 2 or s.shape[1] != self.rows.y.size:
            msg = f"sensitivities have shape {s.shape}; wanted (n_errors, {self.rows.y.size})"
            raise DataError(msg)
        filtered = prepare_filtered(
            self.measurement, self.rows, self.config, self.discrepancy, errors=len(s) > 0
        )
        return replace(self, errors=s, filtered=filtered)

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

        Analytic, from the same pass; for a model with effects, and for systematic errors beside
        censored or Student-t rows, by central differences of a finer quadrature. Zero slope where
        the density is zero.
        """
        x = self._checked(x)
        values = self.log_prior(x)
        slopes = self._priors.slopes(x)
        inside = np.isfinite(values)
        likelihood, likelihood_slopes = self._likelihood_gradient(x[inside])
        values[inside] += self.weight * likelihood
        slopes[inside] += self.weight * likelihood_slopes
        values[~(values < np.inf)] = -np.inf
        return values, np.where(np.isfinite(values)[:, None], slopes, 0.0)

    def _likelihood_gradient(self, x: Array) -> tuple[Array, Array]:
        g, rows, law = self.geometry, self.rows, self.discrepancy
        if self.scene is not None or (self.filtered is not None and self.errors.size):
            return self._differences(x)
        if self.filtered is not None:
            return filtered_gradient(g, rows, self.filtered, x, self.digits)
        if law is None:
            return iid_gradient(g, rows, x, self.digits, self.errors[None])
        return correlated_gradient(g, rows, law, x, self.digits, self.errors[None])

    def _differences(self, x: Array) -> tuple[Array, Array]:
        """Log-likelihood and central differences; at a bound one-sided, from inside.

        The model is computed anew only where a parameter of it moves.
        """
        slopes = np.zeros(x.shape)
        digits = min(self.digits + _FINER_DIGITS, 12.0)
        still = Given(*(np.concatenate([v, v]) for v in self.given(x, digits)))
        for i in self.free:
            spec = self.specs[i]
            step = _STEP * (np.abs(x[:, i]) if spec.log_coordinate else 1.0)
            moved = np.concatenate([x, x])
            above, below = moved[: len(x)], moved[len(x) :]
            above[:, i] = np.minimum(x[:, i] + step, spec.prior.high)
            below[:, i] = np.maximum(x[:, i] - step, spec.prior.low)
            given = still if spec.kind == "nuisance" else self.given(moved, digits)
            ends = self._log_likelihood(moved, digits, given)
            slopes[:, i] = (ends[: len(x)] - ends[len(x) :]) / (above[:, i] - below[:, i])
        return self._log_likelihood(x, self.digits, self.given(x)), slopes

    def sample_prior(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws of the prior, shape (size, n_par).

        Raises
        ------
        ConfigError
            Where next to no sample of the prior reflects less than it receives.
        """
        found = self.prior_quantile(rng.random((size, self.n_par)))
        for turn in range(sum(_REDRAWS)):
            bad = np.flatnonzero(~np.isfinite(self.log_prior(found)))
            if not bad.size:
                return found
            n_new = bad.size if turn < _REDRAWS[0] else _BATCH  # where hardly any is possible
            new = self.prior_quantile(rng.random((n_new, self.n_par)))
            if n_new > bad.size:
                new = new[np.isfinite(self.log_prior(new))][: bad.size]
            if not len(new):
                break
            found[bad[: len(new)]] = new
        msg = (
            "the priors give samples that reflect more than they receive: lower those of sigma_n0 "
            "or of the strengths of the diffuse terms"
        )
        raise ConfigError(msg)

    def prior_quantile(self, probability: Array) -> Array:
        """Parameters at cumulative prior probabilities, both of shape (n_sets, n_par)."""
        columns = zip(self.specs, probability.T, strict=True)
        return np.stack([spec.prior.quantile(p) for spec, p in columns], axis=1)

    def to_coordinates(self, x: Array) -> Array:
        """Sampling coordinates z, shape (..., n_free), of parameters (..., n_par)."""
        free = x[..., self.free]
        return np.where(self.is_log, np.log(np.where(self.is_log, free, 1.0)), free)

    def from_coordinates(self, z: Array) -> Array:
        """Parameters (..., n_par) at sampling coordinates z (..., n_free)."""
        free = np.where(self.is_log, np.exp(np.where(self.is_log, np.minimum(z, 300.0), 0.0)), z)
        if len(self.free) == self.n_par:
            return free
        x = np.empty((*z.shape[:-1], self.n_par))
        x[...] = [spec.prior.mean for spec in self.specs]
        x[..., self.free] = free
        return x

    def log_prob_coordinates(self, z: Array) -> Array:
        """Log-density in the coordinates z, the Jacobian included, shape (n_sets,)."""
        jacobian = z[:, self.is_log].sum(axis=1)
        return np.asarray(self.log_prob(self.from_coordinates(z)) + jacobian)

    def gradient_coordinates(self, z: Array) -> tuple[Array, Array]:
        """`log_prob` of the parameters at z, and its derivatives by z (no Jacobian)."""
        x = self.from_coordinates(z)
        values, slopes = self.log_prob_gradient(x)
        free, slopes = x[:, self.free], slopes[:, self.free]
        return values, np.where(self.is_log, slopes * free, slopes)

    def predict(self, x: ArrayLike, geometry: Geometry | None = None) -> tuple[Array, Array]:
        """Model BRDF [sr^-1] and DHR [1] of the rows, shapes (n_sets, n_brdf), (n_sets, n_dhr)."""
        g, x = geometry or self.geometry, self._checked(x)
        if self.scene is None:
            return evaluate(g, x, self.digits)
        return evaluate_with_effects(g, self.scene, x, self.digits)

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
        noise_columns={q: columns[f"s_rel_{q}"] for q in POLARIZATIONS if f"s_rel_{q}" in columns},
        dhr_noise_column=columns.get("u_dhr", -1),
        floor=config.brdf_floor,
        u_cal=RELATIVE_SCALE if config.brdf_scale == "relative" else config.u_brdf_cal,
        u_dhr_cal=config.u_dhr_cal,
        correlated="tau" in columns,
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
        scene=build_scene(config, tuple(columns)),
    )  # fmt: skip


def normalisation_change(posterior: Posterior, x: Array) -> float:
    """Relative change of the model at the MAP when three more digits are asked for."""
    if not len(posterior.measurement.brdf):
        return 0.0
    coarse, fine = (
        replace(posterior, digits=posterior.digits + extra).predict(x[None, :])[0]
        for extra in (0.0, 3.0)
    )
    return float(np.max(np.abs(coarse / np.maximum(fine, 1e-280) - 1.0)))
