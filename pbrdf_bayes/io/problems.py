"""Problems of an input file: collected, counted, and worded as one message."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

N_LISTED = 20
"""Problems written out in a message; the rest is counted."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong: where, and what to do about it.

    Attributes
    ----------
    line : int
        Line in the file, the header being line 1; 0 for the file as a whole.
    column : str
        Column name; empty where the line as a whole is meant.
    text : str
        The value seen, what is allowed and the remedy.
    sample : str
        Sample the line belongs to; empty where that cannot be told.
    """

    line: int
    column: str
    text: str
    sample: str = ""

    def __str__(self) -> str:
        place = [f"line {self.line}"] if self.line else []
        place += [f"column {self.column}"] if self.column else []
        return f"{', '.join(place)}: {self.text}" if place else self.text


@dataclass
class Problems:
    """Problems found so far: all of them counted, the first ones kept."""

    found: list[Problem] = field(default_factory=list)
    n: int = 0

    def add(self, problem: Problem, *, n: int = 1) -> None:
        """Keep ``problem`` as one of ``n`` of its kind."""
        self.found.append(problem)
        self.n += n

    def extend(self, problems: Iterable[Problem], *, n: int) -> None:
        """Keep the first ``problems`` of a kind that occurs ``n`` times."""
        self.found.extend(problems)
        self.n += n

    def listed(self) -> tuple[Problem, ...]:
        """First `N_LISTED` problems in the order of the file."""
        return tuple(sorted(self.found, key=lambda problem: problem.line)[:N_LISTED])


def compose_message(source: str, problems: Iterable[Problem], n: int) -> str:
    """Word ``n`` problems, of which the first are given, as one block of text.

    Examples
    --------
    >>> print(compose_message("a.csv", [Problem(3, "value", "empty. Give a number.")], 2))
    a.csv: 2 problems, nothing was read.
      line 3, column value: empty. Give a number.
      ... and 1 more.
    """
    listed = list(problems)
    lines = [f"{source}: {n} problem{'s' if n != 1 else ''}, nothing was read."]
    lines += [f"  {problem}" for problem in listed]
    lines += [f"  ... and {n - len(listed)} more."] if n > len(listed) else []
    return "\n".join(lines)


def show_cell(cell: str) -> str:
    r"""Quote a cell for a message, shortened where it is long, control characters escaped.

    Examples
    --------
    >>> show_cell("a\tb"), len(show_cell("x" * 1000))
    ("'a\\tb'", 43)
    """
    return repr(cell if len(cell) <= 40 else f"{cell[:38]}...")
