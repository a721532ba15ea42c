"""What a person sees of a batch while it runs, on stderr."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pbrdf_bayes.batch.progress import Progress

_LONGEST = 200


def repeat_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A warning for every sample that has the readings of another, and every notice."""
    return [
        f"warning: No. {i} {row['sample']!a}: {text}"
        for i, row in enumerate(rows, start=1)
        for text in (row["error"] if row["repeat_of"] else None, row["notice"])
        if text
    ]


def teller() -> Callable[[Progress], None]:
    """On a terminal a line for each worker, written over; else a line for each sample done."""
    live = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    drawn = 0

    def tell(progress: Progress) -> None:
        nonlocal drawn
        lines = [] if progress.row is None else [sample_line(progress)]
        ended = progress.n_done == progress.n_samples
        if live:
            size = shutil.get_terminal_size()
            block = [] if ended else worker_lines(progress)[: max(size.lines - 2, 1)]
            above = f"\x1b[{drawn}F\x1b[J" if drawn else ""
            text = "\n".join([*lines, *(line[: size.columns - 1] for line in block), ""])
            sys.stderr.write(f"{above}{text}")
            drawn = len(block)
        else:
            sys.stderr.write("".join(f"{line}\n" for line in lines))
        sys.stderr.flush()

    return tell


def sample_line(progress: Progress) -> str:
    """What came out for a sample, how far the whole is, and how long it will take."""
    row = progress.row
    assert row is not None
    status = "warning" if row["repeat_of"] else row["status"]
    what = row["verdict"] or f"{status}: {_reason(row['error'])}"
    what += f", {row['conformity']}" if row["conformity"] else ""
    what += f", warning: {_shortened(row['notice'])}" if row["notice"] else ""
    took = f" ({row['seconds']:.1f} s)" if row["seconds"] else ""
    of = f"[{progress.n_done}/{progress.n_samples}]"
    return f"{of} {row['sample']!a}: {what}{took}{_left(progress)}"


def _reason(error: str) -> str:
    """What is wrong, without the head of a message that lists it."""
    head, *problems = error.splitlines()
    return _shortened(" ".join(problems) or head)


def _shortened(text: str) -> str:
    """At most `_LONGEST` characters, whole words as far as there are blanks."""
    plain = " ".join(text.split())
    if len(plain) <= _LONGEST:
        return plain
    cut = plain[: _LONGEST - 3]
    blank = cut.rfind(" ", _LONGEST // 2)
    return f"{cut[:blank] if blank > 0 else cut}..."


def worker_lines(progress: Progress) -> list[str]:
    """How far the whole is, and what each worker does.

    Returns
    -------
    list of str
    """
    share = progress.n_done / max(progress.n_samples, 1)
    bar = "#" * int(24 * share) + "." * (24 - int(24 * share))
    lines = [f"  [{bar}] {progress.n_done}/{progress.n_samples} samples{_left(progress)}"]
    lines += [
        f"  worker {one.worker}: {one.sample!a}, {one.stage}, {_duration(one.seconds)}"
        for one in progress.at_work
    ]
    told = {one.sample for one in progress.at_work}
    rest = [f"  worker: {name!a}" for name in progress.running if name not in told]
    rest += ["  worker: starts or waits"] * progress.n_workers
    return lines + rest[: max(progress.n_workers - len(progress.at_work), 0)]


def _left(progress: Progress) -> str:
    return f", about {_duration(progress.seconds_left)} left" if progress.seconds_left else ""


def _duration(left: float) -> str:
    if left < 100:
        return f"{left:.0f} s"
    return f"{left / 60:.0f} min" if left < 6000 else f"{left / 3600:.1f} h"
