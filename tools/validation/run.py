"""All studies: simulate, count, judge, write the page and its JSON."""

from __future__ import annotations

import json
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.stats import kstest

from pbrdf_bayes import __version__
from pbrdf_bayes.io.run_folder import write_text
from tools.validation.coverage import LINE_SHAPE, MISFITS, simulate_coverage, tabulate
from tools.validation.page import render_page
from tools.validation.sbc import outside_envelope, simulate_rank

DEFAULT_FOLDER = Path("reports") / "calibration"
SCHEMA_VERSION = 1
N_RANKS, N_CONTROL, N_COVERAGE = 300, 100, 60
_FIRST_SEED, _FIRST_CONTROL = 1000, 5000


def run_studies(
    *,
    n_ranks: int = N_RANKS,
    n_control: int = N_CONTROL,
    n_coverage: int = N_COVERAGE,
    processes: int = 2,
    told: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run every study.

    Parameters
    ----------
    n_ranks, n_control, n_coverage : int
        Simulations: for the ranks, for their negative control, for each shape of misfit.
    processes : int
        Simulations that run at the same time; results do not depend on it.
    told : callable
        Told how far each study is.

    Returns
    -------
    dict
        The content of ``calibration.json``.
    """
    started = perf_counter()
    shapes = (*MISFITS, LINE_SHAPE)
    with pool(processes) as run:
        ranks = list(
            _watched(run(simulate_rank, range(_FIRST_SEED, _FIRST_SEED + n_ranks)), "ranks", told)
        )
        control = partial(simulate_rank, overconfident=True)
        seeds = range(_FIRST_CONTROL, _FIRST_CONTROL + n_control)
        controls = list(_watched(run(control, seeds), "negative control", told))
        coverage: list[dict[str, Any]] = []
        for shape in shapes:
            simulate = partial(simulate_coverage, shape=shape)
            coverage += _watched(run(simulate, range(n_coverage)), shape, told)
    return {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(perf_counter() - started, 1),
        "ranks": judge_ranks(ranks),
        "control": judge_ranks(controls),
        "coverage": tabulate(coverage),
    }


def judge_ranks(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Ranks of every quantity, and whether they leave the band of 99 %."""
    names = list(results[0]["ranks"])
    table = {name: np.array([r["ranks"][name] for r in results]) for name in names}
    return {
        "n": len(results),
        "n_not_converged": sum(r["status"] != "done" for r in results),
        "n_importance": sum(r["method"] == "psis" for r in results),
        "n_flagged": sum(r["verdict"] != "PASS" for r in results),
        "quantities": {
            name: {
                "ranks": [round(float(v), 4) for v in values],
                "p_value": float(kstest(values, "uniform").pvalue),
                "covered_90": float(np.mean((values > 0.05) & (values < 0.95))),
                "outside": outside_envelope(values),
            }
            for name, values in table.items()
        },
    }


@contextmanager
def pool(processes: int) -> Iterator[Callable[[Callable[..., Any], Iterable[Any]], Any]]:
    """Map over processes, or in this one."""
    if processes == 1:
        yield map
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as executor:
        yield executor.map


def _watched(
    results: Iterator[dict[str, Any]], name: str, told: Callable[[str], None]
) -> Iterator[dict[str, Any]]:
    for done, result in enumerate(results, start=1):
        told(f"{name}: {done}")
        yield result


def write_studies(result: dict[str, Any], folder: Path) -> Path:
    """Write ``index.html`` and ``calibration.json``; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "calibration.json", json.dumps(result, indent=1) + "\n")
    page = folder / "index.html"
    write_text(page, render_page(result))
    return page


def main(arguments: list[str]) -> int:
    """``python -m tools.validation [FOLDER]``: run everything, print the page's path."""
    folder = Path(arguments[0]) if arguments else DEFAULT_FOLDER
    result = run_studies(told=lambda line: say(f"\r{line:<60}"))
    say("\n")
    sys.stdout.write(f"{write_studies(result, folder)}\n")
    return 0


def say(words: str) -> None:
    """To standard error, at once."""
    sys.stderr.write(words)
    sys.stderr.flush()
