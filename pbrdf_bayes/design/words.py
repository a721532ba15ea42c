"""What to measure next, in words: from the plain values of a design to sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from pbrdf_bayes.design.ranking import span_of_angles

Record = Mapping[str, Any]

WORTH_NATS = 0.05
"""Gain below which no measurement is recommended [nat]."""
WIDE_NATS = 0.2
"""Bracket of the estimator from which on it is told instead of the standard error [nat]."""
_CLEAR = 2.0
_CLOSE = 0.7
_MOST_GROUPS = 3
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
        return [*said, _sentence(words)]
    said.append(_sentence(start + _best(best, design, about)))
    others = [line for line in (_others(rows), _by_minute(rows)) if line]
    said += [" ".join(others)] if others else []
    said += [line for line in (_together(design, best), _pair(design)) if line]
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


def listed(words: Sequence[str]) -> str:
    """Words with commas and an ``and``.

    Examples
    --------
    >>> listed(["n", "k", "rho0"]), listed(["n"])
    ('n, k and rho0', 'n')
    """
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else words[0]


def _caveat(design: Record) -> str:
    run = design["run"]
    if run is None:
        return ""
    if run["verdict"] == "FAIL" or run["applicability"] == "does not apply":
        return (
            "The model does not describe this sample (verdict of the fit: "
            f"{run['verdict']}): its parameters are fitted numbers, not constants of the "
            "material, and what follows holds for these numbers only."
        )
    return ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _nats(value: float) -> str:
    sign = "+" if value >= 0.0 else "−"
    return f"{sign}{abs(value):.1f}" if abs(value) >= 9.95 else f"{sign}{abs(value):.2f}"


def _gain(row: Record) -> str:
    """A gain with its error, or with its bracket where that is wide."""
    if row["eig_high"] - row["eig_low"] > WIDE_NATS:
        return f"between {_nats(row['eig_low'])} and {_nats(row['eig_high'])} nat"
    se = f"{row['eig_se']:.2f}" if row["eig_se"] >= 0.005 else "0.01"
    return f"{_nats(row['eig_nats'])} ± {se} nat"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.01 else "under 1 %"


def _best(best: Record, design: Record, about: str) -> str:
    words = (
        f"take the {best['label']} next ({minutes(best['minutes'])}): {_gain(best)} about {about}"
    )
    wide = best["eig_high"] - best["eig_low"] > WIDE_NATS
    words += "; more draws would narrow that (--draws)." if wide else "."
    ratios = {name: found["ratio"] for name, found in best["sd_ratio"].items()}
    known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
    inferred = [name for name in design["about"] if name in known]
    if inferred:
        sharpest = min(inferred, key=lambda name: known[name])
        goals = [name for name in known if name not in design["about"]][:_MOST_GOALS]
        shrunk = [f"of {name} to {_percent(known[name])}" for name in (sharpest, *goals)]
        words += f" It is expected to bring the standard deviation {listed(shrunk)} of what it is "
        words += "now."
    else:
        words += (
            " So much is gained that few of the draws remain plausible after it: by how much each "
            "parameter sharpens cannot be told from them, and the order of the best is rough."
        )
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
        groups = _groups(tied, rows)
        more = len(groups) - _MOST_GROUPS
        words = "; ".join(groups[:_MOST_GROUPS]) + (f"; and {more} more" if more > 0 else "")
        return f"Not told apart from it by the calculation: {words}."
    share = rest[0]["eig_nats"] / best["eig_nats"]
    if share < _CLOSE:
        return (
            f"Nothing else comes close: the next best, the {rest[0]['label']}, gives "
            f"{_percent(max(share, 0.0))} of it."
        )
    return f"The next best, the {rest[0]['label']}, gives {_percent(share)} of it."


def _groups(tied: Sequence[Record], rows: Sequence[Record]) -> list[str]:
    """Tied candidates of one kind, neighbouring angles of incidence as a range."""

    def kind(row: Record) -> tuple[Any, ...]:
        return row["quantity"], row["polarization"], row["port_deg"] or 0.0

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
    if best["tied_per_minute"]:
        return "It is also the best for each minute."
    if not worth(first):
        return ""
    share, time = first["eig_nats"] / best["eig_nats"], first["minutes"] / best["minutes"]
    return (
        f"For each minute the {first['label']} is best: {_percent(share)} of that gain in "
        f"{_percent(time)} of the time ({minutes(first['minutes'])})."
    )


def _together(design: Record, best: Record) -> str:
    batch = design["batch"]
    members, budget = batch["members"], batch["budget_minutes"]
    if not members or (budget is None and len(members) == 1):
        return ""
    start = "One after the other" if budget is None else f"With {minutes(budget)}"
    labels = ", then ".join(row["label"] for row in members)
    words = f"{start}: {labels}: {'together ' * (len(members) > 1)}{_gain(batch)} in "
    words += f"{minutes(batch['minutes'])}."
    if budget is not None and best["minutes"] > budget:
        words += f" The {best['label']} takes longer than that."
    return words


def _pair(design: Record) -> str:
    pairs = design["pairs"]
    if not pairs or pairs["gap_nats"] < max(WORTH_NATS, _CLEAR * pairs["gap_se"]):
        return ""
    names = " with ".join(row["label"] for row in pairs["best"]["members"])
    return (
        f"Of {pairs['n_compared']} pairs compared {names} tells most: "
        f"{pairs['gap_nats']:.2f} nat more than the two that are best one after the other."
    )
