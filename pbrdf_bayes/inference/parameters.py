"""The table of what is inferred: name, symbol, unit, meaning, prior, sampling coordinate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig, did_you_mean
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.priors import NOISE_PRIORS, PRESETS, Prior, prior_from_table
from pbrdf_bayes.measurement import Measurement

Array = NDArray[np.float64]
PHYSICAL = ("n", "k", "sigma_n0", "rho0")


@dataclass(frozen=True, kw_only=True)
class ParameterSpec:
    """One inferred parameter.

    Attributes
    ----------
    name, symbol, unit, description : str
    kind : {"physical", "nuisance"}
    prior : Prior
    log_coordinate : bool
        Optimiser and sampler move in the logarithm of the parameter.
    """

    name: str
    symbol: str
    unit: str
    description: str
    kind: str
    prior: Prior
    log_coordinate: bool = False


_PHYSICAL = {
    "n": ("n", "real part of the effective refractive index n − ik", False),
    "k": ("k", "imaginary part of the effective refractive index n − ik", False),
    "sigma_n0": ("σ_N0", "grazing-absorption factor: DHR = σ_N0 F", False),
    "rho0": ("ρ_0", "roughness: half width (HWHM) of the lobe at normal incidence", True),
}
_POLARIZATION_WORDS = {"s": "s-polarised", "p": "p-polarised", "u": "unpolarised"}


def parameter_specs(measurement: Measurement, config: RunConfig) -> tuple[ParameterSpec, ...]:
    """What is inferred from this measurement under these choices, in the order of the columns.

    Raises
    ------
    ConfigError
        When ``config.priors`` names a parameter that is not inferred here.
    """
    specs = [
        ParameterSpec(
            name=name, symbol=symbol, unit="1", description=text, kind="physical",
            prior=PRESETS[config.prior][name], log_coordinate=log_coordinate,
        )
        for name, (symbol, text, log_coordinate) in _PHYSICAL.items()
    ]  # fmt: skip
    present = {scan.polarization for scan in measurement.scans}
    specs += [
        ParameterSpec(
            name=f"s_rel_{q}", symbol=f"s_{q}", unit="1", kind="nuisance", log_coordinate=True,
            description=f"relative white noise of {word} BRDF readings",
            prior=NOISE_PRIORS["s_rel"],
        )
        for q, word in _POLARIZATION_WORDS.items() if q in present
    ]  # fmt: skip
    if np.isnan(measurement.dhr.u_value).any():
        specs.append(
            ParameterSpec(
                name="u_dhr", symbol="u_DHR", unit="1", kind="nuisance", log_coordinate=True,
                description="noise of DHR readings without a stated uncertainty",
                prior=NOISE_PRIORS["u_dhr"],
            )
        )  # fmt: skip
    return tuple(_with_user_prior(spec, config.priors) for spec in _known(specs, config.priors))


def _known(specs: list[ParameterSpec], priors: Mapping[str, Any]) -> list[ParameterSpec]:
    names = [spec.name for spec in specs]
    for name in priors:
        if name not in names:
            hint = did_you_mean(name, names)
            msg = f"priors.{name}: no such parameter here.{hint} Inferred: {', '.join(names)}"
            raise ConfigError(msg)
    return specs


def _with_user_prior(spec: ParameterSpec, priors: Mapping[str, Any]) -> ParameterSpec:
    if spec.name not in priors:
        return spec
    prior = prior_from_table(spec.name, priors[spec.name], spec.prior)
    return ParameterSpec(**{**spec.__dict__, "prior": prior})
