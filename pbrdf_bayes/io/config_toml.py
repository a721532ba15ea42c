"""The configuration file: TOML in, TOML out, nothing unknown passes."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pbrdf_bayes.config import RunConfig, check_keys
from pbrdf_bayes.errors import ConfigError


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
        File missing or not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        msg = f"{path}: cannot be read ({error.strerror}). Give the path of a TOML file"
        raise ConfigError(msg) from None
    except (ValueError, RecursionError) as error:  # of TOML or UTF-8
        msg = f"{path}: not a TOML file: {error}"
        raise ConfigError(msg) from None


def _check_type(key: str, value: Any, default: Any) -> None:
    """Refuse a value of another kind than the default's."""
    wanted = {bool: "true or false", str: "a word in quotes", tuple: "a list", dict: "a table"}
    kind = type(default)
    if kind in wanted and not isinstance(value, Mapping if kind is dict else kind):
        msg = f"{key} = {value!r} is not allowed: give {wanted[kind]}"
        raise ConfigError(msg)
    if kind is int and (not isinstance(value, int) or isinstance(value, bool)):
        msg = f"{key} = {value!r} is not allowed: give a whole number"
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
