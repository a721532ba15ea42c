"""What is believed before the next measurement: draws of all parameters, and of the instrument.

Nothing here is a best fit: every expectation of the design runs over these draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.priors import NOISE_PRIORS
from pbrdf_bayes.inference.parameters.table import DISCREPANCY, PHYSICAL, parameter_specs
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

_WIDENING = 1.1
_OF_SCANS = ("s_rel_s", "s_rel_p", "s_rel_u", *DISCREPANCY)
"""Parameters that only a scan has: its noise and the discrepancy of the model along it."""
_USUAL_SCAN_DEG = tuple(float(a) for a in range(-80, 81))


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Draws of what is believed, and where they come from.

    Attributes
    ----------
    posterior : Posterior
        Of the readings so far; without any, only its prior counts.
    x : ndarray, shape (n_draws, n_par)
        Independent draws, physical units.
    measured : bool
        Whether there are readings; else ``x`` are draws of the prior.
    about : tuple of str
        Parameters that the information is about; all others are nuisance.
    """

    posterior: Posterior
    x: Array
    measured: bool
    about: tuple[str, ...]

    @cached_property
    def columns_about(self) -> NDArray[np.int64]:
        """Columns of the free coordinates z that the information is about."""
        names = self.free_names
        return np.array([names.index(name) for name in self.about], dtype=np.int64)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Names of the columns of z."""
        return tuple(self.posterior.parameter_names[i] for i in self.posterior.free)

    @property
    def scans_of_prior(self) -> bool:
        """Whether what a scan has of its own is as the priors have it: no scan was measured."""
        return not (self.measured and self.posterior.measurement.scans)

    @property
    def rough(self) -> bool:
        """Whether the discrepancy along a scan is Matérn 1/2 instead of 3/2."""
        return self.posterior.config.discrepancy == "matern-1/2"

    @cached_property
    def covariance(self) -> Array:
        """Of the draws in z, shape (n_free, n_free)."""
        z = self.posterior.to_coordinates(self.x)
        return np.atleast_2d(np.cov(z, rowvar=False))

    def log_density(self, x: Array) -> Array:
        """Natural log of the density in z of what is believed, but for a constant, (n_sets,)."""
        z = self.posterior.to_coordinates(x)
        value = self.posterior.log_prob(x) if self.measured else self.posterior.log_prior(x)
        return np.asarray(value + z[:, self.posterior.is_log].sum(axis=1))


def beliefs_of_run(
    posterior: Posterior, draws: Array, *, about: Sequence[str] = (), seed: int = 1
) -> Beliefs:
    """What a finished fit leaves.

    A fit without a scan infers neither the noise of scans nor the discrepancy of the model along
    them: these keep their priors, as they are before any reading.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Of the posterior, physical units.
    about : sequence of str
        What the information is about; the free ones of n, k, sigma_n0 and rho0 by default.
    seed : int
        Of what keeps its prior.

    Returns
    -------
    Beliefs

    Raises
    ------
    ConfigError
        When ``about`` names a parameter that is not inferred.
    """
    if not posterior.measurement.scans:
        posterior, draws = _with_scans_of_prior(posterior, draws, seed)
    return Beliefs(posterior, draws, measured=True, about=_about(posterior, about))


def _with_scans_of_prior(posterior: Posterior, draws: Array, seed: int) -> tuple[Posterior, Array]:
    """The posterior and its draws with what a scan would have; equal draws have it alike."""
    config = posterior.config
    of_scans = tuple(
        spec for spec in parameter_specs(_not_measured(POLARIZATIONS, _USUAL_SCAN_DEG), config)
        if spec.name in _OF_SCANS
    )  # fmt: skip
    distinct, which = np.unique(draws, axis=0, return_inverse=True)
    chance = np.random.default_rng([seed, 21]).random((len(distinct), len(of_scans)))
    drawn = [spec.prior.quantile(q) for spec, q in zip(of_scans, chance.T, strict=True)]
    x = np.column_stack([draws, np.stack(drawn, axis=1)[which.ravel()]])
    return replace(posterior, specs=(*posterior.specs, *of_scans)), x


def beliefs_of_prior(
    config: RunConfig, candidates: Sequence[Candidate], *, n_draws: int, seed: int,
    about: Sequence[str] = (),
) -> Beliefs:  # fmt: skip
    """What is believed before any reading: the priors of the sample and of the instrument.

    Parameters
    ----------
    config : RunConfig
    candidates : sequence of Candidate
        They decide which noises have a prior.
    n_draws : int
    seed : int
    about : sequence of str

    Returns
    -------
    Beliefs
    """
    pols = [q for q in POLARIZATIONS if any(c.polarization == q for c in candidates)]
    scan = [c.theta_r_deg for c in candidates if c.theta_r_deg]
    angles = max(scan, key=len) if scan else (0.0,)
    posterior = build_posterior(_not_measured(pols, angles), config)
    x = posterior.sample_prior(np.random.default_rng([seed, 20]), n_draws)
    return Beliefs(posterior, x, measured=False, about=_about(posterior, about))


def _not_measured(polarizations: Sequence[str], theta_r_deg: Sequence[float]) -> Measurement:
    """Scans and DHR readings whose values do not count: they name what would be inferred."""
    n, n_pol = len(theta_r_deg) * len(polarizations), len(polarizations)
    return measurement_from_columns(
        sample="not_measured", wavelength_um=1.0,
        quantity=["brdf"] * n + ["dhr"] * n_pol,
        polarization=[q for q in polarizations for _ in theta_r_deg] + [*polarizations],
        theta_i_deg=[0.0] * (n + n_pol),
        theta_r_deg=[*theta_r_deg] * n_pol + [np.nan] * n_pol,
        value=[0.1] * (n + n_pol),
    )  # fmt: skip


def _about(posterior: Posterior, wanted: Sequence[str]) -> tuple[str, ...]:
    free = [posterior.parameter_names[i] for i in posterior.free]
    for name in wanted:
        if name not in free:
            msg = f"about: {name!r} is not inferred here. Inferred: {', '.join(free)}"
            raise ConfigError(msg)
    return tuple(wanted) or tuple(name for name in PHYSICAL if name in free)


@dataclass(frozen=True, eq=False)
class DrawnSets:
    """Parameter sets with what they say of the instrument; all arrays over the sets.

    Attributes
    ----------
    x : ndarray, shape (n_sets, n_par)
        Physical units.
    variance : mapping of str to ndarray
        White variance of a BRDF reading by polarisation [1].
    tau, ell_deg : ndarray
        Discrepancy: amplitude [1], length [deg].
    dhr_variance : ndarray
        Of a DHR or DDR reading, without its gain [1].
    """

    x: Array
    variance: dict[str, Array]
    tau: Array
    ell_deg: Array
    dhr_variance: Array

    def take(self, rows: NDArray[np.int64] | slice) -> DrawnSets:
        """Some of the sets."""
        return DrawnSets(
            np.ascontiguousarray(self.x[rows]), {q: v[rows] for q, v in self.variance.items()},
            self.tau[rows], self.ell_deg[rows], self.dhr_variance[rows],
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.x)


def draw_sets(beliefs: Beliefs, x: Array, rng: np.random.Generator) -> DrawnSets:
    """What parameter sets say of the instrument.

    A polarisation without a scan has the largest noise of the others, as predicted bands have; DHR
    noise of which nothing is known has its prior, and where the laboratory stated it for each
    reading, the median of what it stated. Student's t counts as the normal law that tells as much
    of a level: scale^2 (nu + 3)/(nu + 1).

    Parameters
    ----------
    beliefs : Beliefs
    x : ndarray, shape (n_sets, n_par)
    rng : numpy.random.Generator
        Of noises that only have a prior.

    Returns
    -------
    DrawnSets
    """
    p = beliefs.posterior
    names, config = p.parameter_names, p.config
    column = {name: x[:, i] for i, name in enumerate(names)}
    inferred = {q: column[f"s_rel_{q}"] ** 2 for q in POLARIZATIONS if f"s_rel_{q}" in column}
    if inferred:
        largest = np.max(list(inferred.values()), axis=0)
    else:
        prior = NOISE_PRIORS["s_rel"]
        largest = prior.quantile(rng.random(len(x))) ** 2
    share = 1.0
    if config.tails == "student-t":
        share = (config.student_dof + 3.0) / (config.student_dof + 1.0)
    variance = {
        q: share * inferred.get(q, largest) + _stated_variance(beliefs, q) for q in POLARIZATIONS
    }
    stated = p.measurement.dhr.u_value
    if "u_dhr" in column:
        dhr = column["u_dhr"] ** 2
    elif beliefs.measured and stated.size:
        dhr = np.full(len(x), float(np.median(stated)) ** 2)
    else:
        dhr = NOISE_PRIORS["u_dhr"].quantile(rng.random(len(x))) ** 2
    nothing = np.zeros(len(x))
    return DrawnSets(
        x, variance, column.get("tau", nothing), column.get("ell_deg", nothing + 1.0), dhr
    )


def _stated_variance(beliefs: Beliefs, polarization: str) -> float:
    """Median relative variance that the laboratory states for readings of a polarisation."""
    p = beliefs.posterior
    if not beliefs.measured:
        return 0.0
    of_q = p.rows.u2[p.measurement.brdf.polarization == polarization]
    if not of_q.size:
        of_q = p.rows.u2
    return float(np.median(of_q)) if of_q.size else 0.0


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Draws of the nuisance given what the information is about.

    Attributes
    ----------
    sets : DrawnSets
        n_outer times n_nuisance sets, those of one outer draw together.
    log_weights : ndarray, shape (n_outer, n_nuisance)
        Normalised for each outer draw.
    """

    sets: DrawnSets
    log_weights: Array


def draw_nuisance(
    beliefs: Beliefs, outer: Array, n: int, rng: np.random.Generator
) -> Nuisance | None:
    """Draws of the nuisance given the parameters of interest of each outer draw.

    Proposed by the normal law with the covariance of the draws, conditioned, and weighed by the
    density; before any reading the nuisance does not depend on the sample, and is drawn as it is.

    Parameters
    ----------
    beliefs : Beliefs
    outer : ndarray, shape (n_outer, n_par)
    n : int
        Draws for each.
    rng : numpy.random.Generator

    Returns
    -------
    Nuisance or None
        None where nothing is nuisance.
    """
    p = beliefs.posterior
    z = np.repeat(p.to_coordinates(outer), n, axis=0)
    about = beliefs.columns_about
    other = np.setdiff1d(np.arange(z.shape[1]), about)
    if not other.size:
        return None
    if not beliefs.measured:
        z[:, other] = p.to_coordinates(beliefs.x)[rng.integers(len(beliefs.x), size=len(z))][
            :, other
        ]
        x = p.from_coordinates(z)
        log_weights = np.where(np.isfinite(p.log_prior(x)), 0.0, -np.inf).reshape(len(outer), n)
    else:
        z, log_weights = _proposed(beliefs, z, other, rng)
        x = p.from_coordinates(z)
        log_weights = log_weights.reshape(len(outer), n)
    total = cast("Array", np.logaddexp.reduce(log_weights, axis=1, keepdims=True))
    return Nuisance(
        draw_sets(beliefs, x, rng), np.where(np.isfinite(total), log_weights - total, -np.log(n))
    )


def _proposed(
    beliefs: Beliefs, z: Array, other: NDArray[np.int64], rng: np.random.Generator
) -> tuple[Array, Array]:
    """The sets with other nuisance by the conditional normal law of the draws.

    With the log of the density over that of the proposal, but for a constant.
    """
    p, about = beliefs.posterior, beliefs.columns_about
    s, mean = beliefs.covariance, p.to_coordinates(beliefs.x).mean(axis=0)
    to_other = np.linalg.solve(s[np.ix_(about, about)], s[np.ix_(about, other)])
    rest = s[np.ix_(other, other)] - s[np.ix_(other, about)] @ to_other
    factor = _WIDENING * np.linalg.cholesky(rest + 1e-12 * np.diag(np.diag(rest)))
    normal = rng.standard_normal((len(z), other.size))
    moved = z.copy()
    moved[:, other] = mean[other] + (z[:, about] - mean[about]) @ to_other + normal @ factor.T
    log_weights = beliefs.log_density(p.from_coordinates(moved)) + 0.5 * np.sum(normal**2, axis=1)
    return moved, np.asarray(log_weights)
