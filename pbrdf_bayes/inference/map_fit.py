"""Optima of the posterior by multi-start nlopt, and the least-squares optimum of the same model."""

from __future__ import annotations

from dataclasses import dataclass

import nlopt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import qmc

from pbrdf_bayes.errors import FitError
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.physics.brdf import LOG_TINY, evaluate_gradient

Array = NDArray[np.float64]

_INSIDE = 1e-12
_SCREENED_PER_START = 16
_SAME_OPTIMUM_NATS = 0.05
_SAME_OPTIMUM_WIDTH = 0.02
_FLOOR = -1e25
_NLOPT_ERRORS = (
    nlopt.RoundoffLimited,
    getattr(nlopt, "exception", RuntimeError),  # before 2.11 a plain RuntimeError
    RuntimeError,
    ValueError,
)


@dataclass(frozen=True, eq=False)
class Optimum:
    """A local maximum of the posterior density in the coordinates z.

    Attributes
    ----------
    x : ndarray, shape (n_par,)
        Parameters in physical units.
    log_posterior : float
        Log of prior times likelihood there (density in physical units).
    n_starts : int
        Starts that ended here.
    """

    x: Array
    log_posterior: float
    n_starts: int


@dataclass(frozen=True, eq=False)
class MapResult:
    """Distinct optima, best first.

    Attributes
    ----------
    optima : tuple of Optimum
    n_starts : int
    n_failed : int
        Starts from which the optimiser found nothing finite.
    """

    optima: tuple[Optimum, ...]
    n_starts: int
    n_failed: int

    @property
    def best(self) -> Optimum:
        """The maximum a posteriori."""
        return self.optima[0]


def coordinate_bounds(posterior: Posterior) -> tuple[Array, Array]:
    """Support of the prior in the coordinates z, each of shape (n_par,)."""
    support = np.array([[spec.prior.low, spec.prior.high] for spec in posterior.specs])
    low, high = posterior.to_coordinates(support.T.copy())
    return low + _INSIDE, high - _INSIDE  # exp(log(bound)) may round to outside


def find_map(posterior: Posterior, *, n_starts: int = 16, seed: int) -> MapResult:
    """Maximise the posterior from many starts.

    Starts are Sobol points of the prior, the better half of those kept by density and the rest as
    they come, so that separated modes are visited. nlopt's L-BFGS climbs, BOBYQA polishes.

    Parameters
    ----------
    posterior : Posterior
    n_starts : int
    seed : int

    Returns
    -------
    MapResult

    Raises
    ------
    FitError
        When no start gives a finite posterior density.
    """
    low, high = coordinate_bounds(posterior)
    sobol = qmc.Sobol(posterior.n_par, rng=np.random.default_rng(seed))
    points = sobol.random(n_starts * _SCREENED_PER_START)
    x = posterior.prior_quantile(np.clip(points, 1e-3, 1.0 - 1e-3))
    density = posterior.log_prob(x)
    order = np.argsort(-density)
    n_best = n_starts // 2
    rest = order[n_best:][np.isfinite(density[order[n_best:]])]
    chosen = np.concatenate([order[:n_best], np.sort(rest)[: n_starts - n_best]])
    found = [
        climb(posterior, start, low, high)
        for start in posterior.to_coordinates(x[chosen][np.isfinite(density[chosen])])
    ]
    finite = [(z, value) for z, value in found if np.isfinite(value) and value > _FLOOR]
    if not finite:
        msg = (
            f"{posterior.measurement.sample}: none of {n_starts} starts gives a finite posterior "
            "density. Check units and values of the readings and the support of the priors"
        )
        raise FitError(msg)
    return MapResult(_distinct(posterior, finite, low, high), n_starts, n_starts - len(finite))


def climb(posterior: Posterior, start: Array, low: Array, high: Array) -> tuple[Array, float]:
    """Nearest maximum uphill of ``start`` (coordinates z) and its log-density."""

    def objective(z: Array, grad: Array) -> float:
        if grad.size:
            values, slopes = posterior.gradient_coordinates(z[None, :])
            value = float(values[0])
            grad[:] = slopes[0]
        else:
            value = float(posterior.log_prob(posterior.from_coordinates(z[None, :]))[0])
        if np.isfinite(value) and value > best[1]:
            best[0], best[1] = z.copy(), value
        return value if np.isfinite(value) else _FLOOR

    best: list[Array | float] = [start, -np.inf]
    for algorithm, evaluations in ((nlopt.LD_LBFGS, 300), (nlopt.LN_BOBYQA, 400)):
        search = nlopt.opt(algorithm, start.size)
        search.set_max_objective(objective)
        search.set_lower_bounds(low)
        search.set_upper_bounds(high)
        search.set_ftol_abs(1e-9)
        search.set_maxeval(evaluations)
        if algorithm == nlopt.LN_BOBYQA:
            search.set_initial_step(0.01)
        try:
            search.optimize(np.clip(np.asarray(best[0]), low, high))
        except _NLOPT_ERRORS:
            continue  # the best point so far is kept in ``best``
    return np.asarray(best[0]), float(np.asarray(best[1]))


def _distinct(
    posterior: Posterior, found: list[tuple[Array, float]], low: Array, high: Array
) -> tuple[Optimum, ...]:
    """Merge ends that are the same optimum; best first."""
    width = np.minimum(high - low, 10.0)
    groups: list[list[tuple[Array, float]]] = []
    for z, value in sorted(found, key=lambda item: -item[1]):
        for group in groups:
            near = np.max(np.abs(z - group[0][0]) / width) < _SAME_OPTIMUM_WIDTH
            if near and group[0][1] - value < max(_SAME_OPTIMUM_NATS, 1.0):
                group.append((z, value))
                break
        else:
            groups.append([(z, value)])
    return tuple(
        Optimum(posterior.from_coordinates(group[0][0][None, :])[0], group[0][1], len(group))
        for group in groups
    )


def fit_least_squares(posterior: Posterior, starts: Array) -> tuple[Array, float]:
    """Physical parameters that minimise the rms of ln(measured/model) over the BRDF rows.

    No noise model, no calibration, no discrepancy: how well the model can follow the curves.

    Parameters
    ----------
    posterior : Posterior
    starts : ndarray, shape (n_starts, n_par)
        Parameters to start from, physical units.

    Returns
    -------
    tuple of ndarray (n_par,) and float
        Parameters (nuisance as in the best start) and the rms [dex]; NaN without BRDF rows.
    """
    y = posterior.rows.y[~posterior.rows.censored]
    if y.size == 0:
        return starts[0], float("nan")
    low, high = coordinate_bounds(posterior)
    low, high = low[:4], high[:4]

    keep = ~posterior.rows.censored

    def at(z: Array) -> Array:
        full = posterior.to_coordinates(starts[:1])
        full[0, :4] = z
        return posterior.from_coordinates(full)

    def residuals(z: Array) -> Array:
        log_f, _, _, _ = evaluate_gradient(posterior.geometry, at(z), posterior.digits)
        return np.asarray(y - np.maximum(log_f[0, keep], LOG_TINY))

    def jacobian(z: Array) -> Array:
        x = at(z)
        _, _, slopes, _ = evaluate_gradient(posterior.geometry, x, posterior.digits)
        scale = np.where(posterior.is_log[:4], x[0, :4], 1.0)
        return np.asarray(-slopes[0, keep] * scale)

    best_z, best_cost = posterior.to_coordinates(starts)[0, :4], np.inf
    for start in posterior.to_coordinates(starts)[:, :4]:
        margin = 1e-6 * np.minimum(high - low, 1.0)
        fit = least_squares(
            residuals, np.clip(start, low + margin, high - margin), jacobian,
            bounds=(low, high), x_scale=np.array([0.1, 0.1, 0.1, 0.1]), max_nfev=200,
        )  # fmt: skip
        if fit.cost < best_cost:
            best_z, best_cost = fit.x, fit.cost
    return at(best_z)[0], float(np.sqrt(2.0 * best_cost / y.size) / np.log(10.0))
