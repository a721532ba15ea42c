"""The configuration file: TOML in, TOML out, nothing unknown passes."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pbrdf_bayes.config import RunConfig, check_keys, show_value
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.outside import MAX_TEXT_BYTES, read_ordinary

_MOST_PARTS = 32
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_MOST_PARTS}}}", re.ASCII)
"""Dotted keys beyond any use: what reads TOML takes the square of their length in time."""


def read_config(path: Path | None, overrides: Mapping[str, Any]) -> RunConfig:
    """Configuration from a TOML file, with values from the command line on top.

    Parameters
    ----------
    path : Path or None
        None takes the defaults.
    overrides : mapping
        Values by key, each an option of that name; None means not given.

    Returns
    -------
    RunConfig

    Raises
    ------
    ConfigError
        File missing or not TOML, unknown key, value not allowed; the message names file and key, or
        the option.
    """
    table: dict[str, Any] = {} if path is None else read_toml(path)
    check_keys(table, where=str(path))
    config = _named(table, str(path))
    for key, value in overrides.items():
        if value is not None:
            table[key] = value
            config = _named(table, f"--{key.replace('_', '-')}")
    return config


def _named(table: Mapping[str, Any], where: str) -> RunConfig:
    """The configuration; an error names where the last value came from."""
    try:
        return config_from_table(table)
    except ConfigError as error:
        msg = f"{where}: {error}"
        raise ConfigError(msg) from None


def config_from_table(table: Mapping[str, Any]) -> RunConfig:
    """Configuration from plain values; lists become tuples.

    Raises
    ------
    ConfigError
    """
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    check_keys(values, where="configuration")
    defaults = RunConfig()
    for key, value in values.items():
        if key != "holdout":  # true, false or a word: the record checks it itself
            _check_type(key, value, getattr(defaults, key))
    return RunConfig(**values)


def config_table(config: RunConfig) -> dict[str, Any]:
    """Plain values of a configuration, as `config_from_table` takes them."""
    table = {f.name: getattr(config, f.name) for f in fields(config)}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in table.items()}


def config_to_toml(config: RunConfig) -> str:
    """The resolved configuration as TOML; `read_config` gives the same record back."""
    table = config_table(config)
    priors = table.pop("priors")
    lines = [f"{key} = {_toml_value(value)}" for key, value in table.items()]
    for name, prior in priors.items():
        lines += ["", f"[priors.{name}]"]
        lines += [f"{key} = {_toml_value(value)}" for key, value in prior.items()]
    return "\n".join(lines) + "\n"


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file.

    Raises
    ------
    ConfigError
        File missing, no ordinary one, larger than `MAX_TEXT_BYTES`, not TOML, or with a whole
        number beyond the 64 bits of TOML.
    """
    try:
        text = read_ordinary(path, MAX_TEXT_BYTES).decode("utf-8-sig")
        if _LONG_KEY.search(text):
            msg = f"{path}: a key of more than {_MOST_PARTS} parts. No key here has so many points"
            raise ConfigError(msg)
        table = tomllib.loads(text)
    except OSError as error:
        msg = f"{path}: cannot be read ({error.strerror}). Give the path of a TOML file"
        raise ConfigError(msg) from None
    except ConfigError:
        raise
    except (ValueError, RecursionError) as error:  # of TOML or UTF-8
        msg = f"{path}: not a TOML file: {str(error)[:200]}"
        raise ConfigError(msg) from None
    _refuse_huge_numbers(path, table)
    return table


def _refuse_huge_numbers(path: Path, table: Mapping[str, Any]) -> None:
    """Refuse whole numbers beyond 64 bits, which no float, and often no message, can hold."""
    left: list[tuple[str, Any]] = list(table.items())
    while left:
        key, value = left.pop()
        if isinstance(value, dict):
            left += [(f"{key}.{name}", item) for name, item in value.items()]
        elif isinstance(value, list):
            left += [(f"{key}[{number}]", item) for number, item in enumerate(value, start=1)]
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            msg = (
                f"{path}: {key[-80:]} = {show_value(value)} is not allowed: a whole number has up "
                "to 64 bits. Give a finite number, with a decimal point where it is large"
            )
            raise ConfigError(msg)


def _check_type(key: str, value: Any, default: Any) -> None:
    """Refuse a value of another kind than the default's."""
    wanted = {bool: "true or false", str: "a word in quotes", tuple: "a list", dict: "a table"}
    kind = type(default)
    if kind in wanted and not isinstance(value, Mapping if kind is dict else kind):
        msg = f"{key} = {show_value(value)} is not allowed: give {wanted[kind]}"
        raise ConfigError(msg)
    if kind is int and (not isinstance(value, int) or isinstance(value, bool)):
        msg = f"{key} = {show_value(value)} is not allowed: give a whole number"
        raise ConfigError(msg)
    if kind is dict and not all(isinstance(v, Mapping) for v in value.values()):
        msg = f"{key}: give one table for each parameter, e.g. [priors.n]"
        raise ConfigError(msg)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
