"""How far DHR readings are from the model, where their inferred noise would take it all up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.conditionals import dhr_conditionals
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.verdict import DHR_FAIL, DHR_WARN, grade
from pbrdf_bayes.words import judged

Array = NDArray[np.float64]


def measure_dhr_misfit(posterior: Posterior, x: Array) -> float:
    """Rms of the DHR readings about the model beyond their stated noise, over their own rms [1].

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_par,)
        Physical units, most of all the MAP.

    Returns
    -------
    float
        NaN without DHR readings. A gain that the readings of a polarisation share (`u_dhr_cal`) is
        taken from the others of them.
    """
    rows = posterior.rows
    if not rows.dhr.size:
        return float("nan")
    _, dhr = posterior.predict(x[None, :])
    away2 = dhr_conditionals(posterior, x[None, :], dhr).error[0] ** 2
    stated2 = np.maximum(rows.dhr_u2, 0.0)  # negative where it is inferred
    beyond = max(float(np.mean(away2) - np.mean(stated2)), 0.0)
    return float(np.sqrt(beyond / np.mean(rows.dhr**2)))


def judge_dhr(misfit: float) -> Check:
    """A verdict on `measure_dhr_misfit`."""
    verdict = grade(misfit, DHR_WARN, DHR_FAIL)
    return judged("dhr_misfit", misfit, DHR_FAIL, verdict, percent=100.0 * misfit)
