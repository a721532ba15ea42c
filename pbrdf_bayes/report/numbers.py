"""Numbers and symbols as a metrologist writes them: digits from the uncertainty, real minus signs.

The rule is that of the GUM (7.2.6): an uncertainty is quoted to two significant digits and the
value to the same decimal place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Any

from markupsafe import Markup

MISSING = "–"
THIN = "\u202f"
"""Narrow no-break space, between a number and its unit and between groups of digits."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Rounded:
    """A value and what surrounds it, all to the decimal place of the uncertainty."""

    value: str
    uncertainty: str
    low: str
    high: str
    map: str


def finite(value: Any) -> float | None:
    """``value`` as a float, or None where it is missing, not a number or not finite.

    Examples
    --------
    >>> finite(None), finite(float("nan")), finite("x"), finite(2)
    (None, None, None, 2.0)
    """
    if isinstance(value, (str, bytes)) or value is None:
        return None
    number = float(value)
    return number if isfinite(number) else None


def decimals_of(uncertainty: Any, *, digits: int = 2) -> int | None:
    """Decimal places that show ``uncertainty`` to ``digits`` significant digits.

    Examples
    --------
    >>> decimals_of(0.00123), decimals_of(0.0996), decimals_of(31.0), decimals_of(0.0)
    (4, 2, 0, None)
    """
    u = finite(uncertainty)
    if u is None or u <= 0:
        return None
    rounded = float(f"{u:.{digits - 1}e}")
    return digits - 1 - floor(log10(rounded))


def rounded(
    value: Any, uncertainty: Any, *, low: Any = None, high: Any = None, at_map: Any = None
) -> Rounded:
    """Round a value, its interval and its MAP to two digits of the standard uncertainty.

    Examples
    --------
    >>> r = rounded(1.52601, 0.00123, low=1.52366, high=1.52841)
    >>> r.value, r.uncertainty, r.low, r.high
    ('1.5260', '0.0012', '1.5237', '1.5284')
    >>> rounded(-0.5, None).value
    '−0.5'
    """
    decimals = decimals_of(uncertainty)

    def shown(x: Any) -> str:
        return number(x) if decimals is None else fixed(x, decimals)

    return Rounded(shown(value), shown(uncertainty), shown(low), shown(high), shown(at_map))


def fixed(value: Any, decimals: int) -> str:
    r"""Write fixed decimals; a power of ten where more than nine would be needed.

    Examples
    --------
    >>> fixed(-1.25, 1), fixed(1234.6, -1), fixed(None, 2), fixed(1.2e-11, 12)
    ('−1.2', '1\u202f230', '–', '1.2 × 10⁻¹¹')
    """
    x = finite(value)
    if x is None:
        return MISSING
    if decimals > 9:
        return number(x, digits=2)
    return _typeset(f"{round(x, decimals) + 0.0:,.{max(decimals, 0)}f}")


def number(value: Any, *, digits: int = 3) -> str:
    r"""Significant digits, trailing zeros dropped, a power of ten outside 1e-4 to 1e6.

    Examples
    --------
    >>> number(0.01234), number(-2.0), number(1.5e-7), number(6420), number(float("inf"))
    ('0.0123', '−2', '1.5 × 10⁻⁷', '6\u202f420', '–')
    """
    x = finite(value)
    if x is None:
        return value if isinstance(value, str) and value else MISSING
    if x == 0:
        return "0"
    x = float(f"{x:.{digits - 1}e}")
    exponent = floor(log10(abs(x)))
    if -4 <= exponent < 6:
        text = f"{x:,.{max(digits - 1 - exponent, 0)}f}"
        return _typeset(text.rstrip("0").rstrip(".") if "." in text else text)
    mantissa = f"{x / 10.0**exponent:.{digits - 1}f}".rstrip("0").rstrip(".")
    return f"{_typeset(mantissa)} × 10{str(exponent).translate(_RAISED)}"


def alike(values: Sequence[Any]) -> list[str]:
    """Write a column with equal decimals, two digits of its smallest number.

    Examples
    --------
    >>> alike([0.2, 0.0423, None]), alike([120.4, 38.2])
    (['0.200', '0.042', '–'], ['120', '38'])
    """
    known = [abs(x) for x in map(finite, values) if x]
    decimals = decimals_of(min(known, default=1.0)) or 0
    return [fixed(value, max(decimals, 0)) for value in values]


def count(value: Any) -> str:
    r"""Whole number with thin spaces between thousands.

    Examples
    --------
    >>> count(3210), count(None)
    ('3\u202f210', '–')
    """
    x = finite(value)
    return MISSING if x is None else _typeset(f"{round(x):,d}")


def percent(fraction: Any, *, digits: int = 2) -> str:
    r"""Fraction as per cent.

    Examples
    --------
    >>> percent(0.905, digits=3), percent(None)
    ('90.5\u202f%', '–')
    """
    x = finite(fraction)
    if x is None:
        return MISSING
    decimals = decimals_of(abs(100 * x), digits=digits)
    text = "0" if decimals is None else fixed(100 * x, min(decimals, digits))
    return f"{text}{THIN}%"


def degrees(value: Any) -> str:
    """Angle with a degree sign.

    Examples
    --------
    >>> degrees(20.0), degrees(-7.5)
    ('20°', '−7.5°')
    """
    text = number(value, digits=6)
    return text if text == MISSING else f"{text}°"


def dex_as_percent(dex: Any) -> str:
    r"""Relative deviation that a deviation in dex is.

    Examples
    --------
    >>> dex_as_percent(0.0072)
    '1.7\u202f%'
    """
    x = finite(dex)
    return MISSING if x is None or x > 300 else percent(10.0 ** abs(x) - 1.0)


def seconds(value: Any) -> str:
    r"""Duration in seconds or minutes.

    Examples
    --------
    >>> seconds(12.34), seconds(75.0), seconds(1e-6)
    ('12.3\u202fs', '1\u202fmin 15\u202fs', '< 1\u202fms')
    """
    x = finite(value)
    if x is None:
        return MISSING
    if x < 1e-3:
        return f"< 1{THIN}ms"
    if x < 60:
        return f"{number(x)}{THIN}s"
    return f"{int(x // 60)}{THIN}min {x % 60:.0f}{THIN}s"


def symbol_markup(symbol: str) -> Markup:
    """Return a symbol with what follows its first underscore as a subscript.

    Examples
    --------
    >>> str(symbol_markup("σ_N0")), str(symbol_markup("n"))
    ('σ<sub>N0</sub>', 'n')
    """
    head, _, tail = symbol.partition("_")
    lowered = Markup("<sub>{}</sub>").format(tail) if tail else Markup("")
    return Markup("{}{}").format(head, lowered)


def _typeset(text: str) -> str:
    """Thin spaces for the commas of ``format``, a minus sign for its hyphen."""
    return text.replace(",", THIN).replace("-", "−")
