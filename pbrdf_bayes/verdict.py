"""The thresholds of all verdicts, and how a number is graded."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, isnan

MISFIT_WARN_DEX = 0.05
MISFIT_FAIL_DEX = 0.10
NOISE_RATIO_WARN = 3.0
SMALLEST_MISFIT_DEX = 0.005
"""However well readings repeat, less than this is no misfit."""
HELD_OUT_FAIL_DEX = 0.10
DHR_WARN, DHR_FAIL = 0.10, 0.30
"""Rms of DHR readings about the model beyond their stated noise, over the rms of the readings."""
_NOISE_MARGIN = 1.1
"""For the noise is itself an estimate."""
LAG1_WARN = 0.2
LAG1_FAIL = 0.5
DISCREPANCY_WARN = 0.08
DISCREPANCY_FAIL = 0.15
COMMON_WARN = 0.3
"""Mean correlation of the misfits of scans that are taken as independent."""
COMMON_SIZE = 0.5
"""Amplitude of a misfit over the white noise from which it matters whether scans share it."""
CONTRACTION_WARN = 0.5
BOUND_SHARE_WARN = 0.2
BOUND_QUANTILE = 0.01
BOUND_REACH = 3.0
"""Of a flat prior: standard deviations of the posterior from its mean to a bound it reaches."""
BOUND_NEAR, BOUND_NEAR_LOG = 1e-3, 0.03
"""Share of a range, and of a value that moves in its logarithm, that is the bound itself."""
COVERAGE_WARN = (0.82, 0.97)
COVERAGE_CHANCE = 0.005
RIVAL_NATS = 12.0
SURPRISE_LIMIT = 1.5
"""Hold-out rms over the 95 % quantile of what the prediction leads to expect. 1.5 of those is 2.9
standard deviations of an error that all readings share: by chance in three of a thousand."""
FALSE_ALARM = 0.01
"""Probability of a false alarm shared by all readings, or by all scans (Bonferroni)."""
K_HAT_LIMIT = 0.7
"""Pareto k-hat above which importance weights are not relied on."""
INFLUENCE_WARN = K_HAT_LIMIT
PIT_DISTANCE = 0.05
"""Kolmogorov distance that matters, however many readings prove it."""
SENSITIVE = 0.05
"""Power scaling: Kallioinen et al. 2024, doi:10.1007/s11222-023-10366-5."""
DISPLACED = 2.0
"""Posterior mean from the middle of the prior, in its standard deviations."""

PASS, WARN, FAIL = "PASS", "WARN", "FAIL"


def misfit_limit_dex(repeatability_dex: float) -> float:
    """Rms beyond which a fit is worse than the readings repeat; infinite where that is not known.

    Examples
    --------
    >>> misfit_limit_dex(0.01), misfit_limit_dex(0.0), misfit_limit_dex(float("nan"))
    (0.03, 0.005, inf)
    """
    if isnan(repeatability_dex):
        return inf
    return max(NOISE_RATIO_WARN * repeatability_dex, SMALLEST_MISFIT_DEX)


def beside_noise(limit_dex: float, noise_dex: float) -> float:
    """Rms that readings of such noise have about a curve that is off by a limit [dex].

    Examples
    --------
    >>> round(beside_noise(0.10, 0.003), 3), round(beside_noise(0.10, 0.25), 3)
    (0.1, 0.293)
    """
    return limit_dex if isnan(noise_dex) else hypot(limit_dex, _NOISE_MARGIN * noise_dex)


def grade(value: float, warn: float, fail: float) -> str:
    """FAIL above one limit, WARN above the lower one."""
    return FAIL if value > fail else WARN if value > warn else PASS


def overall_verdict(verdicts: Sequence[str]) -> str:
    """The worst verdict."""
    return FAIL if FAIL in verdicts else WARN if WARN in verdicts else PASS
