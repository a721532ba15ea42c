"""One inferred parameter: name, symbol, unit, meaning, prior, sampling coordinate."""

from __future__ import annotations

from dataclasses import dataclass

from pbrdf_bayes.inference.parameters.prior_density import Prior


@dataclass(frozen=True, kw_only=True)
class ParameterSpec:
    """One parameter of a posterior.

    Attributes
    ----------
    name, symbol, unit, description : str
    kind : {"physical", "instrument", "nuisance", "fixed"}
        Of the sample, of the instrument, of the noise and the misfit; or not inferred.
    prior : Prior
    log_coordinate : bool
        Optimiser and sampler move in the logarithm of the parameter.
    null : float or None
        Value at which the parameter does nothing, allowed where it is a bound.
    """

    name: str
    symbol: str
    unit: str
    description: str
    kind: str
    prior: Prior
    log_coordinate: bool = False
    null: float | None = None

    @property
    def is_fixed(self) -> bool:
        """The parameter has one value and is not inferred."""
        return self.prior.kind == "fixed"

    @property
    def begins_at_null(self) -> bool:
        """The lower bound is where the parameter does nothing: no sign of a wrong model."""
        return self.null is not None and self.null <= self.prior.low
