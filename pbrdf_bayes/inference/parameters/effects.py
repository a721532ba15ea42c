"""Parameters of line shapes and effects: meaning, null value, prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import log

from pbrdf_bayes.config import AUTO, RunConfig
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.model.effects import EFFECT_DOMAIN
from pbrdf_bayes.physics.scene import NULL, Scene, make_scene


def _prior(name: str, kind: str, mean: float = 0.0, sd: float = 1.0) -> Prior:
    low, high = EFFECT_DOMAIN[name]
    return Prior(kind=kind, mean=mean, sd=sd, low=low, high=high)


def _sample(
    name: str, symbol: str, description: str, prior: Prior, *, log_coordinate: bool = False
) -> ParameterSpec:
    return ParameterSpec(
        name=name, symbol=symbol, unit="1", description=description, kind="physical", prior=prior,
        log_coordinate=log_coordinate, null=getattr(NULL, name),
    )  # fmt: skip


def _instrument(
    name: str, symbol: str, description: str, prior: Prior, *, unit: str = "1",
    log_coordinate: bool = False,
) -> ParameterSpec:  # fmt: skip
    return ParameterSpec(
        name=name, symbol=symbol, unit=unit, description=description, kind="instrument",
        prior=prior, log_coordinate=log_coordinate, null=getattr(NULL, name),
    )  # fmt: skip


LINE_SHAPE_PARAMETERS: Mapping[str, tuple[ParameterSpec, ...]] = {
    "lorentzian": (),
    "gaussian": (),
    "voigt": (
        _sample(
            "eta", "η", "Lorentzian share of the half width of the lobes (Voigt)",
            _prior("eta", "uniform"),
        ),
    ),
    "cauchy": (
        _sample(
            "nu", "ν", "exponent of the lobes (generalised Cauchy); 1 is the Lorentzian",
            _prior("nu", "lognormal", 0.0, log(1.6)), log_coordinate=True,
        ),
    ),
}  # fmt: skip
EFFECT_PARAMETERS: Mapping[str, tuple[ParameterSpec, ...]] = {
    "lambert": (
        _sample(
            "lambert", "D", "albedo of ideal diffuse scatter beside the surface",
            _prior("lambert", "uniform"),
        ),
    ),
    "bulk": (
        _sample(
            "bulk", "D_b", "bulk scatter that leaves through the surface",
            _prior("bulk", "uniform"),
        ),
    ),
    "volume": (
        _sample(
            "volume", "h_b", "single scattering below the surface",
            _prior("volume", "uniform"),
        ),
        _sample(
            "asymmetry", "b", "asymmetry of its phase function, backwards",
            _prior("asymmetry", "fixed", NULL.asymmetry),
        ),
    ),
    "narrowing": (
        _sample(
            "narrowing", "g", "exponent of the narrowing of the lobes with reflectance (Eq. 5)",
            _prior("narrowing", "uniform"),
        ),
    ),
    "backscatter": (
        _sample(
            "backscatter", "a", "height of the peak back to the source",
            _prior("backscatter", "uniform"),
        ),
        _sample(
            "backscatter_width", "w", "half width (HWHM) of that peak, in tan(g/2)",
            _prior("backscatter_width", "loguniform"), log_coordinate=True,
        ),
    ),
    "dhr_offset": (
        _instrument(
            "dhr_offset", "D_0", "offset of the DHR readings",
            _prior("dhr_offset", "normal", 0.0, 0.005),
        ),
    ),
    "scale_p": (
        _instrument(
            "scale_p", "g_p", "scale of p-polarised BRDF readings over that of s",
            _prior("scale_p", "lognormal", 0.0, 0.02), log_coordinate=True,
        ),
    ),
    "leakage": (
        _instrument(
            "leakage", "l", "share of the other polarisation that the polariser lets through",
            _prior("leakage", "normal", 0.0, 0.005),
        ),
    ),
    "offset_theta_i": (
        _instrument(
            "offset_theta_i_deg", "δ_i", "zero offset of the angle of incidence",
            _prior("offset_theta_i_deg", "normal", 0.0, 0.1), unit="deg",
        ),
    ),
    "offset_theta_r": (
        _instrument(
            "offset_theta_r_deg", "δ_r", "zero offset of the scattering angle",
            _prior("offset_theta_r_deg", "normal", 0.0, 0.1), unit="deg",
        ),
    ),
    "aperture": (
        _instrument(
            "aperture_deg", "a_d", "half of the angle that the detector sees along the scan",
            _prior("aperture_deg", "normal", 0.0, 0.5), unit="deg",
        ),
    ),
}  # fmt: skip
"""By the name under which an effect is asked for. A laboratory that knows its instrument better,
or worse, says so by priors of its own."""


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
    asked = [*LINE_SHAPE_PARAMETERS[config.line_shape]]
    for name in config.effects:
        asked += EFFECT_PARAMETERS[name]
    return asked


def with_own_priors(config: RunConfig) -> RunConfig:
    """Without the priors of effects that it does not have: those of others to choose from."""
    idle = EFFECT_DOMAIN.keys() - {spec.name for spec in effect_specs(config)}
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
