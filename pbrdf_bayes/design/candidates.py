"""What could be measured next, and what it costs in minutes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.measurement import Measurement, Scan
from pbrdf_bayes.model.diffuse_directional import PORT_RANGE_DEG
from pbrdf_bayes.model.four_parameter import MAX_THETA_I_DEG
from pbrdf_bayes.quantities import PLANNED, POLARIZATIONS, QUANTITIES, Quantity

MOST_READINGS = 2000
ALIKE_DEG = 1.0
"""Scans of one polarisation whose incidence differs by less are repeats of one another [deg]. The
discrepancy of the model belongs to sample and geometry: within the angular scale of a goniometer,
its aperture and alignment, it is the same curve, far below the 20 deg over which it changes along a
scan; no second one to average over."""


@dataclass(frozen=True)
class Costs:
    """Minutes at the bench.

    Attributes
    ----------
    scan_minutes : float
        Set-up of a BRDF scan: incidence angle, polariser, alignment [min].
    dwell_seconds : float
        A reading of a scan, the move to its angle included [s].
    dhr_minutes, ddr_minutes : float
        A DHR or DDR reading, set-up included [min].
    """

    scan_minutes: float = 5.0
    dwell_seconds: float = 5.0
    dhr_minutes: float = 3.0
    ddr_minutes: float = 3.0

    def of(self, quantity: str, n_readings: int) -> float:
        """Minutes of a measurement."""
        scan = self.scan_minutes + n_readings * self.dwell_seconds / 60.0
        return {"brdf": scan, "dhr": self.dhr_minutes, "ddr": self.ddr_minutes}[quantity]


@dataclass(frozen=True)
class Candidate:
    """One measurement that could be taken.

    Attributes
    ----------
    quantity : {"brdf", "dhr", "ddr"}
        A scan of the BRDF, the directional hemispherical reflectance, or the diffuse directional
        one: the DHR less the light inside a port about the specular direction.
    polarization : {"s", "p", "u"}
    theta_i_deg : float
        Angle of incidence, 0 to 89.95 [deg].
    minutes : float
        What it costs, above 0 [min].
    theta_r_deg : tuple of float
        Angles of the scan [deg]; empty for DHR and DDR.
    port_deg : float
        Half angle of the specular port of a DDR, 0 for others [deg].

    Raises
    ------
    ConfigError
        When a value is not allowed.
    """

    quantity: str
    polarization: str
    theta_i_deg: float
    minutes: float
    theta_r_deg: tuple[float, ...] = ()
    port_deg: float = 0.0

    def __post_init__(self) -> None:
        faults = [
            *_one_of("quantity", self.quantity, PLANNED),
            *_one_of("polarization", self.polarization, POLARIZATIONS),
            *_within("theta_i_deg", self.theta_i_deg, 0.0, MAX_THETA_I_DEG),
            *_within("minutes", self.minutes, 1e-6, 1e6),
        ]
        if self.quantity in PLANNED:
            faults += self._faults_of_kind(QUANTITIES[self.quantity])
        if faults:
            where = f"candidate {self.quantity} {self.polarization} {self.theta_i_deg:g} deg"
            msg = f"{where}: {'; '.join(faults)}"
            raise ConfigError(msg)

    def _faults_of_kind(self, what: Quantity) -> list[str]:
        """What does not go with the quantity."""
        faults = [] if what.hemispherical else self._faults_of_scan()
        if what.hemispherical and self.theta_r_deg:
            faults.append("theta_r_deg belongs to scans. Leave it out")
        if what.port:
            faults += _within("port_deg", self.port_deg, *PORT_RANGE_DEG)
        elif self.port_deg:
            faults.append("port_deg belongs to DDR. Leave it out")
        return faults

    def _faults_of_scan(self) -> list[str]:
        n = len(self.theta_r_deg)
        if not 1 <= n <= MOST_READINGS:
            return [f"a scan has 1 to {MOST_READINGS} readings, not {n}"]
        each = (_within("theta_r_deg", angle, -90.0, 90.0) for angle in self.theta_r_deg)
        return next((found for found in each if found), [])

    @property
    def geometry(self) -> tuple[int, ...]:
        """Quantity, polarisation, incidence and port as whole numbers, angles in 1e-6 deg.

        Two candidates of one geometry may still differ in their angles and their minutes.
        """
        return (
            PLANNED.index(self.quantity), POLARIZATIONS.index(self.polarization),
            round(1e6 * self.theta_i_deg), round(1e6 * self.port_deg),
        )  # fmt: skip

    @property
    def n_readings(self) -> int:
        """Readings it takes."""
        return max(len(self.theta_r_deg), 1)

    @property
    def label(self) -> str:
        """E.g. ``p scan at 60 deg``, ``DHR_s at 75 deg``, ``DDR_s at 20 deg, port 5 deg``."""
        if self.quantity == "brdf":
            return f"{self.polarization} scan at {self.theta_i_deg:g}°"
        port = f", port {self.port_deg:g}°" if self.port_deg else ""
        return f"{self.quantity.upper()}_{self.polarization} at {self.theta_i_deg:g}°{port}"


def list_candidates(
    *,
    quantities: Sequence[str] = PLANNED,
    theta_i_deg: Iterable[float] = tuple(range(0, 90, 5)),
    polarizations: Sequence[str] = POLARIZATIONS,
    theta_r_deg: Sequence[float],
    port_deg: float | Sequence[float] = 5.0,
    costs: Costs | None = None,
) -> tuple[Candidate, ...]:
    """Every quantity, polarisation and angle of incidence.

    Parameters
    ----------
    quantities : sequence of {"brdf", "dhr", "ddr"}
    theta_i_deg : iterable of float
        Angles of incidence [deg].
    polarizations : sequence of {"s", "p", "u"}
    theta_r_deg : sequence of float
        Angles of every scan [deg].
    port_deg : float or sequence of float
        Half angle of the port of DDR readings, or several [deg].
    costs : Costs, optional

    Returns
    -------
    tuple of Candidate

    Raises
    ------
    ConfigError

    Examples
    --------
    >>> len(list_candidates(theta_r_deg=range(-80, 81)))
    162
    """
    price = costs or Costs()
    scan = tuple(float(a) for a in theta_r_deg)
    angles = [float(a) for a in theta_i_deg]
    ports = [float(a) for a in np.atleast_1d(np.asarray(port_deg, dtype=np.float64))]
    return tuple(
        Candidate(
            quantity, q, angle,
            minutes=price.of(quantity, len(scan)),
            theta_r_deg=scan if quantity == "brdf" else (),
            port_deg=port,
        )
        for quantity in quantities for port in (ports if quantity == "ddr" else [0.0])
        for q in polarizations for angle in angles
    )  # fmt: skip


def distinct_labels(candidates: Sequence[Candidate]) -> tuple[str, ...]:
    """Labels of candidates; those that would be equal say in what they differ.

    Examples
    --------
    >>> twice = [Candidate("dhr", "s", 60.0, minutes) for minutes in (3.0, 9.0)]
    >>> distinct_labels(twice)
    ('DHR_s at 60°, 3 min', 'DHR_s at 60°, 9 min')
    """
    alike: dict[str, list[Candidate]] = {}
    for c in candidates:
        alike.setdefault(c.label, []).append(c)
    several = {
        label: (len({c.theta_r_deg for c in same}) > 1, len({c.minutes for c in same}) > 1)
        for label, same in alike.items()
    }
    return tuple(c.label + _apart(c, *several[c.label]) for c in candidates)


def _apart(candidate: Candidate, scans_differ: bool, minutes_differ: bool) -> str:
    """What a candidate has of its own: range and readings of the scan, minutes."""
    angles = candidate.theta_r_deg
    words = ""
    if scans_differ:
        words += f", {min(angles):g} to {max(angles):g}° in {len(angles)} readings"
    return words + (f", {candidate.minutes:.3g} min" if minutes_differ else "")


def usual_scan(measurement: Measurement) -> tuple[float, ...]:
    """Angles of a scan as the sample has been scanned so far [deg]; -80 to 80 by 1 without any.

    The widest range and the median spacing, but no more readings than 161.
    """
    scans = [measurement.brdf.theta_r_deg[s.rows] for s in measurement.scans if len(s) > 1]
    if not scans:
        return tuple(float(a) for a in range(-80, 81))
    low, high = min(float(s.min()) for s in scans), max(float(s.max()) for s in scans)
    step = float(np.median(np.concatenate([np.diff(np.unique(s)) for s in scans])))
    step = max(step, (high - low) / 160.0)
    n = round((high - low) / step)
    return tuple(np.round(np.linspace(low, high, n + 1), 6).tolist())


def repeats(
    measurement: Measurement, theta_r_deg: Sequence[float], *, costs: Costs
) -> tuple[Candidate, ...]:
    """Every geometry that was measured: scans in the plane of incidence, and DHR."""
    scan, m = tuple(float(a) for a in theta_r_deg), measurement
    brdf = [("brdf", s.polarization, s.theta_i_deg) for s in m.scans if s.phi_r_deg == 0.0]
    dhr = [
        ("dhr", str(q), float(angle))
        for q, angle in zip(m.dhr.polarization, m.dhr.theta_i_deg, strict=True)
    ]
    return tuple(
        Candidate(
            quantity, q, angle, minutes=costs.of(quantity, len(scan)),
            theta_r_deg=scan if quantity == "brdf" else (),
        )
        for quantity, q, angle in dict.fromkeys([*brdf, *dhr])
    )  # fmt: skip


def scans_alike(candidate: Candidate, measurement: Measurement) -> tuple[Scan, ...]:
    """Scans that were measured and that a candidate repeats, all of one incidence.

    Those in the plane of incidence, of its polarisation, of the incidence nearest to its own if
    that is less than `ALIKE_DEG` away.
    """
    if candidate.quantity != "brdf":
        return ()
    near = [
        s for s in measurement.scans
        if s.polarization == candidate.polarization and s.phi_r_deg == 0.0
        and _near(s.theta_i_deg, candidate.theta_i_deg)
    ]  # fmt: skip
    nearest = min(
        (s.theta_i_deg for s in near), key=lambda a: abs(a - candidate.theta_i_deg), default=0.0
    )
    return tuple(s for s in near if s.theta_i_deg == nearest)


def was_measured(candidate: Candidate, measurement: Measurement) -> bool:
    """Whether the candidate repeats a geometry of the measurement."""
    dhr = measurement.dhr
    same: NDArray[np.bool_] = (dhr.theta_i_deg == candidate.theta_i_deg) & (
        dhr.polarization == candidate.polarization
    )
    if candidate.quantity == "dhr":
        return bool(same.any())
    return bool(scans_alike(candidate, measurement))


def are_alike(one: Candidate, other: Candidate, measurement: Measurement | None) -> bool:
    """Whether two candidates are repeats of one another: of one geometry, or scans close to it.

    Parameters
    ----------
    one, other : Candidate
    measurement : Measurement or None
        What was measured: two scans that repeat the same one of it are alike too.

    Examples
    --------
    >>> at = [Candidate("brdf", "p", a, 10.0, theta_r_deg=(0.0,)) for a in (56.0, 56.16, 57.0)]
    >>> are_alike(at[0], at[1], None), are_alike(at[0], at[2], None)
    (True, False)
    """
    if one.geometry == other.geometry:
        return True
    if {one.quantity, other.quantity} != {"brdf"} or one.polarization != other.polarization:
        return False
    if _near(one.theta_i_deg, other.theta_i_deg):
        return True
    if measurement is None:
        return False
    first, second = (scans_alike(c, measurement) for c in (one, other))
    return bool(first) and first == second


def _near(one_deg: float, other_deg: float) -> bool:
    """Nearer than `ALIKE_DEG`, to the 1e-6 deg that a geometry is told to."""
    return round(1e6 * abs(one_deg - other_deg)) < round(1e6 * ALIKE_DEG)


def _one_of(key: str, value: str, allowed: Sequence[str]) -> list[str]:
    if value in allowed:
        return []
    return [f"{key} = {value!r} is not known. Allowed: {', '.join(allowed)}"]


def _within(key: str, value: float, low: float, high: float) -> list[str]:
    if low <= value <= high:
        return []
    return [f"{key} = {value!r} is not allowed: give a number in [{low:g}, {high:g}]"]
