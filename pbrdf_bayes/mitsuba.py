"""A BSDF plugin of Mitsuba 3, the extra ``[mitsuba]``.

>>> import mitsuba as mi  # doctest: +SKIP
>>> mi.set_variant("scalar_spectral_polarized")  # doctest: +SKIP
>>> register()  # doctest: +SKIP
>>> mi.load_dict({"type": "pbrdf", "n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47})
... # doctest: +SKIP

The plugin evaluates the model itself, in scalar variants; a ``.pbsdf`` of `pbrdf_bayes.export_brdf`
renders faster. The parameters are those of one wavelength and stand for all wavelengths of a
rendering.
"""

from __future__ import annotations

from importlib import import_module
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import DOMAIN, MAX_THETA_I_DEG, Parameters
from pbrdf_bayes.workflow.export_grids import facet_mueller
from pbrdf_bayes.workflow.export_source import Source, source_of_parameters

_SHARE_DIFFUSE = 0.3
_WIDTH_OF_NORMALS = 0.78
"""Width of the GGX distribution over rho0: its half maximum is where that of the lobe is."""
_NARROWEST, _WIDEST = 1e-3, 1.0
_SCALAR = "scalar_"


def register() -> None:
    """Register the BSDF ``pbrdf`` with the variant of Mitsuba that is set.

    Its parameters are ``n``, ``k``, ``sigma_n0``, ``rho0`` and the effects of the sample by their
    names, such as ``lambert``. In polarised variants `eval` has the Mueller matrix, in others the
    BRDF of unpolarised light.

    Raises
    ------
    ConfigError
        When Mitsuba is not installed, or the variant is not a scalar one.
    """
    try:
        mi = import_module("mitsuba")
    except ImportError:
        msg = "Mitsuba is not installed. Install it: pip install 'pbrdf-bayes[mitsuba]'"
        raise ConfigError(msg) from None
    variant = mi.variant()
    if variant is None or not variant.startswith(_SCALAR):
        msg = (
            f"variant {variant!r}: the plugin works in scalar variants. Call "
            "mitsuba.set_variant('scalar_spectral_polarized') or 'scalar_rgb' before register()"
        )
        raise ConfigError(msg)
    mi.register_bsdf("pbrdf", _plugin_class(mi))


def matrix_of(source: Source, light: NDArray[np.float64], viewer: NDArray[np.float64]) -> Any:
    """Mueller matrix (4, 4) [sr^-1] for unit vectors to light and viewer, z the normal.

    Both Stokes frames lie across the plane of light and viewer.
    """
    theta_i, theta_r = (np.rad2deg(np.arctan2(np.hypot(v[0], v[1]), v[2])) for v in (light, viewer))
    turned = np.arctan2(viewer[1], viewer[0]) - np.arctan2(light[1], light[0]) - np.pi
    phi_r = np.rad2deg(np.arctan2(np.sin(turned), np.cos(turned)))
    at = (np.minimum(theta_i, MAX_THETA_I_DEG), np.minimum(theta_r, 90.0), phi_r)
    return facet_mueller(source, *(np.array([x]) for x in at))[0]


def _plugin_class(mi: Any) -> Any:
    """The class of the plugin for the variant that is set."""

    class Pbrdf(mi.BSDF):  # type: ignore[misc]
        """The four-parameter model."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            null = Effects()
            given = {name: float(props.get(name, 0.0)) for name in DOMAIN if name in props}
            missing = [name for name in DOMAIN if name not in given]
            if missing:
                msg = f"pbrdf: give {', '.join(missing)}"
                raise ConfigError(msg)
            added = {
                name: props[name]
                for name in Effects.__dataclass_fields__
                if name in props and props[name] != getattr(null, name)
            }
            self.source = source_of_parameters(
                Parameters(**given), Effects(**added), sample="pbrdf", wavelength_um=1.0
            )
            width = _WIDTH_OF_NORMALS * given["rho0"]
            self.width = min(max(width, _NARROWEST), _WIDEST)
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags

        def sample(
            self, ctx: Any, si: Any, sample1: float, sample2: Any, active: bool = True
        ) -> Any:
            """A direction from the cosine law or from GGX normals."""
            bs = mi.BSDFSample3f()
            nothing = mi.Spectrum(0.0)
            wi = si.wi
            if wi.z <= 0.0 or not active:
                return bs, nothing
            if sample1 < _SHARE_DIFFUSE:
                wo = mi.warp.square_to_cosine_hemisphere(sample2)
            else:
                tangent = self.width * sqrt(sample2.x / max(1.0 - sample2.x, 1e-12))
                c = 1.0 / sqrt(1.0 + tangent * tangent)
                s, phi = c * tangent, 2.0 * pi * sample2.y
                h = mi.Vector3f(s * cos(phi), s * sin(phi), c)
                wo = 2.0 * _dot(wi, h) * h - wi
            density = self.pdf(ctx, si, wo, active)
            if wo.z <= 0.0 or density <= 0.0:
                return bs, nothing
            bs.wo, bs.pdf, bs.eta = wo, density, 1.0
            bs.sampled_type, bs.sampled_component = +mi.BSDFFlags.GlossyReflection, 0
            return bs, self.eval(ctx, si, wo, active) / density

        def eval(self, ctx: Any, si: Any, wo: Any, active: bool = True) -> Any:
            """BRDF times the cosine of ``wo``."""
            wi = si.wi
            if wi.z <= 0.0 or wo.z <= 0.0 or not active:
                return mi.Spectrum(0.0)
            light, viewer = (wo, wi) if ctx.mode == mi.TransportMode.Radiance else (wi, wo)
            vectors = (np.array([v.x, v.y, v.z], dtype=np.float64) for v in (light, viewer))
            matrix = wo.z * matrix_of(self.source, *vectors)
            if not mi.is_polarized:
                return mi.Spectrum(float(matrix[0, 0]))
            across = mi.Vector3f(*_across(light, viewer))
            return mi.mueller.rotate_mueller_basis(
                _spectrum(matrix), -light, across, mi.mueller.stokes_basis(-light),
                viewer, across, mi.mueller.stokes_basis(viewer),
            )  # fmt: skip

        def pdf(self, ctx: Any, si: Any, wo: Any, active: bool = True) -> float:  # noqa: ARG002
            """Density of `sample` [sr^-1]."""
            wi = si.wi
            if wi.z <= 0.0 or wo.z <= 0.0 or not active:
                return 0.0
            h = wi + wo
            h /= sqrt(_dot(h, h))
            w2 = self.width**2
            normals = w2 / (pi * (h.z * h.z * (w2 - 1.0) + 1.0) ** 2) * h.z
            return float(
                _SHARE_DIFFUSE * wo.z / pi
                + (1.0 - _SHARE_DIFFUSE) * normals / max(4.0 * _dot(wi, h), 1e-12)
            )

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: bool = True) -> Any:
            """`eval` and `pdf`."""
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def traverse(self, callback: Any) -> None:
            """No parameter changes once it is loaded."""

        def to_string(self) -> str:
            """The parameters."""
            return f"Pbrdf[{self.source.parameters}, {self.source.effects}]"

    def _spectrum(matrix: NDArray[np.float64]) -> Any:
        return mi.Spectrum([[mi.UnpolarizedSpectrum(float(x)) for x in row] for row in matrix])

    return Pbrdf


def _dot(a: Any, b: Any) -> float:
    return float(a.x * b.x + a.y * b.y + a.z * b.z)


def _across(light: Any, viewer: Any) -> tuple[float, float, float]:
    """Unit vector across the plane of light and viewer; back along the light, across the normal."""
    x = light.y * viewer.z - light.z * viewer.y
    y = light.z * viewer.x - light.x * viewer.z
    z = light.x * viewer.y - light.y * viewer.x
    if x * x + y * y + z * z < 1e-20:
        x, y, z = -light.y, light.x, 0.0
    norm = sqrt(x * x + y * y + z * z)
    return (x / norm, y / norm, z / norm) if norm > 0.0 else (0.0, 1.0, 0.0)
