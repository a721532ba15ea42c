"""What a person at a terminal sees while something runs: stages and progress, on stderr.

On a terminal lines that change are written over; elsewhere there is a line for each step only.
Nothing is coloured.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pbrdf_bayes.batch.run import Progress as BatchProgress
    from pbrdf_bayes.inference.sampling.sampling import Progress
    from pbrdf_bayes.workflow.fitting import Observer

_BAR = 24
_LONGEST = 200


def screen() -> Callable[[Sequence[str], Sequence[str]], None]:
    """Writes lines that stay, and below them a block that the next call writes over."""
    live = is_live()
    drawn = 0

    def draw(lines: Sequence[str], block: Sequence[str] = ()) -> None:
        nonlocal drawn
        above = ""
        if live:
            above = f"\x1b[{drawn}F\x1b[J" if drawn else ""
            size = shutil.get_terminal_size()
            block = [line[: size.columns - 1] for line in block[: max(size.lines - 2, 1)]]
            lines, drawn = [*lines, *block], len(block)
        sys.stderr.write(above + "".join(f"{line}\n" for line in lines))
        sys.stderr.flush()

    return draw


def is_live() -> bool:
    """Whether stderr is a terminal on which lines can be written over."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def observer(*, quiet: bool, interrupted: Callable[[], bool]) -> Observer:
    """An observer that writes to stderr, silent with ``quiet``, and stops an interrupted run."""
    from pbrdf_bayes.workflow.fitting import Observer

    draw, live = screen(), is_live()

    def say(lines: Sequence[str], block: Sequence[str] = ()) -> None:
        if interrupted():
            raise KeyboardInterrupt
        if not quiet:
            draw(lines, block)

    def progress(p: Progress) -> None:
        line = [progress_line(p)]
        say([], line) if live and p.seconds_left else say(line)

    return Observer(stage=lambda name: say([f"{name} ..."]), progress=progress)


def counter(*, quiet: bool, interrupted: Callable[[], bool]) -> Callable[[str, int, int], None]:
    """Told a stage and how many of how many are done: a line for each stage, with the time left.

    Where stderr is no terminal a stage has a line at its start, at every tenth and at its end.
    """
    draw, live = screen(), is_live()
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
        left = ""
        if 2 <= done < of:
            left = f"about {elapsed * (of - done) / (done - 1) + 0.5:.0f} s left"
        line = [f"  {stage} {done}/{of}  {left}".rstrip()]
        if not quiet and (live or due):
            draw([], line) if live and done < of else draw(line, [])

    return told


def progress_line(progress: Progress) -> str:
    """One line: bar, steps, effective sample size, R-hat, time left.

    Examples
    --------
    >>> from pbrdf_bayes.inference.sampling.sampling import Progress
    >>> progress_line(Progress(400, 512.0, 1000, 1.0123, 2.0, 3.4))
    '  [############............]   400 steps  ESS   512/1000  R-hat 1.012  about 4 s left'
    """
    left = (
        f"about {progress.seconds_left + 0.5:.0f} s left" if progress.seconds_left else "checking"
    )
    return (
        f"  {_bar(progress.ess / progress.ess_target)} {progress.n_steps:5d} steps  "
        f"ESS {progress.ess:5.0f}/{progress.ess_target}  R-hat {progress.rhat:.3f}  {left}"
    )


def _bar(share: float) -> str:
    filled = int(_BAR * min(share, 1.0))
    return f"[{'#' * filled}{'.' * (_BAR - filled)}]"


def teller() -> Callable[[BatchProgress], None]:
    """Of a batch: a line for each sample done, and on a terminal one for each in hand below."""
    draw = screen()

    def tell(progress: BatchProgress) -> None:
        ended = progress.n_done == progress.n_samples
        draw(
            [] if progress.row is None else [sample_line(progress)],
            [] if ended else worker_lines(progress),
        )

    return tell


def repeat_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A warning for every sample that has the readings of another, and every notice."""
    return [
        f"warning: No. {i} {row['sample']!a}: {text}"
        for i, row in enumerate(rows, start=1)
        for text in (row["error"] if row["repeat_of"] else None, row["notice"])
        if text
    ]


def sample_line(progress: BatchProgress) -> str:
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


def worker_lines(progress: BatchProgress) -> list[str]:
    """How far the whole is, and the samples in hand."""
    of = f"{progress.n_done}/{progress.n_samples} samples"
    return [
        f"  {_bar(progress.n_done / max(progress.n_samples, 1))} {of}{_left(progress)}",
        *(f"  {name!a}, {_duration(seconds)}" for name, seconds in progress.running),
    ]


def _left(progress: BatchProgress) -> str:
    return f", about {_duration(progress.seconds_left)} left" if progress.seconds_left else ""


def _duration(left: float) -> str:
    if left < 100:
        return f"{left:.0f} s"
    return f"{left / 60:.0f} min" if left < 6000 else f"{left / 3600:.1f} h"
