"""BRDF against scattering angle with its bands, deviations in dex, residuals of each scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pbrdf_bayes.report.arrays import Curve, ScanPoints
from pbrdf_bayes.report.figures.axes import (
    WIDTH,
    angles,
    dots,
    draw_bands,
    emptied,
    figure_of,
    logarithmic,
    mark_specular,
    name_axes,
    new_axes,
    positive,
    thinned,
)
from pbrdf_bayes.report.figures.looks import FAINT, LOOKS, MUTED, Picture
from pbrdf_bayes.report.figures.planes import (
    Plane,
    Strand,
    brdf_limits,
    deviations,
    dex_reach,
    fit_note,
    label_of,
    rms,
)
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import THIN, count, dex_as_percent, fixed, number, rounded

Array = NDArray[np.float64]

MOST_POINTS = 160
"""Readings of a scan drawn at most over a curve."""
MOST_RESIDUALS = 330
LONGEST_LAG = 40


def plot_curves(
    axes: Axes, plane: Plane, *, y_limits: tuple[float, float] | None = None
) -> Axes:  # fmt: skip
    """Draw the BRDF of a scan plane: readings, curves and bands of each polarisation.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    plane : Plane
        Angles in degrees, BRDF [sr^-1].
    y_limits : tuple of float, optional
        Ends of the logarithmic axis [sr^-1]; those of the plane where not given.

    Returns
    -------
    matplotlib.axes.Axes
        The one given.
    """
    axes.set_xlim(-90.0, 90.0)
    logarithmic(axes, *(y_limits or brdf_limits([plane])))
    angles(axes.xaxis, -60, -30, 0, 30, 60)
    name_axes(axes, "scattering angle θ_r", "BRDF (sr⁻¹)")
    if plane.specular_deg is not None:
        mark_specular(axes, plane.specular_deg)
    for strand in plane.strands:
        look, curve = LOOKS[strand.polarization], strand.curve
        if curve is not None:
            model = None if curve.model_band is None else positive(curve.model_band)
            draw_bands(axes, curve.theta_r_deg, look.color, model=model,
                       predictive=positive(curve.predictive_band))  # fmt: skip
        for scan in strand.scans:
            rows = thinned(scan.residual_dex, max(12, MOST_POINTS // len(strand.scans)))
            dots(
                axes, scan.theta_r_deg[rows], positive(scan.value[rows]), look, size=2.6, alpha=0.5
            )
        if curve is not None:
            axes.plot(curve.theta_r_deg, positive(curve.map), **look.line)
    return axes


def plot_deviations(
    axes: Axes, strand: Strand, *, reach: float | None = None, most: int = MOST_RESIDUALS
) -> Axes:
    """Draw bands and readings of one polarisation relative to the model at the MAP, in dex.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    strand : Strand
    reach : float, optional
        Half height of the axis [dex]; readings beyond it are drawn at its edge.
    most : int
        Readings drawn at most.

    Returns
    -------
    matplotlib.axes.Axes
        The one given.
    """
    reach = dex_reach([strand]) if reach is None else reach
    look, curve = LOOKS[strand.polarization], strand.curve
    axes.set(xlim=(-90.0, 90.0), ylim=(-reach, reach))
    angles(axes.xaxis, -60, -30, 0, 30, 60)
    name_axes(axes, "scattering angle θ_r", "relative to the model (dex)")
    if curve is not None:
        model = None if curve.model_band is None else deviations(curve.model_band, curve)
        draw_bands(axes, curve.theta_r_deg, look.color, model=model,
                   predictive=deviations(curve.predictive_band, curve))  # fmt: skip
    axes.axhline(0.0, color=FAINT, lw=0.8)
    for scan in strand.scans:
        residual = scan.residual_dex
        rows = thinned(residual, max(20, most // len(strand.scans)))
        at_edge = np.clip(residual[rows], -0.97 * reach, 0.97 * reach)
        dots(axes, scan.theta_r_deg[rows], at_edge, look, size=2.2)
    return axes


def plot_autocorrelation(axes: Axes, scan: ScanPoints) -> Axes:
    """Draw the autocorrelation of the residuals of a scan along the scattering angle."""
    acf = autocorrelation(scan.residual_dex)
    step, unit = _spacing(scan.theta_r_deg[np.isfinite(scan.residual_dex)])
    longest = max(1.0, (acf.size - 1) * step)
    axes.set(xlim=(-0.02 * longest, longest), ylim=(-1.0, 1.0), yticks=(-1, 0, 1))
    axes.locator_params("x", nbins=2)
    axes.xaxis.set_major_formatter("{x:g}" + unit)
    name_axes(axes, "lag" if unit else "lag (readings)", "autocorrelation", beside=16)
    if acf.size == 0:
        axes.text(0.5, 0.6, "too few", transform=axes.transAxes, color=MUTED, ha="center")
        return axes
    bound = 1.96 / np.sqrt(np.isfinite(scan.residual_dex).sum())
    for y in (-bound, bound):
        axes.axhline(y, color=MUTED, lw=0.8, ls=(0, (2.0, 2.0)))
    lags, nothing = step * np.arange(acf.size), np.full(acf.size, np.nan)
    bars = np.column_stack([0.0 * acf, acf, nothing]).ravel()
    axes.plot(np.repeat(lags, 3), bars, color=LOOKS[scan.polarization].color, lw=1.4)
    axes.axhline(0.0, color=FAINT, lw=0.8)
    return axes


def autocorrelation(values: Array, longest: int = LONGEST_LAG) -> Array:
    """Autocorrelation at lags 0, 1, ...; empty where there are too few values or no variance.

    Examples
    --------
    >>> import numpy as np
    >>> autocorrelation(np.array([1.0, -1.0] * 8), 2).round(2).tolist()
    [1.0, -0.94, 0.88]
    """
    good = values[np.isfinite(values)]
    centred = good - good.mean() if good.size >= 8 else np.zeros(0)
    variance = float(centred @ centred)
    lags = range(min(longest, good.size // 3) + 1) if variance > 0 else ()
    return np.array([float(centred[: good.size - lag] @ centred[lag:]) / variance for lag in lags])


def _spacing(theta_r_deg: Array) -> tuple[float, str]:
    """Lag of one reading: in degrees where the readings are evenly spaced."""
    steps = np.diff(theta_r_deg)
    typical = float(np.median(steps)) if steps.size else 0.0
    even = typical > 0 and np.mean(np.abs(steps - typical) < 0.05 * typical) > 0.95
    return (typical, "°") if even else (1.0, "")


def plane_pictures(
    planes: Sequence[Plane], *, name: str, what: str = "BRDF",
    note: Callable[[Strand], str] = fit_note,
) -> list[Picture]:  # fmt: skip
    """Return one picture per scan plane, all on the same axes."""
    y, reach = brdf_limits(planes), dex_reach([s for p in planes for s in p.strands])
    panels = {n: _stacked_axes(n, WIDTH, 146.0) for n in {len(p.strands) for p in planes}}
    return [
        _stacked(plane, panels[len(plane.strands)], y, reach, f"{name}{i}", what, note)
        for i, plane in enumerate(planes)
    ]


def key_picture(planes: Sequence[Plane]) -> tuple[Picture, Plane]:
    """Draw the worst-fitting plane for the first screen."""
    plane = max(planes, key=lambda p: float(np.nan_to_num(p.rms_dex)))
    panels = _stacked_axes(len(plane.strands), 384.0, 172.0)
    return _stacked(plane, panels, brdf_limits([plane]), dex_reach(plane.strands), "key"), plane


def _stacked_axes(n: int, width: float, upper: float) -> list[Axes]:
    """Axes of the curve above, and one strip of deviations per polarisation below."""
    left, below, strip, pitch = 46.0, 36.0, 42.0, 51.0
    across, top = width - left - 12.0, below + n * pitch + 21.0
    boxes = [(left, below + i * pitch, across, strip) for i in reversed(range(n))]
    panels = new_axes(width, top + upper + 26.0, (left, top, across, upper), *boxes)
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    return panels


def _stacked(
    plane: Plane, panels: Sequence[Axes], y: tuple[float, float], reach: float, name: str,
    what: str = "BRDF", note: Callable[[Strand], str] = fit_note,
) -> Picture:  # fmt: skip
    first, *strips = emptied(panels)
    plot_curves(first, plane, y_limits=y)
    for axes, strand in zip(strips, plane.strands, strict=True):
        plot_deviations(axes, strand, reach=reach, most=MOST_POINTS)
        q = strand.polarization
        axes.text(92, 0, q, color=LOOKS[q].color, va="center_baseline")
    for axes in strips[1:]:
        axes.set_ylabel("")
    for axes in panels[:-1]:
        axes.set_xlabel("")
    svg = inline_svg(figure_of(first), name=name, label=label_of(plane, what))
    return Picture(svg, plane.title, tuple((s.polarization, note(s)) for s in plane.strands))


def residual_pictures(scans: Sequence[ScanPoints], curves: Sequence[Curve]) -> list[Picture]:
    """Return one picture per scan, all on the same axes."""
    by_key = {(c.polarization, c.theta_i_deg, c.phi_r_deg): c for c in curves}
    strands = [
        Strand(s.polarization, by_key.get((s.polarization, s.theta_i_deg, s.phi_r_deg)), (s,))
        for s in scans
    ]
    reach = dex_reach(strands)
    panels = new_axes(WIDTH, 166.0, (44, 36, 172, 104), (256, 36, 78, 104))
    return [_residuals(strand, panels, reach, f"res{i}") for i, strand in enumerate(strands)]


def _residuals(strand: Strand, panels: Sequence[Axes], reach: float, name: str) -> Picture:
    (scan,), (left, right) = strand.scans, emptied(panels)
    plot_deviations(left, strand, reach=reach)
    angles(left.xaxis, -60, 0, 60)
    name_axes(left, "θ_r", "residual (dex)")
    plot_autocorrelation(right, scan)
    text = _text(scan.residual_dex, reach)
    label = f"Residuals of {LOOKS[scan.polarization].word} at {scan.theta_i_deg:g}°: {text}"
    svg = inline_svg(figure_of(left), name=name, label=label)
    return Picture(svg, scan.label, ((scan.polarization, text),))


def _text(residual: Array, reach: float) -> str:
    good, acf, size = residual[np.isfinite(residual)], autocorrelation(residual), rms(residual)
    mean = rounded(good.mean() if good.size else None, size).value
    text = f"rms {number(size, digits=2)}{THIN}dex ({dex_as_percent(size)}) · mean {mean}"
    text += f" · lag-1\N{NO-BREAK SPACE}{fixed(acf[1], 2)}" if acf.size > 1 else ""
    outside, lost = int((np.abs(good) > reach).sum()), residual.size - good.size
    text += f"; {count(outside)} beyond the axis, drawn at its edge" if outside else ""
    return text + (f"; {count(lost)} without a logarithm" if lost else "")
