"""Texts in a CSV that a spreadsheet would take for a formula get an apostrophe, and lose it again.

So do those that begin with a blank, which a reader would strip. The apostrophe is put before any
number of others, so that every text comes back as it was.
"""

from __future__ import annotations

import unicodedata

_ACTIVE = frozenset("=+-@")
_MINUS = "\N{MINUS SIGN}"
_UNSEEN = frozenset(("Zs", "Zl", "Zp", "Cc", "Cf"))
"""Categories of characters that are not seen: spaces of any width, controls, marks of format."""


def guard(text: str) -> str:
    r"""Put an apostrophe before text that a spreadsheet would take for a formula.

    Examples
    --------
    >>> guard("=1+1"), guard(" =1"), guard("'=1"), guard("paint")
    ("'=1+1", "' =1", "''=1", 'paint')
    >>> guard("\N{FULLWIDTH EQUALS SIGN}1")[0], guard("\N{NO-BREAK SPACE}@1")[0]
    ("'", "'")
    """
    return f"'{text}" if _is_active(text) else text


def unguard(cell: str) -> str:
    """Undo `guard`.

    Examples
    --------
    >>> unguard("'=1+1"), unguard("' =1"), unguard("'tis")
    ('=1+1', ' =1', "'tis")
    """
    return cell[1:] if cell.startswith("'") and _is_active(cell) else cell


def _is_active(text: str) -> bool:
    """It begins like a formula, with what is not seen and width taken off, or with a blank."""
    bare = text.lstrip("'")
    if bare[:1].isspace():
        return True
    seen = next((c for c in bare if unicodedata.category(c) not in _UNSEEN), "")
    return seen == _MINUS or unicodedata.normalize("NFKC", seen)[:1] in _ACTIVE
