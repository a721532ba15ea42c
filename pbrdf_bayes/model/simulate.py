"""Synthetic measurements of a known paint, with stated noise and seed."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.measurement import (
    MAX_LABEL,
    Measurement,
    is_label,
    measurement_from_columns,
)
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import Parameters, brdf, dhr
from pbrdf_bayes.quantities import QUANTITIES, S_AND_P
from pbrdf_bayes.readings.observation import draw_readings, reading_law

Array = NDArray[np.float64]

GREEN_PAINT = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
"""Published parameters of the green paint at 3.39 um, rho0 as used for the paper's predictions."""
PAPER_THETA_I_DEG = (0.0, 20.0, 40.0, 60.0, 80.0)
PAPER_DHR_THETA_I_DEG = tuple(float(a) for a in range(10, 90, 10))
LABEL = "simulated"


def simulate_measurement(
    parameters: Parameters,
    *,
    seed: int,
    sample: str = "paint_simulated",
    wavelength_um: float = 3.39,
    theta_i_deg: Sequence[float] = PAPER_THETA_I_DEG,
    theta_r_deg: ArrayLike | None = None,
    dhr_theta_i_deg: Sequence[float] = PAPER_DHR_THETA_I_DEG,
    polarizations: Sequence[str] = S_AND_P,
    relative_noise: float = 0.02,
    dhr_noise: float = 0.0005,
    u_brdf_cal: float = 0.0,
    u_dhr_cal: float = 0.0,
    brdf_floor: float = 0.0,
    effects: Effects | None = None,
) -> Measurement:
    """Draw readings of the model with noise, by the law of `readings.observation`.

    Parameters
    ----------
    parameters : Parameters
    seed : int
        Of the noise.
    sample : str
        Name; ``simulated`` is appended where it does not say so.
    wavelength_um : float
        Wavelength [um].
    theta_i_deg, dhr_theta_i_deg : sequence of float
        Incidence angles of the scans and of the DHR readings [deg]; either may be empty.
    theta_r_deg : array_like, optional
        Angles of each scan [deg]; the paper's -80..80 by 0.5 by default.
    polarizations : sequence of {"s", "p", "u"}
    relative_noise : float
        Standard deviation of ln(reading), in [0, 1] [1].
    dhr_noise : float
        Standard deviation of a DHR reading, in [0, 1] [1].
    u_brdf_cal, u_dhr_cal : float
        Standard deviation of the gain of a scan, and of the DHR of a polarisation, in [0, 1] [1].
    brdf_floor : float
        Noise-equivalent BRDF of the instrument [sr^-1].
    effects : Effects, optional
        Line shape and effects beyond the four parameters.

    Returns
    -------
    Measurement

    Raises
    ------
    ConfigError
        When a number or the name is not allowed, or a reading comes out as none that the reader
        of the tidy CSV takes: a BRDF of zero, or a DHR beyond its range.
    DomainError
        When an angle is outside the model's domain.

    Examples
    --------
    >>> m = simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=[20.0])
    >>> m.sample, len(m.scans), len(m.brdf), len(m.dhr)
    ('paint_simulated', 2, 642, 16)
    """
    _in_unit(
        relative_noise=relative_noise, dhr_noise=dhr_noise, u_brdf_cal=u_brdf_cal,
        u_dhr_cal=u_dhr_cal,
    )  # fmt: skip
    name = sample if LABEL in sample.lower() else f"{sample}_{LABEL}"
    _nameable(sample, name, wavelength_um)
    rng = np.random.default_rng(seed)
    grid = np.arange(-160, 161) / 2.0 if theta_r_deg is None else np.asarray(theta_r_deg, float)
    columns: dict[str, list[object]] = {
        name: [] for name in ("quantity", "polarization", "theta_i_deg", "theta_r_deg", "value")
    }

    def add(quantity: str, q: str, theta_i: float, theta_r: float, value: float) -> None:
        for name, item in zip(columns, (quantity, q, theta_i, theta_r, value), strict=True):
            columns[name].append(item)

    for theta_i in theta_i_deg:
        for q in polarizations:
            gain = u_brdf_cal * rng.standard_normal()
            model = brdf(parameters, theta_i, grid, q, rtol=1e-10, effects=effects)
            law = reading_law(model, brdf_floor, relative_noise**2)
            values = np.exp(draw_readings(law, gain, rng.standard_normal(grid.size)))
            seen = (model > 0.0) | (brdf_floor > 0.0)
            _readable("brdf", model, seen, "more reflectance (sigma_n0)")
            for theta_r, value in zip(grid.tolist(), values.tolist(), strict=True):
                add("brdf", q, theta_i, theta_r, value)
    for q in polarizations if dhr_theta_i_deg else ():
        gain = 1.0 + u_dhr_cal * rng.standard_normal()
        readings = dhr(parameters, dhr_theta_i_deg, q, effects=effects) * gain
        readings += dhr_noise * rng.standard_normal(readings.size)
        low, high = QUANTITIES["dhr"].readable
        _readable("dhr", readings, (readings >= low) & (readings <= high),
                  "less noise, or less diffuse scatter and reflectance")  # fmt: skip
        for theta_i, value in zip(dhr_theta_i_deg, readings.tolist(), strict=True):
            add("dhr", q, theta_i, np.nan, value)
    return measurement_from_columns(
        sample=name,
        wavelength_um=wavelength_um,
        quantity=columns["quantity"],  # type: ignore[arg-type]
        polarization=columns["polarization"],  # type: ignore[arg-type]
        theta_i_deg=columns["theta_i_deg"],  # type: ignore[arg-type]
        theta_r_deg=columns["theta_r_deg"],  # type: ignore[arg-type]
        value=columns["value"],  # type: ignore[arg-type]
    )


def _in_unit(**shares: float) -> None:
    for name, value in shares.items():
        if not 0.0 <= value <= 1.0:
            msg = f"{name} = {value!r} is not allowed: give a number in [0, 1]"
            raise ConfigError(msg)


def _nameable(sample: str, name: str, wavelength_um: float) -> None:
    if not sample.strip() or not is_label(name):
        msg = (
            f"sample = {sample[:40]!r} is not allowed: give up to "
            f"{MAX_LABEL - len(LABEL) - 1} printable characters, not nothing"
        )
        raise ConfigError(msg)
    if not (isfinite(wavelength_um) and wavelength_um > 0.0):
        msg = f"wavelength_um = {wavelength_um!r} is not allowed: give micrometres above 0"
        raise ConfigError(msg)


def _readable(quantity: str, values: Array, allowed: NDArray[np.bool_], remedy: str) -> None:
    """Refuse readings that the reader of the tidy CSV would refuse."""
    if not np.all(allowed):
        msg = (
            f"a simulated {quantity} reading is {values[~allowed][0]:.3g}, which no file may hold: "
            f"give {remedy}"
        )
        raise ConfigError(msg)
