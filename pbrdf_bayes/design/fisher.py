"""Tier 0: the information gain with everything linearised, averaged over draws.

    1/2 E[ ln det S_tt - ln det (S - S J' (R + J S J')^-1 J S)_tt ]

S is the covariance of all parameters in the coordinates z, tt its block of interest, J the slopes
of the mean of the readings and R their covariance, both at a draw: Chaloner and Verdinelli, Stat.
Sci. 10, 273 (1995), doi:10.1214/ss/1177009939, with nuisance. That the noise itself is learned from
its scatter is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.hemispherical import gain_law, hemispherical_values
from pbrdf_bayes.design.scans import PlannedScan, law_of_rows, measured_rows
from pbrdf_bayes.measurement import Scan
from pbrdf_bayes.readings.observation import reading_law

Array = NDArray[np.float64]

_STEP = 1e-4
_PRIOR_STEP = 0.05
"""Of slopes of the model and of bends of the prior, in standard deviations of the draws."""


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
    """J' R^-1 J of a scan in the coordinates of the model, shape (n_sets, n_model, n_model).

    Parameters
    ----------
    brdf, moved : ndarray
        The model at the rows under ``sets`` and under `moved_sets` [sr^-1].
    steps : ndarray, shape (n_model,)
    """
    p = beliefs.posterior
    law = law_of_rows(beliefs, planned, sets, brdf)
    slopes = slopes_of(reading_law(moved, p.config.brdf_floor).mean, steps)
    gap = np.abs(planned.theta_r_deg[:, None] - planned.theta_r_deg)
    same = planned.scan[:, None] == planned.scan
    new, old = planned.new, ~planned.new
    result = np.zeros((len(sets), steps.size, steps.size))
    for i in range(len(sets)):
        a = gap / sets.ell_deg[i] if beliefs.rough else np.sqrt(3.0) * gap / sets.ell_deg[i]
        shape = np.exp(-a) if beliefs.rough else (1.0 + a) * np.exp(-a)
        h = law.share[i]
        k = h[:, None] * (sets.tau[i] ** 2 * shape + p.rows.u_cal2 * same) * h
        k[np.diag_indices_from(k)] += law.variance[i]
        j, r = slopes[i][new], k[np.ix_(new, new)]
        if old.any():
            weight = np.linalg.solve(k[np.ix_(old, old)], k[np.ix_(old, new)])
            j, r = j - weight.T @ slopes[i][old], r - weight.T @ k[np.ix_(old, new)]
        result[i] = j.T @ np.linalg.solve(r, j)
    return result


@dataclass(frozen=True, eq=False)
class Told:
    """What a measurement tells at each of some sets, linearised: arrays over these.

    Attributes
    ----------
    precision : ndarray, shape (n_sets, n_model, n_model)
        J' R^-1 J, given what was measured so far; n_model coordinates of z.
    gain : tuple of ndarray, or None
        Of a DHR or DDR reading the slopes (n_sets, n_model), the value, the variance of its noise
        and the precision of the gain that it shares; None for a scan.
    polarization : str
    """

    precision: Array
    gain: tuple[Array, Array, Array, Array] | None = None
    polarization: str = ""


def hemispherical_told(
    beliefs: Beliefs, candidate: Candidate, sets: DrawnSets, moved: Array, steps: Array
) -> Told:
    """What a DHR or DDR reading tells."""
    p = beliefs.posterior
    q = candidate.polarization
    value, gain = hemispherical_values(p, candidate, sets.x), gain_law(beliefs, q, sets)
    n = len(moved) // len(sets)
    beside = gain_law(beliefs, q, replace(sets.take(np.tile(np.arange(len(sets)), n)), x=moved))
    mean = hemispherical_values(p, candidate, moved) * (1.0 + beside.mean)
    slope = slopes_of(mean[:, None], steps)[:, 0]
    alone = Told(np.zeros(0), (slope, value, sets.dhr_variance, gain.precision), q)
    return replace(alone, precision=told_together([alone]))


def told_together(told: Sequence[Told]) -> Array:
    """J' R^-1 J of measurements together, shape (n_sets, n_model, n_model).

    Readings of one polarisation share a gain: with R = diag(v) + u^2 D D',

        J' R^-1 J = sum J'J/v - b b'/(1/u^2 + sum D^2/v),   b = sum J' D/v.

    Scans of different geometries share nothing.
    """
    total: Array | float = sum((t.precision for t in told if t.gain is None), 0.0)
    for q in dict.fromkeys(t.polarization for t in told if t.gain is not None):
        here = [t.gain for t in told if t.gain is not None and t.polarization == q]
        at: Array | float = sum((d**2 / v for _, d, v, _ in here), here[0][3])
        b = np.sum([j * (d / v)[:, None] for j, d, v, _ in here], axis=0)
        each = [j[:, :, None] * j[:, None, :] / v[:, None, None] for j, _, v, _ in here]
        shared = b[:, :, None] * b[:, None, :] / np.asarray(at)[:, None, None]
        total = total + np.sum(each, axis=0) - shared
    return np.asarray(total)


def precision_so_far(beliefs: Beliefs, sets: DrawnSets, moved: Array, steps: Array) -> Array:
    """Of the coordinates of the model before the measurement, (n_sets, n_model, n_model).

    What the prior and the readings so far tell at each set, linearised there; along no direction
    less than the draws do, whose covariance knows of bounds and of bends.
    """
    p = beliefs.posterior
    found = _precision_of_prior(beliefs, sets)
    if beliefs.measured:
        for planned in _measured_scans(beliefs):
            brdf = p.predict(sets.x, planned.geometry)[0]
            found = found + scan_precisions(
                beliefs, planned, sets, brdf, p.predict(moved, planned.geometry)[0], steps
            )
        read = _measured_hemispherical(beliefs, sets, moved, steps)
        found = found + (told_together(read) if read else 0.0)
    root = np.linalg.cholesky(beliefs.covariance[np.ix_(p.of_model, p.of_model)])
    size, axes = np.linalg.eigh(root.T @ found @ root)
    back = np.linalg.solve(root.T, axes)
    return np.asarray((back * np.maximum(size, 1.0)[:, None, :]) @ np.swapaxes(back, 1, 2))


def _precision_of_prior(beliefs: Beliefs, sets: DrawnSets) -> Array:
    """Curvature of the prior along each coordinate of the model; 0 where it bends upwards."""
    p = beliefs.posterior
    z, sd = p.to_coordinates(sets.x), np.sqrt(np.diag(beliefs.covariance))

    def height(z: Array) -> Array:
        return np.asarray(p.log_prior(p.from_coordinates(z)) + z[:, p.is_log].sum(axis=1))

    found = np.zeros((len(sets), p.of_model.size, p.of_model.size))
    for i, column in enumerate(p.of_model):
        step = np.zeros(z.shape[1])
        step[column] = _PRIOR_STEP * sd[column]
        ends = height(z + step), height(z - step)
        inside = np.isfinite(ends[0]) & np.isfinite(ends[1])
        bend = (2.0 * height(z) - np.where(inside, ends[0] + ends[1], np.inf)) / step[column] ** 2
        found[:, i, i] = np.maximum(bend, 0.0)
    return found


def _measured_scans(beliefs: Beliefs) -> list[PlannedScan]:
    """Scans so far that share a discrepancy, each of these together."""
    p = beliefs.posterior
    alike: dict[object, list[Scan]] = {}
    for scan in p.measurement.scans:
        own = scan if p.discrepancy is None else None
        key = scan.theta_i_deg, scan.polarization, scan.phi_r_deg, own
        alike.setdefault(key, []).append(scan)
    return [planned for same in alike.values() if (planned := measured_rows(p, same)).y.size]


def _measured_hemispherical(
    beliefs: Beliefs, sets: DrawnSets, moved: Array, steps: Array
) -> list[Told]:
    """What each DHR reading so far tells, before its gain is shared."""
    p, dhr = beliefs.posterior, beliefs.posterior.measurement.dhr
    u2 = p.rows.dhr_cal2
    gain = np.full(len(sets), np.inf if u2 == 0.0 else 1.0 / u2)
    found = []
    for angle, q, stated in zip(dhr.theta_i_deg, dhr.polarization, p.rows.dhr_u2, strict=True):
        there = Candidate("dhr", str(q), float(angle), 1.0)
        slope = slopes_of(hemispherical_values(p, there, moved)[:, None], steps)[:, 0]
        v = np.where(stated >= 0.0, stated, sets.dhr_variance)
        value = hemispherical_values(p, there, sets.x)
        found.append(Told(np.zeros(0), (slope, value, v, gain), str(q)))
    return found
