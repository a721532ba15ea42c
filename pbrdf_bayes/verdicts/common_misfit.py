"""Whether the scans share one misfit, where the likelihood takes those of two scans as independent.

An error of the goniometer's scale, of the detector or of the line shape bends all scans alike. It
does not average out over them, as misfits of their own would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.likelihood.correlated import Discrepancy
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.discrepancy import (
    Process,
    Scanned,
    draw_prior_discrepancy,
    smoother,
)
from pbrdf_bayes.inference.prediction.residuals import law_of_rows, scan_of_rows
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.verdict import (
    COMMON_SIZE,
    COMMON_WARN,
    FALSE_ALARM,
    PASS,
    WARN,
)
from pbrdf_bayes.words import judged

Array = NDArray[np.float64]

_ANGLES = 41
_REPLICATES = 300


@dataclass(frozen=True)
class CommonMisfit:
    """How far the misfits of the scans move together.

    Attributes
    ----------
    correlation : float
        Mean of the products of two of them over the mean of their squares [1]: 0 where they have
        nothing in common, 1 where they are the same.
    p_value : float
        Probability of that much, or more, between independent ones of the same law.
    n_groups : int
        Groups of scans, each with a misfit of its own.
    size : float
        Amplitude of the misfits over the white noise [1].
    """

    correlation: float
    p_value: float
    n_groups: int
    size: float


def compare_misfits(posterior: Posterior, x: Array, *, seed: int) -> CommonMisfit | None:
    """Compare the misfits that are left at one parameter set.

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_par,)
        Physical units, most of all the MAP.
    seed : int
        Of the independent misfits that are drawn for comparison.

    Returns
    -------
    CommonMisfit or None
        None without a correlated discrepancy, with a single group, or where no range of theta_r is
        common to all groups.

    Notes
    -----
    The parameters have been fitted to the misfit, and take part of what is common; those drawn for
    comparison have not. The p-value is rather too large for that.
    """
    law, rows = posterior.discrepancy, posterior.rows
    if law is None:
        return None
    data = _scanned(posterior, law, x)
    wanted = _common_angles(data)
    if wanted.size == 0:
        return None
    process = Process(
        float(x[law.tau_column]), float(x[law.ell_column]), float(np.sqrt(rows.u_cal2)),
        rough=law.groups.rough,
    )  # fmt: skip
    groups = np.unique(data.group)
    smooth = smoother(
        data.theta_r_deg, data.group, data.scan, wanted_deg=np.tile(wanted, groups.size),
        wanted_group=np.repeat(groups, wanted.size), rough=process.rough,
    )  # fmt: skip

    def correlation(residual: Array) -> float:
        return _correlation(
            smooth(residual, data.variance, process)[0].reshape(groups.size, wanted.size)
        )

    rng = np.random.default_rng([seed, 21])
    found = correlation(data.residual)
    drawn = [correlation(_independent(data, process, rng)) for _ in range(_REPLICATES)]
    beyond = sum(value >= found for value in drawn)
    size = process.tau / float(np.sqrt(np.median(data.variance)))
    return CommonMisfit(found, (beyond + 1) / (_REPLICATES + 1), groups.size, size)


def judge_common(found: CommonMisfit) -> Check:
    """WARN where misfits that matter are alike by more than chance would have it."""
    alike = found.p_value < FALSE_ALARM and found.correlation > COMMON_WARN
    shared = alike and found.size > COMMON_SIZE
    return judged(
        "common_misfit", found.correlation, COMMON_WARN, WARN if shared else PASS,
        n=found.n_groups, p=found.p_value,
    )  # fmt: skip


def _scanned(posterior: Posterior, law: Discrepancy, x: Array) -> Scanned:
    """Residuals and variances of the rows as the filter sees them, but for the censored ones."""
    rows, scan = posterior.rows, scan_of_rows(posterior)
    brdf = posterior.predict(x[None, :])[0][0]
    mean, h, variance = law_of_rows(posterior, x, brdf)
    all_rows = Scanned(
        posterior.measurement.brdf.theta_r_deg, law.group_of_scan[scan], scan,
        (rows.y - mean) / h, variance / (h * h),
    )  # fmt: skip
    return Scanned._make(column[~rows.censored] for column in all_rows)


def _common_angles(data: Scanned) -> Array:
    """Angles in the range of all groups [deg]; empty where there is none."""
    groups = np.unique(data.group)
    if groups.size < 2:
        return np.zeros(0)
    low = max(data.theta_r_deg[data.group == g].min() for g in groups)
    high = min(data.theta_r_deg[data.group == g].max() for g in groups)
    return np.linspace(low, high, _ANGLES) if high > low else np.zeros(0)


def _correlation(paths: Array) -> float:
    """Mean product of two rows over the mean square of them."""
    n, squares = len(paths), float(np.mean(paths**2))
    pairs = float(np.mean(np.sum(paths, axis=0) ** 2)) - n * squares
    return pairs / (n * (n - 1) * squares) if squares > 0.0 else 0.0


def _independent(data: Scanned, process: Process, rng: np.random.Generator) -> Array:
    """Residuals of the same rows with misfits of their own, gains and noise drawn from the law."""
    path = draw_prior_discrepancy(process, rng, theta_r_deg=data.theta_r_deg, group=data.group)
    gain = process.u_cal * rng.standard_normal(int(data.scan.max()) + 1)
    noise = np.sqrt(data.variance) * rng.standard_normal(path.size)
    return np.asarray(path + gain[data.scan] + noise)
