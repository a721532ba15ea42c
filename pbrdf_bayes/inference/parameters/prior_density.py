"""Prior densities: of one parameter, and of all parameters of a posterior evaluated together.

An optimiser asks for one point at a time. Parameter by parameter the calls then cost more than the
likelihood does; in a table each operation runs once, over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Prior:
    """A truncated normal, log-normal, uniform or log-uniform density on [low, high], or one value.

    Attributes
    ----------
    kind : {"normal", "lognormal", "uniform", "loguniform", "fixed"}
    mean, sd : float
        Of the value (normal) or of its natural logarithm (lognormal), before truncation; ``mean``
        is the value where it is fixed.
    low, high : float
        Support.
    """

    kind: str
    low: float
    high: float
    mean: float = 0.0
    sd: float = 1.0

    @property
    def is_log(self) -> bool:
        """The density is simple in the logarithm of the value."""
        return self.kind in ("lognormal", "loguniform")

    @property
    def is_normal(self) -> bool:
        """The density is normal in the value or in its logarithm."""
        return self.kind in ("normal", "lognormal")

    @cached_property
    def _limits(self) -> tuple[float, float]:
        """Support in the variable where the density is normal or uniform."""
        low, high = (self.low, self.high)
        if self.is_log:
            low = log(low) if low > 0.0 else -np.inf
            high = log(high) if isfinite(high) else np.inf
        return low, high

    @cached_property
    def cdf_limits(self) -> tuple[float, float]:
        """Cumulative probabilities of the support before truncation (normal kinds)."""
        low, high = self._limits
        return float(ndtr((low - self.mean) / self.sd)), float(ndtr((high - self.mean) / self.sd))

    @cached_property
    def log_norm(self) -> float:
        """Natural log of the factor that makes it integrate to 1 (not of a fixed value)."""
        low, high = self._limits
        if not self.is_normal:
            return -log(high - low)
        a, b = self.cdf_limits
        return -log(self.sd * sqrt(2.0 * pi)) - log(b - a)

    def log_density(self, values: Array) -> Array:
        """Natural log of the normalised density; -inf outside the support.

        Zero at the value where there is only one.
        """
        column = np.reshape(values, (-1, 1))
        return tabulate([self]).log_density(column).reshape(np.shape(values))

    def quantile(self, probability: Array) -> Array:
        """Value at a cumulative probability."""
        if self.kind == "fixed":
            return np.full(np.shape(probability), self.mean)
        low, high = self._limits
        if self.is_normal:
            a, b = self.cdf_limits
            v = self.mean + self.sd * ndtri(a + (b - a) * probability)
        else:
            v = low + (high - low) * probability
        return np.clip(np.exp(v) if self.is_log else v, self.low, self.high)

    @cached_property
    def standard_deviation(self) -> float:
        """Standard deviation, by the midpoint rule over 20 000 quantiles."""
        grid = (np.arange(20_000) + 0.5) / 20_000
        return float(np.std(self.quantile(grid)))

    def describe(self) -> str:
        """The prior in words, as the report prints it."""
        support = f"[{self.low:g}, {self.high:g}]"
        if self.kind == "fixed":
            return f"fixed at {self.mean:g}"
        if self.kind == "uniform":
            return f"Uniform{support}"
        if self.kind == "loguniform":
            return f"LogUniform{support}"
        if self.kind == "lognormal":
            return f"LogNormal(median {np.exp(self.mean):.3g}, factor {np.exp(self.sd):.3g})"
        if self.mean == 0.0 and self.low == 0.0:
            return f"HalfNormal({self.sd:g})"
        return f"Normal({self.mean:g}, {self.sd:g}) on {support}"


@dataclass(frozen=True, eq=False)
class PriorTable:
    """Constants of the priors, each of shape (n_par, 1); see `tabulate`.

    Attributes
    ----------
    low, high : ndarray
        Support; the one value where a parameter is fixed.
    outside : ndarray
        A value at which the density is finite, put in place of those outside the support.
    log_norm, mean, sd : ndarray
    is_log, is_normal : ndarray of bool
    """

    low: Array
    high: Array
    outside: Array
    log_norm: Array
    mean: Array
    sd: Array
    variance: Array
    is_log: NDArray[np.bool_]
    is_normal: NDArray[np.bool_]

    def log_density(self, x: Array) -> Array:
        """Sum of the log-densities over the parameters, shape (n_sets,), of x (n_sets, n_par).

        -inf outside the support; zero for a fixed parameter at its value.
        """
        values = np.ascontiguousarray(x.T)
        inside = (values >= self.low) & (values <= self.high)
        v = self._variable(np.where(inside, values, self.outside))
        square = np.where(self.is_normal, 0.5 * ((v - self.mean) / self.sd) ** 2, 0.0)
        density = self.log_norm - square - np.where(self.is_log, v, 0.0)
        return np.asarray(np.sum(np.where(inside, density, -np.inf), axis=0))

    def slopes(self, x: Array) -> Array:
        """Derivatives of the log-densities, shape (n_sets, n_par); 0 outside the support."""
        values = np.ascontiguousarray(x.T)
        inside = (values >= self.low) & (values <= self.high) & ((values > 0.0) | ~self.is_log)
        safe = np.where(inside, values, 1.0)
        by_v = np.where(self.is_normal, -(self._variable(safe) - self.mean) / self.variance, 0.0)
        slope = np.where(self.is_log, (by_v - 1.0) / np.where(self.is_log, safe, 1.0), by_v)
        return np.ascontiguousarray(np.where(inside, slope, 0.0).T)

    def _variable(self, safe: Array) -> Array:
        """The variable in which the density is normal or uniform."""
        return np.where(self.is_log, np.log(np.where(self.is_log, safe, 1.0)), safe)


def tabulate(priors: Sequence[Prior]) -> PriorTable:
    """Constants of some priors, in their order.

    Examples
    --------
    >>> priors = [Prior(kind="uniform", low=0.0, high=2.0), Prior(kind="fixed", low=0.0, high=1.0)]
    >>> tabulate(priors).log_density(np.array([[1.0, 0.0], [3.0, 0.0]])).round(3).tolist()
    [-0.693, -inf]
    """

    def column(values: list[float]) -> Array:
        return np.array(values)[:, None]

    fixed = [p.kind == "fixed" for p in priors]
    low = [p.mean if f else p.low for p, f in zip(priors, fixed, strict=True)]
    high = [p.mean if f else p.high for p, f in zip(priors, fixed, strict=True)]
    middle = [0.5 * (a + b) if isfinite(b) else 1.0 for a, b in zip(low, high, strict=True)]
    norm = [0.0 if f else p.log_norm for p, f in zip(priors, fixed, strict=True)]
    return PriorTable(
        low=column(low), high=column(high), outside=column(middle), log_norm=column(norm),
        mean=column([p.mean for p in priors]), sd=column([p.sd for p in priors]),
        variance=column([p.sd**2 for p in priors]),
        is_log=np.array([p.is_log for p in priors])[:, None],
        is_normal=np.array([p.is_normal for p in priors])[:, None],
    )  # fmt: skip
