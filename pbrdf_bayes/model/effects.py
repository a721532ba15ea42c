"""Line shapes and effects beyond the four-parameter model: their values and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from inspect import cleandoc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.effects_table import (
    DIFFUSE,
    EFFECT_PARAMETERS,
    FRESNEL_AT,
    IDLE_WITHOUT,
    LINE_SHAPES,
    EffectFields,
    alternatives_in,
)
from pbrdf_bayes.errors import ConfigError, DomainError
from pbrdf_bayes.physics.scene import FIELDS, Scene, make_scene

_OF_SHAPE = {shape.parameter: shape.name for shape in LINE_SHAPES.values() if shape.parameter}


@dataclass(frozen=True, kw_only=True)
class Effects(EffectFields):
    """What is added to the four-parameter model; as made by ``Effects()`` nothing is.

    Attributes
    ----------
    line_shape : str
        Of `pbrdf_bayes.effects_table.LINE_SHAPES`.
    fresnel_at : {"mean-sine", "geometric-mean", "mean-angle"}
        Where the reflectance of a lobe is taken.

    Raises
    ------
    DomainError
        When a value is out of range, not a number, or of a parameter that does nothing here: that
        of another line shape, or of an effect whose strength is zero.

    Examples
    --------
    >>> Effects(lambert=0.02).lambert
    0.02
    """

    line_shape: str = "lorentzian"
    fresnel_at: str = "mean-sine"

    def __post_init__(self) -> None:
        for name, allowed in (("line_shape", LINE_SHAPES), ("fresnel_at", FRESNEL_AT)):
            value = getattr(self, name)
            if value not in allowed:
                hint = did_you_mean(str(value), allowed)
                msg = f"{name} = {value!r} is not known.{hint} Allowed: {', '.join(allowed)}"
                raise DomainError(msg)
        for name, parameter in EFFECT_PARAMETERS.items():
            value, (low, high) = getattr(self, name), parameter.domain
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not (number and low <= value <= high):
                msg = f"{name} = {value!r} is outside its range [{low:g}, {high:g}]"
                raise DomainError(msg)
        both = alternatives_in(tuple(name for name in DIFFUSE if getattr(self, name) > 0.0))
        if both is not None:
            msg = f"{both[0]} is an alternative to {both[1]}, not an addition: give one of them"
            raise DomainError(msg)
        for name, needs in _idle(self.__dict__).items():
            value = getattr(self, name)
            if value != EFFECT_PARAMETERS[name].null:
                msg = f"{name} = {value!r} does nothing without {needs}: give that, or leave {name}"
                raise DomainError(msg)

    @property
    def is_null(self) -> bool:
        """Nothing is added: exactly the four-parameter model."""
        return self == Effects()


_LAST_FIELD = "Where the reflectance of a lobe is taken.\n"
_OF_TABLE = "".join(
    f"{p.name} : float\n    {p.symbol}: {p.meaning}, "
    f"{p.domain[0]:g} to {p.domain[1]:g} [{p.unit}].\n"
    for p in EFFECT_PARAMETERS.values()
)
Effects.__doc__ = cleandoc(Effects.__doc__ or "").replace(_LAST_FIELD, _LAST_FIELD + _OF_TABLE)


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
    for name, strength in IDLE_WITHOUT.items():
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
    values = [float(getattr(effects, name)) for name in FIELDS]
    scene = make_scene(effects.line_shape, effects.fresnel_at, ("", "", "", "", *FIELDS))
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
