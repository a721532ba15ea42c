"""Paths of the discrepancy given the readings, one for each of many draws of the parameters.

What `inference.prediction.discrepancy.draw_discrepancy` does for one draw: the rows are put in
order once, and only amplitude, length, noise and residuals change from draw to draw.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.groups import prepare_groups, set_variances, workspace
from pbrdf_bayes.inference.likelihood.kalman import group_gradient
from pbrdf_bayes.inference.likelihood.matern import MISSING
from pbrdf_bayes.inference.prediction.discrepancy import Process, draw_prior_discrepancy

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    n_read, n = read_deg.size, wanted_deg.size
    angle = np.concatenate([read_deg, wanted_deg])
    group = np.zeros(angle.size, dtype=np.int64)
    _, number = np.unique(scan, return_inverse=True)
    of_wanted = np.zeros(n, dtype=np.int64)
    groups = prepare_groups(
        angle, group, np.concatenate([number, of_wanted]), rough=processes[0].rough
    )
    work = workspace(groups, True)
    base, out = np.zeros(groups.size.size), np.empty((4, angle.size))
    padded, missing = np.zeros(angle.size), np.full(n, MISSING)
    paths = np.empty((len(processes), n))
    for i, (process, rng) in enumerate(zip(processes, rngs, strict=False)):
        path = draw_prior_discrepancy(process, rng, theta_r_deg=angle, group=group)
        gain = process.u_cal * rng.standard_normal(int(number.max()) + 1)
        noise = np.sqrt(variance[i]) * rng.standard_normal(n_read)
        padded[:n_read] = residual[i] - path[:n_read] - gain[number] - noise
        set_variances(groups, work, np.concatenate([variance[i], missing]))
        group_gradient(groups, work, padded, base, process.u_cal**2, process.tau, process.ell, out)
        paths[i] = path[n_read:] + out[2, n_read:]
    return paths
