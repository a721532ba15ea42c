"""How much samples differ among themselves, beyond what their uncertainties explain.

The normal hierarchical model, with y_j and s_j the posterior mean and standard deviation of
sample j, theta_j its true value and tau the standard deviation between samples:

    y_j ~ N(theta_j, s_j^2),   theta_j ~ N(mu, tau^2),   p(mu, tau) constant.

mu is integrated out in closed form and tau is left on a grid: nothing is sampled.

References
----------
Gelman et al., Bayesian Data Analysis, 3rd ed. (2013), Section 5.4, Eqs. (5.20) and (5.21).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize_scalar

from pbrdf_bayes.batch.normal_mixture import mixture_quantiles
from pbrdf_bayes.errors import DataError

Array = NDArray[np.float64]

FEWEST_SAMPLES = 3
"""With fewer the posterior of tau under a flat prior has no finite mass."""
_N_GRID = 4001
_INTERVAL = (0.025, 0.5, 0.975)


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of a population of samples.

    Attributes
    ----------
    n : int
        Samples it was inferred from.
    sd_mode, sd_q025, sd_median, sd_q975 : float
        Between-sample standard deviation, in the unit of the values. The mode is the ordinary
        sample standard deviation where the samples are known exactly.
    mean_median, mean_q025, mean_q975 : float
        Mean of the population.
    """

    n: int
    sd_mode: float
    sd_q025: float
    sd_median: float
    sd_q975: float
    mean_median: float
    mean_q025: float
    mean_q975: float


def infer_spread(values: ArrayLike, uncertainties: ArrayLike) -> Spread:
    """Posterior of the spread between samples.

    Parameters
    ----------
    values, uncertainties : array_like, shape (n_samples,)
        Posterior means and standard deviations of a parameter, in one unit.

    Returns
    -------
    Spread

    Raises
    ------
    DataError
        Fewer than `FEWEST_SAMPLES`, or something that is not a finite number, or a negative
        uncertainty; all values equal and known exactly.

    Examples
    --------
    >>> s = infer_spread([1.0, 2.0, 3.0, 4.0, 5.0], [0.0] * 5)
    >>> round(s.sd_mode, 6), round(s.mean_median, 6)
    (1.581139, 3.0)
    """
    y, s = (np.asarray(v, dtype=np.float64) for v in (values, uncertainties))
    _refuse(y, s)
    scale = float(np.std(y) + s.mean())
    # tau = scale u / (1 - u): the grid reaches from 0 to infinity
    u = np.linspace(0.0, 1.0, _N_GRID + 1)[:-1]
    u[0] = 1e-9
    tau = scale * u / (1.0 - u)
    log_density = _log_density(tau, y, s) - 2.0 * np.log1p(-u)
    density: Array = np.exp(log_density - log_density.max())
    mass: Array = cumulative_trapezoid(density, u, initial=0)
    # beyond the last node the integrand is a power of 1 - u, flat for three samples: a rectangle
    total = mass[-1] + density[-1] * (1.0 - u[-1])
    q025, median, q975 = (float(np.interp(p * total, mass, tau)) for p in _INTERVAL)
    weight = np.gradient(mass)
    mu, variance = _centre(tau, y, s)
    mean = mixture_quantiles(mu, np.sqrt(variance), weight / weight.sum(), _INTERVAL)
    return Spread(y.size, _mode(tau, y, s), q025, median, q975, mean[1], mean[0], mean[2])


def _refuse(y: Array, s: Array) -> None:
    if y.size < FEWEST_SAMPLES or y.shape != s.shape:
        msg = f"{y.size} samples: the spread between samples needs at least {FEWEST_SAMPLES}"
        raise DataError(msg)
    if not (np.isfinite(y).all() and np.isfinite(s).all() and (s >= 0.0).all()):
        msg = "values and uncertainties of samples must be finite, uncertainties 0 or more"
        raise DataError(msg)
    if not np.std(y) + s.mean() > 0.0:
        msg = "all samples are equal and known exactly: there is no spread to infer"
        raise DataError(msg)


def _centre(tau: Array, y: Array, s: Array) -> tuple[Array, Array]:
    """Mean of the population and its variance, given tau: Eq. (5.20)."""
    precision = 1.0 / (s**2 + tau[:, None] ** 2)
    variance = 1.0 / precision.sum(axis=1)
    return variance * (precision @ y), variance


def _log_density(tau: Array, y: Array, s: Array) -> Array:
    """Log of the marginal density of tau up to a constant: Eq. (5.21)."""
    mu, variance = _centre(tau, y, s)
    total = s**2 + tau[:, None] ** 2
    parts = np.log(total) + (y - mu[:, None]) ** 2 / total
    return np.asarray(0.5 * np.log(variance) - 0.5 * parts.sum(axis=1))


def _mode(tau: Array, y: Array, s: Array) -> float:
    """Largest density of tau; 0 where it falls from there on."""
    density = _log_density(tau, y, s)
    best = int(np.argmax(density))
    if best == 0:
        return 0.0
    ends = tau[best - 1], tau[min(best + 1, tau.size - 1)]
    found = minimize_scalar(
        lambda t: -_log_density(np.array([t]), y, s)[0], bounds=ends, method="bounded",
        options={"xatol": 1e-10 * ends[1]},
    )  # fmt: skip
    return float(found.x)
