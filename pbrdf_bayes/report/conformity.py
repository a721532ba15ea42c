"""What the report says of the conformity with a specification: rows, sentences."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pbrdf_bayes.quantities import QUANTITIES
from pbrdf_bayes.report.numbers import (
    MISSING,
    THIN,
    count,
    degrees,
    finite,
    fixed,
    number,
    percent,
    rounded,
)
from pbrdf_bayes.words import say

Record = Mapping[str, Any]
LOOK_OF = {"ACCEPT": "PASS", "REJECT": "FAIL", "UNDECIDED": "WARN"}
"""Verdicts on conformity by the look that a check of the same colour has."""
WORDS = {"ACCEPT": "Accept", "REJECT": "Reject", "UNDECIDED": "Undecided"}


def conformity_text(summary: Record) -> str:
    """The verdict in a sentence; nothing where no limits were given."""
    found = summary.get("conformity")
    if not found:
        return ""
    lead = say(
        f"conform.{found['verdict'].lower()}", name=found["specification"] or "the limits given"
    )
    because = f": {found['reason']}" if found["reason"] else ""
    remark = f" {sentence(found['remark'])}" if found.get("remark") else ""
    limits = found["limits"]
    judged = sum(_can_be_judged(limit) for limit in limits)
    which = f"all {count(judged)} limits" if judged > 1 else "the limit"
    if judged < len(limits):
        which = f"the {count(judged)} of {count(len(limits))} limits that can be judged"
    joint = (
        f" The posterior probability that the sample conforms with {which} at once is "
        f"{probability_text(found['probability'])}."
        if judged
        else ""
    )
    return f"{lead}{because}.{joint}{risk_text(found)}{remark}"


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def risk_text(found: Record) -> str:
    """The specific risk of the decision made, in a sentence; nothing where none was made."""
    if found["verdict"] == "ACCEPT":
        return f" Specific consumer's risk: {_risk(found)}."
    if found["verdict"] == "REJECT":
        return f" Specific producer's risk: {_risk(found)}."
    return ""


def rule_text(found: Record) -> str:
    """The decision rule in words, with the clauses of JCGM 106:2012."""
    rule = found["decision_rule"]
    if rule["rule"] == "simple":
        words = (
            "simple acceptance (clause 8.2): accepted where the estimate lies within the tolerance "
            "limits, at every angle of a band, otherwise rejected"
        )
    elif rule["rule"] == "guard":
        words = (
            f"guard bands (clause 8.3) of {number(rule['guard_factor'], digits=4)} standard "
            "uncertainties, or of the length stated with a limit: accepted where the estimate lies "
            "within the limits moved in by them, rejected where it lies outside the limits moved "
            "out by them at any angle, otherwise undecided"
        )
    else:
        words = (
            "largest specific risk (terms 3.3.13 and 3.3.14): accepted where the probability of "
            f"not conforming is at most {percent(rule['max_consumer_risk'])}, rejected where that "
            f"of conforming is at most {percent(rule['max_producer_risk'])}, otherwise undecided"
        )
    return (
        f"Decision rule after JCGM 106:2012: {words}. What the Monte Carlo error leaves open is "
        "undecided."
    )


_RULES = {
    "simple": "simple acceptance",
    "guard": "guard bands",
    "risk": "largest specific risk",
}
_TOLD_BY = {"simple": r"\bsimple\b", "guard": r"\bguard", "risk": r"\brisk"}
"""Words of a text that name a decision rule."""
_SIMPLE = r"\b(?:no|without|zero) (?:an? |any )?guard\w*|\bshared[- ]risk"
"""Other words for the simple one."""


def rule_notice(summary: Record) -> str:
    """Say where the rule agreed upon, in the words of the laboratory, is not the one applied.

    Nothing where the words name no rule, or the applied one among others.
    """
    found, agreed = summary.get("conformity"), (summary.get("document") or {}).get("decision_rule")
    if not found or not agreed:
        return ""
    plain = re.sub(_SIMPLE, "simple", agreed.lower())
    named = [rule for rule, words in _TOLD_BY.items() if re.search(words, plain)]
    applied = found["decision_rule"]["rule"]
    if not named or applied in named:
        return ""
    return (
        f"The decision rule agreed upon speaks of {' and '.join(_RULES[rule] for rule in named)}; "
        f"the verdict here follows another one, {_RULES[applied]}."
    )


def measurand_text(found: Record) -> str:
    """What is limited, and what is in its uncertainty."""
    curve = (
        "a BRDF is that of the sample, the curve of the model times its discrepancy, drawn with "
        "its correlation along the scan"
        if found["discrepancy"]
        else "a BRDF is that of the model, whose discrepancy was not inferred"
    )
    words = (
        "Limited are the properties of the sample and not new readings: noise and gains of the "
        f"instrument are not in them; {curve}. A band of angles conforms where all its angles do "
        f"at once, in the same of {count(found['n_draws'])} draws. "
    )
    if found["reference"]:
        words += (
            f"Differences are to the reference sample {found['reference']['sample']!r}; errors of "
            "calibration that both share are taken as independent, which states the difference "
            "too uncertain rather than too certain. "
        )
    return words


def limit_rows(summary: Record) -> list[dict[str, Any]]:
    """One row a limit; values at the point where it is least probably met."""
    found = summary.get("conformity")
    return [] if not found else [_row(limit, summary) for limit in found["limits"]]


def _row(limit: Record, summary: Record) -> dict[str, Any]:
    at = limit["worst"]
    known = finite(limit["mean"][at]) is not None
    shown = rounded(limit["mean"][at], limit["u"][at], low=limit["q025"][at],
                    high=limit["q975"][at])  # fmt: skip
    return {
        "name": limit["name"],
        "look": LOOK_OF[limit["verdict"]],
        "verdict": WORDS[limit["verdict"]],
        "reason": limit["reason"] or limit.get("remark", ""),
        "what": what_text(limit, summary),
        "tolerance": tolerance_text(limit),
        "value": f"{shown.value} ± {shown.uncertainty}" if known else MISSING,
        "interval": f"{shown.low} to {shown.high}" if known else "",
        "where": where_text(limit, at),
        "probability": probability_text(limit["probability"]) if known else MISSING,
        "exceeds": exceedance_text(limit) if known else "",
        "risk": _risk(limit),
        "whose": {"ACCEPT": "consumer", "REJECT": "producer"}.get(limit["verdict"], ""),
    }


def _can_be_judged(limit: Record) -> bool:
    return bool(limit["judged"])


def _risk(found: Record) -> str:
    """The risk of the decision, or what it is at most where no draw speaks against it."""
    p = found["probability"]
    if found["verdict"] == "UNDECIDED":
        return MISSING
    value = found["consumer_risk"] if found["verdict"] == "ACCEPT" else found["producer_risk"]
    most = 1.0 - p["low"] if found["verdict"] == "ACCEPT" else p["high"]
    return f"below {percent(most)}" if value == 0.0 else percent(value)


def probability_text(p: Record) -> str:
    r"""A probability with its Monte Carlo error; a bound where all draws agree.

    Examples
    --------
    >>> probability_text({"value": 1.0, "u": 0.0, "low": 0.9982, "high": 1.0})
    'above 99.8\u202f%'
    >>> probability_text({"value": 0.9523, "u": 0.0034, "low": 0.945, "high": 0.958})
    '95.2 ± 0.3\u202f%'
    """
    if p["value"] in (0.0, 1.0):
        bound, word = (p["low"], "above") if p["value"] == 1.0 else (p["high"], "below")
        return f"{word} {percent(bound, digits=3 if bound > 0.5 else 2)}"
    decimals = 1 if p["u"] >= 5e-4 else 2
    return f"{fixed(100 * p['value'], decimals)} ± {fixed(100 * p['u'], decimals)}{THIN}%"


def exceedance_text(limit: Record) -> str:
    """Probability that a difference exceeds its tolerance; nothing for other limits."""
    found = limit.get("probability_exceeds")
    return probability_text(found) if found else ""


def what_text(limit: Record, summary: Record) -> str:
    """The measurand in words."""
    if limit["quantity"] == "parameter":
        known = summary["parameters"].get(limit["parameter"])
        name = known["symbol"] if known else limit["parameter"]
    else:
        name = f"{QUANTITIES[limit['quantity']].name} {limit['polarization']}".strip()
        name += f", {_angles('θᵢ', limit['theta_i_deg'])}"
        if limit["theta_r_deg"]:
            name += f", {_angles('θᵣ', limit['theta_r_deg'])}"
        if limit["phi_r_deg"]:
            name += f", φᵣ {degrees(limit['phi_r_deg'])}"
    return f"difference of {name}" if limit["difference"] else name


def _angles(symbol: str, values: list[float]) -> str:
    distinct = sorted(set(values))
    if len(distinct) == 1:
        return f"{symbol} {degrees(distinct[0])}"
    return f"{symbol} {degrees(distinct[0])} to {degrees(distinct[-1])}"


def tolerance_text(limit: Record) -> str:
    """Tolerance interval with its unit."""
    low, high, unit = limit["lower"], limit["upper"], limit["unit"]
    after = f"{THIN}{unit}" if unit else ""
    if limit["difference"]:
        return f"± {number(high, digits=5)}{after}"
    if low is None:
        return f"at most {number(high, digits=5)}{after}"
    if high is None:
        return f"at least {number(low, digits=5)}{after}"
    return f"{number(low, digits=5)} to {number(high, digits=5)}{after}"


def where_text(limit: Record, at: int) -> str:
    """The angles of a point of a band; nothing for a single point."""
    if len(limit["mean"]) == 1:
        return ""
    where = f"at θᵢ {degrees(limit['theta_i_deg'][at])}"
    if limit["theta_r_deg"]:
        return f"{where}, θᵣ {degrees(limit['theta_r_deg'][at])}"
    return where
