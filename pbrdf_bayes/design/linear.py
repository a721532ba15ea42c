"""The screening estimate: information with everything linear about each of some draws.

What is known at the paint o after a measurement is taken for normal, with the covariance

    C_o = ( P_o + J_o' R_o^-1 J_o )^-1,

P_o what the prior and the readings so far tell there, J_o the slopes of the candidate's readings
and R_o their covariance with noise, discrepancy and gain. The block tt of interest of C_o has the
nuisance marginalised; what readings tell of their own noise is left out. The expected information

    1/2 E_o [ ln det (P_o^-1)_tt - ln det C_tt,o ]

screens all candidates, and by the same determinants batches and pairs are chosen. Where a
measurement tells so much that next to no draw explains a simulated reading, it stands in for the
nested estimate: what is left is narrow then, and the model as good as linear within it. The level
comes from the entropy of the draws, which need not be normal. That is too much
information where what is left is not yet narrow: after few data by up to a nat or two.

Chaloner and Verdinelli, Stat. Sci. 10, 273 (1995), doi:10.1214/ss/1177009939, with nuisance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import digamma, gammaln

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.hemispherical import gain_law, hemispherical_values
from pbrdf_bayes.design.nested import LOCAL, Gain, Spread
from pbrdf_bayes.design.scans import (
    PlannedScan,
    law_of_rows,
    measured_rows,
    plan_scan,
    scan_geometry,
)
from pbrdf_bayes.measurement import Scan
from pbrdf_bayes.readings.observation import reading_law

Array = NDArray[np.float64]

_STEP = 1e-4
_PRIOR_STEP = 0.05
"""Of slopes of the model and of bends of the prior, in standard deviations of the draws."""
_NEIGHBOUR = 5


@dataclass(frozen=True, eq=False)
class Paints:
    """Draws about which everything is linear.

    Attributes
    ----------
    beliefs : Beliefs
    sets : DrawnSets
    moved : ndarray, shape (2 * n_model * n_sets, n_par)
        The sets with each coordinate of the model moved down and up, downs first.
    steps : ndarray, shape (n_model,)
        Of these, in z.
    """

    beliefs: Beliefs
    sets: DrawnSets
    moved: Array
    steps: Array

    def slopes(self, values: Array) -> Array:
        """Slopes (n_sets, n_values, n_model) of ``values`` at the moved sets, (n, n_values)."""
        parts = values.reshape(2, self.steps.size, -1, values.shape[1])
        return np.moveaxis((parts[1] - parts[0]) / (2.0 * self.steps[:, None, None]), 0, -1)

    def __len__(self) -> int:
        return len(self.sets)


def paints_of(beliefs: Beliefs, sets: DrawnSets) -> Paints:
    """The parameter sets, and the sets at which their slopes were taken."""
    p = beliefs.posterior
    z = p.to_coordinates(sets.x)
    sd = np.sqrt(np.diag(beliefs.covariance))
    moved = []
    for sign in (-1.0, 1.0):
        for column in p.of_model:
            there = z.copy()
            there[:, column] += sign * _STEP * sd[column]
            moved.append(p.from_coordinates(there))
    return Paints(beliefs, sets, np.concatenate(moved), _STEP * sd[p.of_model])


@dataclass(frozen=True, eq=False)
class Told:
    """What a measurement tells at each of some paints, linearised: arrays over these.

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


def told_by_scan(paints: Paints, candidate: Candidate) -> Told:
    """What the readings of a scan tell that are expected above the floor."""
    bright = bright_readings(paints, candidate)
    if not bright.any():
        return Told(np.zeros((len(paints), paints.steps.size, paints.steps.size)))
    return Told(_scan_precisions(paints, plan_scan(paints.beliefs, candidate, bright)))


def bright_readings(paints: Paints, candidate: Candidate) -> NDArray[np.bool_]:
    """Readings of a scan expected above the instrument's floor."""
    angles = np.array(candidate.theta_r_deg)
    p = paints.beliefs.posterior
    floor = p.config.brdf_floor
    if floor == 0.0:
        return np.ones(angles.size, dtype=bool)
    there = scan_geometry(candidate.theta_i_deg, angles, candidate.polarization)
    brdf = np.median(p.predict(paints.sets.x, there)[0], axis=0)
    return np.asarray(reading_law(brdf, floor).share > 0.5)


def _scan_precisions(paints: Paints, planned: PlannedScan) -> Array:
    """J' R^-1 J of a scan in the coordinates of the model, shape (n_sets, n_model, n_model)."""
    b, sets, p = paints.beliefs, paints.sets, paints.beliefs.posterior
    law = law_of_rows(b, planned, sets, p.predict(sets.x, planned.geometry)[0])
    moved = p.predict(paints.moved, planned.geometry)[0]
    slopes = paints.slopes(reading_law(moved, p.config.brdf_floor).mean)
    gap = np.abs(planned.theta_r_deg[:, None] - planned.theta_r_deg)
    same = planned.scan[:, None] == planned.scan
    new, old = planned.new, ~planned.new
    result = np.zeros((len(sets), paints.steps.size, paints.steps.size))
    for i in range(len(sets)):
        a = gap / sets.ell_deg[i] if b.rough else np.sqrt(3.0) * gap / sets.ell_deg[i]
        shape = np.exp(-a) if b.rough else (1.0 + a) * np.exp(-a)
        h = law.share[i]
        k = h[:, None] * (sets.tau[i] ** 2 * shape + p.rows.u_cal2 * same) * h
        k[np.diag_indices_from(k)] += law.variance[i]
        j, r = slopes[i][new], k[np.ix_(new, new)]
        if old.any():
            weight = np.linalg.solve(k[np.ix_(old, old)], k[np.ix_(old, new)])
            j, r = j - weight.T @ slopes[i][old], r - weight.T @ k[np.ix_(old, new)]
        result[i] = j.T @ np.linalg.solve(r, j)
    return result


def told_by_hemisphere(paints: Paints, candidate: Candidate) -> Told:
    """What a DHR or DDR reading tells."""
    b, sets, q = paints.beliefs, paints.sets, candidate.polarization
    value, gain = hemispherical_values(b.posterior, candidate, sets.x), gain_law(b, q, sets)
    every = sets.take(np.tile(np.arange(len(sets)), len(paints.moved) // len(sets)))
    beside = gain_law(b, q, replace(every, x=paints.moved))
    mean = hemispherical_values(b.posterior, candidate, paints.moved) * (1.0 + beside.mean)
    slope = paints.slopes(mean[:, None])[:, 0]
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


@dataclass(frozen=True, eq=False)
class LinearLaw:
    """What is known at each of some paints, as a normal law there.

    Attributes
    ----------
    before : ndarray, shape (n_paints, n_model, n_model)
        Precision of the coordinates of the model.
    about : ndarray of int
        Columns of these that the information is about.
    level, level_se : float
        Entropy of the draws less that of the law before any measurement, in the mean [nat].
    """

    before: Array
    about: NDArray[np.int64]
    level: float = 0.0
    level_se: float = 0.0

    def covariance(self, told: Sequence[Told]) -> Array:
        """After measurements taken together, shape (n_paints, n_model, n_model)."""
        return np.asarray(np.linalg.inv(self.before + told_together(told)))

    def gain(self, told: Sequence[Told], so_far: Sequence[Told] = ()) -> Array:
        """Information that measurements add to those so far, shape (n_paints,) [nat]."""
        return 0.5 * (self._log_det(so_far) - self._log_det([*so_far, *told]))

    def _log_det(self, told: Sequence[Told]) -> Array:
        """Of the covariance of what the information is about."""
        inside = self.covariance(told)[:, self.about[:, None], self.about]
        return np.asarray(np.linalg.slogdet(inside)[1])


def linear_law(paints: Paints) -> LinearLaw:
    """The law before the measurement.

    Noises that the information is about are as known after it as before: no mean tells them.
    """
    b, p = paints.beliefs, paints.beliefs.posterior
    of_model = p.of_model.tolist()
    inside = [c for c in b.columns_about.tolist() if c in of_model]
    about = np.array([of_model.index(c) for c in inside], dtype=np.int64)
    law = LinearLaw(_precision_so_far(paints), about)
    entropy, se = entropy_of_draws(p.to_coordinates(b.x)[:, inside])
    own = 0.5 * (law._log_det([]) + about.size * np.log(2.0 * np.pi * np.e))
    return replace(law, level=entropy - float(own.mean()), level_se=se)


def entropy_of_draws(z: Array) -> tuple[float, float]:
    """Differential entropy of a law from draws of it, and its standard error [nat].

    A draw that is there several times, as after resampling, has so much more weight.

    By the distances to near neighbours: Kozachenko and Leonenko, Probl. Inf. Transm. 23, 95 (1987).

    Parameters
    ----------
    z : ndarray, shape (n_draws, n)

    Examples
    --------
    A normal law of standard deviation 2 has ln(2 sqrt(2 pi e)) = 2.112:

    >>> value, se = entropy_of_draws(2.0 * np.random.default_rng(1).standard_normal((4000, 1)))
    >>> abs(value - 2.112) < 3.0 * se < 0.1
    True
    """
    points, counts = np.unique(z, axis=0, return_counts=True)
    weights, n = counts / counts.sum(), points.shape[1]
    root = np.linalg.cholesky(np.atleast_2d(np.cov(z, rowvar=False)))
    white = np.linalg.solve(root, points.T).T
    distance, near = map(np.asarray, cKDTree(white).query(white, list(range(1, _NEIGHBOUR + 2))))
    inside = weights[near[:, 1:]].sum(axis=1) / (1.0 - weights)
    ball = 0.5 * n * np.log(np.pi) - gammaln(0.5 * n + 1.0) + np.log(np.diag(root)).sum()
    level = np.log(_NEIGHBOUR) - digamma(_NEIGHBOUR) + ball
    terms = n * np.log(distance[:, -1]) - np.log(inside) + level
    entropy = float(weights @ terms)
    return entropy, float(np.sqrt(np.sum((weights * (terms - entropy)) ** 2)))


def stand_in(law: LinearLaw, told: Told, within: Gain) -> Gain:
    """Gain by the linear law within the bracket of the nested estimate."""
    terms = law.level + law.gain([told])
    eig = float(np.clip(terms.mean(), within.low, max(within.low, within.high)))
    se = np.hypot(terms.std(ddof=1) / np.sqrt(terms.size), law.level_se)
    return replace(
        within, eig=eig, se=float(se), terms=terms - terms.mean() + eig, inner=None, method=LOCAL
    )


def linear_spread(law: LinearLaw, told: Told, slopes: Array, variance: Array) -> Spread:
    """Variance of quantities after the measurement over that before it.

    What no mean tells, such as a noise, stays as it is. Where a slope would have more variance than
    the draws, as that of ln f at a Brewster null, what is left is that of the draws.

    Parameters
    ----------
    law : LinearLaw
    told : Told
    slopes : ndarray, shape (n_paints, n_quantities, n_model)
        Of the quantities at the paints.
    variance : ndarray, shape (n_quantities,)
        Of the draws, before the measurement.
    """
    after = np.einsum("npi,nij,npj->np", slopes, law.covariance([told]), slopes)
    known = variance > 0.0
    terms = np.minimum(after / np.where(known, variance, 1.0), 1.0)
    terms[:, ~known | ~np.any(slopes != 0.0, axis=(0, 2))] = 1.0
    return Spread(terms, np.zeros((1, terms.shape[1])))


def _precision_so_far(paints: Paints) -> Array:
    """Of the coordinates of the model before the measurement, (n_sets, n_model, n_model).

    What the prior and the readings so far tell at each set, linearised there; along no direction
    less than the draws do, whose covariance knows of bounds and of bends.
    """
    b, p = paints.beliefs, paints.beliefs.posterior
    found = _precision_of_prior(paints)
    if b.measured:
        for planned in _measured_scans(b):
            found = found + _scan_precisions(paints, planned)
        read = _measured_hemispherical(paints)
        found = found + (told_together(read) if read else 0.0)
    root = np.linalg.cholesky(b.covariance[np.ix_(p.of_model, p.of_model)])
    size, axes = np.linalg.eigh(root.T @ found @ root)
    back = np.linalg.solve(root.T, axes)
    return np.asarray((back * np.maximum(size, 1.0)[:, None, :]) @ np.swapaxes(back, 1, 2))


def _precision_of_prior(paints: Paints) -> Array:
    """Curvature of the prior along each coordinate of the model; 0 where it bends upwards."""
    p, sd = paints.beliefs.posterior, np.sqrt(np.diag(paints.beliefs.covariance))
    z = p.to_coordinates(paints.sets.x)

    def height(z: Array) -> Array:
        return np.asarray(p.log_prior(p.from_coordinates(z)) + z[:, p.is_log].sum(axis=1))

    found = np.zeros((len(z), p.of_model.size, p.of_model.size))
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


def _measured_hemispherical(paints: Paints) -> list[Told]:
    """What each DHR reading so far tells, before its gain is shared."""
    p, sets = paints.beliefs.posterior, paints.sets
    dhr, u2 = p.measurement.dhr, p.rows.dhr_cal2
    gain = np.full(len(sets), np.inf if u2 == 0.0 else 1.0 / u2)
    found = []
    for angle, q, stated in zip(dhr.theta_i_deg, dhr.polarization, p.rows.dhr_u2, strict=True):
        there = Candidate("dhr", str(q), float(angle), 1.0)
        slope = paints.slopes(hemispherical_values(p, there, paints.moved)[:, None])[:, 0]
        v = np.where(stated >= 0.0, stated, sets.dhr_variance)
        value = hemispherical_values(p, there, sets.x)
        found.append(Told(np.zeros(0), (slope, value, v, gain), str(q)))
    return found
