"""Pictures of a batch, drawn by hand: one path for a curve, one mark for a sample.

Matplotlib would take longer than the fit where a page has hundreds of small pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from math import ceil, exp, floor, log, log10
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.numbers import degrees, fixed, number

Record = Mapping[str, Any]

SPARK = (112, 30)
_DECADES = 4.0
_CHART = (520.0, 210.0)
_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 10.0, 10.0, 30.0
_MOST_TICKS, _FEWEST_TICKS = 5, 3
_STEPS = (1.0, 2.0, 5.0, 10.0)


def sparkline(curves: Sequence[Record]) -> Markup:
    """Readings of one scan of each polarisation over the scattering angle, on a log axis."""
    logs = [log10(v) for c in curves for v in c["value"] if v and v > 0.0]
    if not logs:
        return Markup("")
    high = max(logs)
    low = max(min(logs), high - _DECADES)
    width, height = SPARK
    span = max(high - low, 1e-9)
    paths, words = [], []
    for curve in curves:
        points = [
            ((t + 90.0) / 180.0 * width, 2.0 + (height - 4.0) * (high - log10(v)) / span)
            for t, v in zip(curve["theta_r_deg"], curve["value"], strict=True)
            if v and log10(v) >= low
        ]
        q = curve["polarization"]
        dash = " ".join(map(str, LOOKS[q].dash)) if q in LOOKS else ""
        stroke = f' stroke-dasharray="{dash}"' if dash else ""
        shape = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        paths.append(f'<path class="{escape(q)}-line" d="M{shape}"{stroke}/>' if points else "")
        words.append(f"{q} at {degrees(curve['theta_i_deg'])}")
    label = (
        f"BRDF of {', '.join(words)} incidence, {number(10**low, digits=2)} to "
        f"{number(10**high, digits=2)} per steradian"
    )
    return Markup(
        f'<svg class="spark" viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
        f' role="img" aria-label="{escape(label)}"><path class="grid" d="M{width / 2} 0V{height}"/>'
        f"{''.join(paths)}</svg>"
    )


def control_chart(record: Record, names: Sequence[str], *, label: str) -> Markup:
    """Values of a parameter over the samples with their limits.

    Parameters
    ----------
    record : mapping
        An entry of ``between_samples`` of the index.
    names : sequence of str
        Of the samples drawn, in their order; the marks bear their numbers in the table too.
    label : str
        Text alternative.
    """
    chart, is_log = record["chart"], record["logarithmic"]
    values, u = record["values"], record["u"]
    low, high = chart_range(record)
    width, height = _CHART
    step = (width - _LEFT - _RIGHT) / max(len(values), 1)

    def x(i: float) -> float:
        return _LEFT + (i + 0.5) * step

    def y(v: float) -> float:
        inside = min(max(v, low), high)  # what is beyond the frame ends there
        return float(_TOP + (height - _TOP - _BOTTOM) * (high - inside) / (high - low))

    def shown(v: float) -> float:
        return exp(v) if is_log else v

    parts = [_ticks(low, high, y, shown), _samples_axis(record["rows"], x, height)]
    if chart:
        parts.append(_limits(chart, x, y, step, (low, high)))
    for i, (value, w, sample) in enumerate(zip(values, u, names, strict=True)):
        why_not, beyond = record["why_not"][i], bool(chart and chart["beyond"][i])
        title = f"No. {record['rows'][i] + 1}, {sample}: {number(shown(value), digits=5)}"
        title += ", beyond its limits" if beyond else ""
        title += f", {why_not}: not in centre and limits" if why_not else ""
        outside = (value > high) - (value < low)
        parts.append(
            _mark(
                x(i), y, value, w, outside=outside, counted=not why_not, beyond=beyond, title=title
            )
        )
    return Markup(
        f'<svg class="plot chart" viewBox="0 0 {width:.0f} {height:.0f}" role="img"'
        f' aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def chart_range(record: Record) -> tuple[float, float]:
    """Ends of the axis: those of limits and samples that count, with bars of the usual length.

    A counted sample that sticks out is inside where that makes the axis no more than three times as
    long; one that is not counted, or known far less well than the others, has no say.
    """
    values, u, counted = (np.asarray(record[key]) for key in ("values", "u", "counted"))
    use = counted.astype(bool) if np.any(counted) else np.ones(len(values), dtype=bool)
    bar = 2.0 * np.minimum(u, np.median(u[use]))
    kept, chart = use, record["chart"]
    ends: list[float] = []
    if chart:
        kept = use & ~np.array(chart["beyond"])
        ends = [chart["low"], chart["high"]]
    ends += [*(values - bar)[kept], *(values + bar)[kept]]
    low, high = min(ends), max(ends)
    if chart:  # those of a sample, where the axis stays legible with them
        own = [
            float(np.median(np.array(chart[key])[kept])) for key in ("sample_low", "sample_high")
        ]
        low, high = max(own[0], 2.0 * low - high), min(own[1], 2.0 * high - low)
        low, high = min([low, *ends]), max([high, *ends])
    near = use & (values > 2.0 * low - high) & (values < 2.0 * high - low)
    low, high = min([low, *values[near]]), max([high, *values[near]])
    margin = 0.06 * max(high - low, 1e-12)
    return float(low - margin), float(high + margin)


def _ticks(low: float, high: float, y: Any, shown: Any) -> str:
    """Round values of the quantity itself, also where the axis is logarithmic."""
    ticks = nice_ticks(low, high, shown)
    steps = [b - a for (a, _), (b, _) in pairwise(ticks)]
    decimals = max(ceil(-log10(steps[0]) - 1e-9), 0) if steps else 5
    return "".join(
        f'<path class="grid" d="M{_LEFT} {y(at):.1f}H{_CHART[0] - _RIGHT}"/>'
        f'<text x="{_LEFT - 7}" y="{y(at) + 4:.1f}" text-anchor="end">{fixed(value, decimals)}'
        "</text>"
        for value, at in ticks
    )


def nice_ticks(low: float, high: float, shown: Any) -> list[tuple[float, float]]:
    """Round values between the ends and where they lie on the axis, as (value, position)."""
    a, b = shown(low), shown(high)
    is_log = shown(1.0) != 1.0
    raw = (b - a) / _MOST_TICKS
    if not raw > 0.0:
        return []
    power = 10.0 ** floor(log10(raw))
    widest = next(m for m in _STEPS if m * power >= raw * (1.0 - 1e-9))
    for step in (m * power for m in reversed(_STEPS) if m <= widest):
        values = [k * step for k in range(ceil(a / step), floor(b / step) + 1)]
        if len(values) >= _FEWEST_TICKS:
            break
    return [(v, log(v) if is_log else v) for v in values if v > 0.0 or not is_log]


def _samples_axis(rows: Sequence[int], x: Any, height: float) -> str:
    """Numbers of the table under the marks, as many as there is room for."""
    every = max(1, ceil(len(rows) / 10))
    marks = [
        f'<text x="{x(i):.1f}" y="{height - 12:.0f}" text-anchor="middle">{rows[i] + 1}</text>'
        for i in range(0, len(rows), every)
    ]
    return "".join(marks)


def _limits(chart: Record, x: Any, y: Any, step: float, frame: tuple[float, float]) -> str:
    """Centre, and the limits of each sample as steps; along the frame where they leave it."""
    lines = f'<path class="centre" d="M{_LEFT} {y(chart["centre"]):.1f}H{_CHART[0] - _RIGHT}"/>'
    for key in ("sample_low", "sample_high"):
        at = y(chart[key][0])
        for is_inside, run in groupby(
            enumerate(chart[key]), key=lambda place: frame[0] <= place[1] <= frame[1]
        ):
            places = list(run)
            shape = f"M{x(places[0][0]) - step / 2:.1f} {at:.1f}"
            shape += "".join(f"V{y(v):.1f}H{x(i) + step / 2:.1f}" for i, v in places)
            at = y(places[-1][1])
            lines += f'<path class="limit{"" if is_inside else " far"}" d="{shape}"/>'
    return lines


def _mark(
    x: float, y: Any, value: float, u: float, *, outside: int, counted: bool, beyond: bool,
    title: str,
) -> str:  # fmt: skip
    """Disc, diamond beyond its limits, cross where it does not count, arrow off the axis."""
    kind = "beyond" if beyond else "inside"
    kind += "" if counted else " aside"
    kind += " off" if outside else ""
    at = y(value)
    if outside:
        shape = f'<path d="M{x - 5:.1f} {at + 8 * outside:.1f}l5 {-8 * outside}l5 {8 * outside}"/>'
    elif not counted:
        shape = f'<path d="M{x - 4:.1f} {at - 4:.1f}l8 8M{x + 4:.1f} {at - 4:.1f}l-8 8"/>'
    elif beyond:
        shape = f'<path d="M{x:.1f} {at - 5.5:.1f}l5.5 5.5l-5.5 5.5l-5.5 -5.5z"/>'
    else:
        shape = f'<circle cx="{x:.1f}" cy="{at:.1f}" r="3"/>'
    bar = f'<path class="u" d="M{x:.1f} {y(value - 2 * u):.1f}V{y(value + 2 * u):.1f}"/>'
    return f'<g class="{kind}"><title>{escape(title)}</title>{bar}{shape}</g>'
