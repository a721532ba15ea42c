"""Pictures of a batch, drawn by hand: one path for a curve, one mark for a sample.

Matplotlib would take longer than the fit where a page has hundreds of small pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, exp, floor, log, log10
from typing import Any

from markupsafe import Markup, escape

from pbrdf_bayes.report.numbers import degrees, number
from pbrdf_bayes.report.panel import LOOKS

Record = Mapping[str, Any]

SPARK = (112, 30)
_DECADES = 4.0
_CHART = (520.0, 210.0)
_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 10.0, 10.0, 30.0
_MOST_TICKS = 5


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
    ends = [v + side * 2.0 * w for v, w in zip(values, u, strict=True) for side in (-1.0, 1.0)]
    if chart:
        ends += [chart["low"], chart["high"], *chart["sample_low"], *chart["sample_high"]]
    low, high = min(ends), max(ends)
    margin = 0.06 * max(high - low, 1e-12)
    low, high = low - margin, high + margin
    width, height = _CHART
    step = (width - _LEFT - _RIGHT) / max(len(values), 1)

    def x(i: float) -> float:
        return _LEFT + (i + 0.5) * step

    def y(v: float) -> float:
        return float(_TOP + (height - _TOP - _BOTTOM) * (high - v) / (high - low))

    def shown(v: float) -> float:
        return exp(v) if is_log else v

    parts = [_ticks(low, high, y, shown), _samples_axis(record["rows"], x, height)]
    if chart:
        parts.append(_limits(chart, x, y, step))
    for i, (value, w, sample) in enumerate(zip(values, u, names, strict=True)):
        counted, beyond = record["counted"][i], bool(chart and chart["beyond"][i])
        name = f"No. {record['rows'][i] + 1}, {sample}"
        parts.append(
            _mark(x(i), y, value, w, counted=counted, beyond=beyond, name=name, shown=shown)
        )
    return Markup(
        f'<svg class="plot chart" viewBox="0 0 {width:.0f} {height:.0f}" role="img"'
        f' aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def _ticks(low: float, high: float, y: Any, shown: Any) -> str:
    """Round values of the quantity itself, also where the axis is logarithmic."""
    parts = []
    for value, at in nice_ticks(low, high, shown):
        parts.append(
            f'<path class="grid" d="M{_LEFT} {y(at):.1f}H{_CHART[0] - _RIGHT}"/>'
            f'<text x="{_LEFT - 7}" y="{y(at) + 4:.1f}" text-anchor="end">{number(value, digits=5)}'
            "</text>"
        )
    return "".join(parts)


def nice_ticks(low: float, high: float, shown: Any) -> list[tuple[float, float]]:
    """Round values between the ends and where they lie on the axis, as (value, position)."""
    a, b = shown(low), shown(high)
    is_log = shown(1.0) != 1.0
    raw = (b - a) / _MOST_TICKS
    if not raw > 0.0:
        return []
    power = 10.0 ** floor(log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * (1.0 - 1e-9))
    values = [k * step for k in range(ceil(a / step), floor(b / step) + 1)]
    return [(v, log(v) if is_log else v) for v in values if v > 0.0 or not is_log]


def _samples_axis(rows: Sequence[int], x: Any, height: float) -> str:
    """Numbers of the table under the marks, as many as there is room for."""
    every = max(1, ceil(len(rows) / 10))
    marks = [
        f'<text x="{x(i):.1f}" y="{height - 12:.0f}" text-anchor="middle">{rows[i] + 1}</text>'
        for i in range(0, len(rows), every)
    ]
    return "".join(marks)


def _limits(chart: Record, x: Any, y: Any, step: float) -> str:
    """Centre, limits of the chart, and the steps of the limits of each sample."""
    right = _CHART[0] - _RIGHT
    lines = f'<path class="centre" d="M{_LEFT} {y(chart["centre"]):.1f}H{right}"/>' + "".join(
        f'<path class="limit" d="M{_LEFT} {y(chart[end]):.1f}H{right}"/>' for end in ("low", "high")
    )
    steps = ""
    for key in ("sample_low", "sample_high"):
        shape = "".join(
            f"{'M' if i == 0 else 'L'}{x(i) - step / 2:.1f} {y(v):.1f}H{x(i) + step / 2:.1f}"
            for i, v in enumerate(chart[key])
        )
        steps += f'<path class="own" d="{shape}"/>'
    return lines + steps


def _mark(
    x: float, y: Any, value: float, u: float, *, counted: bool, beyond: bool, name: str, shown: Any
) -> str:
    kind = "beyond" if beyond else "inside"
    kind += "" if counted else " aside"
    title = f"{name}: {number(shown(value), digits=5)}"
    title += ", beyond its limits" if beyond else ""
    title += "" if counted else ", verdict FAIL: not in centre and limits"
    at = y(value)
    shape = (
        f'<path d="M{x - 4:.1f} {at - 4:.1f}l8 8M{x + 4:.1f} {at - 4:.1f}l-8 8"/>'
        if not counted
        else f'<path d="M{x:.1f} {at - 5.5:.1f}l5.5 5.5l-5.5 5.5l-5.5 -5.5z"/>'
        if beyond
        else f'<circle cx="{x:.1f}" cy="{at:.1f}" r="3"/>'
    )
    bar = f'<path class="u" d="M{x:.1f} {y(value - 2 * u):.1f}V{y(value + 2 * u):.1f}"/>'
    return f'<g class="{kind}"><title>{escape(title)}</title>{bar}{shape}</g>'
