"""The evidence of one reading given a normal prediction, and its derivatives.

A reading y of the quantity g ~ N(mu, s) has the noise sqrt(lambda) N(0, v), lambda from a finite
mixture of weights w_k: one component of lambda = 1 for normal noise, several for Student's t. With
S_k = s + lambda_k v and e = y - mu

    Z = sum_k w_k N(e; 0, S_k)            for a reading,
    Z = sum_k w_k Phi(e / sqrt(S_k))      for one that is only known to be y or less.

The mean and variance of g given the reading follow from L = ln Z alone,

    E[g] = mu + s L',   var[g] = s + s^2 L''      (primes: derivatives by mu)

and derivatives by s and by v from those by mu, since both densities obey the heat equation:
dZ_k/dS = Z_k''/2. Derivatives of L are cumulants over the components' shares of Z, taken about
their means, so that nothing cancels far in the tails.

A t variable with nu degrees of freedom is N(0, 1/u) for u ~ Gamma(nu/2, rate nu/2): Andrews and
Mallows, J. R. Stat. Soc. B 36, 99 (1974), doi:10.1111/j.2517-6161.1974.tb00989.x.
"""

from __future__ import annotations

from math import erfc, log, log1p, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import loggamma

from pbrdf_bayes.physics.compiled import compiled

Array = NDArray[np.float64]

_LN_2PI = log(2.0 * pi)
_TAIL = -4.0
_TERMS = 30
_LN_ERROR = -10.0
_REACH = 300.0

LOG_Z, A, W, KEPT, W_MU, LOG_Z_S, A_S, W_S, LOG_Z_V, A_V, W_V = range(11)
"""L, L', -L'', 1 - s W; derivatives of W by mu; of L, L' and W by s and by v."""
N_OUT = 11


class Mixture(NamedTuple):
    """Variances of the components of the noise over v, and logarithms of their weights."""

    scale: Array
    log_weight: Array


def normal_mixture() -> Mixture:
    """Normal noise: one component."""
    return Mixture(np.ones(1), np.zeros(1))


def student_mixture(dof: float) -> Mixture:
    """Student-t noise of scale sqrt(v) as a mixture of normal laws.

    The trapezoidal rule in ln u: its relative error is |Gamma(a + 2 pi i/h)|/Gamma(a) for the step
    h, a = (dof + 1)/2, at any distance that the nodes reach. The step makes that 5e-5, the nodes
    reach 300 scales; beyond, the law falls off as a normal one of that width.

    Parameters
    ----------
    dof : float
        Degrees of freedom, 1 to 30.

    Returns
    -------
    Mixture

    Examples
    --------
    >>> scale, log_weight = student_mixture(4.0)
    >>> float((np.exp(log_weight) * scale).sum().round(2))  # the variance, dof/(dof - 2)
    2.0
    """
    a = 0.5 * (dof + 1.0)
    steps = np.geomspace(1.5, 0.05, 400)
    error = np.real(loggamma(a + 2j * pi / steps)) - loggamma(a)
    step = steps[np.argmax(error < _LN_ERROR)]
    spread = 2.0 * sqrt(-_LN_ERROR / a)
    low = log(2.0 * a / (dof + _REACH**2)) - max(-_LN_ERROR / a, spread)
    high = log(2.0 * a / dof) + min(spread, log(1.0 - 2.0 * _LN_ERROR / a))
    t = np.arange(low, high + step, step)
    log_weight = 0.5 * dof * (t - np.exp(t))
    return Mixture(np.exp(-t), log_weight - np.logaddexp.reduce(log_weight))


@compiled()
def normal_tail(z: float) -> tuple[float, float, float, float]:
    """Ln Phi(z), the hazard h = phi/Phi, h + z and 1 - h (h + z), each to about 1e-12.

    The last two are how far below z, and how widely, a standard normal number of at most z lies.
    In the tail they are tails of Laplace's continued fraction of h.
    """
    if z > _TAIL:
        cdf = 0.5 * erfc(-z / sqrt(2.0))
        value = log(cdf) if z < 0.0 else log1p(-0.5 * erfc(z / sqrt(2.0)))
        hazard = np.exp(-0.5 * z * z - 0.5 * _LN_2PI) / cdf
        return value, hazard, hazard + z, 1.0 - hazard * (hazard + z)
    t = 0.0
    for n in range(_TERMS, 2, -1):
        t = n / (t - z)
    second = 2.0 / (t - z)
    excess = 1.0 / (second - z)
    hazard = excess - z
    value = -0.5 * z * z - 0.5 * _LN_2PI - log(hazard)
    return value, hazard, excess, (second - excess) * excess


@compiled()
def _component(e: float, s: float, v: float, censored: bool, k: int, work: Array) -> None:
    """Logarithm of Z_k, its four derivatives by mu and 1 + s L_k'', into column ``k``."""
    total = s + v
    b = 1.0 / sqrt(total)
    z = e * b
    if not censored:
        work[0, k] = -0.5 * (z * z + _LN_2PI + log(total))
        work[1, k] = z * b
        work[2, k] = -b * b
        work[3, k] = 0.0
        work[4, k] = 0.0
        work[5, k] = v / total
        return
    value, hazard, excess, left = normal_tail(z)
    bend = left - excess * excess
    work[0, k] = value
    work[1, k] = -b * hazard
    work[2, k] = -b * b * hazard * excess
    work[3, k] = b * b * b * hazard * bend
    fourth = hazard * (bend * (excess + hazard) + 2.0 * excess * left)
    work[4, k] = b * b * b * b * fourth
    work[5, k] = (v + s * left) / total


@compiled()
def _by_variance(work: Array, mixture: Mixture, by_v: bool, out: Array, first: int) -> None:
    """Derivatives of L, L' and W by s, or by v: those of the mean of q = lambda (L'' + L'^2)/2."""
    mean1, mean_q = out[A], 0.0
    for k in range(mixture.scale.size):
        scale = 0.5 * (mixture.scale[k] if by_v else 1.0)
        mean_q += work[0, k] * scale * (work[2, k] + work[1, k] ** 2)
    slope, bend = 0.0, 0.0
    for k in range(mixture.scale.size):
        scale = 0.5 * (mixture.scale[k] if by_v else 1.0)
        l1, l2, l3, l4 = work[1, k], work[2, k], work[3, k], work[4, k]
        q = scale * (l2 + l1 * l1) - mean_q
        q1 = scale * (l3 + 2.0 * l1 * l2)
        q2 = scale * (l4 + 2.0 * (l2 * l2 + l1 * l3))
        away = l1 - mean1
        slope += work[0, k] * (q1 + q * away)
        bend += work[0, k] * (q2 + 2.0 * q1 * away + q * (l2 + away * away + out[W]))
    out[first] = mean_q
    out[first + 1] = slope
    out[first + 2] = -bend


@compiled()
def row_evidence(
    e: float, s: float, v: float, censored: bool, mixture: Mixture, slopes: bool, work: Array,
    out: Array,
) -> None:  # fmt: skip
    """Evidence of a reading.

    Parameters
    ----------
    e : float
        Reading minus its predicted mean, or the limit minus that mean if ``censored``.
    s, v : float
        Variance of the prediction, of the noise; v > 0.
    censored : bool
    mixture : Mixture
    slopes : bool
        Fill all of ``out``, not only the first four numbers.
    work : ndarray, shape (6, n_components)
    out : ndarray, shape (N_OUT,)
    """
    n = mixture.scale.size
    largest = -np.inf
    for k in range(n):
        _component(e, s, v * mixture.scale[k], censored, k, work)
        work[0, k] += mixture.log_weight[k]
        largest = max(largest, work[0, k])
    total = 0.0
    for k in range(n):
        work[0, k] = np.exp(work[0, k] - largest)
        total += work[0, k]
    mean1, mean2, kept = 0.0, 0.0, 0.0
    for k in range(n):
        work[0, k] /= total
        mean1 += work[0, k] * work[1, k]
        mean2 += work[0, k] * work[2, k]
        kept += work[0, k] * work[5, k]
    spread, third = 0.0, 0.0
    for k in range(n):
        away = work[1, k] - mean1
        spread += work[0, k] * away * away
        third += work[0, k] * (work[3, k] + away * (3.0 * (work[2, k] - mean2) + away * away))
    out[LOG_Z] = largest + log(total)
    out[A] = mean1
    out[W] = -mean2 - spread
    out[KEPT] = kept + s * spread
    out[W_MU] = -third
    if slopes:
        _by_variance(work, mixture, False, out, LOG_Z_S)
        _by_variance(work, mixture, True, out, LOG_Z_V)


@compiled()
def fill_cdf(e: Array, s: Array, v: Array, mixture: Mixture, out: Array) -> None:
    """Probability that a reading is at most e above its predicted mean, for rows of (e, s, v)."""
    for i in range(out.size):
        out[i] = 0.0
        for k in range(mixture.scale.size):
            z = e[i] / sqrt(s[i] + v[i] * mixture.scale[k])
            out[i] += np.exp(mixture.log_weight[k]) * 0.5 * erfc(-z / sqrt(2.0))
