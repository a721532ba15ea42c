"""The discrepancy of the model along theta_r: what the residuals say of it, and draws of it.

The process, its noise and the gains of the scans are those of `inference.likelihood.kalman`.
Angles where it is wanted join the rows as readings that are missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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


Smoother = Callable[[Array, Array, Process], tuple[Array, Array]]


def smoother(
    theta_r_deg: ArrayLike, group: ArrayLike, scan: ArrayLike, *, wanted_deg: ArrayLike,
    wanted_group: ArrayLike, rough: bool = False,
) -> Smoother:  # fmt: skip
    """What rows say of the discrepancy at wanted angles, as a function of their residuals.

    Parameters
    ----------
    theta_r_deg, group, scan : array_like, shape (n_rows,)
        Angles [deg] of the rows, and which share their discrepancy and their gain.
    wanted_deg, wanted_group : array_like, shape (n,)
        Where it is wanted; a group without rows has the prior.
    rough : bool
        Matérn 1/2 instead of 3/2.

    Returns
    -------
    callable
        Of residuals and variances (n_rows,) and a `Process`: posterior mean and standard deviation
        of the discrepancy, each of shape (n,), in ln BRDF, the gains integrated out.

    Examples
    --------
    One reading of residual 0.1, its variance that of the process, shrinks by half:

    >>> smooth = smoother([0.0], [0], [0], wanted_deg=[0, 500], wanted_group=[0, 0])
    >>> mean, sd = smooth(np.array([0.1]), np.array([0.0025]), Process(0.05, 20.0))
    >>> mean.round(6).tolist(), sd.round(6).tolist()
    ([0.05, 0.0], [0.035355, 0.05])
    """
    angle, number = np.asarray(wanted_deg, np.float64), np.asarray(wanted_group, np.int64)
    of_group, of_scan = np.asarray(group, np.int64), np.asarray(scan, np.int64)
    n, wanted = of_group.size, angle.size
    some = dict(zip(of_group.tolist(), of_scan.tolist(), strict=True))
    groups = prepare_groups(
        np.concatenate([np.asarray(theta_r_deg, np.float64), angle]),
        np.concatenate([of_group, number]),
        np.concatenate([of_scan, np.array([some.get(g, 0) for g in number.tolist()], np.int64)]),
        rough=rough,
    )
    work = workspace(groups, True)
    base, missing, nothing = np.zeros(groups.size.size), np.full(wanted, MISSING), np.zeros(wanted)

    def smooth(residual: Array, variance: Array, process: Process) -> tuple[Array, Array]:
        out = np.empty((4, n + wanted))
        set_variances(groups, work, np.concatenate([variance, missing]))
        group_gradient(
            groups, work, np.concatenate([residual, nothing]), base, process.u_cal**2,
            process.tau, process.ell, out,
        )  # fmt: skip
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


def draw_paths_given(
    processes: Sequence[Process], rngs: Iterable[np.random.Generator], *, read_deg: Array,
    scan: Index, residual: Array, variance: Array, wanted_deg: Array,
) -> Array:  # fmt: skip
    """Draws of the discrepancy of one group of scans, given their residuals.

    Parameters
    ----------
    processes : sequence of Process, length n_draws
        All of one roughness.
    rngs : iterable of numpy.random.Generator
        One for each draw; the same one again and again will do.
    read_deg : ndarray, shape (n_rows,)
        Scattering angles of the readings [deg].
    scan : ndarray of int, shape (n_rows,)
        Scan of each reading: its gain is integrated out.
    residual, variance : ndarray, shape (n_draws, n_rows)
        ln reading - ln model, and its white variance.
    wanted_deg : ndarray, shape (n,)
        Where the paths are wanted [deg].

    Returns
    -------
    ndarray, shape (n_draws, n)
        In ln BRDF. Matheron's rule: a path of the process plus what its own simulated readings
        leave to explain of the residuals (Journel and Huijbregts, Mining Geostatistics, 1978).
    """
    n_read = read_deg.size
    angle = np.concatenate([read_deg, wanted_deg])
    zeros = np.zeros(angle.size, dtype=np.int64)
    _, number = np.unique(scan, return_inverse=True)
    smooth = smoother(
        read_deg, zeros[:n_read], number, wanted_deg=wanted_deg, wanted_group=zeros[n_read:],
        rough=processes[0].rough,
    )  # fmt: skip
    paths = np.empty((len(processes), wanted_deg.size))
    for i, (process, rng) in enumerate(zip(processes, rngs, strict=False)):
        path = draw_prior_discrepancy(process, rng, theta_r_deg=angle, group=zeros)
        gain = process.u_cal * rng.standard_normal(int(number.max()) + 1)
        noise = np.sqrt(variance[i]) * rng.standard_normal(n_read)
        left = residual[i] - path[:n_read] - gain[number] - noise
        paths[i] = path[n_read:] + smooth(left, variance[i], process)[0]
    return paths


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
