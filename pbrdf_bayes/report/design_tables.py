"""Rows of a design for its page and for the report: text, prepared to be placed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pbrdf_bayes.report.numbers import MISSING, THIN, count, decimals_of, finite, fixed, number
from pbrdf_bayes.words import listed, say

Record = Mapping[str, Any]

_IN_REPORT = 5
_BEST = {"tied": "gain", "tied_per_minute": "gain a minute"}
"""What a candidate is not beaten in, within the error of the calculation."""
_BEST_FOR_GOAL = {
    "tied": "reduction", "tied_per_minute": "reduction a minute", "pareto": "reduction and minutes",
}  # fmt: skip
_OF_GOAL = 5
LOCAL = "local"
"""Method of what is by the local normal approximation."""
_MARK = "*"


def next_section(design: Record) -> dict[str, Any]:
    """What the report of a run says of the next measurement."""
    rows = candidate_rows(evaluated(design)[:_IN_REPORT])
    return {
        "paragraphs": design["recommendation"].split("\n"),
        "rows": rows,
        "local": any(row["local"] for row in rows),
        "names": list(design["sd_before"]),
        "about": listed(design["about"]),
        "n_candidates": count(design["n_candidates"]),
    }


def evaluated(design: Record) -> list[Record]:
    """Candidates that were simulated, the largest gain first."""
    return [row for row in design["candidates"] if row["eig_nats"] is not None]


def candidate_rows(rows: Sequence[Record]) -> list[dict[str, Any]]:
    """Candidates with their gains and the standard deviations that they leave."""
    places = (
        decimals_of(max(row["eig_se"] for row in rows)) or 2,
        decimals_of(max(row["eig_per_minute_se"] for row in rows)) or 4,
    )
    return [_candidate_row(row, *places) for row in rows]


def _candidate_row(row: Record, places: int, places_per_minute: int) -> dict[str, Any]:
    best = [words for key, words in _BEST.items() if row[key]]
    return {
        "label": row["label"],
        "note": "measured before" if row["repeat"] else "",
        "minutes": number(row["minutes"]),
        "gain": _gain(row, places),
        "bracket": f"{fixed(row['eig_low'], places)} to {fixed(row['eig_high'], places)}",
        "local": LOCAL in (row.get("eig_method"), row.get("sd_method")),
        "per_minute": fixed(row["eig_per_minute"], places_per_minute),
        "p_best": _percent(row["p_best"]),
        "p_best_per_minute": _percent(row["p_best_per_minute"]),
        "best": ", ".join(best),
        "ratios": [_left(row, ratio) for ratio in row["sd_ratio"].values()],
        "shares": [_share(ratio["ratio"]) for ratio in row["sd_ratio"].values()],
    }


def _gain(row: Record, places: int) -> str:
    """A gain with its error."""
    mark = _MARK if row.get("eig_method") == LOCAL else ""
    return f"{fixed(row['eig_nats'], places)} ± {fixed(row['eig_se'], places)}{mark}"


def _share(ratio: float | None) -> str:
    """Of small ones one decimal."""
    if ratio is None or ratio >= 0.0995:
        return _percent(ratio)
    return f"{fixed(100.0 * ratio, 1)}{THIN}%"


def _left(row: Record, ratio: Mapping[str, Any]) -> str:
    """Standard deviation after over before with its error."""
    if ratio["ratio"] is None:
        return MISSING
    mark = _MARK if LOCAL in (row.get("sd_method"), row.get("method")) else ""
    places = 0 if ratio["ratio"] >= 0.1 else 1
    return _with_error(ratio["ratio"], ratio["se"], places) + mark


def goal_tables(design: Record) -> list[dict[str, Any]]:
    """For each goal the candidates that sharpen it most, and the best one for each minute."""
    return [_goal_table(goal) for goal in design.get("goals", ())]


def _goal_table(goal: Record) -> dict[str, Any]:
    rows = goal["candidates"]
    first = max(rows, key=lambda row: row["reduction_per_minute"])
    shown = [*rows[:_OF_GOAL], *([] if first in rows[:_OF_GOAL] else [first])]
    return {
        "name": goal["name"],
        "rows": [_goal_row(row) for row in shown],
        "n_more": len(rows) - len(shown),
        "local": any(row.get("method") == LOCAL for row in shown),
    }


def _goal_row(row: Record) -> dict[str, str]:
    best = [words for key, words in _BEST_FOR_GOAL.items() if row[key]]
    return {
        "label": row["label"],
        "minutes": number(row["minutes"]),
        "reduction": _with_error(row["reduction"], row["reduction_se"], 1),
        "per_minute": _with_error(row["reduction_per_minute"], row["reduction_per_minute_se"], 2),
        "left": _left(row, {"ratio": row["sd_ratio"], "se": row["sd_ratio_se"]}),
        "p_best": _percent(row["p_best"]),
        "p_best_per_minute": _percent(row["p_best_per_minute"]),
        "best": ", ".join(best),
    }


def _with_error(share: float, se: float, places: int) -> str:
    return f"{fixed(100.0 * share, places)} ± {fixed(100.0 * se, places)}{THIN}%"


def plan_rows(batch: Record) -> list[dict[str, str]]:
    """Measurements in the order in which to take them."""
    return [
        {
            "order": str(i),
            "label": row["label"],
            "range": _range(row),
            "readings": count(row["n_readings"]),
            "minutes": number(row["minutes"]),
            "spent": number(row["cumulative_minutes"]),
            "note": say("design.ddr") if row["quantity"] == "ddr" else "",
            "added": with_se(row["added_nats"], row["added_se"])
            + _MARK * (row.get("method") == LOCAL),
            "gain": fixed(row["cumulative_nats"], 2),
        }
        for i, row in enumerate(batch["members"], start=1)
    ]


def with_se(value: float, se: float) -> str:
    """A gain and its error, to two decimals or to what a smaller error needs."""
    places = max(2, decimals_of(se, digits=1) or 2)
    return f"{fixed(value, places)} ± {fixed(se, places)}"


def _range(row: Record) -> str:
    low, high, step = (finite(row[f"theta_r_{end}_deg"]) for end in ("lo", "hi", "step"))
    if low is None or high is None:
        return MISSING
    if low == high:
        return f"{number(low)}°"
    by = f" by {number(step)}°" if step is not None else ""
    return f"{number(low)} to {number(high)}°{by}"


def _percent(share: Any) -> str:
    x = finite(share)
    if x is None:
        return MISSING
    return f"under 1{THIN}%" if 0.0 < x < 0.005 else f"{fixed(100.0 * x, 0)}{THIN}%"
