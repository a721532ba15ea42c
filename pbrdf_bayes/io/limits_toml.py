"""The file of limits: TOML in, nothing unknown passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pbrdf_bayes.config import did_you_mean, is_finite, plain_spaces, show_value
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.config_toml import read_toml
from pbrdf_bayes.io.scene_toml import angles_of
from pbrdf_bayes.specification import (
    LONGEST_NAME,
    RULE_OF,
    DecisionRule,
    Limit,
    Specification,
    refuse_other_rule,
)

_RULE = tuple(f.name for f in fields(DecisionRule))
_SHARED = tuple(
    f.name for f in fields(Limit) if f.name not in ("lower", "upper", "difference", "guard")
)
_KEYS = {
    "limit": (*_SHARED, "lower", "upper", "guard"),
    "difference": (*_SHARED, "tolerance", "guard"),
}
_NUMBERS = ("lower", "upper", "guard", "tolerance", "phi_r_deg")


def read_limits(path: str | Path) -> Specification:
    """A specification from a TOML file.

    Parameters
    ----------
    path : str or Path
        ``specification`` (its name), the fields of `DecisionRule`, and a table ``[[limit]]`` for
        each limit, ``[[difference]]`` for each limit on the difference to a reference sample.
        Their keys are the fields of `Limit`; a difference has ``tolerance`` instead of ``lower``
        and ``upper``. Angles [deg] are one number, a list, or the text ``"LO:HI:STEP"``.

    Returns
    -------
    Specification

    Raises
    ------
    ConfigError
        File missing or not TOML, unknown key, value not allowed; the message names file, table and
        key.
    """
    table = read_toml(Path(path))
    try:
        return replace(specification_from_table(table), source=str(path))
    except ConfigError as error:
        msg = f"{path}: {error}"
        raise ConfigError(msg) from None


def specification_from_table(table: Mapping[str, Any]) -> Specification:
    """A specification from plain values, as a TOML file has them.

    Raises
    ------
    ConfigError

    Examples
    --------
    >>> wanted = {"name": "index", "quantity": "parameter", "parameter": "n", "upper": 1.6}
    >>> specification_from_table({"limit": [wanted]}).limits[0].upper
    1.6
    """
    _check_keys(table, ("specification", *_RULE, *_KEYS))
    rule = {key: table[key] for key in _RULE if key in table}
    for key in rule:
        if key != "rule":
            rule[key] = _number(key, rule[key])
    decision = DecisionRule(**rule)
    for key in rule:
        if key in RULE_OF:  # stated, be it the default
            refuse_other_rule(key, decision.rule)
    limits = [
        _limit(kind, row, f"[[{kind}]] {number}")
        for kind in _KEYS
        for number, row in enumerate(_rows(kind, table.get(kind, [])), start=1)
    ]
    title = _text("specification", table.get("specification", ""), may_be_empty=True)
    return Specification(limits=tuple(limits), decision=decision, title=title)


def _rows(kind: str, value: Any) -> list[Mapping[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(row, Mapping) for row in value):
        msg = f"{kind}: give tables, each under a line [[{kind}]]"
        raise ConfigError(msg)
    return value


def _limit(kind: str, row: Mapping[str, Any], where: str) -> Limit:
    """One table; what is wrong is told with its place and its name."""
    named = row.get("name")
    place = f"{where} {show_value(named)}" if isinstance(named, str) and named else where
    try:
        _check_keys(row, _KEYS[kind])
        values: dict[str, Any] = {
            key: _number(key, value) if key in _NUMBERS else value for key, value in row.items()
        }
        values["name"] = _text("name", values.get("name", ""))
        values.setdefault("quantity", "parameter" if "parameter" in values else "")
        for key in ("theta_i_deg", "theta_r_deg"):
            if key in values:
                values[key] = angles_of(key, values[key])
        for key in ("parameter", "polarization", "quantity"):
            if key in values and not isinstance(values[key], str):
                msg = f"{key} = {show_value(values[key])} is not allowed: give a word in quotes"
                raise ConfigError(msg)
        if kind == "difference":
            values |= _of_tolerance(values.pop("tolerance", None))
        return Limit(**values)
    except ConfigError as error:
        msg = f"{place}: {error}"
        raise ConfigError(msg) from None


def _of_tolerance(tolerance: float | None) -> dict[str, Any]:
    if tolerance is None or tolerance <= 0.0:
        msg = (
            f"tolerance = {tolerance!r} is not allowed: give the largest difference that is "
            "tolerated, above 0, in dex for curves and in its unit for a parameter"
        )
        raise ConfigError(msg)
    return {"lower": -tolerance, "upper": tolerance, "difference": True}


def _check_keys(given: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in given:
        if key not in known:
            hint = did_you_mean(key, known)
            msg = f"unknown key {show_value(key)}.{hint} Known: {', '.join(known)}"
            raise ConfigError(msg)


def _number(key: str, value: Any) -> float:
    if not is_finite(value):
        msg = f"{key} = {show_value(value)} is not allowed: give a finite number"
        raise ConfigError(msg)
    return float(value)


def _text(key: str, value: Any, *, may_be_empty: bool = False) -> str:
    text = plain_spaces(value) if isinstance(value, str) else ""
    fits = isinstance(value, str) and len(text) <= LONGEST_NAME
    if not (fits and text.replace("\u00a0", " ").isprintable() and (text.strip() or may_be_empty)):
        msg = (
            f"{key} = {show_value(value)} is not allowed: give 1 to {LONGEST_NAME} printable "
            "characters in quotes"
        )
        raise ConfigError(msg)
    return text
