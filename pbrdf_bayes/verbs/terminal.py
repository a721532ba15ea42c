"""What a person at a terminal sees while something runs: stages and progress, on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from pbrdf_bayes.inference.sampling.sampling import Progress
from pbrdf_bayes.workflow.fitting import Observer

_BAR = 24


def observer(*, quiet: bool, interrupted: Callable[[], bool]) -> Observer:
    """An observer that writes to stderr, silent with ``quiet``, and stops an interrupted run."""
    live = sys.stderr.isatty()

    def say(text: str, end: str) -> None:
        if interrupted():
            raise KeyboardInterrupt
        if not quiet:
            _write(text, end=end)

    return Observer(
        stage=lambda name: say(f"{name} ...", "\n"),
        progress=lambda p: say(progress_line(p), "\r" if live and p.seconds_left else "\n"),
    )


def counter(*, quiet: bool, interrupted: Callable[[], bool]) -> Callable[[str, int, int], None]:
    """Told a stage and how many of how many are done: a line for each stage, with the time left.

    Where stderr is no terminal a stage has a line at its start, at every tenth and at its end.
    """
    live = sys.stderr.isatty()
    started: dict[str, float] = {}
    tenths: dict[str, int] = {}

    def told(stage: str, done: int, of: int) -> None:
        if interrupted():
            raise KeyboardInterrupt
        now = time.perf_counter()
        first = stage not in started
        elapsed = now - started.setdefault(stage, now)
        tenth = 10 * done // max(of, 1)
        due = first or tenth > tenths[stage]
        tenths[stage] = tenth
        if not quiet and (live or due):
            line = f"  {stage} {done}/{of}  {_left(elapsed, done, of)}".rstrip()
            _write(f"{line:<60}", end="\r" if live and done < of else "\n")

    return told


def _left(elapsed: float, done: int, of: int) -> str:
    if done < 2 or done == of:
        return ""
    return f"about {elapsed * (of - done) / (done - 1) + 0.5:.0f} s left"


def _write(text: str, *, end: str) -> None:
    sys.stderr.write(f"{text}{end}")
    sys.stderr.flush()


def progress_line(progress: Progress) -> str:
    """One line: bar, steps, effective sample size, R-hat, time left.

    Examples
    --------
    >>> progress_line(Progress(400, 512.0, 1000, 1.0123, 2.0, 3.4))
    '  [############............]   400 steps  ESS   512/1000  R-hat 1.012  about 4 s left '
    """
    share = min(progress.ess / progress.ess_target, 1.0)
    bar = "#" * int(_BAR * share) + "." * (_BAR - int(_BAR * share))
    left = (
        f"about {progress.seconds_left + 0.5:.0f} s left" if progress.seconds_left else "checking"
    )
    return (
        f"  [{bar}] {progress.n_steps:5d} steps  ESS {progress.ess:5.0f}/{progress.ess_target}"
        f"  R-hat {progress.rhat:.3f}  {left} "
    )
