"""Rows of BRDF scans in the order of a Kalman filter along theta_r.

A group holds the scans of one angle of incidence, plane and polarisation, whose discrepancy is one
and the same function of theta_r. Groups are filtered side by side, see
`inference.likelihood.matern`, whatever their angles: scans of a laboratory have gaps of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.inference.likelihood import matern
from pbrdf_bayes.inference.likelihood.matern import LANES, MISSING
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

_WIDTH = 4
"""Numbers that the processor works on at once."""


class Groups(NamedTuple):
    """Order of the rows in groups; everything that the parameters do not enter.

    Up to `LANES` groups of about equal length make a block, filtered side by side: ``start``
    delimits the points of the blocks and ``lanes`` counts their groups, rounded up. ``row``
    (n_points, LANES) is the reading of a lane there, -1 for none, and ``slot`` the place of each
    reading in that array flattened. ``transition`` is the row of ``step`` that leads to the next
    point, a row of ``step`` the distinct ``spacing`` [deg] of each lane; ``repeats`` marks points
    whose transition is that of the point before.
    """

    rough: bool
    """Matérn 1/2 instead of 3/2."""
    group: Index
    """Group of each lane of each block, -1 for none."""
    size: Index
    start: Index
    lanes: Index
    row: Index
    slot: Index
    template: Array
    transition: Index
    repeats: Flags
    spacing: Array
    step: Index
    shared: Flags
    n_scans: int
    """Most scans in a group."""


class Work(NamedTuple):
    """Arrays of an evaluation, allocated once for many; see `workspace`.

    ``sensitivities`` are those of `set_errors`, ``v`` and ``g`` what the likelihood finds of them;
    they follow the indicators of the scans in ``sequences``, ``products``, ``means`` and ``rho``.
    """

    readings: Array
    sensitivities: Array
    v: Array
    g: Array
    error_gain: Array
    points: Array
    varied: Flags
    """Per block: readings have variances of their own."""
    steps: Array
    moves: Array
    state: Array
    sequences: Array
    products: Array
    gain: Array
    root: Array
    precision: Array
    covariances: Array
    means: Array
    smoother: Array
    rho: Array


def prepare_groups(
    theta_r_deg: ArrayLike, group: ArrayLike, scan: ArrayLike, *, rough: bool = False
) -> Groups:
    """Put rows in the order of the filter.

    Parameters
    ----------
    theta_r_deg : array_like, shape (n_rows,)
        Angles [deg], in any order, repeated or not.
    group : array_like of int, shape (n_rows,)
        0, 1, ... for rows that share their discrepancy.
    scan : array_like of int, shape (n_rows,)
        Rows of a group with the same number share their gain.
    rough : bool
        Matérn 1/2 instead of 3/2.

    Returns
    -------
    Groups
    """
    angle = np.asarray(theta_r_deg, dtype=np.float64)
    groups, scans = np.asarray(group, dtype=np.int64), np.asarray(scan, dtype=np.int64)
    n_groups = int(groups.max(initial=-1)) + 1
    rows = [np.flatnonzero(groups == g) for g in range(n_groups)]
    rows = [r[np.argsort(angle[r], kind="stable")] for r in rows]
    columns = [np.unique(scans[r], return_inverse=True)[1] for r in rows]
    n_scans = [int(c.max(initial=0)) + 1 for c in columns]
    order = sorted(range(n_groups), key=lambda g: (-n_scans[g], -len(rows[g])))
    blocks = [order[i : i + LANES] for i in range(0, n_groups, LANES)]
    lengths = [max(len(rows[g]) for g in block) for block in blocks]
    start = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    width = (1 + max(n_scans, default=1)) * LANES
    template = np.zeros((int(start[-1]), width))
    template[:, matern.EXTRA : matern.EXTRA + LANES] = MISSING
    row = np.full((int(start[-1]), LANES), -1, dtype=np.int64)
    spacing = np.full(row.shape, np.nan)
    for block, first in zip(blocks, start, strict=False):
        for lane, g in enumerate(block):
            here = np.arange(first, first + len(rows[g]))
            row[here, lane] = rows[g]
            template[here, matern.EXTRA + lane] = 0.0
            template[here, matern.ONES + LANES * columns[g] + lane] = 1.0
            spacing[here[:-1], lane] = np.diff(angle[rows[g]])
    distinct, step = _number_steps(spacing)
    table, transition = np.unique(step, axis=0, return_inverse=True)
    transition = transition.ravel().astype(np.int64)
    slot = np.zeros(angle.size, dtype=np.int64)
    present = row >= 0
    slot[row[present]] = np.flatnonzero(present)
    names = np.full((len(blocks), LANES), -1, dtype=np.int64)
    for i, block in enumerate(blocks):
        names[i, : len(block)] = block
    return Groups(
        rough=rough,
        group=names,
        size=np.array([len(r) for r in rows], dtype=np.int64),
        start=start,
        lanes=np.array([-(-len(b) // _WIDTH) * _WIDTH for b in blocks], dtype=np.int64),
        row=row,
        slot=slot,
        template=template,
        transition=transition,
        repeats=_repeats(transition, present, start),
        spacing=distinct,
        step=np.ascontiguousarray(table),
        shared=(table == table[:, :1]).all(axis=1),
        n_scans=max(n_scans, default=1),
    )


def _number_steps(spacing: Array) -> tuple[Array, Index]:
    """Distinct spacings and their numbers; a lane without a next point takes any of its row.

    Spacings that agree to 1e-12 deg are one: those of a regular grid differ by rounding.
    """
    known = ~np.isnan(spacing)
    distinct, number = np.unique(np.round(spacing[known], 12), return_inverse=True)
    step = np.full(spacing.shape, -1, dtype=np.int64)
    step[known] = number.ravel()
    some = step.max(axis=1, initial=-1, keepdims=True)
    for k in np.flatnonzero(some[:, 0] < 0):  # the last point of a block
        some[k] = some[k - 1] if k else 0
    if not distinct.size:
        distinct = np.zeros(1)
    return distinct, np.where(step < 0, np.maximum(some, 0), step)


def _repeats(transition: Index, present: Flags, start: Index) -> Flags:
    """Points with the transition and the lanes of the point before, in the same block."""
    same = np.zeros(transition.size, dtype=bool)
    same[1:] = transition[1:] == transition[:-1]
    same[1:] &= (present[1:] == present[:-1]).all(axis=1)
    same[start[:-1]] = False
    return same


@compiled()
def workspace(groups: Groups, slopes: bool, n_errors: int = 0) -> Work:
    """Arrays for `group_log_likelihood`, or with ``slopes`` for `group_gradient` as well."""
    longest = 0
    for block in range(groups.lanes.size):
        longest = max(longest, groups.start[block + 1] - groups.start[block])
    kept = longest if slopes else 1
    n, m = groups.n_scans, n_errors
    return Work(
        np.zeros(groups.row.shape),
        np.zeros((groups.row.shape[0], m * LANES)),
        np.zeros(m),
        np.zeros((m, m)),
        np.empty((m, n, LANES)),
        groups.template.copy(),
        np.zeros(groups.lanes.size, dtype=np.bool_),
        np.empty((6 if slopes else 3, groups.spacing.size)),
        moves=np.empty((groups.step.shape[0], matern.N_TRANSITION)),
        state=np.empty(matern.N_FILTER),
        sequences=np.empty((n - 1 + m, matern.N_SEQUENCE)),
        products=np.empty((n + m, n + m, LANES)),
        gain=np.empty((n, LANES)),
        root=np.empty((n, n, LANES)),
        precision=np.empty((n, n)),
        covariances=np.empty((kept, matern.N_COVARIANCE)),
        means=np.empty((n + 1 + m, kept, matern.N_MEAN)),
        smoother=np.empty(matern.N_SMOOTHER),
        rho=np.empty((n + 1 + m, matern.N_SMOOTHED)),
    )


@compiled()
def set_variances(groups: Groups, work: Work, extra: Array) -> None:
    """Variances of the readings beyond that of their group: stated ones, that of a floor.

    Zero if never set. ``extra`` has shape (n_rows,); `MISSING` leaves a reading out.
    """
    for i in range(extra.size):
        k, lane = divmod(groups.slot[i], LANES)
        work.points[k, matern.EXTRA + lane] = extra[i]
    for block in range(groups.lanes.size):
        work.varied[block] = False
        for k in range(groups.start[block], groups.start[block + 1]):
            for lane in range(LANES):
                row = groups.row[k, lane]
                if row >= 0 and extra[row] != 0.0:
                    work.varied[block] = True


@compiled()
def set_errors(groups: Groups, work: Work, s: Array) -> None:
    """Sensitivities of rows to systematic errors, shape (n_errors, n_rows); zero if never set."""
    for j in range(s.shape[0]):
        for i in range(s.shape[1]):
            k, lane = divmod(groups.slot[i], LANES)
            work.sensitivities[k, LANES * j + lane] = s[j, i]
