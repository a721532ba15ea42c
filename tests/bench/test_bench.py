"""The benchmark as a user runs it; what it says about accuracy, never how fast it was."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from pbrdf_bayes import cli
from pbrdf_bayes.bench import baselines, closed_form, normalisation, samples, speed
from pbrdf_bayes.bench.run import DEFAULT_FOLDER
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.effects_table import EFFECTS, FRESNEL_AT, LINE_SHAPES
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
from pbrdf_bayes.physics.normalisation.plain import incidence, normalisation_integrals, workspace

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "tests" / "benchmarks"
KEYS = {
    "schema_version", "version", "created_utc", "quick", "machine", "seconds", "headline",
    "normalisation", "error_map", "posterior_shift", "ladder", "scaling", "samples", "options",
    "scenes",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bench") / "page"
    assert cli.main(["bench", "--quick", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def result(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "bench.json").read_text(encoding="utf-8"))
    return found


def points_of(case: dict[str, Any], method: str) -> list[dict[str, Any]]:
    return [p for p in case["points"] if p["method"] == method]


def test_json_holds_every_part(result: dict[str, Any]) -> None:
    assert set(result) == KEYS
    assert result["quick"] is True
    assert result["machine"]["processor"]


def test_page_is_one_file_without_network_or_leftovers(folder: Path) -> None:
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert len(page) < 600_000
    assert page.count('<svg class="plot"') == 16
    for forbidden in ("<script", "http-equiv", "@import", "nan ", ">nan<", ">inf<", "None"):
        assert forbidden not in page
    assert not re.search(r'(src|href)="https?:', page)
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_scenes_are_in_the_page(folder: Path, result: dict[str, Any]) -> None:
    """Their work is counted in ``test_scene_prediction.py``; here only that they are measured."""
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert result["scenes"][0]["ratio"] == 1.0
    for row in result["scenes"]:
        assert row["microseconds"] > 0.0
        assert f"<th>{row['scene']}</th>" in page


def test_error_follows_the_tolerance(result: dict[str, Any]) -> None:
    for case in result["normalisation"]:
        ours = points_of(case, "ours")
        errors = np.array([p["error"] for p in ours])
        rtols = np.array([float(p["setting"]) for p in ours])
        assert (errors <= np.maximum(rtols, 2e-12)).all()
        floored = np.maximum(errors, 2e-14)
        assert (np.diff(floored) <= 0.0).all()
        assert (np.diff([p["evaluations"] for p in ours]) >= 0).all()


def test_grids_and_adaptive_integration_agree_with_ours(result: dict[str, Any]) -> None:
    paint = result["normalisation"][0]
    grids = [p["error"] for p in points_of(paint, "tensor grid")]
    assert (np.diff(grids) < 0.0).all()
    assert grids[-1] < 1e-6
    assert points_of(paint, "scipy dblquad")[-1]["error"] < 1e-6


def test_posterior_does_not_move_at_the_standard_tolerance(result: dict[str, Any]) -> None:
    largest = {
        row["rtol"]: max(map(abs, row["shift"])) for row in result["posterior_shift"]["rows"]
    }
    assert largest[1e-6] < 0.01
    assert largest[1e-9] < largest[1e-4] < largest[1e-2]


def test_longer_inference_is_near_the_reference(result: dict[str, Any]) -> None:
    assert result["ladder"]["reference"]["k_hat"] < 0.7
    for row in result["ladder"]["rows"]:
        assert row["error_mean"] < 0.2, row
        assert row["error_sd"] < 0.2, row


def test_clock_of_the_samples_runs_on(result: dict[str, Any]) -> None:
    found = result["samples"]
    assert found["sizes"] == [1, 2, 3]
    for series in (found, found["threads"]):
        assert series["seconds"][0] > 0.0
        assert (np.diff(series["seconds"]) >= 0.0).all()
    assert found["threads"]["sizes"] == [2, 3]


def test_processes_fit_samples() -> None:
    job = (simulate_measurement(GREEN_PAINT, seed=1, theta_r_deg=[-20.0, 0.0, 20.0]), 1)
    with samples.ready_processes() as pool:
        seconds = list(samples.by_workers(pool)([job, job, job]))
    assert seconds == sorted(seconds)
    assert len(seconds) == 3


def test_one_polarisation_and_unpolarised_are_compared_at_equal_angles(
    result: dict[str, Any],
) -> None:
    """With the row of s and p: the same angles and readings a scan, half the scans, no DHR."""
    both = speed.paper_posterior().measurement
    cases = speed._of_one_scan_an_angle(RunConfig())
    assert [{scan.polarization for scan in m.scans} for m, _ in cases.values()] == [{"s"}, {"u"}]
    for one, _ in cases.values():
        assert 2 * len(one.scans) == len(both.scans)
        assert {s.theta_i_deg for s in one.scans} == {s.theta_i_deg for s in both.scans}
        assert 2 * len(one.brdf) == len(both.brdf)
        assert len(one.dhr) == 0
    assert set(cases) <= {row["option"] for row in result["options"]}


def test_costs_in_the_readme_are_those_of_the_stored_page() -> None:
    """To the two digits that are told."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    stored = json.loads((ROOT / DEFAULT_FOLDER / "bench.json").read_text(encoding="utf-8"))
    ratios = {row["option"]: row["ratio"] for row in stored["options"]}
    scenes = {row["scene"]: row["ratio"] for row in stored["scenes"]}
    told: dict[str, float] = {}
    for line in re.findall(
        r"^\| `(?!effects`).*\|$", text.split("## Effects")[1].split("## ")[0], re.MULTILINE
    ):
        names, *_, cost = line.strip("| ").split(" | ")
        told |= {f"effect {n}": float(cost.split()[0]) for n in re.findall(r"`(\w+)`", names)}
    for name in list(LINE_SHAPES)[1:]:
        cost = re.search(rf"`{name}`(?: costs)?\s(\d+)", text)
        told[f"{name} line shape"] = float(cost[1] if cost else "nan")
    for at in FRESNEL_AT[1:]:
        cost = re.search(rf"`{at}`\s(\d+)", text)
        told[f"Fresnel factor at {at}"] = float(cost[1] if cost else "nan")
    assert set(told) == {
        name for name in ratios if name.startswith(("effect", "Fresnel")) or "shape" in name
    }
    for name, cost in told.items():
        assert cost == float(f"{ratios[name]:.2g}"), name
    quoted = re.search(
        r"in plane s alone costs\s([\d.]+) of s and p, over the hemisphere ([\d.]+)", text
    )
    assert quoted is not None
    for share, place in zip(quoted.groups(), ("in plane", "half of the hemisphere"), strict=True):
        ratio = scenes[f"{place}, s"] / scenes[f"{place}, s and p"]
        assert share == f"{ratio:.2f}"


def test_page_says_what_can_be_switched_on(folder: Path) -> None:
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert ("no effects beyond the four-parameter model" in page) is (not EFFECTS)


def test_map_shows_where_the_closed_forms_fail(result: dict[str, Any]) -> None:
    closed, few = (np.array(result["error_map"][k]) for k in ("closed_form", "few_terms"))
    assert closed.shape == few.shape
    assert np.isfinite(closed).all()
    assert np.median(few) < np.median(closed)
    assert closed.max() > 0.1


def test_closed_form_is_the_limit_of_narrow_lobes_at_normal_incidence() -> None:
    inc, surf = incidence(0.0), normalisation.surface_of(normalisation.paint(1e-3))
    exact = normalisation_integrals(inc, surf, 10.0, workspace())
    np.testing.assert_allclose(closed_form.closed_form(inc, surf), exact, rtol=2e-3)


def test_plain_likelihood_is_the_same_likelihood() -> None:
    """With a finer grid plain NumPy approaches the kernel; with the same numbers, no other law."""
    posterior = speed.paper_posterior()
    x = speed.parameter_sets(posterior, 1)
    ours = posterior.log_likelihood(x)[0]
    coarse, fine = (abs(baselines.PlainLikelihood(posterior, n)(x[0]) - ours) for n in (60, 240))
    assert fine < 0.1 * coarse
    assert fine < 0.2


@pytest.fixture(scope="module")
def guard() -> ModuleType:
    spec = importlib.util.spec_from_file_location("ratios", BENCHMARKS / "ratios.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_guard_stores_every_ratio_and_says_what_is_worse(guard: ModuleType) -> None:
    stored = json.loads((BENCHMARKS / "ratios.json").read_text(encoding="utf-8"))["ratios"]
    assert set(stored) == set(guard.WORDS) == set(guard.MARGINS)
    assert not any(line.startswith("WORSE") for line in guard.judge(stored, stored))
    for name, margin in guard.MARGINS.items():
        factor = 1.01 * margin
        worse = stored[name] / factor if name in guard.LARGER_IS_BETTER else stored[name] * factor
        lines = guard.judge({**stored, name: worse}, stored)
        assert [line.startswith("WORSE") for line in lines].count(True) == 1
