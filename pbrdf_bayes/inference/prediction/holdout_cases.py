"""Angles of incidence left out one by one, and one polarisation predicted from the other.

Each part is fitted quickly, from the optimum of the whole fit: a climb, Laplace's approximation,
importance sampling at draft accuracy. The draws of the whole fit are too narrow a proposal for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import MapResult, Optimum, climb, coordinate_bounds
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.inference.prediction.holdout import (
    LEAST_SHARE,
    N_DRAWS,
    Holdout,
    draft_of,
    draw_quickly,
    score_prediction,
)
from pbrdf_bayes.inference.sampling.sampling import sample_posterior
from pbrdf_bayes.measurement import Measurement, select_scans
from pbrdf_bayes.quantities import S_AND_P
from pbrdf_bayes.words import say

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_MOST_ANGLES = 8
_MAX_STEPS = 400


@dataclass(frozen=True, eq=False)
class Case:
    """Which scans and DHR readings are fitted, and which scans are predicted.

    Attributes
    ----------
    kind : {"angle", "polarization"}
    name, fitted : str
    keep, predict : ndarray of bool, shape (n_scans,)
    dhr : ndarray of bool, shape (n_dhr,)
    """

    kind: str
    name: str
    fitted: str
    keep: Flags
    predict: Flags
    dhr: Flags


def list_cases(measurement: Measurement) -> tuple[Case, ...]:
    """Every angle of incidence left out, then p from s and s from p.

    Empty where there is one angle only, and not both polarisations. Of more than eight angles an
    even choice with the first and the last.
    """
    theta_i = np.array([scan.theta_i_deg for scan in measurement.scans])
    q = np.array([scan.polarization for scan in measurement.scans], dtype=np.str_)
    with_dhr = "DHR and " if len(measurement.dhr) else ""
    every = np.ones(len(measurement.dhr), dtype=bool)
    cases = []
    angles = np.unique(theta_i)
    if angles.size > 1:
        chosen = np.linspace(0, angles.size - 1, min(angles.size, _MOST_ANGLES)).round()
        for angle in angles[chosen.astype(int)].tolist():
            out = theta_i == angle
            cases.append(
                Case("angle", f"{angle:g} deg", f"{with_dhr}the other angles", ~out, out, every)
            )
    if {"s", "p"} <= set(q.tolist()):
        for fitted, predicted in (S_AND_P, S_AND_P[::-1]):
            own = measurement.dhr.polarization == fitted
            words = f"{fitted} scans" + (f" and DHR of {fitted}" if own.any() else "")
            cases.append(
                Case(
                    "polarization", f"{predicted} from {fitted}", words, q == fitted,
                    q == predicted, own,
                )
            )  # fmt: skip
    return tuple(cases)


def why_no_angle_left_out(measurement: Measurement, wanted: str) -> str:
    """Reason or remedy, to follow "not tested", of a run with this ``holdout``; may be empty."""
    if not any(case.kind == "angle" for case in list_cases(measurement)):
        return say("applicability.one_angle")
    return "" if wanted == "all" else say("applicability.not_asked")


def run_cases(
    posterior: Posterior, best: Array, cases: Sequence[Case], *, seed: int
) -> tuple[Holdout, ...]:
    """Fit and predict every case, as many at a time as the configuration has threads.

    Parameters
    ----------
    posterior : Posterior
        Of all readings.
    best : ndarray, shape (n_par,)
        Its optimum, where each fit begins.
    cases : sequence of Case
    seed : int

    Returns
    -------
    tuple of Holdout
    """

    def run(case: Case) -> Holdout:
        return _run_case(posterior, best, case, seed)

    with (
        threadpool_limits(limits=1, user_api="blas"),
        ThreadPoolExecutor(posterior.config.threads) as pool,
    ):
        return tuple(pool.map(run, cases))


def _run_case(whole: Posterior, best: Array, case: Case, seed: int) -> Holdout:
    m = whole.measurement
    part = select_scans(m, case.keep, dhr=case.dhr)
    posterior = build_posterior(part, replace(draft_of(whole.config, part), threads=1))
    columns = [whole.parameter_names.index(name) for name in posterior.parameter_names]
    picked = _draw(posterior, best[columns], seed)
    left_out = select_scans(m, case.predict, dhr=False)
    found = score_prediction(posterior, picked, left_out, np.random.default_rng([seed, 11]))
    return replace(
        found, kind=case.kind, name=case.name, fitted=case.fitted,
        statement=say(
            "holdout.case", fitted=case.fitted, name=case.name, rms=found.rms_dex,
            percent=100.0 * found.coverage_90, width=found.width_dex,
        ),
    )  # fmt: skip


def _draw(posterior: Posterior, start: Array, seed: int) -> Array:
    """Draws by importance sampling; by ensembles where its weights cannot be relied on."""
    low, high = coordinate_bounds(posterior)
    top, value = climb(posterior, posterior.to_coordinates(start[None, :])[0], low, high)
    best = Optimum(posterior.from_coordinates(top[None, :])[0], value, 1)
    laplace = laplace_mixture(posterior, MapResult((best,), 1, 0))
    mixture, z = draw_quickly(posterior, laplace, seed)
    if z is not None:
        return posterior.from_coordinates(z)
    config = replace(posterior.config, max_steps=min(posterior.config.max_steps, _MAX_STEPS))
    found = sample_posterior(
        posterior, mixture, config, method="psis", seed=seed, least_share=LEAST_SHARE
    )
    chosen = np.random.default_rng([seed, 12]).choice(len(found.flat), N_DRAWS)
    return np.asarray(found.flat[chosen])
