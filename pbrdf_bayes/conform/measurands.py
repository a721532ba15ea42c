"""Draws of what the limits of a specification are on.

What is limited is the measurand, not a new reading: noise, gains of scans and effects of the
instrument are not in it. For a parameter it is the parameter. For a BRDF it is the BRDF of the
sample, that of the model times exp(delta): delta is the discrepancy of the likelihood, a Matérn
process along theta_r of amplitude tau and length ell_deg, one path for each angle of incidence,
plane and polarisation, drawn along with the parameters. Where a geometry was measured the path is
drawn given its readings; elsewhere from its law, as it is where the likelihood is filtered (floor,
Student's t), which only widens it. Unpolarised light is half s and half p: where it was not
measured itself, its BRDF is the mean of those of s and p, each with its own path; in a run that has
neither s nor p its discrepancy is its own. The DHR has no discrepancy of its own. All limits share
the same draws and paths.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import repeat
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.config import ACCURACIES
from pbrdf_bayes.conform.conformity import ESS_FINEST
from pbrdf_bayes.effects_table import INSTRUMENT_PARAMETERS
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.discrepancy import (
    Process,
    draw_paths_given,
    draw_prior_discrepancy,
)
from pbrdf_bayes.measurement import name_half_plane
from pbrdf_bayes.model.four_parameter import DOMAIN, digits_of
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scene import FIELDS
from pbrdf_bayes.results import draws_of_run
from pbrdf_bayes.scene.prediction import DrawnModel
from pbrdf_bayes.specification import Limit

Array = NDArray[np.float64]
Key = tuple[float, float, str]
"""Angle of incidence [deg], azimuth of the plane [deg], polarisation."""

_DRAWS = 4000
_MOST_VALUES = 20_000_000
"""Draws of all points together, beyond which no more than `_DRAWS` draws are kept."""
_NONE, _NO_WORDS = np.zeros(0), np.zeros(0, np.str_)


@dataclass(frozen=True, eq=False)
class Sample:
    """Draws of a run, chain by chain: flat they have shape (n_chains * n_draws, n_names)."""

    analysis: Analysis
    posterior: Posterior
    x: Array
    shape: tuple[int, int]

    @property
    def ess_least(self) -> float:
        """Smallest effective sample size of a parameter, at most the number of draws kept."""
        return min(_ess_of_run(self.analysis), float(len(self.x)))

    def ess_finest(self, n_points: int) -> float:
        """What it would be in a fit of the highest accuracy, for as many points."""
        if self.analysis.summary["config"]["accuracy"] == "reference":
            return self.ess_least
        return max(self.ess_least, min(ESS_FINEST, _draws_for(n_points)))


def _draws_for(n_points: int) -> float:
    return max(_MOST_VALUES / n_points, _DRAWS)


def _ess_of_run(analysis: Analysis) -> float:
    rows = analysis.summary["parameters"].values()
    return min(float(min(p["ess_bulk"], p["ess_tail"])) for p in rows if p["kind"] != "fixed")


def sample_of(analysis: Analysis, *, n_points: int = 1) -> Sample:
    """Draws of a run, evenly thinned where there are more than tell apart.

    Twice as many are kept as there are effective ones; fewer, at least 4000, where limits with
    ``n_points`` points would take too much memory.
    """
    posterior = analysis.posterior()
    cube = draws_of_run(analysis, posterior.parameter_names)
    wanted = min(max(2.0 * _ess_of_run(analysis), _DRAWS), _draws_for(n_points))
    step = ceil(cube.shape[0] * cube.shape[1] / wanted)
    kept = cube[:, ::step]
    return Sample(analysis, posterior, kept.reshape(-1, cube.shape[-1]), kept.shape[:2])


def draw_measurands(
    sample: Sample, limits: Iterable[Limit], *, with_paths: bool = True
) -> dict[str, Array]:
    """Draws of what each limit is on, shape (n_draws, n_points), by the name of the limit.

    The model alone, without discrepancy, where ``with_paths`` is false.
    """
    limits = list(limits)
    rng = np.random.default_rng([int(sample.analysis.summary["seed"]), 8])
    drawn, measured = _model(sample), _measured(sample)
    asked: dict[Key, set[float]] = {}
    for limit in limits:
        for keys, theta_r in _points(limit, measured):
            for key in keys:
                asked.setdefault(key, set()).add(theta_r)
    angles = {key: np.array(sorted(v)) for key, v in asked.items()}
    brdf = _draw_brdf(sample, drawn, angles, rng if with_paths else None)
    found = {}
    for limit in limits:
        if limit.quantity == "parameter":
            found[limit.name] = _parameter(sample, limit.parameter)
        elif limit.quantity == "dhr":
            found[limit.name] = _dhr(drawn, limit)
        else:
            found[limit.name] = _of_brdf(limit, measured, brdf)
    return found


def _parameter(sample: Sample, name: str) -> Array:
    names = sample.posterior.parameter_names
    if name not in names:  # a reservation says so
        return np.full((len(sample.x), 1), np.nan)
    return sample.x[:, [names.index(name)]]


def _model(sample: Sample) -> DrawnModel:
    """The model without what the instrument does."""
    config, names = sample.posterior.config, sample.posterior.parameter_names
    kept = (*DOMAIN, *(name for name in FIELDS if name in names))
    x = np.ascontiguousarray(sample.x[:, [names.index(name) for name in kept]])
    digits = digits_of(ACCURACIES[config.accuracy].rtol)
    found = DrawnModel(x, kept, config.line_shape, config.fresnel_at, digits, {})
    return found.without(INSTRUMENT_PARAMETERS)


def _words(limit: Limit) -> tuple[str, ...]:
    """Polarisations whose BRDF a limit needs."""
    if limit.quantity == "brdf_ratio":
        return "s", "p"
    return (limit.polarization,) if limit.quantity == "brdf" else ()


def _measured(sample: Sample) -> set[Key]:
    scans = sample.posterior.measurement.scans
    return {(scan.theta_i_deg, scan.phi_r_deg, scan.polarization) for scan in scans}


def _points(limit: Limit, measured: Set[Key]) -> list[tuple[tuple[Key, ...], float]]:
    """Groups whose mean the BRDF is, and signed scattering angle, of the points of a limit."""
    theta_r, phi_r = name_half_plane(
        np.array(limit.theta_r_deg), np.full(len(limit.theta_r_deg), limit.phi_r_deg)
    )
    return [
        (_sources(measured, (float(theta_i), float(phi), q)), float(theta))
        for q in _words(limit)
        for theta_i in limit.theta_i_deg
        for theta, phi in zip(theta_r, phi_r, strict=True)
    ]


def _sources(measured: Set[Key], key: Key) -> tuple[Key, ...]:
    """The group itself, or those of s and p where they tell what unpolarised light was not seen."""
    theta_i, phi, q = key
    if q != "u" or key in measured or all(word == "u" for *_, word in measured):
        return (key,)
    return (theta_i, phi, "s"), (theta_i, phi, "p")


def _draw_brdf(
    sample: Sample, drawn: DrawnModel, asked: Mapping[Key, Array], rng: np.random.Generator | None
) -> dict[Key, tuple[Array, Array]]:
    """Scattering angles and draws of the BRDF, by group; of the model alone for None."""
    if not asked:
        return {}
    keys = list(asked)
    sizes = [asked[key].size for key in keys]
    theta_i, phi_r = (np.repeat([key[i] for key in keys], sizes) for i in (0, 1))
    theta_r = np.concatenate([asked[key] for key in keys])
    geometry = prepare_geometry(
        theta_i=np.deg2rad(theta_i), theta_r=np.deg2rad(theta_r), phi_r=np.deg2rad(phi_r),
        polarization=np.repeat([key[2] for key in keys], sizes),
        dhr_theta_i=_NONE, dhr_polarization=_NO_WORDS,
    )  # fmt: skip
    values = drawn.evaluate(geometry)[0]
    if rng is not None and "tau" in sample.posterior.parameter_names:
        values = values * np.exp(draw_paths(sample.posterior, sample.x, asked, rng))
    starts = np.cumsum([0, *sizes])
    return {
        key: (asked[key], values[:, a:b])
        for key, a, b in zip(keys, starts[:-1], starts[1:], strict=True)
    }


def draw_paths(
    posterior: Posterior, x: Array, asked: Mapping[Key, Array], rng: np.random.Generator
) -> Array:
    """One path of the discrepancy for each draw, at the angles of groups [deg].

    Parameters
    ----------
    posterior : Posterior
        With a correlated discrepancy.
    x : ndarray, shape (n_draws, n_par)
        Physical units.
    asked : mapping of tuple to ndarray
        Increasing scattering angles by angle of incidence, azimuth and polarisation.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n_draws, n_points)
        In ln BRDF, group after group.
    """
    laws = [_law(posterior, row) for row in x]
    return np.concatenate(
        [_paths_of_group(posterior, x, laws, key, theta_r, rng) for key, theta_r in asked.items()],
        axis=1,
    )


def _paths_of_group(
    posterior: Posterior, x: Array, laws: Sequence[Process], key: Key, theta_r: Array,
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Given the readings of a geometry that was measured, otherwise from the law alone."""
    seen = _readings_of(posterior, x, key)
    if seen is not None:
        return draw_paths_given(laws, repeat(rng), wanted_deg=theta_r, **seen)
    group = np.zeros(theta_r.size, dtype=np.int64)
    return np.stack(
        [draw_prior_discrepancy(law, rng, theta_r_deg=theta_r, group=group) for law in laws]
    )


def _law(posterior: Posterior, row: Array) -> Process:
    names = posterior.parameter_names
    return Process(
        tau=float(row[names.index("tau")]), ell=float(row[names.index("ell_deg")]),
        u_cal=float(np.sqrt(posterior.rows.u_cal2)),
        rough=posterior.config.discrepancy == "matern-1/2",
    )  # fmt: skip


def _readings_of(posterior: Posterior, x: Array, key: Key) -> dict[str, Any] | None:
    """Rows of a measured group, their residuals and variances by draw; None where not used."""
    m, rows, law = posterior.measurement, posterior.rows, posterior.discrepancy
    mine = [
        (number, scan) for number, scan in enumerate(m.scans)
        if (scan.theta_i_deg, scan.phi_r_deg, scan.polarization) == key
    ]  # fmt: skip
    if not mine or law is None or posterior.filtered is not None or rows.floor2 > 0.0:
        return None
    at = np.concatenate([np.arange(len(m.brdf))[scan.rows] for _, scan in mine])
    brdf = m.brdf
    geometry = prepare_geometry(
        theta_i=np.deg2rad(brdf.theta_i_deg[at]), theta_r=np.deg2rad(brdf.theta_r_deg[at]),
        phi_r=np.deg2rad(brdf.phi_r_deg[at]), polarization=brdf.polarization[at],
        dhr_theta_i=_NONE, dhr_polarization=_NO_WORDS,
    )  # fmt: skip
    return {
        "read_deg": brdf.theta_r_deg[at],
        "scan": np.repeat([number for number, _ in mine], [len(scan) for _, scan in mine]),
        "residual": rows.y[at] - np.log(posterior.predict(x, geometry)[0]),
        "variance": x[:, [rows.noise_column[mine[0][0]]]] ** 2 + rows.u2[at],
    }


def _of_brdf(limit: Limit, measured: Set[Key], brdf: Mapping[Key, tuple[Array, Array]]) -> Array:
    """Draws at the points of a limit on BRDF or on the ratio of s to p."""
    columns = [
        np.mean([_at(brdf[key], theta_r) for key in keys], axis=0)
        for keys, theta_r in _points(limit, measured)
    ]
    found = np.stack(columns, axis=1)
    if limit.quantity == "brdf_ratio":
        found = found[:, : limit.n_points] / found[:, limit.n_points :]
    return found


def _at(group: tuple[Array, Array], theta_r: float) -> Array:
    angles, values = group
    return np.asarray(values[:, np.searchsorted(angles, theta_r)])


def _dhr(drawn: DrawnModel, limit: Limit) -> Array:
    angles = np.deg2rad(limit.theta_i_deg)
    geometry = prepare_geometry(
        theta_i=_NONE, theta_r=_NONE, phi_r=_NONE, polarization=_NO_WORDS, dhr_theta_i=angles,
        dhr_polarization=np.repeat([limit.polarization], angles.size),
    )  # fmt: skip
    return drawn.evaluate(geometry)[1]
