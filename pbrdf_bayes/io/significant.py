"""Numbers of a result before it is written: as many digits as they are worth."""

from __future__ import annotations

from typing import Any


def significant(value: Any, digits: int) -> Any:
    """The same dicts and lists with floats to so many significant digits.

    Parameters
    ----------
    value : dict, list or plain value
        As JSON takes it; what is no float is left as it is.
    digits : int

    Examples
    --------
    >>> significant({"x": [1.23456, 2], "name": "a"}, 3)
    {'x': [1.23, 2], 'name': 'a'}
    """
    if isinstance(value, dict):
        return {key: significant(item, digits) for key, item in value.items()}
    if isinstance(value, list):
        return [significant(item, digits) for item in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value
