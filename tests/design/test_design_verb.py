"""The verb ``design`` on a run and on priors: streams, exit codes, files, and what they hold."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import build_parser, main
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.candidates import Costs
from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io.run_folder import locked, validate_design
from pbrdf_bayes.verbs.design import best_table
from pbrdf_bayes.verbs.terminal import counter
from pbrdf_bayes.workflow.candidates_csv import read_candidates

pytestmark = pytest.mark.usefixtures("signals_as_before")
FEW = ["--theta-i", "20,55", "--polarization", "s,p", "--draws", "60", "--quiet"]
FILES = {"design.json", "design.html", "measurement_plan.csv"}
TEXTS = ("<script>alert(1)</script>", "&lt;script&gt;")


def run(*arguments: object) -> int:
    try:
        return main([str(a) for a in arguments])
    except SystemExit as stop:  # argparse
        return int(str(stop.code))


@pytest.fixture(scope="module")
def designed(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a design; never changed: copy it first."""
    folder = tmp_path_factory.mktemp("runs") / "designed"
    shutil.copytree(finished_run, folder)
    goals = ["--goal", "dhr:s:70", "--goal", "scan:p:60"]
    assert run("design", folder, *FEW, *goals, "--minutes", "30") == 0
    return folder


@pytest.fixture
def own_run(designed: Path, tmp_path: Path) -> Path:
    return shutil.copytree(designed, tmp_path / "run")


@pytest.fixture(scope="module")
def design(designed: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((designed / "design.json").read_text(encoding="utf-8"))
    return found


def test_the_files_are_there_and_nothing_half_written(designed: Path) -> None:
    names = {p.name for p in designed.iterdir()}
    assert names >= FILES
    assert not [name for name in names if name.endswith(".part")]


def test_the_json_keeps_to_its_schema_and_to_the_contract(design: dict[str, Any]) -> None:
    validate_design(design, where="design.json")
    rows = design["candidates"]
    assert len(rows) == design["n_candidates"] == 2 * 2 * 3
    wanted = {
        "quantity",
        "polarization",
        "theta_i_deg",
        "minutes",
        "eig_nats",
        "eig_se",
        "eig_per_minute",
        "p_best",
    }
    assert all(wanted <= set(row) for row in rows)
    gains = [row["eig_nats"] for row in rows]
    assert gains == sorted(gains, reverse=True)
    assert sum(row["p_best"] for row in rows) == pytest.approx(1.0)
    for row in rows:
        assert row["eig_per_minute"] == pytest.approx(row["eig_nats"] / row["minutes"])
        assert row["eig_low"] <= row["eig_nats"] <= row["eig_high"]
    assert set(rows[0]["sd_ratio"]) == {"n", "k", "sigma_n0", "rho0", "DHR_s(70°)", "scan f_p(60°)"}
    assert design["run"]["sample"] == "small_simulated"
    broken = design | {"about": []}
    with pytest.raises(RunFolderError, match="about"):
        validate_design(broken, where="x")


def test_goals_are_ranked_as_a_utility(design: dict[str, Any], designed: Path) -> None:
    """For each measurement and each minute, with errors, chances and front; shares of variance."""
    assert [goal["name"] for goal in design["goals"]] == ["DHR_s(70°)", "scan f_p(60°)"]
    ratios = {row["label"]: row["sd_ratio"] for row in design["candidates"]}
    for goal in design["goals"]:
        rows = goal["candidates"]
        assert len(rows) == design["n_evaluated"]
        reductions = [row["reduction"] for row in rows]
        assert reductions == sorted(reductions, reverse=True)
        assert goal["sd_before"] == pytest.approx(design["sd_before"][goal["name"]])
        for kind in ("p_best", "p_best_per_minute"):
            assert sum(row[kind] for row in rows) == pytest.approx(1.0)
        assert rows[0]["tied"]
        assert rows[0]["pareto"]
        for row in rows:
            assert row["reduction_per_minute"] == pytest.approx(row["reduction"] / row["minutes"])
            assert row["reduction"] == pytest.approx(1.0 - row["sd_ratio"] ** 2)
            left = ratios[row["label"]][goal["name"]]
            assert row["sd_ratio"] == pytest.approx(left["ratio"])
            assert row["sd_ratio_se"] == pytest.approx(left["se"])
            better = [r for r in rows if r["minutes"] <= row["minutes"]]
            first = row["reduction"] >= max(r["reduction"] for r in better)
            assert row["pareto"] == (first and row["reduction"] > 2.0 * row["reduction_se"])
    best = design["goals"][0]["candidates"][0]["label"]
    assert f"for DHR_s(70°) the {best} (standard deviation to" in design["recommendation"]
    page = (designed / "design.html").read_text(encoding="utf-8")
    assert "What you need" in page
    assert "Candidates for DHR_s(70°)" in page


def test_a_design_without_goals_has_a_page(design: dict[str, Any]) -> None:
    from pbrdf_bayes.report.design_page import render_design

    older = {key: value for key, value in design.items() if key != "goals"}
    validate_design(older, where="older.json")
    assert "What you need" not in render_design(older)


def test_a_local_gain_is_marked_as_such(design: dict[str, Any]) -> None:
    from pbrdf_bayes.report.design_page import render_design

    first, *rest = design["candidates"]
    local = first | {"eig_nats": 11.5, "eig_low": 8.5, "eig_high": 34.1, "eig_method": "local"}
    page = render_design(design | {"candidates": [local, *rest]})
    assert re.search(r"11\.50* ± [\d.]+\*<", page)
    assert "*: local normal approximation, within the bracket" in page
    table = best_table(design | {"candidates": [local, *rest]})
    assert "11.500*" in table
    assert "* local normal approximation" in table
    assert "local normal" not in best_table(design)


def test_what_is_assumed_of_the_instrument_is_told(design: dict[str, Any]) -> None:
    """Of the scale of scans only where it is perfect, of the discrepancy only where there is one."""
    from pbrdf_bayes.report.design_page import render_design

    assert design["instrument"] == {
        "noise": "correlated", "brdf_scale": "absolute", "u_brdf_cal": 0.0, "u_dhr_cal": 0.01,
        "scans_of_prior": False,
    }  # fmt: skip
    perfect, along = "Scans have a perfect absolute scale", "discrepancy of the model along a scan"
    page = render_design(design)
    assert f"{perfect} here, as the configuration says (u_brdf_cal = 0), while a DHR has" in page
    assert along in page
    assert "No scan was fitted" not in page
    for change in ({"u_brdf_cal": 0.02}, {"brdf_scale": "relative"}):
        assert perfect not in render_design(design | {"instrument": design["instrument"] | change})
    alone = {"noise": "iid", "scans_of_prior": True}
    page = render_design(design | {"instrument": design["instrument"] | alone})
    assert along not in page
    assert "the discrepancy is the same" not in page
    assert "No scan was fitted: noise of scans is drawn from its prior." in page
    older = {key: value for key, value in design.items() if key != "instrument"}
    assert perfect not in render_design(older)


def test_a_ddr_in_the_plan_and_one_candidate_alone(design: dict[str, Any]) -> None:
    from pbrdf_bayes.report.design_page import render_design

    first, *_ = design["batch"]["members"]
    ddr = first | {"quantity": "ddr", "label": "DDR_s at 20°, port 5°"}
    page = render_design(design | {"batch": design["batch"] | {"members": [ddr]}})
    assert re.search(r"port 5°<div class=.what.>fit does not read DDR yet</div>", page)
    assert "fit does not read DDR yet" not in render_design(
        design | {"batch": design["batch"] | {"members": []}}
    )
    one = render_design(design | {"candidates": design["candidates"][:1], "n_evaluated": 1})
    assert "<span>The candidate of the largest gain found. " in one


def test_ratios_have_their_errors(design: dict[str, Any]) -> None:
    ratio = design["candidates"][0]["sd_ratio"]["n"]
    value, se = 100.0 * ratio["ratio"], 100.0 * ratio["se"]
    assert f"{value:.0f} +- {se:.0f} %" in best_table(design)


def test_progress_at_every_tenth_of_a_stage(capsys: pytest.CaptureFixture[str]) -> None:
    """Where stderr is no terminal."""
    told = counter(quiet=False, interrupted=lambda: False)
    for done in range(1, 163):
        told("simulating", done, 162)
    for done in range(1, 4):
        told("refining", done, 3)
    lines = capsys.readouterr().err.splitlines()
    counts = [int(line.split()[1].split("/")[0]) for line in lines if "simulating" in line]
    assert counts == [1, 17, 33, 49, 65, 81, 98, 114, 130, 146, 162]
    assert sum("refining" in line for line in lines) == 3


def test_default_costs_are_those_of_the_records(design: dict[str, Any]) -> None:
    options = build_parser().parse_args(["design", "a"])
    costs = Costs(
        options.scan_minutes, options.dwell_seconds, options.dhr_minutes, options.ddr_minutes
    )
    assert costs == Costs()
    scan = next(r for r in design["candidates"] if r["quantity"] == "brdf")
    assert scan["n_readings"] == 33  # as the sample was scanned
    assert scan["minutes"] == pytest.approx(5.0 + 33 * 5.0 / 60.0)


def test_the_batch_keeps_to_its_budget_and_adds_up(design: dict[str, Any]) -> None:
    batch = design["batch"]
    assert 0.0 < batch["minutes"] <= 30.0
    assert batch["minutes"] == pytest.approx(sum(m["minutes"] for m in batch["members"]))
    assert batch["eig_nats"] == pytest.approx(sum(m["added_nats"] for m in batch["members"]))


def test_the_plan_is_the_batch_and_can_be_given_back(
    designed: Path, design: dict[str, Any], tmp_path: Path
) -> None:
    plan = designed / "measurement_plan.csv"
    rows = list(csv.DictReader(plan.read_text(encoding="utf-8").splitlines()))
    members = design["batch"]["members"]
    assert [int(row["order"]) for row in rows] == list(range(1, len(members) + 1))
    again = read_candidates(plan, (0.0,), costs=Costs(), port_deg=5.0)
    assert [c.label for c in again] == [m["label"] for m in members]
    assert [c.n_readings for c in again] == [m["n_readings"] for m in members]
    assert [c.minutes for c in again] == pytest.approx([m["minutes"] for m in members], abs=1e-4)


def test_the_report_has_the_section_and_keeps_it(own_run: Path, design: dict[str, Any]) -> None:
    report = own_run / "report.html"
    text = report.read_text(encoding="utf-8")
    assert "What to measure next" in text
    assert 'href="design.html"' in text
    assert run("report", own_run) == 0
    assert report.read_text(encoding="utf-8") == text
    (own_run / "design.json").unlink()
    assert run("report", own_run) == 0
    assert "What to measure next" not in report.read_text(encoding="utf-8")


def test_a_run_without_a_design_has_the_report_it_had(finished_run: Path) -> None:
    analysis = load_analysis(finished_run)
    assert analysis.design is None
    assert pb.render_report(analysis) == (finished_run / "report.html").read_text(encoding="utf-8")


def test_a_design_of_other_draws_does_not_count(own_run: Path, design: dict[str, Any]) -> None:
    other = design | {"run": design["run"] | {"created_utc": "2001-01-01T00:00:00+00:00"}}
    (own_run / "design.json").write_text(json.dumps(other), encoding="utf-8")
    assert load_analysis(own_run).design is None


@pytest.mark.parametrize("text", ["{", '{"schema_version": 1}', "[1]"])
def test_a_damaged_design_is_named_with_its_remedy(own_run: Path, text: str) -> None:
    (own_run / "design.json").write_text(text, encoding="utf-8")
    with pytest.raises(RunFolderError, match=r"design\.json: .*Remove it, or run 'design' again"):
        load_analysis(own_run)


def test_texts_are_escaped(own_run: Path, design: dict[str, Any]) -> None:
    from pbrdf_bayes.report.design_page import render_design

    bad, escaped = TEXTS
    page = render_design(design | {"run": design["run"] | {"sample": bad}, "recommendation": bad})
    assert bad not in page
    assert escaped in page


def test_words_on_stdout_and_progress_on_stderr(
    finished_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--candidates", "dhr", "--theta-i", "75", "--polarization", "s", "--draws", "40"]
    before = {p.name: p.read_bytes() for p in finished_run.iterdir()}
    assert run("design", finished_run, *options, "--out", tmp_path / "out") == 0
    shown = capsys.readouterr()
    assert "DHR_s at 75°" in shown.out
    assert str(tmp_path / "out" / "design.html") in shown.out
    assert "screening 1/1" in shown.err
    assert "combining 1/1" in shown.err
    assert {p.name for p in (tmp_path / "out").iterdir()} - {".lock"} == FILES
    assert {p.name: p.read_bytes() for p in finished_run.iterdir()} == before


def test_json_on_stdout_is_the_file_and_a_function_of_the_seed(
    finished_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--candidates", "dhr", "--theta-i", "75", "--draws", "40", "--json", "--quiet"]
    shown = []
    for name, number in (("a", 1), ("b", 1)):
        assert (
            run("design", finished_run, *options, "--seed", number, "--out", tmp_path / name) == 0
        )
        captured = capsys.readouterr()
        assert captured.err == ""
        shown.append(json.loads(captured.out))
        assert shown[-1] == json.loads((tmp_path / name / "design.json").read_text("utf-8"))
    assert shown[0] == shown[1]


def test_design_before_any_reading(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toml = tmp_path / "priors.toml"
    toml.write_text(
        '[priors]\nn = { kind = "normal", mean = 1.5, sd = 0.05, low = 1.3, high = 1.7 }\n'
    )
    assert (
        run("design", "--config", toml, *FEW, "--theta-r=-60:60:20", "--out", tmp_path / "out") == 0
    )
    assert "Before any reading, from the priors alone" in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "design.json").read_text(encoding="utf-8"))
    assert found["run"] is None
    assert found["sd_before"]["n"] == pytest.approx(0.05, rel=0.2)
    assert "Before any reading" in (tmp_path / "out" / "design.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--candidates", "dhrr"], ["'dhrr' is not known", "Did you mean"]),
        (["--candidates", "none.csv"], ["none.csv", "no such file"]),
        (["--goal", "dhr:x:70"], ["goal 'dhr:x:70' is not known", "ratio:THETA_I:THETA_R"]),
        (["--goal", "dhr:s:95"], ["'95' is no angle in [0, 89.95]"]),
        (["--about", "nn"], ["'nn' is not inferred", "rho0"]),
        (["--minutes", "2"], ["minutes = 2 is not enough", "takes 3 min"]),
        (["--minutes", "0"], ["above 0"]),
        (["--scan-minutes", "x"], ["above 0"]),
        (["--batch", "0"], ["batch = 0", "[1, 20]"]),
        (["--draws", "5"], ["draws = 5 (--draws) is not allowed", "[25, 50000]"]),
        (["--draws", "50000"], ["draws", "--accuracy"]),
        (["--theta-i", "95"], ["theta_i_deg = 95.0", "[0, 89.95]"]),
        (["--theta-i", ""], ["no candidate"]),
        (["--port-deg", "80"], ["port_deg = 80.0"]),
        (["--config", "a.toml"], ["not both"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_two_and_nothing_is_written(
    finished_run: Path, options: list[str], words: list[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert run("design", finished_run, *options, "--quiet", "--out", "out") == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert [word for word in words if word not in shown.err] == []
    assert not {p.name for p in tmp_path.rglob("*")} - {"out", ".lock"}


def test_neither_a_run_nor_priors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("design") == 2
    assert "give a run folder, or --config TOML" in capsys.readouterr().err
    assert run("design", tmp_path) == 2
    assert "not a finished run" in capsys.readouterr().err


def test_another_folder_is_not_written_over(
    finished_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert run("design", finished_run, "--out", tmp_path) == 2
    assert "holds something else (notes.txt)" in capsys.readouterr().err


def test_a_folder_in_use_is_refused(own_run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (own_run / "design.json").read_bytes()
    with locked(own_run):
        assert run("design", own_run, *FEW) == 2
    assert "another process is writing this run" in capsys.readouterr().err
    assert (own_run / "design.json").read_bytes() == before


def test_many_candidates_are_screened(
    finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are listed; only the promising ones are simulated."""
    monkeypatch.setattr("pbrdf_bayes.design.run._MOST_EVALUATED", 12)
    many = tmp_path / "many.csv"
    lines = [f"dhr,{'sp'[i % 2]},{80.0 * i / 1000:.4f}" for i in range(1000)]
    many.write_text("quantity,polarization,theta_i_deg\n" + "\n".join(lines) + "\n")
    options = ["--candidates", many, "--draws", "40", "--quiet", "--out", tmp_path / "out"]
    assert run("design", finished_run, *options) == 0
    found = json.loads((tmp_path / "out" / "design.json").read_text(encoding="utf-8"))
    assert (found["n_candidates"], found["n_evaluated"]) == (1000, 12)
    rows = found["candidates"]
    assert len(rows) == 1000
    assert all(row["eig_nats"] is None for row in rows[12:])
    assert "988 of 1000 candidates were only screened" in best_table(found)
    linear = [row["linear_nats"] for row in rows[12:]]
    assert linear == sorted(linear, reverse=True)


def test_in_python_it_is_the_same(finished_run: Path) -> None:
    analysis = load_analysis(finished_run)
    one = [pb.Candidate("dhr", "p", 75.0, minutes=2.0)]
    found = pb.design_next(analysis, candidates=one, goals=("dhr:s:70",), draws=40)
    assert [row["label"] for row in found["candidates"]] == ["DHR_p at 75°"]
    assert found["candidates"][0]["p_best"] == 1.0
    assert "DHR_s(70°)" in found["sd_before"]
    before = pb.design_next(RunConfig(), candidates=one, draws=40)
    assert before["run"] is None
    with pytest.raises(pb.ConfigError, match="auto needs readings"):
        pb.design_next(RunConfig(effects=("auto",)), candidates=one)
