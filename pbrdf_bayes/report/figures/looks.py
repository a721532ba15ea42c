"""Inks and lines: a polarisation is never told by colour alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

INK, MUTED, FAINT, GRID, ALARM = "#1c2126", "#59636e", "#9aa4ae", "#e6e9ec", "#a8201a"
SHADE = "#2b5d86"


@dataclass(frozen=True)
class Look:
    """Word, colour, dashes [px] and marker of a polarisation or an ensemble."""

    word: str
    color: str
    dash: tuple[float, ...]
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """Colour and dashes as matplotlib takes them."""
        return {"color": self.color, "linestyle": (0, self.dash) if self.dash else "-"}


LOOKS = {
    "s": Look("s", "#0067a5", (), "o"),
    "p": Look("p", "#c24d00", (5.0, 2.5), "s"),
    "u": Look("unpolarised (u)", "#00745a", (7.0, 2.0, 1.5, 2.0), "D"),
}
"""Blue, vermilion and green after Okabe and Ito, darkened to be read on white paper."""

ENSEMBLES = (
    Look("", "#0067a5", (), "o"),
    Look("", "#c24d00", (5.0, 2.0), "s"),
    Look("", "#00745a", (1.5, 1.5), "D"),
    Look("", "#a3417f", (7.0, 2.0, 1.5, 2.0), "^"),
)


@dataclass(frozen=True)
class Picture:
    """A plot with its heading and the numbers under it, each with its polarisation."""

    svg: Markup
    title: str | Markup
    notes: tuple[tuple[str, str], ...] = ()

    @property
    def polarizations(self) -> tuple[str, ...]:
        """Polarisations that are drawn."""
        return tuple(p for p, _ in self.notes)
