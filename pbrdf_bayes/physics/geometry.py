"""Where BRDF and DHR are wanted: distinct directions, and rows that point at them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.directions import prepare_directions
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Geometry(NamedTuple):
    """Where the BRDF and the DHR are wanted; everything that the parameters do not enter.

    Distinct directions are grouped by angle of incidence (``start`` delimits the groups) and serve
    s and p alike; a row of the data points at its direction.
    """

    incidences: Array
    """(n_incidence, 4): sine, cosine, theta_i, pi/2 - theta_i."""
    start: Index
    directions: Array
    """(8, n_directions): the fields of `Directions`."""
    in_plane: NDArray[np.bool_]
    """Per angle of incidence: all its directions have beta = 0."""
    unpolarised: NDArray[np.bool_]
    """Per angle of incidence: some row asks for u there."""
    row_direction: Index
    row_polarization: Index
    """0, 1, 2 for s, p, u."""
    row_incidence: Index
    row_run: Index
    """Rows from this one on, with it, whose directions follow one upon the other."""
    dhr_sine: Array
    dhr_cosine: Array
    dhr_polarization: Index
    angles: Array
    """(3, n_directions): theta_i, theta_r, phi_r [rad]."""
    dhr_theta_i: Array
    dhr_first: Index
    """For each DHR row the first one at its angle."""


def polarization_codes(polarization: NDArray[np.str_]) -> Index:
    """0, 1, 2 for s, p, u."""
    return np.array([POLARIZATIONS.index(p) for p in polarization.tolist()], dtype=np.int64)


def prepare_geometry(
    *,
    theta_i: Array,
    theta_r: Array,
    phi_r: Array,
    polarization: NDArray[np.str_],
    dhr_theta_i: Array,
    dhr_polarization: NDArray[np.str_],
) -> Geometry:
    """Precompute the geometry of BRDF rows and DHR rows.

    Parameters
    ----------
    theta_i, theta_r, phi_r : ndarray, shape (n_brdf,)
        Angles [rad].
    polarization : ndarray of str, shape (n_brdf,)
        ``s``, ``p`` or ``u``.
    dhr_theta_i : ndarray, shape (n_dhr,)
        Angles of incidence [rad].
    dhr_polarization : ndarray of str, shape (n_dhr,)

    Returns
    -------
    Geometry
    """
    keys = np.stack([theta_i, theta_r, phi_r], axis=1).reshape(-1, 3)
    distinct, row_direction = _in_order_of_appearance(keys)
    angles, first = np.unique(distinct[:, 0], return_index=True)
    directions = prepare_directions(*distinct.T)
    start = np.append(first, len(distinct)).astype(np.int64)
    flat = directions.beta_offset == 0.0
    codes = polarization_codes(polarization)
    row_incidence = np.searchsorted(angles, theta_i)
    unpolarised = np.zeros(len(angles), dtype=bool)
    unpolarised[row_incidence[codes == 2]] = True
    return Geometry(
        incidences=np.stack([np.sin(angles), np.cos(angles), angles, 0.5 * np.pi - angles], axis=1),
        start=start,
        directions=np.stack(directions),
        in_plane=np.array([flat[a:b].all() for a, b in pairwise(start)]),
        unpolarised=unpolarised,
        row_direction=row_direction,
        row_polarization=codes,
        row_incidence=row_incidence.astype(np.int64),
        row_run=_run_lengths(row_direction),
        dhr_sine=np.sin(dhr_theta_i),
        dhr_cosine=np.cos(dhr_theta_i),
        dhr_polarization=polarization_codes(dhr_polarization),
        angles=np.ascontiguousarray(distinct.T),
        dhr_theta_i=np.asarray(dhr_theta_i, dtype=np.float64),
        dhr_first=_first_of_equals(dhr_theta_i),
    )


def _in_order_of_appearance(keys: Array) -> tuple[Array, Index]:
    """Distinct keys by angle of incidence, then as the rows have them; the key of each row.

    A scan then finds its directions side by side, whichever way it was measured.
    """
    distinct, first, row = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((first, distinct[:, 0]))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    return distinct[order], place[row.ravel()]


def _first_of_equals(values: Array) -> Index:
    """For each value the index of the first one that is equal to it."""
    _, first, which = np.unique(values, return_index=True, return_inverse=True)
    return np.asarray(first[which.ravel()], dtype=np.int64)


def _run_lengths(row_direction: Index) -> Index:
    """For each row the length of the run i, i + 1, i + 2, ... of directions that begins there."""
    last = np.append(np.diff(row_direction) != 1, True)
    ends = np.flatnonzero(last[: row_direction.size])
    rows = np.arange(row_direction.size)
    return np.asarray(ends[np.searchsorted(ends, rows)] - rows + 1, dtype=np.int64)
