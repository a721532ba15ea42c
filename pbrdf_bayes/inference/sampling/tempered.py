"""Particles from the prior to the posterior, by tempering: where no proposal near the optimum fits.

The likelihood is raised to powers from 0 to 1. Each power is the largest that leaves half of the
particles effective; they are resampled and moved by differential evolution, which leaves every
tempered law invariant. Del Moral, Doucet and Jasra, J. R. Stat. Soc. B 68, 411 (2006),
doi:10.1111/j.1467-9868.2006.00553.x; ter Braak, Stat. Comput. 16, 239 (2006),
doi:10.1007/s11222-006-8769-1.

With few readings n, k and sigma_N0 lie on a thin curved sheet of equal reflectance. Particles move
in ln(sigma_N0 F(0)) instead of sigma_N0: on that axis the sheet is flat.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.mixture import resample

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PARTICLES = 1_000
_EFFECTIVE_SHARE = 0.5
_MOVES = 8
_LAST_MOVES = 60
_LONG_JUMPS = 0.1
"""Share of the moves that jump by a whole difference, from one mode to another."""
_JITTER = 1e-4
_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class _Particles:
    """Places w, their log-density under the prior (with its Jacobian) and the log-likelihood."""

    w: Array
    log_prior: Array
    log_likelihood: Array

    def taken(self, rows: Index) -> _Particles:
        """Some of them."""
        return _Particles(self.w[rows], self.log_prior[rows], self.log_likelihood[rows])


def tempered_particles(posterior: Posterior, *, seed: int, threads: int = 1) -> Array:
    """Particles that have the law of the posterior, but for how far the last moves mixed them.

    Parameters
    ----------
    posterior : Posterior
    seed : int
        The particles are a function of it.
    threads : int
        Halves of the particles evaluated at the same time; the result does not depend on it.

    Returns
    -------
    ndarray, shape (1000, n_free)
        Coordinates z.
    """
    rng = np.random.default_rng([seed, 12])
    straight = _Straight(posterior, threads)
    z = posterior.to_coordinates(posterior.sample_prior(rng, _PARTICLES))
    particles = straight.evaluate(straight.from_z(z))
    power = 0.0
    while power < 1.0:
        power, weights = _next_power(particles.log_likelihood, power)
        particles = particles.taken(rng.permutation(resample(weights, _PARTICLES, rng)))
        for _ in range(_LAST_MOVES if power == 1.0 else _MOVES):
            particles = _move(straight, particles, power, rng)
    return straight.to_z(particles.w)


def _next_power(log_likelihood: Array, power: float) -> tuple[float, Array]:
    """The next power, and the normalised weights of the particles on the way to it."""
    seen = np.where(np.isfinite(log_likelihood), log_likelihood, -np.inf)
    above = seen - seen.max()

    def weights(to: float) -> Array:
        found = np.exp((to - power) * above)
        return np.asarray(found / found.sum())

    def effective_share(to: float) -> float:
        return float(1.0 / np.sum(weights(to) ** 2) / above.size)

    low, high = power, 1.0
    if effective_share(high) < _EFFECTIVE_SHARE:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if effective_share(middle) >= _EFFECTIVE_SHARE else (low, middle)
            )
        high = max(low, np.nextafter(power, 1.0))
    return high, weights(high)


def _move(
    straight: _Straight, particles: _Particles, power: float, rng: np.random.Generator
) -> _Particles:
    """One step of differential evolution of each half, by differences of the other."""
    n, n_free = particles.w.shape
    order = rng.permutation(n)
    halves = order[: n // 2], order[n // 2 :]
    for own, other in (halves, halves[::-1]):
        first = rng.integers(0, other.size, own.size)
        second = (first + 1 + rng.integers(0, other.size - 1, own.size)) % other.size
        step = 2.38 / np.sqrt(2.0 * n_free) * np.exp(0.3 * rng.standard_normal(own.size))
        step = np.where(rng.random(own.size) < _LONG_JUMPS, 1.0, step)
        others = particles.w[other]
        jitter = _JITTER * others.std(axis=0) * rng.standard_normal((own.size, n_free))
        proposed = particles.w[own] + step[:, None] * (others[first] - others[second]) + jitter
        new = straight.evaluate(straight.folded(proposed))
        gain = new.log_prior - particles.log_prior[own]
        gain = gain + power * (new.log_likelihood - particles.log_likelihood[own])
        accepted = np.log(rng.random(own.size)) < np.where(np.isfinite(gain), gain, -np.inf)
        rows, chosen = own[accepted], new.taken(np.flatnonzero(accepted))
        w, log_prior, log_likelihood = (
            column.copy() for column in (particles.w, particles.log_prior, particles.log_likelihood)
        )
        w[rows], log_prior[rows] = chosen.w, chosen.log_prior
        log_likelihood[rows] = chosen.log_likelihood
        particles = _Particles(w, log_prior, log_likelihood)
    return particles


class _Straight:
    """Coordinates w of a posterior: those of z, but ln(sigma_N0 F(0)) in place of sigma_N0."""

    def __init__(self, posterior: Posterior, threads: int) -> None:
        free = [posterior.parameter_names[i] for i in posterior.free]
        self._posterior = posterior
        self._columns = [free.index(name) for name in ("n", "k", "sigma_n0") if name in free]
        self._bends = len(self._columns) == 3
        self._bounds = coordinate_bounds(posterior)
        self._threads = threads

    def _log_reflectance(self, w: Array) -> Array:
        """Ln F(0), the reflectance at normal incidence."""
        n, k = w[:, self._columns[0]], w[:, self._columns[1]]
        far = (n + 1.0) ** 2 + k * k
        return np.asarray(np.log(np.maximum((n - 1.0) ** 2 + k * k, 1e-300)) - np.log(far))

    def from_z(self, z: Array) -> Array:
        """Places w of places z."""
        w = z.copy()
        if self._bends:
            sigma = self._columns[2]
            w[:, sigma] = np.log(z[:, sigma]) + self._log_reflectance(z)
        return w

    def to_z(self, w: Array) -> Array:
        """Places z of places w."""
        z = w.copy()
        if self._bends:
            sigma = self._columns[2]
            z[:, sigma] = np.exp(np.minimum(w[:, sigma] - self._log_reflectance(w), 300.0))
        return z

    def folded(self, w: Array) -> Array:
        """Places reflected at the bounds of the prior, where they are beyond; not sigma_N0."""
        low, high = self._bounds
        folded = np.where(w < low, 2.0 * low - w, np.where(w > high, 2.0 * high - w, w))
        if self._bends:
            folded[:, self._columns[2]] = w[:, self._columns[2]]
        return np.asarray(folded)

    def evaluate(self, w: Array) -> _Particles:
        """Log-densities at places; -inf outside the support."""
        z = self.to_z(w)
        low, high = self._bounds
        inside = np.all((z >= low) & (z <= high), axis=1)
        log_prior, log_likelihood = np.full(len(w), -np.inf), np.full(len(w), -np.inf)
        x = self._posterior.from_coordinates(z[inside])
        jacobian = z[inside][:, self._posterior.is_log].sum(axis=1)
        if self._bends:
            jacobian = jacobian + np.log(z[inside, self._columns[2]])
        log_prior[inside] = self._posterior.log_prior(x) + jacobian
        possible = np.flatnonzero(np.isfinite(log_prior))
        x = self._posterior.from_coordinates(z[possible])
        with ThreadPoolExecutor(self._threads) as pool:
            parts = pool.map(self._posterior.log_likelihood, np.array_split(x, self._threads))
            found = np.concatenate(list(parts))
        log_likelihood[possible] = np.where(found < np.inf, found, -np.inf)
        return _Particles(w, log_prior, log_likelihood)
