"""The model with line shapes and effects, for those who ask for them.

    measured_q = (1 - l) f_q + l f_q',      f_q = surface_q + diffuse_q
    surface_q  = sigma_N0 F_q(theta_i) / I_q A_q B_q'
    DHR_q      = sigma_N0 F_q(theta_i) + integral of diffuse_q over the projected hemisphere

The surface is that of Eqs. (2)-(5) with the lobes of `pbrdf_bayes.physics.shaped_lobes`; diffuse
terms are those of `pbrdf_bayes.physics.effects`; l is the leakage of the polariser. What is not
asked for is not computed, and without anything asked for this module is not called at all.

Instrument: the angles of the goniometer may be off by an offset each, a detector of finite aperture
sees the mean over a range of theta_r, and p scans may have a scale of their own.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.brdf import Buffers, buffers, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.directions import fill_directions
from pbrdf_bayes.physics.effects.backscatter import backscatter_brdf, backscatter_dhr
from pbrdf_bayes.physics.effects.bulk import bulk_brdf, bulk_dhr, escape
from pbrdf_bayes.physics.effects.lambert import lambert_brdf
from pbrdf_bayes.physics.effects.volume import volume_brdf, volume_dhr
from pbrdf_bayes.physics.elementary import exp, log
from pbrdf_bayes.physics.fresnel import Surface, reflectances, surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.line_shapes import VOIGT
from pbrdf_bayes.physics.normalisation import (
    VALUES,
    Incidence,
    Workspace,
    incidence,
    workspace,
)
from pbrdf_bayes.physics.scene import EffectValues, Scene, effects_of
from pbrdf_bayes.physics.shaped_lobes import Lobe, lobe, shaped_log_lobes
from pbrdf_bayes.physics.shaped_normalisation import (
    ShapedWorkspace,
    shaped_cumulative,
    shaped_integrals,
    shaped_workspace,
)

Array = NDArray[np.float64]

_DEGREE = pi / 180.0
_TINIEST = 1e-280
_LARGEST_THETA_I = 89.95 * _DEGREE
_BLUR, _BLUR_WEIGHT = np.polynomial.legendre.leggauss(7)


class _Work(NamedTuple):
    """Arrays of one evaluation, allocated once for many."""

    lobes: ShapedWorkspace
    directions: Array
    angles: Array
    f: Array
    """(2, n_directions): BRDF of s and p."""
    scale: Array
    """(n_incidence, 2): DHR over norm of s and p."""
    diffuse: Array
    """(2, n_directions): BRDF of s and p beside the surface."""
    polar: Array
    """(3, n_directions): see `_fill_polar`."""
    quadrature: Workspace
    strict: Buffers


@compiled()
def _make_work(geometry: Geometry) -> _Work:
    n, n_incidence = geometry.directions.shape[1], geometry.incidences.shape[0]
    polar = np.empty((3, n))
    _fill_polar(geometry.angles, polar)
    return _Work(
        shaped_workspace(), geometry.directions.copy(), geometry.angles.copy(), np.empty((2, n)),
        np.empty((n_incidence, 2)), np.empty((2, n)), polar, workspace(),
        buffers(n, n_incidence, VALUES),
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
    work = _make_work(geometry)
    for i in range(n_sets):
        x = parameters[i]
        surf = surface(x[0], x[1], x[2], x[3])
        effects = effects_of(scene, x)
        _fill_brdf(geometry, scene, effects, surf, digits, work, log_f[i])
        _fill_dhr(geometry, effects, surf, dhr[i])
    return log_f, dhr


def evaluate_with_effects(
    geometry: Geometry, scene: Scene, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """BRDF [sr^-1] and DHR [1] of the rows, as `pbrdf_bayes.physics.brdf.evaluate` gives them."""
    log_f, dhr = evaluate_scene(geometry, scene, parameters, digits)
    return np.exp(log_f[:, geometry.row_polarization, geometry.row_direction]), dhr


@compiled(nogil=True)
def conserves_energy(geometry: Geometry, scene: Scene, parameters: Array) -> NDArray[np.bool_]:
    """Which parameter sets reflect no more than they receive, shape (n_sets,).

    At the angles of incidence of the readings, and with (nearly) grazing light, for s and for p.
    """
    result = np.empty(parameters.shape[0], dtype=np.bool_)
    for i in range(parameters.shape[0]):
        x = parameters[i]
        surf = surface(x[0], x[1], x[2], x[3])
        result[i] = _largest_dhr(geometry, effects_of(scene, x), surf) <= 1.0
    return result


@compiled()
def _fill_brdf(
    geometry: Geometry, scene: Scene, effects: EffectValues, surf: Surface, digits: float,
    work: _Work, out: Array,
) -> None:  # fmt: skip
    """Ln BRDF of s, p, u into ``out`` (3, n_directions)."""
    if geometry.start.size <= 1:
        return
    aperture = effects.aperture_deg * _DEGREE
    n_nodes = _BLUR.size if aperture > 0.0 else 1
    moved = n_nodes > 1 or effects.offset_theta_i_deg != 0.0 or effects.offset_theta_r_deg != 0.0
    if not moved and scene.strict_lobes:
        log_brdf(geometry, surf, digits, VALUES, work.quadrature, work.strict)
        _add_diffuse(geometry, effects, surf, work)
    else:
        work.f[:] = 0.0
        parameter = effects.eta if scene.line_shape == VOIGT else effects.nu
        shaped = lobe(scene.line_shape, parameter, effects.narrowing, scene.fresnel_at)
        cumulative = shaped_cumulative(surf, shaped, digits, work.lobes)
        for node in range(n_nodes):
            blur = aperture * _BLUR[node] if n_nodes > 1 else 0.0
            weight = 0.5 * _BLUR_WEIGHT[node] if n_nodes > 1 else 1.0
            if moved:
                _move(geometry.angles, effects, blur, work.angles)
                fill_directions(work.angles[0], work.angles[1], work.angles[2], work.directions)
                _fill_polar(work.angles, work.polar)
            for j in range(geometry.start.size - 1):
                inc = incidence(work.angles[0, geometry.start[j]])
                if node == 0:
                    norm_s, norm_p = shaped_integrals(
                        inc, surf, shaped, cumulative, digits, work.lobes
                    )
                    f_s, f_p = reflectances(inc.sine, inc.cosine, surf)
                    work.scale[j, 0] = surf.sigma_n0 * f_s / norm_s
                    work.scale[j, 1] = surf.sigma_n0 * f_p / norm_p
                _add_group(geometry, j, inc, effects, surf, shaped, weight, work)
    _fill_logs(geometry, effects, work.f, out)


@compiled()
def _add_diffuse(geometry: Geometry, effects: EffectValues, surf: Surface, work: _Work) -> None:
    """BRDF of the strict lobes, as they are in the work, and of the diffuse terms."""
    for j in range(geometry.start.size - 1):
        a, b = geometry.start[j], geometry.start[j + 1]
        sine, cosine = geometry.incidences[j, 0], geometry.incidences[j, 1]
        _fill_diffuse(sine, cosine, a, b, effects, surf, work)
        for q in range(2):
            log_f, more, f = work.strict.log_f[q][a:b], work.diffuse[q][a:b], work.f[q][a:b]
            for i in range(f.size):
                f[i] = exp(log_f[i]) + more[i]


@compiled()
def _fill_diffuse(
    sine_i: float, cosine_i: float, a: int, b: int, effects: EffectValues, surf: Surface,
    work: _Work,
) -> None:  # fmt: skip
    """BRDF [sr^-1] beside the surface of the directions a to b, for s and p illumination."""
    f_s, f_p = work.diffuse[0][a:b], work.diffuse[1][a:b]
    sine, cosine, cos_g = work.polar[0][a:b], work.polar[1][a:b], work.polar[2][a:b]
    same = lambert_brdf(effects.lambert)
    for i in range(f_s.size):
        f_s[i] = f_p[i] = same
    if effects.bulk > 0.0:
        for i in range(f_s.size):
            s, p = bulk_brdf(sine_i, cosine_i, sine[i], cosine[i], effects.bulk, surf)
            f_s[i] += s
            f_p[i] += p
    if effects.volume > 0.0:
        for i in range(f_s.size):
            f = volume_brdf(cosine_i, cosine[i], cos_g[i], effects.volume, effects.asymmetry)
            f_s[i] += f
            f_p[i] += f
    if effects.backscatter > 0.0:
        for i in range(f_s.size):
            f = backscatter_brdf(cos_g[i], effects.backscatter, effects.backscatter_width)
            f_s[i] += f
            f_p[i] += f


@compiled()
def _fill_polar(angles: Array, out: Array) -> None:
    """Sine and cosine of theta_r, and the cosine of the angle between source and detector."""
    for i in range(angles.shape[1]):
        sine, cosine = np.sin(angles[1, i]), max(np.cos(angles[1, i]), 0.0)
        out[0, i] = abs(sine)
        out[1, i] = cosine
        out[2, i] = np.cos(angles[0, i]) * cosine
        out[2, i] -= np.sin(angles[0, i]) * sine * np.cos(angles[2, i])


@compiled()
def _move(angles: Array, effects: EffectValues, blur: float, out: Array) -> None:
    """Angles as they were, not as they were read; (3, n) both."""
    for i in range(angles.shape[1]):
        theta_i = angles[0, i] + effects.offset_theta_i_deg * _DEGREE
        theta_r = angles[1, i] + effects.offset_theta_r_deg * _DEGREE + blur
        mirrored = theta_i < 0.0  # the same plane seen from its other side
        out[0, i] = min(abs(theta_i), _LARGEST_THETA_I)
        out[1, i] = min(max(-theta_r if mirrored else theta_r, -0.5 * pi), 0.5 * pi)
        out[2, i] = angles[2, i]


@compiled()
def _add_group(
    geometry: Geometry, j: int, inc: Incidence, effects: EffectValues, surf: Surface, shaped: Lobe,
    weight: float, work: _Work,
) -> None:  # fmt: skip
    """Add weight times the BRDF of the directions of one angle of incidence."""
    a, b = geometry.start[j], geometry.start[j + 1]
    scale_s, scale_p = work.scale[j, 0], work.scale[j, 1]
    _fill_diffuse(inc.sine, inc.cosine, a, b, effects, surf, work)
    peak_s, peak_p = shaped_log_lobes(0.0, 1.0, 0.0, 1.0, surf, shaped)
    g = work.directions
    for i in range(a, b):
        log_s, log_p = shaped_log_lobes(g[0, i], g[1, i], g[2, i], g[3, i], surf, shaped)
        if geometry.in_plane[j]:
            across_s, across_p = peak_s, peak_p
        else:
            across_s, across_p = shaped_log_lobes(g[4, i], g[5, i], g[6, i], g[7, i], surf, shaped)
        work.f[0, i] += weight * (scale_s * np.exp(log_s + across_p) + work.diffuse[0, i])
        work.f[1, i] += weight * (scale_p * np.exp(log_p + across_s) + work.diffuse[1, i])


@compiled()
def _fill_logs(geometry: Geometry, effects: EffectValues, f: Array, out: Array) -> None:
    """Polariser and scale of p; logarithms of s, p and, where asked for, their mean."""
    leak, scale = effects.leakage, effects.scale_p
    f_s, f_p = f[0], f[1]
    log_s, log_p, log_u = out[0], out[1], out[2]
    if leak > 0.0 or scale != 1.0:
        for i in range(f_s.size):
            s, p = f_s[i], f_p[i]
            f_s[i] = (1.0 - leak) * s + leak * p
            f_p[i] = scale * ((1.0 - leak) * p + leak * s)
    for i in range(f_s.size):
        log_s[i] = log(max(f_s[i], _TINIEST))
    for i in range(f_s.size):
        log_p[i] = log(max(f_p[i], _TINIEST))
    if geometry.unpolarised.any():
        for i in range(f_s.size):
            log_u[i] = log(max(0.5 * (f_s[i] + f_p[i]), _TINIEST))


@compiled()
def _dhr(
    theta_i: float, sine: float, cosine: float, effects: EffectValues, surf: Surface, escaped: float
) -> tuple[float, float]:
    """DHR of s and p [1] as the sample has it."""
    s, p = reflectances(sine, cosine, surf)
    s, p = surf.sigma_n0 * s, surf.sigma_n0 * p
    same = effects.lambert
    if effects.bulk > 0.0:
        bulk_s, bulk_p = bulk_dhr(sine, cosine, effects.bulk, escaped, surf)
        s += bulk_s
        p += bulk_p
    if effects.volume > 0.0:
        same += volume_dhr(theta_i, effects.volume, effects.asymmetry)
    if effects.backscatter > 0.0:
        same += backscatter_dhr(theta_i, effects.backscatter, effects.backscatter_width)
    return s + same, p + same


@compiled()
def _fill_dhr(geometry: Geometry, effects: EffectValues, surf: Surface, out: Array) -> None:
    """DHR of the rows as the instrument reads it, into ``out`` (n_dhr,)."""
    escaped = escape(surf) if effects.bulk > 0.0 else 0.0
    leak = effects.leakage
    for i in range(out.size):
        s, p = _dhr(
            geometry.dhr_theta_i[i], geometry.dhr_sine[i], geometry.dhr_cosine[i], effects, surf,
            escaped,
        )  # fmt: skip
        q = geometry.dhr_polarization[i]
        share = 1.0 - leak if q == 0 else leak if q == 1 else 0.5
        out[i] = share * s + (1.0 - share) * p + effects.dhr_offset


@compiled()
def _largest_dhr(geometry: Geometry, effects: EffectValues, surf: Surface) -> float:
    """Largest DHR of s and p over all angles of incidence of the readings, and at grazing.

    Each term has an upper bound; where even their sum is below 1 that is enough.
    """
    in_t0 = effects.bulk / (surf.transmittance0 * surf.transmittance0)
    most = surf.sigma_n0 + effects.lambert + in_t0 + 4.0 * effects.volume + effects.backscatter
    if most <= 1.0 or most == surf.sigma_n0:
        return min(most, 1.0)
    escaped = escape(surf) if effects.bulk > 0.0 else 0.0
    edge = incidence(_LARGEST_THETA_I)
    largest = max(*_dhr(edge.theta, edge.sine, edge.cosine, effects, surf, escaped))
    for i in range(geometry.incidences.shape[0]):
        row = geometry.incidences[i]
        largest = max(largest, *_dhr(row[2], row[0], row[1], effects, surf, escaped))
    for i in range(geometry.dhr_sine.size):
        sine, cosine = geometry.dhr_sine[i], geometry.dhr_cosine[i]
        largest = max(largest, *_dhr(geometry.dhr_theta_i[i], sine, cosine, effects, surf, escaped))
    return largest
