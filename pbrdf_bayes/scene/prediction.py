"""BRDF, DHR and Stokes components of a scene: only what it asks for is computed.

What decides the cost, and where it is saved:

* the kernels see distinct directions only: the mirror image of a direction in the plane of
  incidence is that direction itself;
* a scan in plane needs one lobe for a direction, out of plane it takes two;
* only the polarisations asked for have rows (and quantiles); s and p share their lobes;
* without ``dhr_theta_i_deg`` there is no row of DHR, without directions no normalisation;
* effects whose values do nothing, and those of the instrument unless asked for, are left out; where
  none is left, the kernel is that of the four parameters;
* Stokes components take the BRDF of s and p; diffuse terms one more pass, the phase none for
  unpolarised light.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from math import isclose

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import ACCURACIES
from pbrdf_bayes.effects_table import DIFFUSE, INSTRUMENT_PARAMETERS
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.model.effects import Effects, with_values
from pbrdf_bayes.model.energy import check_energy
from pbrdf_bayes.model.four_parameter import (
    DOMAIN,
    MAX_THETA_I_DEG,
    Parameters,
    checked_angles,
    digits_of,
)
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.physics.scattering import evaluate_with_effects
from pbrdf_bayes.physics.scene import FIELDS, NULL, make_scene
from pbrdf_bayes.physics.scene_stokes import bulk_s1, of_surface
from pbrdf_bayes.physics.stokes import prepare_frames
from pbrdf_bayes.quantities import S_AND_P, STATES
from pbrdf_bayes.results import Analysis, drawn_sets
from pbrdf_bayes.scene.axial import axial_quantiles, mirrored
from pbrdf_bayes.scenes import Scene, SceneValues

Array = NDArray[np.float64]
Index = NDArray[np.int64]

QUANTILES = (0.05, 0.5, 0.95)
_UNPOLARISED = 1e-12
"""Degree of linear polarisation that is rounding: such light has no angle."""
_MOST_VALUES = 4_000_000
"""Values of all draws that are in memory at a time."""
_NONE = np.zeros(0)
_NO_WORDS = np.zeros(0, np.str_)


@dataclass(frozen=True, eq=False)
class DrawnModel:
    """Parameter sets of one sample, and what is switched on.

    Attributes
    ----------
    x : ndarray, shape (n_sets, 4 + n_effects)
        The first four columns are n, k, sigma_n0, rho0.
    names : tuple of str
        Of the columns.
    line_shape, fresnel_at : str
        As in `pbrdf_bayes.Effects`.
    digits : float
        Correct decimal digits of the normalisation.
    source : mapping
        Where the parameters come from, as text by name.
    wavelength_um : float or None
        That the parameters are of [um].
    """

    x: Array
    names: tuple[str, ...]
    line_shape: str
    fresnel_at: str
    digits: float
    source: Mapping[str, str]
    wavelength_um: float | None = None

    def without(self, left_out: tuple[str, ...]) -> DrawnModel:
        """The same model without the effects of these columns."""
        kept = [i for i, name in enumerate(self.names) if name not in left_out]
        return replace(
            self, x=np.ascontiguousarray(self.x[:, kept]), names=tuple(self.names[i] for i in kept)
        )

    def evaluate(self, geometry: Geometry) -> tuple[Array, Array]:
        """BRDF and DHR of the rows, shapes (n_sets, n_brdf) and (n_sets, n_dhr)."""
        strict = (self.line_shape, self.fresnel_at) == ("lorentzian", "mean-sine")
        if strict and len(self.names) == len(DOMAIN):
            return evaluate(geometry, self.x, self.digits)
        scene = make_scene(self.line_shape, self.fresnel_at, self.names)
        return evaluate_with_effects(geometry, scene, self.x, self.digits)


def predict_scene(
    model: Parameters | Analysis, scene: Scene, *, effects: Effects | None = None,
    rtol: float = 1e-8,
) -> SceneValues:  # fmt: skip
    """BRDF, DHR and Stokes components of what a scene asks for.

    Parameters
    ----------
    model : Parameters or Analysis
        Given parameters, or a finished run: then with bands, 5 %, 50 % and 95 % of the posterior.
    scene : Scene
        Angles [deg].
    effects : Effects, optional
        Line shape and effects beside given parameters; ``scene.effects`` goes on top of them.
    rtol : float
        Relative tolerance of the normalisation where parameters are given, in [1e-12, 1e-2]; a
        run has its own.

    Returns
    -------
    SceneValues
        BRDF and Stokes components [sr^-1], DHR and degree of linear polarisation [1], its angle
        [deg].

    Raises
    ------
    ConfigError
        When effects are given beside a run, are not known, or are those of the instrument in a
        scene without ``instrument``; when the scene has another wavelength than the run, or
        several.
    DomainError
        When an angle, an effect or the tolerance is out of range, or the sample would reflect more
        than it receives.

    Notes
    -----
    Effects of the instrument (DHR offset, scale of p, leakage, angle offsets, aperture) are left
    out unless ``scene.instrument``: a scene is what the sample does.

    Stokes components with diffuse terms: light from below the surface is unpolarised but for bulk
    scatter, which the transmittances of the surface polarise on its way out (Wolff 1994); see
    `pbrdf_bayes.physics.scene_stokes`. ``scene.depolarisation`` acts on all of S1 and S2.

    The bands are those of the curves, without noise or calibration of new readings.

    Source: Renhorn, Hallberg, Bergstrom, Boreman, Opt. Express 19, 1027 (2011), Eqs. (2)-(12),
    doi:10.1364/OE.19.001027. Tested against `brdf`, `dhr`, `stokes` and the integral over the
    hemisphere in ``tests/scene/test_prediction.py``.

    Examples
    --------
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> scene = Scene(theta_i_deg=(20.0,), theta_r_deg=(-40.0, 0.0, 20.0), polarizations=("s",))
    >>> print(predict_scene(green, scene).brdf.ravel().round(6))
    [0.003834 0.013491 0.025692]
    """
    _check_angles(scene)
    if len(scene.wavelength_um) > 1:
        msg = (
            f"wavelength_um has {len(scene.wavelength_um)} values: parameters belong to one "
            "wavelength. Give one, or a run of each"
        )
        raise ConfigError(msg)
    if isinstance(model, Analysis):
        if effects is not None or scene.effects:
            msg = "effects: a run has its own. Leave them out, or give parameters instead of a run"
            raise ConfigError(msg)
        _check_wavelength(model, scene)
        drawn = _of_run(model, scene)
    else:
        whole = _on_top(effects, scene)
        check_energy(model.as_array(), whole)
        drawn = _of_parameters(model, whole, scene, rtol)
    return compute_scene(drawn, scene)


def compute_scene(drawn: DrawnModel, scene: Scene) -> SceneValues:
    """What a scene asks for, from parameter sets; its angles are checked before."""
    grids = _over_directions(drawn, scene) if scene.theta_i_deg else (None,) * 4
    brdf, stokes, dolp, aolp = grids
    return SceneValues(
        scene=scene, quantiles=QUANTILES if len(drawn.x) > 1 else (0.5,), brdf=brdf,
        dhr=_dhr(drawn, scene) if scene.dhr_theta_i_deg else None, stokes=stokes, dolp=dolp,
        aolp_deg=aolp, wavelength_um=drawn.wavelength_um, source=drawn.source,
    )  # fmt: skip


def _check_angles(scene: Scene) -> None:
    checked_angles("theta_i_deg", scene.theta_i_deg, 0.0, MAX_THETA_I_DEG)
    checked_angles("theta_r_deg", scene.theta_r_deg, -90.0, 90.0)
    checked_angles("phi_r_deg", scene.phi_r_deg, -360.0, 360.0)
    checked_angles("dhr_theta_i_deg", scene.dhr_theta_i_deg, 0.0, MAX_THETA_I_DEG)


def _check_wavelength(analysis: Analysis, scene: Scene) -> None:
    of_run = float(analysis.summary["wavelength_um"])
    for asked in scene.wavelength_um:
        if not same_wavelength(asked, of_run):
            msg = (
                f"wavelength_um = {asked:g} is not that of the run, {of_run:g}: parameters belong "
                "to one wavelength. Give a run at this wavelength, or leave the key out"
            )
            raise ConfigError(msg)


def same_wavelength(a: float, b: float) -> bool:
    """Two texts of one wavelength [um]."""
    return isclose(a, b, rel_tol=1e-6)


def _on_top(effects: Effects | None, scene: Scene) -> Effects:
    """Effects with those of the scene on top."""
    for name in scene.effects:
        if name in INSTRUMENT_PARAMETERS and not scene.instrument:
            msg = f"effects.{name} is one of the instrument: give instrument = true, or leave it"
            raise ConfigError(msg)
    return with_values(effects or Effects(), scene.effects, prefix="effects.")


def _of_parameters(
    parameters: Parameters, effects: Effects, scene: Scene, rtol: float
) -> DrawnModel:  # fmt: skip
    added = {name: value for name, value in asdict(effects).items() if name in FIELDS}
    added = {name: value for name, value in added.items() if value != getattr(NULL, name)}
    text = {name: f"{getattr(parameters, name):.10g}" for name in DOMAIN}
    shape = {"line_shape": effects.line_shape, "fresnel_at": effects.fresnel_at}
    x = np.concatenate([parameters.as_array(), [float(v) for v in added.values()]])[None, :]
    found = DrawnModel(
        x, (*DOMAIN, *added), effects.line_shape, effects.fresnel_at, digits_of(rtol), source={}
    )
    found = found if scene.instrument else found.without(INSTRUMENT_PARAMETERS)
    text |= {name: f"{added[name]:.10g}" for name in found.names if name in added}
    text |= {name: word for name, word in shape.items() if word != getattr(Effects(), name)}
    source = {"parameters": ", ".join(f"{k} = {v}" for k, v in text.items())}
    return replace(found, source=source, wavelength_um=next(iter(scene.wavelength_um), None))


def _of_run(analysis: Analysis, scene: Scene) -> DrawnModel:
    """Draws of the posterior, the same that `predict` takes where their number is the same."""
    summary = analysis.summary
    names = (*DOMAIN, *(name for name in FIELDS if name in summary["parameters"]))
    x, _ = drawn_sets(analysis, names, scene.n_draws)
    config = summary["config"]
    source = {
        "sample": str(summary["sample"]),
        "model": str(summary["model"]),
        "verdict": str(summary["verdict"]),
        "seed": str(summary["seed"]),
        "bands": f"5 %, 50 % and 95 % of {scene.n_draws} draws of the posterior",
    }
    judged = summary.get("applicability") or {}
    if judged.get("verdict", "applies") != "applies" or judged.get("caveats"):
        source["applicability"] = str(judged["statement"])
    found = DrawnModel(
        x, names, config["line_shape"], config["fresnel_at"],
        digits_of(ACCURACIES[config["accuracy"]].rtol), source, float(summary["wavelength_um"]),
    )  # fmt: skip
    return found if scene.instrument else found.without(INSTRUMENT_PARAMETERS)


def _quantiles(values: Array) -> Array:
    """Quantiles over the first axis as the last one; for one parameter set its values."""
    if len(values) == 1:
        return np.asarray(values[0][..., None])
    return np.moveaxis(np.quantile(values, QUANTILES, axis=0), 0, -1)


def _dhr(model: DrawnModel, scene: Scene) -> Array:
    words, angles = scene.polarizations, np.deg2rad(scene.dhr_theta_i_deg)
    geometry = prepare_geometry(
        theta_i=_NONE, theta_r=_NONE, phi_r=_NONE, polarization=_NO_WORDS,
        dhr_theta_i=np.tile(angles, len(words)), dhr_polarization=np.repeat(words, angles.size),
    )  # fmt: skip
    values = model.evaluate(geometry)[1]
    return _quantiles(values.reshape(len(values), len(words), angles.size))


@dataclass(frozen=True, eq=False)
class _Directions:
    """The distinct directions of a grid [deg], and which of them each point of the grid is.

    In the image of a mirrored direction S2 has the other sign.
    """

    theta_r: Array
    phi_r: Array
    which: Index
    mirrored: NDArray[np.bool_]


def _distinct(scene: Scene) -> _Directions:
    """Fold the grid by the mirror plane: theta_r >= 0 and phi_r in (0, 180), or phi_r = 0."""
    theta, phi = (a.ravel() for a in np.meshgrid(scene.theta_r_deg, scene.phi_r_deg, indexing="ij"))
    phi = np.mod(np.where(theta < 0.0, phi + 180.0, phi), 360.0)
    theta = np.abs(theta)
    mirrored = phi > 180.0
    phi = np.where(mirrored, 360.0 - phi, phi)
    behind = phi == 180.0
    folded = np.stack([np.where(behind, -theta, theta), np.where(behind, 0.0, phi)], axis=1) + 0.0
    distinct, which = np.unique(folded, axis=0, return_inverse=True)
    return _Directions(distinct[:, 0], distinct[:, 1], which.ravel(), mirrored)


def _over_directions(model: DrawnModel, scene: Scene) -> tuple[Array | None, ...]:
    """BRDF, Stokes components, degree and angle of linear polarisation on the grid of the scene."""
    grid = _distinct(scene)
    found = [_at_incidence(model, scene, theta_i, grid) for theta_i in scene.theta_i_deg]
    n = len(QUANTILES) if len(model.x) > 1 else 1
    shape = (len(found), len(scene.theta_r_deg), len(scene.phi_r_deg), n)
    whole = np.stack([values[:, grid.which] for values in found], axis=1)
    n_words = len(scene.polarizations)
    brdf = whole[:n_words].reshape(n_words, *shape)
    if not scene.stokes_incident:
        return brdf, None, None, None
    s2, dolp, aolp = whole[n_words + 2], whole[n_words + 3], whole[n_words + 4]
    s2[:, grid.mirrored] = -s2[:, grid.mirrored, ::-1]
    aolp[:, grid.mirrored] = mirrored(aolp[:, grid.mirrored], n // 2)
    stokes = whole[n_words : n_words + 3].reshape(3, *shape)
    return brdf, stokes, dolp.reshape(shape), aolp.reshape(shape)


def _at_incidence(model: DrawnModel, scene: Scene, theta_i: float, grid: _Directions) -> Array:
    """BRDF of each polarisation, S0, S1, S2, DoLP, AoLP: (n, n_distinct, n_quantile)."""
    parts = [
        np.concatenate(list(_block(model, scene, theta_i, grid, rows)))
        for rows in _blocks(len(model.x) * 3, grid.theta_r.size)
    ]
    return np.concatenate(parts, axis=1)


def _blocks(width: int, size: int) -> Iterator[slice]:
    step = max(1, _MOST_VALUES // width)
    for first in range(0, size, step):
        yield slice(first, min(first + step, size))


def _block(
    model: DrawnModel, scene: Scene, theta_i: float, grid: _Directions, rows: slice
) -> Iterator[Array]:
    """Quantiles of BRDF and, where asked for, Stokes components, DoLP and AoLP; as they are asked.

    Each of shape (n, n_rows, n_quantile).
    """
    theta_r, phi_r = grid.theta_r[rows], grid.phi_r[rows]
    asked = scene.polarizations
    words = asked if not scene.stokes_incident else tuple(dict.fromkeys((*asked, "s", "p")))
    values = _brdf(model, theta_i, theta_r, phi_r, words)
    yield _quantiles(values[:, : len(asked)])
    if scene.stokes_incident:
        f_s, f_p = values[:, words.index("s")], values[:, words.index("p")]
        stokes = _stokes(model, scene, np.deg2rad([theta_i]), theta_r, phi_r, (f_s, f_p))
        yield _quantiles(stokes)
        lit = np.where(stokes[:, :1] > 0.0, stokes[:, :1], np.nan)
        share = np.hypot(stokes[:, 1:2], stokes[:, 2:3]) / lit
        yield _quantiles(share)
        angle = np.rad2deg(0.5 * np.arctan2(stokes[:, 2:3], stokes[:, 1:2]))
        angle[~(share > _UNPOLARISED)] = np.nan
        yield axial_quantiles(angle, QUANTILES)


def _brdf(
    model: DrawnModel, theta_i: float, theta_r: Array, phi_r: Array, words: tuple[str, ...]
) -> Array:
    """BRDF [sr^-1], shape (n_sets, n_words, n_directions); angles [deg]."""
    n = theta_r.size
    geometry = prepare_geometry(
        theta_i=np.full(n * len(words), np.deg2rad(theta_i)),
        theta_r=np.tile(np.deg2rad(theta_r), len(words)),
        phi_r=np.tile(np.deg2rad(phi_r), len(words)),
        polarization=np.repeat(words, n), dhr_theta_i=_NONE, dhr_polarization=_NO_WORDS,
    )  # fmt: skip
    values = model.evaluate(geometry)[0]
    return values.reshape(len(values), len(words), n)


def _stokes(
    model: DrawnModel, scene: Scene, theta_i: Array, theta_r: Array, phi_r: Array,
    total: tuple[Array, Array],
) -> Array:  # fmt: skip
    """S0, S1, S2 [sr^-1] of each draw, shape (n_sets, 3, n_directions)."""
    incident, angles = scene.stokes_incident, np.deg2rad(theta_r)
    frames = prepare_frames(np.broadcast_to(theta_i, angles.shape), angles, np.deg2rad(phi_r))
    of_facets = total
    if set(DIFFUSE) & set(model.names):
        bare = _brdf(model.without(DIFFUSE), np.rad2deg(theta_i[0]), theta_r, phi_r, S_AND_P)
        of_facets = bare[:, 0], bare[:, 1]
    below_s, below_p = (a - b for a, b in zip(total, of_facets, strict=True))
    share_s, share_p = STATES[incident].weights
    below = share_s * below_s + share_p * below_p
    found = np.empty((len(model.x), 3, angles.size))
    bulk = model.names.index("bulk") if "bulk" in model.names else None
    for i, x in enumerate(model.x):
        f_s, f_p = of_facets[0][i], of_facets[1][i]
        found[i] = of_surface(f_s, f_p, frames, x[0], x[1], incident=incident, phase=scene.phase)
        if bulk is not None:
            surf = surface(x[0], x[1], x[2], x[3])
            found[i, 1] += bulk_s1(float(theta_i[0]), angles, x[bulk], surf, incident=incident)
    found[:, 0] += np.maximum(below, 0.0)
    found[:, 1:] *= 1.0 - scene.depolarisation
    return found
