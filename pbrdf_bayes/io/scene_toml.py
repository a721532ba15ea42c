"""The scene file: TOML in, nothing unknown passes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pbrdf_bayes.config import is_finite, show_value
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.config_toml import read_toml
from pbrdf_bayes.scenes import ANGLES, Scene, check_scene_keys, spaced

_MOST_ANGLES = 100_000


def read_scene(path: Path) -> Scene:
    """A scene from a TOML file.

    Parameters
    ----------
    path : Path
        Its keys are the fields of `Scene`. Angles [deg] are a list, one number, or the text
        ``"LO:HI:STEP"``; a list of words or of wavelengths may be a single one.

    Returns
    -------
    Scene

    Raises
    ------
    ConfigError
        File missing or not TOML, unknown key, value not allowed; the message names file and key.
    """
    table = read_toml(path)
    try:
        return scene_from_table(table)
    except ConfigError as error:
        msg = f"{path}: {error}"
        raise ConfigError(msg) from None


def scene_from_table(table: Mapping[str, Any]) -> Scene:
    """A scene from plain values, as a TOML file has them.

    Raises
    ------
    ConfigError

    Examples
    --------
    >>> scene_from_table({"theta_i_deg": 20, "theta_r_deg": "-10:10:5"}).theta_r_deg
    (-10.0, -5.0, 0.0, 5.0, 10.0)
    """
    check_scene_keys(table)
    values = dict(table)
    for key in ANGLES:
        if key in values:
            values[key] = angles_of(key, values[key])
    for key in ("polarizations", "wavelength_um"):
        given = values.get(key)
        if given is not None:
            values[key] = tuple(given) if isinstance(given, list) else (given,)
    return Scene(**values)


def angles_of(key: str, value: Any) -> tuple[float, ...]:
    """Angles [deg] of one number, a list or the text ``"LO:HI:STEP"``.

    Raises
    ------
    ConfigError
        It is no such thing; a number that is not finite is none.
    """
    if isinstance(value, str):
        return _grid(key, value)
    angles = value if isinstance(value, list) else [value]
    for angle in angles:
        if not is_finite(angle):
            place = f"{key}: {show_value(angle)} in its list" if isinstance(value, list) else ""
            msg = (
                f"{place or f'{key} = {show_value(value)}'} is not allowed: give finite numbers of "
                'degrees, e.g. 20 or [20, 60], or the text "LO:HI:STEP"'
            )
            raise ConfigError(msg)
    return tuple(map(float, angles))


def _grid(key: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(spaced(text, most=_MOST_ANGLES))
    except ValueError:
        msg = (
            f"{key} = {show_value(text)} is not allowed: give degrees as a list, or as "
            f'"LO:HI:STEP" with LO <= HI, STEP > 0 and fewer than {_MOST_ANGLES} angles, '
            'e.g. "-80:80:0.5"'
        )
        raise ConfigError(msg) from None
