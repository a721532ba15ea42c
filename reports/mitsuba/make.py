"""A sphere in Mitsuba, from the ``.pbsdf`` of the published paint, beside the model itself.

python reports/mitsuba/make.py

Needs the extra ``[mitsuba]``. The light is distant and the camera orthographic: the plane of light
and camera is the same all over the sphere, and s is across it in every pixel.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.io.significant import significant
from pbrdf_bayes.mitsuba import register
from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.svg import inline_svg

Array = NDArray[np.float64]

HERE = Path(__file__).parent
PAINT = pb.GREEN_PAINT
VARIANT = "scalar_spectral_polarized"
PHASE_DEG = 60.0
"""Angle between the directions to the light and to the camera."""
N_PIXELS, N_SAMPLES = 96, 64
MOST_DEG = 75.0
"""Pixels count where light and camera are up to it from the normal."""
FURNACE_DEG = (10.0, 40.0, 70.0)
N_FURNACE = 5_000
DIGITS = 3


def make() -> dict[str, Any]:
    """Numbers of the page."""
    mi = import_module("mitsuba")
    mi.set_variant(VARIANT)
    register()
    with tempfile.TemporaryDirectory() as folder:
        done = pb.export_brdf(PAINT, Path(folder) / "green.pbsdf", format="mitsuba")
        size = done.paths[0].stat().st_size
        rendered = render(mi, done.paths[0])
    model = of_model()
    counted = model["counted"]
    errors = {}
    for name in ("s", "p"):
        relative = np.abs(rendered[name][counted] / model[name][counted] - 1.0)
        errors[name] = {
            "median": float(np.median(relative)),
            "p95": float(np.quantile(relative, 0.95)),
        }
    off = np.abs(dolp(rendered) - dolp(model))[counted]
    errors["dolp"] = {"median": float(np.median(off)), "p95": float(np.quantile(off, 0.95))}
    images = {
        name: np.where(model["lit"], found, 0.0).tolist()
        for name, found in (("s", rendered["s"]), ("p", rendered["p"]), ("dolp", dolp(rendered)))
    }
    result = {
        "version": pb.__version__, "mitsuba": mi.__version__, "bytes": size, "notes": done.notes,
        "errors": errors, "furnace": furnace(mi), "images": images,
    }  # fmt: skip
    return json.loads(json.dumps(significant(result, DIGITS)))


def dolp(image: Mapping[str, Array]) -> Array:
    """Degree of linear polarisation with its sign: + is s."""
    total = image["s"] + image["p"]
    return (image["s"] - image["p"]) / np.where(total > 0.0, total, 1.0)


def render(mi: Any, pbsdf: Path) -> dict[str, Array]:
    """Radiance of the two polarisations for an irradiance of 1 across the light, [sr^-1]."""
    phase = np.deg2rad(PHASE_DEG)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {
                "type": "stokes",
                "nested": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
            },
            "sphere": {
                "type": "sphere",
                "bsdf": {"type": "measured_polarized", "filename": str(pbsdf), "alpha_sample": 0.3},
            },
            "sun": {
                "type": "directional", "direction": [-np.sin(phase), 0.0, -np.cos(phase)],
                "irradiance": {"type": "uniform", "value": 1.0},
            },
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at(
                    origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]
                ),
                "film": {
                    "type": "hdrfilm", "width": N_PIXELS, "height": N_PIXELS,
                    "rfilter": {"type": "box"}, "pixel_format": "luminance",
                },
                "sampler": {"type": "independent", "sample_count": N_SAMPLES},
            },
        }
    )  # fmt: skip
    found = np.array(mi.render(scene), dtype=np.float64)
    # channels: luminance, then the linear RGB of S0, S1, S2, S3; green of a flat spectrum
    white = np.array(mi.render(white_scene(mi)), dtype=np.float64)[..., 2].max()
    s0, s1 = found[..., 2] / white, found[..., 5] / white
    # + of S1 is along x of the camera, in the plane of light and camera
    return {"s": 0.5 * (s0 - s1), "p": 0.5 * (s0 + s1)}


def white_scene(mi: Any) -> Any:
    """A sky of radiance 1: the value that a flat spectrum of 1 has in a channel."""
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "stokes", "nested": {"type": "direct"}},
            "sky": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
            "sensor": {
                "type": "orthographic",
                "film": {
                    "type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"},
                    "pixel_format": "luminance",
                },
                "sampler": {"type": "independent", "sample_count": 1024},
            },
        }
    )  # fmt: skip


def of_model() -> dict[str, Any]:
    """The same pictures from `pbrdf_bayes.brdf` at the centre of each pixel."""
    x, y = np.meshgrid(*[(np.arange(N_PIXELS) + 0.5) / (0.5 * N_PIXELS) - 1.0] * 2)
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    phase = np.deg2rad(PHASE_DEG)
    mu_i, mu_r = x * np.sin(phase) + z * np.cos(phase), z
    lit = (mu_i > 0.0) & (mu_r > 0.0)
    theta_i, theta_r = (np.rad2deg(np.arccos(np.clip(mu[lit], 0.0, 1.0))) for mu in (mu_i, mu_r))
    sines = np.sin(np.deg2rad(theta_i)) * np.sin(np.deg2rad(theta_r))
    between = (np.cos(phase) - mu_i[lit] * mu_r[lit]) / np.maximum(sines, 1e-12)
    phi_r = np.rad2deg(np.pi - np.arccos(np.clip(between, -1.0, 1.0)))
    pictures: dict[str, Any] = {"lit": lit, "counted": np.zeros(lit.shape, dtype=bool)}
    for q in "sp":
        pictures[q] = np.zeros(lit.shape)
        values = pb.brdf(PAINT, np.minimum(theta_i, 89.95), theta_r, q, phi_r_deg=phi_r)
        pictures[q][lit] = 0.5 * values * mu_i[lit]
    near = (theta_i > 5.0) & (theta_r > 5.0) & (theta_i < MOST_DEG) & (theta_r < MOST_DEG)
    pictures["counted"][lit] = near
    return pictures


def furnace(mi: Any) -> list[dict[str, float]]:
    """Mean weight of directions that the plugin samples: the light that leaves of light of one."""
    bsdf = mi.load_dict(
        {
            "type": "pbrdf",
            "n": PAINT.n,
            "k": PAINT.k,
            "sigma_n0": PAINT.sigma_n0,
            "rho0": PAINT.rho0,
        }
    )
    context, rng = mi.BSDFContext(mi.TransportMode.Importance), np.random.default_rng(1)
    found = []
    for theta_i in FURNACE_DEG:
        si = mi.SurfaceInteraction3f()
        si.wavelengths = [550.0] * 4
        si.wi = mi.Vector3f(np.sin(np.deg2rad(theta_i)), 0.0, np.cos(np.deg2rad(theta_i)))
        weights = [
            np.ravel(np.array(bsdf.sample(context, si, a, mi.Point2f(b, c))[1]))[0]
            for a, b, c in rng.random((N_FURNACE, 3)).tolist()
        ]
        found.append(
            {
                "theta_i_deg": theta_i,
                "share": float(np.mean(weights)),
                "u": float(np.std(weights) / N_FURNACE**0.5),
                "dhr": float(pb.dhr(PAINT, theta_i, "u")),
            }
        )
    return found


def page(result: Mapping[str, Any]) -> str:
    """The page as text."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        loader=FileSystemLoader(HERE),
    )  # fmt: skip
    return environment.get_template("page.html.j2").render(
        css=Markup((HERE.parent / "pages.css").read_text(encoding="utf-8")),  # our own file
        pictures=draw(result["images"]), phase=PHASE_DEG, most=MOST_DEG, n_furnace=N_FURNACE,
        **result,
    )  # fmt: skip


def draw(images: Mapping[str, Any]) -> Markup:
    """The three pictures side by side."""
    s, p, degree = (np.array(images[name]) for name in ("s", "p", "dolp"))
    with figure_style():
        figure = Figure(figsize=(10.0, 3.3))
        axes = figure.subplots(1, 3)
        brightest = np.quantile(s[s > 0.0], 0.995)
        for ax, picture, title in zip(
            axes, (s, p, degree), ("s [1/sr]", "p [1/sr]", "degree (s - p)/(s + p)"), strict=True
        ):
            last = picture is degree
            shown = ax.imshow(
                picture, cmap="RdBu_r" if last else "gray",
                vmin=-1.0 if last else 0.0, vmax=1.0 if last else brightest,
            )  # fmt: skip
            ax.set_title(title)
            ax.set_axis_off()
            figure.colorbar(shown, ax=ax, shrink=0.8)
        figure.tight_layout()
        return inline_svg(figure, name="sphere", label="Sphere: s, p and degree of polarisation")


if __name__ == "__main__":
    numbers = make()
    (HERE / "mitsuba.json").write_text(json.dumps(numbers) + "\n", encoding="utf-8")
    (HERE / "index.html").write_text(page(numbers), encoding="utf-8")
    print({name: numbers[name] for name in ("errors", "furnace", "notes")})  # noqa: T201
