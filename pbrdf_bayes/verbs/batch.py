"""The verb ``batch``: its arguments; no science."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pbrdf_bayes.verbs.arguments import (
    DONE,
    STRICT_FAIL,
    add_choices,
    add_verb,
    effects,
    interrupted,
)
from pbrdf_bayes.verbs.conform import add_paperwork, paperwork_of

_EPILOG = """\
Every sample of every file gets a run folder in DIR, named after it and a hash of its readings,
configuration, seed and version, and a row in index.html, index.csv and index.json. A sample that
cannot be fitted is listed with its error. Files come in the order given; where a shell has sorted
them, by the numbers in their names: lot_2 before lot_10. Reports are in short form; 'report' draws
all figures. With --limits every sample is judged (see 'conform'); with --resume those that are
finished too, where the limits are others than before.

workers on other machines, which must see DIR under the same path:
  dask scheduler
  dask worker tcp://HOST:8786 --nworkers 8 --nthreads 1
  pbrdf-bayes batch *.csv --out DIR --scheduler tcp://HOST:8786

exit codes: 0 every sample has a row, even where some failed; with --strict 4 where one failed, has
the verdict FAIL, or with --limits is anything but ACCEPT; 2 bad usage; 3 the scheduler was lost,
130 interrupted: go on with --resume
"""


def add_batch(verbs: Any) -> None:
    """The verb ``batch``."""
    parser = add_verb(
        verbs, "batch", _batch, "Fit every sample of some files, with an index.", epilog=_EPILOG
    )
    parser.add_argument("csv", type=Path, nargs="+", metavar="CSV")
    parser.add_argument("--out", type=Path, metavar="DIR",
                        help="folder of the batch (default reports/batch/<time>)")  # fmt: skip
    add_choices(parser, of="every run")
    parser.add_argument("--workers", type=_workers, default=1, metavar="N",
                        help="processes on this machine (default 1)")  # fmt: skip
    parser.add_argument("--scheduler", metavar="ADDRESS",
                        help="workers of a Dask scheduler instead, see below")  # fmt: skip
    parser.add_argument("--resume", action="store_true",
                        help="go on with the batch in DIR or start it")  # fmt: skip
    parser.add_argument("--strict", action="store_true",
                        help="exit 4 when a sample failed, is FAIL, or is not ACCEPT")  # fmt: skip
    add_paperwork(parser, pdf=False)
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")


def _workers(text: str) -> int:
    if not (text.isdecimal() and 1 <= len(text) <= 4 and 1 <= int(text) <= 1024):
        msg = f"{text[:40]!r}: give a whole number from 1 to 1024"
        raise argparse.ArgumentTypeError(msg)
    return int(text)


def _batch(options: argparse.Namespace) -> int:
    from pbrdf_bayes.batch.run import fit_batch
    from pbrdf_bayes.errors import ConfigError
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.verbs.terminal import repeat_lines, teller

    if options.scheduler is not None and options.workers != 1:
        msg = "--workers with --scheduler: the scheduler has workers of its own. Give one of them"
        raise ConfigError(msg)
    config = read_config(
        options.config, {"accuracy": options.accuracy, "effects": effects(options.effects)}
    )
    wanted = paperwork_of(options)
    try:
        result = fit_batch(
            options.csv, config, out=options.out, seed=options.seed, workers=options.workers,
            scheduler=options.scheduler, resume=options.resume,
            limits=wanted.specification, reference=wanted.reference, document=wanted.document,
            told=None if options.quiet else teller(), interrupted=interrupted.is_set,
        )  # fmt: skip
    except KeyboardInterrupt as stop:
        stop.add_note("go on with --resume and the same --out; the index holds what is done")
        raise
    for line in repeat_lines(result.samples) if options.quiet else ():
        print(line, file=sys.stderr)
    print(result.folder)
    return STRICT_FAIL if options.strict and not result.is_clean else DONE
