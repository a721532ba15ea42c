"""Which curves a run predicts, and whether its readings lie inside their bands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import (
    Bands,
    Targets,
    expand_scales,
    inside_band,
    predict_bands,
    targets_at,
)
from pbrdf_bayes.quantities import POLARIZATIONS, S_AND_P

Array = NDArray[np.float64]

_CURVE_STEP_DEG = 1.0
_CURVE_LIMIT_DEG = 85.0
_DHR_ANGLES_DEG = np.linspace(0.0, 88.0, 89)


def predict_curves(
    posterior: Posterior, draws: Array, x_map: Array, rng: np.random.Generator
) -> tuple[Targets, NDArray[np.bool_], Bands]:
    """Curves at every measured incidence, s and p (u where measured), and between them."""
    scans = posterior.measurement.scans
    measured = {(s.theta_i_deg, s.phi_r_deg, s.polarization) for s in scans}
    geometries = sorted({(theta, phi) for theta, phi, _ in measured})
    wanted = [
        (theta, phi, q)
        for theta, phi in geometries
        for q in POLARIZATIONS
        if q in S_AND_P or (theta, phi, q) in measured
    ]
    between = posterior.config.predict_theta_i_deg or angles_between([g[0] for g in geometries])
    wanted += [(theta, 0.0, q) for theta in between for q in S_AND_P]
    grid = np.arange(-_CURVE_LIMIT_DEG, _CURVE_LIMIT_DEG + 0.5, _CURVE_STEP_DEG)
    targets = Targets(
        polarization=np.repeat([q for _, _, q in wanted], grid.size),
        theta_i_deg=np.repeat([theta for theta, _, _ in wanted], grid.size),
        theta_r_deg=np.tile(grid, len(wanted)),
        phi_r_deg=np.repeat([phi for _, phi, _ in wanted], grid.size),
    )
    flags = np.repeat([key in measured for key in wanted], grid.size)
    return targets, flags, predict_bands(posterior, draws, x_map, targets, rng)


def angles_between(measured_deg: Sequence[float]) -> tuple[float, ...]:
    """Up to three incidence angles that were not measured: the middles of the widest gaps [deg]."""
    if not measured_deg:
        return (20.0, 45.0, 70.0)
    distinct = sorted({0.0, *measured_deg, 80.0})
    gaps = sorted(pairwise(distinct), key=lambda g: (g[0] - g[1], g[0]))
    middles = [round(0.5 * (a + b), 1) for a, b in gaps[:3] if b - a >= 5.0]
    return tuple(sorted(middles))


def predict_dhr(
    posterior: Posterior, draws: Array, x_map: Array, rng: np.random.Generator
) -> tuple[Targets, NDArray[np.bool_], Bands]:
    """DHR against the angle of incidence, s and p (u where some reading is unpolarised)."""
    words = ["s", "p"]
    if (
        "u" in posterior.measurement.dhr.polarization
        or "u" in posterior.measurement.brdf.polarization
    ):
        words.append("u")
    n = _DHR_ANGLES_DEG.size
    targets = Targets(
        polarization=np.repeat(words, n),
        theta_i_deg=np.tile(_DHR_ANGLES_DEG, len(words)),
        theta_r_deg=np.full(n * len(words), np.nan),
        phi_r_deg=np.zeros(n * len(words)),
    )
    flags = np.zeros(n * len(words), dtype=bool)
    return targets, flags, predict_bands(posterior, draws, x_map, targets, rng)


def count_covered(
    posterior: Posterior, draws: Array, x_map: Array, scales: Array | None, rng: np.random.Generator
) -> tuple[int, int]:
    """Number of BRDF readings inside the 90 % predictive band, and of readings looked at."""
    brdf = posterior.measurement.brdf
    if not len(brdf):
        return 0, 0
    every = max(1, ceil(len(brdf) / 20_000))
    targets = targets_at(brdf, every=every)
    scales = expand_scales(scales, posterior.measurement, every=every)
    band = predict_bands(posterior, draws, x_map, targets, rng, scales=scales).predictive
    inside = inside_band(brdf.value[::every], band, posterior.config.brdf_floor, rng)
    return int(inside.sum()), inside.size
