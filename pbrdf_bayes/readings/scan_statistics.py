"""What a scan shows without any model: its noise, its outliers, its symmetry, its integral.

Levels are compared as log10(BRDF) [dex]; readings of zero or less are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement, Scan

Array = NDArray[np.float64]

MAX_ZERO_OFFSET_DEG = 3.0
_MAD_TO_SD = 1.4826


@dataclass(frozen=True, eq=False)
class Profile:
    """Positive readings of one scan, one per angle (repeated ones averaged in log).

    Attributes
    ----------
    scan : Scan
    theta_r_deg : ndarray, shape (n_angles,)
        Strictly increasing [deg].
    level : ndarray, shape (n_angles,)
        log10(BRDF / sr^-1) [dex].
    row : ndarray of int, shape (n_angles,)
        Line in the source file of the (first) reading.
    """

    scan: Scan
    theta_r_deg: Array
    level: Array
    row: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.level.size)


def profile(measurement: Measurement, scan: Scan) -> Profile:
    """Positive readings of a scan of ``measurement`` as a function of the angle."""
    brdf, rows = measurement.brdf, scan.rows
    positive = brdf.value[rows] > 0
    level = np.log10(brdf.value[rows][positive])
    angle, first, place, n = np.unique(
        brdf.theta_r_deg[rows][positive], return_index=True, return_inverse=True, return_counts=True
    )
    mean = np.bincount(place, weights=level, minlength=angle.size) / n
    return Profile(scan, angle, mean, brdf.row[rows][positive][first])


def neighbour_deviation(p: Profile) -> tuple[Array, Array]:
    """Deviation of each level from the cubic through its two neighbours on either side.

    Returns
    -------
    deviation : ndarray, shape (n_angles - 4,)
        Without the two points at either end [dex]; empty below five points.
    gain : ndarray, shape (n_angles - 4,)
        Standard deviation of ``deviation`` for independent noise of unit standard deviation [1].
    """
    n = len(p)
    if n < 5:
        return np.zeros(0), np.zeros(0)
    around = np.array([0, 1, 3, 4])[:, None] + np.arange(n - 4)
    x = p.theta_r_deg[around] - p.theta_r_deg[2:-2]
    weights = np.ones_like(x)
    for j in range(4):
        for m in range(4):
            if m != j:
                weights[j] *= x[m] / (x[m] - x[j])
    deviation = p.level[2:-2] - np.sum(weights * p.level[around], axis=0)
    return deviation, np.sqrt(1.0 + np.sum(weights**2, axis=0))


def one_sided_deviation(p: Profile) -> Array:
    """Deviation of each level from the line through the two points before it, and after it.

    A point that is off by itself differs from both; one beside a step or a dip from one of them.

    Returns
    -------
    ndarray, shape (2, n_angles - 4)
        Before and after, without the two points at either end [dex]; empty below five points.
    """
    x, y = p.theta_r_deg, p.level
    n = max(len(p) - 4, 0)
    here = np.arange(n) + 2
    lines = []
    for near, far in ((here - 1, here - 2), (here + 1, here + 2)):
        slope = (y[near] - y[far]) / (x[near] - x[far])
        lines.append(y[here] - y[near] - slope * (x[here] - x[near]))
    return np.array(lines)


def point_noise(p: Profile) -> float:
    """Estimate the noise from point to point, robustly [dex]; NaN below five points.

    What varies slowly along the scan (calibration, alignment, model error) is not in it.
    """
    deviation, gain = neighbour_deviation(p)
    return _MAD_TO_SD * float(np.median(np.abs(deviation) / gain)) if gain.size else float("nan")


def find_spikes(
    p: Profile, *, at_least: float, significant: float
) -> tuple[NDArray[np.int64], Array]:
    """Find points that are off by themselves.

    Spared are the point next to the specular direction and those within a degree, where a narrow
    lobe looks like a spike, and dips of p, which may fall to nothing at the Brewster angle.

    Parameters
    ----------
    p : Profile
    at_least : float
        Least deviation from the neighbours [dex].
    significant : float
        Least deviation in standard deviations of the noise from point to point [1].

    Returns
    -------
    index : ndarray of int, shape (n_spikes,)
        Points of ``p``.
    deviation : ndarray, shape (n_spikes,)
        Level above the neighbours [dex].
    """
    deviation, gain = neighbour_deviation(p)
    if deviation.size == 0:
        return np.zeros(0, np.int64), deviation
    size = np.abs(deviation)
    beyond = (size > at_least) & (size / gain > significant * point_noise(p))
    alone = one_sided_deviation(p) * np.sign(deviation) > 0.5 * size
    padded = np.pad(size / gain, 2)
    largest = np.all([size / gain >= padded[d : d + size.size] for d in range(5)], axis=0)
    step = float(np.median(np.diff(p.theta_r_deg)))
    spared = from_specular_deg(p)[2:-2] <= max(0.75 * step, 1.0)
    spared |= (deviation < 0) & (p.scan.polarization == "p")
    index = np.flatnonzero(beyond & alone.all(axis=0) & largest & ~spared)
    return index + 2, deviation[index]


def repeat_deviation(measurement: Measurement) -> tuple[Array, NDArray[np.int64]]:
    """Deviation of repeated readings from the mean of their geometry.

    Readings repeat where polarisation, incidence, azimuth and scattering angle agree (to 1e-6 deg),
    in one scan or in several.

    Returns
    -------
    deviation : ndarray, shape (n_repeated,)
        In log10, scaled to the standard deviation of a single reading [dex].
    scan : ndarray of int, shape (n_repeated,)
        Index of the scan of each reading.
    """
    brdf, scans = measurement.brdf, measurement.scans
    use = np.flatnonzero(brdf.value > 0)
    scan = np.repeat(np.arange(len(scans)), [len(s) for s in scans])[use]
    directions = [(s.polarization, round(s.theta_i_deg, 6), round(s.phi_r_deg, 6)) for s in scans]
    number = {direction: index for index, direction in enumerate(directions)}
    direction = np.array([number[d] for d in directions], dtype=np.int64)[scan]
    theta_r = brdf.theta_r_deg[use].round(6)
    order = np.lexsort((theta_r, direction))
    new = np.ones(order.size, dtype=bool)
    new[1:] = (np.diff(theta_r[order]) != 0) | (np.diff(direction[order]) != 0)
    place = np.cumsum(new) - 1
    n = np.bincount(place)
    level = np.log10(brdf.value[use[order]])
    mean = np.bincount(place, weights=level) / n
    several = n[place] > 1
    n_here = n[place[several]]
    scale = np.sqrt(n_here / (n_here - 1))
    return (level - mean[place])[several] * scale, scan[order[several]]


def mirror_asymmetry(p: Profile, centre_deg: float = 0.0) -> float:
    """Rms of log10 f(centre + t) / f(centre - t) over the measured t > 0 [dex]; NaN below 5."""
    t = np.abs(p.theta_r_deg - centre_deg)
    reach = min(p.theta_r_deg[-1] - centre_deg, centre_deg - p.theta_r_deg[0]) if len(p) else 0.0
    t = np.unique(t[(t > 0) & (t <= reach)])
    if t.size < 5:
        return float("nan")
    forward = np.interp(centre_deg + t, p.theta_r_deg, p.level)
    backward = np.interp(centre_deg - t, p.theta_r_deg, p.level)
    return float(np.sqrt(np.mean((forward - backward) ** 2)))


def zero_offset(p: Profile) -> tuple[float, float]:
    """Angle about which a scan is most symmetric [deg], and the asymmetry left about it [dex]."""
    centres = np.linspace(-MAX_ZERO_OFFSET_DEG, MAX_ZERO_OFFSET_DEG, 301)
    left = np.array([mirror_asymmetry(p, centre) for centre in centres.tolist()])
    if np.all(np.isnan(left)):
        return 0.0, float("nan")
    best = int(np.nanargmin(left))
    return float(centres[best]), float(left[best])


def normal_incidence_ratio(a: Profile, b: Profile, reach_deg: float) -> tuple[float, float]:
    """Level of a over b at theta_r = 0 and its standard error [dex]; NaN where not measured.

    A parabola in theta_r through the differences within ``reach_deg`` of the normal, so that a
    detector that hides the normal direction itself does not matter. The error is the larger one of
    those from the scatter about the parabola and from the noise of both scans.
    """
    near = a.theta_r_deg[np.abs(a.theta_r_deg) <= reach_deg]
    inside = (near >= b.theta_r_deg[:1].min(initial=np.inf)) & (
        near <= b.theta_r_deg[-1:].max(initial=-np.inf)
    )
    near = near[inside]
    if near.size < 3 or np.unique(np.abs(near)).size < 2 or not (near.min() <= 0 <= near.max()):
        return float("nan"), float("nan")
    difference = np.interp(near, a.theta_r_deg, a.level) - np.interp(near, b.theta_r_deg, b.level)
    design = np.stack([np.ones_like(near), (near / reach_deg) ** 2], axis=1)
    solution = np.linalg.lstsq(design, difference, rcond=None)[0]
    residual = difference - design @ solution
    scatter = np.sqrt(residual @ residual / max(near.size - 2, 1))
    noise = np.nan_to_num(np.hypot(point_noise(a), point_noise(b)))
    gain = np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    return float(solution[0]), float(max(scatter, noise) * gain)


def in_plane(scan: Scan) -> bool:
    """Tell whether a scan lies in the plane of incidence."""
    return scan.phi_r_deg == 0


def from_specular_deg(p: Profile) -> Array:
    """Angle between each direction of a scan and its specular direction, shape (n_angles,) [deg].

    sin^2(d/2) = sin^2((theta_r - theta_i)/2) + sin(theta_r) sin(theta_i) sin^2(phi_r/2)
    """
    theta_r, theta_i = np.deg2rad(p.theta_r_deg), np.deg2rad(p.scan.theta_i_deg)
    across = np.sin(0.5 * np.deg2rad(p.scan.phi_r_deg)) ** 2
    if across == 0.0:
        return np.abs(p.theta_r_deg - p.scan.theta_i_deg)
    square = np.sin(0.5 * (theta_r - theta_i)) ** 2 + np.sin(theta_r) * np.sin(theta_i) * across
    distance: Array = np.rad2deg(2.0 * np.arcsin(np.sqrt(np.clip(square, 0.0, 1.0))))
    return distance


def covers_specular(p: Profile, *, within_deg: float) -> bool:
    """Tell whether a scan has a point within some degrees, or a step, of its specular direction."""
    step = float(np.median(np.diff(p.theta_r_deg))) if len(p) > 1 else 0.0
    nearest = float(np.min(from_specular_deg(p), initial=np.inf))
    return nearest <= max(within_deg, step)


def hemisphere_bracket(p: Profile) -> tuple[float, float]:
    """Least and largest hemispherical integral of the BRDF that an in-plane scan suggests [1].

    The lobe is taken to depend on the angle from the specular direction alone. The scan has that
    angle on either side of the specular direction; the smaller of the two readings gives the lower
    bound, the larger one the upper. Beyond its ends the scan is continued by its last reading.
    """
    theta, phi, weight = _hemisphere()
    incidence = np.deg2rad(p.scan.theta_i_deg)
    cosine = np.sin(theta) * np.cos(phi) * np.sin(incidence) + np.cos(theta) * np.cos(incidence)
    distance = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    there, back = p.scan.theta_i_deg + distance, p.scan.theta_i_deg - distance
    there, back = np.where(there > 90, back, there), np.where(back < -90, there, back)
    sides = [10 ** np.interp(angle, p.theta_r_deg, p.level) for angle in (there, back)]
    return float(weight @ np.minimum(*sides)), float(weight @ np.maximum(*sides))


def _hemisphere(n_theta: int = 180, n_phi: int = 120) -> tuple[Array, Array, Array]:
    """Directions [rad] of the half phi in (0, pi) and weights of cos(theta) dOmega, both halves."""
    theta = (np.arange(n_theta) + 0.5) * (np.pi / 2 / n_theta)
    phi = (np.arange(n_phi) + 0.5) * (np.pi / n_phi)
    theta, phi = (angle.ravel() for angle in np.meshgrid(theta, phi))
    return theta, phi, np.cos(theta) * np.sin(theta) * (np.pi / 2 / n_theta) * (2 * np.pi / n_phi)
