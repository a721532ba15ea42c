"""How large the correlated misfit came out, and what independent readings would have claimed."""

from __future__ import annotations

from dataclasses import replace
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.parameters.table import DISCREPANCY
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.records.summary import DiscrepancySize
from pbrdf_bayes.verdict import (
    DISCREPANCY_FAIL,
    DISCREPANCY_WARN,
    FAIL,
    grade,
)
from pbrdf_bayes.words import judged

Array = NDArray[np.float64]

_N_STARTS = 4


def measure_discrepancy(posterior: Posterior, draws: Array, *, seed: int) -> DiscrepancySize | None:
    """Size of the discrepancy; None where the readings are taken as independent.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Physical units.
    seed : int
        Of the starts of the i.i.d. fit.

    Returns
    -------
    DiscrepancySize or None
    """
    if posterior.discrepancy is None:
        return None
    measurement = posterior.measurement
    median = dict(zip(posterior.parameter_names, np.median(draws, axis=0).tolist(), strict=True))
    theta_r = measurement.brdf.theta_r_deg
    sd = dict(zip(posterior.parameter_names, draws.std(axis=0, ddof=1).tolist(), strict=True))
    physical = [spec.name for spec in posterior.specs if spec.kind == "physical"]
    claimed = _sd_if_independent(posterior, seed)
    return DiscrepancySize(
        tau=median["tau"],
        ell_deg=median["ell_deg"],
        span_deg=max(float(np.ptp(theta_r[scan.rows])) for scan in measurement.scans),
        white_noise=max(v for name, v in median.items() if name.startswith("s_rel_")),
        size_dex=median["tau"] / log(10.0),
        size_percent=100.0 * (exp(median["tau"]) - 1.0),
        sd={name: sd[name] for name in physical},
        sd_if_independent={name: claimed[name] for name in physical},
    )


def _sd_if_independent(posterior: Posterior, seed: int) -> dict[str, float]:
    """Laplace standard deviations of all parameters under the i.i.d. likelihood."""
    config = posterior.config
    priors = {name: table for name, table in config.priors.items() if name not in DISCREPANCY}
    plain = build_posterior(posterior.measurement, replace(config, noise="iid", priors=priors))
    optima = find_map(plain, n_starts=_N_STARTS, seed=seed)
    factor = laplace_mixture(plain, optima).factors[0]
    free = optima.best.x[plain.free]
    sd = np.sqrt(np.sum(factor**2, axis=1)) * np.where(plain.is_log, free, 1.0)
    names = [plain.parameter_names[i] for i in plain.free]
    return dict(zip(names, sd.tolist(), strict=True))


def judge_size(found: DiscrepancySize) -> Check:
    """Too large, or so long that it is a second level of the scan: the model does not apply."""
    too_long = found.tau > DISCREPANCY_WARN and found.ell_deg > 0.5 * found.span_deg
    verdict = FAIL if too_long else grade(found.tau, DISCREPANCY_WARN, DISCREPANCY_FAIL)
    factors = [found.sd[name] / found.sd_if_independent[name] for name in found.sd]
    return judged(
        "discrepancy", found.tau, DISCREPANCY_FAIL, verdict, dex=found.size_dex,
        percent=found.size_percent, length=found.ell_deg, noise=100.0 * found.white_noise,
        low=min(factors), high=max(factors),
    )  # fmt: skip
