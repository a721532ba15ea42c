"""All diffuse terms together: what each adds to the BRDF and to the DHR of the surface.

A term is a module of this folder with its BRDF, its hemispherical part and its source. It has one
line in each function here; a term whose strength is zero is not computed. A term that is singular
close to some direction names that direction in `back_cosines`, for a detector of finite aperture.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.effects.backscatter import (
    backscatter_brdf,
    backscatter_dhr,
    backscatter_pole,
)
from pbrdf_bayes.physics.effects.bulk import bulk_brdf, bulk_dhr, escape
from pbrdf_bayes.physics.effects.lambert import lambert_brdf
from pbrdf_bayes.physics.effects.volume import volume_brdf, volume_dhr, volume_pole
from pbrdf_bayes.physics.fresnel import Surface
from pbrdf_bayes.physics.scene import EffectValues

Array = NDArray[np.float64]


class Shared(NamedTuple):
    """What the hemispherical parts of one parameter set share at all angles of incidence."""

    escaped: float
    """Of `pbrdf_bayes.physics.effects.bulk.escape`; 0 without bulk scatter."""


@compiled()
def shared_by_angles(effects: EffectValues, surf: Surface) -> Shared:
    """Computed once for many `diffuse_dhr`."""
    return Shared(escape(surf) if effects.bulk > 0.0 else 0.0)


@compiled()
def fill_diffuse(
    sine_i: float, cosine_i: float, polar: Array, a: int, b: int, effects: EffectValues,
    surf: Surface, out: tuple[Array, Array],
) -> None:  # fmt: skip
    """BRDF [sr^-1] beside the surface of the directions a to b, for s and p illumination.

    Rows of ``polar`` are sine and cosine of theta_r and the cosine of the phase angle.
    """
    f_s, f_p = out
    sine, cosine, cos_g = polar[0][a:b], polar[1][a:b], polar[2][a:b]
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
def diffuse_dhr(
    theta_i: float, sine_i: float, cosine_i: float, effects: EffectValues, surf: Surface,
    shared: Shared,
) -> tuple[float, float]:  # fmt: skip
    """DHR [1] beside the surface for s and p illumination."""
    s = p = 0.0
    same = effects.lambert
    if effects.bulk > 0.0:
        s, p = bulk_dhr(sine_i, cosine_i, effects.bulk, shared.escaped, surf)
    if effects.volume > 0.0:
        same += volume_dhr(theta_i, effects.volume, effects.asymmetry)
    if effects.backscatter > 0.0:
        same += backscatter_dhr(theta_i, effects.backscatter, effects.backscatter_width)
    return s + same, p + same


@compiled()
def most_diffuse(effects: EffectValues, surf: Surface) -> float:
    """An upper bound of `diffuse_dhr` at any angle, zero without diffuse terms."""
    bulk = effects.bulk / (surf.transmittance0 * surf.transmittance0)
    return effects.lambert + bulk + 4.0 * effects.volume + effects.backscatter


@compiled()
def back_cosines(effects: EffectValues) -> tuple[float, float]:
    """Cosines of the phase angle, beyond 1, at which a term is singular; inf for none."""
    of_volume = of_backscatter = inf
    if effects.volume > 0.0 and effects.asymmetry > 0.0:
        of_volume = volume_pole(effects.asymmetry)
    if effects.backscatter > 0.0:
        of_backscatter = backscatter_pole(effects.backscatter_width)
    return of_volume, of_backscatter
