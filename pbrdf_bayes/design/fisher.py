"""Tier 0: the information gain with everything linearised, averaged over draws.

    1/2 E[ ln det S_tt - ln det (S - S J' (R + J S J')^-1 J S)_tt ]

S is the covariance of all parameters in the coordinates z, tt its block of interest, J the slopes
of the mean of the readings and R their covariance, both at a draw: Chaloner and Verdinelli, Stat.
Sci. 10, 273 (1995), doi:10.1214/ss/1177009939, with nuisance. That the noise itself is learned from
its scatter is left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.hemispherical import gain_law, hemispherical_values
from pbrdf_bayes.design.scans import PlannedScan, law_of_rows

Array = NDArray[np.float64]

_STEP = 1e-4


def linear_gain(covariance: Array, precisions: Array, about: NDArray[np.int64]) -> Array:
    """Information gain of linear measurements about some parameters, shape (n_draws,) [nat].

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        S, of all parameters.
    precisions : ndarray, shape (n_draws, n, n)
        J' R^-1 J.
    about : ndarray of int
        Parameters of interest.

    Examples
    --------
    One parameter of variance 1, read with variance 1, tells half of ln 2:

    >>> one = np.ones((1, 1))
    >>> print(linear_gain(one, one[None], np.array([0])).round(4))
    [0.3466]
    """
    root = np.linalg.cholesky(covariance)
    n = len(covariance)
    inside = np.eye(n) + root.T @ precisions @ root
    after = root @ np.linalg.solve(inside, np.broadcast_to(root.T, inside.shape))
    block = np.ix_(about, about)
    before = np.linalg.slogdet(covariance[block])[1]
    return np.asarray(0.5 * (before - np.linalg.slogdet(after[:, about[:, None], about])[1]))


def moved_sets(beliefs: Beliefs, x: Array) -> tuple[Array, Array]:
    """Sets with each model coordinate moved down and up, and the coordinates' steps.

    Returns
    -------
    tuple of ndarray
        Sets of shape (2 * n_model * n_sets, n_par), downs first; steps (n_model,) in z.
    """
    p = beliefs.posterior
    z = p.to_coordinates(x)
    sd = np.sqrt(np.diag(beliefs.covariance))
    moved = []
    for sign in (-1.0, 1.0):
        for column in p.of_model:
            there = z.copy()
            there[:, column] += sign * _STEP * sd[column]
            moved.append(p.from_coordinates(there))
    steps = [_STEP * sd[column] for column in p.of_model]
    return np.concatenate(moved), np.array(steps)


def slopes_of(values: Array, steps: Array) -> Array:
    """Central differences, shape (n_sets, n_values, n_model), of values at `moved_sets`."""
    n_model = steps.size
    parts = values.reshape(2, n_model, -1, values.shape[1])
    return np.moveaxis((parts[1] - parts[0]) / (2.0 * steps[:, None, None]), 0, -1)


def scan_precisions(
    beliefs: Beliefs, planned: PlannedScan, sets: DrawnSets, brdf: Array, moved: Array, steps: Array
) -> Array:
    """J' R^-1 J of a scan in all coordinates, shape (n_sets, n_free, n_free).

    Parameters
    ----------
    brdf, moved : ndarray
        The model at the rows under ``sets`` and under `moved_sets` [sr^-1].
    steps : ndarray, shape (n_model,)
    """
    p = beliefs.posterior
    law = law_of_rows(beliefs, planned, sets, brdf)
    floor2 = p.rows.floor2
    log_moved = 0.5 * np.log(np.maximum(moved, 1e-280) ** 2 + floor2)
    slopes = slopes_of(log_moved, steps)
    gap = np.abs(planned.theta_r_deg[:, None] - planned.theta_r_deg)
    same = planned.scan[:, None] == planned.scan
    new, old = planned.new, ~planned.new
    rough = p.discrepancy is not None and p.discrepancy.groups.rough
    result = np.zeros((len(sets), len(p.free), len(p.free)))
    block = np.ix_(p.of_model, p.of_model)
    for i in range(len(sets)):
        a = gap / sets.ell_deg[i] if rough else np.sqrt(3.0) * gap / sets.ell_deg[i]
        shape = np.exp(-a) if rough else (1.0 + a) * np.exp(-a)
        h = law.share[i]
        k = h[:, None] * (sets.tau[i] ** 2 * shape + p.rows.u_cal2 * same) * h
        k[np.diag_indices_from(k)] += law.variance[i]
        j, r = slopes[i][new], k[np.ix_(new, new)]
        if old.any():
            weight = np.linalg.solve(k[np.ix_(old, old)], k[np.ix_(old, new)])
            j, r = j - weight.T @ slopes[i][old], r - weight.T @ k[np.ix_(old, new)]
        result[i][block] = j.T @ np.linalg.solve(r, j)
    return result


def hemispherical_precisions(
    beliefs: Beliefs, candidate: Candidate, sets: DrawnSets, moved: Array, steps: Array
) -> Array:
    """J' R^-1 J of a DHR or DDR reading, shape (n_sets, n_free, n_free)."""
    p = beliefs.posterior
    q = candidate.polarization
    value, gain = hemispherical_values(p, candidate, sets.x), gain_law(beliefs, q, sets)
    n = len(moved) // len(sets)
    beside = gain_law(beliefs, q, replace(sets.take(np.tile(np.arange(len(sets)), n)), x=moved))
    mean = hemispherical_values(p, candidate, moved) * (1.0 + beside.mean)
    slope = slopes_of(mean[:, None], steps)[:, 0]
    variance = sets.dhr_variance + value**2 / gain.precision
    result = np.zeros((len(sets), len(p.free), len(p.free)))
    result[:, p.of_model[:, None], p.of_model] = (
        slope[:, :, None] * slope[:, None, :] / variance[:, None, None]
    )
    return result
