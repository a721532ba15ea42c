"""What is asked for beyond the four-parameter model, and the values of one parameter set."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.lobes.line_shapes import LINE_SHAPES
from pbrdf_bayes.physics.lobes.shaped import FRESNEL_AT

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class EffectValues(NamedTuple):
    """The values of one parameter set beyond the four parameters."""

    nu: float
    eta: float
    narrowing: float
    lambert: float
    bulk: float
    volume: float
    asymmetry: float
    backscatter: float
    backscatter_width: float
    dhr_offset: float
    scale_p: float
    leakage: float
    offset_theta_i_deg: float
    offset_theta_r_deg: float
    aperture_deg: float


NULL = EffectValues(
    nu=1.0, eta=1.0, narrowing=1.0, lambert=0.0, bulk=0.0, volume=0.0, asymmetry=0.45,
    backscatter=0.0, backscatter_width=0.05, dhr_offset=0.0, scale_p=1.0, leakage=0.0,
    offset_theta_i_deg=0.0, offset_theta_r_deg=0.0, aperture_deg=0.0,
)  # fmt: skip
"""The values that do nothing."""
_NULL = np.array(NULL)


class Scene(NamedTuple):
    """What is asked for."""

    line_shape: int
    """Code of `pbrdf_bayes.physics.lobes.line_shapes`."""
    fresnel_at: int
    """Where the Fresnel factor of a lobe is taken, see `shaped_lobes`."""
    column: Index
    """For each field of `EffectValues` its column in the array of parameter sets; -1 for none."""


def make_scene(line_shape: str, fresnel_at: str, names: tuple[str, ...]) -> Scene:
    """What is asked for, with parameters in the columns that have their names.

    Parameters
    ----------
    line_shape : str
        Of `pbrdf_bayes.physics.lobes.line_shapes.LINE_SHAPES`.
    fresnel_at : str
        Of `pbrdf_bayes.physics.lobes.shaped.FRESNEL_AT`.
    names : tuple of str
        Names of the columns of parameter sets.
    """
    columns = [names.index(name) if name in names else -1 for name in EffectValues._fields]
    codes = LINE_SHAPES[line_shape], FRESNEL_AT[fresnel_at]
    return Scene(*codes, np.array(columns, dtype=np.int64))


@compiled()
def effects_of(scene: Scene, x: Array) -> EffectValues:
    """Values of a parameter set, null where nothing is asked for."""
    v = _NULL.copy()
    for i in range(v.size):
        if scene.column[i] >= 0:
            v[i] = x[scene.column[i]]
    return EffectValues(
        v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13],
        v[14],
    )  # fmt: skip
