"""What verbs of the command line share: exit codes, kinds of arguments, their parser."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Any

from pbrdf_bayes.errors import ConfigError

DONE, BAD_INPUT, NOT_CONVERGED, STRICT_FAIL, INTERRUPTED = 0, 2, 3, 4, 130

interrupted = threading.Event()
"""Set by a signal: an exception that meets a foreign callback is lost there."""


class HelpFormatter(argparse.HelpFormatter):
    """Paragraphs of running text are filled, lines of examples stay as they are.

    An example is what is indented by two blanks; an empty line parts paragraphs.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        filled: list[str] = []
        for is_example, lines in groupby(
            text.splitlines(), lambda line: line.startswith("  ") or not line
        ):
            if is_example:
                filled += [f"{indent}{line}" for line in lines]
            else:
                filled.append(super()._fill_text(" ".join(lines), width, indent))
        return "\n".join(filled)


def add_verb(
    verbs: Any, name: str, run: Callable[[argparse.Namespace], int], text: str, epilog: str = ""
) -> argparse.ArgumentParser:
    """A sub-parser whose options are handed to ``run``, which returns the exit code."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name, help=text, description=text, epilog=epilog, formatter_class=HelpFormatter
    )
    parser.set_defaults(run=run)
    return parser


def add_choices(parser: argparse.ArgumentParser, *, of: str) -> None:
    """Arguments of every verb that fits."""
    parser.add_argument("--config", type=Path, metavar="TOML", help=f"choices of {of}")
    parser.add_argument("--accuracy", metavar="LEVEL",
                        help="draft, standard (default) or reference")  # fmt: skip
    parser.add_argument("--effects", metavar="NAMES",
                        help="none (default), auto, or names: lambert,volume")  # fmt: skip
    parser.add_argument("--seed", type=seed, default=1, metavar="N", help="seed (default 1)")


def seed(text: str) -> int:
    """A seed."""
    if not (text.isdecimal() and len(text) <= 18):
        msg = f"{text[:40]!r}: give a whole number that is not negative, of up to 18 digits"
        raise argparse.ArgumentTypeError(msg)
    return int(text)


def numbers(text: str) -> list[float]:
    """Numbers with commas."""
    try:
        return [float(part) for part in text.split(",") if part.strip()]
    except ValueError:
        msg = f"{text!r}: give numbers with commas, e.g. 20,40,60"
        raise argparse.ArgumentTypeError(msg) from None


def grid(text: str) -> list[float]:
    """One angle, or LO:HI:STEP."""
    from pbrdf_bayes.scenes import spaced

    try:
        return spaced(text if ":" in text else f"{text}:{text}:1", most=1_000_000)
    except ValueError:
        msg = f"{text!r}: give one angle, or LO:HI:STEP with STEP > 0, e.g. -80:80:0.5"
        raise argparse.ArgumentTypeError(msg) from None


def angles(text: str) -> list[float]:
    """Angles with commas, or LO:HI:STEP."""
    return grid(text) if ":" in text else numbers(text)


def words(text: str) -> list[str]:
    """Polarisations with commas."""
    from pbrdf_bayes.quantities import POLARIZATIONS

    found = [part.strip() for part in text.split(",") if part.strip()]
    if not found or any(word not in POLARIZATIONS for word in found):
        msg = f"{text!r}: give s, p or u with commas"
        raise argparse.ArgumentTypeError(msg)
    return found


def effects(text: str | None) -> tuple[str, ...] | None:
    """Names of effects with commas, or ``none``.

    Raises
    ------
    ConfigError
        Where a name is empty.
    """
    if text is None:
        return None
    if text.strip() == "none":
        return ()
    found = tuple(part.strip() for part in text.split(","))
    if "" in found:
        msg = f"--effects {text!r}: give names with commas, e.g. lambert,volume, or none, or auto"
        raise ConfigError(msg)
    return found
