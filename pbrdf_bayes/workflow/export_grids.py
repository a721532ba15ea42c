"""Grids on which linear interpolation keeps to the model, and how well it does.

An axis is bisected where the middle of an interval differs from the mean of its ends by more than
a tolerance, at probes along the other axes. Errors are relative, and count where the BRDF is above
1 % of its peak at the same angle of incidence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.io.export.records import HalfAngleGrid, SpecularGrid
from pbrdf_bayes.model.four_parameter import MAX_THETA_I_DEG
from pbrdf_bayes.model.polarimetry import mueller
from pbrdf_bayes.physics.stokes import prepare_frames
from pbrdf_bayes.workflow.export_source import Source

Array = NDArray[np.float64]
Field = Callable[..., Array]
"""Axes of one shape to values (n_channels, *shape); NaN where the value does not count."""

MOST_BYTES = 64 * 2**20
SHARE_OF_PEAK = 0.01
_TOLERANCES = (0.1, 0.07, 0.05, 0.035, 0.025, 0.018, 0.013, 0.009, 0.006, 0.0045)
_OF_LIST = 0.004
_MOST_THETA_R_DEG = 89.0
_MOST_INCIDENCE_DEG = 80.0
COUNTED_DEG = 75.0
"""Error in half angles counts where light and viewer are both up to it."""
_N_POINTS = 20_000
_BYTES_OF_TEXT, _BYTES_OF_MATRICES = 13, 5 * 16 * 4


@dataclass(frozen=True, kw_only=True)
class Error:
    """Relative error of linear interpolation in a grid [1]."""

    median: float
    most: float

    def __str__(self) -> str:
        return f"median {100.0 * self.median:.2g} %, largest {100.0 * self.most:.2g} %"


def refine(
    axes: Sequence[Array], probes: Sequence[Array], field: Field, *, tolerance: float
) -> list[Array]:
    """Axes bisected until interpolation along each keeps to ``tolerance``.

    Parameters
    ----------
    axes : sequence of ndarray
        Coarse nodes of each axis, increasing.
    probes : sequence of ndarray
        Where the other axes are held while one is refined.
    field : callable
        See `Field`.
    tolerance : float
        Relative error allowed along one axis [1].

    Returns
    -------
    list of ndarray
    """
    return [
        _refine_one(nodes, number, probes, field, tolerance) for number, nodes in enumerate(axes)
    ]


def refine_within(
    axes: Sequence[Array],
    probes: Sequence[Array],
    field: Field,
    bytes_of: Callable[[Sequence[Array]], int],
) -> list[Array]:
    """The finest of the `refine`d axes, over falling tolerances, that keep to `MOST_BYTES`."""
    for tolerance in _TOLERANCES:
        finer = refine(axes, probes, field, tolerance=tolerance)
        if bytes_of(finer) > MOST_BYTES:
            break
        axes = finer
    return list(axes)


def _refine_one(
    nodes: Array, number: int, probes: Sequence[Array], field: Field, tolerance: float
) -> Array:
    def along(x: Array) -> Array:
        axes = [x if i == number else probe for i, probe in enumerate(probes)]
        return np.moveaxis(field(*np.meshgrid(*axes, indexing="ij")), 1 + number, -1)

    least = np.ptp(nodes) / 4000.0
    values = along(nodes)
    while True:
        middle = 0.5 * (nodes[1:] + nodes[:-1])
        exact = along(middle)
        error = np.abs(0.5 * (values[..., 1:] + values[..., :-1]) / exact - 1.0)
        worst = np.nan_to_num(error).reshape(-1, middle.size).max(axis=0)
        bad = np.flatnonzero((worst > tolerance) & (np.diff(nodes) > least))
        if not bad.size:
            return nodes
        nodes = np.insert(nodes, bad + 1, middle[bad])
        values = np.insert(values, bad + 1, exact[..., bad], axis=-1)


def interpolation_error(axes: Sequence[Array], field: Field, seed: int = 1) -> Error:
    """Error of linear interpolation, at random points of random cells of the grid.

    Parameters
    ----------
    axes : sequence of ndarray
    field : callable
        See `Field`; cells with a corner that does not count are left out.
    seed : int
        Of the points.

    Returns
    -------
    Error
    """
    rng = np.random.default_rng(seed)
    cells = [rng.integers(0, x.size - 1, _N_POINTS) for x in axes]
    shares = [rng.random(_N_POINTS) for _ in axes]
    between: Array | float = 0.0
    for corner in product((0, 1), repeat=len(axes)):
        at = [x[cell + up] for x, cell, up in zip(axes, cells, corner, strict=True)]
        weight = np.prod([t if up else 1.0 - t for t, up in zip(shares, corner, strict=True)], 0)
        between = between + weight * field(*at)
    points = [x[c] + t * (x[c + 1] - x[c]) for x, c, t in zip(axes, cells, shares, strict=True)]
    error = np.abs(between / field(*points) - 1.0)
    error = error[np.isfinite(error)]
    if not error.size:
        return Error(median=0.0, most=0.0)
    return Error(median=float(np.median(error)), most=float(error.max()))


class Peaks:
    """Largest BRDF in plane against the angle of incidence, of each source and polarisation."""

    def __init__(self, sources: Sequence[Source], polarizations: Sequence[str]) -> None:
        self.targets = list(product(sources, polarizations))
        self._theta_i = np.append(np.linspace(0.0, 88.0, 45), MAX_THETA_I_DEG)
        theta_r = np.linspace(-_MOST_THETA_R_DEG, _MOST_THETA_R_DEG, 357)
        self._logs = [
            np.log(source.at(self._theta_i[:, None], theta_r, 0.0, q).max(axis=1))
            for source, q in self.targets
        ]

    def counted(self, theta_i: Array, theta_r: Array, phi_r: Array) -> Array:
        """BRDF (n_targets, ...) of directions [deg], NaN below 1 % of the peak."""
        found = []
        for (source, q), logs in zip(self.targets, self._logs, strict=True):
            values = source.at(theta_i, theta_r, phi_r, q)
            peak = np.exp(np.interp(theta_i, self._theta_i, logs))
            found.append(np.where(values > SHARE_OF_PEAK * peak, values, np.nan))
        return np.stack(found)


def line_of(peaks: Peaks, theta_i: float) -> tuple[Array, Error]:
    """theta_r [deg], signed, of a scan in plane."""

    def field(theta_r: Array) -> Array:
        return peaks.counted(np.full(theta_r.shape, theta_i), theta_r, np.zeros(theta_r.shape))

    most = _MOST_THETA_R_DEG
    start = np.concatenate([[-most], np.arange(-85.0, 86.0, 5.0), [most]])
    axes = refine([start], [start], field, tolerance=1.5 * _OF_LIST)
    return axes[0], interpolation_error(axes, field)


def hemisphere_of(peaks: Peaks, theta_i: float) -> tuple[list[Array], Error]:
    """theta_r from 0 and phi_r from 0 to 180 [deg] about one incidence."""

    def field(theta_r: Array, phi_r: Array) -> Array:
        return peaks.counted(np.full(theta_r.shape, theta_i), theta_r, phi_r)

    near = theta_i + np.linspace(-10.0, 10.0, 11)
    theta = np.unique(np.clip(np.append(near, np.arange(5.0, 89.0, 12.0)), 0.0, _MOST_THETA_R_DEG))
    phi = np.unique(np.append([0.0, 1.0, 2.0, 4.0, 8.0], np.arange(15.0, 181.0, 15.0)))
    start = [np.append(np.arange(0.0, 86.0, 5.0), _MOST_THETA_R_DEG), np.arange(0.0, 181.0, 15.0)]
    axes = refine(start, [theta, phi], field, tolerance=_OF_LIST)
    return axes, interpolation_error(axes, field)


def about_specular(theta_i: Array, azimuth: Array, radial: Array) -> tuple[Array, Array, Array]:
    """theta_r, phi_r [deg] and the height d_z of directions about the specular one.

    d = cos R s + sin R (cos A t + sin A y), with s the specular direction, t towards the normal.

    Parameters
    ----------
    theta_i, azimuth, radial : ndarray
        Of one shape [deg].

    Returns
    -------
    tuple of ndarray
    """
    i, a, r = (np.deg2rad(x) for x in (theta_i, azimuth, radial))
    x = np.cos(r) * np.sin(i) - np.sin(r) * np.cos(a) * np.cos(i)
    z = np.cos(r) * np.cos(i) + np.sin(r) * np.cos(a) * np.sin(i)
    y = np.sin(r) * np.sin(a)
    theta_r = np.rad2deg(np.arctan2(np.hypot(x, y), z))
    return theta_r, np.rad2deg(np.arctan2(y, x)), z


_HORIZON = 1e-9


def specular_axes(
    peaks: Peaks, theta_i: Sequence[float] | None
) -> tuple[tuple[Array, Array, Array], Error]:
    """Incidence, azimuth and radial angle [deg]; given incidences are kept as they are."""

    def field(theta_i: Array, azimuth: Array, radial: Array) -> Array:
        theta_r, phi_r, z = about_specular(theta_i, azimuth, radial)
        values = peaks.counted(theta_i, np.minimum(theta_r, 90.0), phi_r)
        return np.where(z > _HORIZON, values, np.nan)

    given = None if theta_i is None else np.asarray(theta_i, dtype=np.float64)
    incidences = np.linspace(0.0, _MOST_INCIDENCE_DEG, 9) if given is None else given
    far = 90.0 + incidences[-1]
    radial = np.append([0.0, 1.0, 2.0, 3.5, 5.0, 7.0], np.arange(10.0, far, 10.0))
    start = [incidences, np.linspace(0.0, 180.0, 19), np.append(radial, far)]
    probes = [incidences[:: 1 + incidences.size // 10], np.linspace(0.0, 180.0, 9), start[2]]

    def bytes_of(axes: Sequence[Array]) -> int:
        return _BYTES_OF_TEXT * incidences.size * prod(x.size for x in axes[-2:])

    if given is None:
        axes = refine_within(
            start, probes, field, lambda axes: bytes_of(axes) // incidences.size * axes[0].size
        )
        return (axes[0], axes[1], axes[2]), interpolation_error(axes, field)

    def at_given(azimuth: Array, radial: Array) -> Array:
        each = [field(np.full(azimuth.shape, x), azimuth, radial) for x in probes[0].tolist()]
        return np.concatenate(each)

    axes = refine_within(start[1:], probes[1:], at_given, bytes_of)
    return (given, axes[0], axes[1]), interpolation_error(axes, at_given)


def fill_specular(axes: tuple[Array, Array, Array], source: Source, q: str) -> SpecularGrid:
    """Values of one source and polarisation in the grid, 0 below the horizon."""
    mesh = np.meshgrid(*axes, indexing="ij")
    theta_r, phi_r, z = about_specular(*mesh)
    above = z > _HORIZON
    value = np.zeros(above.shape)
    value[above] = source.at(mesh[0][above], theta_r[above], phi_r[above], q)
    dhr = source.dhr_at(axes[0], q)
    return SpecularGrid(
        theta_i_deg=axes[0], azimuth_deg=axes[1], radial_deg=axes[2], value=value, dhr=dhr
    )


def half_to_angles(theta_h: Array, theta_d: Array, phi_d: Array) -> tuple[Array, Array, Array]:
    """theta_i, theta_r, phi_r [deg] of half and difference angles [rad].

    The light is i = R(theta_h) d, with d the direction (theta_d, phi_d) about the half vector; the
    viewer is its mirror image. Directions below the horizon have angles above 90.
    """
    sh, ch, sd, cd = np.sin(theta_h), np.cos(theta_h), np.sin(theta_d), np.cos(theta_d)
    sp, cp = np.sin(phi_d), np.cos(phi_d)
    i = np.stack([ch * sd * cp + sh * cd, sd * sp, ch * cd - sh * sd * cp])
    r = np.stack([sh * cd - ch * sd * cp, -sd * sp, ch * cd + sh * sd * cp])
    theta_i, theta_r = (np.rad2deg(np.arctan2(np.hypot(v[0], v[1]), v[2])) for v in (i, r))
    turned = np.arctan2(r[1], r[0]) - np.arctan2(i[1], i[0]) - np.pi
    return theta_i, theta_r, np.rad2deg(np.arctan2(np.sin(turned), np.cos(turned)))


def half_angle_axes(peaks: Peaks) -> tuple[tuple[Array, Array, Array], Error]:
    """theta_h, theta_d and phi_d from 0 to pi [rad], within `MOST_BYTES`."""

    def field(theta_h: Array, theta_d: Array, phi_d: Array) -> Array:
        theta_i, theta_r, phi_r = half_to_angles(theta_h, theta_d, phi_d)
        seen = (theta_i <= COUNTED_DEG) & (theta_r <= COUNTED_DEG)
        inside = (np.where(seen, x, 0.0) for x in (theta_i, theta_r, phi_r))
        return np.where(seen, peaks.counted(*inside), np.nan)

    right = 0.5 * np.pi
    start = [right * np.linspace(0.0, 1.0, 9) ** 2, np.linspace(0.0, right, 10),
             np.linspace(0.0, np.pi, 7)]  # fmt: skip
    probes = [right * np.linspace(0.0, 0.95, 14) ** 2, np.linspace(0.0, np.deg2rad(80.0), 13),
              np.linspace(0.0, np.pi, 9)]  # fmt: skip

    def bytes_of(axes: Sequence[Array]) -> int:
        h, d, phi = axes
        return _BYTES_OF_MATRICES * h.size * d.size * (2 * phi.size - 1)

    h, d, phi = refine_within(start, probes, field, bytes_of)
    return (h, d, phi), interpolation_error([h, d, phi], field)


def fill_half_angles(
    axes: tuple[Array, Array, Array], sources: Sequence[Source], wavelength_nm: Sequence[int]
) -> HalfAngleGrid:
    """Mueller matrices of five sources in the grid.

    Below the horizon stand the values at it: a renderer cuts there itself, and interpolation near
    it keeps to the model.
    """
    h, d, half = axes
    mesh = np.meshgrid(half, d, h, indexing="ij")
    theta_i, theta_r, phi_r = half_to_angles(mesh[2], mesh[1], mesh[0])
    angles = (np.minimum(theta_i, MAX_THETA_I_DEG), np.minimum(theta_r, 90.0), phi_r)
    found = {id(source): facet_mueller(source, *angles) for source in sources}
    one_side = np.stack([found[id(source)] for source in sources], axis=-3)
    flip = np.outer([1.0, 1.0, -1.0, -1.0], [1.0, 1.0, -1.0, -1.0])
    return HalfAngleGrid(
        theta_h=h, theta_d=d, phi_d=np.concatenate([-half[:0:-1], half]),
        wavelength_nm=np.array(wavelength_nm),
        mueller=np.concatenate([flip * one_side[:0:-1], one_side]).astype(np.float32),
    )  # fmt: skip


def facet_mueller(source: Source, theta_i: Array, theta_r: Array, phi_r: Array) -> Array:
    """Mueller matrices (..., 4, 4) with both frames across the plane of light and viewer.

    Circular light keeps the share that light at 45 deg keeps; between the two nothing passes.
    """
    whole = mueller(source.parameters, theta_i, theta_r, phi_r_deg=phi_r, effects=source.effects)
    frames = prepare_frames(*(np.deg2rad(x) for x in (theta_i, theta_r, phi_r)))
    matrix = np.zeros((*theta_i.shape, 4, 4))
    matrix[..., 1:3, 1:3] = np.eye(2)
    into, out = np.zeros((2, *theta_i.shape, 3, 3))
    for turn, cosine, sine in (
        (into, frames.cos_in, frames.sin_in), (out, frames.cos_out, -frames.sin_out)
    ):  # fmt: skip
        turn[..., 0, 0] = 1.0
        turn[..., 1, 1] = turn[..., 2, 2] = cosine
        turn[..., 1, 2], turn[..., 2, 1] = -sine, sine
    matrix[..., :3, :3] = np.swapaxes(out, -1, -2) @ whole @ np.swapaxes(into, -1, -2)
    matrix[..., 3, 3] = matrix[..., 2, 2]
    return matrix
