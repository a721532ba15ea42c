"""Priors of the parameters: presets of the physical ones, and those the user gives."""

from __future__ import annotations

from collections.abc import Mapping
from math import log
from typing import Any

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.model.four_parameter import DOMAIN

_SPARE = 1e-9


def _in_domain(name: str, kind: str, mean: float = 0.0, sd: float = 1.0, **limits: float) -> Prior:
    low, high = DOMAIN[name]
    return Prior(
        kind=kind, mean=mean, sd=sd, low=limits.get("low", low), high=limits.get("high", high)
    )


_COMMON = {"sigma_n0": _in_domain("sigma_n0", "uniform"), "rho0": _in_domain("rho0", "loguniform")}
PRESETS: Mapping[str, Mapping[str, Prior]] = {
    "paint": {
        "n": _in_domain("n", "normal", 1.5, 0.2, low=1.0, high=3.0),
        "k": _in_domain("k", "normal", 0.0, 0.5),
        **_COMMON,
    },
    "dielectric": {
        "n": _in_domain("n", "uniform", low=1.0, high=3.0),
        "k": _in_domain("k", "normal", 0.0, 0.5),
        **_COMMON,
    },
    "metal": {
        "n": _in_domain("n", "uniform", low=0.05, high=6.0),
        "k": _in_domain("k", "uniform", low=0.1, high=12.0),
        **_COMMON,
    },
}
"""Priors of the physical parameters by the name of the preset."""

NOISE_PRIORS: Mapping[str, Prior] = {
    "s_rel": Prior(kind="lognormal", mean=log(0.02), sd=1.5, low=1e-6, high=3.0),
    "u_dhr": Prior(kind="lognormal", mean=log(0.003), sd=1.5, low=1e-7, high=0.5),
    "tau": Prior(kind="lognormal", mean=log(0.05), sd=1.0, low=1e-5, high=2.0),
    "ell_deg": Prior(kind="lognormal", mean=log(20.0), sd=0.8, low=0.5, high=500.0),
}
"""Priors of the nuisance parameters: relative noise of BRDF readings, noise of DHR readings,
amplitude and length of the discrepancy."""

_SHORTHAND = {"halfnormal": "normal"}
_KEYS = ("kind", "mean", "sd", "low", "high", "median", "factor", "value")
_KINDS = ("normal", "halfnormal", "lognormal", "uniform", "loguniform", "fixed")


def prior_from_table(name: str, table: Mapping[str, Any], default: Prior) -> Prior:
    """Build a prior from the user's table, e.g. ``{kind = "normal", mean = 1.5, sd = 0.05}``.

    Parameters
    ----------
    name : str
        Parameter, for messages.
    table : mapping
        ``kind`` and its numbers; ``fixed`` takes a ``value``, ``lognormal`` takes ``median`` and
        ``factor`` (exp of the standard deviation of the logarithm). Missing limits are those of
        ``default``.
    default : Prior

    Returns
    -------
    Prior

    Raises
    ------
    ConfigError
        Unknown key or kind, a missing or impossible number.
    """
    for key in table:
        if key not in _KEYS:
            hint = did_you_mean(key, _KEYS)
            msg = f"priors.{name}: unknown key {key!r}.{hint} Known: {', '.join(_KEYS)}"
            raise ConfigError(msg)
    kind = table.get("kind", default.kind)
    if kind not in _KINDS:
        hint = did_you_mean(str(kind), _KINDS)
        msg = f"priors.{name}.kind = {kind!r} is not known.{hint} Allowed: {', '.join(_KINDS)}"
        raise ConfigError(msg)
    low = _number(name, table, "low", default.low, default.low, default.high)
    high = _number(name, table, "high", default.high, default.low, default.high)
    if low >= high:
        msg = f"priors.{name}: low = {low:g} is not below high = {high:g}"
        raise ConfigError(msg)
    if kind == "fixed":
        value = _number(name, table, "value", None, low, high)
        return Prior(kind=kind, mean=value, low=low, high=high)
    if kind in ("uniform", "loguniform"):
        if kind == "loguniform" and low <= 0.0:
            msg = f"priors.{name}: loguniform needs low > 0, not {low:g}"
            raise ConfigError(msg)
        return Prior(kind=kind, low=low, high=high)
    if kind == "lognormal":
        median = _number(name, table, "median", None, _SPARE, 1e6)
        factor = _number(name, table, "factor", None, 1.0 + _SPARE, 1e6)
        prior = Prior(kind=kind, mean=log(median), sd=log(factor), low=low, high=high)
        return _with_mass(name, prior)
    mean = 0.0 if kind == "halfnormal" else _number(name, table, "mean", None, -1e6, 1e6)
    sd = _number(name, table, "sd", None, _SPARE, 1e6)
    prior = Prior(kind=_SHORTHAND.get(kind, kind), mean=mean, sd=sd, low=low, high=high)
    return _with_mass(name, prior)


def _with_mass(name: str, prior: Prior) -> Prior:
    low, high = prior.cdf_limits
    if high - low < _SPARE:
        words = {"normal": f"Normal({prior.mean:g}, {prior.sd:g})"}.get(
            prior.kind, prior.describe()
        )
        msg = f"priors.{name}: {words} has no mass on [{prior.low:g}, {prior.high:g}]"
        raise ConfigError(msg)
    return prior


def _number(
    name: str, table: Mapping[str, Any], key: str, default: float | None, low: float, high: float
) -> float:
    value = table.get(key, default)
    if value is None:
        msg = f"priors.{name}: {key!r} is missing"
        raise ConfigError(msg)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not low <= value <= high:
        msg = (
            f"priors.{name}.{key} = {value!r} is not allowed: give a number in [{low:g}, {high:g}]"
        )
        raise ConfigError(msg)
    return float(value)
