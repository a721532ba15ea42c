"""All pictures of the report, section by section, from one analysis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pbrdf_bayes.report.arrays import (
    AngleCurve,
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
from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.curves import (
    MOST_POINTS,
    key_picture,
    plane_pictures,
    residual_pictures,
)
from pbrdf_bayes.report.figures.incidence import (
    conformity_pictures,
    dhr_pictures,
    not_drawn_text,
    width_pictures,
)
from pbrdf_bayes.report.figures.looks import Picture
from pbrdf_bayes.report.figures.planes import (
    MOST_PLANES,
    Plane,
    held_out_note,
    planes_of,
    rms,
    worst,
)
from pbrdf_bayes.report.figures.posterior import (
    MOST_DRAWS,
    MOST_SCANS,
    Sample,
    chain_pictures,
    corner_picture,
    places_picture,
)
from pbrdf_bayes.report.numbers import count, finite, number
from pbrdf_bayes.results import Analysis


@dataclass(frozen=True)
class Figures:
    """Pictures of each section; an empty list where the run has none."""

    key: Picture | None
    key_caption: str
    conformity: list[Picture]
    measured: list[Picture] = field(default_factory=list)
    between: list[Picture] = field(default_factory=list)
    dhr: list[Picture] = field(default_factory=list)
    residuals: list[Picture] = field(default_factory=list)
    places: Picture | None = None
    held_out: list[Picture] = field(default_factory=list)
    widths: list[Picture] = field(default_factory=list)
    corner: Picture | None = None
    chains: list[Picture] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)


def draw_figures(analysis: Analysis, *, brief: bool = False) -> Figures:
    """Draw every figure the analysis has data for.

    Parameters
    ----------
    analysis : Analysis
    brief : bool
        The worst-fitting scan plane and the tolerance limits alone.

    Returns
    -------
    Figures
    """
    scans, curves = scans_of(analysis), curves_of(analysis, measured=True)
    planes, dhr = planes_of(curves, scans), (dhr_curves_of(analysis), dhr_points_of(analysis))
    with figure_style():
        key, caption = _key(planes, *dhr)
        conformity = conformity_pictures(analysis.summary)
        remarks = {"conformity": not_drawn_text(analysis.summary), **_remarks(planes)}
        if brief:
            return Figures(key, caption, conformity, remarks=remarks)
        samples = samples_of(analysis)
        kinds = analysis.summary["parameters"]
        physical = [s for s in samples if kinds[s.name]["kind"] == "physical"]
        held_out = planes_of(*held_out_of(analysis))
        return Figures(
            key=key, key_caption=caption, conformity=conformity, remarks=remarks,
            measured=plane_pictures(_worst(planes), name="measured"),
            between=plane_pictures(
                _worst(planes_of(curves_of(analysis, measured=False), [])), name="between"
            ),
            dhr=dhr_pictures(*dhr),
            residuals=residual_pictures(
                worst(scans, [rms(s.residual_dex) for s in scans]), curves
            ),
            places=places_picture(places_of(analysis)),
            held_out=plane_pictures(
                _worst(held_out), name="held", what="Held-out BRDF", note=held_out_note
            ),
            widths=width_pictures(width_curves_of(analysis), scan_widths_of(analysis)),
            corner=corner_picture(physical) if physical else None,
            chains=chain_pictures(samples, ensembles_of(analysis)),
        )  # fmt: skip


def _worst(planes: Sequence[Plane]) -> list[Plane]:
    return worst(planes, [p.rms_dex for p in planes])


def samples_of(analysis: Analysis) -> list[Sample]:
    """Draws of every parameter that is not fixed, thinned to `MOST_DRAWS`."""
    found = []
    for name, record in analysis.summary["parameters"].items():
        posterior = draws_of(analysis, "posterior", name)
        if record["kind"] == "fixed" or not posterior.size:
            continue
        step = -(-posterior.size // MOST_DRAWS)
        prior, at_map = draws_of(analysis, "prior", name), finite(record["map"])
        found.append(
            Sample(name, record["symbol"], posterior[:, ::step], prior, at_map, step)
        )  # fmt: skip
    return found


def _key(
    planes: Sequence[Plane], curves: Sequence[AngleCurve], points: Sequence[DhrPoints]
) -> tuple[Picture | None, str]:
    """Picture of the first screen: the worst-fitting scan plane, or else the DHR."""
    measured = [plane for plane in planes if any(s.scans for s in plane.strands)]
    if measured:
        picture, plane = key_picture(measured)
        which = "The only scan plane" if len(measured) == 1 else "The worst-fitting scan plane"
        return picture, f"{which}, {plane.words}: rms {number(plane.rms_dex, digits=2)} dex."
    found = dhr_pictures(curves, points, name="key")
    return (found[0], "Directional-hemispherical reflectance.") if found else (None, "")


def _remarks(planes: Sequence[Plane]) -> dict[str, str]:
    """Say where a figure leaves something out."""
    scans = [scan for p in planes for s in p.strands for scan in s.scans]
    longest, n = max((s.value.size for s in scans), default=0), len(scans)
    return {
        "measured": (len(planes) > MOST_PLANES)
        * f"The {MOST_PLANES} worst-fitting of {count(len(planes))} scan planes are drawn.",
        "residuals": (n > MOST_PLANES)
        * f"The {MOST_PLANES} worst-fitting of {count(n)} scans are drawn.",
        "places": (n > MOST_SCANS)
        * f"The {MOST_SCANS} of {count(n)} scans least like chance are drawn.",
        "points": (longest > MOST_POINTS)
        * (
            f"At most {MOST_POINTS} readings of a scan are drawn here, evenly thinned without "
            f"losing an outlier; the fit uses all (up to {count(longest)} in a scan)."
        ),
    }
