"""The items of a laboratory's report, and the statement of uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pbrdf_bayes.document import run_number
from pbrdf_bayes.report.numbers import count

Record = Mapping[str, Any]
_FRONT = {
    "report_number": "Report number",
    "customer": "Customer",
    "customer_address": "Address of the customer",
    "item_id": "Label of the item",
    "item_description": "Item",
    "date_received": "Received",
    "date_measured": "Measured",
    "date_issued": "Issued",
    "operator": "Operator",
    "authorised_by": "Authorised by",
}
_DETAILS = {
    "place": "Place of the measurements",
    "item_condition": "Condition of the item",
    "sampling": "Sampling",
    "method": "Method",
    "deviations": "Deviations, additions, exclusions",
    "environment": "Environmental conditions",
    "traceability": "Metrological traceability",
    "decision_rule": "Decision rule agreed upon",
    "note": "Operator's note",
}
_LETTERHEAD = {"title": "title", "laboratory": "laboratory", "laboratory_address": "its address"}
KEYS = tuple({**_LETTERHEAD, **_FRONT, **_DETAILS})
"""Every item that is shown."""
_HOW = {
    "emcee": "draws of a Markov chain",
    "psis": "draws by importance sampling",
}


def given(summary: Record) -> dict[str, str]:
    """Items that were given, by key; empty without a document."""
    return {key: text for key, text in (summary.get("document") or {}).items() if text}


def front_items(summary: Record) -> list[tuple[str, str]]:
    """Short items of the first screen."""
    found = given(summary)
    return [(words, _shown(key, found[key])) for key, words in _FRONT.items() if key in found]


def detail_items(summary: Record) -> list[tuple[str, str]]:
    """Items that take a sentence or more."""
    found = given(summary)
    return [(words, found[key]) for key, words in _DETAILS.items() if key in found]


def not_given(summary: Record) -> str:
    """Names of the items without a text, in one line; nothing without a document."""
    if not summary.get("document"):
        return ""
    found = given(summary)
    names = {**_LETTERHEAD, **_FRONT, **_DETAILS}
    return ", ".join(words.lower() for key, words in names.items() if key not in found)


def identification(summary: Record) -> str:
    """What tells this report from every other: the laboratory's number, or that of the run."""
    number = given(summary).get("report_number")
    return f"Report {number}" if number else f"Report of run {run_number(summary)}"


def signatures(summary: Record) -> list[tuple[str, str]]:
    """Who signs, and as what."""
    found = given(summary)
    return [(_FRONT[key], found[key]) for key in ("operator", "authorised_by") if key in found]


def _shown(key: str, text: str) -> str:
    return text.replace("/", " to ") if key == "date_measured" else text


def uncertainty_text(summary: Record) -> list[str]:
    """The statement of uncertainty in the terms of JCGM 100:2008 and JCGM 101:2008."""
    sampling = summary["sampling"]
    how = _HOW.get(str(sampling["method"]), "draws")
    n = count(sampling["n_draws"])
    words = (
        "The number after ± is the standard uncertainty u (JCGM 100:2008, 2.3.1): the standard "
        "deviation of the distribution that the readings, the model and the priors give to the "
        "quantity; the estimate is its mean. Intervals are coverage intervals for a coverage "
        "probability of 95 %, probabilistically symmetric, from the 2.5 % to the 97.5 % quantile "
        "(JCGM 101:2008, 3.12 and 3.15); bands of curves say their own probability. No coverage "
        "factor is used, for the distributions need not be normal."
    )
    propagated = (
        f"Distributions are propagated by Monte Carlo: {n} {how} of the joint posterior go "
        "through the model one by one (JCGM 101:2008, clause 5.9, with the posterior as "
        "the distribution of the input quantities). Numerical error is stated beside them (MCSE)."
    )
    holds = (
        "The results relate only to the item tested, in the state in which it was measured, and "
        "hold under the model and the priors that this report names."
    )
    return [words, propagated, holds]


def css_string(text: str) -> str:
    r"""A text as a string of CSS in which nothing can end the string or the style element.

    Examples
    --------
    >>> css_string('A-7</style>')
    '"A\\00002d 7\\00003c \\00002f style\\00003e "'
    """
    return (
        '"' + "".join(c if c.isascii() and c.isalnum() else f"\\{ord(c):06x} " for c in text) + '"'
    )
