"""DHR of a sample with its diffuse terms, and whether it reflects no more than it receives.

    DHR_q(theta_i) = sigma_N0 F_q(theta_i) + integral of diffuse_q over the projected hemisphere

The largest DHR is looked for at fixed angles of incidence, whatever was measured or asked for: on a
grid from normal to grazing, at Brewster's angle atan|m|, where bulk scatter of p light peaks, and,
where that comes close to 1, by golden section about the best of them.
"""

from __future__ import annotations

from math import atan, cos, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.effects.diffuse import (
    Shared,
    diffuse_dhr,
    most_diffuse,
    shared_by_angles,
)
from pbrdf_bayes.physics.fresnel import Surface, reflectances, surface
from pbrdf_bayes.physics.scene import EffectValues, Scene, effects_of

Array = NDArray[np.float64]

LARGEST_THETA_I_DEG = 89.95
_GRID = np.deg2rad([*range(0, 90, 10), 85.0, 88.0, LARGEST_THETA_I_DEG])
_CLOSE = 0.95
"""Largest DHR on the grid from which on its maximum between the angles is looked for."""
_STEPS = 16
_GOLDEN = 0.5 * (sqrt(5.0) - 1.0)


@compiled()
def sample_dhr(
    theta_i: float, sine: float, cosine: float, effects: EffectValues, surf: Surface, shared: Shared
) -> tuple[float, float]:
    """DHR of s and p [1] as the sample has it, Eq. (2) and the diffuse terms."""
    f_s, f_p = reflectances(sine, cosine, surf)
    s, p = diffuse_dhr(theta_i, sine, cosine, effects, surf, shared)
    return surf.sigma_n0 * f_s + s, surf.sigma_n0 * f_p + p


@compiled(nogil=True)
def conserves_energy(scene: Scene, parameters: Array) -> NDArray[np.bool_]:
    """Which parameter sets reflect no more than they receive, shape (n_sets,).

    For s and for p at every angle of incidence up to (nearly) grazing.
    """
    result = np.empty(parameters.shape[0], dtype=np.bool_)
    for i in range(parameters.shape[0]):
        result[i] = largest_dhr(scene, parameters[i])[0] <= 1.0
    return result


@compiled(nogil=True)
def largest_dhr(scene: Scene, x: Array) -> tuple[float, float, int]:
    """The largest DHR of s and p [1], its angle of incidence [rad], 0 for s and 1 for p.

    Each term has an upper bound; where even their sum is below 1 it is that sum, at no angle.
    """
    surf, effects = surface(x[0], x[1], x[2], x[3]), effects_of(scene, x)
    most = surf.sigma_n0 + most_diffuse(effects, surf)
    if most <= 1.0 or most == surf.sigma_n0:
        return min(most, 1.0), 0.0, 0
    shared = shared_by_angles(effects, surf)
    brewster = min(atan(hypot(surf.n, surf.k)), _GRID[-1])
    largest, at_angle, of = -1.0, 0.0, 0
    on_grid = np.empty((2, _GRID.size + 1))
    for j in range(_GRID.size + 1):
        theta = _GRID[j] if j < _GRID.size else brewster
        on_grid[0, j], on_grid[1, j] = sample_dhr(
            theta, sin(theta), cos(theta), effects, surf, shared
        )
    for q in range(2):
        j = int(np.argmax(on_grid[q]))
        found, theta = on_grid[q, j], _GRID[j] if j < _GRID.size else brewster
        if _CLOSE < found <= 1.0:
            found, theta = _between(theta, q, found, effects, surf, shared)
        if found > largest:
            largest, at_angle, of = found, theta, q
    return largest, at_angle, of


@compiled()
def _between(
    at: float, q: int, largest: float, effects: EffectValues, surf: Surface, shared: Shared
) -> tuple[float, float]:
    """The maximum of the DHR of polarisation q between the angles of the grid next to ``at``."""
    low, high = 0.0, _GRID[-1]
    for angle in _GRID:
        if angle < at:
            low = angle
    for angle in _GRID[::-1]:
        if angle > at:
            high = angle
    place = at
    inner = high - _GOLDEN * (high - low)
    outer = low + _GOLDEN * (high - low)
    f_inner = sample_dhr(inner, sin(inner), cos(inner), effects, surf, shared)[q]
    f_outer = sample_dhr(outer, sin(outer), cos(outer), effects, surf, shared)[q]
    for _ in range(_STEPS):
        if f_inner > f_outer:
            high, outer, f_outer = outer, inner, f_inner
            inner = high - _GOLDEN * (high - low)
            f_inner = sample_dhr(inner, sin(inner), cos(inner), effects, surf, shared)[q]
            found, angle = f_outer, outer
        else:
            low, inner, f_inner = inner, outer, f_outer
            outer = low + _GOLDEN * (high - low)
            f_outer = sample_dhr(outer, sin(outer), cos(outer), effects, surf, shared)[q]
            found, angle = f_inner, inner
        if found > largest:
            largest, place = found, angle
    return largest, place
