"""The table of the ``predict`` verb: tidy columns, with bands where a posterior is at hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.prediction.bands import Bands, Targets, predict_bands
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import Parameters, brdf, check_directions, dhr, digits_of
from pbrdf_bayes.model.reciprocity import reciprocal_brdf
from pbrdf_bayes.results import N_BAND_DRAWS, drawn_sets

Array = NDArray[np.float64]

COLUMNS = (
    "quantity", "polarization", "theta_i_deg", "theta_r_deg", "value", "q05", "q25", "q75", "q95",
    "pred_q05", "pred_q95",
)  # fmt: skip


def predict_table(
    *,
    folder: Path | None,
    parameters: Parameters | None,
    effects: Effects | None = None,
    theta_i_deg: Sequence[float],
    theta_r_deg: Sequence[float],
    phi_r_deg: float,
    dhr_theta_i_deg: Sequence[float],
    polarizations: Sequence[str],
    rtol: float,
    reciprocal: bool = False,
) -> str:
    """CSV text of predicted BRDF [sr^-1] and DHR [1] curves.

    Parameters
    ----------
    folder : Path or None
        A finished run: ``value`` is the posterior median, with model and predictive bands.
    parameters : Parameters or None
        Given parameters instead: ``value`` only, the bands stay empty.
    effects : Effects or None
        Line shape and effects beside given parameters.
    theta_i_deg, theta_r_deg, dhr_theta_i_deg : sequence of float
        Angles [deg]: every incidence with every scattering angle; DHR at its own.
    phi_r_deg : float
        Azimuth of the scattering directions [deg].
    polarizations : sequence of {"s", "p", "u"}
    rtol : float
        Tolerance of the normalisation where parameters are given.
    reciprocal : bool
        The BRDF of `pbrdf_bayes.reciprocal_brdf` in place of that of Eq. (4).

    Returns
    -------
    str

    Raises
    ------
    ConfigError
        When there is nothing to predict, or the reciprocal normalisation is asked for beside a run,
        with effects or out of plane.
    DomainError
        When an angle or the tolerance is not allowed.
    RunFolderError
        When the folder is not a finished run.
    """
    digits_of(rtol)
    if reciprocal:
        _refuse_reciprocal(folder, effects, phi_r_deg)
    brdf_targets = _targets(theta_i_deg, theta_r_deg, phi_r_deg, polarizations)
    dhr_targets = _targets(dhr_theta_i_deg, [np.nan], 0.0, polarizations)
    if not brdf_targets.theta_i_deg.size + dhr_targets.theta_i_deg.size:
        msg = "there is no angle to predict at: give theta_i_deg, or dhr_theta_i_deg for DHR"
        raise ConfigError(msg)
    for targets in (brdf_targets, dhr_targets):
        check_directions(
            theta_i_deg=targets.theta_i_deg, phi_r_deg=targets.phi_r_deg,
            theta_r_deg=targets.theta_r_deg if targets is brdf_targets else 0.0,
        )  # fmt: skip
    if folder is not None:
        values_of = _bands_of_run(folder)
    else:
        values_of = _values_of_parameters(parameters, effects, rtol, reciprocal=reciprocal)
    lines = [",".join(COLUMNS)]
    for quantity, targets in (("brdf", brdf_targets), ("dhr", dhr_targets)):
        if not targets.theta_i_deg.size:
            continue
        lines += _lines(quantity, targets, values_of(targets))
    return "\n".join(lines) + "\n"


def _bands_of_run(folder: Path) -> Callable[[Targets], Array]:
    """Read a run once; from it median, model band and predictive band, shape (n, 7)."""
    analysis = load_analysis(folder)

    def of(targets: Targets) -> Array:
        bands = predict_from_analysis(analysis, targets)
        return np.column_stack([bands.model[:, [2, 0, 1, 3, 4]], bands.predictive[:, [0, 4]]])

    return of


def _targets(
    theta_i: Sequence[float], theta_r: Sequence[float], phi_r: float, words: Sequence[str]
) -> Targets:
    grid = [(q, i, r) for i in theta_i for q in words for r in theta_r]
    return Targets(
        polarization=np.array([q for q, _, _ in grid], dtype=np.str_),
        theta_i_deg=np.array([i for _, i, _ in grid], dtype=np.float64),
        theta_r_deg=np.array([r for _, _, r in grid], dtype=np.float64),
        phi_r_deg=np.full(len(grid), phi_r),
    )


def _values_of_parameters(
    parameters: Parameters | None, effects: Effects | None, rtol: float, *, reciprocal: bool
) -> Callable[[Targets], Array]:
    """Values at given parameters, shape (n, 1)."""
    assert parameters is not None
    of_dhr = partial(dhr, parameters, effects=effects)
    of_brdf: Callable[..., Array] = partial(brdf, parameters, effects=effects, rtol=rtol)
    if reciprocal:
        of_brdf = partial(reciprocal_brdf, parameters, rtol=rtol)

    def of(targets: Targets) -> Array:
        values = np.empty(targets.theta_i_deg.size)
        for q in np.unique(targets.polarization).tolist():
            rows = targets.polarization == q
            theta_i, theta_r = targets.theta_i_deg[rows], targets.theta_r_deg[rows]
            phi_r = targets.phi_r_deg[rows]
            values[rows] = (
                of_dhr(theta_i, q)
                if targets.hemispherical
                else of_brdf(theta_i, theta_r, q, phi_r_deg=phi_r)
            )
        return values[:, None]

    return of


def _refuse_reciprocal(folder: Path | None, effects: Effects | None, phi_r_deg: float) -> None:
    """It exists for the four parameters, and is reciprocal in plane."""
    what = "the reciprocal normalisation"
    if folder is not None:
        msg = f"{what} goes with --params only: {folder} was fitted with that of the paper"
    elif effects is not None and not effects.is_null:
        msg = f"{what} is that of the four parameters: leave the effects out, or take the paper's"
    elif phi_r_deg % 180.0 != 0.0:
        msg = (
            f"phi_r_deg = {phi_r_deg:g}: out of plane {what} is not reciprocal either. Give 0 or "
            "180, or take reciprocal_brdf in Python"
        )
    else:
        return
    raise ConfigError(msg)


def _lines(quantity: str, targets: Targets, values: Array) -> list[str]:
    lines = []
    for q, theta_i, theta_r, row in zip(
        targets.polarization.tolist(), targets.theta_i_deg.tolist(), targets.theta_r_deg.tolist(),
        values.tolist(), strict=True,
    ):  # fmt: skip
        numbers = [f"{value:.9g}" for value in row] + [""] * (len(COLUMNS) - 4 - len(row))
        angle = "" if np.isnan(theta_r) else f"{theta_r:.10g}"
        lines.append(",".join([quantity, q, f"{theta_i:.10g}", angle, *numbers]))
    return lines


def predict_from_analysis(analysis: Analysis, targets: Targets) -> Bands:
    """Bands of the model and of new readings at any geometry.

    Parameters
    ----------
    analysis : Analysis
    targets : Targets
        All BRDF, or all DHR (``theta_r_deg`` NaN).

    Returns
    -------
    Bands

    Raises
    ------
    DomainError
        When an angle is out of range or not a number.
    """
    check_directions(
        theta_i_deg=targets.theta_i_deg, phi_r_deg=targets.phi_r_deg,
        theta_r_deg=0.0 if targets.hemispherical else targets.theta_r_deg,
    )  # fmt: skip
    posterior = analysis.posterior()
    picked, rng = drawn_sets(analysis, posterior.parameter_names, N_BAND_DRAWS)
    best = analysis.summary["parameters"]
    x_map = np.array([best[name]["map"] for name in posterior.parameter_names])
    return predict_bands(posterior, picked, x_map, targets, rng)
