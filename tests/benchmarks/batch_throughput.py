"""What a batch costs: samples a minute for one and two workers, overhead, memory over the run.

Both runs do the same samples, one after the other, so that only their ratio is quoted from a
machine that is not alone; the pace once running leaves out the first sample of each worker.
Overhead is what a sample takes with one worker beyond the bare fit of the same readings (`pb.fit`:
no run folder, no report), start of the worker left out.

    python tests/benchmarks/batch_throughput.py --samples 12
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil

import pbrdf_bayes as pb

_EVERY = 0.2


def write_lots(path: Path, n: int) -> None:
    """Lots of a paint that differ a little: 10 scans of 81 points and 16 DHR readings each."""
    rng = np.random.default_rng(5)
    lines: list[str] = []
    for i in range(n):
        paint = replace(
            pb.GREEN_PAINT, n=pb.GREEN_PAINT.n + 0.02 * rng.normal(),
            rho0=pb.GREEN_PAINT.rho0 * np.exp(0.05 * rng.normal()),
        )  # fmt: skip
        m = pb.simulate_measurement(
            paint, seed=100 + i, sample=f"lot_{i + 1:03d}_simulated",
            theta_i_deg=(0.0, 20.0, 40.0, 60.0, 75.0), theta_r_deg=np.linspace(-80.0, 80.0, 81),
        )  # fmt: skip
        one = path.with_name("one.csv")
        pb.write_tidy_csv(m, one)
        text = one.read_text().splitlines()
        lines += text[bool(lines) :]
    path.write_text("\n".join(lines) + "\n")


def watch(process: subprocess.Popen[str], sizes: dict[int, list[tuple[float, float]]]) -> None:
    """Resident memory [MB] of every worker over time."""
    began = time.perf_counter()
    while process.poll() is None:
        try:
            children = psutil.Process(process.pid).children(recursive=True)
            for child in children:
                if "spawn_main" in " ".join(child.cmdline()):
                    size = child.memory_info().rss / 2**20
                    sizes.setdefault(child.pid, []).append((time.perf_counter() - began, size))
        except psutil.Error:
            continue
        time.sleep(_EVERY)


def run(file: Path, out: Path, workers: int) -> dict[str, object]:
    """One batch in a process of its own."""
    command = [
        sys.executable, "-m", "pbrdf_bayes", "batch", str(file), "--out", str(out), "--accuracy",
        "draft", "--workers", str(workers), "--quiet",
    ]  # fmt: skip
    sizes: dict[int, list[tuple[float, float]]] = {}
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, text=True)
    thread = threading.Thread(target=watch, args=(process, sizes))
    thread.start()
    process.wait()
    wall = time.perf_counter() - began
    thread.join()
    rows = json.loads((out / "index.json").read_text())["samples"]
    ends = sorted((out / row["run"] / "summary.json").stat().st_mtime for row in rows)
    return {
        "wall": wall, "failed": sum(row["status"] != "done" for row in rows), "sizes": sizes,
        "fits": [row["seconds"] for row in rows], "steady": (ends[-1] - ends[workers - 1]) / (len(ends) - workers),
        "verdicts": sorted({row["verdict"] for row in rows}),
    }  # fmt: skip


def bare_fits(file: Path, n: int) -> list[float]:
    """Seconds of `pb.fit` for every sample after the first."""
    config = pb.RunConfig(accuracy="draft", threads=1)
    seconds = []
    for i in range(n):
        measurement = pb.read_measurement(file, sample=f"lot_{i + 1:03d}_simulated")
        began = time.perf_counter()
        pb.fit(measurement, config, seed=1)
        seconds.append(time.perf_counter() - began)
    return seconds[1:]


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=12)
    n = parser.parse_args().samples
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "lots.csv"
        write_lots(file, n)
        found = {k: run(file, Path(folder) / f"out{k}", k) for k in (1, 2)}
        bare = float(np.mean(bare_fits(file, n)))
    for k, r in found.items():
        pace, fits = float(r["steady"]), np.array(r["fits"][k:])  # type: ignore[arg-type,index]
        print(
            f"{k} worker{'s' * (k > 1)}: {r['wall']:.1f} s for {n} samples, {60 / pace:.1f} samples "
            f"a minute once running, {np.median(fits):.2f} s a fit (median), failed {r['failed']}, "
            f"verdicts {', '.join(r['verdicts'])}"  # type: ignore[arg-type]
        )
        for i, curve in enumerate(r["sizes"].values()):  # type: ignore[union-attr,attr-defined]
            size = np.array(curve)[:, 1]
            thirds = [part.max() for part in np.array_split(size, 3)]
            print(f"  worker {i + 1}: peak {size.max():.0f} MB; by thirds of the run "
                  + ", ".join(f"{t:.0f}" for t in thirds))  # fmt: skip
    one, two = found[1], found[2]
    print(f"2 workers over 1: {float(one['steady']) / float(two['steady']):.2f} once running, "  # type: ignore[arg-type]
          f"{float(one['wall']) / float(two['wall']):.2f} start included")  # type: ignore[arg-type]  # fmt: skip
    overhead = float(one["steady"]) / bare - 1.0  # type: ignore[arg-type]
    print(f"bare fit {bare:.2f} s (mean); overhead a sample {100 * overhead:.1f} % of it")


if __name__ == "__main__":
    main()
