"""One way to compile a kernel, typed: numba's options for all of them in one place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(
    *, inline: bool = False, reassociate: bool = False, nogil: bool = False
) -> Callable[[Function], Function]:
    """Decorator: compile in nopython mode, cached on disk, division by zero as in IEEE 754.

    What is on disk counts only while the sources of all kernels are what they were: numba itself
    looks at the one file alone, and would go on with kernels of another version that it calls. The
    hash joins the version that numba compares before it unpickles records that may have moved.

    A product and a sum may be contracted to one fused operation, which rounds once.

    Parameters
    ----------
    inline : bool
        Paste the function into its callers, so that their loops are vectorised.
    reassociate : bool
        Allow sums in another order, which vectorised sums need. Not where rounding is exploited.
    nogil : bool
        Let other threads run meanwhile.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}
    if inline:
        options["inline"] = "always"
    if reassociate:
        options["fastmath"] = {"reassoc", "contract", "nsz"}
    if nogil:
        options["nogil"] = True

    def decorate(function: Function) -> Function:
        kernel: Function = njit(**options)(function)
        file = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
        if file is not None:
            file._version = f"{file._version} {kernel_sources()}"
        return kernel

    return decorate


@cache
def kernel_sources(package: Path = Path(__file__).parents[1]) -> str:
    """Hash of every source file of the package that holds kernels."""
    found = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"@compiled" in source:
            found.update(source)
    return found.hexdigest()
