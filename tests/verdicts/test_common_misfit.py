"""Misfits that scans share are told from those of their own, and only where they matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.model.simulate import simulate_measurement
from pbrdf_bayes.verdicts.common_misfit import CommonMisfit, compare_misfits, judge_common
from tools.validation.coverage import (
    LAYOUT,
    MISFITS,
    NOISE,
    U_DHR,
    coverage_config,
    draw_paint,
)
from tools.validation.experiments import draw_misfit, draw_readings, rows_of

COMMON, OWN, NOTHING = "one path common to all scans", "own path for each scan", ""


def simulated(seed: int, shape: str) -> tuple[Posterior, CommonMisfit]:
    """Readings with such a misfit, and how alike the misfits at the optimum are."""
    rng = np.random.default_rng([seed, 77])
    template = build_posterior(LAYOUT.template(), coverage_config("iid"))
    truth = np.array([*draw_paint(rng), NOISE, NOISE, U_DHR])
    misfit = np.zeros(len(template.measurement.brdf))
    if shape:
        misfit = draw_misfit(MISFITS[shape](*rows_of(template.measurement)), rng)
    readings = draw_readings(template, truth, rng, misfit=misfit)
    posterior = build_posterior(readings, coverage_config("correlated"))
    found = compare_misfits(posterior, find_map(posterior, n_starts=4, seed=1).best.x, seed=1)
    assert found is not None
    return posterior, found


@pytest.mark.parametrize(
    ("shape", "least", "most"), [(COMMON, 9, 12), (OWN, 0, 1), (NOTHING, 0, 1)]
)
def test_what_is_shared_is_told(shape: str, least: int, most: int) -> None:
    """Of twelve: 95 % are found (below nine: 2 in 10^4), 1 % false alarms (above one: 6 in 10^3)."""
    verdicts = [judge_common(simulated(seed, shape)[1]).verdict for seed in range(12)]
    assert least <= verdicts.count("WARN") <= most


def test_the_correlation_is_that_of_equal_and_of_opposite_paths() -> None:
    """Two groups whose residuals are one smooth curve, then that curve and its negative."""
    posterior, _ = simulated(3, OWN)
    x = find_map(posterior, n_starts=2, seed=1).best.x
    brdf = posterior.predict(x[None, :])[0][0]
    theta_r, scan = rows_of(posterior.measurement)
    curve = 0.1 * np.sin(np.deg2rad(3.0 * theta_r))
    for sign, wanted in ((1.0, 1.0), (-1.0, -1.0 / 3.0)):
        signs = np.where(scan % 2 == 0, 1.0, sign)
        values = brdf * np.exp(signs * curve)
        m = posterior.measurement
        bent = replace(m, brdf=replace(m.brdf, value=values))
        shaped = build_posterior(bent, posterior.config)
        found = compare_misfits(shaped, x, seed=1)
        assert found is not None
        assert found.correlation == pytest.approx(wanted, abs=0.02)


def test_one_group_has_nothing_to_share(green: pb.Parameters) -> None:
    one = simulate_measurement(
        green, seed=1, theta_i_deg=(20.0,), polarizations=("s",), dhr_theta_i_deg=(),
        theta_r_deg=np.linspace(-60.0, 60.0, 31),
    )  # fmt: skip
    posterior = build_posterior(one, pb.RunConfig())
    x = posterior.sample_prior(np.random.default_rng(1), 1)[0]
    assert compare_misfits(posterior, x, seed=1) is None
    independent = build_posterior(one, pb.RunConfig(noise="iid"))
    assert compare_misfits(independent, x[: independent.n_par], seed=1) is None


def test_a_small_misfit_is_no_warning() -> None:
    """However alike: it does not matter below half of the noise."""
    assert judge_common(CommonMisfit(0.9, 0.003, 4, 0.4)).verdict == "PASS"
    assert judge_common(CommonMisfit(0.9, 0.003, 4, 0.6)).verdict == "WARN"
