"""What is exported: the model of a run or of given parameters, without its instrument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.effects_table import INSTRUMENT_PARAMETERS
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.export.records import Fitted
from pbrdf_bayes.model.effects import Effects, effects_of_fit, scene_and_columns
from pbrdf_bayes.model.four_parameter import DOMAIN, Parameters, brdf, dhr, digits_of
from pbrdf_bayes.physics.brdf import evaluate
from pbrdf_bayes.physics.geometry import Geometry, prepare_geometry
from pbrdf_bayes.physics.scattering import evaluate_with_effects
from pbrdf_bayes.results import N_BAND_DRAWS, drawn_sets

Array = NDArray[np.float64]
Evaluate = Callable[[Geometry], tuple[Array, Array]]

_RTOL = 1e-8
_MOST_VALUES = 4_000_000
"""Values of all draws held at a time."""
_DESCRIPTIONS = {
    "n": "real part of the effective refractive index n - ik",
    "k": "imaginary part of the effective refractive index n - ik",
    "sigma_n0": "grazing-absorption factor: DHR_q = sigma_n0 F_q",
    "rho0": "roughness: half width at half maximum of the lobe at normal incidence in direction "
    "cosine",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Source:
    """The model of one sample at one wavelength.

    Attributes
    ----------
    sample : str
    wavelength_um : float
    parameters : Parameters
        Given ones, or the medians of the posterior.
    effects : Effects
        Of the sample, in the same way.
    fitted : tuple of Fitted
    sets : callable
        BRDF (n_sets, n_brdf) and DHR (n_sets, n_dhr) of a geometry: one set where parameters are
        given, and draws of a posterior.
    of_run : bool
    without : tuple of str
        Effects of the instrument that the model had, and that are not in the values.
    """

    sample: str
    wavelength_um: float
    parameters: Parameters
    effects: Effects
    fitted: tuple[Fitted, ...]
    sets: Evaluate
    of_run: bool
    without: tuple[str, ...] = ()

    def at(self, theta_i: ArrayLike, theta_r: ArrayLike, phi_r: ArrayLike, q: str) -> Array:
        """BRDF [sr^-1] at ``parameters``; angles as in `pbrdf_bayes.brdf`."""
        return brdf(
            self.parameters, theta_i, theta_r, q, phi_r_deg=phi_r, effects=self.effects, rtol=_RTOL
        )

    def dhr_at(self, theta_i: ArrayLike, q: str) -> Array:
        """DHR [1] at ``parameters``; angles [deg]."""
        return dhr(self.parameters, theta_i, q, effects=self.effects)

    def values(
        self, theta_i: Array, theta_r: Array, phi_r: Array, q: str
    ) -> tuple[Array, Array | None]:
        """Median over the sets and, from a posterior, the standard deviation, shapes (n,).

        Angles [deg]; NaN in ``theta_r`` for DHR.
        """
        median, u = np.empty(theta_i.size), np.empty(theta_i.size)
        step = max(1, _MOST_VALUES // N_BAND_DRAWS) if self.of_run else theta_i.size
        hemispherical = bool(np.isnan(theta_r).all())
        for start in range(0, theta_i.size, step):
            rows = slice(start, start + step)
            sets = self.sets(_geometry(theta_i[rows], theta_r[rows], phi_r[rows], q))[hemispherical]
            median[rows] = np.median(sets, axis=0)
            u[rows] = np.std(sets, axis=0)
        return median, u if self.of_run else None


def _geometry(theta_i: Array, theta_r: Array, phi_r: Array, q: str) -> Geometry:
    none, words = np.zeros(0), np.full(theta_i.size, q)
    hemispherical = bool(np.isnan(theta_r).all())
    at = [none] * 3 if hemispherical else [np.deg2rad(x) for x in (theta_i, theta_r, phi_r)]
    return prepare_geometry(
        theta_i=at[0], theta_r=at[1], phi_r=at[2],
        polarization=words[:0] if hemispherical else words,
        dhr_theta_i=np.deg2rad(theta_i) if hemispherical else none,
        dhr_polarization=words if hemispherical else words[:0],
    )  # fmt: skip


def source_of_parameters(
    parameters: Parameters, effects: Effects | None, *, sample: str, wavelength_um: float
) -> Source:
    """The model at given parameters.

    Parameters
    ----------
    parameters : Parameters
    effects : Effects or None
        Those of the instrument are left out.
    sample : str
    wavelength_um : float
        [um].

    Returns
    -------
    Source
    """
    given = effects or Effects()
    without = tuple(n for n in INSTRUMENT_PARAMETERS if getattr(given, n) != getattr(Effects(), n))
    added = replace(given, **{name: getattr(Effects(), name) for name in without})
    x = parameters.as_array()

    def sets(geometry: Geometry) -> tuple[Array, Array]:
        if added.is_null:
            return evaluate(geometry, x[None, :], digits_of(_RTOL))
        return evaluate_with_effects(geometry, *scene_and_columns(added, x), digits_of(_RTOL))

    brdf(parameters, 0.0, 0.0, effects=added)  # refuses what reflects more than it receives
    return Source(
        sample=sample, wavelength_um=wavelength_um, parameters=parameters, effects=added,
        fitted=_fitted(parameters, added, {}), sets=sets, of_run=False, without=without,
    )  # fmt: skip


def source_of_run(run: Analysis) -> Source:
    """The model of a run, with the instrument of its posterior left out.

    Parameters
    ----------
    run : Analysis

    Returns
    -------
    Source
        Values are medians over draws of the posterior.
    """
    posterior = run.posterior()
    names = posterior.parameter_names
    picked, _ = drawn_sets(run, names, N_BAND_DRAWS)
    rows = run.summary["parameters"]
    without = tuple(name for name in INSTRUMENT_PARAMETERS if name in names)
    picked = picked.copy()
    for name in without:
        picked[:, names.index(name)] = getattr(Effects(), name)
    medians = {name: rows[name]["median"] for name in names}
    own = {n: v for n, v in medians.items() if n in Effects.__dataclass_fields__}
    choices = {
        "line_shape": run.summary.get("line_shape"),
        "fresnel_at": run.summary["config"].get("fresnel_at"),
    }
    kept = {n: v for n, v in (own | choices).items() if n not in without and v is not None}
    parameters, effects = Parameters(**{n: medians[n] for n in DOMAIN}), effects_of_fit(kept)
    return Source(
        sample=str(run.summary["sample"]), wavelength_um=float(run.summary["wavelength_um"]),
        parameters=parameters, effects=effects, sets=lambda g: posterior.predict(picked, g),
        fitted=_fitted(parameters, effects, {name: rows[name]["sd"] for name in names}),
        of_run=True, without=without,
    )  # fmt: skip


def _fitted(parameters: Parameters, effects: Effects, u: dict[str, float]) -> tuple[Fitted, ...]:
    """The four parameters, and what is added to them."""
    null = Effects()
    values = {name: getattr(parameters, name) for name in DOMAIN}
    values |= {
        name: getattr(effects, name)
        for name in Effects.__dataclass_fields__
        if getattr(effects, name) != getattr(null, name)
        and isinstance(getattr(effects, name), float)
    }
    return tuple(
        Fitted(
            name=name,
            description=_DESCRIPTIONS.get(name, f"effect {name}, see the documentation"),
            value=float(value),
            unit="1",
            u=u.get(name),
        )
        for name, value in values.items()
    )


def sources_of_runs(folders: Sequence[Path], wavelength_um: float | None) -> tuple[Source, ...]:
    """The model of each run, in the order of their wavelengths.

    Parameters
    ----------
    folders : sequence of Path
        Finished runs of one sample, each of another wavelength.
    wavelength_um : float or None
        Take the run of this wavelength alone [um].

    Returns
    -------
    tuple of Source

    Raises
    ------
    ConfigError
        Runs of different samples or of one wavelength, or a wavelength that no run has.
    RunFolderError
        A folder is not a finished run.
    """
    runs = [load_analysis(folder) for folder in folders]
    waves = [float(run.summary["wavelength_um"]) for run in runs]
    samples = dict.fromkeys(str(run.summary["sample"]) for run in runs)
    there = ", ".join(f"{wave:g}" for wave in waves)
    if len(samples) > 1:
        msg = (
            f"the runs are of different samples ({', '.join(map(repr, samples))}). "
            "Give runs of one sample, each of another wavelength"
        )
        raise ConfigError(msg)
    if len({round(wave, 6) for wave in waves}) < len(waves):
        msg = f"two runs have the same wavelength ({there} um). Give one run of each wavelength"
        raise ConfigError(msg)
    order = np.argsort(waves)
    if wavelength_um is not None:
        order = np.array([i for i in order if abs(waves[i] - wavelength_um) < 1e-6], dtype=np.intp)
    if not order.size:
        msg = f"wavelength_um = {wavelength_um:g}: no run has this wavelength, they have {there} um"
        raise ConfigError(msg)
    return tuple(source_of_run(runs[i]) for i in order.tolist())
