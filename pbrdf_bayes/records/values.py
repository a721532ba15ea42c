"""Kinds of values in the records, and records as plain values.

A number that is not finite or not known is NaN in memory and null in a file. The names below are
plain types to a type checker, and what a file may hold to `msgspec`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import UNSET, Meta, Struct

if TYPE_CHECKING:
    Number = float
    Positive = float
    Share = float
    Correlation = float
    Probable = float
    Factor = float
    Whole = int
    Polarization = str
    Judged = str
    CheckJudged = str
    Sha256 = str
    MaybeSha256 = str
else:
    Number = float | None
    Whole = Annotated[int, Meta(ge=0)]
    Positive = Annotated[float, Meta(gt=0)]
    Factor = Annotated[float, Meta(ge=1)]
    Share = Annotated[float, Meta(ge=0, le=1)] | None
    Probable = Annotated[float, Meta(ge=0, le=1)]
    Correlation = Annotated[float, Meta(ge=-1.000001, le=1.000001)] | None
    Polarization = Literal["s", "p", "u"]
    Judged = Literal["PASS", "WARN", "FAIL"]
    CheckJudged = Literal["PASS", "WARN", "FAIL", "SKIP"]
    Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
    MaybeSha256 = Annotated[str, Meta(pattern="^([0-9a-f]{64})?$")]


def plain(value: Any) -> Any:
    """Copy for JSON: records become mappings, numpy scalars numbers, NaN and infinities null.

    Fields of a record that are unset are left out.
    """
    if isinstance(value, Struct):
        found = {name: getattr(value, name) for name in value.__struct_fields__}
        return {name: plain(item) for name, item in found.items() if item is not UNSET}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
