"""The posterior as a callable: shapes, support, names, errors, coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import pbrdf_bayes as pb
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.measurement import Measurement, select_scans
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]


def parameter_names(rows: list[Any], make: Callable[..., Measurement], **columns: Any) -> list[str]:
    return list(
        pb.build_posterior(make(rows, **columns), pb.RunConfig(noise="iid")).parameter_names
    )


PHYSICAL = ["n", "k", "sigma_n0", "rho0"]
SCAN_S, SCAN_P, SCAN_U = (("brdf", q, 20.0, 5.0, 0.01) for q in "spu")
DHR = ("dhr", "s", 20.0, math.nan, 0.05)


@pytest.mark.parametrize(
    ("rows", "sigma", "nuisance"),
    [
        ([SCAN_S], None, ["s_rel_s"]),
        ([SCAN_P, SCAN_S], None, ["s_rel_s", "s_rel_p"]),
        ([SCAN_U, SCAN_P], None, ["s_rel_p", "s_rel_u"]),
        ([SCAN_S, DHR], None, ["s_rel_s", "u_dhr"]),
        ([SCAN_S, DHR], [math.nan, 0.001], ["s_rel_s"]),
        ([SCAN_S, DHR], [0.001, math.nan], ["s_rel_s", "u_dhr"]),
        ([DHR], None, ["u_dhr"]),
        ([DHR], [0.001], []),
    ],
)
def test_names_follow_what_was_measured(
    rows: list[Any], sigma: Any, nuisance: list[str], make_measurement: Callable[..., Measurement]
) -> None:
    assert parameter_names(rows, make_measurement, sigma=sigma) == PHYSICAL + nuisance


def test_shapes_and_types(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(1), 7)
    assert x.shape == (7, small_posterior.n_par)
    assert x.dtype == np.float64
    for method in (
        small_posterior.log_prior,
        small_posterior.log_likelihood,
        small_posterior.log_prob,
    ):
        assert method(x).shape == (7,)
        assert method(x[:0]).shape == (0,)
        np.testing.assert_array_equal(method(x.tolist()), method(x))
        np.testing.assert_array_equal(method(np.asfortranarray(x)), method(x))
    brdf, dhr = small_posterior.predict(x)
    assert brdf.shape == (7, len(small_posterior.measurement.brdf))
    assert dhr.shape == (7, len(small_posterior.measurement.dhr))


def test_arguments_are_left_alone(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(1), 5)
    before = x.copy()
    small_posterior.log_prob(x)
    small_posterior.log_prob_coordinates(small_posterior.to_coordinates(x))
    np.testing.assert_array_equal(x, before)


@pytest.mark.parametrize("shape", [(7,), (3, 6), (3, 8), (2, 3, 7), ()])
def test_a_wrong_shape_is_refused_with_the_names(
    shape: tuple[int, ...], small_posterior: Posterior
) -> None:
    with pytest.raises(pb.DataError, match=r"wanted \(n_sets, 7\): columns n, k, sigma_n0, rho0"):
        small_posterior.log_prob(np.full(shape, 0.5))


def test_log_prob_is_prior_plus_likelihood(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(2), 50)
    total = small_posterior.log_prior(x) + small_posterior.log_likelihood(x)
    np.testing.assert_array_equal(small_posterior.log_prob(x), total)


def test_the_prior_is_the_product_of_its_factors(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(3), 20)
    factors = [spec.prior.log_density(x[:, i]) for i, spec in enumerate(small_posterior.specs)]
    np.testing.assert_allclose(small_posterior.log_prior(x), np.sum(factors, axis=0), rtol=1e-14)


@pytest.mark.parametrize("column", range(7))
@pytest.mark.parametrize("beyond", ["below", "above", "nan", "inf", "-inf", "huge"])
def test_outside_the_support_the_density_is_zero(
    column: int, beyond: str, small_posterior: Posterior
) -> None:
    x = np.array([[1.5, 0.2, 0.5, 0.4, 0.02, 0.02, 0.001]])
    assert np.isfinite(small_posterior.log_prob(x))[0]
    prior = small_posterior.specs[column].prior
    x[0, column] = {
        "below": np.nextafter(prior.low, -np.inf), "above": np.nextafter(prior.high, np.inf),
        "nan": np.nan, "inf": np.inf, "-inf": -np.inf, "huge": 1e300,
    }[beyond]  # fmt: skip
    assert np.isneginf(small_posterior.log_prob(x))[0]


def test_density_is_finite_everywhere_inside(small_posterior: Posterior) -> None:
    """From the middle of the prior to its very corners."""
    rng = np.random.default_rng(4)
    x = small_posterior.prior_quantile(rng.choice([0.0, 1e-12, 0.5, 1.0 - 1e-12, 1.0], (400, 7)))
    # n = 1 with k = 0 is no surface: ln f is not defined at that one point
    x = x[(x[:, 0] > 1.0) | (x[:, 1] > 0.0)]
    assert np.all(np.isfinite(small_posterior.log_prob(x)))


def test_no_surface_has_no_density(small_posterior: Posterior) -> None:
    """n = 1 with k = 0 reflects nothing; the density there is a number or zero, never NaN."""
    x = np.array([[1.0, 0.0, 0.5, 0.4, 0.02, 0.02, 0.001]])
    assert not np.isnan(small_posterior.log_prob(x)[0])


def test_prior_draws_follow_the_prior(small_posterior: Posterior) -> None:
    """Kolmogorov-Smirnov against uniform cumulative probabilities, p > 1e-4 for seven columns."""
    x = small_posterior.sample_prior(np.random.default_rng(5), 4000)
    for i, spec in enumerate(small_posterior.specs):
        grid = np.linspace(0.0, 1.0, 20_001)
        cumulative = np.interp(x[:, i], spec.prior.quantile(grid), grid)
        assert stats.kstest(cumulative, "uniform").pvalue > 1e-4, spec.name


def test_prior_draws_are_a_function_of_the_generator(small_posterior: Posterior) -> None:
    first, again, other = (
        small_posterior.sample_prior(np.random.default_rng(s), 5) for s in (6, 6, 7)
    )
    np.testing.assert_array_equal(first, again)
    assert np.all(first != other)


def test_coordinates_round_trip(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(8), 200)
    z = small_posterior.to_coordinates(x)
    np.testing.assert_allclose(small_posterior.from_coordinates(z), x, rtol=1e-14)
    names = small_posterior.parameter_names
    logs = [names.index(name) for name in ("rho0", "s_rel_s", "s_rel_p", "u_dhr")]
    np.testing.assert_array_equal(z[:, logs], np.log(x[:, logs]))
    np.testing.assert_array_equal(z[:, :3], x[:, :3])


def test_the_jacobian_is_that_of_the_coordinates(small_posterior: Posterior) -> None:
    """p(z) = p(x) |dx/dz|, the determinant by central differences."""
    x = small_posterior.sample_prior(np.random.default_rng(9), 5)
    z = small_posterior.to_coordinates(x)
    for row, point in zip(x, z, strict=True):
        jacobian = np.empty((7, 7))
        for i in range(7):
            step = np.zeros(7)
            step[i] = 1e-6
            ends = small_posterior.from_coordinates(np.array([point + step, point - step]))
            jacobian[:, i] = (ends[0] - ends[1]) / 2e-6
        log_volume = np.linalg.slogdet(jacobian)[1]
        found = small_posterior.log_prob_coordinates(point[None, :])[0]
        wanted = small_posterior.log_prob(row[None, :])[0] + log_volume
        # exp(ln x) differs from x by an ulp, times the slope of ln L: compare relative to |ln L|
        assert found == pytest.approx(wanted, rel=1e-8, abs=1e-8)


def test_coordinates_that_overflow_have_zero_density(small_posterior: Posterior) -> None:
    z = np.tile(
        small_posterior.to_coordinates(np.array([[1.5, 0.2, 0.5, 0.4, 0.02, 0.02, 1e-3]])), (3, 1)
    )
    z[0, 3], z[1, 4], z[2, 6] = 1e3, 1e308, -1e308
    assert np.all(np.isneginf(small_posterior.log_prob_coordinates(z)))


def test_tempering_weakens_the_likelihood_only(small_posterior: Posterior) -> None:
    x = small_posterior.sample_prior(np.random.default_rng(10), 20)
    weak = small_posterior.tempered(0.25)
    np.testing.assert_array_equal(weak.log_likelihood(x), 0.25 * small_posterior.log_likelihood(x))
    np.testing.assert_array_equal(weak.log_prior(x), small_posterior.log_prior(x))
    assert small_posterior.weight == 1.0


def test_predict_is_the_public_model(small_posterior: Posterior, green: pb.Parameters) -> None:
    x = np.concatenate([green.as_array(), [0.02, 0.02, 0.001]])[None, :]
    brdf, dhr = small_posterior.predict(x)
    readings = small_posterior.measurement.brdf
    for scan in small_posterior.measurement.scans:
        rows = scan.rows
        wanted = pb.brdf(green, scan.theta_i_deg, readings.theta_r_deg[rows], scan.polarization)
        np.testing.assert_allclose(brdf[0, rows], wanted, rtol=1e-4)  # draft: 10 rtol
    hemispherical = small_posterior.measurement.dhr
    for q in "sp":
        rows = hemispherical.polarization == q
        wanted = pb.dhr(green, hemispherical.theta_i_deg[rows], q)
        np.testing.assert_allclose(dhr[0, rows], wanted, rtol=1e-14)


@pytest.mark.parametrize("value", [0.0, -1e-3])
def test_a_reading_that_is_not_positive_needs_a_floor(
    value: float, make_measurement: Callable[..., Measurement]
) -> None:
    m = make_measurement([SCAN_S, ("brdf", "s", 20.0, 10.0, value)], row=[2, 17])
    with pytest.raises(
        pb.DataError, match=r"line 17, column value: a BRDF reading that is not pos"
    ):
        pb.build_posterior(m, pb.RunConfig(noise="iid"))
    posterior = pb.build_posterior(m, pb.RunConfig(noise="iid", brdf_floor=1e-4))
    assert np.isfinite(posterior.log_likelihood(np.array([[1.5, 0.1, 0.5, 0.4, 0.02]])))[0]


def test_a_relative_scale_needs_dhr(make_measurement: Callable[..., Measurement]) -> None:
    with pytest.raises(pb.ConfigError, match=r"brdf_scale = 'relative' needs DHR readings"):
        pb.build_posterior(
            make_measurement([SCAN_S]), pb.RunConfig(noise="iid", brdf_scale="relative")
        )


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        (
            {"rho": {"kind": "uniform"}},
            r"priors\.rho: no such parameter here\. Did you mean 'rho0'\?",
        ),
        (
            {"s_rel_u": {"kind": "uniform"}},
            r"priors\.s_rel_u: no such parameter here.*Inferred: n, k",
        ),
        ({"n": {"kind": "normal", "mean": 1.5}}, r"priors\.n: 'sd' is missing"),
    ],
)
def test_priors_that_do_not_fit_the_measurement_are_refused(
    priors: dict[str, Any], message: str, small: Measurement
) -> None:
    with pytest.raises(pb.ConfigError, match=message):
        pb.build_posterior(small, pb.RunConfig(noise="iid", priors=priors))


def test_user_priors_take_effect(small: Measurement) -> None:
    priors = {"n": {"kind": "uniform", "low": 1.4, "high": 1.6}}
    posterior = pb.build_posterior(small, pb.RunConfig(noise="iid", priors=priors))
    x = posterior.sample_prior(np.random.default_rng(11), 500)
    assert x[:, 0].min() >= 1.4
    assert x[:, 0].max() <= 1.6
    metal = pb.build_posterior(small, pb.RunConfig(noise="iid", prior="metal"))
    assert metal.specs[0].prior.high == 6.0


def test_order_of_the_rows_does_not_matter(small: Measurement, small_posterior: Posterior) -> None:
    """The same readings in any order are the same measurement."""
    from pbrdf_bayes.measurement import measurement_from_columns

    brdf, dhr = small.brdf, small.dhr
    n = small.n_obs
    order = np.random.default_rng(12).permutation(n)

    def mixed(name: str) -> Array:
        column: Array = np.concatenate([getattr(brdf, name), getattr(dhr, name)])[order]
        return column

    shuffled = measurement_from_columns(
        sample="x", wavelength_um=1.0, quantity=np.repeat(["brdf", "dhr"], [len(brdf), len(dhr)])[order],
        polarization=mixed("polarization"), theta_i_deg=mixed("theta_i_deg"),
        theta_r_deg=mixed("theta_r_deg"), value=mixed("value"),
    )  # fmt: skip
    assert [scan.label for scan in shuffled.scans] == [scan.label for scan in small.scans]
    x = small_posterior.sample_prior(np.random.default_rng(13), 5)
    other = pb.build_posterior(shuffled, small_posterior.config)
    np.testing.assert_array_equal(other.log_likelihood(x), small_posterior.log_likelihood(x))


def test_accuracy_level_sets_the_quadrature(small: Measurement) -> None:
    """draft against reference: ln L differs by what 1e-5 in f does, and not by nothing."""
    draft, reference = (
        pb.build_posterior(small, pb.RunConfig(noise="iid", accuracy=a))
        for a in ("draft", "reference")
    )
    x = draft.sample_prior(np.random.default_rng(14), 50)
    x[:, 4:6] = 0.05
    rough, fine = draft.log_likelihood(x), reference.log_likelihood(x)
    assert np.any(rough != fine)
    brdf, _ = reference.predict(x)
    residual = np.log(reference.measurement.brdf.value / brdf)
    bound = 1e-4 * np.sum(np.abs(residual), axis=1) / 0.05**2 + 1e-6
    assert np.all(np.abs(rough - fine) <= bound)


def test_dhr_only_posterior(small: Measurement) -> None:
    alone = select_scans(small, np.zeros(len(small.scans), bool), dhr=True)
    posterior = pb.build_posterior(alone, pb.RunConfig(noise="iid"))
    assert posterior.parameter_names == ("n", "k", "sigma_n0", "rho0", "u_dhr")
    x = np.tile([1.5, 0.2, 0.45, 0.1, 0.001], (2, 1))
    x[1, 3] = 2.0
    values = posterior.log_likelihood(x)
    assert values[0] == values[1]  # rho0 does not enter DHR
    assert posterior.predict(x)[0].shape == (2, 0)


def test_simulated_truth_has_the_expected_chi_square(green: pb.Parameters) -> None:
    """-2 ln L at the truth is chi^2 + ln det: within 5 sd of its mean for 642 rows."""
    m = simulate_measurement(green, seed=15, theta_i_deg=(20.0,), dhr_theta_i_deg=())
    posterior = pb.build_posterior(m, pb.RunConfig(noise="iid"))
    x = np.concatenate([green.as_array(), [0.02, 0.02]])[None, :]
    constant = -0.5 * 642 * math.log(2.0 * math.pi * 0.02**2)
    chi2 = 2.0 * (constant - posterior.log_likelihood(x)[0])
    assert abs(chi2 - 642.0) < 5.0 * math.sqrt(2.0 * 642.0)
