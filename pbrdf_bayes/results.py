"""What a fit leaves behind: frozen records, and its draws as they are taken from them.

A run is one `Analysis`: a JSON-able summary, a tree of arrays and the resolved configuration.
The run folder holds exactly these three, so a report made from disk equals one made from memory.

``Analysis.draws`` is an `xarray.DataTree` in the ArviZ layout, with these groups:

``posterior``, ``prior``
    One variable per parameter, dimensions ``(chain, draw)``. A chain of the posterior is one
    walker; the coordinate ``ensemble (chain)`` says which independent ensemble it belongs to.
``sample_stats``
    ``lp (chain, draw)``, ``acceptance_rate (chain)``.
``observed_data``
    ``brdf (brdf_obs)`` [sr^-1], ``dhr (dhr_obs)`` [1].
``constant_data``
    Everything else of the measurement, see `pbrdf_bayes.measurement`. Over ``brdf_obs`` and
    ``dhr_obs``, each name after ``brdf_`` or ``dhr_``: ``polarization, theta_i_deg, theta_r_deg,
    phi_r_deg, u`` (stated standard uncertainty, NaN where none), ``repeated, row, map`` (model at
    the MAP); ``brdf_scan`` (index into ``scan``), ``brdf_best`` (model at the least-squares
    optimum). Over ``scan`` (coordinate: the labels): ``scan_polarization, scan_theta_i_deg,
    scan_phi_r_deg, scan_start, scan_stop``. Over ``flag`` (coordinate): ``n_excluded``. Over
    ``n_warnings``: ``warning``. Attributes: ``sample, wavelength_um, source, sha256``.
``posterior_predictive``
    ``brdf (chain, draw, brdf_obs)``, ``dhr (chain, draw, dhr_obs)``: replicated readings.
``leave_one_out``
    ``brdf_elpd, brdf_k_hat, brdf_pit (brdf_obs)`` and the same over ``dhr_obs``: log density of
    each reading given all others, Pareto k-hat, place in its predicted law in [0, 1]; NaN where
    not scored.
``curves``
    ``model_band, predictive_band (curve, theta_r_deg, quantile)``, ``map (curve, theta_r_deg)``
    [sr^-1]; coordinates ``quantile`` (0.05, 0.25, 0.5, 0.75, 0.95), ``curve_polarization,
    curve_theta_i_deg, curve_phi_r_deg, curve_measured (curve)``.
``dhr_curves``
    ``model_band, predictive_band (polarization, theta_i_deg, quantile)``,
    ``map (polarization, theta_i_deg)`` [1].
``widths``
    Width of the lobes at the specular direction, Eq. (5): ``model_band (polarization, theta_i_deg,
    quantile)``, ``map (polarization, theta_i_deg)``, in direction cosine [1]; those of single scans
    are in the summary.
``holdout`` (where it was done)
    Over ``holdout_obs``: ``scan`` (label), ``theta_r_deg``, ``value`` [sr^-1] and
    ``predictive_band (holdout_obs, quantile)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of every stored band: the 50 % and the 90 % interval and the median."""

N_BAND_DRAWS = 400
"""Draws of a run that its bands are made of."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """A finished run.

    Attributes
    ----------
    summary : mapping
        The content of ``summary.json``, see `pbrdf_bayes.records.summary.Summary`.
    draws : xarray.DataTree
        The content of ``posterior.nc``, see the module's docstring.
    config_toml : str
        The resolved configuration.
    design : mapping, optional
        The content of ``design.json``: what to measure next, where that was computed.
    """

    summary: Mapping[str, Any]
    draws: xr.DataTree
    config_toml: str
    design: Mapping[str, Any] | None = None


def draws_of_run(analysis: Analysis, names: Sequence[str]) -> NDArray[np.float64]:
    """Draws of some parameters, shape (n_chains, n_draws, n_names), physical units."""
    group = analysis.draws["posterior"].to_dataset()
    return np.stack([group[name].values for name in names], axis=-1)


def drawn_sets(
    analysis: Analysis, names: Sequence[str], n: int
) -> tuple[NDArray[np.float64], np.random.Generator]:
    """Parameter sets drawn from the posterior, the same ones for every prediction of a run.

    Parameters
    ----------
    analysis : Analysis
    names : sequence of str
        Of the columns.
    n : int
        Sets to draw.

    Returns
    -------
    tuple of ndarray, shape (n, n_names), and numpy.random.Generator
        The sets, in physical units, and the generator to go on with.
    """
    cube = draws_of_run(analysis, names)
    flat = cube.reshape(-1, len(names))
    rng = np.random.default_rng([int(analysis.summary["seed"]), 7])
    return flat[rng.choice(len(flat), n)], rng
