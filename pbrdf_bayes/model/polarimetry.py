"""Polarisation of the scattered light, in degrees: Mueller matrix, Stokes vectors, DoLP, AoLP.

Equation numbers are those of Renhorn, Hallberg, Bergstrom, Boreman, "Four-parameter model for
polarization-resolved rough-surface BRDF", Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027. The derivation is that of `pbrdf_bayes.physics.stokes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.effects_table import DIFFUSE, DIFFUSE_PARAMETERS, INSTRUMENT_PARAMETERS
from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.model.effects import Effects, given_effects
from pbrdf_bayes.model.four_parameter import Parameters, brdf, checked_polarization
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.scene import NULL
from pbrdf_bayes.physics.scene_stokes import bulk_s1
from pbrdf_bayes.physics.stokes import depolarise, mueller_matrix, phase_cosine, prepare_frames
from pbrdf_bayes.quantities import S_AND_P, STATES

Array = NDArray[np.float64]


def mueller(
    parameters: Parameters,
    theta_i_deg: ArrayLike,
    theta_r_deg: ArrayLike,
    *,
    phi_r_deg: ArrayLike = 0.0,
    phase: str = "fresnel",
    depolarisation: float = 0.0,
    effects: Effects | None = None,
    rtol: float = 1e-8,
) -> Array:
    """Mueller matrix of the BRDF for (S0, S1, S2), in and out of plane, Eqs. (7)-(12).

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg, theta_r_deg, phi_r_deg : array_like
        Angles as in `brdf` [deg].
    phase : {"fresnel", "paper"}
        Between the two polarisations of a facet: that of Fresnel's coefficients at the local
        angle, or none, as Eq. (8) is printed.
    depolarisation : float
        Share of the scattered light that is depolarised, in [0, 1] [1]; 0 is the model without it.
    effects : Effects, optional
        Line shape and effects of the sample; none by default.
    rtol : float
        Relative tolerance of the normalisation, as in `brdf`.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        [sr^-1], of the broadcast shape of the angles. It takes Stokes vectors of irradiance in the
        frame of the plane of incidence to those of radiance in the frame of the meridian plane
        phi_r.

    Raises
    ------
    DomainError
        When an angle, the tolerance, the phase or the share is not allowed; when an effect is one
        of the instrument; when the sample would reflect more than it receives.

    Notes
    -----
    Light from below the surface has lost its polarisation there, and is that of s or p light or
    their mean: light at 45 deg and circular light count as unpolarised. Bulk scatter is polarised
    by the transmittances on its way out (Wolff 1994), as in `predict_scene`; other diffuse terms
    are unpolarised. ``depolarisation`` acts on all that is scattered.

    Frames: s_i = (0, 1, 0), s_r = (-sin phi_r, cos phi_r, 0), p = k x s. S1 is s minus p; S2 is
    positive for a field along s + p, 45 deg from s counterclockwise for who looks into the beam.
    Circular light is neither taken nor told. In plane the matrix is that of f_s, f_p and
    sqrt(f_s f_p) times the cosine of the phase.

    Where the paper is imprecise: sqrt(g) and sqrt(h) stand for alpha c_i + alpha_i c_r and for
    (alpha^2 + beta^2) c_i + alpha alpha_i c_r, which are negative for backward directions;
    sqrt(f_s f_p) is negative below Brewster's angle, where E keeps its line. With the
    signs, the third component of (9) is

        2 [H alpha_i beta (g f_s - beta^2 f_p) - G sqrt(f_s f_p) beta (h - alpha_i^2 beta^2)]
        / [(g + beta^2)(h + alpha_i^2 beta^2)],

    which is S2 with the other handedness, the negative of the one here.

    f_s and f_p are those of the facet here and of the plane of incidence in (3). Out of plane S0 of
    s light is thus (g f_s + beta^2 f_p) / (g + beta^2), not f_s; that of unpolarised light is the
    mean of f_s and f_p everywhere. Over the hemisphere S0 of s light does not integrate to DHR_s,
    nor that of p light to DHR_p, as (2) would have it: for the published paint the ratios are 1.07
    and 0.93 at normal incidence, 0.89 and 8.41 at 60 deg.

    Limits: at theta_r = 0 the frame is the one of the meridian phi_r. Back along the incoming ray
    the facet has no plane of its own; the value is the limit along the meridian. From other sides
    the limits differ, as f_s and f_p of (3) differ there for theta_i > 0.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(mueller(green, 40.0, 50.0, phi_r_deg=60.0).round(6))
    [[ 0.005732  0.000161 -0.00255 ]
     [ 0.000869 -0.004662 -0.002248]
     [-0.002403 -0.002071  0.00527 ]]
    """
    angles = np.broadcast_arrays(
        *(np.asarray(x, dtype=np.float64) for x in (theta_i_deg, theta_r_deg, phi_r_deg))
    )
    added = _of_sample(given_effects(effects))
    f_s, f_p = _of_s_and_p(parameters, angles, added, rtol)
    if phase not in ("fresnel", "paper"):
        msg = f"phase = {phase!r} is not known. Allowed: 'fresnel', 'paper'"
        raise DomainError(msg)
    if not 0.0 <= depolarisation <= 1.0:
        msg = f"depolarisation = {depolarisation!r} is not allowed: give a share in [0, 1]"
        raise DomainError(msg)
    frames = prepare_frames(*(np.deg2rad(angle) for angle in angles))
    paper = np.ones(f_s.shape)
    cosine = phase_cosine(frames, parameters.n, parameters.k) if phase == "fresnel" else paper
    if not any(getattr(added, name) > 0.0 for name in DIFFUSE):
        return depolarise(mueller_matrix(f_s, f_p, cosine, frames), depolarisation)
    bare = _of_s_and_p(parameters, angles, _without(added, DIFFUSE_PARAMETERS), rtol)
    whole = mueller_matrix(*bare, cosine, frames)
    whole += _from_below(parameters, angles, added, (f_s - bare[0], f_p - bare[1]))
    return depolarise(whole, depolarisation)


def _of_sample(effects: Effects) -> Effects:
    """The effects, refused where one is of the instrument."""
    for name in INSTRUMENT_PARAMETERS:
        value = getattr(effects, name)
        if value != getattr(NULL, name):
            msg = (
                f"{name} = {value!r} is an effect of the instrument: polarisation is that of the "
                "scattered light. Leave it out"
            )
            raise DomainError(msg)
    return effects


def _without(effects: Effects, names: tuple[str, ...]) -> Effects:
    return replace(effects, **{name: getattr(NULL, name) for name in names})


def _of_s_and_p(
    parameters: Parameters, angles: Sequence[Array], effects: Effects, rtol: float
) -> tuple[Array, Array]:
    """BRDF [sr^-1] of s and of p light at theta_i, theta_r, phi_r [deg]."""
    theta_i, theta_r, phi_r = angles
    f_s, f_p = (
        brdf(parameters, theta_i, theta_r, q, phi_r_deg=phi_r, effects=effects, rtol=rtol)
        for q in S_AND_P
    )
    return f_s, f_p


def _from_below(
    parameters: Parameters, angles: Sequence[Array], effects: Effects, below: tuple[Array, Array]
) -> Array:
    """Mueller matrix (..., 3, 3) of the diffuse terms [sr^-1], whose BRDF of s and p is given."""
    d_s, d_p = (np.maximum(d, 0.0) for d in below)
    b_s, b_p = np.zeros(d_s.shape), np.zeros(d_p.shape)
    if effects.bulk > 0.0:
        surf = surface(parameters.n, parameters.k, parameters.sigma_n0, parameters.rho0)
        theta_i, theta_r = (np.asarray(np.deg2rad(angle)) for angle in angles[:2])
        for angle in np.unique(theta_i).tolist():
            at = theta_i == angle
            for found, q in ((b_s, "s"), (b_p, "p")):
                found[at] = bulk_s1(angle, theta_r[at], effects.bulk, surf, incident=q)
    matrix = np.zeros((*d_s.shape, 3, 3))
    for row, (of_s, of_p) in enumerate(((d_s, d_p), (b_s, b_p))):
        matrix[..., row, 0] = 0.5 * (of_s + of_p)
        matrix[..., row, 1] = 0.5 * (of_s - of_p)
    return matrix


def stokes(
    parameters: Parameters,
    theta_i_deg: ArrayLike,
    theta_r_deg: ArrayLike,
    polarization: str = "u",
    *,
    phi_r_deg: ArrayLike = 0.0,
    phase: str = "fresnel",
    depolarisation: float = 0.0,
    effects: Effects | None = None,
    rtol: float = 1e-8,
) -> Array:
    """Stokes vector of the light scattered from s, p or unpolarised light, Eqs. (9)-(12).

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg, theta_r_deg, phi_r_deg : array_like
        Angles as in `brdf` [deg].
    polarization : {"s", "p", "u"}
        Of the illumination.
    phase, depolarisation, effects, rtol
        As in `mueller`.

    Returns
    -------
    ndarray, shape (..., 3)
        S0, S1, S2 per unit irradiance [sr^-1], Eq. (9) for s light, in the frame and with the
        handedness of `mueller`. S0 is what a detector blind to polarisation reads.

    Raises
    ------
    DomainError
        As for `mueller`, and when the polarisation is not allowed.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(stokes(green, 40.0, [40.0, -10.0], "s").round(6))
    [[0.064165 0.064165 0.      ]
     [0.005193 0.005193 0.      ]]
    """
    share_s, share_p = STATES[checked_polarization(polarization)].weights
    matrix = mueller(
        parameters, theta_i_deg, theta_r_deg,
        phi_r_deg=phi_r_deg, phase=phase, depolarisation=depolarisation, effects=effects,
        rtol=rtol,
    )  # fmt: skip
    return np.asarray(matrix @ np.array((1.0, share_s - share_p, 0.0)))


def degree_of_linear_polarization(stokes_vectors: ArrayLike) -> Array:
    """Degree of linear polarisation, sqrt(S1^2 + S2^2) / S0.

    Parameters
    ----------
    stokes_vectors : array_like, shape (..., 3)
        S0, S1, S2 in any unit: of one direction or, for a scene, of sums over its sources.

    Returns
    -------
    ndarray, shape (...)
        In [0, 1] up to rounding [1]; NaN where there is no light.

    Raises
    ------
    DomainError
        When the last axis is not of length 3.

    Examples
    --------
    >>> print(degree_of_linear_polarization([[2.0, 0.6, 0.8], [1.0, 0.0, 0.0]]))
    [0.5 0. ]
    """
    s0, s1, s2 = _components(stokes_vectors)
    return np.asarray(np.hypot(s1, s2) / np.where(s0 == 0.0, np.nan, s0))


def angle_of_linear_polarization_deg(stokes_vectors: ArrayLike) -> Array:
    """Angle of linear polarisation, atan2(S2, S1) / 2.

    Parameters
    ----------
    stokes_vectors : array_like, shape (..., 3)
        S0, S1, S2 in any unit.

    Returns
    -------
    ndarray, shape (...)
        In (-90, 90] [deg]: 0 is along s, 90 along p, positive counterclockwise for who looks into
        the beam. NaN where the light has no linear polarisation.

    Raises
    ------
    DomainError
        When the last axis is not of length 3.

    Examples
    --------
    >>> print(angle_of_linear_polarization_deg([[1.0, 0.0, 0.3], [1.0, -1.0, 0.0]]))
    [45. 90.]
    """
    _, s1, s2 = _components(stokes_vectors)
    angle = np.degrees(0.5 * np.arctan2(s2, s1))
    angle = np.where(angle == -90.0, 90.0, angle)
    return np.asarray(np.where((s1 == 0.0) & (s2 == 0.0), np.nan, angle))


def _components(stokes_vectors: ArrayLike) -> tuple[Array, Array, Array]:
    vectors = np.asarray(stokes_vectors, dtype=np.float64)
    if vectors.ndim == 0 or vectors.shape[-1] != 3:
        msg = f"Stokes vectors have shape {vectors.shape}: give S0, S1, S2 along the last axis"
        raise DomainError(msg)
    return vectors[..., 0], vectors[..., 1], vectors[..., 2]
