"""Rows as the likelihoods compare them with the model: over h, see `readings.observation`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.physics.brdf import Buffers, add_scan_slopes, at_rows, to_parameters
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.readings.observation import fill_scaled, slopes_by_log_f

Array = NDArray[np.float64]


class ScaledRows(NamedTuple):
    """Numbers of every row, allocated once: see `compare_scan`.

    ``residual`` and s_q^2 + ``extra`` are residual and variance over h and h^2, ``above`` is
    f^2/(f^2 + b^2).
    """

    log_f: Array
    residual: Array
    above: Array
    extra: Array
    rise: Array


@compiled()
def scaled_rows(rows: Rows) -> ScaledRows:
    """Arrays for `compare_scan`, right for rows without a floor."""
    n = rows.y.size
    return ScaledRows(np.empty(n), np.empty(n), np.ones(n), rows.u2.copy(), np.empty(n))


@compiled()
def compare_scan(
    geometry: Geometry, rows: Rows, found: Buffers, x: Array, scan: int, row: ScaledRows
) -> float:
    """Residuals and variances of a scan.

    Returns minus the sum of ln h over the rows that are not censored, which their densities need.
    """
    a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
    values = found.log_f[geometry.row_polarization[a]]
    log_f = at_rows(geometry, values, a, row.log_f[a:b])
    y, residual, rise = rows.y[a:b], row.residual[a:b], row.rise[a:b]
    jacobian = 0.0
    if rows.floor2 == 0.0:
        for i in range(y.size):
            residual[i] = y[i] - log_f[i]
    else:
        fill_scaled(
            y, log_f, rows.u2[a:b], x[rows.noise_column[scan]] ** 2, rows.floor2, residual,
            row.above[a:b], row.extra[a:b], rise,
        )  # fmt: skip
        for i in range(y.size):
            jacobian += 0.0 if rows.censored[a + i] else rise[i]
    return jacobian


@compiled()
def compare_rows(
    geometry: Geometry, rows: Rows, found: Buffers, x: Array, row: ScaledRows
) -> float:
    """`compare_scan` of all scans."""
    jacobian = 0.0
    for scan in range(rows.noise_column.size):
        jacobian += compare_scan(geometry, rows, found, x, scan, row)
    return jacobian


@compiled()
def add_scaled_scan(
    geometry: Geometry, rows: Rows, found: Buffers, x: Array, scan: int, row: ScaledRows,
    by_row: Array, sums: Array, out: Array,
) -> float:  # fmt: skip
    """Slopes of a scan: by its noise to ``out``, the rest to ``sums`` as `add_scan_slopes` does.

    ``by_row`` holds those by the mean and by the variance of every row; the first are replaced.
    """
    a, b = rows.scan_start[scan], rows.scan_start[scan + 1]
    column = rows.noise_column[scan]
    s_rel, by_log_f = x[column], by_row[0, a:b]
    by_s2 = slopes_by_log_f(
        s_rel * s_rel, row.residual[a:b], row.above[a:b], row.extra[a:b], rows.censored[a:b],
        by_log_f, by_row[1, a:b],
    )  # fmt: skip
    out[column] += 2.0 * s_rel * by_s2
    return add_scan_slopes(geometry, found, a, by_log_f, sums)


@compiled()
def add_to_parameters(sums: Array, weight: float, surf: Surface, out: Array) -> None:
    """Add the slopes by the four parameters, from sums of `add_scan_slopes`."""
    physical = np.empty(4)
    to_parameters(sums[0], sums[1], sums[2], surf, physical)
    out[0] += physical[0]
    out[1] += physical[1]
    out[2] += weight / surf.sigma_n0
    out[3] += physical[3]


@compiled()
def add_row_slopes(
    geometry: Geometry, rows: Rows, found: Buffers, surf: Surface, x: Array, row: ScaledRows,
    by_row: Array, out: Array,
) -> None:  # fmt: skip
    """Slopes of all scans by the four parameters and the noises, as for `add_scaled_scan`."""
    sums, weight = np.zeros(3), 0.0
    for scan in range(rows.noise_column.size):
        weight += add_scaled_scan(geometry, rows, found, x, scan, row, by_row, sums, out)
    add_to_parameters(sums, weight, surf, out)
