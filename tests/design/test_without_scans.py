"""After DHR alone: what only a scan tells of, noise and discrepancy, is as its priors have it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

import pbrdf_bayes as pb
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_run, draw_nuisance, draw_sets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.evaluate import set_stage, told_by
from pbrdf_bayes.design.linear import linear_law
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.measurement import measurement_from_columns
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

SCAN = tuple(float(a) for a in range(-60, 61, 5))
SPREAD = 0.02
PRIORS = {"tau": (0.05, 1.0), "ell_deg": (20.0, 0.8), "s_rel_p": (0.02, 1.5)}
"""Median and standard deviation of the logarithm, as the table of priors in README has them."""


def beliefs(*, stated: bool = False, n: int = 1200, **choices: object) -> Beliefs:
    """Normal draws about a paint, of which DHR was measured and no scan."""
    m = measurement_from_columns(
        sample="dhr", wavelength_um=3.39, quantity=["dhr"] * 2, polarization=["s", "p"],
        theta_i_deg=[10.0, 10.0], theta_r_deg=[np.nan] * 2, value=[0.023, 0.021],
        sigma=[0.001 if stated else np.nan] * 2,
    )  # fmt: skip
    posterior = build_posterior(m, pb.RunConfig(accuracy="draft", **choices))  # type: ignore[arg-type]
    x = np.full((n, posterior.n_par), 0.002)
    x[:, :4] = GREEN_PAINT.as_array() * (
        1.0 + SPREAD * np.random.default_rng(2).standard_normal((n, 4))
    )
    return beliefs_of_run(posterior, x)


def test_noise_and_discrepancy_are_drawn_from_their_priors() -> None:
    b = beliefs()
    sets = draw_sets(b, b.x, np.random.default_rng(3))
    found = {
        "tau": sets.tau, "ell_deg": sets.ell_deg, "s_rel_p": np.sqrt(sets.variance["p"]),
    }  # fmt: skip
    for name, (median, spread) in PRIORS.items():
        assert kstest(np.log(found[name] / median) / spread, "norm").pvalue > 1e-3, name


def test_draws_that_are_equal_stay_equal() -> None:
    """The design takes them as one: two noises would make two draws of one paint."""
    b = beliefs(n=300)
    twice = beliefs_of_run(
        build_posterior(b.posterior.measurement, b.posterior.config),
        np.repeat(b.x[:, : b.x.shape[1] - 5], 2, axis=0),
    )
    assert len(np.unique(twice.x, axis=0)) == 300


def test_a_scan_tells_what_it_tells_with_them() -> None:
    """1/2 ln det(1 + S J' R^-1 J) by dense algebra, averaged over draws of the priors."""
    b = beliefs()
    candidate = Candidate("brdf", "p", 55.0, 10.0, theta_r_deg=SCAN)
    stage = set_stage(b, n_outer=400, n_inner=800, n_nuisance=2, seed=4, n_linear=400)
    found = linear_law(stage.paints).gain([told_by(stage, candidate)])
    rng = np.random.default_rng(5)
    x0 = GREEN_PAINT.as_array()

    def level(x: np.ndarray) -> np.ndarray:
        return np.log(
            pb.brdf(pb.Parameters(**dict(zip(PHYSICAL, x.tolist(), strict=True))), 55.0, SCAN, "p")
        )

    slopes = np.stack([(level(x0 + d) - level(x0 - d)) / 2e-4 for d in np.diag(1e-4 * x0)], axis=1)
    gap = np.abs(np.subtract.outer(SCAN, SCAN))
    wanted = []
    for _ in range(400):
        tau, ell, s = (
            median * np.exp(spread * rng.standard_normal()) for median, spread in PRIORS.values()
        )
        a = np.sqrt(3.0) * gap / ell
        r = tau**2 * (1.0 + a) * np.exp(-a) + s**2 * np.eye(len(SCAN))
        told = SPREAD**2 * slopes.T @ np.linalg.solve(r, slopes)
        wanted.append(0.5 * np.linalg.slogdet(np.eye(4) + told)[1])
    error = np.hypot(np.std(found), np.std(wanted)) / 20.0
    assert found.mean() == pytest.approx(np.mean(wanted), abs=3.0 * error + 0.1)


def test_they_are_nuisance_even_where_the_laboratory_states_its_noise() -> None:
    """Else a scan would be credited with what it tells of its own noise."""
    b = beliefs(stated=True)
    nuisance = draw_nuisance(b, b.x[:3], 8, np.random.default_rng(1))
    assert nuisance is not None
    assert len(np.unique(nuisance.sets.tau)) == 24


def test_independent_readings_have_no_discrepancy() -> None:
    b = beliefs(noise="iid")
    assert not draw_sets(b, b.x, np.random.default_rng(3)).tau.any()


def test_a_run_with_a_scan_is_left_as_it_is() -> None:
    """Its discrepancy is inferred, and of independent readings there is none."""
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=np.arange(-60.0, 61.0, 10.0),
        dhr_theta_i_deg=(10.0,),
    )  # fmt: skip
    for noise in ("correlated", "iid"):
        posterior = build_posterior(m, pb.RunConfig(accuracy="draft", noise=noise))
        x = posterior.sample_prior(np.random.default_rng(1), 50)
        b = beliefs_of_run(posterior, x)
        assert b.posterior is posterior
        assert b.x is x
        tau = draw_sets(b, x, np.random.default_rng(3)).tau
        wanted = x[:, posterior.parameter_names.index("tau")] if noise == "correlated" else 0.0
        np.testing.assert_array_equal(tau, wanted)


def test_the_law_of_the_discrepancy_is_that_of_the_choices() -> None:
    assert beliefs(discrepancy="matern-1/2").rough
    assert not beliefs().rough
