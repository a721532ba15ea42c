"""Times that can be compared: taken in turns within one run, the least of many repeats."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from pathlib import Path
from time import perf_counter

import numba
import numpy as np
import scipy

_SHORTEST = 2e-3
_READABLE = 1e-4


def time_in_turns(
    functions: Mapping[str, Callable[[], object]], *, rounds: int = 7, shortest: float = _SHORTEST
) -> dict[str, float]:
    """Seconds a call of each function, the least in rounds in which each has its turn.

    A load that comes and goes then hits all of them alike, and the least is what it hit least.

    Parameters
    ----------
    functions : mapping of str to callable
    rounds : int
    shortest : float
        A turn repeats its function for about this long [s]; calls too short for the clock are
        timed together.

    Returns
    -------
    dict of str to float
    """
    turns = {}
    for name, function in functions.items():
        function()  # compiled and in cache
        started = perf_counter()
        function()
        once = max(perf_counter() - started, 1e-7)
        calls = max(ceil(min(_READABLE, shortest) / once), 1)
        turns[name] = calls, max(ceil(shortest / (calls * once)), 1)
    best = dict.fromkeys(functions, np.inf)
    for _ in range(rounds):
        for name, function in functions.items():
            calls, batches = turns[name]
            for _ in range(batches):
                started = perf_counter()
                for _ in range(calls):
                    function()
                best[name] = min(best[name], (perf_counter() - started) / calls)
    return {name: float(value) for name, value in best.items()}


def fitted_exponent(sizes: list[float], seconds: list[float]) -> float:
    """Slope of ln(seconds) against ln(size) over the upper half of the sizes.

    Examples
    --------
    >>> round(fitted_exponent([1.0, 10.0, 100.0], [5.0, 40.0, 400.0]), 3)
    1.0
    """
    half = len(sizes) // 2
    x, y = np.log(sizes[half:]), np.log(seconds[half:])
    return float(np.polyfit(x, y, 1)[0])


def straight_line(sizes: Sequence[int], times: Sequence[float]) -> dict[str, float]:
    """Fixed cost and cost a unit, the relative residuals least in squares.

    Parameters
    ----------
    sizes : sequence of int
    times : sequence of float
        In any unit.

    Returns
    -------
    dict
        exponent of the growth [1]; fixed and per_unit in the unit of ``times``; off_the_line, the
        largest relative distance from the line ``fixed + per_unit * size`` [1].

    Examples
    --------
    >>> line = straight_line([1, 2, 4], [3.0, 5.0, 9.0])
    >>> round(line["fixed"], 6), round(line["per_unit"], 6)
    (1.0, 2.0)
    """
    x, y = np.array(sizes, dtype=np.float64), np.array(times)
    columns = np.stack([np.ones(y.size), x], axis=1)
    (fixed, slope), *_ = np.linalg.lstsq(columns / y[:, None], np.ones(y.size))
    residual = columns @ np.array([fixed, slope]) / y - 1.0
    return {
        "exponent": fitted_exponent(x.tolist(), y.tolist()),
        "fixed": float(fixed),
        "per_unit": float(slope),
        "off_the_line": float(np.abs(residual).max()),
    }


def describe_machine() -> dict[str, str | int]:
    """Processor, cores, load and versions, for the page and its JSON."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "not stated"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _processor(),
        "cores": cores or 1,
        "load": load,
        "vector_unit": _vector_unit(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
    }


def _cpu_lines() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


def _processor() -> str:
    name, clock = platform.processor() or platform.machine(), ""
    for line in _cpu_lines():
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            name = value.strip()
        if key.strip() == "cpu MHz":
            clock = f", {float(value) / 1000.0:.1f} GHz"
    return name if "GHz" in name else name + clock


def _vector_unit() -> str:
    flags = next((line.split() for line in _cpu_lines() if line.startswith("flags")), [])
    return next((unit for unit in ("avx512f", "avx2", "avx") if unit in flags), "not stated")
