"""Line shapes and effects beyond the four-parameter model: their values and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import FRESNEL_AT, INSTRUMENT_EFFECTS, LINE_SHAPES, did_you_mean
from pbrdf_bayes.errors import ConfigError, DomainError
from pbrdf_bayes.physics.lobes.line_shapes import ETA_RANGE, NU_RANGE
from pbrdf_bayes.physics.lobes.shaped import NARROWING_RANGE
from pbrdf_bayes.physics.scene import NULL, EffectValues, Scene, make_scene

EFFECT_DOMAIN: Mapping[str, tuple[float, float]] = {
    "nu": NU_RANGE,
    "eta": ETA_RANGE,
    "narrowing": NARROWING_RANGE,
    "lambert": (0.0, 1.0),
    "bulk": (0.0, 1.0),
    "volume": (0.0, 1.0),
    "asymmetry": (0.0, 0.95),
    "backscatter": (0.0, 1.0),
    "backscatter_width": (0.005, 0.3),
    "dhr_offset": (-0.1, 0.1),
    "scale_p": (0.5, 2.0),
    "leakage": (0.0, 0.1),
    "offset_theta_i_deg": (-1.0, 1.0),
    "offset_theta_r_deg": (-1.0, 1.0),
    "aperture_deg": (0.0, 3.0),
}
"""Ranges of their parameters."""
INSTRUMENT_FIELDS = tuple(
    name for name in EffectValues._fields if name.removesuffix("_deg") in INSTRUMENT_EFFECTS
)
"""Those that say what the instrument does, and not the sample."""
_OF_SHAPE = {"nu": "cauchy", "eta": "voigt"}
_BESIDE = {"asymmetry": "volume", "backscatter_width": "backscatter"}


@dataclass(frozen=True, kw_only=True)
class Effects:
    """What is added to the four-parameter model; as made by ``Effects()`` nothing is.

    Attributes
    ----------
    line_shape : {"lorentzian", "gaussian", "voigt", "cauchy"}
    fresnel_at : {"mean-sine", "geometric-mean", "mean-angle"}
        Where the reflectance of a lobe is taken.
    nu : float
        Exponent of the generalised Cauchy shape, 0.6 to 6 [1].
    eta : float
        Lorentzian share of the Voigt shape: the half width of its Lorentzian over the sum of those
        of Lorentzian and Gaussian [1].
    narrowing : float
        Exponent of Eq. (5) of the 2011 paper, 0 to 2 [1].
    lambert, bulk, volume, backscatter : float
        Strengths of the diffuse terms, see `pbrdf_bayes.physics.effects` [1].
    asymmetry : float
        Of the phase function of ``volume`` [1].
    backscatter_width : float
        Half width (HWHM) of the peak in tan(g/2) [1].
    dhr_offset : float
        Offset of DHR readings [1].
    scale_p : float
        Scale of p-polarised BRDF readings over that of s and of unpolarised ones [1].
    leakage : float
        Share of the other polarisation that the polariser lets through [1].
    offset_theta_i_deg, offset_theta_r_deg : float
        Zero offsets of the goniometer [deg].
    aperture_deg : float
        Half of the range of theta_r that the detector sees [deg]; what of it is beyond the horizon
        counts as nothing.

    Raises
    ------
    DomainError
        When a value is out of range, not a number, or of a parameter that does nothing here: ``nu``
        without the cauchy and ``eta`` without the voigt line shape, ``asymmetry`` without
        ``volume``, ``backscatter_width`` without ``backscatter``.

    Examples
    --------
    >>> Effects(lambert=0.02).lambert
    0.02
    """

    line_shape: str = "lorentzian"
    fresnel_at: str = "mean-sine"
    nu: float = NULL.nu
    eta: float = NULL.eta
    narrowing: float = NULL.narrowing
    lambert: float = NULL.lambert
    bulk: float = NULL.bulk
    volume: float = NULL.volume
    asymmetry: float = NULL.asymmetry
    backscatter: float = NULL.backscatter
    backscatter_width: float = NULL.backscatter_width
    dhr_offset: float = NULL.dhr_offset
    scale_p: float = NULL.scale_p
    leakage: float = NULL.leakage
    offset_theta_i_deg: float = NULL.offset_theta_i_deg
    offset_theta_r_deg: float = NULL.offset_theta_r_deg
    aperture_deg: float = NULL.aperture_deg

    def __post_init__(self) -> None:
        for name, allowed in (("line_shape", LINE_SHAPES), ("fresnel_at", FRESNEL_AT)):
            value = getattr(self, name)
            if value not in allowed:
                hint = did_you_mean(str(value), allowed)
                msg = f"{name} = {value!r} is not known.{hint} Allowed: {', '.join(allowed)}"
                raise DomainError(msg)
        for name, (low, high) in EFFECT_DOMAIN.items():
            value = getattr(self, name)
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not (number and low <= value <= high):
                msg = f"{name} = {value!r} is outside its range [{low:g}, {high:g}]"
                raise DomainError(msg)
        if self.lambert > 0.0 and self.bulk > 0.0:
            msg = "bulk is an alternative to lambert, not an addition: give one of them"
            raise DomainError(msg)
        for name, needs in _idle(self.__dict__).items():
            value, null = getattr(self, name), getattr(NULL, name)
            if value != null:
                msg = f"{name} = {value!r} does nothing without {needs}: give that, or leave {name}"
                raise DomainError(msg)

    @property
    def is_null(self) -> bool:
        """Nothing is added: exactly the four-parameter model."""
        return self == Effects()


def given_effects(effects: object) -> Effects:
    """Effects as they were given to a function of the model, none for None.

    Raises
    ------
    DomainError
        When it is anything else, such as a mapping.
    """
    if effects is None:
        return Effects()
    if not isinstance(effects, Effects):
        msg = f"effects = {effects!r} is no pb.Effects. Give e.g. pb.Effects(lambert=0.01)"
        raise DomainError(msg)
    return effects


def _idle(values: Mapping[str, Any]) -> dict[str, str]:
    """Parameters that do nothing beside these values, and what they need."""
    shape = values.get("line_shape", Effects.line_shape)
    found = {name: f"line_shape = {word!r}" for name, word in _OF_SHAPE.items() if word != shape}
    for name, strength in _BESIDE.items():
        if not values.get(strength, 0.0) > 0.0:
            found[name] = f"{strength} > 0"
    return found


def effects_of_fit(values: Mapping[str, Any]) -> Effects:
    """Effects with the values of a fit, which keeps parameters beside a strength of zero.

    Parameters
    ----------
    values : mapping of str to value
        Fields of `Effects` by name; those that do nothing are left out.

    Raises
    ------
    DomainError
        When a value is out of range.

    Examples
    --------
    >>> effects_of_fit({"volume": 0.0, "asymmetry": 0.6}).is_null
    True
    """
    idle = _idle(values)
    return Effects(**{name: value for name, value in values.items() if name not in idle})


def scene_and_columns(
    effects: Effects, parameters: NDArray[np.float64]
) -> tuple[Scene, NDArray[np.float64]]:
    """What a kernel needs for these values.

    Parameters
    ----------
    effects : Effects
    parameters : ndarray, shape (4,)
        n, k, sigma_n0, rho0.

    Returns
    -------
    tuple of Scene and ndarray, shape (1, 4 + n_effects)
    """
    names = EffectValues._fields
    values = [float(getattr(effects, name)) for name in names]
    scene = make_scene(effects.line_shape, effects.fresnel_at, ("", "", "", "", *names))
    return scene, np.concatenate([parameters, values])[None, :]


def with_values(effects: Effects, table: Mapping[str, Any], *, prefix: str = "") -> Effects:
    """Effects with values by name in place of theirs, as a file has them.

    Parameters
    ----------
    effects : Effects
    table : mapping of str to value
    prefix : str
        What stands before a name in the file.

    Raises
    ------
    ConfigError
        Naming a key that is not known.
    DomainError
        When a value is out of range.
    """
    known = [field.name for field in fields(Effects)]
    for name in table:
        if name not in known:
            hint = did_you_mean(name, known)
            msg = f"{prefix}{name} is not known.{hint} Known: {', '.join(known)}"
            raise ConfigError(msg)
    return replace(effects, **table)
