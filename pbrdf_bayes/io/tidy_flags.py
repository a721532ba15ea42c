"""Rows of a tidy CSV that carry a flag, counted for the samples that they belong to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pbrdf_bayes.io.csv_table import refuse
from pbrdf_bayes.io.tidy_choice import Key
from pbrdf_bayes.io.tidy_rows import Rows

_MOST_COUNTS = 1_000_000

Flags = Mapping[Key, Mapping[str, int]]
"""Flagged rows by flag, by sample and wavelength; "" and 0 where they name none."""


def count_flags(
    path: str, rows: Rows, words: Mapping[str, Sequence[str]], keys: Iterable[Key]
) -> Flags:
    """Count flagged rows, once for all samples and wavelengths ``keys``.

    Raises
    ------
    DataError
        Too many different flags that count in every sample.
    """
    index = np.flatnonzero(~rows.used)
    wavelength = np.where(rows.wavelength_um[index] > 0, rows.wavelength_um[index], 0.0)
    kinds = np.stack([rows.sample[index], wavelength, rows.flag[index]], axis=1)
    names, flags = words["sample"], words["flag"]
    found: dict[tuple[str, float], dict[str, int]] = {}
    for (code, micrometres, flag), n in zip(
        *(part.tolist() for part in np.unique(kinds, axis=0, return_counts=True)), strict=True
    ):
        found.setdefault((names[int(code)], micrometres), {})[flags[int(flag)]] = n
    if sum(len(found.get(place, ())) for key in keys for place in _places(key)) > _MOST_COUNTS:
        reason = "flagged rows that name no sample or no wavelength have too many different flags."
        refuse(path, f"{reason} They count in every sample: fill in where they belong.")
    return found


def excluded_by_flag(flags: Flags, key: Key) -> dict[str, int]:
    """Flagged rows of one sample; those that name no sample or wavelength count everywhere."""
    counts: Counter[str] = Counter()
    for place in _places(key):
        counts.update(flags.get(place, {}))
    return dict(sorted(counts.items()))


def _places(key: Key) -> tuple[Key, ...]:
    """Where `Flags` has the rows that count for a sample and wavelength."""
    return key, (key[0], 0.0), ("", key[1]), ("", 0.0)
