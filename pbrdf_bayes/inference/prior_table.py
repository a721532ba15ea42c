"""The priors of all parameters of a posterior, evaluated together.

An optimiser asks for one point at a time. Parameter by parameter the calls then cost more than the
likelihood does; here each operation runs once, over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pbrdf_bayes.inference.priors import Prior

Array = NDArray[np.float64]


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
    >>> from pbrdf_bayes.inference.priors import Prior
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
