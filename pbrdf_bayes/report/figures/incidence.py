"""DHR, lobe widths and tolerance limits: bands and readings against an angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pbrdf_bayes.quantities import QUANTITIES
from pbrdf_bayes.report.arrays import AngleCurve, DhrPoints, ScanWidthPoints
from pbrdf_bayes.report.conformity import WORDS, probability_text, tolerance_text
from pbrdf_bayes.report.figures.axes import (
    WIDTH,
    angles,
    draw_bands,
    figure_of,
    limits,
    logarithmic,
    name_axes,
    new_axes,
    positive,
    shade,
    thinned,
)
from pbrdf_bayes.report.figures.looks import ALARM, FAINT, INK, LOOKS, Picture
from pbrdf_bayes.report.figures.planes import half_width, rms, span
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import THIN, degrees, number

Array = NDArray[np.float64]
Record = Mapping[str, Any]

MOST_READINGS = 90
MOST_LIMITS = 12
_BESIDE = {"s": -0.8, "p": 0.8, "u": 0.0}
"""Where s and p were measured at one angle, their points stand side by side [deg]."""
_FLAT, _FARTHEST = 0.05, 3.0


def _incidence_axes(title: str, y: tuple[float, float], low: float = 0.0) -> Axes:
    (axes,) = new_axes(WIDTH, 236.0, (52, 36, WIDTH - 62, 172))
    axes.set(xlim=(low, 90.0), ylim=y)
    angles(axes.xaxis, 0, 30, 60, 90)
    name_axes(axes, "incidence angle θ_i", title, beside=50)
    return axes


def _bars(axes: Axes, x: Array, y: Array, u: Array, q: str) -> None:
    """Readings with bars of one standard uncertainty where it is known."""
    look = LOOKS[q]
    axes.errorbar(x, y, u, fmt=look.marker, color=look.color, markersize=4.4, elinewidth=1.0)


# --------------------------------------------------------------------------------------------- DHR


def plot_dhr(axes: Axes, curves: Sequence[AngleCurve], points: Sequence[DhrPoints]) -> Axes:
    """Draw DHR [1] against incidence [deg]: bands, curves at the MAP, readings."""
    for curve in curves:
        look = LOOKS[curve.polarization]
        draw_bands(axes, curve.theta_i_deg, look.color, model=curve.model_band,
                   predictive=curve.predictive_band)  # fmt: skip
        axes.plot(curve.theta_i_deg, curve.map, **look.line)
    for group in points:
        rows = thinned(group.value - group.map, MOST_READINGS)
        _bars(axes, group.theta_i_deg[rows], group.value[rows], group.u_value[rows],
              group.polarization)  # fmt: skip
    return axes


def plot_dhr_difference(axes: Axes, curve: AngleCurve | None, points: DhrPoints) -> Axes:
    """Draw DHR readings and bands less the model at the MAP [1] against incidence [deg]."""
    if curve is not None:
        base, color = curve.map[:, None], LOOKS[curve.polarization].color
        draw_bands(axes, curve.theta_i_deg, color, model=curve.model_band - base,
                   predictive=curve.predictive_band - base)  # fmt: skip
    axes.axhline(0.0, color=FAINT, lw=0.8)
    difference = points.value - points.map
    rows = thinned(difference, MOST_READINGS)
    _bars(axes, points.theta_i_deg[rows], difference[rows], points.u_value[rows],
          points.polarization)  # fmt: skip
    return axes


def dhr_pictures(
    curves: Sequence[AngleCurve], points: Sequence[DhrPoints], *, name: str = "dhr"
) -> list[Picture]:
    """Return DHR against incidence, and its difference from the MAP for each polarisation read."""
    by_q = {c.polarization: c for c in curves}
    spreads = [p.value - p.map for p in points]
    read = [by_q[p.polarization] for p in points if p.polarization in by_q]
    spreads += [(c.predictive_band[:, [0, 4]] - c.map[:, None])[c.theta_i_deg <= 80] for c in read]
    reach = max(abs(v) for v in limits(*spreads, pad=0.06, least=1e-4))
    found = [_dhr(curves, points, name)] if curves else []
    for p in points:
        axes = _incidence_axes("DHR, measured − model", (-reach, reach))
        plot_dhr_difference(axes, by_q.get(p.polarization), p)
        word, difference = LOOKS[p.polarization].word, p.value - p.map
        text = (
            f"rms {number(rms(difference), digits=2)} over {np.isfinite(difference).sum()} readings"
        )
        svg = inline_svg(figure_of(axes), name=f"{name}-{p.polarization}",
                         label=f"DHR {word}, measured minus model: {text}")  # fmt: skip
        found.append(Picture(svg, f"Measured − model, {word}", ((p.polarization, text),)))
    return found


def _dhr(curves: Sequence[AngleCurve], points: Sequence[DhrPoints], name: str) -> Picture:
    low, high = limits(
        *(c.model_band[:, [0, 4]] for c in curves), *(p.value for p in points), [0.0]
    )
    axes = _incidence_axes("DHR", (low if low < -0.02 else 0.0, min(high, 1.05)))
    plot_dhr(axes, curves, points)
    parts = [
        f"{LOOKS[p.polarization].word}: measured {span(p.value)} in {p.value.size} readings"
        for p in points
    ] + [
        f"{LOOKS[c.polarization].word}: predicted {span(c.map)}, 90 % model band "
        f"±{half_width(c.model_band)}"
        for c in curves
    ]
    label = "DHR against incidence angle; " + "; ".join(parts)
    notes = tuple(
        (c.polarization,
         f"model ±{half_width(c.model_band)} · predictive ±{half_width(c.predictive_band)}")
        for c in curves
    )  # fmt: skip
    return Picture(inline_svg(figure_of(axes), name=name, label=label), "Against incidence", notes)


# ------------------------------------------------------------------------------------------ widths


def plot_widths(
    axes: Axes, curves: Sequence[AngleCurve], points: Sequence[ScanWidthPoints], *,
    relative: bool = False,
) -> Axes:  # fmt: skip
    """Draw half widths of the lobes [1], or their ratio to Eq. (5), against incidence."""
    if relative:
        axes.axhline(1.0, color=FAINT, lw=0.8)
    for curve in curves:
        look, over = LOOKS[curve.polarization], curve.map if relative else np.ones_like(curve.map)
        draw_bands(axes, curve.theta_i_deg, look.color, model=curve.model_band / over[:, None])
        axes.plot(curve.theta_i_deg, curve.map / over, **look.line)
    for p in points:
        theta, unit = p.theta_i_deg + _BESIDE[p.polarization], p.model if relative else 1.0
        _bars(axes, theta, p.width / unit, p.u_width / unit, p.polarization)
    return axes


def width_pictures(
    curves: Sequence[AngleCurve], points: Sequence[ScanWidthPoints]
) -> list[Picture]:
    """Return widths against incidence, and the same over Eq. (5) at the MAP."""
    if not curves:
        return []
    return [_widths(curves, points, relative=relative) for relative in (False, True)]


def _widths(
    curves: Sequence[AngleCurve], points: Sequence[ScanWidthPoints], *, relative: bool
) -> Picture:
    bands = [c.model_band / (c.map[:, None] if relative else 1.0) for c in curves]
    most = _FARTHEST * limits(*bands, pad=0.0)[1]
    over = [p.model if relative else 1.0 for p in points]
    ends = [np.clip((p.width + sign * p.u_width) / m, 0.0, most)
            for p, m in zip(points, over, strict=True) for sign in (-1.0, 0.0, 1.0)]  # fmt: skip
    low, high = limits(*bands, *ends, [float(relative)], least=2 * _FLAT if relative else 0.0)
    title = "Over Eq. (5) at the MAP" if relative else "Against incidence"
    name = "width over Eq. (5)" if relative else "half width ρ"
    axes = _incidence_axes(name, (low if relative else 0.0, high), -4.0)
    plot_widths(axes, curves, points, relative=relative)
    notes = tuple((p.polarization, _width_note(p)) for p in points)
    label = f"Lobe width of each scan, {title.lower()}: " + "; ".join(
        f"{LOOKS[q].word}: {span(p.width / m)} in {p.width.size} scans, {note}"
        for (q, note), p, m in zip(notes, points, over, strict=True)
    )
    svg = inline_svg(figure_of(axes), name="widths-relative" if relative else "widths", label=label)
    return Picture(svg, title, notes)


def _width_note(group: ScanWidthPoints) -> str:
    away = 100.0 * rms(group.width / group.model - 1.0)
    known = np.isfinite(away)
    return (
        f"rms {number(away, digits=2)}{THIN}% away from Eq. (5)"
        if known
        else "0 scans with a width"
    )


# ---------------------------------------------------------------------------------------- tolerance


def conformity_pictures(summary: Record, *, tag: str = "") -> list[Picture]:
    """A picture for each of the first curves; none for single points and what has no value.

    ``tag`` begins the ids of the pictures: needed where a page has those of several samples.
    """
    return [
        _limit_picture(limit, rows, tag + name)
        for limit, rows, name in _limit_curves(summary)[:MOST_LIMITS]
    ]


def not_drawn_text(summary: Record) -> str:
    """How many curves have no picture; nothing where all have one."""
    n = len(_limit_curves(summary))
    return (n > MOST_LIMITS) * (
        f"The first {MOST_LIMITS} of {n} curves are drawn; the table has all limits."
    )


def _limit_curves(summary: Record) -> list[tuple[Record, NDArray[np.int64], str]]:
    """Limit, points of every curve of it, and the name of its picture."""
    found = (summary.get("conformity") or {}).get("limits", [])
    return [
        (limit, rows, f"conform-{index}-{rows[0]}")
        for index, limit in enumerate(found)
        for rows in _limit_strands(limit)
    ]


def against_incidence(limit: Record) -> bool:
    """Whether the points of a limit differ in theta_i alone."""
    return QUANTITIES[limit["quantity"]].hemispherical or len(set(limit["theta_r_deg"])) == 1


def _limit_strands(limit: Record) -> Iterator[NDArray[np.int64]]:
    """Points of each curve: those of one angle of incidence, or the DHR against it."""
    if limit["quantity"] == "parameter" or None in limit["mean"]:
        return
    theta_i = np.array(limit["theta_i_deg"])
    group = np.zeros_like(theta_i) if against_incidence(limit) else theta_i
    for angle in dict.fromkeys(group.tolist()):
        rows = np.flatnonzero(group == angle)
        if rows.size > 2:
            yield rows


def tolerance_axes() -> list[Axes]:
    """Axes of a picture of limits."""
    return new_axes(WIDTH, 216.0, (52, 36, WIDTH - 66, 154))


def plot_tolerance(axes: Axes, limit: Record, rows: NDArray[np.int64]) -> Axes:
    """Draw mean and 95 % band of a quantity and its tolerance limits against the angle [deg]."""
    against_i = against_incidence(limit)
    x = np.array(limit["theta_i_deg" if against_i else "theta_r_deg"])[rows]
    low, mean, high = (np.array(limit[k])[rows] for k in ("q025", "mean", "q975"))
    ends = [limit[side] for side in ("lower", "upper") if limit[side] is not None]
    name = QUANTITIES[limit["quantity"]].axis
    axes.set_xlim(x.min(), x.max())
    if not QUANTITIES[limit["quantity"]].hemispherical and not limit["difference"]:
        logs = (np.log10(positive(v)) for v in (low, high, ends))
        bottom, top = limits(*logs, pad=0.08, least=0.05)
        low, mean, high = positive(low), positive(mean), positive(high)
        logarithmic(axes, 10.0**bottom, 10.0**top)
    else:
        axes.set_ylim(limits(low, high, ends, pad=0.08, least=1e-4))
    angles(axes.xaxis)
    name_axes(axes, "incidence angle θ_i" if against_i else "scattering angle θ_r",
              f"difference of {name.split(' [')[0]} [dex]" if limit["difference"] else name,
              beside=50)  # fmt: skip
    look = LOOKS.get(limit["polarization"])
    shade(axes, x, low, high, look.color if look else INK, 0.25)
    axes.plot(x, mean, **(look.line if look else {"color": INK}))
    for end in ends:
        axes.axhline(end, color=ALARM, lw=1.4)
    return axes


def _limit_picture(limit: Record, rows: NDArray[np.int64], name: str) -> Picture:
    (axes,) = tolerance_axes()
    plot_tolerance(axes, limit, rows)
    angle = degrees(limit["theta_i_deg"][int(rows[0])])
    where = "" if against_incidence(limit) else f", θᵢ = {angle}"
    label = (
        f"{limit['name']}: tolerance {tolerance_text(limit)}, probability of conformity "
        f"{probability_text(limit['probability'])}, verdict {limit['verdict']}"
    )
    svg = inline_svg(figure_of(axes), name=name, label=label)
    return Picture(svg, f"{limit['name']}{where}: {WORDS[limit['verdict']].lower()}")
