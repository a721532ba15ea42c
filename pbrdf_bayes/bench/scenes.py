"""What scenes cost: less where less is asked for."""

from __future__ import annotations

from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from pbrdf_bayes.bench.speed import RTOL_DIGITS, paper_posterior, parameter_sets
from pbrdf_bayes.bench.timing import time_in_turns
from pbrdf_bayes.model.four_parameter import DOMAIN
from pbrdf_bayes.model.simulate import GREEN_PAINT
from pbrdf_bayes.physics.reciprocal import solve_scale
from pbrdf_bayes.scene.prediction import DrawnModel, compute_scene
from pbrdf_bayes.scenes import Scene

_N_DRAWS = 64
_THETA_I = (20.0, 60.0)
_PLANE = tuple(np.linspace(-85.0, 85.0, 171).tolist())
_THETA = tuple(np.linspace(0.0, 87.5, 36).tolist())
_HALF = tuple(np.linspace(0.0, 180.0, 37).tolist())
_LAMBERT = 0.01


def measure_scenes(*, quick: bool) -> list[dict[str, Any]]:
    """Time of scenes that ask for more and more, bands of 64 draws included.

    Two angles of incidence; 171 directions in plane, 1332 in half of the hemisphere. Last the
    reciprocal normalisation, which is solved for once a surface.

    Returns
    -------
    list of dict
        scene, microseconds (a draw), ratio to the first one.
    """
    x = parameter_sets(paper_posterior(), _N_DRAWS)[:, : len(DOMAIN)]
    bare = DrawnModel(x, tuple(DOMAIN), "lorentzian", "mean-sine", RTOL_DIGITS, {})
    with_column = np.column_stack([x, np.full(len(x), _LAMBERT)])
    diffuse = DrawnModel(
        with_column, (*DOMAIN, "lambert"), "lorentzian", "mean-sine", RTOL_DIGITS, {}
    )
    plane: dict[str, Any] = {"theta_i_deg": _THETA_I, "theta_r_deg": _PLANE}
    half: dict[str, Any] = {"theta_i_deg": _THETA_I, "theta_r_deg": _THETA, "phi_r_deg": _HALF}
    whole: dict[str, Any] = half | {"phi_r_deg": (*_HALF, *(360.0 - phi for phi in _HALF[-2:0:-1]))}
    dhr: dict[str, Any] = {"dhr_theta_i_deg": tuple(np.linspace(0.0, 85.0, 18).tolist())}
    cases = {
        "in plane, s": (bare, Scene(**plane, polarizations=("s",))),
        "in plane, unpolarised": (bare, Scene(**plane, polarizations=("u",))),
        "in plane, s and p": (bare, Scene(**plane)),
        "in plane, s and p, DHR at 18 angles": (bare, Scene(**plane, **dhr)),
        "DHR alone, s and p": (bare, Scene(**dhr)),
        "half of the hemisphere, s": (bare, Scene(**half, polarizations=("s",))),
        "half of the hemisphere, unpolarised": (bare, Scene(**half, polarizations=("u",))),
        "half of the hemisphere, s and p": (bare, Scene(**half)),
        "whole hemisphere, s and p": (bare, Scene(**whole)),
        "half, s and p, Stokes of unpolarised light": (bare, Scene(**half, stokes_incident="u")),
        "half, s and p, Stokes of s light": (bare, Scene(**half, stokes_incident="s")),
        "half, s and p, Stokes of s light, depolarised": (
            bare, Scene(**half, stokes_incident="s", depolarisation=0.1),
        ),
        "half, s and p, Lambertian": (diffuse, Scene(**half)),
        "half, s and p, Lambertian, Stokes of s light": (
            diffuse, Scene(**half, stokes_incident="s"),
        ),
    }  # fmt: skip
    times = time_in_turns(
        {name: partial(compute_scene, *case) for name, case in cases.items()},
        rounds=2 if quick else 12,
    )
    times |= {name: t * _N_DRAWS for name, t in _reciprocal(quick=quick).items()}
    first = next(iter(times.values()))
    return [
        {"scene": name, "microseconds": t * 1e6 / _N_DRAWS, "ratio": t / first}
        for name, t in times.items()
    ]


def _reciprocal(*, quick: bool) -> dict[str, float]:
    """Seconds that the reciprocal normalisation of the published paint takes, by its tolerance."""
    paint, found = GREEN_PAINT, {}
    solve_scale(paint.n, paint.k, paint.rho0, 1e-3)  # compiled
    for rtol in (1e-6,) if quick else (1e-6, 1e-8):
        started = perf_counter()
        solve_scale(paint.n, paint.k, paint.rho0, rtol)
        found[f"reciprocal normalisation, one surface, rtol {rtol:.0e}"] = perf_counter() - started
    return found
