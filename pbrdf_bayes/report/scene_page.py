"""The page of a scene, and its pictures as files of their own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.figures.scene import ScenePicture, drawn_incidences
from pbrdf_bayes.report.numbers import count
from pbrdf_bayes.report.page import environment
from pbrdf_bayes.scenes import SceneValues

_FONT = "Arial, Helvetica, sans-serif"
_WORDS = {"verdict": "verdict of the fit", "applicability": "applicability of the model"}
_NO_MAP = (
    "no polar map: maps need theta_r from 0 on and phi_r from 0 to 180°, in steps of 90° at most; "
    "all values are in scene.csv and scene.nc"
)
_TURNED = (
    "S0 is not the BRDF out of plane: facets there mix s and p, Eqs. (8) to (12), where the BRDF "
    "of Eq. (2) has one polarisation; only unpolarised light has the same S0 and BRDF"
)
_PARTS = {
    "plane": ("In the plane of incidence", "Scattering angles from −90° (back) to 90° (forward)."),
    "hemisphere": (
        "Over the hemisphere",
        "Seen from above, light from the left. White lines at the labelled values.",
    ),
    "polarisation": (
        "Polarisation",
        (
            "Degree of linear polarisation of the scattered light, and its angle: modulo 180°, 0° "
            "along s, counterclockwise for who looks into the beam; none where it is unpolarised."
        ),
    ),
    "dhr": ("Hemispherical reflectance", "Directional hemispherical reflectance."),
}


@dataclass(frozen=True)
class _Part:
    """A section of the page: pictures of one kind."""

    heading: str
    note: str
    pictures: Sequence[ScenePicture]


@dataclass(frozen=True)
class _Chapter:
    """One wavelength: its heading where there are several, lines on its source, its sections."""

    heading: str
    lines: Sequence[str]
    parts: Sequence[_Part]


def render_scene(drawn: Sequence[tuple[SceneValues, Sequence[ScenePicture]]]) -> str:
    """Write a scene as one self-contained HTML page.

    Parameters
    ----------
    drawn : sequence of (SceneValues, sequence of ScenePicture)
        Of every wavelength of one scene, with what `scene_pictures` made of it.

    Returns
    -------
    str
        The same scene gives the same text.
    """
    first = drawn[0][0]
    scene, several = first.scene, len(drawn) > 1
    n, n_dhr = scene.n_directions, len(scene.dhr_theta_i_deg)
    kicker = [f"{count(n)} direction{'s' * (n != 1)}"] if scene.theta_i_deg else []
    kicker += [f"DHR at {count(n_dhr)} angle{'s' * (n_dhr != 1)}"] if n_dhr else []
    kicker += [f"{len(drawn)} wavelengths"] if several else []
    chapters = [_chapter(values, pictures, headed=several) for values, pictures in drawn]
    common = _of_scene(first, {p.part for _, pictures in drawn for p in pictures})
    return environment().get_template("scene.html.j2").render(
        title=first.source.get("sample", "Given parameters"), kicker=" · ".join(kicker),
        lines=common if several else [*chapters[0].lines, *common], chapters=chapters,
    )  # fmt: skip


def _chapter(values: SceneValues, pictures: Sequence[ScenePicture], *, headed: bool) -> _Chapter:
    wavelength = "" if values.wavelength_um is None else f"{values.wavelength_um:.10g} µm"
    lines = [_line(key, text) for key, text in values.source.items() if key != "sample"]
    parts = [
        _Part(heading, note, [p for p in pictures if p.part == name])
        for name, (heading, note) in _PARTS.items()
    ]
    return _Chapter(
        heading=wavelength if headed else "",
        lines=lines if headed or not wavelength else [wavelength, *lines],
        parts=[part for part in parts if part.pictures],
    )


def _of_scene(values: SceneValues, drawn: set[str]) -> list[str]:
    """Lines on what was asked for and what is not drawn of it."""
    scene, lines = values.scene, []
    n_drawn = len(drawn_incidences(values))
    if n_drawn < len(scene.theta_i_deg):
        lines.append(f"drawn: {n_drawn} of {len(scene.theta_i_deg)} angles of incidence")
    if drawn and scene.theta_i_deg and not scene.in_plane and "hemisphere" not in drawn:
        lines.append(_NO_MAP)
    if scene.stokes_incident:
        share = f", share of depolarised light {scene.depolarisation:g}"
        lines.append(
            f"Stokes components for {LOOKS[scene.stokes_incident].word} illumination"
            + (share if scene.depolarisation else "")
        )
        if scene.stokes_incident != "u" and not scene.in_plane:
            lines.append(_TURNED)
    return lines


def _line(key: str, text: str) -> str:
    return f"{_WORDS.get(key, key)}: {text}"


def standalone_svg(picture: ScenePicture) -> str:
    """Text of a picture as a file of its own, on white."""
    text = str(picture.svg)
    box = re.search(r'viewBox="0 0 (\S+) (\S+)"', text)
    width, height = box.groups() if box else ("344", "344")
    opening = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'font-family="{_FONT}"'
    )
    body = re.sub(r' style="max-width[^"]*"', "", text, count=1)
    body = body.replace('<svg class="plot"', opening, 1)
    head, mark, rest = body.partition(">")
    return f'{head}{mark}<rect width="100%" height="100%" fill="white"/>{rest}\n'
