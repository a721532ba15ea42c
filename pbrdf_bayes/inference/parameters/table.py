"""The table of what is inferred: name, symbol, unit, meaning, prior, sampling coordinate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig, did_you_mean
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.effects import effect_specs
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.inference.parameters.priors import NOISE_PRIORS, PRESETS, prior_from_table
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.quantities import STATES
from pbrdf_bayes.records.summary import PHYSICAL as PHYSICAL

Array = NDArray[np.float64]
DISCREPANCY = ("tau", "ell_deg")
"""Amplitude and length of the correlated misfit; a flat prior of either would replace the model."""


_PHYSICAL = {
    "n": ("n", "real part of the effective refractive index n − ik", False),
    "k": ("k", "imaginary part of the effective refractive index n − ik", False),
    "sigma_n0": ("σ_N0", "grazing-absorption factor: DHR = σ_N0 F", False),
    "rho0": ("ρ_0", "roughness: half width (HWHM) of the lobe at normal incidence", True),
}
_LONGEST_BOUND_DEG = 40.0


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
            null=0.0 if name == "k" else None,
        )
        for name, (symbol, text, log_coordinate) in _PHYSICAL.items()
    ]  # fmt: skip
    specs += effect_specs(config)
    present = {scan.polarization for scan in measurement.scans}
    specs += [
        ParameterSpec(
            name=f"s_rel_{q}", symbol=f"s_{q}", unit="1", kind="nuisance", log_coordinate=True,
            description=f"relative white noise of {state.adjective} BRDF readings",
            prior=NOISE_PRIORS["s_rel"],
        )
        for q, state in STATES.items() if q in present
    ]  # fmt: skip
    if config.noise == "correlated" and measurement.scans:
        specs += [
            ParameterSpec(
                name="tau", symbol="τ", unit="1", kind="nuisance", log_coordinate=True,
                description="amplitude of the model's discrepancy along a scan, in ln BRDF",
                prior=NOISE_PRIORS["tau"],
            ),
            ParameterSpec(
                name="ell_deg", symbol="ℓ", unit="deg", kind="nuisance", log_coordinate=True,
                description="length of the model's discrepancy along θ_r",
                prior=_resolved(NOISE_PRIORS["ell_deg"], measurement),
            ),
        ]  # fmt: skip
    if np.isnan(measurement.dhr.u_value).any():
        specs.append(
            ParameterSpec(
                name="u_dhr", symbol="u_DHR", unit="1", kind="nuisance", log_coordinate=True,
                description="noise of DHR readings without a stated uncertainty",
                prior=NOISE_PRIORS["u_dhr"],
            )
        )  # fmt: skip
    chosen = [_with_user_prior(spec, config.priors) for spec in _known(specs, config.priors)]
    if all(spec.is_fixed for spec in chosen if spec.kind == "physical"):
        msg = "priors: every parameter of the sample is fixed. Leave one of them free"
        raise ConfigError(msg)
    return tuple(replace(spec, kind="fixed") if spec.is_fixed else spec for spec in chosen)


def _resolved(prior: Prior, measurement: Measurement) -> Prior:
    """The prior of the length from twice the spacing of the readings on.

    A discrepancy shorter than that is white noise by another name: the two would trade places along
    a ridge that says nothing.
    """
    theta_r = measurement.brdf.theta_r_deg
    gaps = [np.diff(np.unique(theta_r[scan.rows])) for scan in measurement.scans]
    spacing = min((float(np.median(gap)) for gap in gaps if gap.size), default=prior.low)
    return replace(prior, low=min(max(prior.low, 2.0 * spacing), _LONGEST_BOUND_DEG))


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
    if spec.name in DISCREPANCY and prior.kind in ("uniform", "loguniform"):
        msg = (
            f"priors.{spec.name}: a flat prior lets the discrepancy take the place of the model. "
            "Give a lognormal one, e.g. {kind = 'lognormal', median = 0.05, factor = 2.7}"
        )
        raise ConfigError(msg)
    return replace(spec, prior=prior)
