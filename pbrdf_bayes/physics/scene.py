"""What is asked for beyond the four-parameter model, and the values of one parameter set."""

from __future__ import annotations

from collections import namedtuple
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from pbrdf_bayes.effects_table import (
    EFFECT_PARAMETERS,
    FRESNEL_AT,
    LINE_SHAPES,
    EffectFields,
)
from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FIELDS = tuple(EFFECT_PARAMETERS)
"""Parameters beyond the four, in the order of `EffectValues`."""

if TYPE_CHECKING:

    class EffectValues(EffectFields):
        """The values of one parameter set beyond the four parameters, a named tuple."""

        def __init__(self, *values: float) -> None: ...
        def __getitem__(self, i: int) -> float: ...

else:
    EffectValues = namedtuple("EffectValues", FIELDS)

_NULL = np.array([p.null for p in EFFECT_PARAMETERS.values()])
_N_FIELDS = _NULL.size
NULL = EffectValues(*_NULL.tolist())
"""The values that do nothing."""


class Scene(NamedTuple):
    """What is asked for."""

    line_shape: int
    """Code of `pbrdf_bayes.physics.lobes.line_shapes`."""
    shape_field: int
    """Which field of `EffectValues` is the parameter of the line shape; -1 for none."""
    fresnel_at: int
    """Where the Fresnel factor of a lobe is taken, see `pbrdf_bayes.physics.lobes.shaped`."""
    column: Index
    """For each field of `EffectValues` its column in the array of parameter sets; -1 for none."""


def make_scene(line_shape: str, fresnel_at: str, names: tuple[str, ...]) -> Scene:
    """What is asked for, with parameters in the columns that have their names.

    Parameters
    ----------
    line_shape : str
        Of `pbrdf_bayes.effects_table.LINE_SHAPES`.
    fresnel_at : str
        Of `pbrdf_bayes.effects_table.FRESNEL_AT`.
    names : tuple of str
        Names of the columns of parameter sets.
    """
    columns = [names.index(name) if name in names else -1 for name in FIELDS]
    parameter = LINE_SHAPES[line_shape].parameter
    return Scene(
        tuple(LINE_SHAPES).index(line_shape), FIELDS.index(parameter) if parameter else -1,
        FRESNEL_AT.index(fresnel_at), np.array(columns, dtype=np.int64),
    )  # fmt: skip


@compiled()
def effects_of(scene: Scene, x: Array) -> EffectValues:
    """Values of a parameter set, null where nothing is asked for."""
    v = _NULL.copy()
    for i in range(v.size):
        if scene.column[i] >= 0:
            v[i] = x[scene.column[i]]
    return EffectValues(*to_fixed_tuple(v, _N_FIELDS))
