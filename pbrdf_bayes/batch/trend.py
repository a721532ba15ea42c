"""Whether a parameter drifts over the samples, in their order.

With y_j and s_j the posterior mean and standard deviation of the sample in place x_j:

    y_j ~ N(theta_j, s_j^2),   theta_j ~ N(a + b x_j, tau^2),   p(a, b, tau) constant.

a and b are integrated out in closed form, the marginal law of b is a mixture over a grid of tau.
That of samples known exactly is Student's with n - 3 degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.batch.normal_mixture import mixture_quantiles

Array = NDArray[np.float64]

FEWEST_SAMPLES = 5
"""With fewer the interval says nothing."""
_N_GRID = 2001
_QUANTILES = (0.5, 0.025, 0.975)


@dataclass(frozen=True)
class Trend:
    """Change from a sample to the next.

    Attributes
    ----------
    n : int
        Samples it was inferred from.
    slope_median, slope_q025, slope_q975 : float
        In the unit of the values.
    """

    n: int
    slope_median: float
    slope_q025: float
    slope_q975: float

    @property
    def is_seen(self) -> bool:
        """The 95 % interval does not hold zero."""
        return self.slope_q025 > 0.0 or self.slope_q975 < 0.0


def infer_trend(places: ArrayLike, values: ArrayLike, uncertainties: ArrayLike) -> Trend | None:
    """Posterior of the slope; None where samples are too few or all alike and known exactly.

    Parameters
    ----------
    places, values, uncertainties : array_like, shape (n_samples,)
        Places in the order, all different; posterior means and standard deviations.

    Examples
    --------
    >>> trend = infer_trend(range(6), [1.0, 2.1, 2.9, 4.0, 5.1, 5.9], [0.01] * 6)
    >>> trend.is_seen, round(trend.slope_median, 2)
    (True, 0.99)
    """
    x, y, s = (np.asarray(v, dtype=np.float64) for v in (places, values, uncertainties))
    scale = float(np.std(y) + s.mean()) if y.size else 0.0
    if y.size < FEWEST_SAMPLES or not scale > 0.0:
        return None
    # tau = scale (v / (1 - v))^2: the grid, of midpoints, reaches from 0 to infinity
    v = (np.arange(_N_GRID) + 0.5) / _N_GRID
    tau = scale * v**2 / (1.0 - v) ** 2
    jacobian = np.log(v) - 3.0 * np.log1p(-v)
    weight = 1.0 / (s**2 + tau[:, None] ** 2)
    total = weight.sum(axis=1)
    x0, y0 = (weight @ z / total for z in (x, y))
    dx, dy = x - x0[:, None], y - y0[:, None]
    precision = (weight * dx**2).sum(axis=1)
    slope = (weight * dx * dy).sum(axis=1) / precision
    rest = (weight * (dy - slope[:, None] * dx) ** 2).sum(axis=1)
    logs = 0.5 * (np.log(weight).sum(axis=1) - np.log(total) - np.log(precision) - rest) + jacobian
    mass: Array = np.exp(logs - logs.max())
    sd = 1.0 / np.sqrt(precision)
    return Trend(y.size, *mixture_quantiles(slope, sd, mass / mass.sum(), _QUANTILES))
