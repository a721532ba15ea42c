"""The model with line shapes and effects, for those who ask for them.

    f_q        = surface_q + diffuse_q
    surface_q  = sigma_N0 F_q(theta_i) / I_q A_q B_q'
    DHR_q      = sigma_N0 F_q(theta_i) + integral of diffuse_q over the projected hemisphere

The surface is that of Eqs. (2)-(5) with the lobes of `pbrdf_bayes.physics.lobes.shaped`; diffuse
terms are those of `pbrdf_bayes.physics.effects`. The instrument then makes readings of both, see
`pbrdf_bayes.physics.instrument`; a detector of finite aperture sees the mean over a range of
theta_r, to which nothing comes from beyond the horizon. What is not asked for is not computed, and
without anything asked for this module is not called at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.aperture import (
    MOST_SEEN,
    MOST_SINGULARITIES,
    aperture_nodes,
    singularities,
)
from pbrdf_bayes.physics.brdf import Buffers, buffers, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.directions import fill_directions
from pbrdf_bayes.physics.effects.diffuse import fill_diffuse, shared_by_angles
from pbrdf_bayes.physics.elementary import exp
from pbrdf_bayes.physics.fresnel import Surface, reflectances, surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.hemispherical import sample_dhr
from pbrdf_bayes.physics.instrument import (
    DEGREE,
    dhr_reading,
    fill_log_readings,
    is_moved,
    move,
)
from pbrdf_bayes.physics.lobes.line_shapes import LORENTZIAN
from pbrdf_bayes.physics.lobes.shaped import (
    LOWEST_OF_ROW,
    MEAN_SINE,
    Lobe,
    Places,
    fill_shaped_lobes,
    lobe,
    shaped_log_lobes,
)
from pbrdf_bayes.physics.normalisation.plain import VALUES, Workspace, incidence, workspace
from pbrdf_bayes.physics.normalisation.shaped import (
    ShapedWorkspace,
    shaped_cumulative,
    shaped_integrals,
    shaped_workspace,
)
from pbrdf_bayes.physics.scene import EffectValues, Scene, effects_of

Array = NDArray[np.float64]


class _Where(NamedTuple):
    """Directions: fields of `Directions`, angles as in `Geometry`, and what `_fill_polar` makes."""

    directions: Array
    angles: Array
    polar: Array


class _Work(NamedTuple):
    """Arrays of one evaluation, allocated once for many."""

    lobes: ShapedWorkspace
    as_read: _Where
    moved: _Where
    f: Array
    """(2, n_directions): BRDF of s and p."""
    scale: Array
    """(n_incidence, 2): DHR over norm of s and p."""
    diffuse: Array
    """(2, n_directions): BRDF of s and p beside the surface."""
    quadrature: Workspace
    strict: Buffers
    seen: _Where
    """Directions within the aperture, ``weight`` of each, and their BRDF."""
    weight: Array
    seen_f: Array
    seen_diffuse: Array
    places: Array
    """(2, most): singularities of the BRDF along a scan."""
    rows: Array
    """(5, most): scratch of `_fill_group`."""


@compiled()
def _make_work(geometry: Geometry) -> _Work:
    n, n_incidence = geometry.directions.shape[1], geometry.incidences.shape[0]
    as_read = _Where(geometry.directions, geometry.angles, np.empty((3, n)))
    _fill_polar(as_read.angles, as_read.polar)
    moved = _Where(np.empty((8, n)), np.empty((3, n)), np.empty((3, n)))
    return _Work(
        shaped_workspace(), as_read, moved, np.empty((2, n)), np.empty((n_incidence, 2)),
        np.empty((2, n)), workspace(), buffers(n, n_incidence, VALUES),
        _Where(np.empty((8, MOST_SEEN)), np.empty((3, MOST_SEEN)), np.empty((3, MOST_SEEN))),
        np.empty(MOST_SEEN), np.empty((2, MOST_SEEN)), np.empty((2, MOST_SEEN)),
        np.empty((2, MOST_SINGULARITIES)), np.empty((5, max(n, MOST_SEEN))),
    )  # fmt: skip


@compiled(nogil=True)
def evaluate_scene(
    geometry: Geometry, scene: Scene, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """Logarithm of the BRDF at the distinct directions, and the DHR of the rows.

    Parameters
    ----------
    geometry : Geometry
    scene : Scene
    parameters : ndarray, shape (n_sets, n_par)
        The first four columns are n, k, sigma_n0, rho0.
    digits : float
        Correct decimal digits of the normalisation.

    Returns
    -------
    tuple of ndarray, shapes (n_sets, 3, n_directions) and (n_sets, n_dhr)
        ln BRDF of s, p and, where a row asks for it, u; DHR.
    """
    n_sets = parameters.shape[0]
    log_f = np.empty((n_sets, 3, geometry.directions.shape[1]))
    dhr = np.empty((n_sets, geometry.dhr_sine.size))
    work, sample = _make_work(geometry), np.empty((2, dhr.shape[1]))
    for i in range(n_sets):
        x = parameters[i]
        surf = surface(x[0], x[1], x[2], x[3])
        effects = effects_of(scene, x)
        _fill_brdf(geometry, scene, effects, surf, digits, work, log_f[i])
        _fill_dhr(geometry, effects, surf, sample, dhr[i])
    return log_f, dhr


def evaluate_with_effects(
    geometry: Geometry, scene: Scene, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """BRDF [sr^-1] and DHR [1] of the rows, as `pbrdf_bayes.physics.brdf.evaluate` gives them."""
    log_f, dhr = evaluate_scene(geometry, scene, parameters, digits)
    return np.exp(log_f[:, geometry.row_polarization, geometry.row_direction]), dhr


@compiled()
def _fill_brdf(
    geometry: Geometry, scene: Scene, effects: EffectValues, surf: Surface, digits: float,
    work: _Work, out: Array,
) -> None:  # fmt: skip
    """Ln BRDF of s, p, u into ``out`` (3, n_directions)."""
    if geometry.start.size <= 1:
        return
    moved = is_moved(effects)
    lorentzian = scene.line_shape == LORENTZIAN and scene.fresnel_at == MEAN_SINE
    if lorentzian and effects.narrowing == 1.0 and not moved:
        log_brdf(geometry, surf, digits, VALUES, work.quadrature, work.strict)
        _add_diffuse(geometry, effects, surf, work)
    else:
        parameter = effects[scene.shape_field] if scene.shape_field >= 0 else 1.0
        shaped = lobe(scene.line_shape, parameter, effects.narrowing, scene.fresnel_at)
        where = work.moved if moved else work.as_read
        _fill_shaped(geometry, effects, surf, shaped, where, moved, digits, work)
    fill_log_readings(effects, work.f, bool(geometry.unpolarised.any()), out)


@compiled()
def _fill_shaped(
    geometry: Geometry, effects: EffectValues, surf: Surface, shaped: Lobe, where: _Where,
    moved: bool, digits: float, work: _Work,
) -> None:  # fmt: skip
    """BRDF with general lobes, as the detector sees it from where the goniometer is."""
    if moved:
        move(geometry.angles, effects, where.angles)
        theta_i, theta_r, phi_r = where.angles[0], where.angles[1], where.angles[2]
        fill_directions(theta_i, theta_r, phi_r, where.directions)
        _fill_polar(where.angles, where.polar)
    _fill_scales(geometry, surf, shaped, where, digits, work)
    for j in range(geometry.start.size - 1):
        a, b, in_plane = geometry.start[j], geometry.start[j + 1], geometry.in_plane[j]
        if effects.aperture_deg > 0.0:
            _see(a, b, j, in_plane, effects, surf, shaped, where, digits, work)
        else:
            f_s, f_p, more = work.f[0][a:b], work.f[1][a:b], _rows(work.diffuse, a, b)
            _fill_group(
                a, j, in_plane, effects, surf, shaped, where, work.scale, more, work.rows, f_s, f_p
            )


@compiled(inline=True)
def _rows(both: Array, a: int, b: int) -> tuple[Array, Array]:
    """Elements a to b of the rows of s and p."""
    return both[0][a:b], both[1][a:b]


@compiled()
def _see(
    a: int, b: int, j: int, in_plane: bool, effects: EffectValues, surf: Surface, shaped: Lobe,
    where: _Where, digits: float, work: _Work,
) -> None:  # fmt: skip
    """Means of the BRDF over the aperture around the directions a to b, of the incidence j."""
    theta_i, theta_r, phi_r = where.angles[0, a], where.angles[1], where.angles[2]
    half, nodes, weight, azimuth = (
        effects.aperture_deg * DEGREE, work.seen.angles[1], work.weight, work.seen.angles[2],
    )  # fmt: skip
    n_places, first, n, end = 0, a, 0, np.empty(b - a, np.int64)
    for i in range(a, b):
        if i == a or phi_r[i] != phi_r[i - 1]:
            places = work.places
            n_places = singularities(theta_i, phi_r[i], effects, surf, shaped, digits, places)
        last = aperture_nodes(theta_r[i], half, n_places, work.places, digits, n, nodes, weight)
        azimuth[n:last] = phi_r[i]
        n = end[i - a] = last
        if n > MOST_SEEN // 2 or i == b - 1:
            work.seen.angles[0][:n] = theta_i
            _fill_means(
                n, end[first - a : i + 1 - a], first, j, in_plane, effects, surf, shaped, work
            )
            first, n = i + 1, 0


@compiled()
def _fill_means(
    n: int, end: NDArray[np.int64], first: int, j: int, in_plane: bool, effects: EffectValues,
    surf: Surface, shaped: Lobe, work: _Work,
) -> None:  # fmt: skip
    """Means over ``n`` nodes: those of the first direction end at ``end[0]``, and so on."""
    angles, directions, polar = work.seen.angles, work.seen.directions, work.seen.polar
    fill_directions(angles[0][:n], angles[1][:n], angles[2][:n], directions[:, :n])
    _fill_polar(angles[:, :n], polar[:, :n])
    f_s, f_p, more = work.seen_f[0][:n], work.seen_f[1][:n], _rows(work.seen_diffuse, 0, n)
    _fill_group(
        0, j, in_plane, effects, surf, shaped, work.seen, work.scale, more, work.rows, f_s, f_p
    )
    weight, node = work.weight, 0
    for i in range(end.size):
        total_s = total_p = 0.0
        while node < end[i]:
            total_s += weight[node] * f_s[node]
            total_p += weight[node] * f_p[node]
            node += 1
        work.f[0, first + i], work.f[1, first + i] = total_s, total_p


@compiled()
def _fill_scales(
    geometry: Geometry, surf: Surface, shaped: Lobe, where: _Where, digits: float, work: _Work
) -> None:
    """DHR of the surface over its norm at every angle of incidence."""
    cumulative = shaped_cumulative(surf, shaped, digits, work.lobes)
    for j in range(geometry.start.size - 1):
        inc = incidence(where.angles[0, geometry.start[j]])
        norm_s, norm_p = shaped_integrals(inc, surf, shaped, cumulative, digits, work.lobes)
        f_s, f_p = reflectances(inc.sine, inc.cosine, surf)
        work.scale[j, 0] = surf.sigma_n0 * f_s / norm_s
        work.scale[j, 1] = surf.sigma_n0 * f_p / norm_p


@compiled()
def _add_diffuse(geometry: Geometry, effects: EffectValues, surf: Surface, work: _Work) -> None:
    """BRDF of the strict lobes, as they are in the work, and of the diffuse terms."""
    for j in range(geometry.start.size - 1):
        a, b = geometry.start[j], geometry.start[j + 1]
        sine, cosine = geometry.incidences[j, 0], geometry.incidences[j, 1]
        diffuse = _rows(work.diffuse, a, b)
        fill_diffuse(sine, cosine, work.as_read.polar, a, b, effects, surf, diffuse)
        for q in range(2):
            log_f, more, f = work.strict.log_f[q][a:b], diffuse[q], work.f[q][a:b]
            for i in range(f.size):
                f[i] = exp(log_f[i]) + more[i]


@compiled()
def _fill_polar(angles: Array, out: Array) -> None:
    """Sine and cosine of theta_r, and the cosine of the angle between source and detector."""
    theta_i = phi_r = sine_i = cosine_i = along = 0.0
    for i in range(angles.shape[1]):
        if i == 0 or angles[0, i] != theta_i or angles[2, i] != phi_r:  # a scan has one of each
            theta_i, phi_r = angles[0, i], angles[2, i]
            sine_i, cosine_i, along = np.sin(theta_i), np.cos(theta_i), np.cos(phi_r)
        sine, cosine = np.sin(angles[1, i]), max(np.cos(angles[1, i]), 0.0)
        out[0, i] = abs(sine)
        out[1, i] = cosine
        out[2, i] = cosine_i * cosine - sine_i * sine * along


@compiled()
def _fill_group(
    a: int, j: int, in_plane: bool, effects: EffectValues, surf: Surface, shaped: Lobe,
    where: _Where, scale: Array, diffuse: tuple[Array, Array], rows: Array, f_s: Array, f_p: Array,
) -> None:  # fmt: skip
    """BRDF of s and p of the directions from a on, of the incidence j; ``rows`` is scratch."""
    more_s, more_p = diffuse
    b = a + f_s.size
    theta_i, g = where.angles[0, a], where.directions
    sine_i, cosine_i = np.sin(theta_i), np.cos(theta_i)
    fill_diffuse(sine_i, cosine_i, where.polar, a, b, effects, surf, diffuse)
    n, ones, lowest = f_s.size, rows[0][: f_s.size], LOWEST_OF_ROW
    ones[:] = 1.0
    w2_s, w2_p = rows[1][:n], rows[2][:n]
    along = Places(g[0][a:b], g[1][a:b], g[2][a:b], g[3][a:b], ones)
    fill_shaped_lobes(along, sine_i, cosine_i, surf, shaped, lowest, w2_s, w2_p, f_s, f_p)
    if in_plane:
        log_s, log_p = shaped_log_lobes(0.0, 1.0, 0.0, 1.0, surf, shaped)
        scale_s, scale_p = scale[j, 0] * np.exp(log_p), scale[j, 1] * np.exp(log_s)
        for i in range(n):
            f_s[i] = scale_s * f_s[i] + more_s[i]
            f_p[i] = scale_p * f_p[i] + more_p[i]
    else:
        scale_s, scale_p = scale[j, 0], scale[j, 1]
        b_s, b_p = rows[3][:n], rows[4][:n]
        across = Places(g[4][a:b], g[5][a:b], g[6][a:b], g[7][a:b], ones)
        fill_shaped_lobes(across, 0.0, 1.0, surf, shaped, lowest, w2_s, w2_p, b_s, b_p)
        for i in range(n):
            f_s[i] = scale_s * (f_s[i] * b_p[i]) + more_s[i]
            f_p[i] = scale_p * (f_p[i] * b_s[i]) + more_p[i]


@compiled()
def _fill_sample_dhr(geometry: Geometry, effects: EffectValues, surf: Surface, out: Array) -> None:
    """DHR of s and p of the sample at the angles of the rows, into ``out`` (2, n_dhr)."""
    shared = shared_by_angles(effects, surf)
    for i in range(out.shape[1]):
        first = geometry.dhr_first[i]
        if first < i:
            out[0, i], out[1, i] = out[0, first], out[1, first]
        else:
            sine, cosine = geometry.dhr_sine[i], geometry.dhr_cosine[i]
            out[0, i], out[1, i] = sample_dhr(
                geometry.dhr_theta_i[i], sine, cosine, effects, surf, shared
            )


@compiled()
def _fill_dhr(
    geometry: Geometry, effects: EffectValues, surf: Surface, sample: Array, out: Array
) -> None:
    """DHR of the rows as the instrument reads it, into ``out`` (n_dhr,)."""
    _fill_sample_dhr(geometry, effects, surf, sample)
    for i in range(out.size):
        out[i] = dhr_reading(effects, geometry.dhr_polarization[i], sample[0, i], sample[1, i])
