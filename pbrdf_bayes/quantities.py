"""What is measured, limited or planned, and the states of polarisation, declared once.

A kind of reading is an entry of `QUANTITIES`. Words, units, ranges, columns of a file, labels and
the choices of specifications and designs derive from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, kw_only=True)
class Polarization:
    """A state of polarisation of the incident light.

    Attributes
    ----------
    word : str
        In files, arguments and columns.
    adjective, label : str
        Before a noun, and as a label.
    weights : tuple of float
        Shares of s and p.
    synonyms : tuple of str
        Words of others for it, that a message may explain.
    """

    word: str
    adjective: str
    label: str
    weights: tuple[float, float]
    synonyms: tuple[str, ...] = ()


STATES: Mapping[str, Polarization] = {
    state.word: state
    for state in (
        Polarization(
            word="s", adjective="s-polarised", label="s", weights=(1.0, 0.0),
            synonyms=("te", "perpendicular", "senkrecht"),
        ),
        Polarization(
            word="p", adjective="p-polarised", label="p", weights=(0.0, 1.0),
            synonyms=("tm", "parallel"),
        ),
        Polarization(
            word="u", adjective="unpolarised", label="unpolarised", weights=(0.5, 0.5),
            synonyms=("unpolarized", "unpolarised", "unpol", "none", "mean", "random"),
        ),
    )
}  # fmt: skip
"""By word, in the order of every axis of polarisation and of the codes of the kernels."""
POLARIZATIONS = S, P, U = tuple(STATES)
S_AND_P = (S, P)
"""The states that are pure; ``u`` is the mean of the two."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A kind of reading, or of value that a limit is set on.

    Attributes
    ----------
    word : str
        In files and arguments.
    name, long_name : str
        As a label, and written out.
    unit : str
        In messages and files, ``1`` for none.
    one, reading : str
        A value of it in a sentence, with its article; a measurement of it as a heading.
    hemispherical : bool
        Over all directions of scatter: it has no theta_r and no phi_r.
    port : bool
        Without the light inside a port about the specular direction.
    polarized : bool
        A value belongs to one state of polarisation.
    range : tuple of float
        What it can be; the lower end itself only where it is hemispherical.
    readable : tuple of float
        What noise may make of a reading.
    read, planned, limited : bool
        A file of readings holds it; a design proposes it; a specification may limit it.
    synonyms : tuple of str
        Words of others for it, that a message may explain.
    """

    word: str
    name: str
    long_name: str
    unit: str
    one: str
    reading: str = ""
    hemispherical: bool = False
    port: bool = False
    polarized: bool = True
    range: tuple[float, float]
    readable: tuple[float, float] = (-inf, inf)
    read: bool = False
    planned: bool = False
    limited: bool = False
    synonyms: tuple[str, ...] = ()

    @property
    def angles(self) -> tuple[str, ...]:
        """Columns of angles that a row of it needs."""
        return ("theta_i_deg",) if self.hemispherical else ("theta_i_deg", "theta_r_deg")

    @property
    def shown_unit(self) -> str:
        """As it is printed behind a number; empty for none."""
        return {"sr^-1": "sr⁻¹"}.get(self.unit, "")

    @property
    def axis(self) -> str:
        """The name with its unit, for an axis."""
        return f"{self.name} [{self.shown_unit}]" if self.shown_unit else self.name


QUANTITIES: Mapping[str, Quantity] = {
    quantity.word: quantity
    for quantity in (
        Quantity(
            word="brdf", name="BRDF", long_name="BRDF", unit="sr^-1", one="a BRDF",
            reading="Scan of the BRDF", range=(0.0, inf), read=True, planned=True,
            limited=True, synonyms=("bsdf", "brf"),
        ),
        Quantity(
            word="dhr", name="DHR", long_name="directional hemispherical reflectance", unit="1",
            one="a DHR", reading="DHR reading", hemispherical=True, range=(0.0, 1.0),
            readable=(-0.05, 1.05), read=True, planned=True, limited=True,
            synonyms=("hdr", "tis", "hemispherical", "reflectance"),
        ),
        Quantity(
            word="ddr", name="DDR", long_name="diffuse directional reflectance", unit="1",
            one="a DDR", reading="DDR reading", hemispherical=True, port=True, range=(0.0, 1.0),
            planned=True,
        ),
        Quantity(
            word="brdf_ratio", name="BRDF s/p", long_name="BRDF of s over that of p", unit="1",
            one="a ratio of two BRDFs", polarized=False, range=(0.0, inf), limited=True,
        ),
    )
}  # fmt: skip
"""By word."""

READ = tuple(q.word for q in QUANTITIES.values() if q.read)
"""Quantities of a measurement."""
PLANNED = tuple(q.word for q in QUANTITIES.values() if q.planned)
LIMITED = tuple(q.word for q in QUANTITIES.values() if q.limited)
MEANT: Mapping[str, str] = {
    **{synonym: state.word for state in STATES.values() for synonym in state.synonyms},
    **{synonym: q.word for q in QUANTITIES.values() for synonym in q.synonyms},
}
"""Words of others, and what they mean here."""
