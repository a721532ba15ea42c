"""Reciprocity, in degrees: how far the model is from it, and a normalisation that has it.

Equation numbers are those of Renhorn, Hallberg, Bergstrom, Boreman, "Four-parameter model for
polarization-resolved rough-surface BRDF", Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.errors import ConvergenceError, DomainError
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import (
    Parameters,
    brdf,
    check_directions,
    checked_polarization,
    digits_of,
)
from pbrdf_bayes.physics.directions import prepare_directions
from pbrdf_bayes.physics.reciprocal import Scale, scale_at, shape, solve_scale
from pbrdf_bayes.quantities import S_AND_P

Array = NDArray[np.float64]

FINEST_RTOL = 1e-9
"""Smallest tolerance of the reciprocal normalisation."""
_SPARE = 0.1


def reciprocity_defect(
    parameters: Parameters, theta_a_deg: ArrayLike, theta_b_deg: ArrayLike, *,
    effects: Effects | None = None, rtol: float = 1e-8,
) -> Array:  # fmt: skip
    """f(a -> b) / f(b -> a) in plane for s and p with the normalisation of Eq. (4).

    1 is reciprocal. A_q and B_q' of Eq. (3) are symmetric in the two directions, so that without
    effects the ratio is that of DHR_q / I_q at the two angles, I_q the integral in (4); the paper
    says that the model is reciprocal.

    Parameters
    ----------
    parameters : Parameters
    theta_a_deg : array_like
        Angles in the plane of incidence, [0, 89.95] [deg].
    theta_b_deg : array_like
        Angles on the forward side of a, [0, 89.95], or on its own side, [-89.95, 0] [deg]. A column
        of angles and the same in a row give the whole table. Without effects the side is all one.
    effects : Effects, optional
        Line shape and effects; none by default.
    rtol : float
        Relative tolerance of the normalisation, as in `brdf`.

    Returns
    -------
    ndarray, shape (2, ...)
        s and p, each of the broadcast shape of the angles [1]; NaN where nothing is reflected.

    Raises
    ------
    DomainError
        When an angle or the tolerance is not allowed.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(reciprocity_defect(green, 20.0, [20.0, 60.0]).round(2))
    [[1.  1.2]
     [1.  5.7]]
    """
    a, b = np.asarray(theta_a_deg, np.float64), np.asarray(theta_b_deg, np.float64)
    check_directions(theta_i_deg=np.abs(b))
    pairs = []
    for q in S_AND_P:
        there = brdf(parameters, a, b, q, effects=effects, rtol=rtol)
        back = brdf(parameters, np.abs(b), np.copysign(a, b), q, effects=effects, rtol=rtol)
        pairs.append(there / np.where(back > 0.0, back, np.nan))
    return np.stack(pairs)


def reciprocal_brdf(
    parameters: Parameters,
    theta_i_deg: ArrayLike,
    theta_r_deg: ArrayLike,
    polarization: str = "s",
    *,
    phi_r_deg: ArrayLike = 0.0,
    rtol: float = 1e-8,
) -> Array:
    """Polarised BRDF with a reciprocal normalisation in place of that of Eq. (4).

    f_q = sigma_n0 g_q(alpha_i) A_q B_q' g_q(|alpha|), where g_q gives every angle of incidence its
    DHR, Eq. (2). A choice beside the paper's model, which is `brdf`.

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg, theta_r_deg, phi_r_deg : array_like
        Angles as in `brdf` [deg].
    polarization : {"s", "p", "u"}
        ``u`` is the mean of s and p (Eq. 6).
    rtol : float
        Relative tolerance of the DHR, in [1e-9, 1e-2]. In plane f is reciprocal to rounding
        whatever it is.

    Returns
    -------
    ndarray
        BRDF [sr^-1], of the broadcast shape of the angles.

    Raises
    ------
    DomainError
        When an angle, the polarisation or the tolerance is not allowed.
    ConvergenceError
        When the factor g is not found to the tolerance.

    Notes
    -----
    Tested for n in [1.0005, 6] with k in [0, 10], a metal with n < 1, rho0 from 1e-3 to 4 and
    angles of incidence from 0 to 89.95 deg (``tests/physics/test_reciprocal.py``).

    Out of plane A_q B_q' is not reciprocal, and no factor makes it so: g depends on alpha there.
    The price is the symmetry at normal incidence: s and p have factors of their own, so that
    f_s(0; alpha, beta) is no longer f_p(0; beta, alpha) though a surface without a direction cannot
    tell them apart. On the published paint f_s / f_p is 0.92 at theta_i = theta_r = 0.

    At grazing f goes to zero like sqrt(cos(theta)) in the two angles, which that of (4) does not
    for the scattered light.

    On the published paint, scans at 0, 20, 40, 60 and 80 deg from -80 to 80 deg: f is between 0.59
    and 1.48 times that of `brdf` for s, and between 0.083 and 1.52 times for p, least at 57 deg,
    where F_p is small: a product of factors brings the small DHR of that incidence to every scan.

    The factor is solved for once per n, k and rho0 and kept for later calls.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> there, back = reciprocal_brdf(green, [20.0, 60.0], [60.0, 20.0], "p")
    >>> bool(abs(there / back - 1.0) < 1e-13)
    True
    """
    checked_polarization(polarization)
    check_directions(theta_i_deg=theta_i_deg, theta_r_deg=theta_r_deg, phi_r_deg=phi_r_deg)
    if digits_of(rtol) > digits_of(FINEST_RTOL):
        msg = f"rtol = {rtol!r} is not allowed here: give a tolerance in [{FINEST_RTOL:g}, 1e-2]"
        raise DomainError(msg)
    angles = np.broadcast_arrays(
        *(np.asarray(x, dtype=np.float64) for x in (theta_i_deg, theta_r_deg, phi_r_deg))
    )
    theta_i, theta_r, phi_r = (np.deg2rad(angle.ravel()) for angle in angles)
    scale = _solved(parameters.n, parameters.k, parameters.rho0, rtol)
    incoming = scale_at(scale, np.deg2rad(90.0 - angles[0].ravel()))
    outgoing = scale_at(scale, _from_grazing(np.deg2rad(90.0 - np.abs(angles[1].ravel())), phi_r))
    lobes = shape(prepare_directions(theta_i, theta_r, phi_r), scale.surf)
    both = parameters.sigma_n0 * (incoming * outgoing) * lobes
    chosen = {"s": both[0], "p": both[1], "u": 0.5 * (both[0] + both[1])}[polarization]
    return np.asarray(chosen.reshape(angles[0].shape))


def _from_grazing(grazing: Array, phi_r: Array) -> Array:
    """pi/2 - arcsin |alpha| for a direction at ``grazing`` from the horizon [rad]."""
    sine = np.cos(grazing)
    flat = sine * np.sin(phi_r)
    angle = np.arctan2(np.hypot(np.sin(grazing), flat), np.abs(sine * np.cos(phi_r)))
    return np.where(phi_r == 0.0, grazing, angle)


@lru_cache(maxsize=32)
def _solved(n: float, k: float, rho0: float, rtol: float) -> Scale:
    """The factor of a surface, refused where it is not as accurate as asked."""
    found = solve_scale(n, k, rho0, _SPARE * rtol)
    if not found.error <= _SPARE * rtol:
        msg = (
            f"the reciprocal normalisation of n = {n!r}, k = {k!r}, rho0 = {rho0!r} is accurate to "
            f"{found.error:.1e} where {_SPARE * rtol:.1e} was wanted: ask for a larger rtol"
        )
        raise ConvergenceError(msg)
    return found
