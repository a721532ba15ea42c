"""Parameters at the bound of their prior: by the draws, and by where an optimum lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds
from pbrdf_bayes.inference.parameters.spec import ParameterSpec
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.verdict import (
    BOUND_NEAR,
    BOUND_NEAR_LOG,
    BOUND_QUANTILE,
    BOUND_REACH,
    BOUND_SHARE_WARN,
)

Array = NDArray[np.float64]


def at_bound(posterior: Posterior, x: Array) -> tuple[str, ...]:
    """Parameters of the model that a set ``x``, shape (n_par,), has on a bound.

    The null value of a parameter is none: there it does nothing, and the model is right without it.
    """
    low, high = _on_bounds(posterior, x)
    specs = [posterior.specs[posterior.free[i]] for i in posterior.of_model]
    return tuple(
        spec.name
        for spec, at_low, at_high in zip(specs, low, high, strict=True)
        if at_high or (at_low and not spec.begins_at_null)
    )


def at_null(posterior: Posterior, x: Array) -> tuple[str, ...]:
    """Parameters of the model that a set ``x``, shape (n_par,), has at their null value below."""
    low, _ = _on_bounds(posterior, x)
    specs = [posterior.specs[posterior.free[i]] for i in posterior.of_model]
    return tuple(s.name for s, at_low in zip(specs, low, strict=True) if at_low & s.begins_at_null)


def _on_bounds(posterior: Posterior, x: Array) -> tuple[list[bool], list[bool]]:
    """Whether the parameters of the model are on the lower, and on the upper end of their prior.

    Nearer than a thousandth of the range or of 1; in the logarithm of a parameter that moves in it,
    nearer than three per cent of its value.
    """
    low, high = coordinate_bounds(posterior)
    z = posterior.to_coordinates(x[None, :])[0]
    margin = np.where(
        posterior.is_log, BOUND_NEAR_LOG, BOUND_NEAR * np.minimum(high - low, 1.0)
    )  # fmt: skip
    at_low, at_high = z < low + margin, z > high - margin
    return at_low[posterior.of_model].tolist(), at_high[posterior.of_model].tolist()


def share_at_bound(spec: ParameterSpec, values: Array) -> float:
    """Share of the draws in the last per cent of the prior, the larger one of either side.

    Where the prior is flat up to its bound, a value there may be small and well known: it counts
    only if the posterior reaches the bound.
    """
    prior = spec.prior
    low, high = prior.quantile(np.array([BOUND_QUANTILE, 1.0 - BOUND_QUANTILE]))
    mean, reach = float(values.mean()), np.inf
    if prior.kind in ("uniform", "loguniform"):
        reach = max(BOUND_REACH * float(values.std()), BOUND_NEAR * (prior.high - prior.low))
    begins = spec.begins_at_null or mean - prior.low > reach
    at_low = 0.0 if begins else float(np.mean(values < low))
    at_high = float(np.mean(values > high)) if prior.high - mean <= reach else 0.0
    return max(at_low, at_high)


def pressed(shares: Mapping[str, float], optimum_at: Sequence[str]) -> tuple[str, ...]:
    """Parameters with more than a fifth of the draws, or with an optimum, at a bound."""
    return tuple(n for n, share in shares.items() if share > BOUND_SHARE_WARN or n in optimum_at)
