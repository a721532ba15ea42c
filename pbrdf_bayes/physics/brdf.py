"""The four-parameter polarised BRDF and the DHR, Eqs. (2)-(6), on prepared geometries.

    f_q(alpha_i; alpha, beta) = DHR_q(alpha_i) / I_q(alpha_i) * A_q(alpha; alpha_i) * B_q'(beta)
    DHR_q(alpha_i)            = sigma_N0 F_q(alpha_i)

Source: Renhorn, Hallberg, Bergstrom, Boreman, Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027. The limits of the integrals printed there in (2) and (4) mean the unit
disk. Every equation stands as printed in `pbrdf_bayes.physics.equations`. The paper calls the model
reciprocal; with (4) the norm depends on the angle of incidence and f(a -> b) differs from
f(b -> a): see `pbrdf_bayes.model.four_parameter.reciprocity_ratio`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import (
    TINIEST,
    LobeSlopes,
    Surface,
    lobe_slopes,
    reflectance_slopes,
    reflectances,
    surface,
)
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.normalisation.plain import (
    SLOPES,
    VALUES,
    Incidence,
    Workspace,
    expand_cumulative,
    fill_log_lobes,
    fill_slopes,
    integral_slopes,
    integrals,
    workspace,
)
from pbrdf_bayes.physics.normalisation.quadrature import expansion_order

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TINY = 1e-280
LOG_TINY = -640.0
"""What is below is zero."""
LOWEST = -645.0
LARGEST = 700.0


class Buffers(NamedTuple):
    """Results of one parameter set at the distinct directions, allocated once for many.

    ``log_f`` (3, n_directions) holds ln f of s and p, and that of u where some row asks for it:
    there ``share_s`` (n_directions) is the share of s in the mean of s and p. With slopes, the
    rows of ``lobes`` from the third on are d ln f_q/d (Re m^2, -Im m^2, width) of the lobes alone,
    and ``scale_slopes`` (n_incidence, 2, 3) that of the scales of s and p.
    """

    lobes: Array
    across: Array
    log_f: Array
    share_s: Array
    scale_slopes: Array
    norm_slopes: Array


@compiled()
def buffers(n_directions: int, n_incidence: int, n_series: int) -> Buffers:
    """Allocate the buffers."""
    n_rows = max(n_series, 5)
    return Buffers(
        np.empty((n_rows, n_directions)),
        np.empty((n_rows, n_directions)),
        np.empty((3, n_directions)),
        np.empty(n_directions),
        np.empty((n_incidence, 2, 3)),
        np.empty(6),
    )


@compiled()
def _log_or_less(x: float) -> float:
    """Ln x, and for zero less than anything that a lobe could lift above `LOG_TINY`."""
    return np.log(x) if x > TINY else 2.0 * LOG_TINY


@compiled()
def _add_logs(log_scale: float, log_lobe: Array, out: Array) -> None:
    for i in range(out.size):
        out[i] = max(log_scale + log_lobe[i], LOWEST)


@compiled()
def _log_mean(log_s: Array, log_p: Array, share_s: Array, out: Array) -> None:
    """Ln of the mean of s and p, Eq. (6), and the share that s has in it."""
    for i in range(out.size):
        p_to_s = exp(min(max(log_p[i] - log_s[i], -LARGEST), LARGEST))
        share_s[i] = 1.0 / (1.0 + p_to_s)
        out[i] = log_s[i] + log(0.5 + 0.5 * p_to_s)


@compiled()
def _fill_logs(
    geometry: Geometry, first: int, a: int, b: int, surf: Surface, n_series: int, out: Array
) -> None:
    """Logarithms of the lobes of s and p and, if asked for, their slopes."""
    if n_series == SLOPES:
        fill_slopes(geometry.directions, first, a, b, surf, out)
        for q in range(2):
            row = out[q][a:b]
            for i in range(row.size):
                row[i] = log(max(row[i], TINIEST))
    else:
        fill_log_lobes(geometry.directions, first, a, b, surf, 0.0, 0.0, -np.inf, out, out)


@compiled()
def _add_across(n_series: int, a: int, b: int, lobes: Array, across: Array) -> None:
    """Out of plane: A_s B_p and A_p B_s, as sums of logarithms and of their slopes."""
    for j in range(n_series):
        other = 1 - j if j < 2 else j + 3 if j < 5 else j - 3
        row, added = lobes[j][a:b], across[other][a:b]
        for i in range(row.size):
            row[i] += added[i]


@compiled()
def log_brdf(
    geometry: Geometry, surf: Surface, digits: float, n_series: int, ws: Workspace, out: Buffers
) -> None:
    """Ln f_q of Eq. (3) at every distinct direction, with slopes where ``n_series`` is SLOPES."""
    n_incidence = geometry.incidences.shape[0]
    if n_incidence == 0:
        return
    m = expansion_order(np.arcsinh(0.5 * np.pi / surf.rho0), digits)
    expand_cumulative(surf, m, n_series, ws)
    peak = lobe_slopes(0.0, 1.0, 0.0, 1.0, surf)
    for j in range(n_incidence):
        row = geometry.incidences[j]
        inc = Incidence(row[0], row[1], row[2], row[3])
        norm_s, norm_p, n_nodes = integrals(inc, surf, digits, m, n_series, ws)
        if n_series == SLOPES:
            _scale_slopes(
                inc, surf, n_nodes, norm_s, norm_p, ws, out.norm_slopes, out.scale_slopes[j]
            )
        f_s, f_p = reflectances(inc.sine, inc.cosine, surf)
        scale_s = surf.sigma_n0 * f_s / norm_s
        scale_p = surf.sigma_n0 * f_p / norm_p
        a, b = geometry.start[j], geometry.start[j + 1]
        flat = geometry.in_plane[j]
        add_s = _log_or_less(scale_s * peak.p if flat else scale_s)
        add_p = _log_or_less(scale_p * peak.s if flat else scale_p)
        if flat and n_series == VALUES:
            fill_log_lobes(
                geometry.directions, 0, a, b, surf, add_s, add_p, LOWEST, out.lobes, out.log_f
            )
        else:
            _fill_logs(geometry, 0, a, b, surf, n_series, out.lobes)
            if flat:
                _add_peak(peak, out.scale_slopes[j])
            else:
                _fill_logs(geometry, 4, a, b, surf, n_series, out.across)
                _add_across(n_series, a, b, out.lobes, out.across)
            _add_logs(add_s, out.lobes[0][a:b], out.log_f[0][a:b])
            _add_logs(add_p, out.lobes[1][a:b], out.log_f[1][a:b])
        if geometry.unpolarised[j]:
            log_s, log_p = out.log_f[0][a:b], out.log_f[1][a:b]
            _log_mean(log_s, log_p, out.share_s[a:b], out.log_f[2][a:b])


@compiled()
def _scale_slopes(
    inc: Incidence, surf: Surface, n_nodes: int, norm_s: float, norm_p: float, ws: Workspace,
    work: Array, out: Array,
) -> None:  # fmt: skip
    """Slopes of ln(F_q(theta_i) / I_q), into ``out`` (2, 3)."""
    integral_slopes(inc, n_nodes, ws, work)
    s_re, s_im, p_re, p_im = reflectance_slopes(inc.sine, inc.cosine, surf)
    out[0, 0] = s_re - work[0] / norm_s
    out[0, 1] = s_im - work[1] / norm_s
    out[0, 2] = -work[2] / norm_s
    out[1, 0] = p_re - work[3] / norm_p
    out[1, 1] = p_im - work[4] / norm_p
    out[1, 2] = -work[5] / norm_p


@compiled()
def _add_peak(peak: LobeSlopes, out: Array) -> None:
    """In plane f_s has the factor B_p(0), f_p has B_s(0)."""
    out[0, 0] += peak.p_re
    out[0, 1] += peak.p_im
    out[0, 2] += peak.p_width
    out[1, 0] += peak.s_re
    out[1, 1] += peak.s_im
    out[1, 2] += peak.s_width


@compiled()
def to_parameters(re: float, im: float, width: float, surf: Surface, out: Array) -> None:
    """Chain rule from (Re m^2, -Im m^2, width) to (n, k, sigma_n0, rho0); sigma_n0 is left alone.

    width = 4 rho0 / T0, T0 = 4 n / ((1 + n)^2 + k^2).
    """
    n, k = surf.n, surf.k
    width_n = surf.rho0 * (1.0 - (1.0 + k * k) / (n * n))
    width_k = 2.0 * surf.rho0 * k / n
    out[0] = 2.0 * (n * re + k * im) + width_n * width
    out[1] = 2.0 * (n * im - k * re) + width_k * width
    out[3] = width * surf.width / surf.rho0


@compiled()
def row_slopes(geometry: Geometry, found: Buffers, i: int) -> tuple[float, float, float]:
    """Slopes of ln f of row ``i`` by (Re m^2, -Im m^2, width)."""
    j, inc, q = geometry.row_direction[i], geometry.row_incidence[i], geometry.row_polarization[i]
    share = 1.0 if q == 0 else 0.0 if q == 1 else found.share_s[j]
    lobes_, scale = found.lobes, found.scale_slopes[inc]
    other = 1.0 - share
    return (
        share * (lobes_[2, j] + scale[0, 0]) + other * (lobes_[5, j] + scale[1, 0]),
        share * (lobes_[3, j] + scale[0, 1]) + other * (lobes_[6, j] + scale[1, 1]),
        share * (lobes_[4, j] + scale[0, 2]) + other * (lobes_[7, j] + scale[1, 2]),
    )


@compiled(inline=True)
def at_rows(geometry: Geometry, values: Array, first: int, out: Array) -> Array:
    """Values (n_directions) at the rows from ``first`` on, as many as ``out`` has.

    Rows whose directions follow one upon the other are seen in place; others go into ``out``.
    """
    start = geometry.row_direction[first]
    found = out
    if geometry.row_run[first] >= out.size:
        found = values[start : start + out.size]
    else:
        index = geometry.row_direction[first : first + out.size]
        for i in range(out.size):
            out[i] = values[index[i]]
    return found


@compiled(reassociate=True)
def _dots(weights: Array, a: Array, b: Array, c: Array) -> tuple[float, float, float]:
    sum_a = 0.0
    sum_b = 0.0
    sum_c = 0.0
    for i in range(weights.size):
        sum_a += weights[i] * a[i]
        sum_b += weights[i] * b[i]
        sum_c += weights[i] * c[i]
    return sum_a, sum_b, sum_c


@compiled(reassociate=True)
def sum_of(values: Array) -> float:
    """Sum of all values."""
    total = 0.0
    for i in range(values.size):
        total += values[i]
    return total


@compiled()
def add_scan_slopes(
    geometry: Geometry, found: Buffers, first: int, weights: Array, sums: Array
) -> float:
    """Add sum of weight times slope of ln f over the rows of one scan to ``sums`` (3,).

    ``first`` is the first row of the scan. Returns the sum of the weights.
    """
    q, inc, n = geometry.row_polarization[first], geometry.row_incidence[first], weights.size
    total = sum_of(weights)
    if q == 2 or geometry.row_run[first] < n:
        for i in range(n):
            re, im, width = row_slopes(geometry, found, first + i)
            sums[0] += weights[i] * re
            sums[1] += weights[i] * im
            sums[2] += weights[i] * width
        return total
    start, row, scale = geometry.row_direction[first], 2 + 3 * q, found.scale_slopes[inc, q]
    re, im, width = _dots(
        weights, found.lobes[row][start : start + n], found.lobes[row + 1][start : start + n],
        found.lobes[row + 2][start : start + n],
    )  # fmt: skip
    sums[0] += re + total * scale[0]
    sums[1] += im + total * scale[1]
    sums[2] += width + total * scale[2]
    return total


@compiled()
def _mix(q: int, s: float, p: float) -> float:
    return s if q == 0 else p if q == 1 else 0.5 * (s + p)


@compiled()
def fill_dhr(geometry: Geometry, surf: Surface, out: Array) -> None:
    """DHR of each row by Eq. (2), into ``out`` (n_dhr,)."""
    for i in range(out.size):
        f_s, f_p = reflectances(geometry.dhr_sine[i], geometry.dhr_cosine[i], surf)
        out[i] = surf.sigma_n0 * _mix(geometry.dhr_polarization[i], f_s, f_p)


@compiled()
def dhr_gradient(geometry: Geometry, surf: Surface, i: int, out: Array) -> None:
    """D DHR / d (n, k, sigma_n0, rho0) of row ``i``, into ``out`` (4,)."""
    q = geometry.dhr_polarization[i]
    sine, cosine = geometry.dhr_sine[i], geometry.dhr_cosine[i]
    f_s, f_p = reflectances(sine, cosine, surf)
    s_re, s_im, p_re, p_im = reflectance_slopes(sine, cosine, surf)
    re = _mix(q, f_s * s_re, f_p * p_re)
    im = _mix(q, f_s * s_im, f_p * p_im)
    to_parameters(surf.sigma_n0 * re, surf.sigma_n0 * im, 0.0, surf, out)
    out[2] = _mix(q, f_s, f_p)
    out[3] = 0.0


@compiled(nogil=True)
def evaluate(geometry: Geometry, parameters: Array, digits: float) -> tuple[Array, Array]:
    """BRDF and DHR of every row for every parameter set.

    Parameters
    ----------
    geometry : Geometry
    parameters : ndarray, shape (n_sets, >= 4)
        Columns n, k, sigma_n0, rho0; further columns are ignored.
    digits : float
        Correct decimal digits of the normalisation.

    Returns
    -------
    tuple of ndarray, shapes (n_sets, n_brdf) and (n_sets, n_dhr)
        BRDF [sr^-1] and DHR [1].
    """
    n_sets = parameters.shape[0]
    brdf = np.empty((n_sets, geometry.row_direction.size))
    dhr = np.empty((n_sets, geometry.dhr_sine.size))
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    ws = workspace()
    for i in range(n_sets):
        surf = surface(parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        log_brdf(geometry, surf, digits, VALUES, ws, found)
        for j in range(brdf.shape[1]):
            log_f = found.log_f[geometry.row_polarization[j], geometry.row_direction[j]]
            brdf[i, j] = np.exp(log_f) if log_f > LOG_TINY else 0.0
        fill_dhr(geometry, surf, dhr[i])
    return brdf, dhr


@compiled(nogil=True)
def evaluate_gradient(
    geometry: Geometry, parameters: Array, digits: float
) -> tuple[Array, Array, Array, Array]:
    """Logarithm of the BRDF, the DHR, and their derivatives by (n, k, sigma_n0, rho0).

    Parameters
    ----------
    geometry : Geometry
    parameters : ndarray, shape (n_sets, >= 4)
    digits : float

    Returns
    -------
    tuple of ndarray
        ln BRDF (n_sets, n_brdf), DHR (n_sets, n_dhr), d ln BRDF (n_sets, n_brdf, 4),
        d DHR (n_sets, n_dhr, 4).
    """
    n_sets = parameters.shape[0]
    n_brdf, n_dhr = geometry.row_direction.size, geometry.dhr_sine.size
    log_f = np.empty((n_sets, n_brdf))
    dhr = np.empty((n_sets, n_dhr))
    log_f_slopes = np.empty((n_sets, n_brdf, 4))
    dhr_slopes = np.empty((n_sets, n_dhr, 4))
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    ws = workspace()
    for i in range(n_sets):
        surf = surface(parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        log_brdf(geometry, surf, digits, SLOPES, ws, found)
        for j in range(n_brdf):
            log_f[i, j] = found.log_f[geometry.row_polarization[j], geometry.row_direction[j]]
            re, im, width = row_slopes(geometry, found, j)
            to_parameters(re, im, width, surf, log_f_slopes[i, j])
            log_f_slopes[i, j, 2] = 1.0 / surf.sigma_n0
        fill_dhr(geometry, surf, dhr[i])
        for j in range(n_dhr):
            dhr_gradient(geometry, surf, j, dhr_slopes[i, j])
    return log_f, dhr, log_f_slopes, dhr_slopes
