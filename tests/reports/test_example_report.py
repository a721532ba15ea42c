"""The committed example of a run is what its script makes today, within Monte Carlo error."""

import importlib.util
import json
import re
from pathlib import Path

import jsonschema
import pytest

from pbrdf_bayes.io.schemas import json_schema
from pbrdf_bayes.records.summary import Summary

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[2] / "reports" / "example"
TRUTH = {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}


@pytest.fixture(scope="module")
def committed():
    return json.loads((FOLDER / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rebuilt(tmp_path_factory):
    spec = importlib.util.spec_from_file_location("example_make", FOLDER / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    target = tmp_path_factory.mktemp("example")
    module.make(target)
    return target


def test_the_parameters_are_the_committed_ones(rebuilt, committed):
    summary = json.loads((rebuilt / "summary.json").read_text(encoding="utf-8"))
    assert list(summary["parameters"]) == list(committed["parameters"])
    for name, then in committed["parameters"].items():
        now = summary["parameters"][name]
        error = (now["mcse_mean"] ** 2 + then["mcse_mean"] ** 2) ** 0.5
        assert abs(now["mean"] - then["mean"]) < 5.0 * error, name
        assert now["sd"] == pytest.approx(then["sd"], rel=0.2), name
        assert now["map"] == pytest.approx(then["map"], abs=0.2 * then["sd"]), name


def test_data_choices_and_verdicts_are_the_committed_ones(rebuilt, committed):
    summary = json.loads((rebuilt / "summary.json").read_text(encoding="utf-8"))
    for key in ("schema_version", "sample", "status", "verdict", "config", "seed"):
        assert summary[key] == committed[key], key
    for key in ("n_brdf", "n_dhr", "excluded", "warnings"):
        assert summary["input"][key] == committed["input"][key], key
    verdicts = {name: check["verdict"] for name, check in summary["diagnostics"].items()}
    assert verdicts == {name: check["verdict"] for name, check in committed["diagnostics"].items()}


def test_the_example_finds_the_paint_it_was_simulated_from(committed):
    for name, true in TRUTH.items():
        found = committed["parameters"][name]
        assert abs(found["mean"] - true) < 4.0 * found["sd"], name


def test_the_summary_follows_the_schema(committed):
    jsonschema.validate(committed, json_schema(Summary))


def test_the_committed_files_are_small_and_stand_alone(committed):
    assert (FOLDER / "report.html").stat().st_size < 600_000
    assert (FOLDER / "curves.svg").stat().st_size < 150_000
    report = (FOLDER / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"<(?:link|script|img)[^>]*(?:src|href)=\"(?!data:)[^\"]*\"", report) == []
    assert committed["sample"] in report


def test_the_committed_files_name_no_folder_of_the_machine_that_made_them(committed):
    assert committed["input"]["file"] == "green_paint_simulated.csv"
    for path in FOLDER.iterdir():
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        assert re.findall(r"(?:/home/|/root/|/tmp/|/Users/|[A-Z]:\\\\)\S*", text) == [], path.name


def test_the_report_shows_the_committed_values(committed):
    report = (FOLDER / "report.html").read_text(encoding="utf-8")
    for name in ("n", "sigma_n0"):
        assert f"{committed['parameters'][name]['mean']:.6f}"[:5] in report


def test_the_picture_has_a_curve_and_both_bands_for_each_polarisation(rebuilt):
    for folder in (rebuilt, FOLDER):
        picture = (folder / "curves.svg").read_text(encoding="utf-8")
        for title in ("20° of incidence, fitted", "75° of incidence, not measured"):
            assert title in picture
        assert picture.count("opacity: 0.22") == picture.count("opacity: 0.5") == 6
