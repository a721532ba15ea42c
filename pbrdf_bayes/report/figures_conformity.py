"""Bands of angles against their tolerance limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.quantities import QUANTITIES
from pbrdf_bayes.report.conformity import WORDS, probability_text, tolerance_text
from pbrdf_bayes.report.figures_planes import Picture
from pbrdf_bayes.report.numbers import degrees
from pbrdf_bayes.report.panel import (
    INK,
    LOOKS,
    Panel,
    limits,
    linear_ticks,
    log10_or_gap,
    log_ticks,
    new_figure,
)
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]
WIDTH, HEIGHT = 344.0, 216.0
MOST = 12
LIMIT = "#a8201a"


def conformity_pictures(summary: Mapping[str, Any]) -> list[Picture]:
    """A picture for each of the first curves; none for single points and what has no value."""
    return [_picture(limit, rows, index) for index, limit, rows in _curves(summary)[:MOST]]


def not_drawn_text(summary: Mapping[str, Any]) -> str:
    """How many curves have no picture; nothing where all have one."""
    n = len(_curves(summary))
    return f"The first {MOST} of {n} curves are drawn; the table has all limits." * (n > MOST)


def _curves(
    summary: Mapping[str, Any],
) -> list[tuple[int, Mapping[str, Any], NDArray[np.int64]]]:
    """Number of the limit, limit, and points of every curve."""
    limits_of = (summary.get("conformity") or {}).get("limits", [])
    return [
        (index, limit, rows) for index, limit in enumerate(limits_of) for rows in _strands(limit)
    ]


def _strands(limit: Mapping[str, Any]) -> Iterator[NDArray[np.int64]]:
    """Points of each curve: those of one angle of incidence, or the DHR against it."""
    theta_i = np.array(limit["theta_i_deg"])
    if limit["quantity"] == "parameter" or None in limit["mean"]:
        return
    if QUANTITIES[limit["quantity"]].hemispherical or len(set(limit["theta_r_deg"])) == 1:
        if theta_i.size > 2:
            yield np.arange(theta_i.size)
        return
    for angle in dict.fromkeys(theta_i.tolist()):
        rows = np.flatnonzero(theta_i == angle)
        if rows.size > 2:
            yield rows


def _picture(limit: Mapping[str, Any], rows: NDArray[np.int64], index: int) -> Picture:
    against_i = QUANTITIES[limit["quantity"]].hemispherical or len(set(limit["theta_r_deg"])) == 1
    x = np.array(limit["theta_i_deg" if against_i else "theta_r_deg"])[rows]
    logarithmic = not QUANTITIES[limit["quantity"]].hemispherical and not limit["difference"]
    low, mean, high = (_scaled(np.array(limit[k])[rows], logarithmic=logarithmic)
                       for k in ("q025", "mean", "q975"))  # fmt: skip
    ends = [limit[side] for side in ("lower", "upper") if limit[side] is not None]
    lines = _scaled(np.array(ends, dtype=np.float64), logarithmic=logarithmic)
    y = limits(low, high, lines, pad=0.08, least=0.05 if logarithmic else 1e-4)
    figure = new_figure(WIDTH, HEIGHT)
    across = (float(x.min()), float(x.max()))
    panel = Panel(figure, 52, 36, WIDTH - 66, HEIGHT - 62, across, y)
    ticks, labels = linear_ticks(*across)
    panel.x_axis(ticks, [f"{label}°" for label in labels],
                 "incidence angle θ_i" if against_i else "scattering angle θ_r")  # fmt: skip
    name = QUANTITIES[limit["quantity"]].axis
    title = f"difference of {name.split(' [')[0]} [dex]" if limit["difference"] else name
    panel.y_axis(*(log_ticks if logarithmic else linear_ticks)(*y), title)
    look = LOOKS.get(limit["polarization"])
    color, dash = (look.color, look.dash) if look else (INK, ())
    panel.fill(x, low, high, color, 0.25)
    panel.line(x, mean, color, 1.3, dash)
    panel.segments([(across[0], t, across[1], t) for t in lines], color=LIMIT, width=1.4)
    return Picture(
        inline_svg(figure, name=f"conform-{index}-{rows[0]}", label=_label(limit)),
        _title(limit, rows, against_i=against_i), (),
    )  # fmt: skip


def _scaled(values: Array, *, logarithmic: bool) -> Array:
    return log10_or_gap(values) if logarithmic else values


def _title(limit: Mapping[str, Any], rows: NDArray[np.int64], *, against_i: bool) -> str:
    where = "" if against_i else f", θᵢ = {degrees(limit['theta_i_deg'][int(rows[0])])}"
    return f"{limit['name']}{where}: {WORDS[limit['verdict']].lower()}"


def _label(limit: Mapping[str, Any]) -> str:
    return (
        f"{limit['name']}: tolerance {tolerance_text(limit)}, probability of conformity "
        f"{probability_text(limit['probability'])}, verdict {limit['verdict']}"
    )
