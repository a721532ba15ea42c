"""Residuals of each scan in dex and their autocorrelation along the scattering angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import Curve, ScanPoints
from pbrdf_bayes.report.figures_brdf import THETA, WIDTH, draw_deviations
from pbrdf_bayes.report.figures_planes import MOST_PLANES, Picture, Plane, Strand, dex_reach, rms
from pbrdf_bayes.report.numbers import THIN, count, dex_as_percent, fixed, number, rounded
from pbrdf_bayes.report.panel import FAINT, INK, LOOKS, MUTED, Panel, linear_ticks, new_figure
from pbrdf_bayes.report.svg import inline_svg

Array = NDArray[np.float64]
HEIGHT = 166.0
MOST_POINTS = 330
LONGEST_LAG = 40


def worst_scans(scans: Sequence[ScanPoints]) -> list[ScanPoints]:
    """Return at most `MOST_PLANES` scans, those with the largest residuals, in their order."""
    if len(scans) <= MOST_PLANES:
        return list(scans)
    sizes = [rms(s.residual_dex) for s in scans]
    order = np.argsort(-np.nan_to_num(sizes), kind="stable")[:MOST_PLANES]
    return [scans[i] for i in sorted(order.tolist())]


def residual_pictures(scans: Sequence[ScanPoints], curves: Sequence[Curve]) -> list[Picture]:
    """Return one panel per scan, all on the same axes."""
    strands = [Strand(s.polarization, _curve_of(s, curves), (s,)) for s in scans]
    reach = dex_reach([Plane(0.0, 0.0, tuple(strands))])
    return [_picture(strand, reach, f"res{i}") for i, strand in enumerate(strands)]


def autocorrelation(values: Array, longest: int = LONGEST_LAG) -> Array:
    """Autocorrelation at lags 0, 1, ...; empty where there are too few values or no variance.

    Examples
    --------
    >>> import numpy as np
    >>> autocorrelation(np.array([1.0, -1.0] * 8), 2).round(2).tolist()
    [1.0, -0.94, 0.88]
    """
    good = values[np.isfinite(values)]
    n = good.size
    if n < 8:
        return np.zeros(0)
    centred = good - good.mean()
    variance = float(centred @ centred)
    if not variance > 0:
        return np.zeros(0)
    lags = range(min(longest, n // 3) + 1)
    return np.array([float(centred[: n - lag] @ centred[lag:]) / variance for lag in lags])


def _picture(strand: Strand, reach: float, name: str) -> Picture:
    scan = strand.scans[0]
    residual = scan.residual_dex
    figure = new_figure(WIDTH, HEIGHT)
    panel = Panel(figure, 44, 36, 172, HEIGHT - 62, THETA, (-reach, reach))
    panel.x_axis([-60, 0, 60], ["−60°", "0°", "60°"], "θ_r")
    panel.y_axis(*linear_ticks(-reach, reach), "residual (dex)")
    draw_deviations(panel, strand, most=MOST_POINTS)
    acf = _draw_autocorrelation(figure, scan, residual, LOOKS[scan.polarization].color)
    text = _text(residual, acf, reach)
    label = f"Residuals of {LOOKS[scan.polarization].word} at {scan.theta_i_deg:g}°: {text}"
    return Picture(
        inline_svg(figure, name=name, label=label), scan.label, ((scan.polarization, text),)
    )


def _draw_autocorrelation(figure: Figure, scan: ScanPoints, residual: Array, color: str) -> Array:
    acf = autocorrelation(residual)
    step, unit = _spacing(scan.theta_r_deg[np.isfinite(residual)])
    longest = max(1.0, (acf.size - 1) * step)
    panel = Panel(figure, 256, 36, 78, HEIGHT - 62, (-0.02 * longest, longest), (-1.0, 1.0))
    ticks, labels = linear_ticks(0, longest, least=2)
    panel.x_axis(ticks, [f"{text}{unit}" for text in labels], "lag" if unit else "lag (readings)")
    panel.y_axis([-1, 0, 1], ["−1", "0", "1"])
    panel.words(-16, panel.height + 9, "autocorrelation", color=INK, align="left")
    if acf.size == 0:
        panel.words(panel.width / 2, panel.height / 2 + 8, "too few", size=9.5)
        return acf
    bound = 1.96 / np.sqrt(np.isfinite(residual).sum())
    panel.segments([(0, b, longest, b) for b in (-bound, bound)], MUTED, 0.8, (2.0, 2.0))
    panel.segments([(i * step, 0, i * step, r) for i, r in enumerate(acf.tolist())], color, 1.4)
    panel.segments([(0, 0, longest, 0)], color=FAINT)
    return acf


def _curve_of(scan: ScanPoints, curves: Sequence[Curve]) -> Curve | None:
    key = (scan.polarization, scan.theta_i_deg, scan.phi_r_deg)
    return next((c for c in curves if (c.polarization, c.theta_i_deg, c.phi_r_deg) == key), None)


def _spacing(theta_r_deg: Array) -> tuple[float, str]:
    """Lag of one reading: in degrees where the readings are evenly spaced."""
    steps = np.diff(theta_r_deg)
    if steps.size == 0 or not np.median(steps) > 0:
        return 1.0, ""
    typical = float(np.median(steps))
    even = np.mean(np.abs(steps - typical) < 0.05 * typical) > 0.95
    return (typical, "°") if even else (1.0, "")


def _text(residual: Array, acf: Array, reach: float) -> str:
    good = residual[np.isfinite(residual)]
    size = rms(residual)
    mean = rounded(good.mean() if good.size else None, size).value
    text = f"rms {number(size, digits=2)}{THIN}dex ({dex_as_percent(size)}) · mean {mean}"
    text += f" · lag-1\N{NO-BREAK SPACE}{fixed(acf[1], 2)}" if acf.size > 1 else ""
    outside, lost = int((np.abs(good) > reach).sum()), residual.size - good.size
    text += f"; {count(outside)} beyond the axis, drawn at its edge" if outside else ""
    return text + (f"; {count(lost)} without a logarithm" if lost else "")
