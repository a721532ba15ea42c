"""Parameters of the line shapes and effects that a run asks for."""

from __future__ import annotations

from dataclasses import replace

from pbrdf_bayes.config import AUTO, RunConfig
from pbrdf_bayes.effects_table import (
    EFFECT_PARAMETERS,
    EFFECTS,
    INSTRUMENT_PARAMETERS,
    LINE_SHAPES,
)
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.physics.scene import Scene, make_scene


def effect_spec(name: str) -> ParameterSpec:
    """The declared parameter as one that is inferred."""
    declared = EFFECT_PARAMETERS[name]
    kind, mean, sd = declared.prior
    low, high = declared.domain
    return ParameterSpec(
        name=name, symbol=declared.symbol, unit=declared.unit, description=declared.meaning,
        kind="instrument" if name in INSTRUMENT_PARAMETERS else "physical",
        prior=Prior(kind=kind, mean=mean, sd=sd, low=low, high=high),
        log_coordinate=declared.log_coordinate, null=declared.null,
    )  # fmt: skip


def effect_specs(config: RunConfig) -> list[ParameterSpec]:
    """Parameters beyond the four that the choices of a run ask for.

    Raises
    ------
    ConfigError
        Where the effects are still to be chosen.
    """
    if config.effects == AUTO:
        msg = "effects = auto: `fit` and `choose_effects` choose them. Give names, or none"
        raise ConfigError(msg)
    asked = [*LINE_SHAPES[config.line_shape].parameters]
    for name in config.effects:
        asked += EFFECTS[name].parameters
    return [effect_spec(name) for name in asked]


def with_own_priors(config: RunConfig) -> RunConfig:
    """Without the priors of effects that it does not have: those of others to choose from."""
    idle = EFFECT_PARAMETERS.keys() - {spec.name for spec in effect_specs(config)}
    return replace(config, priors={n: t for n, t in config.priors.items() if n not in idle})


def before_choice(config: RunConfig) -> RunConfig:
    """What ``effects = auto`` starts from; any other configuration as it is."""
    return with_own_priors(replace(config, effects=())) if config.effects == AUTO else config


def build_scene(config: RunConfig, names: tuple[str, ...]) -> Scene | None:
    """What is asked for beyond the four-parameter model; None for that model itself.

    Parameters
    ----------
    config : RunConfig
    names : tuple of str
        Names of the columns of parameter sets.
    """
    if not config.additions:
        return None
    return make_scene(config.line_shape, config.fresnel_at, names)
