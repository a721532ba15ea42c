"""What was measured on one paint sample at one wavelength, as validated frozen arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.errors import DataError
from pbrdf_bayes.quantities import POLARIZATIONS, QUANTITIES, READ

ANGLE_TOLERANCE_DEG = 0.05
"""Incidences and azimuths that differ by no more are one: encoders jitter."""
MOST_SCANS = 10_000
"""Scans of one sample."""
MAX_LABEL = 200
"""Longest name of a scan."""
MAX_NAME = 1000
"""Longest name of a sample; of a folder it makes a short name with a hash."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of one quantity, row by row.

    Attributes
    ----------
    polarization : ndarray of str, shape (n_obs,)
        ``"s"``, ``"p"`` or ``"u"``.
    theta_i_deg, theta_r_deg, phi_r_deg : ndarray, shape (n_obs,)
        Directions [deg]; ``theta_r_deg`` is signed, + on the forward side, ``phi_r_deg`` in
        (-90, 90] for BRDF readings. NaN in ``theta_r_deg`` for hemispherical readings.
    value : ndarray, shape (n_obs,)
        BRDF [sr^-1] or DHR [1].
    u_value : ndarray, shape (n_obs,)
        Standard uncertainty of ``value`` stated by the laboratory, same unit; NaN where not
        stated. Already divided by the root of the number of repeats.
    repeated : ndarray of bool, shape (n_obs,)
        True where ``u_value`` is the scatter of repeated readings (few degrees of freedom).
    row : ndarray of int, shape (n_obs,)
        Line in the source file (the header is line 1); 0 when there is no file.
    """

    polarization: NDArray[np.str_]
    theta_i_deg: NDArray[np.float64]
    theta_r_deg: NDArray[np.float64]
    phi_r_deg: NDArray[np.float64]
    value: NDArray[np.float64]
    u_value: NDArray[np.float64]
    repeated: NDArray[np.bool_]
    row: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.value.size)


@dataclass(frozen=True)
class Scan:
    """One BRDF scan: fixed incidence, polarisation and azimuth; ``theta_r`` varies.

    ``start`` and ``stop`` delimit its rows in ``Measurement.brdf``, sorted by ``theta_r_deg``.
    """

    label: str
    polarization: str
    theta_i_deg: float
    phi_r_deg: float
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def rows(self) -> slice:
        """Rows of this scan in ``Measurement.brdf``."""
        return slice(self.start, self.stop)


@dataclass(frozen=True, eq=False)
class Measurement:
    """All usable readings of one sample at one wavelength, see `measurement_from_columns`.

    Attributes
    ----------
    sample : str
    wavelength_um : float
        Wavelength [um].
    brdf, dhr : Readings
        BRDF rows grouped by scan and sorted by ``theta_r_deg``; DHR rows sorted by polarisation
        and angle. Either may be empty, not both.
    scans : tuple of Scan
        Unique labels; ordered by incidence angle, then s, p, u.
    excluded : mapping of str to int
        Rows left out, counted by their ``flag``.
    source, sha256 : str
        File name (without folder) and hash of its bytes; empty when not from a file.
    warnings : tuple of str
        What reading found worth saying without refusing the file.
    """

    sample: str
    wavelength_um: float
    brdf: Readings
    dhr: Readings
    scans: tuple[Scan, ...]
    excluded: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def n_obs(self) -> int:
        """Number of usable readings, BRDF and DHR together."""
        return len(self.brdf) + len(self.dhr)


def measurement_from_columns(
    *,
    sample: str,
    wavelength_um: float,
    quantity: ArrayLike,
    polarization: ArrayLike,
    theta_i_deg: ArrayLike,
    theta_r_deg: ArrayLike,
    value: ArrayLike,
    phi_r_deg: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    n_repeats: ArrayLike | None = None,
    scan: ArrayLike | None = None,
    row: ArrayLike | None = None,
    excluded: Mapping[str, int] | None = None,
    source: str = "",
    sha256: str = "",
    warnings: tuple[str, ...] = (),
    angle_tolerance_deg: float = ANGLE_TOLERANCE_DEG,
) -> Measurement:
    """Group validated columns of the tidy format into a `Measurement`.

    A direction has two names, (theta_r, phi_r) and (-theta_r, phi_r + 180 deg). The one with phi_r
    in (-90, 90] is kept, so that both halves of a plane are one scan.

    Incidences and azimuths of BRDF readings that differ by at most the tolerance are one geometry
    and take their nominal value; theta_r is never merged. A label splits a geometry only where
    angles repeat and it names more than one reading, so that a time stamp makes no scans.

    Parameters
    ----------
    quantity, polarization, theta_i_deg, theta_r_deg, value : array_like, shape (n_rows,)
        Columns of the tidy CSV; angles [deg], BRDF values [sr^-1], DHR values [1].
    phi_r_deg, sigma, n_repeats, scan, row : array_like, shape (n_rows,), optional
        Optional columns; missing ``sigma`` is NaN, missing ``n_repeats`` is NaN (``sigma`` is then
        the standard uncertainty itself), missing ``scan`` is the empty label.
    angle_tolerance_deg : float
        0 keeps every angle as it is [deg].

    Returns
    -------
    Measurement

    Raises
    ------
    DataError
        When no row is left, or with more than `MOST_SCANS` scans. Ranges are the business of the
        reader.

    Examples
    --------
    >>> m = measurement_from_columns(
    ...     sample="a", wavelength_um=3.39, quantity=["brdf", "brdf", "dhr"],
    ...     polarization=["s", "s", "p"], theta_i_deg=[20, 20, 30], theta_r_deg=[10, -10, np.nan],
    ...     value=[0.02, 0.01, 0.03])
    >>> [scan.label for scan in m.scans], m.brdf.theta_r_deg.tolist(), len(m.dhr)
    (['s 20 deg'], [-10.0, 10.0], 1)
    """
    quantity = np.asarray(quantity, dtype=np.str_)
    n_rows = quantity.size
    if n_rows == 0:
        msg = f"{source or 'measurement'}: no usable rows for sample {sample!r}"
        raise DataError(msg)

    def column(values: ArrayLike | None, fill: float) -> NDArray[np.float64]:
        return np.full(n_rows, fill) if values is None else np.asarray(values, dtype=np.float64)

    repeats = column(n_repeats, np.nan)
    repeated = np.nan_to_num(repeats, nan=1.0) > 1
    is_brdf = np.isin(quantity, [q for q in READ if not QUANTITIES[q].hemispherical])
    theta_r, phi_r = name_half_plane(
        np.where(is_brdf, column(theta_r_deg, np.nan), np.nan),
        np.where(is_brdf, column(phi_r_deg, 0.0), 0.0),
    )
    columns = Readings(
        polarization=np.asarray(polarization, dtype=np.str_),
        theta_i_deg=column(theta_i_deg, np.nan),
        theta_r_deg=theta_r,
        phi_r_deg=phi_r,
        value=column(value, np.nan),
        u_value=column(sigma, np.nan) / np.sqrt(np.where(repeated, repeats, 1.0)),
        repeated=repeated,
        row=np.zeros(n_rows, np.int64) if row is None else np.asarray(row, dtype=np.int64),
    )
    columns = _merge_geometries(columns, is_brdf, angle_tolerance_deg)
    labels = np.full(n_rows, "", dtype=object)  # references: a long label takes no room in others
    rank = _rank(columns.polarization, POLARIZATIONS)
    phi = np.where(is_brdf, columns.phi_r_deg, 0.0)
    theta = np.where(is_brdf, columns.theta_r_deg, 0.0)
    if scan is not None:
        labels[:] = [str(label) for label in np.asarray(scan).ravel()]
        geometry = np.stack([columns.theta_i_deg, phi, rank], axis=1)[is_brdf]
        labels[is_brdf] = _labels_that_split(labels[is_brdf], geometry, theta[is_brdf])
    label_rank = _rank(labels, sorted(set(labels.tolist())))
    order = np.lexsort((columns.row, theta, label_rank, phi, rank, columns.theta_i_deg))
    brdf_rows = order[is_brdf[order]]
    dhr_order = np.lexsort((columns.row, columns.theta_i_deg, rank))
    dhr_rows = dhr_order[~is_brdf[dhr_order]]
    brdf = _take(columns, brdf_rows)
    return Measurement(
        sample=sample,
        wavelength_um=float(wavelength_um),
        brdf=brdf,
        dhr=_take(columns, dhr_rows),
        scans=_group_scans(brdf, label_rank[brdf_rows], labels[brdf_rows]),
        excluded=dict(excluded or {}),
        source=source,
        sha256=sha256,
        warnings=warnings,
    )


def merge_close(values: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """One nominal value for all values that lie within a tolerance of each other.

    It is their median, rounded to a fifth of the tolerance: 20.0021 becomes 20 at 0.05.

    Parameters
    ----------
    values : ndarray, shape (n,)
    tolerance : float
        Largest difference in a cluster, in the unit of the values; clusters begin at the smallest.

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> merge_close(np.array([20.0, 0.001, 20.004, 0.003, 19.998]), 0.05).tolist()
    [20.0, 0.0, 20.0, 0.0, 20.0]
    """
    distinct = np.unique(values)
    nominal = values.copy()
    first = 0
    for last in range(distinct.size):
        if last + 1 < distinct.size and distinct[last + 1] - distinct[first] <= tolerance:
            continue
        if last > first:
            inside = (values >= distinct[first]) & (values <= distinct[last])
            step = 0.2 * tolerance
            nominal[inside] = round(np.round(np.median(values[inside]) / step) * step, 9)
        first = last + 1
    return nominal


def _merge_geometries(
    readings: Readings, is_brdf: NDArray[np.bool_], tolerance_deg: float
) -> Readings:
    """Nominal incidences and azimuths of BRDF rows; both sides of -90 deg are one plane."""
    theta_i, theta_r, phi_r = (
        column.copy() for column in (readings.theta_i_deg, readings.theta_r_deg, readings.phi_r_deg)
    )
    wraps = is_brdf & (phi_r <= tolerance_deg - 90.0)
    phi_r[wraps] += 180.0
    theta_r[wraps] *= -1.0
    phi_r[is_brdf] = np.minimum(merge_close(phi_r[is_brdf], tolerance_deg), 90.0)
    theta_i[is_brdf] = merge_close(theta_i[is_brdf], tolerance_deg)
    return replace(readings, theta_i_deg=theta_i, theta_r_deg=theta_r + 0.0, phi_r_deg=phi_r + 0.0)


def _labels_that_split(
    labels: NDArray[np.object_], geometry: NDArray[np.float64], theta_r_deg: NDArray[np.float64]
) -> NDArray[np.object_]:
    """Labels, empty in the geometries that they do not split.

    A geometry of one label keeps it. One of several keeps them where an angle was read more than
    once and the labels name two readings or more on average.
    """
    kept = labels.copy()
    _, number = np.unique(geometry, axis=0, return_inverse=True)
    for g in range(int(number.max(initial=-1)) + 1):
        own = np.flatnonzero(number.ravel() == g)
        n_labels = len(set(labels[own].tolist()))
        repeats = np.unique(theta_r_deg[own]).size < own.size
        if n_labels > 1 and not (repeats and own.size >= 2 * n_labels):
            kept[own] = ""
    return kept


def name_half_plane(
    theta_r_deg: NDArray[np.float64], phi_r_deg: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Name directions by the azimuth in (-90, 90], with the sign of ``theta_r`` that goes with it.

    Parameters
    ----------
    theta_r_deg, phi_r_deg : ndarray, shape (n,)
        Signed scattering angle and azimuth [deg].

    Returns
    -------
    theta_r_deg, phi_r_deg : ndarray, shape (n,)
        Those with an azimuth in the range already are untouched; others are rounded to 1e-9 deg,
        so that both halves of a plane get the same azimuth.

    Examples
    --------
    >>> theta_r, phi_r = name_half_plane(np.array([10.0, 10.0]), np.array([180.0, 30.0]))
    >>> theta_r.tolist(), phi_r.tolist()
    ([-10.0, 10.0], [0.0, 30.0])
    """
    inside = (phi_r_deg > -90.0) & (phi_r_deg <= 90.0)
    rounded = np.where(inside, phi_r_deg, np.round(phi_r_deg, 9))
    half_turns = np.where(inside, 0.0, np.ceil(rounded / 180.0 - 0.5))
    azimuth = np.where(inside, phi_r_deg, np.round(rounded - 180.0 * half_turns, 9))
    theta = np.where(half_turns % 2 == 1, -theta_r_deg, theta_r_deg)
    return theta + 0.0, azimuth + 0.0  # no negative zeros


def _take(readings: Readings, rows: NDArray[np.int64]) -> Readings:
    """Select rows of every column."""
    return Readings(**{name: getattr(readings, name)[rows] for name in readings.__dict__})


def _rank(words: NDArray[Any], ordered: Sequence[str]) -> NDArray[np.integer]:
    """Place of each word among the ordered ones."""
    place = {word: index for index, word in enumerate(ordered)}
    # numpy sorts short integers fastest.
    kind = np.int16 if len(ordered) < 2**15 else np.int64
    return np.fromiter(map(place.__getitem__, words.tolist()), kind, words.size)


def _group_scans(
    brdf: Readings, label_rank: NDArray[np.integer], labels: NDArray[np.object_]
) -> tuple[Scan, ...]:
    """Cut rows sorted by scan where incidence, polarisation, azimuth or label changes."""
    if len(brdf) == 0:
        return ()
    keys = (brdf.theta_i_deg, brdf.polarization, brdf.phi_r_deg, label_rank)
    new = np.zeros(len(brdf), dtype=bool)
    for key in keys:
        new[1:] |= key[1:] != key[:-1]
    starts = np.concatenate([[0], np.flatnonzero(new), [len(brdf)]])
    if (n := starts.size - 1) > MOST_SCANS:
        msg = (
            f"{n} scans in one sample (allowed: up to {MOST_SCANS}): readings of one scan share "
            "theta_i_deg, polarization, phi_r_deg and scan exactly. Round the angles set"
        )
        raise DataError(msg)
    scans: list[Scan] = []
    for start, stop in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        theta_i, pol, phi = (
            float(brdf.theta_i_deg[start]),
            str(brdf.polarization[start]),
            float(brdf.phi_r_deg[start]),
        )
        label = name_direction(pol, theta_i, phi)
        label += f" {labels[start]}" if labels[start] else ""
        scans.append(Scan(label, pol, theta_i, phi, start, stop))
    return tuple(scans)


def is_label(word: str, *, longest: int = MAX_LABEL) -> bool:
    """Tell whether a name can be shown, in a message or a report, and is not too long."""
    return word.isprintable() and len(word) <= longest


def is_name(word: str) -> bool:
    """Tell whether a sample can have that name."""
    return word != "" and is_label(word, longest=MAX_NAME)


def name_direction(polarization: str, theta_i_deg: float, phi_r_deg: float) -> str:
    """Name of a scan without its label, e.g. ``s 20 deg`` or ``p 40 deg phi 90 deg``."""
    azimuth = f" phi {phi_r_deg:.8g} deg" if phi_r_deg else ""
    return f"{polarization} {theta_i_deg:.8g} deg{azimuth}"


def select_scans(
    measurement: Measurement, keep: NDArray[np.bool_], *, dhr: NDArray[np.bool_] | bool
) -> Measurement:
    """Copy with only some scans, ``keep`` of shape (n_scans,), and all, no or some DHR readings."""
    chosen = [scan for scan, use in zip(measurement.scans, keep, strict=True) if use]
    rows = np.concatenate(
        [np.arange(scan.start, scan.stop) for scan in chosen] or [np.zeros(0, np.int64)]
    )
    starts = np.cumsum([0, *(len(scan) for scan in chosen)])
    scans = tuple(
        Scan(s.label, s.polarization, s.theta_i_deg, s.phi_r_deg, int(a), int(b))
        for s, a, b in zip(chosen, starts[:-1], starts[1:], strict=True)
    )
    dhr_rows = np.flatnonzero(np.broadcast_to(dhr, len(measurement.dhr)))
    return Measurement(
        sample=measurement.sample,
        wavelength_um=measurement.wavelength_um,
        brdf=_take(measurement.brdf, rows.astype(np.int64)),
        dhr=_take(measurement.dhr, dhr_rows),
        scans=scans,
        source=measurement.source,
        sha256=measurement.sha256,
    )
