"""The discrepancy of the model along theta_r: what the residuals say of it, and draws of it.

The process, its noise and the gains of the scans are those of `inference.likelihood.kalman`.
Angles where it is wanted join the rows as readings that are missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.inference.likelihood.groups import prepare_groups, set_variances, workspace
from pbrdf_bayes.inference.likelihood.kalman import group_gradient
from pbrdf_bayes.inference.likelihood.matern import MISSING, fill_steps
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Process(NamedTuple):
    """Law of the discrepancy and of the gains: amplitude [1], length [deg], u_cal [1]."""

    tau: float
    ell: float
    u_cal: float = 0.0
    rough: bool = False
    """Matérn 1/2 instead of 3/2."""


class Scanned(NamedTuple):
    """Residuals y - mean of rows and their variances; the rest as for `prepare_groups`."""

    theta_r_deg: Array
    group: Index
    scan: Index
    residual: Array
    variance: Array


def smooth_discrepancy(
    data: Scanned, process: Process, *, theta_r_deg: ArrayLike, group: ArrayLike
) -> tuple[Array, Array]:
    """Posterior mean and standard deviation of the discrepancy, the gains integrated out.

    Parameters
    ----------
    data : Scanned
    process : Process
    theta_r_deg, group : array_like, shape (n,)
        Where it is wanted; a group without readings has the prior.

    Returns
    -------
    tuple of ndarray, each of shape (n,)
        In units of the natural logarithm.

    Examples
    --------
    One reading of residual 0.1, its variance that of the process, shrinks by half:

    >>> one = Scanned(np.zeros(1), np.zeros(1, int), np.zeros(1, int), np.array([0.1]),
    ...     np.array([0.0025]))
    >>> mean, sd = smooth_discrepancy(one, Process(0.05, 20.0), theta_r_deg=[0, 500], group=[0, 0])
    >>> mean.round(6).tolist(), sd.round(6).tolist()
    ([0.05, 0.0], [0.035355, 0.05])
    """
    return smoother(data, process, theta_r_deg=theta_r_deg, group=group)(data.residual)


def smoother(
    data: Scanned, process: Process, *, theta_r_deg: ArrayLike, group: ArrayLike
) -> Callable[[Array], tuple[Array, Array]]:
    """`smooth_discrepancy` of the same rows for many residuals, as a function of them."""
    angle = np.asarray(theta_r_deg, dtype=np.float64)
    number = np.asarray(group, dtype=np.int64)
    n, wanted = data.residual.size, angle.size
    scan = np.zeros(wanted, dtype=np.int64)
    some = {int(g): int(s) for g, s in zip(data.group, data.scan, strict=True)}
    scan[:] = [some.get(g, 0) for g in number.tolist()]
    groups = prepare_groups(
        np.concatenate([data.theta_r_deg, angle]),
        np.concatenate([data.group, number]),
        np.concatenate([data.scan, scan]),
        rough=process.rough,
    )
    work = workspace(groups, True)
    set_variances(groups, work, np.concatenate([data.variance, np.full(wanted, MISSING)]))
    base = np.zeros(groups.size.size)

    def smooth(residual: Array) -> tuple[Array, Array]:
        out = np.empty((4, n + wanted))
        padded = np.concatenate([residual, np.zeros(wanted)])
        u_cal2, tau, ell = process.u_cal**2, process.tau, process.ell
        group_gradient(groups, work, padded, base, u_cal2, tau, ell, out)
        return out[2, n:], np.sqrt(np.maximum(out[3, n:], 0.0))

    return smooth


def draw_prior_discrepancy(
    process: Process, rng: np.random.Generator, *, theta_r_deg: ArrayLike, group: ArrayLike
) -> Array:
    """One draw of the process at angles of groups, shape (n,); rows of a group share its path."""
    angle = np.asarray(theta_r_deg, dtype=np.float64)
    number = np.asarray(group, dtype=np.int64)
    order = np.lexsort((angle, number))
    first = np.ones(angle.size, dtype=bool)
    first[1:] = np.diff(number[order]) != 0
    spacing = np.zeros(angle.size)
    spacing[1:] = np.where(first[1:], 0.0, np.diff(angle[order]))
    normal = rng.standard_normal((angle.size, 2))
    path = np.empty(angle.size)
    path[order] = _walk(spacing, first, process.rough, process.tau, process.ell, normal)
    return path


def draw_discrepancy(
    data: Scanned,
    process: Process,
    rng: np.random.Generator,
    *,
    theta_r_deg: ArrayLike,
    group: ArrayLike,
) -> Array:
    """One draw of the discrepancy given the residuals, shape (n,).

    A prior draw plus what its own simulated readings leave to explain (Matheron's rule: Journel and
    Huijbregts, Mining Geostatistics, 1978): exact, in linear time.
    """
    angle = np.asarray(theta_r_deg, dtype=np.float64)
    number = np.asarray(group, dtype=np.int64)
    n = data.residual.size
    path = draw_prior_discrepancy(
        process,
        rng,
        theta_r_deg=np.concatenate([data.theta_r_deg, angle]),
        group=np.concatenate([data.group, number]),
    )
    pairs = np.stack([data.group, data.scan], axis=1)
    scans, which = np.unique(pairs, axis=0, return_inverse=True)
    gain = process.u_cal * rng.standard_normal(len(scans))
    noise = np.sqrt(data.variance) * rng.standard_normal(n)
    simulated = path[:n] + gain[which.ravel()] + noise
    left = data._replace(residual=data.residual - simulated)
    mean, _ = smooth_discrepancy(left, process, theta_r_deg=angle, group=number)
    return np.asarray(path[n:] + mean)


@compiled()
def _walk(
    spacing: Array, first: Flags, rough: bool, tau: float, ell: float, normal: Array
) -> Array:
    """First component of the Markov chain of `pbrdf_bayes.inference.likelihood.matern`."""
    steps = np.empty((3, spacing.size))
    fill_steps(spacing, rough, tau, ell, steps)
    path = np.empty(spacing.size)
    x0, x1 = 0.0, 0.0
    for i in range(spacing.size):
        z0, z1 = normal[i, 0], normal[i, 1]
        if first[i]:
            x0, x1 = tau * z0, tau * z1
        else:
            e, b, q = steps[0, i], steps[1, i], steps[2, i]
            by0 = np.sqrt(q)
            by1 = 2.0 * tau * tau * b * b / by0 if by0 > 0.0 else 0.0
            rest = np.sqrt(max(q + 4.0 * tau * tau * e * b - by1 * by1, 0.0))
            x0, x1 = (e + b) * x0 + b * x1 + by0 * z0, (e - b) * x1 - b * x0 + by1 * z0 + rest * z1
        path[i] = x0
    return path
