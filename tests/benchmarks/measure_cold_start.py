"""Time and memory of the commands a user waits for, each in a process of its own.

python tests/benchmarks/measure_cold_start.py [--repeats N] [--first-run]

Prints the table that README quotes. ``--first-run`` adds a fit with an empty cache of compiled
kernels, as after an installation. Run it with nothing else running: the load is printed too.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
CSV = ROOT / "data" / "green_paint_simulated" / "green_paint_simulated.csv"
FIT = ("-m", "pbrdf_bayes", "fit", str(CSV), "--quiet", "--out")
LIKELIHOOD = f"""
import time
import numpy as np
import pbrdf_bayes as pb
posterior = pb.build_posterior(pb.read_measurement({str(CSV)!r}), pb.RunConfig())
x = posterior.sample_prior(np.random.default_rng(1), 64)
x[:, :4] = (1.526, 0.193, 0.4528, 0.47)
posterior.log_likelihood(x)
times = []
for _ in range(40):
    started = time.perf_counter()
    posterior.log_likelihood(x)
    times.append((time.perf_counter() - started) / len(x) * 1e6)
print(np.median(times))
"""


class Run(NamedTuple):
    """Wall-clock and processor time [s], peak memory [MB] and output of one process."""

    seconds: float
    cpu: float
    memory: float
    output: str


def measure(arguments: list[str], *, cache: Path | None = None) -> Run:
    """Run one Python process."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache else {})
    started = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, env=environment, text=True, cwd=ROOT
    )
    output = process.stdout.read() if process.stdout else ""
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        message = f"{' '.join(arguments)}: exit code {process.returncode}"
        raise SystemExit(message)
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes here
    return Run(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit, output)


def row(name: str, runs: list[Run]) -> str:
    """Median times and largest memory of repeated runs, as a row of a Markdown table."""
    seconds, cpu = (statistics.median(run[i] for run in runs) for i in (0, 1))
    shown = [f"{t:.2f} s" if t < 2.0 else f"{t:.1f} s" for t in (seconds, cpu)]
    return f"| {name} | {' | '.join(shown)} | {max(run.memory for run in runs):.0f} MB |\n"


def machine() -> str:
    """Processor, cores and versions."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        facts = dict(line.split(":", 1) for line in text.split("\n\n")[0].splitlines())
        found = {key.strip(): value.strip() for key, value in facts.items()}
        processor = f"{found['model name']} at {float(found['cpu MHz']) / 1000:.1f} GHz"
    except (OSError, KeyError, ValueError):
        processor = platform.processor() or platform.machine()
    version = f"{platform.system()}, Python {platform.python_version()}"
    return f"{processor}, {os.cpu_count()} cores, {version}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="fits of each kind (3)")
    parser.add_argument("--first-run", action="store_true", help="also with nothing compiled yet")
    options = parser.parse_args()
    write = sys.stdout.write
    write(f"{machine()}\nload before: {os.getloadavg()[0]:.1f}\n\n")
    write("| What | Time | Processor time | Peak memory |\n| --- | ---: | ---: | ---: |\n")
    fits: list[tuple[str, int, list[str], str]] = [
        ("`fit --accuracy draft` with report", options.repeats, ["--accuracy", "draft"], ""),
        ("`fit` with report", options.repeats, [], ""),
        ("`fit` with report, first run after installation", int(options.first_run), [], "cache"),
    ]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        measure([*FIT, str(folder / "warm"), "--accuracy", "draft"])  # compiles where it has to
        for name, arguments in (
            ("start of Python itself", ["-c", "pass"]),
            ("`import pbrdf_bayes`", ["-c", "import pbrdf_bayes"]),
            ("`pbrdf-bayes --help`", ["-m", "pbrdf_bayes", "--help"]),
            ("`pbrdf-bayes check` of the example", ["-m", "pbrdf_bayes", "check", str(CSV)]),
        ):
            write(row(name, [measure(arguments) for _ in range(max(options.repeats, 5))]))
        for number, (name, count, extra, cache) in enumerate(fits):
            runs = [
                measure(
                    [*FIT, str(folder / f"{number}_{i}"), *extra],
                    cache=folder / cache if cache else None,
                )
                for i in range(count)
            ]
            write(row(name, runs) if runs else "")
    microseconds = float(measure(["-c", LIKELIHOOD]).output)
    write(f"\none likelihood of 3226 readings, on one core: {microseconds:.0f} us\n")
    write(f"load after: {os.getloadavg()[0]:.1f}\n")


if __name__ == "__main__":
    main()
