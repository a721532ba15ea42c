"""Which of the samples and wavelengths of a file is meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isclose

from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.io.problems import N_LISTED, Problem, show_cell

Key = tuple[str, float]
"""Sample and wavelength [um]."""


def choose_key(
    names: Sequence[str], keys: Iterable[Key], sample: str | None, wavelength_um: float | None
) -> Key | Problem | None:
    """Find the sample and wavelength asked for, or say why there is none.

    Parameters
    ----------
    names : sequence of str
        Samples with rows that are not flagged.
    keys : iterable of (str, float)
        Samples and wavelengths with rows that have no problem.
    sample, wavelength_um : str and float, optional
        What was asked for; not needed where there is only one.

    Returns
    -------
    (str, float) or Problem or None
        None where all rows of the sample have problems, which are reported by themselves.

    Examples
    --------
    >>> choose_key(["green"], [("green", 3.39), ("green", 4.5)], None, 3.39)
    ('green', 3.39)
    """
    if sample is None and len(names) == 1:
        sample = names[0]
    if sample is None or sample not in names:
        return Problem(0, "sample", explain_sample(sample, names))
    present = [wavelength for name, wavelength in keys if name == sample]
    found = [w for w in present if wavelength_um is None or isclose(w, wavelength_um, rel_tol=1e-6)]
    if len(found) == 1:
        return sample, found[0]
    if not present:
        return None
    return Problem(0, "wavelength_um", _explain_wavelength(sample, wavelength_um, present))


def explain_sample(sample: str | None, names: Sequence[str]) -> str:
    """Say why no sample is chosen, and which there are."""
    if not names:
        return "every row is flagged, no reading is left. Clear the flag of rows to be used."
    listed = _list_some([show_cell(name) for name in names])
    if sample is None:
        return f"the file has {len(names)} samples. Choose one (sample=, or --sample): {listed}."
    hint = did_you_mean(sample, names)
    return f"{show_cell(sample)} has no rows to use.{hint} The file has: {listed}."


def _explain_wavelength(sample: str, wanted: float | None, present: Sequence[float]) -> str:
    """Say why no wavelength is chosen, and which there are."""
    listed = f"sample {show_cell(sample)} has {_list_some([f'{w:.10g}' for w in present])} um."
    if wanted is None:
        return f"{listed} Choose one (wavelength_um=, or --wavelength)."
    return f"{wanted:.10g} um was not measured: {listed} Choose one of them."


def _list_some(words: Sequence[str]) -> str:
    """First words of a list, and how many there are where they are too many."""
    more = f", ... ({len(words)} in all)" if len(words) > N_LISTED else ""
    return ", ".join(words[:N_LISTED]) + more
