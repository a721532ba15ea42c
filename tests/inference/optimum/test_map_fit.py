"""The optimiser: known optima, the paper's own recipe, and what happens when there is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize

import pbrdf_bayes as pb
from pbrdf_bayes.errors import FitError
from pbrdf_bayes.inference.optimum.least_squares import fit_least_squares
from pbrdf_bayes.inference.optimum.map_fit import coordinate_bounds, find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.measurement import Measurement, measurement_from_columns, select_scans
from pbrdf_bayes.model.simulate import PAPER_DHR_THETA_I_DEG, PAPER_THETA_I_DEG

Array = NDArray[np.float64]
MakeLaw = Callable[..., Posterior]


def test_a_quadratic_is_maximised_exactly(make_law: MakeLaw) -> None:
    centre, width = np.array([0.3, -1.2, 2.0]), np.array([0.1, 0.5, 0.02])
    law = make_law(lambda x: -0.5 * np.sum(((x - centre) / width) ** 2, axis=1), [-5] * 3, [5] * 3)
    found = find_map(law, seed=1)
    # ftol_abs is 1e-9 nat: (x - c)/w below sqrt(2e-9) or so
    np.testing.assert_allclose(found.best.x, centre, atol=1e-4 * width.max(), rtol=0.0)
    assert np.all(np.abs(found.best.x - centre) < 2e-4 * width)
    assert len(found.optima) == 1
    assert found.best.n_starts + found.n_failed == found.n_starts == 16
    assert found.best.log_posterior == pytest.approx(-3.0 * math.log(10.0), abs=1e-8)


def test_a_curved_valley_is_followed_to_its_end(make_law: MakeLaw) -> None:
    """Rosenbrock's function, maximum 0 at (1, 1)."""
    law = make_law(
        lambda x: -(100.0 * (x[:, 1] - x[:, 0] ** 2) ** 2 + (1.0 - x[:, 0]) ** 2), [-2, -1], [2, 3]
    )
    np.testing.assert_allclose(find_map(law, seed=1).best.x, [1.0, 1.0], atol=1e-3)


def test_both_modes_are_found_and_ranked(make_law: MakeLaw) -> None:
    low, high = np.array([-2.0, -2.0]), np.array([2.0, 1.0])

    def two(x: Array) -> Array:
        a = -0.5 * np.sum(((x - low) / 0.3) ** 2, axis=1)
        b = -0.5 * np.sum(((x - high) / 0.3) ** 2, axis=1) - 2.0
        return np.asarray(np.logaddexp(a, b))

    found = find_map(make_law(two, [-5, -5], [5, 5]), seed=2)
    assert len(found.optima) >= 2
    np.testing.assert_allclose(found.optima[0].x, low, atol=1e-3)
    np.testing.assert_allclose(found.optima[1].x, high, atol=1e-3)
    gap = found.optima[0].log_posterior - found.optima[1].log_posterior
    assert gap == pytest.approx(2.0, abs=1e-6)
    values = [optimum.log_posterior for optimum in found.optima]
    assert values == sorted(values, reverse=True)
    assert sum(optimum.n_starts for optimum in found.optima) == found.n_starts - found.n_failed


def test_an_optimum_at_the_bound_is_found(make_law: MakeLaw) -> None:
    law = make_law(lambda x: 3.0 * x[:, 0] - x[:, 1] ** 2, [-1, -1], [2, 1])
    np.testing.assert_allclose(find_map(law, seed=3).best.x, [2.0, 0.0], atol=1e-3)


def test_logarithmic_coordinates_do_not_move_the_optimum(make_law: MakeLaw) -> None:
    """The maximum is that of the density in physical units: no Jacobian in the MAP."""
    law = make_law(
        lambda x: -0.5 * ((x[:, 0] - 0.5) / 0.1) ** 2 + np.log(x[:, 0]),  # undoes the prior 1/x
        [1e-3], [10.0], log_coordinate=[True],
    )  # fmt: skip
    assert find_map(law, seed=4).best.x[0] == pytest.approx(0.5, abs=1e-4)


def test_a_density_that_is_zero_nowhere_finite_is_an_error_with_advice(make_law: MakeLaw) -> None:
    law = make_law(lambda x: np.full(len(x), -np.inf), [-1, -1], [1, 1])
    with pytest.raises(FitError, match=r"none of 16 starts gives a finite.*Check units"):
        find_map(law, seed=1)


def test_parts_of_the_prior_without_density_are_survived(make_law: MakeLaw) -> None:
    """Half of the box has zero density, and the boundary is next to the optimum."""
    law = make_law(
        lambda x: np.where(x[:, 0] > 0.0, -(x[:, 0] - 0.01) ** 2 - x[:, 1] ** 2, -np.inf),
        [-1, -1], [1, 1],
    )  # fmt: skip
    np.testing.assert_allclose(find_map(law, seed=5).best.x, [0.01, 0.0], atol=1e-3)


@pytest.mark.parametrize("n_starts", [1, 3, 6, 8])
def test_any_number_of_starts_will_do(n_starts: int, make_law: MakeLaw) -> None:
    law = make_law(lambda x: -np.sum(x**2, axis=1), [-1, -1], [1, 1])
    found = find_map(law, n_starts=n_starts, seed=1)
    np.testing.assert_allclose(found.best.x, 0.0, atol=1e-3)
    assert found.n_starts == n_starts


def test_same_seed_same_optimum(small_posterior: Posterior) -> None:
    first, again = (find_map(small_posterior, seed=7) for _ in range(2))
    np.testing.assert_array_equal(first.best.x, again.best.x)
    assert first.best.log_posterior == again.best.log_posterior


def test_the_optimum_beats_an_independent_optimiser(small_posterior: Posterior) -> None:
    """Nelder-Mead from the truth, in the same bounds: not one hundredth of a nat better."""
    found = find_map(small_posterior, seed=7)
    low, high = coordinate_bounds(small_posterior)
    start = small_posterior.to_coordinates(
        np.array([[1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 0.0005]])
    )[0]
    other = optimize.minimize(
        lambda z: -small_posterior.log_prob(small_posterior.from_coordinates(z[None, :]))[0],
        start, method="Nelder-Mead", bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 8000, "maxfev": 8000, "xatol": 1e-6, "fatol": 1e-8, "adaptive": True},
    )  # fmt: skip
    assert found.best.log_posterior >= -other.fun - 0.01
    assert found.best.log_posterior == pytest.approx(
        small_posterior.log_prob(found.best.x[None, :])[0], abs=1e-9
    )


def test_simulated_truth_is_recovered(small_posterior: Posterior, green: pb.Parameters) -> None:
    """Within five Laplace standard deviations of each physical parameter."""
    from pbrdf_bayes.inference.optimum.laplace import laplace_mixture

    found = find_map(small_posterior, seed=7)
    mixture = laplace_mixture(small_posterior, found)
    sd = np.sqrt(np.diag(mixture.factors[0] @ mixture.factors[0].T))[:4]
    truth = small_posterior.to_coordinates(
        np.concatenate([green.as_array(), [0.02, 0.02, 0.0005]])[None, :]
    )[0, :4]
    best = small_posterior.to_coordinates(found.best.x[None, :])[0, :4]
    assert np.all(np.abs(best - truth) < 5.0 * sd)


# ------------------------------------------------------------------------ the paper's own recipe


@pytest.fixture(scope="module")
def noiseless(green: pb.Parameters) -> Measurement:
    """The paper's grid without noise; DHR readings stated to 1e-6."""
    theta_r = np.arange(-80.0, 80.5, 2.0)
    columns: dict[str, list[Any]] = {k: [] for k in ("quantity", "q", "i", "r", "value", "u")}

    def add(*row: Any) -> None:
        for column, item in zip(columns.values(), row, strict=True):
            column.append(item)

    for theta_i in PAPER_THETA_I_DEG:
        for q in "sp":
            for r, v in zip(theta_r, pb.brdf(green, theta_i, theta_r, q, rtol=1e-10), strict=True):
                add("brdf", q, theta_i, r, v, math.nan)
    for q in "sp":
        for theta_i in PAPER_DHR_THETA_I_DEG:
            add("dhr", q, theta_i, math.nan, float(pb.dhr(green, theta_i, q)), 1e-6)
    return measurement_from_columns(
        sample="noiseless, simulated", wavelength_um=3.39, quantity=columns["quantity"],
        polarization=columns["q"], theta_i_deg=columns["i"], theta_r_deg=columns["r"],
        value=columns["value"], sigma=columns["u"],
    )  # fmt: skip


def recipe_config(**priors: Any) -> pb.RunConfig:
    return pb.RunConfig(
        noise="iid", prior="dielectric", u_dhr_cal=0.0, accuracy="reference", priors=priors
    )


def test_recipe_dhr_alone_gives_index_and_scale(
    noiseless: Measurement, green: pb.Parameters
) -> None:
    alone = select_scans(noiseless, np.zeros(len(noiseless.scans), bool), dhr=True)
    found = find_map(pb.build_posterior(alone, recipe_config()), seed=1).best.x
    # 16 readings to 1e-6 leave n, k, sigma_N0 about 1e-4 wide, and the prior pulls by far less
    np.testing.assert_allclose(found[:3], green.as_array()[:3], atol=5e-5)


@pytest.fixture(scope="module")
def recipe_optimum(noiseless: Measurement) -> Array:
    """DHR and the scan at 20 deg, s, fitted; the white noise held at 1e-3."""
    labels = [scan.label for scan in noiseless.scans]
    keep = np.arange(len(labels)) == labels.index("s 20 deg")
    config = recipe_config(s_rel_s={"kind": "lognormal", "median": 1e-3, "factor": 1.01})
    chosen = select_scans(noiseless, keep, dhr=True)
    return find_map(pb.build_posterior(chosen, config), seed=1).best.x


def test_recipe_one_scan_then_gives_the_roughness(
    recipe_optimum: Array, green: pb.Parameters
) -> None:
    # 81 points to 1e-3: rho0 to about 1e-4 relative
    assert recipe_optimum[3] == pytest.approx(green.rho0, rel=2e-4)
    np.testing.assert_allclose(recipe_optimum[:3], green.as_array()[:3], atol=5e-5)


def test_recipe_then_predicts_every_other_scan(
    noiseless: Measurement, recipe_optimum: Array
) -> None:
    found = pb.Parameters(**dict(zip(("n", "k", "sigma_n0", "rho0"), recipe_optimum, strict=False)))
    for scan in noiseless.scans:
        readings = noiseless.brdf.value[scan.rows]
        angles = noiseless.brdf.theta_r_deg[scan.rows]
        predicted = pb.brdf(found, scan.theta_i_deg, angles, scan.polarization)
        dex = np.abs(np.log10(readings / predicted))
        assert dex.max() < 3e-4, scan.label  # 0.07 %, from 2e-4 in rho0 and 5e-5 in n and k


# ------------------------------------------------------------------------------- least squares


def test_least_squares_of_noiseless_data_leaves_nothing(
    noiseless: Measurement, green: pb.Parameters
) -> None:
    posterior = pb.build_posterior(noiseless, recipe_config())
    start = np.array([[1.7, 0.4, 0.6, 0.3, 0.02, 0.02]])
    x, rms = fit_least_squares(posterior, start)
    assert rms < 1e-7
    np.testing.assert_allclose(x[:4], green.as_array(), rtol=1e-5)


def test_least_squares_finds_what_a_plain_optimiser_finds(small: Measurement) -> None:
    """rms of log10(measured/model) by Nelder-Mead on the public model."""
    posterior = pb.build_posterior(small, pb.RunConfig(noise="iid", accuracy="draft"))
    start = find_map(posterior, seed=1).best.x
    x, rms = fit_least_squares(posterior, start[None, :])

    def cost(p: Array) -> float:
        try:
            parameters = pb.Parameters(n=p[0], k=p[1], sigma_n0=p[2], rho0=math.exp(p[3]))
        except pb.DomainError:
            return 1e3
        squares = 0.0
        for scan in small.scans:
            model = pb.brdf(
                parameters, scan.theta_i_deg, small.brdf.theta_r_deg[scan.rows], scan.polarization
            )
            squares += float(np.sum(np.log10(small.brdf.value[scan.rows] / model) ** 2))
        return math.sqrt(squares / len(small.brdf))

    other = optimize.minimize(
        cost, [1.5, 0.2, 0.45, math.log(0.47)], method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 4000, "maxfev": 4000},
    )  # fmt: skip
    assert rms == pytest.approx(other.fun, rel=1e-4)
    found = pb.Parameters(**dict(zip(("n", "k", "sigma_n0", "rho0"), x, strict=False)))
    assert cost(np.append(found.as_array()[:3], math.log(found.rho0))) == pytest.approx(
        rms, rel=1e-4
    )


def test_least_squares_without_brdf_is_not_a_number(small: Measurement) -> None:
    alone = select_scans(small, np.zeros(len(small.scans), bool), dhr=True)
    posterior = pb.build_posterior(alone, pb.RunConfig(noise="iid"))
    start = np.array([[1.5, 0.2, 0.45, 0.4, 0.001]])
    x, rms = fit_least_squares(posterior, start)
    assert math.isnan(rms)
    np.testing.assert_array_equal(x, start[0])


def test_censored_rows_do_not_enter_least_squares(small: Measurement) -> None:
    """Rows at the floor carry no residual: replacing them by smaller ones changes nothing."""
    floor = float(np.quantile(small.brdf.value, 0.2))
    lowered = replace(
        small,
        brdf=replace(small.brdf, value=np.where(small.brdf.value <= floor, 1e-9, small.brdf.value)),
    )
    start = np.array([[1.5, 0.2, 0.45, 0.47, 0.02, 0.02, 0.0005]])
    results = [
        fit_least_squares(pb.build_posterior(m, pb.RunConfig(noise="iid", brdf_floor=floor)), start)
        for m in (small, lowered)
    ]
    assert results[0][1] == pytest.approx(results[1][1], rel=1e-9)
