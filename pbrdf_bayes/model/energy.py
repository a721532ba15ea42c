"""Effects with which a sample would reflect more than it receives are refused.

Eq. (2) keeps the surface of the paper below 1 by itself; diffuse terms add to it:

    DHR_q(theta_i) = sigma_N0 F_q(theta_i) + integral of diffuse_q over the projected hemisphere

It has to be at most 1 for s and for p at every angle of incidence up to grazing, whichever are
asked for: bulk scatter of p light is largest at Brewster's angle. The same rule takes such
parameters out of the prior of a fit (`pbrdf_bayes.physics.hemispherical`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.effects_table import DIFFUSE
from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.model.effects import Effects, scene_and_columns
from pbrdf_bayes.physics.hemispherical import LARGEST_THETA_I_DEG, largest_dhr
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

GRAZING_DEG = LARGEST_THETA_I_DEG
_ROUNDING = 1e-9


def check_energy(parameters: Array, effects: Effects) -> None:
    """Refuse values with which the sample reflects more than it receives, at any angle.

    Without diffuse terms nothing is computed. Effects of the instrument do not count.

    Parameters
    ----------
    parameters : ndarray, shape (4,)
        n, k, sigma_n0, rho0.
    effects : Effects

    Raises
    ------
    DomainError
        With the largest DHR, its polarisation and angle, the values, and what to do.

    Examples
    --------
    >>> green = np.array([1.526, 0.193, 0.4528, 0.47])
    >>> check_energy(green, Effects(lambert=0.02))
    """
    added = [name for name in DIFFUSE if getattr(effects, name) > 0.0]
    if not added:
        return
    scene, columns = scene_and_columns(effects, parameters)
    total, angle, q = largest_dhr(scene, columns[0])
    if total > 1.0 + _ROUNDING:
        given = ", ".join(f"{name} = {getattr(effects, name):g}" for name in added)
        msg = (
            f"sigma_n0 = {parameters[2]:g} with {given}: of {POLARIZATIONS[q]} light at "
            f"{np.rad2deg(angle):.4g} deg the sample would reflect {total:.6g} times what it "
            f"receives. Allowed: at most 1. Lower sigma_n0 or {' or '.join(added)}"
        )
        raise DomainError(msg)
