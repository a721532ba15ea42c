"""What a scene asks for, and what was computed for it: two frozen records.

`Scene` is the request of a user, in degrees. The kernels have a record of the same name of their
own, `pbrdf_bayes.physics.scene.Scene`: which effects are switched on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from math import floor
from typing import TYPE_CHECKING, Any

from pbrdf_bayes.config import did_you_mean, is_finite, show_value
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.quantities import POLARIZATIONS, S_AND_P

if TYPE_CHECKING:  # the help of the command line comes from here and loads nothing heavy
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

PHASES = ("fresnel", "paper")
MOST_DIRECTIONS = 1_000_000
"""Directions times polarisations of a scene, at most."""
DRAWS = (10, 4000)
WAVELENGTHS_UM = (0.01, 1e4)
SCENE_HELP = """\
a scene file (angles in degrees: a list, or "LO:HI:STEP"; what is not asked for is not computed):
  theta_i_deg = [20, 60]
  theta_r_deg = "0:85:2.5"
  phi_r_deg = "0:180:5"             # without it in plane, theta_r_deg with sign
  polarizations = ["s", "p", "u"]
  dhr_theta_i_deg = "0:85:5"
  wavelength_um = [0.65, 3.39]      # a run of each; left out: all runs given
  stokes_incident = "u"             # light whose Stokes components are wanted
  depolarisation = 0.1              # share of it that is depolarised
  instrument = false                # with the effects of the instrument
  n_draws = 400                     # of the posterior, for the bands
  [effects]                         # with --params only: line_shape, lambert, ...

written to --out DIR: scene.csv, scene.nc, scene.html and its pictures as SVG; the CSV alone goes to
standard output with --out -
"""
"""What a scene file looks like, for the help of the command line."""
ANGLES = ("theta_i_deg", "theta_r_deg", "phi_r_deg", "dhr_theta_i_deg")


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is wanted of a sample; what is not asked for is not computed.

    Every field is a top-level key of the TOML file.

    Attributes
    ----------
    theta_i_deg : tuple of float
        Angles of incidence of the BRDF, [0, 89.95] [deg]; empty for none.
    theta_r_deg : tuple of float
        Scattering angles, [-90, 90] [deg], increasing; + is the forward (specular) side.
    phi_r_deg : tuple of float
        Azimuths of the scattering directions, [-360, 360] [deg], increasing. (0,) is a scan in the
        plane of incidence. The BRDF is its own mirror image in that plane, and half is computed.
    polarizations : tuple of {"s", "p", "u"}
        Of the illumination, for BRDF and DHR; ``u`` is the mean of s and p.
    dhr_theta_i_deg : tuple of float
        Angles of incidence of the DHR, [0, 89.95] [deg]; empty for no DHR.
    stokes_incident : {"", "s", "p", "u"}
        Illumination of which the scattered light has its Stokes components computed; "" for none.
    phase : {"fresnel", "paper"}
        Between the two polarisations of a facet, as in `pbrdf_bayes.mueller`.
    depolarisation : float
        Share of the scattered light that is depolarised, in [0, 1] [1]; 0 does nothing.
    effects : mapping
        Fields of `pbrdf_bayes.Effects` by name, beside given parameters; a run has its own.
    instrument : bool
        With the effects of the instrument: what it would read, and not what the sample does.
    wavelength_um : tuple of float
        Of the scene [um], increasing; empty for that of the run. Parameters belong to one
        wavelength: a scene at several takes a run of each, see `predict_spectral_scene`.
    n_draws : int
        Posterior draws that the bands of a run are made of, [10, 4000].

    Raises
    ------
    ConfigError
        When a value is not allowed, or nothing is asked for.

    Examples
    --------
    >>> scene = Scene(theta_i_deg=(20.0,), theta_r_deg=(-40.0, 0.0, 20.0), polarizations=("u",))
    >>> scene.in_plane, scene.n_directions
    (True, 3)
    """

    theta_i_deg: tuple[float, ...] = ()
    theta_r_deg: tuple[float, ...] = ()
    phi_r_deg: tuple[float, ...] = (0.0,)
    polarizations: tuple[str, ...] = S_AND_P
    dhr_theta_i_deg: tuple[float, ...] = ()
    stokes_incident: str = ""
    phase: str = "fresnel"
    depolarisation: float = 0.0
    effects: Mapping[str, Any] = field(default_factory=dict)
    instrument: bool = False
    wavelength_um: tuple[float, ...] = ()
    n_draws: int = 400

    def __post_init__(self) -> None:
        for key in ANGLES:
            _increasing(key, getattr(self, key))
        _words("polarizations", self.polarizations, POLARIZATIONS)
        _words("stokes_incident", (self.stokes_incident,), ("", *POLARIZATIONS))
        _words("phase", (self.phase,), PHASES)
        _number("depolarisation", self.depolarisation, 0.0, 1.0)
        _number("n_draws", self.n_draws, *DRAWS, whole=True)
        _increasing("wavelength_um", self.wavelength_um, unit="micrometres", each="wavelengths")
        for value in self.wavelength_um:
            _number("wavelength_um", value, *WAVELENGTHS_UM)
        _kind("instrument", self.instrument, bool, "true or false")
        _kind("effects", self.effects, Mapping, "a table, e.g. [effects]")
        self._refuse_half_a_request()

    def _refuse_half_a_request(self) -> None:
        if bool(self.theta_i_deg) != bool(self.theta_r_deg):
            missing = "theta_r_deg" if self.theta_i_deg else "theta_i_deg"
            msg = f"{missing} is missing: a BRDF needs both theta_i_deg and theta_r_deg"
            raise ConfigError(msg)
        if not (self.theta_i_deg or self.dhr_theta_i_deg):
            msg = "nothing is asked for: give theta_i_deg and theta_r_deg, or dhr_theta_i_deg"
            raise ConfigError(msg)
        if not self.phi_r_deg:
            msg = (
                "phi_r_deg = [] is not allowed: give azimuths, or leave it out for a scan in plane"
            )
            raise ConfigError(msg)
        if self.stokes_incident and not self.theta_i_deg:
            msg = "stokes_incident needs directions: give theta_i_deg and theta_r_deg"
            raise ConfigError(msg)
        if self.depolarisation and not self.stokes_incident:
            msg = "depolarisation acts on Stokes components only: give stokes_incident, or leave it"
            raise ConfigError(msg)
        if self.stokes_incident and self.instrument:
            msg = (
                "instrument = true with stokes_incident is not available: Stokes components are "
                "those of the sample. Leave one of the two out"
            )
            raise ConfigError(msg)
        size = self.n_directions * len(self.polarizations)
        if size > MOST_DIRECTIONS:
            msg = (
                f"theta_i_deg, theta_r_deg, phi_r_deg and polarizations make {size} values; "
                f"allowed are {MOST_DIRECTIONS}. Take wider steps, or several scenes"
            )
            raise ConfigError(msg)

    @property
    def in_plane(self) -> bool:
        """All directions lie in the plane of incidence."""
        return all(phi % 180.0 == 0.0 for phi in self.phi_r_deg)

    @property
    def n_directions(self) -> int:
        """Number of pairs of incidence and scattering direction."""
        return len(self.theta_i_deg) * len(self.theta_r_deg) * len(self.phi_r_deg)


@dataclass(frozen=True, eq=False)
class SceneValues:
    """What was computed for a scene. The last axis of every array is the quantile.

    Attributes
    ----------
    scene : Scene
    quantiles : tuple of float
        0.05, 0.5, 0.95 of the posterior; 0.5 alone where parameters were given.
    brdf : ndarray or None
        Shape (n_polarization, n_theta_i, n_theta_r, n_phi_r, n_quantile) [sr^-1].
    dhr : ndarray or None
        Shape (n_polarization, n_dhr_theta_i, n_quantile) [1].
    stokes : ndarray or None
        S0, S1, S2 in the frame of the meridian plane phi_r, see `pbrdf_bayes.stokes`, shape
        (3, n_theta_i, n_theta_r, n_phi_r, n_quantile), per unit irradiance [sr^-1].
    dolp : ndarray or None
        Degree of linear polarisation, shape (n_theta_i, n_theta_r, n_phi_r, n_quantile) [1].
    aolp_deg : ndarray or None
        Angle of linear polarisation, of the same shape, see
        `pbrdf_bayes.angle_of_linear_polarization_deg` [deg]: modulo 180, 0 along s, medians in
        (-90, 90]. The band is that of the deviations from the mean axis of the draws, its ends on
        their own sides of the median. NaN where the degree is 0.
    wavelength_um : float or None
        Of the run, or as the scene has it beside given parameters [um].
    source : mapping
        Where the model comes from, as text by name.
    """

    scene: Scene
    quantiles: tuple[float, ...]
    brdf: Array | None
    dhr: Array | None
    stokes: Array | None
    dolp: Array | None
    aolp_deg: Array | None
    wavelength_um: float | None
    source: Mapping[str, str]

    @property
    def at_median(self) -> int:
        """Index of the median on the axis of quantiles."""
        return self.quantiles.index(0.5)


def spaced(text: str, *, most: int) -> list[float]:
    """Angles of ``LO:HI:STEP``, both ends included where the step meets them.

    Raises
    ------
    ValueError
        Where the text is no such thing, or makes more angles than ``most``.

    Examples
    --------
    >>> spaced("-10:10:10", most=100)
    [-10.0, 0.0, 10.0]
    """
    low, high, step = (float(part) for part in text.split(":"))
    if not (step > 0.0 and low <= high and (high - low) / step < most):
        raise ValueError(text)
    count = floor((high - low) / step + 1e-9)
    return [round(min(low + step * i, high), 10) for i in range(count + 1)]


def check_scene_keys(given: Iterable[str]) -> None:
    """Refuse keys that `Scene` does not have, with the nearest one it has.

    Raises
    ------
    ConfigError
    """
    known = [f.name for f in fields(Scene)]
    for key in given:
        if key not in known:
            msg = f"unknown key {key!r}.{did_you_mean(key, known)} Known: {', '.join(known)}"
            raise ConfigError(msg)


def _kind(key: str, value: Any, kind: type, words: str) -> None:
    if not isinstance(value, kind):
        msg = f"{key} = {show_value(value)} is not allowed: give {words}"
        raise ConfigError(msg)


def _increasing(key: str, values: Any, *, unit: str = "degrees", each: str = "angles") -> None:
    _kind(key, values, tuple, "a list (in Python a tuple)")
    for value in values:
        if not is_finite(value):
            msg = f"{key}: {show_value(value)} is not a finite number: give {unit}"
            raise ConfigError(msg)
    for a, b in pairwise(values):
        if a >= b:
            msg = f"{key}: {b!r} follows {a!r}. Give increasing {each}, each once"
            raise ConfigError(msg)


def _words(key: str, values: Any, allowed: tuple[str, ...]) -> None:
    if not isinstance(values, tuple) or not values:
        listed = ", ".join(map(repr, allowed))
        msg = f"{key} = {show_value(values)} is not allowed: give a list of {listed}"
        raise ConfigError(msg)
    for value in values:
        if value not in allowed:
            hint = did_you_mean(str(value), allowed)
            listed = ", ".join(map(repr, allowed))
            msg = f"{key}: {show_value(value)} is not known.{hint} Allowed: {listed}"
            raise ConfigError(msg)
        if values.count(value) > 1:
            msg = f"{key}: {show_value(value)} is given twice. Give it once"
            raise ConfigError(msg)


def _number(key: str, value: Any, low: float, high: float, *, whole: bool = False) -> None:
    kinds = int if whole else (int, float)
    if not isinstance(value, kinds) or isinstance(value, bool) or not low <= value <= high:
        kind = "a whole number" if whole else "a number"
        msg = f"{key} = {show_value(value)} is not allowed: give {kind} in [{low:g}, {high:g}]"
        raise ConfigError(msg)
