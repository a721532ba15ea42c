"""Two kinds of bands: where the curve is, and where a new reading would be."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import Targets, predict_bands
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.simulate import simulate_measurement
from pbrdf_bayes.results import QUANTILES

Array = NDArray[np.float64]
GRID = np.linspace(-80.0, 80.0, 33)
TRUTH = {"s_rel_s": 0.05, "s_rel_p": 0.1, "u_dhr": 0.002}


def brdf_targets(theta_i: tuple[float, ...], words: str = "sp", phi_r: float = 0.0) -> Targets:
    rows = [(q, i, r) for i in theta_i for q in words for r in GRID.tolist()]
    return Targets(
        polarization=np.array([q for q, _, _ in rows]),
        theta_i_deg=np.array([i for _, i, _ in rows]),
        theta_r_deg=np.array([r for _, _, r in rows]),
        phi_r_deg=np.full(len(rows), phi_r),
    )


def dhr_targets(words: str = "sp") -> Targets:
    angles = np.arange(5.0, 90.0, 5.0)
    n = angles.size * len(words)
    return Targets(
        np.repeat(list(words), angles.size),
        np.tile(angles, len(words)),
        np.full(n, np.nan),
        np.zeros(n),
    )


def at_truth(posterior: Posterior, green: pb.Parameters, n_draws: int) -> Array:
    """Draws that all are the truth: only noise is left in the bands."""
    nuisance = [TRUTH[name] for name in posterior.parameter_names[4:]]
    return np.tile(np.concatenate([green.as_array(), nuisance]), (n_draws, 1))


def spread_draws(posterior: Posterior, green: pb.Parameters, n_draws: int) -> Array:
    """Draws a few per mille around the truth."""
    rng = np.random.default_rng(1)
    x = at_truth(posterior, green, n_draws)
    return np.asarray(x * np.exp(0.003 * rng.standard_normal(x.shape)))


def make(readings: Measurement, **config: Any) -> Posterior:
    return pb.build_posterior(readings, pb.RunConfig(noise="iid", accuracy="reference", **config))


def test_the_model_band_is_the_quantiles_of_the_public_model(
    small: Measurement, green: pb.Parameters
) -> None:
    posterior = make(small)
    draws = spread_draws(posterior, green, 60)
    targets = brdf_targets((35.0,))
    bands = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(2))
    curves = np.array([
        np.concatenate([
            pb.brdf(pb.Parameters(n=n, k=k, sigma_n0=s, rho0=r), 35.0, GRID, q, rtol=1e-10)
            for q in "sp"
        ])
        for n, k, s, r in draws[:, :4].tolist()
    ])  # fmt: skip
    np.testing.assert_allclose(bands.model, np.quantile(curves, QUANTILES, axis=0).T, rtol=1e-9)
    np.testing.assert_allclose(bands.at_map, curves[0], rtol=1e-9)


def test_bands_out_of_plane_are_those_of_the_public_model(
    small: Measurement, green: pb.Parameters
) -> None:
    posterior = make(small)
    draws = at_truth(posterior, green, 20)
    targets = brdf_targets((35.0,), "s", phi_r=60.0)
    bands = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(2))
    wanted = pb.brdf(green, 35.0, GRID, "s", phi_r_deg=60.0, rtol=1e-10)
    np.testing.assert_allclose(bands.model, np.tile(wanted[:, None], 5), rtol=1e-9)


@pytest.mark.parametrize("hemispherical", [False, True])
def test_quantiles_are_in_order_and_the_model_band_lies_inside(
    small: Measurement, green: pb.Parameters, hemispherical: bool
) -> None:
    """Noise widens at both ends, by more than the Monte Carlo error of a quantile of 2000 draws."""
    posterior = make(small, u_brdf_cal=0.02)
    draws = spread_draws(posterior, green, 2000)
    targets = dhr_targets() if hemispherical else brdf_targets((20.0, 60.0))
    bands = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(3))
    for band in (bands.model, bands.predictive):
        assert band.shape == (targets.theta_i_deg.size, 5)
        assert np.all(np.diff(band, axis=1) >= 0.0)
    assert np.all(bands.predictive[:, 0] < bands.model[:, 0])
    assert np.all(bands.predictive[:, -1] > bands.model[:, -1])


def test_noise_alone_gives_the_width_of_the_normal_law(
    small: Measurement, green: pb.Parameters
) -> None:
    """ln of the 5 % and 95 % ends at -+1.645 s_q about ln f; a quantile of 8000 has 1.5 % error."""
    posterior = make(small)
    targets = brdf_targets((20.0,))
    draws = at_truth(posterior, green, 8000)
    bands = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(4))
    half_widths = 0.5 * np.log(bands.predictive[:, -1] / bands.predictive[:, 0])
    noise = np.where(targets.polarization == "s", 0.05, 0.1)
    np.testing.assert_allclose(half_widths, 1.6449 * noise, rtol=0.06)
    np.testing.assert_array_equal(bands.model[:, 0], bands.model[:, -1])


def test_the_gain_of_a_scan_widens_its_predictive_band(
    small: Measurement, green: pb.Parameters
) -> None:
    posterior = make(small, u_brdf_cal=0.2)
    targets = brdf_targets((20.0,), "s")
    draws = at_truth(posterior, green, 8000)
    bands = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(5))
    half_widths = 0.5 * np.log(bands.predictive[:, -1] / bands.predictive[:, 0])
    np.testing.assert_allclose(half_widths, 1.6449 * math.hypot(0.05, 0.2), rtol=0.06)


def coverage(
    posterior: Posterior, replicate: Callable[[int], Array], targets: Targets, draws: Array
) -> float:
    """Share of replicated readings inside the 90 % predictive band."""
    band = predict_bands(posterior, draws, draws[0], targets, np.random.default_rng(6)).predictive
    inside = [
        np.mean((values >= band[:, 0]) & (values <= band[:, -1]))
        for values in (replicate(seed) for seed in range(60))
    ]
    return float(np.mean(inside))


def test_the_predictive_band_covers_replicated_scans(
    small: Measurement, green: pb.Parameters
) -> None:
    """Data made by `simulate_measurement` with other seeds: 90 % within 2 %.

    60 x 132 readings, gains shared by 33 of them: error at most 0.3/sqrt(60 x 4) = 0.019 for gains
    that dominate, and 0.005 for the ends of the band.
    """
    posterior = make(small, u_brdf_cal=0.03)
    draws = at_truth(posterior, green, 3000)
    targets = brdf_targets((20.0, 60.0))

    def replicate(seed: int) -> Array:
        parts = [
            simulate_measurement(
                green, seed=1000 + 2 * seed + i, theta_i_deg=(theta,), theta_r_deg=GRID,
                polarizations=(q,), dhr_theta_i_deg=(), relative_noise=noise, u_brdf_cal=0.03,
            ).brdf.value
            for theta in (20.0, 60.0)
            for i, (q, noise) in enumerate((("s", 0.05), ("p", 0.1)))
        ]  # fmt: skip
        return np.concatenate(parts)

    assert coverage(posterior, replicate, targets, draws) == pytest.approx(0.9, abs=0.02)


def test_the_predictive_band_covers_replicated_dhr(
    small: Measurement, green: pb.Parameters
) -> None:
    """120 gains (two a replicate) of 0.05 and noise of 0.002: error below 0.3/sqrt(120) = 0.03."""
    posterior = make(small, u_dhr_cal=0.05)
    draws = at_truth(posterior, green, 3000)
    targets = dhr_targets()

    def replicate(seed: int) -> Array:
        return simulate_measurement(
            green, seed=2000 + seed, theta_i_deg=(), dhr_theta_i_deg=targets.theta_i_deg[:17].tolist(),
            dhr_noise=0.002, u_dhr_cal=0.05,
        ).dhr.value  # fmt: skip

    # the simulator puts s before p, as the targets do
    assert coverage(posterior, replicate, targets, draws) == pytest.approx(0.9, abs=0.05)


def test_stated_uncertainties_are_part_of_a_new_reading(
    green: pb.Parameters, make_measurement: Callable[..., Measurement]
) -> None:
    """A laboratory that states 10 % and shows no other noise: a new reading scatters by 10 %."""
    values = pb.brdf(green, 20.0, GRID, "s")
    rows = [("brdf", "s", 20.0, r, v) for r, v in zip(GRID, values, strict=True)]
    posterior = make(make_measurement(rows, sigma=0.1 * values))
    draws = np.tile(np.append(green.as_array(), 1e-4), (4000, 1))
    bands = predict_bands(
        posterior, draws, draws[0], brdf_targets((20.0,), "s"), np.random.default_rng(7)
    )
    half_widths = 0.5 * np.log(bands.predictive[:, -1] / bands.predictive[:, 0])
    np.testing.assert_allclose(half_widths, 1.6449 * 0.1, rtol=0.1)


def test_stated_dhr_uncertainties_are_part_of_a_new_reading(
    green: pb.Parameters, make_measurement: Callable[..., Measurement]
) -> None:
    rows = [("dhr", q, a, math.nan, 0.05) for q in "sp" for a in (20.0, 60.0)]
    posterior = make(make_measurement(rows, sigma=[0.004] * 4), u_dhr_cal=0.0)
    draws = np.tile(green.as_array(), (4000, 1))
    bands = predict_bands(posterior, draws, draws[0], dhr_targets(), np.random.default_rng(8))
    half_widths = 0.5 * (bands.predictive[:, -1] - bands.predictive[:, 0])
    np.testing.assert_allclose(half_widths, 1.6449 * 0.004, rtol=0.1)


def test_a_floor_lifts_the_predictive_band_off_zero(
    small: Measurement, green: pb.Parameters
) -> None:
    """Far below the floor a reading is the floor times a log-normal factor of one."""
    floor = 0.5
    posterior = make(small, brdf_floor=floor)
    draws = at_truth(posterior, green, 4000)
    bands = predict_bands(
        posterior, draws, draws[0], brdf_targets((20.0,), "s"), np.random.default_rng(9)
    )
    np.testing.assert_allclose(bands.predictive[:, 2], floor, rtol=0.1)
    np.testing.assert_allclose(bands.predictive[:, -1] / floor, math.exp(1.6449), rtol=0.15)


def test_a_polarisation_without_a_scan_takes_the_largest_noise(green: pb.Parameters) -> None:
    only_s = simulate_measurement(
        green,
        seed=1,
        theta_i_deg=(20.0,),
        theta_r_deg=GRID,
        polarizations=("s",),
        dhr_theta_i_deg=(),
    )
    posterior = make(only_s)
    assert posterior.parameter_names[4:] == ("s_rel_s",)
    draws = at_truth(posterior, green, 4000)
    bands = predict_bands(
        posterior, draws, draws[0], brdf_targets((20.0,), "p"), np.random.default_rng(10)
    )
    half_widths = 0.5 * np.log(bands.predictive[:, -1] / bands.predictive[:, 0])
    np.testing.assert_allclose(half_widths, 1.6449 * 0.05, rtol=0.1)


def test_bands_are_a_function_of_the_generator(small: Measurement, green: pb.Parameters) -> None:
    posterior = make(small)
    draws = spread_draws(posterior, green, 100)
    first, again, other = (
        predict_bands(posterior, draws, draws[0], brdf_targets((20.0,)), np.random.default_rng(s))
        for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.predictive, again.predictive)
    assert np.any(first.predictive != other.predictive)
    np.testing.assert_array_equal(first.model, other.model)
