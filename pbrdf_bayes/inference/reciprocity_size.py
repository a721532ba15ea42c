"""How far the fitted model is from reciprocity, and where the readings would notice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.effects import INSTRUMENT_FIELDS, Effects, effects_of_fit
from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model import Parameters
from pbrdf_bayes.physics.scene import EffectValues
from pbrdf_bayes.reciprocity import reciprocity_defect

Array = NDArray[np.float64]

THETA_DEG = tuple(10.0 * i for i in range(9))
"""Angles of the table [deg]."""
_TO_HALF_DEG = 2.0
_LAST_DEG = 89.5
_DECIMALS = 4
"""Of ln factor: of pairs that differ by less the first is taken, on the forward side."""


@dataclass(frozen=True)
class LargestDefect:
    """The pair of measured angles with the largest defect.

    Attributes
    ----------
    polarization : {"s", "p"}
    theta_a_deg, theta_b_deg : float
        b is negative where it lies on the side of a [deg].
    factor : float
        f(a -> b) / f(b -> a), above 1.
    """

    polarization: str
    theta_a_deg: float
    theta_b_deg: float
    factor: float


@dataclass(frozen=True)
class ReciprocitySize:
    """f(a -> b) / f(b -> a) in plane at the MAP; 1 is reciprocal.

    Attributes
    ----------
    theta_deg : tuple of float
        Angles of the table, forward side [deg].
    factors : mapping of str to list of list of float
        For s and p the table [1]: a in rows, b in columns.
    largest : LargestDefect or None
        Over the pairs of angles that were measured in plane, of the polarisations measured; None
        without any. Unpolarised readings are a mean of s and p, and their factor lies between.
    """

    theta_deg: tuple[float, ...]
    factors: Mapping[str, list[list[float]]]
    largest: LargestDefect | None


def measure_reciprocity(posterior: Posterior, x_map: Array) -> ReciprocitySize | None:
    """Reciprocity defect of the sample's BRDF, whatever its line shape and effects.

    Effects of the instrument are left out: they are none of the sample.

    Parameters
    ----------
    posterior : Posterior
    x_map : ndarray, shape (n_par,)
        Physical units.

    Returns
    -------
    ReciprocitySize or None
        None where the MAP reflects totally beyond some angle (n < 1 with hardly any k), or with
        effects more than it receives at an angle that was not measured.
    """
    names, config = posterior.parameter_names, posterior.config
    values = dict(zip(names, x_map.tolist(), strict=True))
    grid = np.array(THETA_DEG)
    try:
        parameters = Parameters(**{name: values[name] for name in names[:4]})
        effects = sample_effects(config, values)
        table = reciprocity_defect(
            parameters, grid[:, None], grid, effects=effects, rtol=config.rtol
        )
        largest = _largest(posterior.measurement, parameters, effects, config.rtol)
    except DomainError:
        return None
    factors = {q: table[i].tolist() for i, q in enumerate("sp")}
    return ReciprocitySize(theta_deg=THETA_DEG, factors=factors, largest=largest)


def sample_effects(config: RunConfig, values: Mapping[str, float]) -> Effects:
    """Line shape and effects of the sample alone at the values of a parameter set.

    Parameters
    ----------
    config : RunConfig
    values : mapping of str to float
        By the names of the columns of the posterior.
    """
    of_sample = [n for n in EffectValues._fields if n in values and n not in INSTRUMENT_FIELDS]
    choices = {"line_shape": config.line_shape, "fresnel_at": config.fresnel_at}
    return effects_of_fit(choices | {name: values[name] for name in of_sample})


def _largest(
    measurement: Measurement, parameters: Parameters, effects: Effects, rtol: float
) -> LargestDefect | None:
    """Over the measured pairs, to half a degree of theta_r; the larger way of each."""
    a, b = measured_pairs(measurement)
    measured = {scan.polarization for scan in measurement.scans}
    if not a.size:
        return None
    defect = np.log(reciprocity_defect(parameters, a, b, effects=effects, rtol=rtol))
    for i, q in enumerate("sp"):
        if not measured & {q, "u"}:
            defect[i] = np.nan
    if not np.isfinite(defect).any():
        return None
    size = np.where(np.isfinite(defect), np.abs(defect).round(_DECIMALS), -1.0)
    i, j = divmod(int(np.argmax(size)), size.shape[1])
    pair = (float(a[j]), float(b[j]))
    if defect[i, j] < 0.0:
        pair = (abs(pair[1]), float(np.copysign(pair[0], pair[1])))
    return LargestDefect("sp"[i], *pair, float(np.exp(abs(defect[i, j]))))


def measured_pairs(measurement: Measurement) -> tuple[Array, Array]:
    """Pairs of angles measured in plane, theta_r to half a degree and within 89.5 [deg].

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of ndarray, each of shape (n_pairs,)
        theta_i and signed theta_r, each pair once.
    """
    brdf = measurement.brdf
    flat = brdf.phi_r_deg == 0.0
    theta_r = np.round(_TO_HALF_DEG * brdf.theta_r_deg[flat]) / _TO_HALF_DEG
    pairs = np.stack([brdf.theta_i_deg[flat], np.clip(theta_r, -_LAST_DEG, _LAST_DEG)], axis=1)
    a, b = np.unique(pairs, axis=0).reshape(-1, 2)[::-1].T
    return a, b
