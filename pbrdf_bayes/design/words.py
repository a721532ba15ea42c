"""What to measure next, in words: from the plain values of a design to sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from math import floor, log10
from typing import Any

from pbrdf_bayes.design.nested import LOCAL, WIDE
from pbrdf_bayes.design.ranking import span_of_angles
from pbrdf_bayes.words import LOCAL_NORMAL, listed, say

Record = Mapping[str, Any]

WORTH_NATS = 0.05
"""Gain below which no measurement is recommended [nat]."""
WIDE_NATS = 0.2
"""Bracket of the estimator from which on it is told instead of the standard error [nat]."""
_CLEAR = 2.0
_CLOSE = 0.7
_MOST_GROUPS = 3
_MOST_PLACES = 4
_MOST_GOALS = 3


def recommend(design: Record) -> list[str]:
    """The recommendation, one paragraph an entry.

    Parameters
    ----------
    design : mapping
        Of `pbrdf_bayes.design.summary.summarise_design`, without its recommendation.

    Returns
    -------
    list of str
        Names of parameters as they are typed.
    """
    rows = [row for row in design["candidates"] if row["eig_nats"] is not None]
    best = rows[0]
    about = listed(design["about"])
    said = [caveat] if (caveat := _caveat(design)) else []
    start = "Before any reading, from the priors alone: " if design["run"] is None else ""
    if not worth(best):
        words = (
            f"{start}no candidate tells much more about {about}: the largest gain is "
            f"{_gain(best)} ({best['label']}, {minutes(best['minutes'])})."
        )
        return [*said, _sentence(words), *(line for line in [_for_goals(design)] if line)]
    said.append(_sentence(start + _best(best, design, about)))
    others = [line for line in (_others(rows), _by_minute(rows)) if line]
    said += [" ".join(others)] if others else []
    said += [line for line in (
        _together(design, best), _pair(design), _for_goals(design), _of_ddr(design, rows)
    ) if line]  # fmt: skip
    said.append("1 nat is a factor of 2.7 in the volume of what is plausible.")
    return said


def worth(row: Record) -> bool:
    """Whether a gain is worth a measurement, and not chance of the calculation."""
    return bool(row["eig_nats"] >= WORTH_NATS and row["eig_nats"] > _CLEAR * row["eig_se"])


def minutes(value: float) -> str:
    """Minutes as one says them.

    Examples
    --------
    >>> minutes(18.4), minutes(0.5), minutes(1.0)
    ('18 min', '0.5 min', '1 min')
    """
    return f"{value:.0f} min" if value >= 9.95 else f"{value:.2g} min"


def _caveat(design: Record) -> str:
    run = design["run"]
    if run is None:
        return ""
    if run.get("status", "done") != "done":
        return say("design.not_converged")
    if run["applicability"] == "does not apply":
        return say("design.not_constants", verdict=run["verdict"])
    return say("design.fail") if run["verdict"] == "FAIL" else ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _nats(value: float, se: float = 0.0) -> str:
    """A gain to the decimals of a small error: below 0 it is by chance of the calculation only."""
    text = f"{max(value, 0.0):.{1 if value >= 9.95 else _places(se)}f}"
    return f"+{text}" if float(text) else text


def _places(se: float) -> int:
    """Decimals that show an error: two, or more where it is smaller."""
    return 2 if not 0.0 < se < 0.005 else min(-floor(log10(se)), _MOST_PLACES)


def error(se: float) -> str:
    """A standard error of a gain as one says it.

    Examples
    --------
    >>> error(0.28), error(0.0043), error(0.00002), error(0.0)
    ('0.28', '0.004', 'under 0.0001', '0.00')
    """
    smallest = 10.0**-_MOST_PLACES
    return f"under {smallest:g}" if 0.0 < se < smallest else f"{se:.{_places(se)}f}"


def _local(row: Record) -> bool:
    """Whether a gain is of the local normal approximation."""
    return bool(row.get("eig_method", row.get("method")) == LOCAL)


def _wide(row: Record) -> bool:
    return bool(row["eig_high"] - row["eig_low"] > WIDE_NATS) and not _local(row)


def _gain(row: Record) -> str:
    """A gain with its error, or with its bracket where that is wide."""
    if _wide(row):
        return f"between {_nats(row['eig_low'])} and {_nats(row['eig_high'])} nat"
    of = f" ({LOCAL_NORMAL})" if _local(row) else ""
    return f"{_nats(row['eig_nats'], row['eig_se'])} ± {error(row['eig_se'])} nat{of}"


def _percent(share: float) -> str:
    """A share; of small ones one decimal."""
    if share < 0.001:
        return "under 0.1 %"
    return f"{100.0 * share:.0f} %" if share >= 0.0995 else f"{100.0 * share:.1f} %"


def _best(best: Record, design: Record, about: str) -> str:
    words = (
        f"take the {best['label']} next ({minutes(best['minutes'])}): {_gain(best)} about {about}"
    )
    plain = _wide(best) and best["eig_high"] - best["eig_low"] <= WIDE
    words += "; more draws would narrow that (--draws)." if plain else "."
    ratios = {name: found["ratio"] for name, found in best["sd_ratio"].items()}
    sharpest = min(design["about"], key=lambda name: ratios[name])
    goals = [name for name in ratios if name not in design["about"]][:_MOST_GOALS]
    shrunk = [f"of {name} to {_percent(ratios[name])}" for name in (sharpest, *goals)]
    words += f" It is expected to bring the standard deviation {listed(shrunk)} of what it is now"
    words += f" ({LOCAL_NORMAL})." if best.get("sd_method") == LOCAL else "."
    if best["repeat"]:
        words += " It repeats a geometry that has been measured: less noise there tells more."
    return words


def _others(rows: Sequence[Record]) -> str:
    """What is as good as the best, or how far the next is behind."""
    best, rest = rows[0], rows[1:]
    if not rest:
        return "It is the only candidate."
    tied = [row for row in rest if row["tied"]]
    if tied:
        return f"Not told apart from it by the calculation: {_grouped(tied, rows)}."
    if _wide(best) or _wide(rest[0]):
        return f"The next best, the {rest[0]['label']}, gives less: {_gain(rest[0])}."
    share = rest[0]["eig_nats"] / best["eig_nats"]
    if share < _CLOSE:
        return (
            f"Nothing else comes close: the next best, the {rest[0]['label']}, gives "
            f"{_percent(max(share, 0.0))} of it."
        )
    return f"The next best, the {rest[0]['label']}, gives {_percent(share)} of it."


def _grouped(tied: Sequence[Record], rows: Sequence[Record]) -> str:
    """Tied candidates, kind by kind; of many kinds the first."""
    groups = _groups(tied, rows)
    more = len(groups) - _MOST_GROUPS
    return "; ".join(groups[:_MOST_GROUPS]) + (f"; and {more} more" if more > 0 else "")


def _groups(tied: Sequence[Record], rows: Sequence[Record]) -> list[str]:
    """Tied candidates of one kind, neighbouring angles of incidence as a range."""

    def kind(row: Record) -> tuple[Any, ...]:
        rest = row["label"].replace(f"{row['theta_i_deg']:g}°", "", 1)
        return row["quantity"], row["polarization"], row["port_deg"] or 0.0, rest

    first = kind(rows[0])
    ordered = sorted(tied, key=lambda row: (kind(row) != first, kind(row), row["theta_i_deg"]))
    found = []
    for name, members in groupby(ordered, key=kind):
        same = list(members)
        grid = [row["theta_i_deg"] for row in rows if kind(row) == name]
        span = span_of_angles([row["theta_i_deg"] for row in same], grid)
        found.append(same[0]["label"].replace(f"{same[0]['theta_i_deg']:g}°", span, 1))
    return found


def _by_minute(rows: Sequence[Record]) -> str:
    best, first = rows[0], max(rows, key=lambda row: row["eig_per_minute"])
    if len(rows) == 1:
        return ""
    tied = [row for row in rows if row["tied_per_minute"] and row is not first]
    if first is best:
        if not tied:
            return "It is also the best for each minute."
        if tied == [row for row in rows if row["tied"] and row is not first]:
            return "For each minute it is first as well, not told apart from the same."
        return f"For each minute it is first, not told apart from: {_grouped(tied, rows)}."
    if best["tied_per_minute"]:
        return f"For each minute it is not told apart from the best, the {first['label']}."
    if not worth(first):
        return ""
    share, time = first["eig_nats"] / best["eig_nats"], first["minutes"] / best["minutes"]
    return (
        f"For each minute the {first['label']} is best: {_percent(share)} of that gain in "
        f"{_percent(time)} of the time ({minutes(first['minutes'])})"
        + (f"; not told apart from it there: {_grouped(tied, rows)}." if tied else ".")
    )


def _together(design: Record, best: Record) -> str:
    batch = design["batch"]
    members, budget = batch["members"], batch["budget_minutes"]
    if not members:
        return ""
    if budget is None and len(members) == 1:
        return ""
    start = "One after the other" if budget is None else f"With {minutes(budget)}"
    labels = ", then ".join(
        row["label"] + f" ({say('design.ddr')})" * is_ddr(row) for row in members
    )
    whole = batch | {"method": members[0].get("method")}
    words = f"{start}: {labels}: {'together ' * (len(members) > 1)}{_gain(whole)} in "
    words += f"{minutes(batch['minutes'])}."
    if budget is not None and best["minutes"] > budget:
        words += f" The {best['label']} takes longer than that."
    local = [row.get("method") == LOCAL for row in members]
    if any(local[1:]):
        words += f" What it adds from no. {local.index(True, 1) + 1} on is by the {LOCAL_NORMAL}."
    return words


def _pair(design: Record) -> str:
    pairs = design["pairs"]
    if not pairs or pairs["gap_nats"] < max(WORTH_NATS, _CLEAR * pairs["gap_se"]):
        return ""
    names = " with ".join(row["label"] for row in pairs["best"]["members"])
    return (
        f"Of {pairs['n_compared']} pairs compared {names} tells most: "
        f"{pairs['gap_nats']:.2f} nat more than the two that are best one after the other"
        + (f" ({LOCAL_NORMAL})." if pairs.get("method") == LOCAL else ".")
    )


def _for_goals(design: Record) -> str:
    """The best candidate for each goal."""
    words = [_for_goal(goal) for goal in design.get("goals", ())]
    return f"Best for what you need: {'; '.join(words)}." if words else ""


def _for_goal(goal: Record) -> str:
    rows = goal["candidates"]
    best, first = rows[0], max(rows, key=lambda row: row["reduction_per_minute"])
    if best["reduction"] <= _CLEAR * best["reduction_se"]:
        return f"nothing sharpens {goal['name']}"
    tied = sum(row["tied"] for row in rows) - 1
    words = f"for {goal['name']} the {best['label']} (standard deviation to "
    words += _percent(best["sd_ratio"])
    words += f", {LOCAL_NORMAL}" if best.get("method") == LOCAL else ""
    words += f", {tied} more not told apart)" if tied else ")"
    if not best["tied_per_minute"]:
        words += f" and for each minute the {first['label']}"
        tied = sum(row["tied_per_minute"] for row in rows) - 1
        words += f" ({tied} more not told apart)" if tied else ""
    return words


def is_ddr(row: Record) -> bool:
    """Whether a candidate is a DDR, whose readings are not fitted."""
    return bool(row["quantity"] == "ddr")


def _of_ddr(design: Record, rows: Sequence[Record]) -> str:
    """A DDR can be advised, and its readings not be fitted; steps of a plan say so themselves."""
    first = max(rows, key=lambda row: row["eig_per_minute"])
    advised = [rows[0], first]
    for goal in design.get("goals", ()):
        ranked = goal["candidates"]
        advised += [ranked[0], max(ranked, key=lambda row: row["reduction_per_minute"])]
    return f"Note: {say('design.ddr')}." if any(is_ddr(row) for row in advised) else ""
