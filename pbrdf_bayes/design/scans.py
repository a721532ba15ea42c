"""The law of the readings of a BRDF scan that could be taken, and draws of them.

A scan at a geometry that was measured, or within `ALIKE_DEG` of it, shares the discrepancy of the
model with the readings there: its law is that of both together over that of the old ones,

    p(new | x, data) = p(old, new | x) / p(old | x),

so that a repeat of what is known well tells nothing new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets
from pbrdf_bayes.design.candidates import Candidate, scans_alike
from pbrdf_bayes.design.pairs import matched_log_likelihoods, pair_log_likelihoods
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.discrepancy import (
    Process,
    draw_paths_given,
    draw_prior_discrepancy,
)
from pbrdf_bayes.measurement import Scan
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.readings.observation import Law, draw_readings, reading_law

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PlannedScan:
    """The rows of a scan, together with those measured at its geometry or close to it.

    Attributes
    ----------
    polarization : str
    geometry : Geometry
        Of the rows in the order of theta_r.
    theta_r_deg : ndarray, shape (n_rows,)
    scan : ndarray of int, shape (n_rows,)
        Scan of a row; that of new rows is the last one.
    new : ndarray of bool, shape (n_rows,)
    y : ndarray, shape (n_rows,)
        ln of the readings that there are.
    key : tuple of int
        `Candidate.geometry`.
    """

    polarization: str
    geometry: Geometry
    theta_r_deg: Array
    scan: Index
    new: NDArray[np.bool_]
    y: Array
    key: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class RowLaw:
    """Law of the rows of a scan under parameter sets: arrays of shape (n_sets, n_rows)."""

    mean: Array
    share: Array
    variance: Array
    sets: DrawnSets

    def with_noise_of(self, sets: DrawnSets, polarization: str) -> RowLaw:
        """The same curves with other noise: n of ``sets`` in turn for each curve."""
        n = len(sets) // len(self.sets)
        white = sets.variance[polarization] - np.repeat(self.sets.variance[polarization], n)
        mean, share, variance = (
            np.repeat(part, n, axis=0) for part in (self.mean, self.share, self.variance)
        )
        return RowLaw(mean, share, variance + white[:, None], sets)

    def of(self, rows: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Mean, share and variance of some rows, as the kernels take them."""
        if rows.all():
            return self.mean, self.share, self.variance
        return (
            np.ascontiguousarray(self.mean[:, rows]), np.ascontiguousarray(self.share[:, rows]),
            np.ascontiguousarray(self.variance[:, rows]),
        )  # fmt: skip


def plan_scan(beliefs: Beliefs, candidate: Candidate, bright: NDArray[np.bool_]) -> PlannedScan:
    """Put the rows of a candidate and those that it repeats in order.

    Parameters
    ----------
    beliefs : Beliefs
    candidate : Candidate
    bright : ndarray of bool, shape (n_readings,)
        Readings expected above the floor: only these count.

    Returns
    -------
    PlannedScan
    """
    p = beliefs.posterior
    theta_r = np.array(candidate.theta_r_deg)[bright]
    old = _measured_there(p, candidate) if beliefs.measured else ()
    rows = [np.arange(s.start, s.stop) for s in old]
    rows = [r[~p.rows.censored[r]] for r in rows]
    angles = np.concatenate([*(p.measurement.brdf.theta_r_deg[r] for r in rows), theta_r])
    theta_i = [*(s.theta_i_deg for s in old), candidate.theta_i_deg]
    y = np.concatenate([*(p.rows.y[r] for r in rows), np.zeros(theta_r.size)])
    lengths = [*(r.size for r in rows), theta_r.size]
    scan = np.repeat(np.arange(len(lengths)), lengths)
    order = np.argsort(angles, kind="stable")
    return PlannedScan(
        polarization=candidate.polarization,
        geometry=scan_geometry(
            np.repeat(theta_i, lengths)[order], angles[order], candidate.polarization
        ),
        theta_r_deg=angles[order],
        scan=scan[order],
        new=scan[order] == len(lengths) - 1,
        y=y[order],
        key=candidate.geometry,
    )


def scan_geometry(theta_i_deg: float | Array, theta_r_deg: Array, polarization: str) -> Geometry:
    """Geometry of rows in the plane of incidence, of one polarisation."""
    n = theta_r_deg.size
    return prepare_geometry(
        theta_i=np.full(n, np.deg2rad(theta_i_deg)), theta_r=np.deg2rad(theta_r_deg),
        phi_r=np.zeros(n), polarization=np.full(n, polarization),
        dhr_theta_i=np.zeros(0), dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip


def measured_rows(posterior: Posterior, scans: Sequence[Scan]) -> PlannedScan:
    """Scans of one geometry that were measured, as if they were still to be."""
    m, first = posterior.measurement, scans[0]
    rows = [np.arange(s.start, s.stop) for s in scans]
    rows = [r[~posterior.rows.censored[r]] for r in rows]
    every = np.concatenate(rows)
    order = every[np.argsort(m.brdf.theta_r_deg[every], kind="stable")]
    of_row = dict(zip(every.tolist(), np.repeat(range(len(rows)), [r.size for r in rows]),
                      strict=True))  # fmt: skip
    theta_r, n = m.brdf.theta_r_deg[order], order.size
    geometry = prepare_geometry(
        theta_i=np.full(n, np.deg2rad(first.theta_i_deg)), theta_r=np.deg2rad(theta_r),
        phi_r=np.full(n, np.deg2rad(first.phi_r_deg)),
        polarization=np.full(n, first.polarization),
        dhr_theta_i=np.zeros(0), dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip
    return PlannedScan(
        polarization=first.polarization, geometry=geometry, theta_r_deg=theta_r,
        scan=np.array([of_row[row] for row in order.tolist()], dtype=np.int64),
        new=np.ones(n, dtype=bool), y=posterior.rows.y[order], key=(),
    )  # fmt: skip


def _measured_there(posterior: Posterior, candidate: Candidate) -> tuple[Scan, ...]:
    """Scans of the same discrepancy; without one, repeats tell nothing of each other."""
    if posterior.discrepancy is None:
        return ()
    return scans_alike(candidate, posterior.measurement)


def law_of_rows(beliefs: Beliefs, planned: PlannedScan, sets: DrawnSets, brdf: Array) -> RowLaw:
    """Law of the rows where the model gives ``brdf``, shape (n_sets, n_rows) [sr^-1]."""
    white = sets.variance[planned.polarization][:, None]
    return RowLaw(*reading_law(brdf, beliefs.posterior.config.brdf_floor, white), sets)


def draw_scans(beliefs: Beliefs, planned: PlannedScan, law: RowLaw, *, seed: int) -> Array:
    """One scan for every parameter set, given what was measured at its geometry.

    Parameters
    ----------
    beliefs : Beliefs
    planned : PlannedScan
    law : RowLaw
        Of the sets that the scans are drawn from.
    seed : int
        Set i has a generator of its own at every geometry: given the parameters, noise,
        discrepancy and gain of scans of different geometries are independent, and a batch adds up
        their log-densities.

    Returns
    -------
    ndarray, shape (n_rows, n_sets)
        ln of the readings; old rows hold what was measured.
    """
    p = beliefs.posterior
    u_cal = float(np.sqrt(p.rows.u_cal2))
    new, theta_r = planned.new, planned.theta_r_deg
    n = int(new.sum())
    result = np.repeat(planned.y[:, None], len(law.sets), axis=1)
    rngs = [np.random.default_rng([seed, 22, *planned.key, i]) for i in range(len(law.sets))]
    noise = np.stack([rng.standard_normal(n) for rng in rngs])
    gain = u_cal * np.array([[rng.standard_normal()] for rng in rngs])
    processes = [
        Process(float(tau), float(ell), u_cal, rough=beliefs.rough)
        for tau, ell in zip(law.sets.tau, law.sets.ell_deg, strict=True)
    ]
    old = ~new
    if old.any():
        h = law.share[:, old]
        paths = draw_paths_given(
            processes, rngs, read_deg=theta_r[old], scan=planned.scan[old],
            residual=(planned.y[old] - law.mean[:, old]) / h,
            variance=law.variance[:, old] / h**2, wanted_deg=theta_r[new],
        )  # fmt: skip
    else:
        zeros = np.zeros(n, dtype=np.int64)
        paths = np.stack([
            draw_prior_discrepancy(process, rng, theta_r_deg=theta_r, group=zeros)
            for process, rng in zip(processes, rngs, strict=True)
        ])  # fmt: skip
    of_new = Law(law.mean[:, new], law.share[:, new], law.variance[:, new])
    result[new] = draw_readings(of_new, gain + paths, noise).T
    return result


def scan_log_likelihoods(
    beliefs: Beliefs, planned: PlannedScan, y: Array, law: RowLaw, *, matched: bool
) -> Array:
    """Log-density of drawn scans given the old readings, under parameter sets.

    Parameters
    ----------
    beliefs : Beliefs
    planned : PlannedScan
    y : ndarray, shape (n_rows, n_simulated)
    law : RowLaw
        Of n_sets sets.
    matched : bool
        The sets belong to the simulated scans one after the other, instead of all to all.

    Returns
    -------
    ndarray, shape (n_simulated, n_sets) or (n_simulated, n_sets / n_simulated)
    """
    p = beliefs.posterior
    u_cal2, sets = p.rows.u_cal2, law.sets
    kernel = matched_log_likelihoods if matched else pair_log_likelihoods
    every = np.ones(planned.new.size, dtype=bool)
    found = kernel(
        y, planned.theta_r_deg, planned.scan, *law.of(every), sets.tau, sets.ell_deg,
        beliefs.rough, u_cal2,
    )  # fmt: skip
    old = ~planned.new
    if old.any():
        alone = pair_log_likelihoods(
            np.ascontiguousarray(planned.y[old][:, None]), planned.theta_r_deg[old],
            planned.scan[old], *law.of(old), sets.tau, sets.ell_deg, beliefs.rough, u_cal2,
        )  # fmt: skip
        found = found - alone.reshape(-1, found.shape[1]) if matched else found - alone
    return np.asarray(found)
