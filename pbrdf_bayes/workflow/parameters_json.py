"""Parameters from JSON: those of ``--params``, or of the summary of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.outside import read_ordinary
from pbrdf_bayes.model.effects import Effects, effects_of_fit, with_values
from pbrdf_bayes.model.four_parameter import DOMAIN, Parameters

_MOST_BYTES = 8 * 2**20
"""Of a file: it may be the summary of a run, some tens of kB."""


def read_parameters(text: str) -> tuple[Parameters, Effects]:
    """The four parameters, and what is added to them, from JSON.

    Parameters
    ----------
    text : str
        A JSON object with n, k, sigma_n0, rho0 and, where wanted, fields of `Effects`; or the path
        of a file that holds one, or that is the ``summary.json`` of a run.

    Returns
    -------
    tuple of Parameters and Effects

    Raises
    ------
    ConfigError
        When the text is no such JSON.
    DomainError
        When a value is out of range.

    Examples
    --------
    >>> text = '{"n": 1.5, "k": 0.0, "sigma_n0": 0.4, "rho0": 0.3, "lambert": 0.01}'
    >>> parameters, effects = read_parameters(text)
    >>> parameters.rho0, effects.lambert
    (0.3, 0.01)
    """
    try:
        content = text if text.lstrip().startswith("{") else read_ordinary(text, _MOST_BYTES)
        table = json.loads(content)
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        msg = f"--params {text[:200]}: not JSON and not a JSON file ({reason[:200]})"
        raise ConfigError(msg) from None
    fitted = isinstance(table, dict) and isinstance(table.get("parameters"), dict)
    if fitted:
        table = _of_summary(table)
    if not isinstance(table, dict) or not set(DOMAIN) <= set(table):
        given = ", ".join(table) if isinstance(table, dict) else type(table).__name__
        msg = f"--params {text[:200]}: needs {', '.join(DOMAIN)}; got {given[:200]}"
        raise ConfigError(msg)
    others = {name: value for name, value in table.items() if name not in DOMAIN}
    effects = effects_of_fit(others) if fitted else with_values(Effects(), others)
    return Parameters(**{name: table[name] for name in DOMAIN}), effects


def _of_summary(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Values at the MAP and choices of the model."""
    known = {*DOMAIN, *(field.name for field in fields(Effects))}
    rows = summary["parameters"].items()
    table = {k: v.get("map") for k, v in rows if k in known and isinstance(v, dict)}
    config = summary.get("config")
    of_config = config.get("fresnel_at") if isinstance(config, dict) else None
    choices = {"line_shape": summary.get("line_shape"), "fresnel_at": of_config}
    return table | {name: value for name, value in choices.items() if value is not None}
