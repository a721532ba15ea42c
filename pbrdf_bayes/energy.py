"""Effects with which a sample would reflect more than it receives are refused.

Eq. (2) keeps the surface of the paper below 1 by itself; diffuse terms add to it:

    DHR_q(theta_i) = sigma_N0 F_q(theta_i) + integral of diffuse_q over the projected hemisphere

It has to be at most 1 for s and for p at the angles of incidence asked for and at grazing. The same
rule takes such parameters out of the prior of a fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.effects import INSTRUMENT_FIELDS, Effects, scene_and_columns
from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scattering import evaluate_with_effects
from pbrdf_bayes.physics.scene import NULL

Array = NDArray[np.float64]

DIFFUSE = ("lambert", "bulk", "volume", "backscatter")
"""Effects that add to the DHR of the surface."""
GRAZING_DEG = 89.95
_ROUNDING = 1e-9
_NONE = np.zeros(0)


def check_energy(parameters: Array, effects: Effects, theta_i_deg: Array) -> None:
    """Refuse values with which the sample reflects more than it receives.

    Without diffuse terms nothing is computed. Effects of the instrument do not count.

    Parameters
    ----------
    parameters : ndarray, shape (4,)
        n, k, sigma_n0, rho0.
    effects : Effects
    theta_i_deg : ndarray
        Angles of incidence asked for [deg]; nearly grazing light is always among them.

    Raises
    ------
    DomainError
        With the largest DHR, its polarisation and angle, the values, and what to do.

    Examples
    --------
    >>> green = np.array([1.526, 0.193, 0.4528, 0.47])
    >>> check_energy(green, Effects(lambert=0.02), np.array([20.0]))
    """
    added = [name for name in DIFFUSE if getattr(effects, name) > 0.0]
    if not added:
        return
    angles = np.append(np.unique(theta_i_deg), GRAZING_DEG)
    dhr = _sample_dhr(parameters, effects, angles)
    row, column = np.unravel_index(np.argmax(dhr), dhr.shape)
    total = float(dhr[row, column])
    if total > 1.0 + _ROUNDING:
        given = ", ".join(f"{name} = {getattr(effects, name):g}" for name in added)
        msg = (
            f"sigma_n0 = {parameters[2]:g} with {given}: of {'sp'[row]} light at "
            f"{angles[column]:g} deg the sample would reflect {total:.6g} times what it receives. "
            f"Allowed: at most 1. Lower sigma_n0 or {' or '.join(added)}"
        )
        raise DomainError(msg)


def _sample_dhr(parameters: Array, effects: Effects, angles: Array) -> Array:
    """DHR of s and p [1] without what the instrument does, shape (2, n_angles)."""
    of_sample = replace(effects, **{name: getattr(NULL, name) for name in INSTRUMENT_FIELDS})
    geometry = prepare_geometry(
        theta_i=_NONE, theta_r=_NONE, phi_r=_NONE, polarization=np.zeros(0, np.str_),
        dhr_theta_i=np.tile(np.deg2rad(angles), 2),
        dhr_polarization=np.repeat(("s", "p"), angles.size),
    )  # fmt: skip
    scene, columns = scene_and_columns(of_sample, parameters)
    return evaluate_with_effects(geometry, scene, columns, 2.0)[1].reshape(2, angles.size)
