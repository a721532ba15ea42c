"""How much each parameter owes to its prior and to the readings: both raised to a power near 1.

Kallioinen, Paananen, Buerkner and Vehtari 2024, doi:10.1007/s11222-023-10366-5. Prior is that of
the physical parameters, all of them together: the noise and the discrepancy have weak priors that
belong to the likelihood. A density raised to a power depends on the variable that it is a density
of; here that is the one in which sampler and prior are simple (the logarithm of rho0), so that a
flat prior there stays what it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.arviz_adapter import power_scaling
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.sampling import Draws

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PriorSensitivity:
    """Change of each marginal for a doubling of the power of prior or likelihood, at 1.

    Attributes
    ----------
    names : tuple of str
        Physical parameters.
    prior, likelihood : ndarray, shape (n_physical,)
        In units of the (bounded) cumulative Jensen-Shannon distance; 0.05 is a change of the mean
        by about 0.3 standard deviations for a halved or doubled power [1].
    displacement : ndarray, shape (n_physical,)
        Posterior mean from the median of the prior, in standard deviations of the prior.
    """

    names: tuple[str, ...]
    prior: Array
    likelihood: Array
    displacement: Array


def measure_sensitivity(posterior: Posterior, draws: Draws) -> PriorSensitivity:
    """Sensitivity of the physical parameters to their prior and to the readings.

    Parameters
    ----------
    posterior : Posterior
    draws : Draws
        The densities that were stored with them are split; nothing is evaluated again.

    Returns
    -------
    PriorSensitivity
    """
    columns = np.moveaxis(draws.x, 2, 0)
    log_priors = np.array(
        [_log_density(spec, x) for spec, x in zip(posterior.specs, columns, strict=True)]
    )
    physical = [i for i, spec in enumerate(posterior.specs) if spec.kind == "physical"]
    values = np.stack([_coordinate(posterior.specs[i], columns[i]) for i in physical], axis=2)
    return PriorSensitivity(
        names=tuple(posterior.specs[i].name for i in physical),
        prior=power_scaling(values, log_priors[physical].sum(axis=0)),
        likelihood=power_scaling(values, draws.log_prob - log_priors.sum(axis=0)),
        displacement=np.array([_displacement(posterior.specs[i], columns[i]) for i in physical]),
    )


def _coordinate(spec: ParameterSpec, x: Array) -> Array:
    return np.log(x) if spec.log_coordinate else x


def _log_density(spec: ParameterSpec, x: Array) -> Array:
    """Log prior density of the coordinate."""
    return spec.prior.log_density(x) + (np.log(x) if spec.log_coordinate else 0.0)


def _displacement(spec: ParameterSpec, x: Array) -> float:
    prior = _coordinate(spec, spec.prior.quantile((np.arange(2000) + 0.5) / 2000))
    return float((_coordinate(spec, x).mean() - np.median(prior)) / prior.std())
