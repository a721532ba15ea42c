"""What a laboratory puts on its report: one frozen record of texts and dates.

The items are those that ISO/IEC 17025:2017, clause 7.8, lists for reports and that this program
cannot know. They are printed as they were given; whether a report meets the standard is for the
laboratory to say.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import date
from itertools import pairwise
from typing import Any

from pbrdf_bayes.config import did_you_mean, plain_spaces, show_value
from pbrdf_bayes.errors import ConfigError

SHORT, LONG = 200, 2000
DATES = ("date_received", "date_measured", "date_issued")
LONG_ITEMS = (
    "laboratory_address", "place", "customer_address", "item_description", "item_condition",
    "method", "deviations", "sampling", "environment", "traceability", "decision_rule", "note",
)  # fmt: skip
"""Items that may have several lines and up to `LONG` characters."""
PLACES, MARKS = ("title", "report_number", "item_id"), ("{sample}", "{run}")
"""Items with what is another in every report, and how it is written there."""
_MADE_FROM = ("sample", "wavelength_um", "seed", "created_utc")


@dataclass(frozen=True, kw_only=True)
class Document:
    """The items of a report; what is empty was not given.

    Attributes
    ----------
    title, report_number : str
        Up to `SHORT` characters; the number stands on every printed page. In these two and in
        ``item_id``, ``{sample}`` stands for the name of the sample and ``{run}`` for the number of
        the run (`run_number`), each once at most. In every text, spaces of
        Unicode other than the plain one become that, or U+00A0 where they are no-break ones.
    laboratory, laboratory_address, place : str
        Name and address, and where the measurements were made.
    customer, customer_address : str
    item_description, item_condition, item_id : str
        The sample, its state on receipt, its label.
    date_received, date_measured, date_issued : str
        ISO 8601 dates; ``date_measured`` may be an interval, "2026-03-02/2026-03-05".
    method, deviations, sampling : str
        Method of measurement, what was done otherwise, how the sample was taken.
    environment, traceability, decision_rule : str
        Ambient conditions; to which standards readings are traceable; a rule agreed upon.
    operator, authorised_by, note : str
        Who measured, who answers for the report, and the operator's note.

    Raises
    ------
    ConfigError
        The message names the key, the value and what is allowed.
    """

    title: str = ""
    report_number: str = ""
    laboratory: str = ""
    laboratory_address: str = ""
    place: str = ""
    customer: str = ""
    customer_address: str = ""
    item_description: str = ""
    item_condition: str = ""
    item_id: str = ""
    date_received: str = ""
    date_measured: str = ""
    date_issued: str = ""
    method: str = ""
    deviations: str = ""
    sampling: str = ""
    environment: str = ""
    traceability: str = ""
    decision_rule: str = ""
    operator: str = ""
    authorised_by: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if isinstance(value, str):  # of a word processor: spaces of other widths
                object.__setattr__(self, key, plain_spaces(value))
            _check_text(key, getattr(self, key))
        if not any(asdict(self).values()):
            msg = "no item is given: give at least one, or leave the file away"
            raise ConfigError(msg)
        self._check_order()

    def _check_order(self) -> None:
        known = [(key, _days(key, getattr(self, key))) for key in DATES]
        given = [(key, days) for key, days in known if days]
        for (before, first), (after, then) in pairwise(given):
            if then[0] < first[0] or (after == "date_issued" and then[0] < first[-1]):
                msg = (
                    f"{after} = {getattr(self, after)!r} is before {before} = "
                    f"{getattr(self, before)!r}"
                )
                raise ConfigError(msg)


def run_number(summary: Mapping[str, Any]) -> str:
    """Ten hexadecimal digits that tell a run from every other, from its summary.

    They are a hash of what it was made from and when: file, sample, wavelength, seed, time.
    """
    text = json.dumps([summary["input"]["sha256"], *(summary[key] for key in _MADE_FROM)])
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def fill_in(document: Document, summary: Mapping[str, Any]) -> dict[str, str]:
    """The items for a run, ``{sample}`` and ``{run}`` replaced by its own."""
    own = {"{sample}": str(summary["sample"]), "{run}": run_number(summary)}
    return {key: _filled(text, own) if key in PLACES else text
            for key, text in asdict(document).items()}  # fmt: skip


def _filled(text: str, own: Mapping[str, str]) -> str:
    """In one pass: a sample that is called {run} stays what it is."""
    return re.sub("|".join(map(re.escape, own)), lambda found: own[found[0]], text)


def refuse_shared_items(document: Document, samples: Sequence[str]) -> None:
    """Refuse a report number or a label of the item that several reports would have in common.

    Parameters
    ----------
    document : Document
    samples : sequence of str
        Name of the sample of each report.

    Raises
    ------
    ConfigError
    """
    number, label = (
        [_filled(text, {"{sample}": name}) for name in samples]
        for text in (document.report_number, document.item_id)
    )
    if document.report_number and "{run}" not in document.report_number:
        _refuse_twice("report_number", document.report_number, number, samples)
    if document.item_id and "{run}" not in document.item_id:  # of one item at two wavelengths: once
        items = dict(zip(samples, label, strict=True))
        _refuse_twice("item_id", document.item_id, list(items.values()), list(items))


def _refuse_twice(key: str, given: str, texts: Sequence[str], samples: Sequence[str]) -> None:
    text, n = Counter(texts).most_common(1)[0] if texts else ("", 0)
    if n > 1:
        same = [name for name, one in zip(samples, texts, strict=True) if one == text]
        mark = "{sample}" if len(set(same)) == n else "{run}"
        msg = (
            f"{key} = {show_value(given)} would stand on {n} reports: of "
            f"{', '.join(map(show_value, same[:3]))}{' ...' if n > 3 else ''}. Put {mark} in it, "
            f"e.g. {show_value(given + '-' + mark)}, or leave it out"
        )
        raise ConfigError(msg)


def check_document_keys(given: Iterable[str]) -> None:
    """Refuse keys that `Document` does not have, with the nearest one it has.

    Raises
    ------
    ConfigError
    """
    known = [f.name for f in fields(Document)]
    for key in given:
        if key not in known:
            hint = did_you_mean(key, known)
            msg = f"unknown key {show_value(key)}.{hint} Known: {', '.join(known)}"
            raise ConfigError(msg)


def _check_text(key: str, value: Any) -> None:
    most = LONG if key in LONG_ITEMS else SHORT
    if not isinstance(value, str):
        msg = f"{key} = {show_value(value)} is not allowed: give text in quotes"
        raise ConfigError(msg)
    if len(value) > most:
        msg = f"{key}: {len(value)} characters; allowed are {most}. Shorten it, or refer to a file"
        raise ConfigError(msg)
    lines = value.split("\n") if key in LONG_ITEMS else [value]
    if not all(re.sub("[\t\xa0]", " ", line).isprintable() for line in lines):
        msg = (
            f"{key} = {value[:60]!r} has characters that cannot be printed"
            + ("" if key in LONG_ITEMS else ", or a line break, which this item may not have")
            + ". Take them out"
        )
        raise ConfigError(msg)
    if key in PLACES:
        _check_marks(key, value)


def _check_marks(key: str, text: str) -> None:
    for mark, n in Counter(re.findall(r"\{[^{}]*\}", text)).items():
        if mark not in MARKS or n > 1:
            hint = did_you_mean(mark, MARKS)
            msg = (
                f"{key} = {show_value(text)}: {mark} is "
                + (f"not known.{hint}" if mark not in MARKS else "there twice.")
                + f" Allowed, each once: {', '.join(MARKS)}"
            )
            raise ConfigError(msg)


def _days(key: str, text: str) -> tuple[date, ...]:
    """Dates of an item, in order; none where it is empty."""
    if not text:
        return ()
    parts = text.split("/") if key == "date_measured" else [text]
    try:
        days = tuple(date.fromisoformat(part) for part in parts)
    except ValueError:
        days = ()
    if not 1 <= len(days) <= 2 or list(days) != sorted(days):
        also = ', or from/to: "2026-03-02/2026-03-05"' if key == "date_measured" else ""
        msg = f"{key} = {text[:60]!r} is not allowed: give a date as 2026-03-02{also}"
        raise ConfigError(msg)
    return days
