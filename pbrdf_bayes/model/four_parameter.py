"""The four-parameter model for direct use, in degrees: parameters, BRDF, DHR.

Equation numbers are those of Renhorn, Hallberg, Bergstrom, Boreman, "Four-parameter model for
polarization-resolved rough-surface BRDF", Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite, log10

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.model.effects import Effects, given_effects, scene_and_columns
from pbrdf_bayes.model.energy import GRAZING_DEG, check_energy
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.physics.normalisation.plain import incidence, normalisation_integrals, workspace
from pbrdf_bayes.physics.scattering import evaluate_with_effects
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

DOMAIN: Mapping[str, tuple[float, float]] = {
    "n": (0.05, 6.0),
    "k": (0.0, 12.0),
    "sigma_n0": (0.0, 1.0),
    "rho0": (1e-3, 4.0),
}
"""Where the model is computed; the accuracy is tested there for n >= 1 or k >= 1."""
MAX_THETA_I_DEG = GRAZING_DEG
_NO_ANGLES = np.zeros(0)
_MORE_DIGITS = 4.0
_ROUNDING = 2e-13


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The four parameters of the model.

    Attributes
    ----------
    n, k : float
        Effective refractive index n - ik [1].
    sigma_n0 : float
        Grazing-absorption factor: DHR_q = sigma_n0 F_q, in [0, 1] [1].
    rho0 : float
        Roughness: half width at half maximum of the lobe at normal incidence, in direction
        cosine [1].

    Raises
    ------
    DomainError
        When a value is outside `DOMAIN`, not a number, or n = 1 with k = 0 (no surface).

    Examples
    --------
    The green paint of the paper at 3.39 um:

    >>> Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47).n
    1.526
    """

    n: float
    k: float
    sigma_n0: float
    rho0: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            low, high = DOMAIN[field.name]
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not (number and low <= value <= high):
                msg = f"{field.name} = {value!r} is outside the model's domain [{low:g}, {high:g}]"
                raise DomainError(msg)
        if self.n == 1.0 and self.k == 0.0:
            msg = "n = 1 with k = 0 is no surface: nothing is reflected. Allowed: n != 1 or k > 0"
            raise DomainError(msg)
        if self.n < 1.0 and self.k < 0.1:
            msg = (
                f"n = {self.n!r} with k = {self.k!r} reflects totally beyond a critical angle, "
                "where the lobe has no width. Allowed below n = 1: k >= 0.1"
            )
            raise DomainError(msg)

    def as_array(self) -> Array:
        """Values as an array, shape (4,), in the order n, k, sigma_n0, rho0."""
        return np.array([self.n, self.k, self.sigma_n0, self.rho0], dtype=np.float64)


def brdf(
    parameters: Parameters,
    theta_i_deg: ArrayLike,
    theta_r_deg: ArrayLike,
    polarization: str = "s",
    *,
    phi_r_deg: ArrayLike = 0.0,
    effects: Effects | None = None,
    rtol: float = 1e-8,
) -> Array:
    """Polarised BRDF, Eqs. (3)-(6), and what effects add.

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg : array_like
        Angle of incidence, [0, 89.95] [deg].
    theta_r_deg : array_like
        Angle of scattering, [-90, 90] [deg]; + is the forward (specular) side.
    polarization : {"s", "p", "u"}
        ``u`` is the mean of s and p (Eq. 6).
    phi_r_deg : array_like
        Azimuth of the scattering direction [deg]; 0 is the plane of incidence. The direction
        cosines are alpha = sin(theta_r) cos(phi_r) and beta = sin(theta_r) sin(phi_r).
    effects : Effects, optional
        Line shape and effects; none by default.
    rtol : float
        Relative tolerance of the normalisation, in [1e-12, 1e-2].

    Returns
    -------
    ndarray
        BRDF [sr^-1], of the broadcast shape of the angles.

    Raises
    ------
    DomainError
        When an angle, the polarisation or the tolerance is not allowed, or the sample would reflect
        more than it receives.

    Notes
    -----
    The relative error is below 10 ``rtol`` for n in [1.0005, 6] with k in [0, 10] and for metals
    with n in [0.1, 1] and k in [1, 8] (``tests/physics/test_accuracy.py``).

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(brdf(green, 20.0, [-40.0, 0.0, 20.0], "s").round(6))
    [0.003834 0.013491 0.025692]
    """
    angles = np.broadcast_arrays(
        checked_angles("theta_i_deg", theta_i_deg, 0.0, MAX_THETA_I_DEG),
        checked_angles("theta_r_deg", theta_r_deg, -90.0, 90.0),
        checked_angles("phi_r_deg", phi_r_deg, -360.0, 360.0),
    )
    theta_i, theta_r, phi_r = (np.deg2rad(angle.ravel()) for angle in angles)
    geometry = prepare_geometry(
        theta_i=theta_i,
        theta_r=theta_r,
        phi_r=phi_r,
        polarization=np.full(theta_i.size, checked_polarization(polarization)),
        dhr_theta_i=_NO_ANGLES,
        dhr_polarization=np.zeros(0, np.str_),
    )
    values, _ = _evaluate(parameters, effects, geometry, digits_of(rtol))
    return np.asarray(values[0].reshape(angles[0].shape))


def dhr(
    parameters: Parameters, theta_i_deg: ArrayLike, polarization: str = "s", *,
    effects: Effects | None = None,
) -> Array:  # fmt: skip
    """Directional hemispherical reflectance, Eq. (2): sigma_n0 F_q(theta_i), and what effects add.

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg : array_like
        Angle of incidence, [0, 89.95] [deg].
    polarization : {"s", "p", "u"}
    effects : Effects, optional
        Line shape and effects; none by default.

    Returns
    -------
    ndarray
        DHR [1], of the shape of ``theta_i_deg``.

    Raises
    ------
    DomainError
        When an angle or the polarisation is not allowed, or the sample would reflect more than it
        receives.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> print(dhr(green, [10.0, 80.0], "p").round(5))
    [0.02128 0.10927]
    """
    angles = checked_angles("theta_i_deg", theta_i_deg, 0.0, MAX_THETA_I_DEG)
    geometry = prepare_geometry(
        theta_i=_NO_ANGLES,
        theta_r=_NO_ANGLES,
        phi_r=_NO_ANGLES,
        polarization=np.zeros(0, np.str_),
        dhr_theta_i=np.deg2rad(angles.ravel()),
        dhr_polarization=np.full(angles.size, checked_polarization(polarization)),
    )
    _, values = _evaluate(parameters, effects, geometry, 6.0)
    return np.asarray(values[0].reshape(angles.shape))


def _evaluate(
    parameters: Parameters, effects: Effects | None, geometry: Geometry, digits: float
) -> tuple[Array, Array]:
    """BRDF and DHR of the rows, shapes (1, n_brdf) and (1, n_dhr)."""
    x = parameters.as_array()
    added = given_effects(effects)
    if added.is_null:
        return evaluate(geometry, x[None, :], digits)
    check_energy(x, added)
    return evaluate_with_effects(geometry, *scene_and_columns(added, x), digits)


def reciprocity_ratio(
    parameters: Parameters, theta_a_deg: float, theta_b_deg: float, polarization: str = "s"
) -> float:
    """f(a -> b) / f(b -> a) in plane, 1 for a reciprocal BRDF [1].

    The paper calls the model reciprocal. Its factor sigma_N^q depends on the angle of incidence
    (Eq. 4), so that the ratio is not 1.

    Parameters
    ----------
    parameters : Parameters
    theta_a_deg, theta_b_deg : float
        Angles in the plane of incidence, forward side, [0, 89.95] [deg].
    polarization : {"s", "p", "u"}

    Returns
    -------
    float

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> round(reciprocity_ratio(green, 20.0, 60.0, "s"), 2)
    1.2
    >>> round(reciprocity_ratio(green, 20.0, 60.0, "p"), 1)
    5.7
    """
    there, back = brdf(
        parameters, [theta_a_deg, theta_b_deg], [theta_b_deg, theta_a_deg], polarization
    )
    return float(there / back)


def normalisation_error(
    parameters: Parameters, theta_i_deg: ArrayLike, rtol: float = 1e-8
) -> Array:
    """Estimated relative error of the normalisation integral of Eq. (4) at a tolerance [1].

    The difference to the same quadrature with four more digits, plus a floor for rounding. The
    larger of s and p.

    Parameters
    ----------
    parameters : Parameters
    theta_i_deg : array_like
        Angle of incidence, [0, 89.95] [deg].
    rtol : float
        Relative tolerance whose error is wanted, in [1e-12, 1e-2].

    Returns
    -------
    ndarray
        Estimates, of the shape of ``theta_i_deg``.

    Raises
    ------
    DomainError
        When an angle or the tolerance is not allowed.

    Notes
    -----
    The true error is below 10 times the estimate, against integrations in extended precision
    over the whole domain (``tests/physics/test_error_estimate.py``).

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> bool(normalisation_error(green, 60.0, rtol=1e-6) < 1e-6)
    True
    """
    angles = checked_angles("theta_i_deg", theta_i_deg, 0.0, MAX_THETA_I_DEG)
    digits = digits_of(rtol)
    surf = surface(parameters.n, parameters.k, parameters.sigma_n0, parameters.rho0)
    scratch = workspace()
    errors = np.empty(angles.size)
    for i, theta_i in enumerate(np.deg2rad(angles.ravel())):
        coarse, fine = (
            np.array(normalisation_integrals(incidence(theta_i), surf, wanted, scratch))
            for wanted in (digits, digits + _MORE_DIGITS)
        )
        errors[i] = np.max(np.abs(coarse / fine - 1.0)) + _ROUNDING
    return errors.reshape(angles.shape)


def digits_of(rtol: float) -> float:
    """Decimal digits asked of the quadrature for a relative tolerance.

    Raises
    ------
    DomainError
        Outside [1e-12, 1e-2].
    """
    if not 1e-12 <= rtol <= 1e-2:
        msg = f"rtol = {rtol!r} is not allowed: give a tolerance in [1e-12, 1e-2]"
        raise DomainError(msg)
    return -log10(rtol)


def check_directions(
    *, theta_i_deg: ArrayLike, theta_r_deg: ArrayLike = 0.0, phi_r_deg: ArrayLike = 0.0
) -> None:
    """Refuse directions that the model is not computed for, NaN included.

    Parameters
    ----------
    theta_i_deg, theta_r_deg, phi_r_deg : array_like
        Angles as in `brdf` [deg].

    Raises
    ------
    DomainError
        Naming the angle, its value and what is allowed.
    """
    checked_angles("theta_i_deg", theta_i_deg, 0.0, MAX_THETA_I_DEG)
    checked_angles("theta_r_deg", theta_r_deg, -90.0, 90.0)
    checked_angles("phi_r_deg", phi_r_deg, -360.0, 360.0)


def checked_angles(name: str, values: ArrayLike, low: float, high: float) -> Array:
    """Angles [deg] as an array.

    Raises
    ------
    DomainError
        Where one is outside [low, high], or not a number; names the angle.
    """
    array = np.asarray(values, dtype=np.float64)
    bad = array[~((array >= low) & (array <= high))]
    if bad.size:
        first = float(bad.flat[0])
        hint = "" if isfinite(first) else " (not a finite number)"
        msg = f"{name} = {first!r}{hint} is not allowed: give degrees in [{low:g}, {high:g}]"
        raise DomainError(msg)
    return array


def checked_polarization(polarization: str) -> str:
    """The word itself, where it is one of a state of polarisation.

    Raises
    ------
    DomainError
    """
    if polarization not in POLARIZATIONS:
        allowed = ", ".join(map(repr, POLARIZATIONS))
        msg = f"polarization = {polarization!r} is not known. Allowed: {allowed}"
        raise DomainError(msg)
    return polarization
