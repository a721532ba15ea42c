"""Values of another model in place of those of the four parameters, for the same likelihoods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.brdf import Buffers, fill_dhr, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.normalisation.plain import VALUES, Workspace

Array = NDArray[np.float64]


class Given(NamedTuple):
    """Ln BRDF (n_sets, 3, n_directions) and DHR (n_sets, n_dhr) from another model, or nothing."""

    log_f: Array
    dhr: Array


NOTHING_GIVEN = Given(np.empty((0, 3, 0)), np.empty((0, 0)))
"""The model is that of the four parameters."""


@compiled()
def fill_model(
    geometry: Geometry, given: Given, i: int, x: Array, digits: float, ws: Workspace,
    found: Buffers, dhr: Array,
) -> None:  # fmt: skip
    """Ln BRDF and DHR of parameter set ``i``, computed from its values ``x`` or as given."""
    if given.log_f.shape[0] > 0:
        found.log_f[:] = given.log_f[i]
        dhr[:] = given.dhr[i]
    else:
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, VALUES, ws, found)
        fill_dhr(geometry, surf, dhr)
