"""Optima of the posterior by multi-start nlopt."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from math import ceil, log2

import nlopt
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from pbrdf_bayes.errors import FitError
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prior_support import possible_samples
from pbrdf_bayes.inference.rejected import Rejected, rejected_among

Array = NDArray[np.float64]

_INSIDE = 1e-12
_SCREENED_PER_START = 16
_SAME_OPTIMUM_NATS = 0.05
_SAME_OPTIMUM_WIDTH = 0.02
_FLOOR = -1e25
_EVALUATIONS = 1200
_NOTHING_GAINED_NATS = 1e-6
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
        Starts from which the optimiser found nothing finite, or stopped on a slope.
    rejected : Rejected
        Points of the prior, tried as starts, at which the model gave no finite density.
    """

    optima: tuple[Optimum, ...]
    n_starts: int
    n_failed: int
    rejected: Rejected = field(default_factory=Rejected)

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
    they come, so that separated modes are visited. nlopt climbs from each, see `climb`.

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
    points = sobol.random_base2(ceil(log2(n_starts * _SCREENED_PER_START)))
    x = posterior.prior_quantile(np.clip(points, 1e-3, 1.0 - 1e-3))
    density = posterior.log_prob(x)
    if not np.isfinite(density).any():  # hardly any sample of the prior may be possible
        x = possible_samples(posterior)[: len(x)]
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
    ends = [end for end in finite if is_stationary(posterior, end[0], low, high)]
    ends = ends or [max(finite, key=lambda end: end[1])]
    rejected = rejected_among(posterior, x, density)
    optima = _distinct(posterior, ends, low, high)
    return MapResult(optima, n_starts, n_starts - len(ends), rejected)


def climb(posterior: Posterior, start: Array, low: Array, high: Array) -> tuple[Array, float]:
    """Nearest maximum uphill of ``start`` (coordinates z) and its log-density.

    L-BFGS is begun again where it stopped until it gains nothing. Where a slope is left, BOBYQA
    goes on without slopes; a climb without end, as on readings without noise, is cut. From an end
    at a bound the climb is tried again from inside: on the bound k = 0 the slope by k vanishes even
    where the density rises inwards.
    """
    end = _climb_smoothly(posterior, start, low, high)
    inside = np.clip(end[0], *_moved_in(low, high))
    if np.isfinite(end[1]) and not np.array_equal(inside, end[0]):
        again = _climb_smoothly(posterior, inside, low, high)
        end = max(end, again, key=lambda found: found[1])
    return end


def _climb_smoothly(
    posterior: Posterior, start: Array, low: Array, high: Array
) -> tuple[Array, float]:
    end = (np.clip(start, low, high), -np.inf)
    left = _EVALUATIONS
    for algorithm in (nlopt.LD_LBFGS, nlopt.LN_BOBYQA, nlopt.LD_LBFGS):
        gained = np.inf
        while gained > _NOTHING_GAINED_NATS and left > 0:
            before = end[1]
            end, used = _search(posterior, algorithm, end, low, high, min(left, _EVALUATIONS // 3))
            gained = end[1] - before if np.isfinite(end[1]) else 0.0
            left -= used
        if left <= 0 or is_stationary(posterior, end[0], low, high):
            break
    return end


def is_stationary(posterior: Posterior, z: Array, low: Array, high: Array) -> bool:
    """Tell whether a step of a thousandth of the width along the slopes would gain next to nothing.

    Slopes that point out of the bounds do not count.
    """
    slope = posterior.gradient_coordinates(z[None, :])[1][0]
    outwards = ((z <= low) & (slope < 0.0)) | ((z >= high) & (slope > 0.0))
    step = 1e-3 * np.minimum(high - low, 1.0)
    return bool(np.all(np.abs(np.where(outwards, 0.0, slope)) * step < _SAME_OPTIMUM_NATS))


def _moved_in(low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds a little inside the given ones."""
    step = 0.05 * np.minimum(high - low, 1.0)
    return low + step, high - step


def _search(
    posterior: Posterior, algorithm: int, start: tuple[Array, float], low: Array, high: Array,
    n_most: int,
) -> tuple[tuple[Array, float], int]:  # fmt: skip
    """One run of nlopt; the best point it saw, whatever way it ended, and its evaluations."""
    best = start

    def objective(z: Array, grad: Array) -> float:
        nonlocal best
        if grad.size:
            values, slopes = posterior.gradient_coordinates(z[None, :])
            value = float(values[0])
            grad[:] = slopes[0]
        else:
            value = float(posterior.log_prob(posterior.from_coordinates(z[None, :]))[0])
        if np.isfinite(value) and value > best[1]:
            best = z.copy(), value
        return value if np.isfinite(value) else _FLOOR

    search = nlopt.opt(algorithm, start[0].size)
    search.set_max_objective(objective)
    search.set_lower_bounds(low)
    search.set_upper_bounds(high)
    search.set_ftol_abs(1e-9)
    search.set_maxeval(n_most)
    if algorithm == nlopt.LN_BOBYQA:
        search.set_initial_step(0.01)
    with suppress(*_NLOPT_ERRORS):  # the best point so far is kept
        search.optimize(start[0])
    return best, max(search.get_numevals(), 1)


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
