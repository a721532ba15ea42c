"""The studies of ``make validate``, small and seeded; the committed ones are in reports/."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import pbrdf_bayes as pb
from tools.validation.coverage import LINE_SHAPE, simulate_coverage, tabulate
from tools.validation.experiments import rows_of
from tools.validation.line_shape import cauchy_log_brdf, cauchy_log_ratio
from tools.validation.page import render_page
from tools.validation.run import judge_ranks
from tools.validation.sbc import (
    LAYOUT,
    envelope,
    envelope_level,
    outside_envelope,
    simulate_rank,
)

pytestmark = pytest.mark.slow

N_RANKS, N_CONTROL, N_COVERAGE = 12, 10, 4


@pytest.fixture(scope="module")
def ranks() -> dict[str, Any]:
    return judge_ranks([simulate_rank(seed) for seed in range(N_RANKS)])


@pytest.fixture(scope="module")
def control() -> dict[str, Any]:
    return judge_ranks([simulate_rank(seed, overconfident=True) for seed in range(N_CONTROL)])


@pytest.fixture(scope="module")
def coverage() -> list[dict[str, Any]]:
    shapes = ("own path for each scan", LINE_SHAPE)
    return tabulate([simulate_coverage(s, shape) for shape in shapes for s in range(N_COVERAGE)])


def test_ranks_are_uniform(ranks: dict[str, Any]) -> None:
    """Twelve quantities, each at the level of one in ten thousand."""
    found = {name: q["p_value"] for name, q in ranks["quantities"].items()}
    assert len(found) == 12
    assert min(found.values()) > 1e-4, found
    assert ranks["n_not_converged"] == 0


def test_a_likelihood_that_is_too_sure_is_found(control: dict[str, Any]) -> None:
    """Of twelve intervals of 90 %, some parameter's hold fewer than one in ten thousand allows."""
    inside = [control["quantities"][n]["covered_90"] for n in ("n", "k", "sigma_n0", "rho0")]
    assert min(inside) * N_CONTROL < stats.binom(N_CONTROL, 0.9).ppf(1e-4)


def test_a_correlated_misfit_is_covered_and_by_independent_readings_is_not(
    coverage: list[dict[str, Any]],
) -> None:
    """24 intervals: 90 % of them at the level of one in a thousand, against about half of them."""
    rows = {row["noise"]: row for row in coverage if row["shape"] != LINE_SHAPE}
    n = 4 * N_COVERAGE
    least = stats.binom(n, 0.9).ppf(1e-3)
    assert rows["correlated"]["covered_mean"] * n >= least
    assert rows["iid"]["covered_mean"] * n < least
    assert max(rows["correlated"]["width_ratio"].values()) < 1.5


def test_a_wrong_line_shape_is_said(coverage: list[dict[str, Any]]) -> None:
    """rho0 is that of a Lorentzian: independent readings are sure of it, and wrong."""
    rows = {row["noise"]: row for row in coverage if row["shape"] == LINE_SHAPE}
    assert rows["iid"]["covered"]["rho0"] <= 0.5
    assert all(row["flagged"] == 1.0 for row in rows.values())


def test_the_page_tells_all(
    ranks: dict[str, Any], control: dict[str, Any], coverage: list[dict[str, Any]]
) -> None:
    result = {
        "version": "0", "created_utc": "2026-01-01T00:00:00+00:00", "seconds": 60.0,
        "ranks": ranks, "control": control, "coverage": coverage,
    }  # fmt: skip
    page = render_page(result)
    assert page.count("<svg") == 12
    assert "wrong line shape" in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_the_lorentzian_of_the_other_shapes_is_the_model() -> None:
    x = np.array([1.526, 0.193, 0.4528, 0.47])
    paint = pb.Parameters(n=x[0], k=x[1], sigma_n0=x[2], rho0=x[3])
    angles = np.array([-50.0, 0.0, 30.0, 70.0])
    for index, q in enumerate("sp"):
        found = np.exp(cauchy_log_brdf(0.5, np.sin(np.deg2rad(angles)), index, x, 1.0))
        np.testing.assert_allclose(found, pb.brdf(paint, 30.0, angles, q), rtol=1e-6)
    template = LAYOUT.template()
    assert np.all(cauchy_log_ratio(template, x, 1.0) == 0.0)
    assert rows_of(template)[0].size == len(template.brdf)


def test_the_band_holds_whole_curves() -> None:
    """99 % of samples of uniform numbers; a sample squeezed to the middle leaves it."""
    rng = np.random.default_rng(5)
    left = sum(outside_envelope(rng.random(50)) for _ in range(400))
    assert left <= stats.binom(400, 0.01).ppf(0.9999)
    assert outside_envelope(0.35 + 0.3 * rng.random(50))
    assert 0.0 < envelope_level(50) < 0.01
    low, high = envelope(50, np.array([0.5]))
    assert low[0] < 0.5 < high[0]
