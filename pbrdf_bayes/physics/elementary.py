"""Elementary functions that the compiler can run on several numbers at once.

Those of the C library are calls that no compiler vectorises; most of the time of a likelihood
would go into them. These are plain arithmetic on the bits of the number, accurate to a few ulp on
the ranges stated (``tests/physics/test_elementary.py``).
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pbrdf_bayes.physics.compiled import compiled

_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
# Coefficients of log((1 + s)/(1 - s)) - 2 s on |s| < 0.1716: the minimax fit of fdlibm's e_log.c.
_L1, _L2, _L3, _L4 = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
)
_L5, _L6, _L7 = 1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01
_SQRT_HALF_BITS = 0x3FE6A09E00000000


@intrinsic  # type: ignore[untyped-decorator]
def _bits(typingctx: Any, x: Any) -> Any:  # noqa: ARG001
    """The bits of a float64 as an int64."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic  # type: ignore[untyped-decorator]
def _float(typingctx: Any, x: Any) -> Any:  # noqa: ARG001
    """The float64 that has these bits."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@compiled(inline=True)
def log(x: float) -> float:
    """Natural logarithm of a positive normal number; anything else gives a meaningless number."""
    shifted = _bits(x) - _SQRT_HALF_BITS
    exponent = shifted >> 52
    m = _float(_bits(x) - (exponent << 52))  # in [sqrt(1/2), sqrt(2))
    f = m - 1.0
    s = f / (m + 1.0)
    z = s * s
    series = z * (_L1 + z * (_L2 + z * (_L3 + z * (_L4 + z * (_L5 + z * (_L6 + z * _L7))))))
    half = 0.5 * f * f
    e = float(exponent)
    result: float = e * _LN2_HIGH - ((half - (s * (half + series) + e * _LN2_LOW)) - f)
    return result


# The same on |s| <= 0.2, interpolated at Chebyshev points of s^2.
_R1, _R2, _R3, _R4 = (
    0.6666666666666694,
    0.39999999999335556,
    0.2857142883604555,
    0.22222182776674482,
)
_R5, _R6, _R7 = 0.18184610246294064, 0.15283703752403147, 0.1511848710872457
_HALF_BITS = 1 << 51


@compiled(inline=True)
def log_ratio(a: float, b: float) -> float:
    """ln(a / b) of positive normal numbers at the cost of one division, that of the logarithm."""
    exponent = (_bits(a) - _bits(b) + _HALF_BITS) >> 52
    near = _float(_bits(b) + (exponent << 52))  # within a factor 3/2 of a
    s = (a - near) / (a + near)
    z = s * s
    series = z * (_R1 + z * (_R2 + z * (_R3 + z * (_R4 + z * (_R5 + z * (_R6 + z * _R7))))))
    e = float(exponent)
    result: float = e * _LN2_HIGH + (2.0 * s + (s * series + e * _LN2_LOW))
    return result


_LOG2_E = 1.4426950408889634
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer in the low bits
_ROUND_BITS = 0x4338000000000000


@compiled(inline=True)
def exp(x: float) -> float:
    """Exponential for |x| <= 700."""
    shifted = x * _LOG2_E + _ROUND
    k = shifted - _ROUND
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    series = 1.0 / 479001600.0
    series = 1.0 / 39916800.0 + r * (series + r * (1.0 / 6227020800.0))
    series = 1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * series))
    series = 1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r * series))
    series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * series))))
    result: float = series * _float((_bits(shifted) - _ROUND_BITS + 1023) << 52)
    return result


@compiled(inline=True)
def half_sincos(x: float) -> tuple[float, float]:
    """sin(x/2) and cos(x/2) for |x| <= pi, from the Taylor series at x/4."""
    y = 0.25 * x
    z = y * y
    s = 1.0 / 6227020800.0 - z * (1.0 / 1307674368000.0 - z * (1.0 / 355687428096000.0))
    s = 1.0 / 5040.0 - z * (1.0 / 362880.0 - z * (1.0 / 39916800.0 - z * s))
    s = y * (1.0 - z * (1.0 / 6.0 - z * (1.0 / 120.0 - z * s)))
    c = 1.0 / 479001600.0 - z * (1.0 / 87178291200.0 - z * (1.0 / 20922789888000.0))
    c = 1.0 / 720.0 - z * (1.0 / 40320.0 - z * (1.0 / 3628800.0 - z * c))
    c = 1.0 - z * (0.5 - z * (1.0 / 24.0 - z * c))
    return 2.0 * s * c, 1.0 - 2.0 * s * s
