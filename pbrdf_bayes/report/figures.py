"""All figures of the report, section by section, from one analysis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pbrdf_bayes.report.arrays import (
    DhrCurve,
    DhrPoints,
    curves_of,
    dhr_curves_of,
    dhr_points_of,
    draws_of,
    ensembles_of,
    held_out_of,
    places_of,
    scan_widths_of,
    scans_of,
    width_curves_of,
)
from pbrdf_bayes.report.figures_brdf import MOST_POINTS, key_picture, plane_pictures
from pbrdf_bayes.report.figures_conformity import conformity_pictures, not_drawn_text
from pbrdf_bayes.report.figures_dhr import dhr_pictures
from pbrdf_bayes.report.figures_pit import MOST_SCANS, pit_picture
from pbrdf_bayes.report.figures_planes import (
    MOST_PLANES,
    Picture,
    Plane,
    held_out_note,
    planes_of,
    worst_planes,
)
from pbrdf_bayes.report.figures_posterior import Sample, chain_pictures, corner_picture
from pbrdf_bayes.report.figures_residuals import residual_pictures, worst_scans
from pbrdf_bayes.report.figures_widths import width_pictures
from pbrdf_bayes.report.numbers import count, finite, number
from pbrdf_bayes.report.svg import figure_style
from pbrdf_bayes.results import Analysis


@dataclass(frozen=True)
class Figures:
    """Pictures of each section; an empty list where the run has none."""

    key: Picture | None
    key_caption: str
    measured: list[Picture]
    between: list[Picture]
    dhr: list[Picture]
    residuals: list[Picture]
    places: Picture | None
    held_out: list[Picture]
    widths: list[Picture]
    corner: Picture | None
    chains: list[Picture]
    conformity: list[Picture]
    remarks: dict[str, str] = field(default_factory=dict)


def draw_figures(analysis: Analysis, *, brief: bool = False) -> Figures:
    """Draw every figure the analysis has data for.

    Parameters
    ----------
    analysis : Analysis
    brief : bool
        The worst-fitting scan plane alone.

    Returns
    -------
    Figures
    """
    with figure_style():
        return _draw_key(analysis) if brief else _draw(analysis)


def _draw_key(analysis: Analysis) -> Figures:
    planes = planes_of(curves_of(analysis, measured=True), scans_of(analysis))
    key, caption = _key(planes, dhr_curves_of(analysis), dhr_points_of(analysis))
    return Figures(
        key=key, key_caption=caption, measured=[], between=[], dhr=[], residuals=[], places=None,
        held_out=[], widths=[], corner=None, chains=[],
        remarks={**_remarks(0, 0, 0), "conformity": not_drawn_text(analysis.summary)},
        conformity=conformity_pictures(analysis.summary),
    )  # fmt: skip


def _draw(analysis: Analysis) -> Figures:
    scans = scans_of(analysis)
    curves, between = curves_of(analysis, measured=True), curves_of(analysis, measured=False)
    planes, shown = planes_of(curves, scans), worst_scans(scans)
    dhr_curves, dhr_points = dhr_curves_of(analysis), dhr_points_of(analysis)
    samples = samples_of(analysis)
    physical = [s for s in samples if analysis.summary["parameters"][s.name]["kind"] == "physical"]
    key, caption = _key(planes, dhr_curves, dhr_points)
    return Figures(
        key=key,
        key_caption=caption,
        measured=plane_pictures(worst_planes(planes), name="brdf"),
        between=plane_pictures(planes_of(between, [])[:MOST_PLANES], name="between"),
        dhr=dhr_pictures(dhr_curves, dhr_points),
        residuals=residual_pictures(shown, curves),
        places=pit_picture(places_of(analysis)),
        held_out=plane_pictures(
            worst_planes(planes_of(*held_out_of(analysis))),
            name="held",
            what="Held-out BRDF",
            note=held_out_note,
        ),
        widths=width_pictures(width_curves_of(analysis), scan_widths_of(analysis)),
        corner=corner_picture(physical) if physical else None,
        chains=chain_pictures(samples, ensembles_of(analysis)),
        conformity=conformity_pictures(analysis.summary),
        remarks={
            **_remarks(len(planes), len(scans), max((s.value.size for s in scans), default=0)),
            "conformity": not_drawn_text(analysis.summary),
        },
    )


def samples_of(analysis: Analysis) -> list[Sample]:
    """Draws of every parameter that is not fixed."""
    found = []
    for name, record in analysis.summary["parameters"].items():
        if record["kind"] == "fixed":
            continue
        posterior = draws_of(analysis, "posterior", name)
        if posterior.size:
            prior = draws_of(analysis, "prior", name)
            found.append(Sample(name, record["symbol"], posterior, prior, finite(record["map"])))
    return found


def _key(
    planes: Sequence[Plane], curves: Sequence[DhrCurve], points: Sequence[DhrPoints]
) -> tuple[Picture | None, str]:
    """Picture of the first screen: the worst-fitting scan plane, or else the DHR."""
    measured = [plane for plane in planes if plane.measured]
    if measured:
        picture, plane = key_picture(measured)
        which = "The only scan plane" if len(measured) == 1 else "The worst-fitting scan plane"
        return picture, f"{which}, {plane.words}: rms {number(plane.rms_dex, digits=2)} dex."
    found = dhr_pictures(curves, points, name="key")
    return (found[0], "Directional-hemispherical reflectance.") if found else (None, "")


def _remarks(n_planes: int, n_scans: int, longest: int) -> dict[str, str]:
    """Say where a figure leaves something out."""
    found = dict.fromkeys(("measured", "residuals", "points", "places"), "")
    if n_planes > MOST_PLANES:
        found["measured"] = (
            f"The {MOST_PLANES} worst-fitting of {count(n_planes)} scan planes are drawn."
        )
    if n_scans > MOST_PLANES:
        found["residuals"] = f"The {MOST_PLANES} worst-fitting of {count(n_scans)} scans are drawn."
    if n_scans > MOST_SCANS:
        found["places"] = f"The {MOST_SCANS} of {count(n_scans)} scans least like chance are drawn."
    if longest > MOST_POINTS:
        found["points"] = (
            f"At most {MOST_POINTS} readings of a scan are drawn here, evenly thinned; "
            f"the fit uses all (up to {count(longest)} in a scan)."
        )
    return found
