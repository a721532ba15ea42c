"""What the stages of a fit produced, as one record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.optimum.map_fit import MapResult
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import Bands, Targets
from pbrdf_bayes.inference.prediction.holdout import Holdout
from pbrdf_bayes.inference.prediction.leave_one_out import LeaveOneOut
from pbrdf_bayes.inference.prediction.residuals import Residuals
from pbrdf_bayes.inference.prediction.scan_widths import ScanWidths
from pbrdf_bayes.inference.sampling.power_scaling import PriorSensitivity
from pbrdf_bayes.inference.sampling.sampling import Draws
from pbrdf_bayes.records.checks import Check, Finding
from pbrdf_bayes.records.summary import (
    Applicability,
    DiscrepancySize,
    EffectsChoice,
    ReciprocitySize,
)
from pbrdf_bayes.verdicts.diagnostics import Identifiability

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stages:
    """What the stages of a fit produced, before it is put together."""

    posterior: Posterior
    seed: int
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]
    optima: MapResult
    draws: Draws
    least_squares: tuple[Array, float]
    residuals: Residuals
    best_dex: Array
    identifiability: Identifiability
    diagnostics: tuple[Check, ...]
    curves: tuple[Targets, NDArray[np.bool_], Bands]
    dhr_curves: tuple[Targets, NDArray[np.bool_], Bands]
    sensitivity: PriorSensitivity
    leave_one_out: LeaveOneOut
    holdout: Holdout | None
    holdouts: tuple[Holdout, ...]
    scales: Array | None
    discrepancy: DiscrepancySize | None
    normalisation_error: float
    microseconds: float
    timings: Mapping[str, float]
    applicability: Applicability
    reciprocity: ReciprocitySize | None
    widths: ScanWidths
    effects_choice: EffectsChoice | None = None
