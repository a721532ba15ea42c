"""Conformity with tolerance limits from draws of the posterior.

The probability of conformity p_c of a measurand is the posterior mass inside its tolerance interval
(JCGM 106:2012, clause 7.1); that of a band of angles is the mass of the draws that are inside at
every angle at once, that of several limits the mass inside all of them: counted on the same draws,
nothing is multiplied. Estimate y and standard uncertainty u are mean and standard deviation of the
draws (JCGM 101:2008, 7.6). The verdict follows from the decision rule:

``simple`` (8.2)
    ACCEPT where y is inside the tolerance interval at every point, else REJECT.
``guard`` (8.3)
    ACCEPT where y is inside the limits moved in by g = k u, or by a length g, at every point
    (guarded acceptance, 8.3.2); REJECT where it is outside the limits moved out by g at any point
    (guarded rejection, 8.3.3); UNDECIDED between.
``risk``
    ACCEPT where the specific consumer's risk 1 - p_c (3.3.13) is at most its maximum; REJECT where
    the specific producer's risk p_c (3.3.14) is; else UNDECIDED.

With n effective draws no risk below 1 - 0.025**(1/n), about 3.7/n, can be shown (`smallest_risk`).
Whatever the Monte Carlo error of y, u or p_c leaves open at 95 % is UNDECIDED, and so is what a
reservation speaks against: a parameter of a model that does not apply has no true value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from pbrdf_bayes.config import ACCURACIES
from pbrdf_bayes.inference.arviz_adapter import ess_of_mean
from pbrdf_bayes.records.summary import Probability
from pbrdf_bayes.specification import DecisionRule
from pbrdf_bayes.words import say

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ACCEPT, REJECT, UNDECIDED = "ACCEPT", "REJECT", "UNDECIDED"
_Z = 1.96
_OUTSIDE = 0.025
ESS_FINEST = float(ACCURACIES["reference"].ess_target)
"""Effective draws of a fit of the highest accuracy, at least."""


@dataclass(frozen=True, eq=False)
class Measurand:
    """Draws of what a limit is on.

    Attributes
    ----------
    values : ndarray, shape (n_chains, n_draws, n_points)
    lower, upper : float
        Tolerance limits, infinite where there is none.
    guard : float or None
        Length of the guard band; None for a multiple of u.
    reservation : str
        Why no verdict may be given on it; empty where one may.
    """

    values: Array
    lower: float
    upper: float
    guard: float | None = None
    reservation: str = ""


@dataclass(frozen=True, eq=False)
class Judged:
    """Verdict on one limit.

    Attributes
    ----------
    verdict : {"ACCEPT", "REJECT", "UNDECIDED"}
    reason : str
        Why it is undecided; empty otherwise.
    remark : str
        What a decision that is made takes on; empty where its risk is at most a half.
    judged : bool
        No reservation speaks against a verdict.
    probability : Probability
        Of conformity.
    consumer_risk, producer_risk : float
        1 - p_c where accepted, p_c where rejected; else NaN.
    mean, sd, low, high, inside, guard : ndarray, shape (n_points,)
        Estimate, standard uncertainty, 95 % interval, probability of conformity at each point
        alone, length of the guard band.
    worst : int
        The point least probably inside, and of several such the one nearest to a limit beside u.
    """

    verdict: str
    reason: str
    remark: str
    judged: bool
    probability: Probability
    consumer_risk: float
    producer_risk: float
    mean: Array
    sd: Array
    low: Array
    high: Array
    inside: Array
    guard: Array
    worst: int


@dataclass(frozen=True)
class Overall:
    """Verdict on all limits together."""

    verdict: str
    reason: str
    remark: str
    probability: Probability
    consumer_risk: float
    producer_risk: float


class _Effective(NamedTuple):
    """Effective draws that there are, and that a fit of higher accuracy would have."""

    least: float
    finest: float


def count_probability(counts: Flags, ess_least: float) -> Probability:
    """Probability of an event from draws, with its Monte Carlo error.

    Parameters
    ----------
    counts : ndarray of bool, shape (n_chains, n_draws)
        Whether the event holds in a draw.
    ess_least : float
        Effective sample size that is not exceeded: that of the parameters. It is also the one of
        an event that no draw or every draw has, which does not tell its own.

    Returns
    -------
    Probability
        With k of n effective draws the 95 % limits are those of Clopper and Pearson, Biometrika
        26, 404 (1934), doi:10.1093/biomet/26.4.404: beyond a count of zero lies
        1 - 0.025**(1/n), not nothing.

    Examples
    --------
    >>> found = count_probability(np.ones((4, 250), dtype=bool), 1000.0)
    >>> found.value, round(found.low, 4), found.high
    (1.0, 0.9963, 1.0)
    """
    p = float(counts.mean())
    n = min(float(ess_least), float(counts.size))
    if 0.0 < p < 1.0:
        n = min(n, ess_of_mean(counts.astype(np.float64)))
    n = max(n, 1.0)
    k = p * n
    low = float(betaincinv(k, n - k + 1.0, _OUTSIDE)) if p > 0.0 else 0.0
    high = float(betaincinv(k + 1.0, n - k, 1.0 - _OUTSIDE)) if p < 1.0 else 1.0
    return Probability(p, sqrt(p * (1.0 - p) / n), low, high, n)


def probability_of_not(p: Probability) -> Probability:
    """That the event does not hold; with the same error."""
    return Probability(1.0 - p.value, p.u, 1.0 - p.high, 1.0 - p.low, p.ess)


def smallest_risk(ess: float) -> float:
    """The upper 95 % limit of the probability of an event that no effective draw has.

    Examples
    --------
    >>> round(smallest_risk(1000.0), 5), round(smallest_risk(10_000.0), 6)
    (0.00368, 0.000369)
    """
    return float(-np.expm1(np.log(_OUTSIDE) / max(ess, 1.0)))


def judge_limits(
    measurands: Sequence[Measurand],
    rule: DecisionRule,
    *,
    ess_least: float,
    ess_finest: float = ESS_FINEST,
) -> tuple[tuple[Judged, ...], Overall]:
    """Verdict on each limit, and on all of them jointly.

    Parameters
    ----------
    measurands : sequence of Measurand
        Their draws belong together one by one.
    rule : DecisionRule
    ess_least : float
        Smallest effective sample size of the parameters.
    ess_finest : float
        What a fit of higher accuracy would have; at most `ess_least` where there is none.

    Returns
    -------
    tuple of Judged, and Overall
        All together: under ``risk`` the rule on the joint probability of the limits that can be
        judged; else ACCEPT where every limit is accepted, REJECT where one is rejected. A limit
        with a reservation bars ACCEPT, not REJECT: with it the probability is smaller still.
    """
    ess = _Effective(ess_least, ess_finest)
    inside = [_inside(m) for m in measurands]
    judged = tuple(_judge(m, flags, rule, ess) for m, flags in zip(measurands, inside, strict=True))
    usable = [flags.all(axis=-1) for m, flags in zip(measurands, inside, strict=True)
              if not m.reservation]  # fmt: skip
    every = [flags.all(axis=-1) for flags in inside]
    joint = count_probability(np.logical_and.reduce(usable or every), ess_least)
    verdict, reason = _together(judged, joint, rule, ess, n_usable=len(usable))
    if len(usable) < len(judged) and verdict == ACCEPT:
        verdict, reason = UNDECIDED, say("conform.reserved")
    return judged, Overall(verdict, reason, _remark(verdict, joint), joint, *_risks(verdict, joint))


def _inside(m: Measurand) -> Flags:
    """Whether each draw is inside the tolerance interval, at each point."""
    return np.asarray((m.values >= m.lower) & (m.values <= m.upper))


def _judge(m: Measurand, inside: Flags, rule: DecisionRule, ess: _Effective) -> Judged:
    flat = m.values.reshape(-1, m.values.shape[-1])
    mean, sd = flat.mean(axis=0), flat.std(axis=0, ddof=1)
    low, high = np.quantile(flat, [0.025, 0.975], axis=0)
    probability = count_probability(np.logical_and.reduce(inside, axis=-1), ess.least)
    factor = 0.0 if rule.rule != "guard" or m.guard is not None else rule.guard_factor
    guard = factor * sd
    if rule.rule == "guard" and m.guard is not None:
        guard = np.full(mean.size, m.guard)
    if m.reservation:
        verdict, reason = UNDECIDED, m.reservation
    elif rule.rule == "risk":
        verdict, reason = _by_risk(probability, rule, ess)
    else:
        n = max(min(ess.least, float(len(flat))), 2.0)
        slack = _Z * sd * np.sqrt(1.0 / n + 0.5 * factor**2 / n)
        verdict, reason = _by_estimate(m, mean, guard, slack, ess)
    return Judged(
        verdict, reason, _remark(verdict, probability), not m.reservation, probability,
        *_risks(verdict, probability), mean, sd, low, high, inside.mean(axis=(0, 1)), guard,
        _worst(m, mean, sd, inside),
    )  # fmt: skip


def _worst(m: Measurand, mean: Array, sd: Array, inside: Flags) -> int:
    room = np.minimum(mean - m.lower, m.upper - mean) / np.maximum(sd, 1e-300)
    return int(np.lexsort((room, inside.mean(axis=(0, 1))))[0])


def _by_risk(p: Probability, rule: DecisionRule, ess: _Effective) -> tuple[str, str]:
    consumer, producer = rule.max_consumer_risk, rule.max_producer_risk
    if 1.0 - p.low <= consumer:
        return ACCEPT, ""
    if p.high <= producer:
        return REJECT, ""
    if 1.0 - p.value <= consumer:
        return UNDECIDED, _left_open(ess, consumer)
    if p.value <= producer:
        return UNDECIDED, _left_open(ess, producer)
    return UNDECIDED, say(
        "conform.risk", accept=1.0 - p.value, consumer=consumer, reject=p.value, producer=producer
    )


def _by_estimate(
    m: Measurand, y: Array, guard: Array, slack: Array, ess: _Effective
) -> tuple[str, str]:
    """Simple acceptance and guard bands: distances beyond the acceptance and rejection limits."""
    beyond = np.maximum(m.lower - y, y - m.upper)
    if np.all(beyond + guard <= -slack):
        return ACCEPT, ""
    if np.any(beyond - guard > slack):
        return REJECT, ""
    if np.any(2.0 * guard >= m.upper - m.lower):
        return UNDECIDED, say("conform.all_guard")
    if guard.any() and np.any(beyond + guard > slack):
        return UNDECIDED, say("conform.in_guard")
    return UNDECIDED, _left_open(ess)


def _left_open(ess: _Effective, allowed: float = 1.0) -> str:
    """What the draws leave open, and what would help; ``allowed`` is the risk in question."""
    least, finest = smallest_risk(ess.least), smallest_risk(ess.finest)
    finer = ess.finest > ess.least
    if allowed >= least:
        return say("conform.finer" if finer else "conform.finest")
    remedies = [say("conform.reference_accuracy")] if finer else []
    if not finer or allowed < finest:
        remedies.append(say("conform.allow", risk=finest))
    return say(
        "conform.few_draws",
        n=ess.least,
        least=least,
        allowed=allowed,
        remedy=", and ".join(remedies),
    )


def _together(
    judged: Sequence[Judged],
    joint: Probability,
    rule: DecisionRule,
    ess: _Effective,
    *,
    n_usable: int,
) -> tuple[str, str]:
    if not n_usable:
        return UNDECIDED, say("conform.none")
    if rule.rule == "risk":
        return _by_risk(joint, rule, ess)
    verdicts = [one.verdict for one in judged]
    if REJECT in verdicts:
        return REJECT, ""
    if UNDECIDED in verdicts:
        return UNDECIDED, say("conform.one_undecided")
    return ACCEPT, ""


def _remark(verdict: str, p: Probability) -> str:
    """Name a risk above a half: some rules look at the estimate alone."""
    for whose, risk in zip(("consumer", "producer"), _risks(verdict, p), strict=True):
        if risk > 0.5:
            return say("conform.wrong", whose=whose, percent=100.0 * risk)
    return ""


def _risks(verdict: str, p: Probability) -> tuple[float, float]:
    """Specific consumer's and producer's risk, where there is a decision to be wrong about."""
    return (
        1.0 - p.value if verdict == ACCEPT else np.nan,
        p.value if verdict == REJECT else np.nan,
    )
