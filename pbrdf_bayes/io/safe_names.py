"""Folder names for any name of a sample."""

from __future__ import annotations

import hashlib
import re

_RESERVED = {"con", "prn", "aux", "nul", *(f"{d}{i}" for d in ("com", "lpt") for i in range(10))}
_LONGEST_NAME = 80


def safe_name(name: str) -> str:
    """A folder name for any sample name: plain characters, never hidden, reserved or long.

    A name that had to be changed ends in a hash of the original, so that two never collide.

    Examples
    --------
    >>> safe_name("green_paint")
    'green_paint'
    >>> safe_name("../etc")
    'etc-f7f9121f'
    """
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._-")[:_LONGEST_NAME]
    usable = bool(plain) and plain.lower().split(".")[0] not in _RESERVED
    if usable and plain == name:
        return plain
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{plain}-{digest}" if usable else f"sample-{digest}"
