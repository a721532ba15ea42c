"""Guard of the speed: ratios measured in one run against the stored ones. Run by hand.

    python tests/benchmarks/ratios.py            # exit 1 when a ratio is worse than its margin
    python tests/benchmarks/ratios.py --store    # keep what is measured, after a deliberate change

Ratios, not times: the machine, its clock and its load cancel. Both sides of a ratio run in turns
and the least of many repeats counts. The gain of two threads is divided by that of a loop that
shares nothing, so that a busy second core cancels too.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from pbrdf_bayes.bench.speed import measure_headline, measure_scaling
from pbrdf_bayes.bench.timing import describe_machine

STORED = Path(__file__).with_name("ratios.json")
WORDS = {
    "likelihood_to_floor": "log-likelihood : arithmetic floor",
    "gradient_to_likelihood": "gradient : log-likelihood",
    "plain_to_likelihood": "plain NumPy : log-likelihood",
    "two_threads": "gain of two threads : gain of the floor",
    "scans_off_the_line": "time against scans, off the straight line",
    "points_exponent": "growth with points per scan, exponent",
}
LARGER_IS_BETTER = {"plain_to_likelihood", "two_threads"}
MARGINS = {
    "likelihood_to_floor": 1.3,
    "gradient_to_likelihood": 1.3,
    "plain_to_likelihood": 2.0,
    "two_threads": 1.2,
    "scans_off_the_line": 3.0,
    "points_exponent": 1.1,
}
"""Factor by which a ratio may be worse than the stored one.

That of plain NumPy is wide: its large temporary arrays cost up to twice as much or not, as the
allocator of the process pleases.
"""
SMALLEST_DEVIATION = 0.05
"""A straight line is straight up to this much."""


def measure_ratios() -> dict[str, float]:
    """All ratios in one run."""
    with threadpool_limits(limits=1):
        head = measure_headline(rounds=250)
        scaling = measure_scaling(quick=True)
    return {
        "likelihood_to_floor": head["floor_ratio"],
        "gradient_to_likelihood": head["gradient_ratio"],
        "plain_to_likelihood": head["plain_ratio"],
        "two_threads": head["two_threads"] / head["two_threads_floor"],
        "scans_off_the_line": max(scaling["scans"]["off_the_line"], SMALLEST_DEVIATION),
        "points_exponent": scaling["points"]["exponent"],
    }


def judge(measured: dict[str, float], stored: dict[str, float]) -> list[str]:
    """One line for every ratio; those that are worse begin with ``WORSE``."""
    lines = []
    for name, words in WORDS.items():
        now, before, margin = measured[name], stored[name], MARGINS[name]
        worse = now < before / margin if name in LARGER_IS_BETTER else now > before * margin
        word = "WORSE" if worse else "ok"
        lines.append(f"{word:<6}{words:<44}{now:>9.3g}   stored {before:.3g}, margin x {margin}")
    return lines


def main() -> int:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--store", action="store_true", help="keep what is measured now")
    options = parser.parse_args()
    measured = {name: float(f"{v:.4g}") for name, v in measure_ratios().items()}
    machine = describe_machine()
    if options.store:
        STORED.write_text(json.dumps({"machine": machine, "ratios": measured}, indent=1) + "\n")
        print(f"stored in {STORED.name}: {measured}")  # noqa: T201
        return 0
    stored: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    print(f"{machine['processor']}, load {machine['load']}")  # noqa: T201
    lines = judge(measured, stored["ratios"])
    print("\n".join(lines))  # noqa: T201
    return int(any(line.startswith("WORSE") for line in lines))


if __name__ == "__main__":
    sys.exit(main())
