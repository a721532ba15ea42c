"""The diffuse directional reflectance: the DHR less the light inside a specular port.

An integrating sphere whose specular port is open loses what is scattered into a cone about the
specular direction. Renhorn et al. (2011) ask whether such a reading could replace a BRDF scan;
``reports/ddr`` answers it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import MAX_THETA_I_DEG, Parameters, brdf, checked_angles, dhr
from pbrdf_bayes.physics.port import lobe_widths, port_nodes

Array = NDArray[np.float64]

PORT_RANGE_DEG = (0.1, 45.0)
"""Half angles of a port [deg]."""
_APART = 16.0
"""Lobes that many times as wide as the narrowest one still share its nodes."""


def ddr(
    parameters: Parameters, theta_i_deg: ArrayLike, polarization: str = "s", *,
    port_deg: float, effects: Effects | None = None,
) -> Array:  # fmt: skip
    """Diffuse directional reflectance: DHR less the light inside a circular specular port.

    DDR = DHR - integral of the BRDF over the cone, d alpha d beta = cos(theta_r) d omega.

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg : array_like
        Angle of incidence, [0, 89.95] [deg].
    polarization : {"s", "p", "u"}
    port_deg : float
        Half angle of the cone about the specular direction, [0.1, 45] [deg]. What of it lies below
        the horizon does not count.
    effects : Effects, optional
        Line shape and effects; none by default.

    Returns
    -------
    ndarray
        DDR [1], of the shape of ``theta_i_deg``.

    Raises
    ------
    DomainError
        When an angle or the polarisation is not allowed, or the sample would reflect more than it
        receives.

    Notes
    -----
    The error is below 1e-6 of the DHR for rho0 from 1e-3 to 4, up to 89 deg of incidence
    (``tests/model/test_ddr.py``).

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(ddr(green, [10.0, 60.0], "s", port_deg=5.0).round(5))
    [0.02256 0.08685]
    """
    angles = checked_angles("theta_i_deg", theta_i_deg, 0.0, MAX_THETA_I_DEG)
    checked_angles("port_deg", port_deg, *PORT_RANGE_DEG)
    whole = dhr(parameters, angles, polarization, effects=effects)
    exponent = np.array([1.0 if effects is None else effects.narrowing])

    def inside(angle: float) -> float:
        def light(theta_r: Array, phi_r: Array, weight: Array, _: NDArray[np.int64]) -> Array:
            f = brdf(
                parameters, angle, np.rad2deg(theta_r), polarization,
                phi_r_deg=np.rad2deg(phi_r), effects=effects,
            )  # fmt: skip
            return np.array([f @ weight])

        return float(
            port_light(parameters.as_array()[None, :], exponent, angle, port_deg, light)[0]
        )

    lost = np.array([inside(float(a)) for a in angles.ravel()])
    return np.asarray(whole - lost.reshape(angles.shape))


def port_light(
    x: Array, narrowing: Array, theta_i_deg: float, port_deg: float,
    light: Callable[[Array, Array, Array, NDArray[np.int64]], Array],
) -> Array:  # fmt: skip
    """Light inside a port for many parameter sets, on nodes that serve lobes of similar width.

    Parameters
    ----------
    x : ndarray, shape (n_sets, 4)
        n, k, sigma_n0 and rho0.
    narrowing : ndarray, shape (n_sets,)
        Exponent of Eq. (5).
    theta_i_deg, port_deg : float
        Incidence and half angle of the port [deg].
    light : callable
        Of theta_r, phi_r [rad] and weights [sr], each of shape (n_nodes,), and the indices of the
        sets that are meant: the sum of weight times BRDF for each of them.

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    theta_i = float(np.deg2rad(theta_i_deg))
    widths = lobe_widths(x, theta_i, narrowing)
    order = np.argsort(widths)
    found = np.empty(len(x))
    first = 0
    while first < len(order):
        narrowest = widths[order[first]]
        last = int(np.searchsorted(widths[order], _APART * narrowest, side="right"))
        sets = order[first:last]
        nodes = port_nodes(
            theta_i, float(np.deg2rad(port_deg)), width=float(narrowest),
            rho0=float(x[sets, 3].min()),
        )  # fmt: skip
        found[sets] = light(*nodes, sets)
        first = last
    return found
