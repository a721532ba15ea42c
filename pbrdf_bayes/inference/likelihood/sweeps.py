"""Rows of BRDF scans in the order of the assumed-density filter, and its arrays.

See `pbrdf_bayes.inference.likelihood.assumed_density`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.inference.likelihood.row_evidence import N_OUT, Mixture
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

FIRST_GAIN = 4
"""State index of the first gain."""


class Sweep(NamedTuple):
    """Order of the filter over the rows of groups; everything that the parameters do not enter.

    ``start`` delimits the steps of each group and ``turn`` is the step at which it returns to the
    angle of its first (its end if it does not). Each step has its reading ``row``, the way
    ``spacing`` [deg] to it and the state index ``gain`` of its scan's gain. ``scan`` is the number
    of each gain of a group, shape (n_groups, n_gains), -1 for none.
    """

    rough: bool
    """Matérn 1/2 instead of 3/2."""
    group: Index
    """Number of each group that is swept."""
    start: Index
    turn: Index
    row: Index
    spacing: Array
    gain: Index
    scan: Index
    mixture: Mixture


class Tape(NamedTuple):
    """Arrays of a sweep, allocated once for many; what the adjoint sweep needs of every step.

    ``sensitivities`` (n_errors, n_rows) are those of the rows to systematic errors, zero if never
    filled; ``v`` and ``g`` are what the log-likelihood finds of them, without slopes only.
    """

    sensitivities: Array
    v: Array
    g: Array
    error_mean: Array
    error_innovation: Array
    steps: Array
    mean: Array
    cov: Array
    moved_mean: Array
    moved_cov: Array
    mean_bar: Array
    cov_bar: Array
    found: Array
    shares: Array
    scratch: Array


def prepare_sweep(
    theta_r_deg: ArrayLike, group: ArrayLike, scan: ArrayLike, y: ArrayLike, censored: ArrayLike,
    mixture: Mixture, *, groups: ArrayLike, rough: bool = False,
) -> Sweep:  # fmt: skip
    """Put rows of groups in the order of the filter.

    Rows of one angle are taken by scan and reading, so that the order of the rows of a file does
    not matter.

    Parameters
    ----------
    theta_r_deg : array_like, shape (n_rows,)
        Angles [deg].
    group, scan : array_like of int, shape (n_rows,)
        Rows that share their discrepancy, their gain.
    y : array_like, shape (n_rows,)
        Logarithms of the readings.
    censored : array_like of bool, shape (n_rows,)
    mixture : Mixture
        Law of the noise.
    groups : array_like of int
        Groups that are swept.
    rough : bool
        Matérn 1/2 instead of 3/2.

    Returns
    -------
    Sweep
    """
    angle, value = np.asarray(theta_r_deg, np.float64), np.asarray(y, np.float64)
    of_group, of_scan = np.asarray(group), np.asarray(scan)
    hidden = np.asarray(censored, dtype=bool)
    names = np.asarray(groups, dtype=np.int64)
    rows, spacings, gains, turns, scans = [], [], [], [], []
    for g in names:
        own = np.flatnonzero(of_group == g)
        own = own[np.lexsort((value[own], of_scan[own], angle[own]))]
        first = _choose_start(value[own], of_scan[own], ~hidden[own])
        order = np.concatenate([own[first:], own[:first][::-1]])
        spacing = np.abs(np.diff(angle[order], prepend=angle[order[0]]))
        if first:
            spacing[own.size - first] = angle[own[first]] - angle[own[first - 1]]
        present, number = np.unique(of_scan[order], return_inverse=True)
        rows.append(order)
        spacings.append(spacing)
        gains.append(FIRST_GAIN + number.ravel())
        turns.append(own.size - first)
        scans.append(present)
    start = np.concatenate([[0], np.cumsum([r.size for r in rows])]).astype(np.int64)
    table = np.full((names.size, max((s.size for s in scans), default=1)), -1, dtype=np.int64)
    for line, present in zip(table, scans, strict=True):
        line[: present.size] = present
    return Sweep(
        rough=rough,
        group=names,
        start=start,
        turn=start[:-1] + np.array(turns, dtype=np.int64),
        row=np.concatenate([*rows, np.zeros(0)]).astype(np.int64),
        spacing=np.concatenate([*spacings, np.zeros(0)]),
        gain=np.concatenate([*gains, np.zeros(0)]).astype(np.int64),
        scan=table,
        mixture=mixture,
    )


def _choose_start(value: Array, scan: Index, seen: Flags) -> int:
    """Place in the middle half of the longest run of seen rows; 0 where there is none.

    The first readings of the scans there are to be the least astray: a gain not yet known follows
    its first reading, and nothing later can tell that it was an outlier.
    """
    if not seen.any():
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(np.int8)))
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    low, high = int(edges[2 * longest]), int(edges[2 * longest + 1])
    quarter = (high - low) // 4
    astray = np.full(value.size, np.inf)
    for s in np.unique(scan):
        own = np.flatnonzero((scan == s) & seen)
        if own.size:
            near = np.pad(value[own], 2, mode="edge")
            windows = np.lib.stride_tricks.sliding_window_view(near, 5)
            astray[own] = np.abs(value[own] - np.median(windows, axis=1))

    def worst_first(start: int) -> float:
        order = np.concatenate([np.arange(start, value.size), np.arange(start)[::-1]])
        return float(astray[order[np.unique(scan[order], return_index=True)[1]]].max())

    return min(range(low + quarter, high - quarter), key=worst_first)


@compiled()
def make_tape(sweep: Sweep, slopes: bool, n_errors: int = 0) -> Tape:
    """Arrays for `sweep_log_likelihood`, or with ``slopes`` for `sweep_gradient` as well."""
    longest = 1
    for g in range(sweep.group.size):
        longest = max(longest, sweep.start[g + 1] - sweep.start[g])
    kept = longest if slopes else 1
    n = FIRST_GAIN + sweep.scan.shape[1]
    n_rows = sweep.row.max() + 1 if sweep.row.size else 0
    return Tape(
        sensitivities=np.zeros((n_errors, n_rows)),
        v=np.zeros(n_errors),
        g=np.zeros((n_errors, n_errors)),
        error_mean=np.empty((n_errors, n)),
        error_innovation=np.empty(n_errors),
        steps=np.empty((6 if slopes else 3, sweep.row.size)),
        mean=np.empty((kept + 1, n)),
        cov=np.empty((kept + 1, n, n)),
        moved_mean=np.empty((kept + 1, n)),
        moved_cov=np.empty((kept + 1, n, n)),
        mean_bar=np.empty(n),
        cov_bar=np.empty((n, n)),
        found=np.empty((kept, N_OUT)),
        shares=np.empty((6, sweep.mixture.scale.size)),
        scratch=np.empty((4, n)),
    )
