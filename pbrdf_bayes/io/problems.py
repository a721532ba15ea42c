"""Problems of an input file: collected, counted, and worded as one message."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

N_LISTED = 20
"""Problems written out in a message; the rest is counted."""
N_LINES = 4
"""Lines named where several have the same problem."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong, in one line or in several: where, and what to do about it.

    Attributes
    ----------
    line : int
        (First) line in the file, the header being line 1; 0 for the file as a whole.
    column : str
        Column name; empty where the line as a whole is meant.
    text : str
        The value seen, what is allowed and the remedy.
    sample : str
        Sample the line belongs to; empty where that cannot be told.
    kind : str
        What problems of this kind have in common; the text itself by default.
    n : int
        Lines that have it.
    lines : tuple of int
        The first of them; ``line`` alone by default.
    """

    line: int
    column: str
    text: str
    sample: str = ""
    kind: str = ""
    n: int = 1
    lines: tuple[int, ...] = ()

    def __str__(self) -> str:
        place = [f"line {self.line}"] if self.line else []
        place += [f"column {self.column}"] if self.column else []
        text = f"{', '.join(place)}: {self.text}" if place else self.text
        return f"{text} {self._others()}" if self.n > 1 else text

    def _others(self) -> str:
        others = ", ".join(str(line) for line in self.lines[1:])
        more = ", ..." if self.n > len(self.lines) else ""
        return f"The same in line{'s' if self.n > 2 else ''} {others}{more} ({self.n} rows in all)."

    def of(self, sample: str) -> Problem:
        """The same problem in lines of a sample."""
        return replace(self, sample=sample)

    def joined(self, other: Problem) -> Problem:
        """The same problem in the lines of both."""
        first = min(self, other, key=lambda problem: problem.line)
        lines = sorted((*(self.lines or (self.line,)), *(other.lines or (other.line,))))
        return replace(first, n=self.n + other.n, lines=tuple(lines[:N_LINES]))


@dataclass
class Problems:
    """Problems found so far: by sample one for each column and kind, and the number of all."""

    found: dict[str, dict[tuple[str, str], Problem]] = field(default_factory=dict)
    n: int = 0

    def add(self, problem: Problem) -> None:
        """Keep ``problem``, with others of its kind as one."""
        own = self.found.setdefault(problem.sample, {})
        key = (problem.column, problem.kind or problem.text)
        own[key] = own[key].joined(problem) if key in own else problem
        self.n += problem.n

    def extend(self, other: Problems) -> None:
        """Keep those of another as well."""
        for own in other.found.values():
            for problem in own.values():
                self.add(problem)

    def listed(self, sample: str | None = None) -> tuple[Problem, ...]:
        """First `N_LISTED` kinds in the order of the file, of all samples together or of one."""
        kinds: dict[tuple[str, str], Problem] = {}
        for own in self.found.values() if sample is None else (self.found.get(sample, {}),):
            for key, problem in own.items():
                kinds[key] = kinds[key].joined(problem) if key in kinds else problem
        return tuple(sorted(kinds.values(), key=lambda problem: problem.line)[:N_LISTED])


def compose_message(source: str, problems: Iterable[Problem], n: int) -> str:
    """Word ``n`` problems, of which the first kinds are given, as one block of text.

    Examples
    --------
    >>> print(compose_message("a.csv", [Problem(3, "value", "empty. Give a number.")], 2))
    a.csv: 2 problems, nothing was read.
      line 3, column value: empty. Give a number.
      ... and 1 more.
    """
    listed = list(problems)
    lines = [f"{printable(source)}: {n} problem{'s' if n != 1 else ''}, nothing was read."]
    lines += [f"  {problem}" for problem in listed]
    left = n - sum(problem.n for problem in listed)
    lines += [f"  ... and {left} more."] if left else []
    return "\n".join(lines)


def printable(text: str) -> str:
    r"""Text with what cannot be seen escaped: control characters, turned directions, odd blanks.

    Examples
    --------
    >>> printable("a\tb"), printable("l\u202et"), printable("Lot 7")
    ('a\\tb', 'l\\u202et', 'Lot 7')
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def show_cell(cell: str) -> str:
    r"""Quote a cell for a message, shortened where it is long, control characters escaped.

    Examples
    --------
    >>> show_cell("a\tb"), len(show_cell("x" * 1000))
    ("'a\\tb'", 43)
    """
    return repr(cell if len(cell) <= 40 else f"{cell[:38]}...")
