"""The law of a DHR or DDR reading that could be taken.

    y = g D + noise,   g ~ N(1, u_dhr_cal^2)

with one gain g for all hemispherical readings of a polarisation, those that were taken included: a
DDR is read with the same sphere and the same reference as a DHR. Given a parameter set everything
is normal, and g is integrated out in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.effects_table import INSTRUMENT_PARAMETERS
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.model.diffuse_directional import port_light
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scene import NULL

Array = NDArray[np.float64]

_LN_2PI = float(np.log(2.0 * np.pi))
_VALUES_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class GainLaw:
    """What is known of the gain g - 1 of a polarisation under each set: normal, arrays (n_sets,).

    ``precision`` is infinite where the gain is exact.
    """

    mean: Array
    precision: Array


def of_sample(posterior: Posterior, x: Array, *, kept: tuple[str, ...] = ()) -> Array:
    """The sets with the effects of the instrument off, but for those kept: what the sample does."""
    names = posterior.parameter_names
    found = x.copy()
    for name in INSTRUMENT_PARAMETERS:
        if name in names and name not in kept:
            found[:, names.index(name)] = getattr(NULL, name)
    return found


def hemispherical_values(posterior: Posterior, candidate: Candidate, x: Array) -> Array:
    """DHR or DDR as it is read, but for its gain [1], shape (n_sets,).

    Offset and leakage count in both, as they do where DHR readings are fitted; effects of the
    goniometer count in neither.
    """
    values = _dhr(posterior, np.array([candidate.theta_i_deg]), candidate.polarization, x)[:, 0]
    if candidate.quantity == "ddr":
        values = values - specular_part(posterior, candidate, x)
    return np.asarray(values)


def _dhr(posterior: Posterior, theta_i_deg: Array, polarization: str, x: Array) -> Array:
    """DHR of one polarisation, shape (n_sets, n_angles)."""
    none = np.zeros(0)
    geometry = prepare_geometry(
        theta_i=none, theta_r=none, phi_r=none, polarization=np.zeros(0, np.str_),
        dhr_theta_i=np.deg2rad(theta_i_deg),
        dhr_polarization=np.full(theta_i_deg.size, polarization),
    )  # fmt: skip
    return posterior.predict(x, geometry)[1]


def specular_part(posterior: Posterior, candidate: Candidate, x: Array) -> Array:
    """Light inside the port about the specular direction [1], shape (n_sets,).

    Of the sample in the light that the polariser lets through: what a goniometer would do to a scan
    there does not count.
    """
    x = of_sample(posterior, x, kept=("leakage",))
    names, q = posterior.parameter_names, candidate.polarization
    narrowing = x[:, names.index("narrowing")] if "narrowing" in names else np.ones(len(x))

    def light(theta_r: Array, phi_r: Array, weight: Array, sets: NDArray[np.int64]) -> Array:
        geometry = prepare_geometry(
            theta_i=np.full(theta_r.size, np.deg2rad(candidate.theta_i_deg)), theta_r=theta_r,
            phi_r=phi_r, polarization=np.full(theta_r.size, q), dhr_theta_i=np.zeros(0),
            dhr_polarization=np.zeros(0, np.str_),
        )  # fmt: skip
        step = max(1, _VALUES_AT_ONCE // theta_r.size)
        parts = [posterior.predict(x[sets[i : i + step]], geometry)[0] @ weight
                 for i in range(0, sets.size, step)]  # fmt: skip
        return np.concatenate(parts)

    return port_light(x[:, :4], narrowing, candidate.theta_i_deg, candidate.port_deg, light)


def gain_law(beliefs: Beliefs, polarization: str, sets: DrawnSets) -> GainLaw:
    """What the readings so far say of the gain of a polarisation, under each parameter set."""
    p = beliefs.posterior
    rows, u2 = p.rows, p.rows.dhr_cal2
    n = len(sets)
    if u2 == 0.0:
        return GainLaw(np.zeros(n), np.full(n, np.inf))
    precision, moment = np.full(n, 1.0 / u2), np.zeros(n)
    here = np.flatnonzero(p.measurement.dhr.polarization == polarization)
    if beliefs.measured and here.size:
        model = _dhr(p, p.measurement.dhr.theta_i_deg[here], polarization, sets.x)
        stated = rows.dhr_u2[here]
        variance = np.where(stated >= 0.0, stated, sets.dhr_variance[:, None])
        precision = precision + np.sum(model**2 / variance, axis=1)
        moment = np.sum(model * (rows.dhr[here] - model) / variance, axis=1)
    return GainLaw(moment / precision, precision)


def draw_hemispherical(
    value: Array, gain: GainLaw, sets: DrawnSets, *, seed: tuple[int, ...],
    key: tuple[int, ...] = (),
) -> Array:  # fmt: skip
    """One reading for every set, shape (n_sets,).

    The gain comes from ``seed`` alone, the same for all readings of a polarisation; the noise from
    ``key`` (`Candidate.geometry`) too: readings of different geometries share the gain only.
    """
    n = value.size
    shift = gain.mean + np.random.default_rng([*seed, 23]).standard_normal(n) / np.sqrt(
        gain.precision
    )
    noise = np.random.default_rng([*seed, 24, *key]).standard_normal(n)
    return np.asarray(value * (1.0 + shift) + np.sqrt(sets.dhr_variance) * noise)


def hemispherical_log_likelihoods(
    y: list[Array], values: list[Array], gain: GainLaw, sets: DrawnSets, *, matched: bool
) -> Array:
    """Log-density of readings that share a gain, one after the other, under parameter sets.

    Parameters
    ----------
    y : list of ndarray, shape (n_simulated,)
        Readings; one array for each candidate.
    values : list of ndarray, shape (n_sets,)
        The model there.
    gain : GainLaw
    sets : DrawnSets
    matched : bool
        The sets belong to the simulated readings one after the other, instead of all to all.

    Returns
    -------
    ndarray, shape (n_simulated, n_sets) or (n_simulated, n_sets / n_simulated)
    """
    n = y[0].size

    def shaped(values: Array) -> Array:
        return values.reshape(n, -1) if matched else values[None, :]

    precision, v = shaped(gain.precision), shaped(sets.dhr_variance)
    moment = shaped(np.where(np.isfinite(gain.precision), gain.mean * gain.precision, 0.0))
    total: Array | float = 0.0
    for reading, value in zip(y, values, strict=True):
        model, read = shaped(value), reading[:, None]
        variance = v + model**2 / precision
        residual = read - model * (1.0 + moment / precision)
        total = total - 0.5 * (residual**2 / variance + np.log(variance) + _LN_2PI)
        moment = moment + model * (read - model) / v
        precision = precision + model**2 / v
    return np.asarray(total)
