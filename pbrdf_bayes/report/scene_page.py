"""The page of a scene, and its pictures as files of their own."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pbrdf_bayes.report.figures_scene import ScenePicture, drawn_incidences
from pbrdf_bayes.report.numbers import count
from pbrdf_bayes.report.page import environment
from pbrdf_bayes.scenes import SceneValues

_FONT = "Arial, Helvetica, sans-serif"
_WORDS = {"verdict": "verdict of the fit", "applicability": "applicability of the model"}
_NO_MAP = (
    "no polar map: maps need theta_r from 0 on and phi_r from 0 to 180°, in steps of 90° at most; "
    "all values are in scene.csv and scene.nc"
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


def render_scene(values: SceneValues, pictures: Sequence[ScenePicture]) -> str:
    """Write a scene as one self-contained HTML page.

    Parameters
    ----------
    values : SceneValues
    pictures : sequence of ScenePicture
        Of `scene_pictures`.

    Returns
    -------
    str
        The same scene gives the same text.
    """
    source, scene = values.source, values.scene
    parts = [
        (heading, note, [p for p in pictures if p.part == name])
        for name, (heading, note) in _PARTS.items()
    ]
    kicker = (
        [f"{count(scene.n_directions)} direction{'s' * (scene.n_directions != 1)}"]
        if scene.theta_i_deg
        else []
    )
    kicker += (
        [f"DHR at {count(len(scene.dhr_theta_i_deg))} angles"] if scene.dhr_theta_i_deg else []
    )
    lines = [_line(key, text) for key, text in source.items() if key != "sample"]
    n_drawn = len(drawn_incidences(values))
    if n_drawn < len(scene.theta_i_deg):
        lines.append(f"drawn: {n_drawn} of {len(scene.theta_i_deg)} angles of incidence")
    drawn = {picture.part for picture in pictures}
    if drawn and scene.theta_i_deg and not scene.in_plane and "hemisphere" not in drawn:
        lines.append(_NO_MAP)
    if scene.stokes_incident:
        share = f", share of depolarised light {scene.depolarisation:g}"
        lines.append(
            f"Stokes components for illumination {scene.stokes_incident!r}"
            + (share if scene.depolarisation else "")
        )
    return environment().get_template("scene.html.j2").render(
        title=source.get("sample", "Given parameters"), kicker=" · ".join(kicker), lines=lines,
        parts=[part for part in parts if part[2]],
    )  # fmt: skip


def _line(key: str, text: str) -> str:
    if key == "wavelength_um":
        return f"{text} µm"
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
