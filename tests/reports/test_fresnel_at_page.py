"""The committed comparison of where the reflectance is taken: complete, and made by its script."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.effects_table import FRESNEL_AT
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.inference.effects_choice.choose import compare_configs
from pbrdf_bayes.model.simulate import simulate_measurement

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[2] / "reports" / "fresnel_at"


@pytest.fixture(scope="module")
def make(make_of: Callable[[str], ModuleType]) -> ModuleType:
    return make_of("fresnel_at")


@pytest.fixture(scope="module")
def stored():
    return json.loads((FOLDER / "fresnel_at.json").read_text(encoding="utf-8"))


def test_every_row_is_there(make: ModuleType, stored) -> None:
    measured = {(one["sample"], one["model"]) for one in stored["measured"]}
    assert measured == {(sample, model) for sample in make.MEASURED for model in make.MODELS}
    simulated = {(one["sample"], one["truth"], one["seed"]) for one in stored["simulated"]}
    wanted = {
        (p, t, s) for p, paint in make.PAINTS.items() for t in FRESNEL_AT for s in paint.seeds
    }
    assert simulated == wanted
    for one in (*stored["measured"], *stored["simulated"]):
        assert [row["fresnel_at"] for row in one["rows"]] == list(FRESNEL_AT)
        assert sum(row["best"] for row in one["rows"]) == 1
    assert stored["seconds"] < 600.0
    for one in stored["simulated"]:
        true = next(row for row in one["rows"] if row["fresnel_at"] == one["truth"])
        assert true["rms_dex"] < 0.05, "the optimum was found"


def test_the_page_states_the_finding(make: ModuleType, stored) -> None:
    page = (FOLDER / "index.html").read_text(encoding="utf-8")
    assert make.finding(stored["measured"]) in page


def test_a_stored_row_is_what_the_script_finds_today(make: ModuleType, stored) -> None:
    one = next(o for o in stored["simulated"] if o["truth"] == "mean-angle" and o["seed"] == 1)
    paint = make.PAINTS[one["sample"]]
    measurement = make.simulate(paint, one["truth"], one["seed"])
    for now, then in zip(make.score(measurement, ()), one["rows"], strict=True):
        for name in ("rms_dex", "held_out_dex"):
            assert now[name] == pytest.approx(then[name], rel=0.02)
        assert now["best"] == then["best"]


def test_the_misfit_has_the_law_that_is_stated(make: ModuleType) -> None:
    rng = np.random.default_rng(1)
    theta = np.array([0.0, 20.0])
    paths = np.array([make.misfit(theta, rng) for _ in range(20_000)])
    covariance = paths.T @ paths / len(paths)
    a = np.sqrt(3.0)
    wanted = 0.07**2 * np.array([[1.0, (1 + a) * np.exp(-a)], [(1 + a) * np.exp(-a), 1.0]])
    np.testing.assert_allclose(covariance, wanted, atol=0.07**2 * 0.03)


def test_verdicts_count_the_truth(make: ModuleType) -> None:
    def rows(rms, best, beaten):
        return [
            {"fresnel_at": p, "rms_dex": r, "best": p == best, "beaten": p in beaten}
            for p, r in zip(FRESNEL_AT, rms, strict=True)
        ]

    sine, mean, angle = FRESNEL_AT
    found = make.verdicts([
        {"truth": sine, "rows": rows((1, 2, 3), sine, {mean, angle})},
        {"truth": mean, "rows": rows((1, 2, 3), mean, {angle})},
        {"truth": angle, "rows": rows((2, 3, 1), sine, {angle})},
    ])  # fmt: skip
    assert found == {"n": 3, "in_sample": 2, "left_out": 2, "decided": 1, "misled": 1}


def test_nothing_left_out_is_no_comparison() -> None:
    one = simulate_measurement(
        pb.GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=np.linspace(-60.0, 60.0, 9),
        polarizations=("s",),
    )  # fmt: skip
    with pytest.raises(DataError, match="nothing can be left out"):
        compare_configs(one, [pb.RunConfig()], seed=1)
