"""The logarithm of Re w(x + iy), y >= 0: the Voigt profile without a scale.

    w(z) = exp(-z^2) erfc(-iz),   Re w(x + iy) = y/pi * integral of exp(-t^2) / [(x-t)^2 + y^2] dt

The midpoint rule or the trapezoidal rule of step h for that integral, with what the poles
t = +-x +- iy close to the real axis do to them,

    + 2 exp(-z^2) / [1 +- exp(-2 pi i z/h)]   (+ for the midpoint rule, - for the other),

that rule of the two whose nodes are not near x. Both rules are sums of positive terms with the
factor y, so that the real part keeps its relative accuracy however much smaller it is than the
imaginary part; as a logarithm it neither underflows nor overflows.

Source: Al Azah, Chandler-Wilde, SIAM J. Numer. Anal. 59, 2346 (2021), doi:10.1137/20M1373037,
Eqs. (9)-(11): the error is below 0.7 exp(-pi N) with N + 1 nodes and h = sqrt(pi/(N + 1)); here
N = 11, 7e-16.
"""

from __future__ import annotations

from math import cos, exp, floor, log, log1p, pi, sin, sqrt

import numpy as np

from pbrdf_bayes.physics.compiled import compiled

_N_NODES = 12
_H = sqrt(pi / _N_NODES)
_MIDPOINTS = (np.arange(_N_NODES) + 0.5) * _H
_TRAPEZOIDS = np.arange(_N_NODES) * _H
_NODES = np.stack([_TRAPEZOIDS**2, _MIDPOINTS**2])
_ROOTS = np.stack([_TRAPEZOIDS, _MIDPOINTS])
_WEIGHTS = 2.0 * _H / pi * np.exp(-_NODES)
_WEIGHTS[0, 0] *= 0.5
_TRAPEZOID, _MIDPOINT = 0, 1
_FAR = 1e8
"""|z|^2 from which two terms of the asymptotic series are exact."""
_NO_MATTER = 40.0


@compiled(reassociate=True)
def _log_sum(x: float, y: float, rule: int) -> float:
    """Ln of the rule's sum for Re w / y."""
    x2, y2 = x * x, y * y
    r = x2 + y2
    if r > _FAR:
        return -log(r) - 0.5 * log(pi) + log1p((1.5 * x2 - 0.5 * y2) / r / r)
    total = 0.0
    for k in range(_N_NODES):
        below = x - _ROOTS[rule, k]
        above = x + _ROOTS[rule, k]
        product = (below * below + y2) * (above * above + y2)
        total += _WEIGHTS[rule, k] * (r + _NODES[rule, k]) / product
    return log(total)


@compiled()
def _residue(x: float, y: float, rule: int) -> tuple[float, float]:
    """Real part of what the poles add, as exponent and factor."""
    sign = 1.0 if rule == _MIDPOINT else -1.0
    turn, phase = 2.0 * pi / _H * x, 2.0 * x * y
    decay = exp(-2.0 * pi / _H * y)
    cos_turn = sign * cos(turn)
    above = (decay + cos_turn) * cos(phase) + sign * sin(turn) * sin(phase)
    exponent = (y - x) * (y + x) - 2.0 * pi / _H * y
    return exponent, 2.0 * above / (1.0 + decay * (2.0 * cos_turn + decay))


@compiled()
def log_real_w(x: float, y: float) -> float:
    """Ln Re w(x + iy) for x >= 0, y >= 0 and x^2 + y^2 < 1e150; exact -x^2 at y = 0.

    The error is a few 1e-15 of Re w or of its logarithm (``tests/physics/test_faddeeva.py``).
    """
    if y == 0.0:
        return -x * x
    place = x / _H - floor(x / _H)
    rule = _TRAPEZOID if y < x and 0.25 <= place <= 0.75 else _MIDPOINT
    log_sum = log(y) + _log_sum(x, y, rule)
    exponent = (y - x) * (y + x) - 2.0 * pi / _H * y
    if y >= max(x, pi / _H) or exponent < log_sum - _NO_MATTER:
        return log_sum
    exponent, factor = _residue(x, y, rule)
    if exponent > log_sum:
        return exponent + log(factor + exp(log_sum - exponent))
    return log_sum + log1p(factor * exp(exponent - log_sum))
