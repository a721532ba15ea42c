"""The reciprocity defect of a fit against DHR over integral, and what counts as measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.reciprocity import reciprocity_defect
from pbrdf_bayes.verdicts.reciprocity_size import (
    THETA_DEG,
    measure_reciprocity,
    measured_pairs,
)
from tests.laws import GREEN

X = [1.526, 0.193, 0.4528, 0.47, 0.02, 0.02, 5e-4]


def cap(q, theta):
    """The lobe factor of normal exit, f_q(theta -> 0), by the public BRDF alone."""
    return float(pb.brdf(GREEN, theta, 0.0, q, rtol=1e-10))


def test_the_table_is_one_function_of_an_angle_over_itself(small_posterior: Posterior) -> None:
    """f(a -> b) / f(b -> a) = h(a) / h(b), h = DHR / I: so every entry follows from one row."""
    found = measure_reciprocity(small_posterior, np.array([X]))
    assert found is not None
    assert found.theta_deg == THETA_DEG
    for q in "sp":
        table = np.array(found.factors[q])
        h = [cap(q, t) / float(pb.brdf(GREEN, 0.0, t, q, rtol=1e-10)) for t in THETA_DEG]
        wanted = np.divide.outer(h, h)
        np.testing.assert_allclose(table, wanted, rtol=1e-4)  # draft accuracy, 1e-5 in each of two
        np.testing.assert_allclose(table * table.T, 1.0, rtol=1e-12)


def test_the_largest_is_searched_over_the_measured_pairs(small_posterior: Posterior) -> None:
    found = measure_reciprocity(small_posterior, np.array([X]))
    assert found is not None
    assert found.largest is not None
    measured = np.arange(-80.0, 80.5, 5.0)
    by_hand = [
        (abs(np.log(pb.reciprocity_ratio(GREEN, a, abs(b), q))), q, {a, abs(b)})
        for q in "sp"
        for a in (20.0, 60.0)
        for b in measured
    ]
    size, q, pair = max(by_hand, key=lambda t: t[0])
    assert found.largest.polarization == q
    assert {found.largest.theta_a_deg, abs(found.largest.theta_b_deg)} == pair
    assert np.log(found.largest.factor) == pytest.approx(size, abs=1e-4)
    assert found.largest.theta_b_deg >= 0.0, "the forward side of two that are the same"


def test_only_what_was_measured_counts(make_measurement) -> None:
    rows = [("brdf", "s", 20.0, t, 0.02) for t in (-40.0, -39.9, 0.1, 40.0, 90.0)]
    rows += [("brdf", "s", 60.0, 10.0, 0.02), ("dhr", "s", 70.0, np.nan, 0.03)]
    flat = make_measurement(rows, phi_r_deg=[0.0] * 5 + [30.0] + [0.0])
    pairs = sorted(zip(*map(np.ndarray.tolist, measured_pairs(flat)), strict=True))
    assert pairs == [(20.0, -40.0), (20.0, 0.0), (20.0, 40.0), (20.0, 89.5)]
    posterior = pb.build_posterior(flat, pb.RunConfig(noise="iid"))
    found = measure_reciprocity(posterior, np.array([[*X[:5], X[6]]]))
    assert found is not None
    assert found.largest is not None
    assert found.largest.polarization == "s"
    only_dhr = pb.build_posterior(make_measurement(rows[-1:]), pb.RunConfig(noise="iid"))
    none = measure_reciprocity(only_dhr, np.array([[*X[:4], X[6]]]))
    assert none is not None
    assert none.largest is None


def test_effects_of_the_sample_count_and_those_of_the_instrument_do_not(make_measurement) -> None:
    rows = [("brdf", q, 20.0, t, 0.02) for q in "sp" for t in (-60.0, 0.0, 60.0)]
    config = pb.RunConfig(
        effects=("volume", "scale_p", "aperture"), line_shape="cauchy", noise="iid"
    )
    posterior = pb.build_posterior(make_measurement(rows), config)
    x = posterior.sample_prior(np.random.default_rng(1), 1)
    values = {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}
    values |= {"nu": 1.3, "volume": 0.1, "asymmetry": 0.45, "scale_p": 0.9, "aperture_deg": 1.0}
    for name, value in values.items():
        x[:, posterior.parameter_names.index(name)] = value
    found = measure_reciprocity(posterior, x)
    assert found is not None
    effects = Effects(line_shape="cauchy", nu=1.3, volume=0.1, asymmetry=0.45)
    wanted = reciprocity_defect(GREEN, 20.0, 70.0, effects=effects)
    for q, factor in zip("sp", wanted, strict=True):
        assert found.factors[q][2][7] == pytest.approx(float(factor), rel=1e-4)
    beyond = reciprocity_defect(GREEN, 20.0, [-60.0, 0.0, 60.0], effects=effects)
    assert found.largest is not None
    assert np.log(found.largest.factor) == pytest.approx(np.abs(np.log(beyond)).max(), abs=1e-4)


def test_median_and_interval_are_those_of_the_draws_and_of_the_light_that_was_measured(
    make_measurement,
) -> None:
    """Unpolarised scans: the factor of the mean of s and p, draw by draw by the public model."""
    rows = [("brdf", "u", a, t, 0.02) for a in (20.0, 60.0) for t in (-60.0, 0.0, 60.0)]
    posterior = pb.build_posterior(make_measurement(rows), pb.RunConfig(noise="iid"))
    ks = np.linspace(0.0, 1.0, 21)
    found = measure_reciprocity(posterior, np.array([[1.5, k, 0.4, 0.3, 0.02] for k in ks]))
    assert found is not None
    assert found.n_draws == 21
    assert set(found.factors) == set(found.q05) == set(found.q95) == {"u"}
    by_hand = [
        pb.reciprocity_ratio(pb.Parameters(n=1.5, k=k, sigma_n0=0.4, rho0=0.3), 20.0, 60.0, "u")
        for k in ks
    ]
    for level, table in ((0.05, found.q05), (0.5, found.factors), (0.95, found.q95)):
        assert table["u"][2][6] == pytest.approx(np.quantile(by_hand, level), rel=1e-3)
    assert found.largest is not None
    assert found.largest.polarization == "u"
    assert found.largest.q05 <= found.largest.factor <= found.largest.q95


def test_diffuse_scatter_that_is_reciprocal_brings_the_factor_to_one() -> None:
    """Lambert and Lommel-Seeliger terms are reciprocal: beside a faint lobe nothing is left."""
    faint = replace(GREEN, sigma_n0=1e-9)
    for diffuse in (Effects(lambert=0.3), Effects(volume=0.3, asymmetry=0.6)):
        for b in (70.0, -70.0):
            one = reciprocity_defect(faint, 20.0, b, effects=diffuse)
            np.testing.assert_allclose(one, 1.0, rtol=1e-6)


def test_the_side_matters_with_effects_and_only_then() -> None:
    volume = Effects(volume=0.05)
    with_effects = reciprocity_defect(GREEN, 20.0, [70.0, -70.0], effects=volume)
    assert (np.abs(with_effects[:, 0] - with_effects[:, 1]) > 1e-3).all()
    there = pb.brdf(GREEN, 20.0, -70.0, "s", effects=volume)
    back = pb.brdf(GREEN, 70.0, -20.0, "s", effects=volume)
    assert with_effects[0, 1] == pytest.approx(float(there / back), rel=1e-9)
    without = reciprocity_defect(GREEN, 20.0, [70.0, -70.0])
    np.testing.assert_allclose(without[:, 0], without[:, 1], rtol=1e-12)


def test_total_reflection_has_no_table(small_posterior: Posterior) -> None:
    assert measure_reciprocity(small_posterior, np.array([[0.8, 0.01, *X[2:]]])) is None
