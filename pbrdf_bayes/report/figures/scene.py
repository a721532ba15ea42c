"""A scene in pictures: polar maps of the hemisphere, and s and p curves in the plane of incidence.

A map is seen from above. The radius is theta_r, light comes from the left (phi_r = 180 deg) and
goes on to the right (phi_r = 0). It is its own mirror image, of which the scene may hold half.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pbrdf_bayes.report.figures.axes import (
    WIDTH,
    angles,
    figure_of,
    figure_style,
    limits,
    logarithmic,
    mark_specular,
    name_axes,
    new_axes,
    positive,
    shade,
)
from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.figures.planes import span
from pbrdf_bayes.report.figures.polar_map import ANGLE_TICKS, Scale, fill_angles, polar_map
from pbrdf_bayes.report.figures.svg import inline_svg
from pbrdf_bayes.report.numbers import degrees, number
from pbrdf_bayes.scenes import SceneValues

Array = NDArray[np.float64]

MOST_DRAWN = 8
"""Angles of incidence that are drawn at most."""
_DECADES = 5.0
_MAPS = {"BRDF": "viridis", "DoLP": "magma", "AoLP": "twilight"}
"""Colours whose lightness rises evenly, for angles around and back; also told apart by the
colour-blind, and but for angles in grey."""


@dataclass(frozen=True)
class ScenePicture:
    """A picture with the name of its file and the part of the page that it belongs to."""

    name: str
    part: str
    svg: Markup


def scene_pictures(values: SceneValues, *, tag: str = "") -> list[ScenePicture]:
    """Everything that a scene can show.

    Parameters
    ----------
    values : SceneValues
    tag : str
        Ends every name: needed where pictures of several wavelengths are on one page.

    Returns
    -------
    list of ScenePicture
        Maps of the BRDF, on one scale, and of the degree and the angle of linear polarisation,
        where the directions span a hemisphere; curves of BRDF and degree in the plane of
        incidence and of the DHR where there are two points or more.
    """
    with figure_style():
        return [*_curves(values, tag), *_maps(values, tag), *_dhr(values, tag)]


def drawn_incidences(values: SceneValues) -> list[tuple[int, float]]:
    """Index and angle [deg] of the incidences that are drawn: `MOST_DRAWN`, evenly spread."""
    theta_i = values.scene.theta_i_deg
    chosen = np.unique(np.linspace(0, len(theta_i) - 1, min(len(theta_i), MOST_DRAWN)).astype(int))
    return [(i, theta_i[i]) for i in chosen.tolist()] if theta_i else []


# -------------------------------------------------------------------------------------------- maps


def _maps(values: SceneValues, tag: str) -> list[ScenePicture]:
    scene, grid = values.scene, _closed(values)
    found: list[ScenePicture] = []
    if grid is None:
        return found
    x, y, order = grid
    drawn = drawn_incidences(values)
    if values.brdf is not None:
        logs = np.log10(positive(values.brdf[..., values.at_median]))
        scale = _brdf_scale(logs)
        for i, theta_i in drawn:
            for q, z in zip(scene.polarizations, logs[:, i], strict=True):
                title = f"BRDF (sr⁻¹), {LOOKS[q].word}, θ_i = {degrees(theta_i)}"
                label = f"Polar map of the {q} BRDF at {degrees(theta_i)}: {span(10**z)} per sr"
                at = f"{theta_i:.10g}{tag}"
                svg = polar_map(x, y, z[:, order], theta_i, scale, title, label, f"map-{q}-{at}")
                found.append(ScenePicture(f"scene_brdf_{q}_{at}", "hemisphere", svg))
    if values.dolp is not None:
        dolp = values.dolp[..., values.at_median]
        scale = _share_scale(dolp)
        for i, theta_i in drawn:
            z = dolp[i]
            title = f"Degree of linear polarisation, θ_i = {degrees(theta_i)}"
            label = (
                f"Polar map of the degree of linear polarisation at {degrees(theta_i)}: {span(z)}"
            )
            at = f"{theta_i:.10g}{tag}"
            svg = polar_map(x, y, z[:, order], theta_i, scale, title, label, f"dolp-{at}")
            found.append(ScenePicture(f"scene_dolp_{at}", "polarisation", svg))
    if values.aolp_deg is not None:
        found += _angle_maps(values, x, y, order, tag)
    return found


def _angle_maps(
    values: SceneValues, x: Array, y: Array, order: NDArray[np.int64], tag: str
) -> list[ScenePicture]:
    """Angle of linear polarisation, where there is any; the mirror image has the other sign."""
    assert values.aolp_deg is not None
    found = []
    folded = np.mod(values.scene.phi_r_deg, 360.0) > 180.0
    side = np.where(np.arange(order.size) < (order.size + 1) // 2, 1.0, -1.0)
    sign = np.where(folded[order], -side, side)
    scale = Scale(-90.0, 90.0, *ANGLE_TICKS, _MAPS["AoLP"])
    for i, theta_i in drawn_incidences(values):
        z = sign * values.aolp_deg[i][:, order, values.at_median]
        known = int(np.isfinite(z).sum())
        title = f"Angle of linear polarisation, θ_i = {degrees(theta_i)}"
        label = (
            f"Polar map of the angle of linear polarisation at {degrees(theta_i)}, modulo 180°, "
            f"0 along s: {known} of {z.size} directions have one"
        )
        at = f"{theta_i:.10g}{tag}"
        svg = polar_map(x, y, z, theta_i, scale, title, label, f"aolp-{at}", fill=fill_angles)
        found.append(ScenePicture(f"scene_aolp_{at}", "polarisation", svg))
    return found


def _closed(values: SceneValues) -> tuple[Array, Array, NDArray[np.int64]] | None:
    """Points of a full circle of azimuths, and which azimuth of the scene each is.

    None where the scene has too few: two radii, and azimuths that reach from 0 to 180 deg when
    folded, in steps of 90 deg at most.
    """
    theta = np.array(values.scene.theta_r_deg)
    folded = np.mod(values.scene.phi_r_deg, 360.0)
    folded = np.where(folded > 180.0, 360.0 - folded, folded)
    phi, first = np.unique(folded, return_index=True)
    ends = phi.size > 2 and phi[0] == 0.0 and phi[-1] == 180.0
    if not ends or np.diff(phi).max() > 90.0 or theta.size < 2 or theta[0] < 0.0:
        return None
    order = np.concatenate([first, first[-2::-1]])
    circle = np.deg2rad(np.concatenate([phi, 360.0 - phi[-2::-1]]))
    return np.outer(theta, np.cos(circle)), np.outer(theta, np.sin(circle)), order


def _brdf_scale(logs: Array) -> Scale:
    low, high = limits(logs, pad=0.0, least=0.4)
    low = max(low, high - _DECADES)
    every = (1,) if high - low > 2.0 else (1, 2, 5)
    steps = [(f, d) for d in range(floor(low), ceil(high) + 1) for f in every]
    inside = [(f, d) for f, d in steps if low <= log10(f) + d <= high]
    words = [number(f * 10.0**d) for f, d in inside]
    return Scale(low, high, [log10(f) + d for f, d in inside], words, _MAPS["BRDF"])


def _share_scale(dolp: Array) -> Scale:
    known = dolp[np.isfinite(dolp)]
    high = min(1.0, ceil(10.0 * max(float(known.max(initial=0.0)), 0.05) - 1e-9) / 10.0)
    steps = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(0.0, high)
    ticks = [float(t) for t in steps if t <= high + 1e-9]
    return Scale(0.0, high, ticks, [f"{t:.3g}" for t in ticks], _MAPS["DoLP"])


# ------------------------------------------------------------------------------------------ curves


def _curves(values: SceneValues, tag: str) -> list[ScenePicture]:
    found: list[ScenePicture] = []
    scene, (theta, rows, columns) = values.scene, _in_plane(values)
    if theta.size < 2:
        return found
    for i, theta_i in drawn_incidences(values):
        at = f"{theta_i:.10g}{tag}"
        if values.brdf is not None:
            strands = {
                q: values.brdf[j, i][rows, columns] for j, q in enumerate(scene.polarizations)
            }
            svg = _brdf_curves(theta, strands, theta_i, values.at_median, f"plane-{at}")
            found.append(ScenePicture(f"scene_plane_{at}", "plane", svg))
        if values.dolp is not None:
            curve = values.dolp[i][rows, columns]
            svg = _dolp_curve(theta, curve, theta_i, values, f"plane-dolp-{at}")
            found.append(ScenePicture(f"scene_plane_dolp_{at}", "polarisation", svg))
    return found


def _in_plane(values: SceneValues) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Signed angles in the plane of incidence, and where they stand in the grid."""
    scene = values.scene
    turned = np.mod(scene.phi_r_deg, 360.0)
    columns = np.flatnonzero((turned == 0.0) | (turned == 180.0))
    signs = np.where(turned[columns] == 0.0, 1.0, -1.0)
    signed = np.outer(scene.theta_r_deg, signs)
    theta, first = np.unique(signed.ravel(), return_index=True)
    if not columns.size:
        return theta, first, first
    return theta, first // columns.size, columns[first % columns.size]


def _brdf_curves(
    theta: Array, strands: dict[str, Array], theta_i: float, middle: int, name: str
) -> Markup:
    low, high = limits(*(np.log10(positive(v)) for v in strands.values()), pad=0.05, least=0.6)
    axes = _axes(f"In the plane of incidence, θ_i = {degrees(theta_i)}", "BRDF (sr⁻¹)")
    logarithmic(axes, 10.0 ** max(low, high - _DECADES), 10.0**high)
    mark_specular(axes, theta_i)
    plot_strands(axes, theta, {q: positive(v) for q, v in strands.items()}, middle)
    said = "; ".join(f"{q} {span(v[:, middle])} per sr" for q, v in strands.items())
    label = f"BRDF in the plane of incidence at {degrees(theta_i)}: {said}"
    return inline_svg(figure_of(axes), name=name, label=label)


def _dolp_curve(
    theta: Array, curve: Array, theta_i: float, values: SceneValues, name: str
) -> Markup:
    axes = _axes(f"Polarisation in the plane, θ_i = {degrees(theta_i)}",
                 "degree of linear polarisation")  # fmt: skip
    axes.set_ylim(0.0, _share_scale(curve).high)
    plot_strands(axes, theta, {values.scene.stokes_incident: curve}, values.at_median)
    label = f"Degree of linear polarisation in plane: {span(curve[:, values.at_median])}"
    return inline_svg(figure_of(axes), name=name, label=label)


def _dhr(values: SceneValues, tag: str) -> list[ScenePicture]:
    scene = values.scene
    if values.dhr is None or len(scene.dhr_theta_i_deg) < 2:
        return []
    strands = dict(zip(scene.polarizations, values.dhr, strict=True))
    axes = _axes("Hemispherical reflectance", "DHR")
    axes.set(xlim=(0.0, 90.0), ylim=(0.0, limits(values.dhr, pad=0.06)[1]))
    angles(axes.xaxis, 0, 30, 60, 90)
    axes.set_xlabel("angle of incidence θ_i")
    plot_strands(axes, np.array(scene.dhr_theta_i_deg), strands, values.at_median)
    said = "; ".join(f"{q} {span(v[:, values.at_median])}" for q, v in strands.items())
    svg = inline_svg(
        figure_of(axes), name=f"scene-dhr{tag}", label=f"DHR against incidence: {said}"
    )
    return [ScenePicture(f"scene_dhr{tag}", "dhr", svg)]


def _axes(title: str, quantity: str) -> Axes:
    (axes,) = new_axes(WIDTH, 278.0, (46, 58, WIDTH - 56, 170))
    axes.set_xlim(-90.0, 90.0)
    angles(axes.xaxis, -60, -30, 0, 30, 60)
    name_axes(axes, "scattering angle θ_r", quantity)
    axes.annotate(title, (0, 1), (-44, 32), "axes fraction", "offset points", fontsize=11.5)
    return axes


def plot_strands(axes: Axes, x: Array, strands: Mapping[str, Array], middle: int) -> Axes:
    """Draw curves of shape (n_x, n_quantile) with their bands and a legend below the axis."""
    for q, curve in strands.items():
        look = LOOKS[q]
        if curve.shape[1] > 1:
            shade(axes, x, curve[:, 0], curve[:, -1], look.color, 0.25)
        axes.plot(x, curve[:, middle], lw=1.5, label=look.word, **look.line)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.22), ncols=3, frameon=False,
                borderpad=0, borderaxespad=0, handlelength=2.5, fontsize=10.5)  # fmt: skip
    return axes
