"""One way to compile a kernel, typed: numba's options for all of them in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(
    *, inline: bool = False, reassociate: bool = False, nogil: bool = False
) -> Callable[[Function], Function]:
    """Decorator: compile in nopython mode, cached on disk, division by zero as in IEEE 754.

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
        return kernel

    return decorate
