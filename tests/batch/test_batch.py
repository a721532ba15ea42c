"""Many samples, with real files and real processes: nothing lost, nothing done twice."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Timer
from typing import ClassVar

import numpy as np
import psutil
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.batch import executors
from pbrdf_bayes.batch import run as batch_run
from pbrdf_bayes.batch import work as batch_work
from pbrdf_bayes.batch.executors import Crew
from pbrdf_bayes.batch.index import harmless, write_index
from pbrdf_bayes.batch.outcome import failed_row, finished_row
from pbrdf_bayes.batch.plan import Job, in_order, plan_batch
from pbrdf_bayes.batch.run import Progress
from pbrdf_bayes.batch.work import Task, finished_before, is_own_report, note_report, run_task
from pbrdf_bayes.cli import main
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.checkpoint import write_checkpoint
from pbrdf_bayes.report.figures.batch import nice_ticks
from pbrdf_bayes.verbs.terminal import sample_line, teller

COMMAND = [sys.executable, "-m", "pbrdf_bayes", "batch"]
HEADER = "sample,wavelength_um,quantity,polarization,theta_i_deg,theta_r_deg,value"
FITTED = ["../../escape", "<script>alert(1)</script>", "=1+1", "Lot"]
DONE = " s)"
"""In the line that says that a sample is done."""
LIMITS = """rule = "simple"
[[limit]]
name = "roughness"
parameter = "rho0"
"""
HOSTILE = [
    "../../escape", "a/b", "CON", "<script>alert(1)</script>", "'\"; rm -rf ~", "=1+1", "Lot",
    "lot", "l\u043et", "..", "n" * 200,
]  # fmt: skip
"""Names that a file may have."""


def rows_of(name: str, seed: int) -> list[str]:
    m = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=seed, theta_i_deg=(20.0, 60.0), theta_r_deg=np.linspace(-80, 80, 21),
        dhr_theta_i_deg=(10.0, 40.0, 70.0), sample="simulated",
    )  # fmt: skip
    quoted = '"' + name.replace('"', '""') + '"'
    lines = [
        f"{quoted},3.39,brdf,{q},{a:g},{t:g},{v:.6g}"
        for q, a, t, v in zip(
            m.brdf.polarization, m.brdf.theta_i_deg, m.brdf.theta_r_deg, m.brdf.value, strict=True
        )
    ]
    return lines + [
        f"{quoted},3.39,dhr,{q},{a:g},,{v:.6g}"
        for q, a, v in zip(m.dhr.polarization, m.dhr.theta_i_deg, m.dhr.value, strict=True)
    ]


def write_samples(path: Path, names: list[str], seed: int = 1) -> Path:
    lines = [line for i, name in enumerate(names) for line in rows_of(name, seed + i)]
    path.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Options of runs that are as short as they can be."""
    config = tmp_path_factory.mktemp("config") / "quick.toml"
    config.write_text('holdout = "none"\nnoise = "iid"\n')
    return ["--config", str(config), "--accuracy", "draft"]


def index_of(out: Path) -> dict:
    return json.loads((out / "index.json").read_text(encoding="utf-8"))


def statuses(out: Path) -> dict[str, str]:
    return {row["sample"]: row["status"] for row in index_of(out)["samples"]}


@pytest.fixture(scope="module")
def finished(tmp_path_factory, quick) -> Path:
    """Folder with a batch of hostile names, one bad sample and one bad file; never changed."""
    home = tmp_path_factory.mktemp("batch")
    good = write_samples(home / "good.csv", FITTED)
    lines = good.read_text(encoding="utf-8").splitlines()
    (home / "good.csv").write_text("\n".join([*lines, "bad,3.39,brdf,s,20,5,-1", ""]), "utf-8")
    write_samples(home / "twice.csv", ["lot"], seed=77)
    (home / "broken.csv").write_text("nothing;here\n1;2\n")
    (home / "limits.toml").write_text(f"{LIMITS}lower = 0.2\nupper = 0.8\n")
    (home / "document.toml").write_text('laboratory = "Laboratory <1>"\n')
    papers = ["--limits", str(home / "limits.toml"), "--document", str(home / "document.toml")]
    names = ["good.csv", "twice.csv", "broken.csv", "absent.csv"]
    done = subprocess.run(
        [*COMMAND, *(str(home / n) for n in names), "--out", str(home / "out"), *quick, *papers,
         "--workers", "2"], capture_output=True, text=True, check=False, cwd=home,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{home / 'out'}\n"
    said = [line for line in done.stderr.splitlines() if line.startswith("[")]
    assert [line.split("]")[0] for line in said] == ["[3/8"] * 3 + [f"[{i}/8" for i in range(4, 9)]
    assert all(line.endswith(" left") for line in said[3:-1])
    assert not list((home / "out").glob(".batch*"))
    return home


def test_every_sample_has_a_row(finished):
    index = index_of(finished / "out")
    assert index["finished"]
    rows = index["samples"]
    assert [row["sample"] for row in rows] == [*FITTED, "bad", "lot", "broken.csv", "absent.csv"]
    good = [row for row in rows if row["status"] == "done"]
    assert len(good) == len(FITTED) + 1
    for row in good:
        assert row["verdict"] in ("PASS", "WARN", "FAIL")
        run = json.loads((finished / "out" / row["run"] / "summary.json").read_text("utf-8"))
        assert run["sample"] == row["sample"]
        for name, record in row["parameters"].items():
            assert record["mean"] == run["parameters"][name]["mean"]
    errors = {row["sample"]: row["error"] for row in rows if row["status"] == "failed"}
    assert "column value" in errors["bad"]
    assert (
        "noise floor (brdf_floor in the file of --config, or check --brdf-floor)" in errors["bad"]
    )
    assert "check:" not in errors["bad"]
    assert "no such file" in errors["absent.csv"]


def test_nothing_is_written_outside(finished):
    outside = sorted(p.name for p in finished.iterdir())
    assert outside == [
        "broken.csv", "document.toml", "good.csv", "limits.toml", "out", "twice.csv",
    ]  # fmt: skip
    runs = [p for p in (finished / "out").iterdir() if p.is_dir()]
    assert len({p.name.lower() for p in runs}) == len(FITTED) + 1


def test_the_index_is_harmless(finished):
    page = (finished / "out" / "index.html").read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page
    assert "http" not in page.replace("http-equiv", "")
    with (finished / "out" / "index.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["sample"] for row in table][2] == "'=1+1"
    active = [c for row in table for c in row.values() if c[:1] in ("=", "+", "-", "@", "\t")]
    assert all(float(cell) < 0.0 for cell in active)


def test_resume_skips_what_is_done(finished, tmp_path, quick, capsys, signals_as_before):
    out, names = finished / "out", ("good.csv", "twice.csv")
    before = {p: p.stat().st_mtime_ns for p in out.glob("*/summary.json")}
    files = [str(finished / name) for name in names]
    assert main(["batch", *files, "--out", str(out), *quick]) == 2
    assert "not empty" in capsys.readouterr().err
    options = [*files, "--out", str(out), *quick, "--resume", "--quiet"]
    assert main(["batch", *options]) == 0
    assert set(statuses(out).values()) == {"skipped", "failed"}
    assert {p: p.stat().st_mtime_ns for p in out.glob("*/summary.json")} == before
    assert main(["batch", *options, "--strict"]) == 4


def test_every_sample_is_judged(finished, tmp_path, quick, capsys, signals_as_before):
    """When it is fitted; by other limits without fitting it again; bad limits start nothing."""
    out = Path(shutil.copytree(finished / "out", tmp_path / "out"))
    rows = [row for row in index_of(out)["samples"] if row["status"] != "failed"]
    for row in rows:
        summary = json.loads((out / row["run"] / "summary.json").read_text("utf-8"))
        found = summary["conformity"]
        assert row["conformity"] == found["verdict"]
        if any(limit["judged"] for limit in found["limits"]):
            assert row["p_conformity"] == found["probability"]["value"]
            assert row["consumer_risk"] == found["consumer_risk"]
            assert row["producer_risk"] == found["producer_risk"]
        assert summary["document"]["laboratory"] == "Laboratory <1>"
        draws = pb.load_analysis(out / row["run"]).draws["posterior"]["rho0"].values
        if row["verdict"] != "FAIL" and summary["parameters"]["rho0"]["identified"]:
            assert row["conformity"] == ("ACCEPT" if 0.2 <= draws.mean() <= 0.8 else "REJECT")
    assert "ACCEPT" in {row["conformity"] for row in rows}
    page = (out / "index.html").read_text("utf-8")
    assert ">Conformity<" in page
    assert "Laboratory &lt;1&gt;" in (out / rows[0]["run"] / "report.html").read_text("utf-8")

    limits = tmp_path / "other.toml"
    limits.write_text(f"{LIMITS}upper = 0.1\n")
    options = [str(finished / "good.csv"), "--out", str(out), *quick, "--resume", "--quiet"]
    assert main(["batch", *options, "--limits", str(limits)]) == 0
    good = write_samples(tmp_path / "good.csv", FITTED)
    strict = [str(good), *options[1:], "--limits", str(limits), "--strict"]
    assert main(["batch", *strict]) == 4
    assert not any(row["verdict"] == "FAIL" for row in index_of(out)["samples"])
    assert {row["status"] for row in index_of(out)["samples"]} == {"skipped"}
    assert main(["batch", *options, "--limits", str(limits)]) == 0
    again = {row["run"]: row for row in index_of(out)["samples"] if row["run"]}
    assert len(again) == len(FITTED)
    for row in rows:
        if row["run"] in again:
            assert again[row["run"]]["parameters"] == row["parameters"]
            assert again[row["run"]]["status"] == "skipped"
            if row["conformity"] == "ACCEPT":
                assert again[row["run"]]["conformity"] == "REJECT"

    limits.write_text(LIMITS.replace("rho0", "rho") + "upper = 1\n")
    bad = [str(finished / "good.csv"), "--out", str(tmp_path / "none"), "--limits", str(limits)]
    assert main(["batch", *bad]) == 2
    assert "other.toml" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_every_sample_is_held_against_a_reference(
    finished, finished_run, tmp_path, quick, capsys, signals_as_before
):
    """The run of another sample; what is wrong with it is said before anything is computed."""
    out = Path(shutil.copytree(finished / "out", tmp_path / "out"))
    limits = tmp_path / "shade.toml"
    limits.write_text('[[difference]]\nname = "dn"\nparameter = "n"\ntolerance = 0.5\n')
    options = [str(finished / "good.csv"), "--out", str(out), *quick, "--resume", "--quiet"]
    assert main(["batch", *options, "--limits", str(limits)]) == 2
    assert "give the run folder of the other with --reference" in capsys.readouterr().err
    papers = ["--limits", str(limits), "--reference"]
    assert main(["batch", *options, *papers, str(tmp_path / "absent")]) == 2
    assert main(["batch", *options, "--reference", str(finished_run)]) == 2
    assert "without any [[difference]]" in capsys.readouterr().err

    assert main(["batch", *options, *papers, str(finished_run)]) == 0
    index = index_of(out)
    judged = [row for row in index["samples"] if row["run"]]
    assert len(judged) == len(FITTED)
    name = json.loads((finished_run / "summary.json").read_text("utf-8"))["sample"]
    for row in judged:
        found = json.loads((out / row["run"] / "summary.json").read_text("utf-8"))["conformity"]
        assert found["reference"]["sample"] == name
        assert row["conformity"] == found["verdict"]
    before = {row["run"]: (out / row["run"] / "report.html").stat().st_mtime_ns for row in judged}
    assert main(["batch", *options, *papers, str(finished_run)]) == 0
    after = {run: (out / run / "report.html").stat().st_mtime_ns for run in before}
    assert after == before  # judged by the same limits and reference: nothing is made again


def test_a_reference_of_another_wavelength_is_refused_before_the_fit(
    finished_run, tmp_path, quick, signals_as_before
):
    lines = write_samples(tmp_path / "a.csv", ["lot"]).read_text("utf-8").splitlines()
    text = "\n".join([lines[0], *(line.replace(",3.39,", ",0.65,") for line in lines[1:]), ""])
    (tmp_path / "a.csv").write_text(text, "utf-8")
    (tmp_path / "l.toml").write_text(
        '[[difference]]\nname = "dn"\nparameter = "n"\ntolerance = 1\n'
    )
    papers = ["--limits", str(tmp_path / "l.toml"), "--reference", str(finished_run)]
    out = tmp_path / "out"
    assert main(["batch", str(tmp_path / "a.csv"), "--out", str(out), *quick, *papers]) == 0
    (row,) = index_of(out)["samples"]
    assert row["status"] == "failed"
    assert "Give a reference of the same wavelength" in row["error"]
    assert not list(out.glob("*/summary.json"))


def test_what_is_judged_by_the_same_limits_is_not_judged_again(
    finished, tmp_path, quick, monkeypatch, signals_as_before
):
    """Nor is its time forgotten; with another document the report of each is made again."""
    out = Path(shutil.copytree(finished / "out", tmp_path / "out"))
    limits = tmp_path / "moved.toml"
    shutil.copy(finished / "limits.toml", limits)
    before = index_of(out)["samples"]
    handed: list[str] = []

    class Recording(Immediate):
        def submit(self, fn, task):
            handed.append(task.job.sample)
            future: Future = Future()
            future.set_result(run_task(task))
            return future

    crew = batch_crew(Crew(lambda _: Recording(), 1, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    options = [str(finished / "good.csv"), "--out", str(out), *quick, "--resume", "--quiet"]
    papers = ["--limits", str(limits), "--document", str(finished / "document.toml")]
    assert main(["batch", *options, *papers]) == 0
    assert handed == []
    for row, was in zip(index_of(out)["samples"], before, strict=False):
        if was["status"] == "done":
            assert row["conformity"] == was["conformity"]
            assert row["seconds"] == pytest.approx(was["seconds"], rel=0.3)
    other = tmp_path / "other.toml"
    other.write_text('laboratory = "Another"\n')
    assert main(["batch", *options, *papers[:3], str(other)]) == 0
    assert handed == FITTED
    summary = json.loads((out / before[0]["run"] / "summary.json").read_text("utf-8"))
    assert summary["document"]["laboratory"] == "Another"


@pytest.mark.parametrize("how", ["report", "conform", "pdf"])
def test_a_report_that_was_issued_since_is_kept(
    finished, tmp_path, quick, capsys, signals_as_before, how
):
    """Not a byte of it changes, and the index says what it says; without it the batch's is made."""
    out = Path(shutil.copytree(finished / "out", tmp_path / "out"))
    before = index_of(out)["samples"]
    run = out / before[0]["run"]
    document, other = tmp_path / "issued.toml", tmp_path / "other.toml"
    document.write_text('report_number = "L-1/A"\nlaboratory = "Issued"\n')
    other.write_text(f"{LIMITS}upper = 0.1\n")
    if how == "report":
        assert main(["report", str(run), "--document", str(document)]) == 0
    elif how == "conform":
        assert main(["conform", str(run), "--limits", str(other), "--save"]) == 0
    else:
        (run / "report.pdf").write_bytes(b"%PDF")
    papers = ["--limits", str(finished / "limits.toml"), "--document",
              str(finished / "document.toml")]  # fmt: skip
    options = [str(finished / "good.csv"), "--out", str(out), *quick, "--resume"]
    moved = [*papers[:3], str(document)] if how == "pdf" else papers
    document.write_text('laboratory = "Moved"\n')
    issued = {p.name: p.read_bytes() for p in run.iterdir() if p.is_file()}
    capsys.readouterr()
    assert main(["batch", *options, *moved]) == 0
    assert {p.name: p.read_bytes() for p in run.iterdir() if p.is_file()} == issued
    row, *others = index_of(out)["samples"]
    summary = json.loads(issued["summary.json"])
    assert row["conformity"] == summary["conformity"]["verdict"]
    assert (row["conformity"] == before[0]["conformity"]) == (how != "conform")
    assert "made by other means" in row["notice"]
    assert not any(one["notice"] for one in others)
    assert "made by other means" in (out / "index.html").read_text("utf-8")
    assert "made by other means" in (out / "index.csv").read_text("utf-8")
    assert "made by other means" in capsys.readouterr().err

    for name in ("report.html", "report.pdf"):
        (run / name).unlink(missing_ok=True)
    assert main(["batch", *options, *moved, "--quiet"]) == 0
    row = index_of(out)["samples"][0]
    assert row["notice"] is None
    assert row["conformity"] == before[0]["conformity"]
    laboratory = "Moved" if how == "pdf" else "Laboratory &lt;1&gt;"
    assert laboratory in (run / "report.html").read_text("utf-8")


def test_a_damaged_note_protects_the_report(tmp_path):
    (tmp_path / "report.html").write_text("made by the batch")
    assert is_own_report(tmp_path)
    note_report(tmp_path)
    assert is_own_report(tmp_path)
    (tmp_path / ".batch_report").write_bytes(b"\xff\x00")
    assert not is_own_report(tmp_path)


@pytest.mark.parametrize("how", ["missing", "cut", "altered", "issued"])
def test_a_damaged_run_is_fitted_again_and_the_row_says_why(how, tmp_path):
    """But for one whose report was made by other means: it is kept, and the sample has failed."""
    file = write_samples(tmp_path / "one.csv", ["one"])
    config = pb.RunConfig(accuracy="draft", holdout="none", noise="iid", threads=1)
    (job,) = plan_batch([file], config, seed=1)
    out = tmp_path / "out"
    out.mkdir()
    task = Task(job, out, config, 1, batch_work.leave_mark(out))
    assert run_task(task)["status"] == "done"
    assert finished_before(out, job, task.paperwork)["status"] == "skipped"
    stored = out / job.folder / "posterior.nc"
    content = stored.read_bytes()
    stored.unlink()
    if how != "missing":
        stored.write_bytes(content[:-1] if how == "cut" else bytes([content[0] ^ 1]) + content[1:])
    if how == "issued":
        (out / job.folder / "report.html").write_text("issued")
        row = finished_before(out, job, task.paperwork)
        assert row["status"] == "failed"
        assert "made by other means" in row["error"]
        return
    assert finished_before(out, job, task.paperwork) is None
    row = run_task(task)
    assert row["status"] == "done"
    assert "posterior.nc" in row["notice"]
    assert "fitted again" in row["notice"]
    assert stored.read_bytes() == content
    assert finished_before(out, job, task.paperwork)["notice"] is None


def test_a_link_out_of_the_folder_is_refused(tmp_path, quick, capsys, signals_as_before):
    file = write_samples(tmp_path / "one.csv", ["one"])
    out, outside = tmp_path / "out", tmp_path / "outside"
    outside.mkdir()
    out.mkdir()
    (out / "index.json").write_text("{}")
    config = batch_run.replace(
        pb.RunConfig(accuracy="draft", holdout="none", noise="iid"), threads=1
    )
    (job,) = plan_batch([file], config, seed=1)
    (out / job.folder).symlink_to(outside)
    assert main(["batch", str(file), "--out", str(out), *quick, "--resume", "--quiet"]) == 0
    (row,) = index_of(out)["samples"]
    assert row["status"] == "failed"
    assert "symbolic link" in row["error"]
    assert list(outside.iterdir()) == []
    (out / ".lock").unlink()
    (out / ".lock").symlink_to(outside / "made")
    assert main(["batch", str(file), "--out", str(out), *quick, "--resume", "--quiet"]) == 2
    assert ".lock: is a symbolic link, which is not followed" in capsys.readouterr().err
    assert list(outside.iterdir()) == []
    assert (
        main(
            ["batch", str(file), "--out", str(outside / "x"), "--workers", "2", "--scheduler", "a"]
        )
        == 2
    )
    assert "Give one of them" in capsys.readouterr().err


def start(files: list[Path], out: Path, *options: str, until: str) -> subprocess.Popen[str]:
    """A batch that has said a line with that text."""
    process = subprocess.Popen(
        [*COMMAND, *map(str, files), "--out", str(out), *options], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if until in line:
            return process
    pytest.fail(f"the batch ended before it said {until!r}")


def workers_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Its workers, once there are two."""
    deadline = time.monotonic() + 60.0
    found: list[psutil.Process] = []
    while len(found) < 2 and time.monotonic() < deadline:
        children = psutil.Process(process.pid).children(recursive=True)
        found = [p for p in children if "spawn_main" in " ".join(p.cmdline())]
        time.sleep(0.05)
    return found


def test_interrupted_resumed_and_a_worker_killed_nothing_is_lost(tmp_path, quick):
    """One batch through all of it, for each start of a process takes seconds."""
    names = [f"lot {i}" for i in range(6)]
    file, out = write_samples(tmp_path / "many.csv", names), tmp_path / "out"
    process = start([file], out, *quick, "--workers", "2", until=DONE)
    children = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "--resume" in said
    assert "Traceback" not in said
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []
    before = statuses(out)
    assert 1 <= len(before) < 6
    assert not index_of(out)["finished"]

    process = start([file], out, *quick, "--workers", "2", "--resume", until=DONE)
    workers_of(process)[0].send_signal(signal.SIGKILL)
    process.communicate(timeout=120)
    assert process.returncode == 0
    after = statuses(out)
    assert list(after) == names
    assert all(after[name] == "skipped" for name in before)
    assert set(after.values()) <= {"done", "skipped"}
    assert len(list(out.glob("*/summary.json"))) == 6


def test_when_the_parent_is_killed_its_workers_end(tmp_path, quick):
    file = write_samples(tmp_path / "many.csv", [f"lot {i}" for i in range(6)])
    process = start([file], tmp_path / "out", *quick, "--workers", "2", until=DONE)
    children = workers_of(process)
    assert len(children) == 2
    process.kill()
    process.communicate()
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []
    assert index_of(tmp_path / "out")["n_samples"] == 6


class Deadly(Executor):
    """Breaks, as a pool does, when a given sample is handed to it; all in hand are lost."""

    def __init__(self, deadly: str, log: list[str]) -> None:
        self.deadly, self.log, self.broken = deadly, log, False
        self.pending: list[tuple[Future, object]] = []

    def submit(self, fn, task):  # type: ignore[override]
        future: Future = Future()
        self.pending.append((future, task))
        self.broken |= task.job.sample == self.deadly
        if self.broken:
            for waiting, _ in self.pending:
                waiting.set_exception(BrokenProcessPool("died"))
            self.pending.clear()
        elif len(self.pending) == 2 or task.job.sample == "z":
            for waiting, one in self.pending:
                self.log.append(one.job.sample)
                waiting.set_result(fitted(one))
            self.pending.clear()
        return future


def row_of(job):
    summary = {
        "status": "done", "verdict": "PASS", "headline": "", "parameters": {},
        "fit": {"rms_dex_best": {"overall": 0.01}},
    }  # fmt: skip
    return finished_row(job, summary, status="done", seconds=0.1)


def fitted(task):
    """What a worker leaves and says."""
    folder = task.out / task.job.folder
    folder.mkdir()
    (folder / "summary.json").write_text("{}")
    return row_of(task.job)


def test_a_sample_that_kills_its_process_twice_is_listed(tmp_path, monkeypatch):
    """The others that were in hand with it are computed, each once."""
    names = ["a", "b", "c", "deadly", "y", "z"]
    file = write_samples(tmp_path / "many.csv", names)
    log: list[str] = []

    class Alone(Deadly):
        def submit(self, fn, task):
            future = super().submit(fn, task)
            for waiting, one in self.pending:
                log.append(one.job.sample)
                waiting.set_result(fitted(one))
            self.pending.clear()
            return future

    def pool(n_workers: int) -> Executor:
        return Deadly("deadly", log) if n_workers > 1 else Alone("deadly", log)

    crew = Crew(pool, 2, lambda _: None)
    monkeypatch.setattr(batch_run, "_crew", lambda *_: batch_crew(crew))
    told: list[Progress] = []
    found = batch_run.fit_batch([file], out=tmp_path / "out", told=told.append)
    assert all(len(one.running) <= one.n_workers for one in told)
    after = [one for one in told if one.n_done]
    assert [one.seconds_left == 0.0 for one in after] == [one.n_done == 6 for one in after]
    assert {row["sample"]: row["status"] for row in found.samples} == {
        name: "failed" if name == "deadly" else "done" for name in names
    }
    assert sorted(log) == ["a", "b", "c", "y", "z"]
    assert "died twice" in found.samples[3]["error"]
    assert not found.is_clean


class batch_crew:  # noqa: N801 - stands for a function
    def __init__(self, crew: Crew) -> None:
        self.crew = crew

    def __enter__(self) -> Crew:
        return self.crew

    def __exit__(self, *_: object) -> None:
        """Nothing to end."""


def test_any_name_has_a_safe_folder_of_its_own(tmp_path):
    file = write_samples(tmp_path / "a.csv", [*HOSTILE, *FITTED])
    jobs = plan_batch([file], pb.RunConfig(), seed=1)
    folders = [job.folder.lower() for job in jobs if job.measurement is not None]
    assert len(set(folders)) == len(folders) == len({*HOSTILE, *FITTED})
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9._-]{0,110}", name) for name in folders)
    names = ["n" * 300, "bell\a", "fine", "n" * 301, "n" * 1001]
    jobs = plan_batch([write_samples(tmp_path / "long.csv", names)], pb.RunConfig(), seed=1)
    assert [bool(job.error) for job in jobs] == [False, True, False, False, True]
    assert [job.sample for job in jobs] == names
    assert jobs[0].folder != jobs[3].folder
    assert all(len(job.folder) <= 110 for job in jobs)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("lot_1 lot_10 lot_2 lot_3", "lot_1 lot_2 lot_3 lot_10"),  # LC_ALL=C
        ("lot_10.csv lot_1.csv lot_2.csv", "lot_1.csv lot_2.csv lot_10.csv"),  # en_US.UTF-8
        ("A_10 a_2 B_1", "a_2 A_10 B_1"),
        ("lot_3 lot_1 lot_2 lot_10", "lot_3 lot_1 lot_2 lot_10"),
        ("b a", "b a"),
        ("2026-03-02/p10 2026-03-02/p9 2026-11-01/p1", "2026-03-02/p9 2026-03-02/p10 2026-11-01/p1"),
    ],
)  # fmt: skip
def test_files_that_a_shell_has_sorted_come_by_their_numbers(given, wanted):
    assert [
        str(file) for file in in_order([Path(name) for name in given.split()])
    ] == wanted.split()


def test_failed_samples_keep_their_place(tmp_path):
    """In the order of the file, whatever is wrong with them; a row of no sample is one as well."""
    rows = [*rows_of("one", 1), "two,3.39,brdf", *rows_of("three", 3), ",3.39,brdf,s,20,5,1",
            "four,3.39,brdf,s,20,5,-1", *rows_of("five", 5)]  # fmt: skip
    file = tmp_path / "lots.csv"
    file.write_text("\n".join([HEADER, *rows]) + "\n")
    jobs = plan_batch([file], pb.RunConfig(), seed=1)
    line = 2 + rows.index(",3.39,brdf,s,20,5,1")
    assert [(job.sample, bool(job.measurement)) for job in jobs] == [
        ("one", True), ("two", False), ("three", True), (f"lots.csv, line {line}", False),
        ("four", False), ("five", True),
    ]  # fmt: skip


def test_a_file_that_has_grown_does_not_stop_an_interrupted_sample(
    tmp_path, quick, signals_as_before
):
    """Its readings are the same; what was stored under the file's old hash is begun again."""
    config = pb.RunConfig(accuracy="draft", holdout="none", noise="iid", threads=1)
    file, out = write_samples(tmp_path / "a.csv", ["one"]), tmp_path / "out"
    (job,) = plan_batch([file], config, seed=1)
    assert job.measurement is not None
    stored = out / job.folder / "checkpoint_sample.npz"
    stored.parent.mkdir(parents=True)
    (out / "index.json").write_text("{}")
    write_checkpoint(stored, {"z": np.zeros(3)}, {"data": job.measurement.sha256, "seed": 1})
    written = stored.read_bytes()
    options = ["--out", str(out), *quick, "--resume", "--quiet"]
    assert main(["batch", str(file), *options]) == 0
    (row,) = index_of(out)["samples"]
    assert "is a checkpoint of something else" in row["error"]  # of the same file: of what else?
    assert stored.read_bytes() == written
    file.write_text(file.read_text() + "two,3.39,brdf,s,20,5,-1\n")
    assert main(["batch", str(file), *options]) == 0
    one, two = index_of(out)["samples"]
    assert (one["status"], two["status"]) == ("done", "failed")
    assert one["run"] == job.folder
    assert not stored.exists()


def test_folders_are_a_function_of_what_a_run_is_made_from(tmp_path):
    file = write_samples(tmp_path / "a.csv", ["one", "two"])
    config = pb.RunConfig(accuracy="draft")
    first = [job.folder for job in plan_batch([file], config, seed=1)]
    assert first == [job.folder for job in plan_batch([file], config, seed=1)]
    changed = [
        plan_batch([file], config, seed=2),
        plan_batch([file], pb.RunConfig(accuracy="standard"), seed=1),
    ]
    more = write_samples(tmp_path / "a.csv", ["one", "two", "three"])
    assert [job.folder for job in plan_batch([more], config, seed=1)][:2] == first
    assert all({j.folder for j in jobs}.isdisjoint(first) for jobs in changed)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for spelled in (
        tmp_path / "elsewhere" / ".." / "a.csv",
        shutil.copy(more, elsewhere / "b.csv"),
    ):
        assert [job.folder for job in plan_batch([spelled], config, seed=1)][:2] == first
    steps = pb.RunConfig(accuracy="draft", max_steps=99_999, threads=7)
    assert [job.folder for job in plan_batch([file], steps, seed=1)][:2] == first


class Immediate(Executor):
    """Has every sample done as soon as it is handed over."""

    def __init__(self, **found: object) -> None:
        self.found, self.asked = found, []

    def submit(self, fn, task):  # type: ignore[override]
        self.asked.append(task.job.sample)
        future: Future = Future()
        future.set_result({**fitted(task), **self.found})
        return future


def test_the_same_readings_are_fitted_and_counted_once(
    tmp_path, monkeypatch, capsys, signals_as_before
):
    """The file twice, and its readings under another name; the same name is no repeat."""
    file = write_samples(tmp_path / "a.csv", ["one", "two"])
    copied = [line.replace('"one"', '"uno"') for line in rows_of("one", 1)]
    (tmp_path / "b.csv").write_text("\n".join([HEADER, *copied, *rows_of("two", 9)]) + "\n")
    pool = Immediate()
    crew = batch_crew(Crew(lambda _: pool, 2, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    files = [str(file), str(tmp_path / "." / "b.csv"), str(file)]
    out = tmp_path / "out"
    assert main(["batch", *files, "--out", str(out), "--strict"]) == 0
    assert pool.asked == ["one", "two", "two"]
    rows = index_of(out)["samples"]
    assert [row["sample"] for row in rows] == ["one", "two", "uno", "two", "one", "two"]
    assert [row["repeat_of"] for row in rows] == [None, None, 1, None, 1, 2]
    assert [row["status"] for row in rows] == ["done", "done", "skipped", "done", *["skipped"] * 2]
    said = capsys.readouterr().err
    assert said.count("warning: the readings are those of No. 1 to the last digit") == 2
    assert "repeat of No. 1" in (out / "index.html").read_text("utf-8")
    quietly = ["--quiet", "--out", str(tmp_path / "again")]
    assert main(["batch", *files, *quietly]) == 0
    assert capsys.readouterr().err.count("warning: No. ") == 3


class Elsewhere(Immediate):
    """Its workers have a disk of their own, under the same path."""

    def __init__(self, home: Path, work: Callable[[Task], dict]) -> None:
        super().__init__()
        self.home, self.work = home, work

    def submit(self, fn, task):  # type: ignore[override]
        self.asked.append(task.job.sample)
        future: Future = Future()
        future.set_result(self.work(replace(task, out=self.home)))
        return future


@pytest.mark.parametrize(
    ("work", "said"),
    [(run_task, "does not see the folder of this batch"), (fitted, "is not to be seen from here")],
)
def test_what_a_worker_writes_elsewhere_is_not_done(
    tmp_path, monkeypatch, signals_as_before, work, said
):
    """Whether it is told before it fits, or only seen after that."""
    monkeypatch.setattr(batch_work, "SEEN_WITHIN", 0.3)
    file = write_samples(tmp_path / "a.csv", ["one", "two"])
    home, out = tmp_path / "home", tmp_path / "out"
    home.mkdir()
    crew = batch_crew(Crew(lambda _: Elsewhere(home, work), 1, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    assert main(["batch", str(file), "--out", str(out), "--quiet"]) == 0
    rows = index_of(out)["samples"]
    assert [row["status"] for row in rows] == ["failed", "failed"]
    assert all(said in row["error"] and "must share it" in row["error"] for row in rows)
    assert (list(home.iterdir()) == []) == (work is run_task)
    assert not (out / ".batch").exists()


def test_workers_that_do_not_see_the_folder_start_nothing(
    tmp_path, monkeypatch, capsys, signals_as_before
):
    file, out = write_samples(tmp_path / "a.csv", ["one"]), tmp_path / "out"
    pool = Immediate()

    def blind(folder: Path, mark: str) -> list[str]:
        assert (folder, (folder / ".batch").read_text()) == (out, mark)
        return ["tcp://b:1"]

    crew = batch_crew(Crew(lambda _: pool, 2, lambda _: None, blind=blind))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    assert main(["batch", str(file), "--out", str(out), "--quiet"]) == 2
    assert "1 of the workers do not see" in capsys.readouterr().err
    assert pool.asked == []


def test_a_file_that_shows_late_is_waited_for(tmp_path):
    mark = batch_work.leave_mark(tmp_path)
    assert batch_work.sees_mark(tmp_path, mark)
    Timer(
        0.4, lambda: fitted(Task(Job("a", "a.csv", folder="late"), tmp_path, None, 1, ""))
    ).start()
    assert batch_work.sees_run(tmp_path, "late")


def test_workers_that_come_later_are_used(tmp_path, monkeypatch, signals_as_before):
    """One at first and three after that: so many wait in hand, and one more at first."""
    file = write_samples(tmp_path / "a.csv", [f"lot {i}" for i in range(8)])
    in_hand: list[int] = []

    class Growing(Executor):
        pending: ClassVar[deque[tuple[Future, Task]]] = deque()

        def submit(self, fn, task):  # type: ignore[override]
            self.pending.append((Future(), task))
            return self.pending[-1][0]

    def count() -> int:
        in_hand.append(len(Growing.pending))
        if Growing.pending:
            future, task = Growing.pending.popleft()
            future.set_result(fitted(task))
        return 1 if len(in_hand) < 4 else 3

    crew = batch_crew(Crew(lambda _: Growing(), 1, lambda _: None, count=count))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    out = tmp_path / "out"
    assert main(["batch", str(file), "--out", str(out), "--quiet"]) == 0
    assert max(in_hand[:4]) == 2
    assert max(in_hand) == 3
    assert set(statuses(out).values()) == {"done"}


@pytest.mark.parametrize("decided", ["REJECT", "UNDECIDED", "ACCEPT"])
def test_strict_is_about_conformity_too(tmp_path, monkeypatch, signals_as_before, decided):
    file = write_samples(tmp_path / "a.csv", ["one"])
    crew = batch_crew(Crew(lambda _: Immediate(conformity=decided), 1, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    options = [str(file), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(["batch", *options, "--strict"]) == (0 if decided == "ACCEPT" else 4)


def wave_row(i: int, wavelength_um: float, n: float) -> dict[str, object]:
    """A row of the index; No. 2 has no result."""
    (job,) = (Job(f"lot {i}", "a.csv", wavelength_um),)
    if i == 2:
        return failed_row(job, "no readings")
    n_record = {
        "symbol": "n", "unit": "1", "kind": "physical", "mean": n, "sd": 0.01, "median": n,
        "q025": n - 0.0196, "q975": n + 0.0196, "identified": True,
    }  # fmt: skip
    return {**row_of(job), "parameters": {"n": n_record}}


def test_a_fixed_parameter_is_called_fixed(tmp_path):
    rows = [wave_row(i, 3.39, 1.5) for i in (1, 3)]
    for row in rows:
        row["parameters"]["n"] |= {"kind": "fixed", "sd": 0.0, "identified": False}
    write_index(tmp_path, rows, n_samples=2)
    page = (tmp_path / "index.html").read_text("utf-8")
    assert len(re.findall(r'1\.5<span class="what">fixed', page)) == 2
    assert "not identified" not in page


def test_every_wavelength_has_its_own_charts_and_spread(tmp_path):
    """Dispersion of a paint is no spread between its samples. Marks bear numbers of the table."""
    at = {3.39: [1.50, 1.52, 1.49, 1.51, 1.53], 10.6: [2.20, 2.21, 2.19, 2.22, 2.18]}
    pairs = [
        (w, n) for both in zip(*at.values(), strict=True) for w, n in zip(at, both, strict=True)
    ]
    pairs.insert(1, (3.39, 9.9))
    rows = [wave_row(i, w, n) for i, (w, n) in enumerate(pairs, start=1)]
    write_index(tmp_path, rows, n_samples=len(rows))
    index = index_of(tmp_path)
    assert index["between_samples"] is None
    assert [group["wavelength_um"] for group in index["by_wavelength"]] == [3.39, 10.6]
    for group, values in zip(index["by_wavelength"], at.values(), strict=True):
        record = group["parameters"]["n"]
        sigma = np.mean(np.abs(np.diff(values))) * np.sqrt(np.pi) / 2.0
        assert record["values"] == values
        assert record["chart"]["centre"] == pytest.approx(np.mean(values), rel=1e-12)
        assert record["chart"]["high"] == pytest.approx(np.mean(values) + 3.0 * sigma, rel=1e-12)
        assert record["spread"]["n"] == 5
        assert record["spread"]["sd_q975"] < 0.1  # of both together 0.35 and more
    page = (tmp_path / "index.html").read_text("utf-8")
    assert re.findall(r'<h3 class="wavelength">(.*?)</h3>', page) == ["3.39 µm", "10.6 µm"]
    charts = re.findall(r'<svg class="plot chart".*?</svg>', page, flags=re.DOTALL)
    marks = [re.findall(r'text-anchor="middle">(\d+)<', chart) for chart in charts]
    assert marks == [["1", "4", "6", "8", "10"], ["3", "5", "7", "9", "11"]]
    with (tmp_path / "index.csv").open(encoding="utf-8", newline="") as file:
        waves = [row["wavelength_um"] for row in csv.DictReader(file)]
    assert waves == [str(w) for w, _ in pairs]

    alone = [row for row in rows if row["wavelength_um"] == 3.39]
    write_index(tmp_path, alone, n_samples=len(alone))
    index = index_of(tmp_path)
    assert index["between_samples"] == index["by_wavelength"][0]["parameters"]
    assert 'class="wavelength"' not in (tmp_path / "index.html").read_text("utf-8")


def charted(tmp_path: Path, rows: list[dict[str, object]]) -> tuple[dict, str]:
    """Record of n in the index, and its chart."""
    write_index(tmp_path, rows, n_samples=len(rows))
    page = (tmp_path / "index.html").read_text("utf-8")
    (chart,) = re.findall(r'<svg class="plot chart".*?</svg>', page, flags=re.DOTALL)
    return index_of(tmp_path)["between_samples"]["n"], chart


def ticks(chart: str) -> list[float]:
    return [float(v.replace("\u2212", "-")) for v in re.findall(r'text-anchor="end">(.*?)<', chart)]


def test_a_number_that_is_not_identified_is_no_measurement(tmp_path):
    """It is the prior's: shown, and told why it does not count."""
    rows = [wave_row(i, 3.39, 1.5 + 0.01 * (i % 3)) for i in range(3, 11)]
    alone, _ = charted(tmp_path, rows)
    rows.insert(4, wave_row(20, 3.39, 2.4))
    rows[4]["parameters"]["n"]["identified"] = False
    record, chart = charted(tmp_path, rows)
    assert record["counted"] == [i != 4 for i in range(9)]
    assert record["why_not"][4] == "not identified"
    assert record["spread"] == alone["spread"]
    for key in ("centre", "low", "high"):
        assert record["chart"][key] == alone["chart"][key]
    assert "No. 5, lot 20: 2.4, beyond its limits, not identified: not in centre" in chart
    assert "do not identify n in 1 sample" in (tmp_path / "index.html").read_text("utf-8")


@pytest.mark.parametrize("how", ["failed", "uncertain", "outlier", "unidentified"])
def test_one_sample_does_not_stretch_the_axis(tmp_path, how):
    """What is further out is an arrow at the frame, and no mark or bar is outside it."""
    rows = [wave_row(i, 3.39, 1.5 + 0.01 * (i % 3)) for i in range(3, 12)]
    _, chart = charted(tmp_path, rows)
    usual = ticks(chart)
    odd = wave_row(20, 3.39, 1.5 if how == "uncertain" else 9.0)
    record = odd["parameters"]["n"]
    if how == "uncertain":
        record |= {"sd": 5.0, "q025": -8.3, "q975": 11.3}
    if how == "failed":
        odd["verdict"] = "FAIL"
    if how == "unidentified":
        record["identified"] = False
    _, chart = charted(tmp_path, [*rows[:5], odd, *rows[5:]])
    span = np.ptp(usual)
    assert min(usual) - 1.1 * span <= min(ticks(chart))
    assert max(ticks(chart)) <= max(usual) + 1.1 * span
    assert (" off" in chart) == (how != "uncertain")
    heights = [float(v) for v in re.findall(r'class="u" d="M[0-9.]+ (-?[0-9.]+)V', chart)]
    heights += [float(v) for v in re.findall(r'class="u" d="M[0-9.]+ -?[0-9.]+V(-?[0-9.]+)', chart)]
    assert min(heights) >= 10.0
    assert max(heights) <= 180.0


@pytest.mark.parametrize(("drift", "said"), [(0.02, "Trend: 0.0"), (0.0, "No trend is seen: ")])
def test_a_drift_is_told_below_the_chart(tmp_path, drift, said):
    scatter = [0.0, 0.004, -0.003, 0.005, -0.006, 0.002, 0.001, -0.004, 0.003]
    rows = [wave_row(i + 3, 3.39, 1.5 + drift * i + s) for i, s in enumerate(scatter)]
    record, _ = charted(tmp_path, rows)
    assert record["trend"]["seen"] == bool(drift)
    assert record["trend"]["slope_q025"] < drift < record["trend"]["slope_q975"]
    assert said in (tmp_path / "index.html").read_text("utf-8")


def test_what_cannot_be_seen_is_escaped(tmp_path, monkeypatch, capsys, signals_as_before):
    """Of refused names and of files, in the table and on the terminal; lines of a message stay."""
    crew = batch_crew(Crew(lambda _: Immediate(), 1, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    names = ["a\u202eb", "bell\a", "esc\x1b[2J", "line\nbreak", "ta\tb", "fine"]
    file = write_samples(tmp_path / "a\n\x1b[31m\u202eb.csv", names)
    undecodable = tmp_path / "\udcff.csv"
    out = tmp_path / "out"
    assert main(["batch", str(file), str(undecodable), "--out", str(out)]) == 0
    text = (out / "index.csv").read_text("utf-8")
    assert not any(c in text for c in "\u202e\a\x1b\t\r")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["sample"] for row in rows] == [
        "a\\u202eb", "bell\\x07", "esc\\x1b[2J", "line\\nbreak", "ta\\tb", "fine", "\\udcff.csv",
    ]  # fmt: skip
    assert {row["source"] for row in rows[:-1]} == {"a\\n\\x1b[31m\\u202eb.csv"}
    assert (
        rows[0]["error"].splitlines()[0].startswith(f"{tmp_path}/a\\n\\x1b[31m\\u202eb.csv: sample")
    )
    said = capsys.readouterr().err
    assert "there is no such file" in said
    assert not any(c in said for c in "\u202e\a\x1b\t\r")
    lines = [line for line in said.splitlines() if line.startswith("[")]
    assert len(lines) == len(names) + 1
    assert all("printable characters" in line for line in lines if "failed: line" in line)


def test_names_that_look_alike_are_told(tmp_path, monkeypatch, capsys, signals_as_before):
    """Composed or not, by capitals or blanks."""
    crew = batch_crew(Crew(lambda _: Immediate(), 1, lambda _: None))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    names = ["f\u00fcr", "fu\u0308r", "Lot 1", "lot 1", "Lot 2", "paint", "alone"]
    file = write_samples(tmp_path / "a.csv", names)
    text = file.read_text("utf-8")
    file.write_text(text.replace('"paint",', '"paint ",', 1), encoding="utf-8")
    other = write_samples(tmp_path / "b.csv", ["paint"], seed=50)
    out = tmp_path / "out"
    assert main(["batch", str(file), str(other), "--out", str(out), "--quiet"]) == 0
    notices = [row["notice"] for row in index_of(out)["samples"]]
    assert [bool(text) for text in notices] == [True] * 4 + [False, True, False, False]
    assert "for that of No. 2 'fu\\u0308r'." in notices[0]
    assert "for that of No. 3 'Lot 1'." in notices[3]
    assert "'paint', 'paint ' differ by blanks" in notices[5]
    page = (out / "index.html").read_text("utf-8")
    assert page.count('class="what notice"') == 5
    said = capsys.readouterr().err
    assert said.count("warning: No. ") == 5


def progress_of(error: str) -> Progress:
    return Progress({**failed_row(Job("a", "a.csv"), error)}, 1, 2, (), 0.0, 1)


def test_a_line_says_why_and_ends_with_a_word():
    """Not the head of a list of problems alone; what is long ends in an ellipsis."""
    long = "a: not converged within max_steps; " + "raise them and go on with --resume; " * 9
    line = sample_line(progress_of(long))
    said = line.split("failed: ")[1]
    assert said.endswith("...")
    assert long.startswith(said[:-3] + " ")
    assert 150 < len(said) <= 200
    listed = "lots/lot_99.csv: 1 problem, nothing was read.\n  there is no such file."
    assert sample_line(progress_of(listed)) == "[1/2] 'a': failed: there is no such file."
    assert len(sample_line(progress_of("x" * 999))) < 230


def drawn_limits(chart: str) -> list[tuple[float, float, float, str]]:
    """Horizontal parts of the limits: left, right, height, and what is said of them."""
    found = []
    for kind, d in re.findall(r'<path class="limit([^"]*)" d="M([^"]*)"', chart):
        left = float(d.split()[0])
        for height, right in re.findall(r"V([0-9.]+)H([0-9.]+)", d):
            found.append((left, float(right), float(height), kind))
            left = float(right)
    return found


def drawn_samples(chart: str) -> list[tuple[float, float, str]]:
    """Where the value of each sample is drawn: the middle of its bar; and its kind."""
    bars = re.findall(
        r'<g class="([^"]*)">.*?class="u" d="M([0-9.]+) ([0-9.]+)V([0-9.]+)"', chart, re.DOTALL
    )
    return [(float(x), 0.5 * (float(a) + float(b)), kind) for kind, x, a, b in bars]


def test_a_sample_beyond_a_line_is_never_passed_over(tmp_path):
    """Only the limits that decide are drawn; two of these lots lie beyond mean +- 3 MR/1.128."""
    values = [1.5105, 1.5283, 1.5028, 1.5014, 1.5115, 1.525, 1.5316, 1.5466, 1.5495, 1.555, 1.5568,
              1.546]  # fmt: skip
    centre, sigma = np.mean(values), np.mean(np.abs(np.diff(values))) / 1.128
    assert sum(abs(v - centre) > 3.0 * sigma for v in values) == 2
    for shift, n_beyond in ((0.0, 0), (0.5, 1)):
        shifted = [*values[:-1], values[-1] + shift]
        rows = [wave_row(i + 3, 3.39, v) for i, v in enumerate(shifted)]
        record, chart = charted(tmp_path, rows)
        assert sum(record["chart"]["beyond"]) == n_beyond
        limits = drawn_limits(chart)
        assert len(limits) == 2 * len(values)
        for x, at, kind in drawn_samples(chart):
            own = [height for left, right, height, _ in limits if left < x < right]
            assert len(own) == 2
            assert ("beyond" in kind) == (not min(own) < at < max(own)), (x, kind)
        page = (tmp_path / "index.html").read_text("utf-8")
        said = "1 is beyond its limits" if n_beyond else "None is beyond its limits"
        assert f"{said} in a control chart." in page


def test_limits_beyond_the_axis_go_along_the_frame(tmp_path):
    """The line is not broken: it is dotted where a limit is further out."""
    rows = [wave_row(i, 3.39, 1.5 + 0.01 * (i % 3)) for i in range(3, 12)]
    rows[4]["parameters"]["n"] |= {"sd": 0.04, "q025": 1.43, "q975": 1.59}
    _, chart = charted(tmp_path, rows)
    limits = drawn_limits(chart)
    assert len(limits) == 2 * len(rows)
    assert sorted(height for *_, height, kind in limits if kind == " far") == [10.0, 180.0]
    ends = [float(v) for v in re.findall(r'class="limit[^"]*" d="M([0-9.]+)', chart)]
    assert set(ends) <= {62.0, *(right for _, right, *_ in limits)}


def test_a_drift_is_told_in_the_lead(tmp_path):
    """By its symbol, relative where it is one, with equal decimals: 2 % a sample, exp(0.02) - 1."""
    rows = []
    for i, scatter in enumerate([0.0, 0.4, -0.3, 0.5, -0.6, 0.2, 0.1, -0.4, 0.3]):
        row = wave_row(i + 3, 3.39, 1.5 + 0.002 * scatter)
        mean = 0.45 * np.exp(0.02 * i + 0.002 * scatter)
        row["parameters"]["sigma_n0"] = {
            **row["parameters"]["n"], "symbol": "\u03c3_N0", "mean": mean, "median": mean,
            "sd": 0.0005, "q025": mean - 0.00098, "q975": mean + 0.00098,
        }  # fmt: skip
        rows.append(row)
    write_index(tmp_path, rows, n_samples=len(rows))
    page = (tmp_path / "index.html").read_text("utf-8")
    (lead,) = re.findall(r'<p class="headline">(.*?)</p>', page)
    said = re.search(
        r"<i>\u03c3<sub>N0</sub></i> drifts: (\S+) % from a sample to the next "
        r"\(95 % interval (\S+) to (\S+) %\)\.",
        lead,
    )
    assert said is not None
    slope, low, high = said.groups()
    assert float(low) < 100.0 * np.expm1(0.02) < float(high)
    assert len({len(part.partition(".")[2]) for part in (slope, low, high)}) == 1
    assert "<i>n</i> drifts" not in lead


@pytest.mark.parametrize(("low", "high"), [(1.25, 1.77), (0.1, 14.9), (2.6, 5.4), (0.0, 1.0)])
def test_an_axis_has_three_numbers_or_more(low, high):
    found = [value for value, _ in nice_ticks(low, high, float)]
    assert 3 <= len(found) <= 8
    assert low <= found[0]
    assert found[-1] <= high


@pytest.mark.parametrize(
    "unseen", ["", " ", "\u00a0", "\u3000", "\u2003", "\u200b", "\ufeff", "\t"]
)
@pytest.mark.parametrize(
    "sign", ["=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20", "\u2212"]
)
def test_no_cell_is_a_formula(unseen, sign):
    """Spaces that nobody sees and the full-width forms, which some programs take for the plain."""
    assert harmless(f"{unseen}{sign}1+1") == f"'{unseen}{sign}1+1"
    assert harmless(f"lot{unseen}{sign}1") == f"lot{unseen}{sign}1"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_has_a_line_for_each_sample_in_hand(monkeypatch):
    """Written over while it runs; what is done stays above it."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    tell = teller()
    tell(Progress(None, 0, 3, (("lot 1", 3.0), ("x" * 99, 1.0)), None, 2))
    first = terminal.getvalue()
    assert first.splitlines()[0].split("] ")[1] == "0/3 samples"
    assert first.splitlines()[1] == "  'lot 1', 3 s"
    assert [len(line) < 60 for line in first.splitlines()] == [True] * 3
    row = {"sample": "lot 1", "verdict": "PASS", "conformity": "REJECT", "seconds": 4.0,
           "repeat_of": None, "status": "done", "error": None, "notice": None}  # fmt: skip
    tell(Progress(row, 1, 3, (("x" * 99, 2.0),), 130.0, 2))
    second = terminal.getvalue()[len(first) :]
    assert second.startswith("\x1b[3F\x1b[J[1/3] 'lot 1': PASS, REJECT (4.0 s), about 2 min left\n")
    tell(Progress({**row, "sample": "lot 3"}, 3, 3, (), 0.0, 2))
    assert terminal.getvalue().endswith("\x1b[2F\x1b[J[3/3] 'lot 3': PASS, REJECT (4.0 s)\n")


class GoneError(Exception):
    """Stands for what a client says whose scheduler is gone."""


class Losing(Immediate):
    """Its scheduler goes when the third sample is handed over; even to be stopped is too much."""

    def submit(self, fn, task):
        if len(self.asked) < 2:
            return super().submit(fn, task)
        if len(self.asked) == 3:
            raise GoneError
        self.asked.append(task.job.sample)
        future: Future = Future()
        future.set_exception(GoneError())
        return future


def test_a_scheduler_that_goes_leaves_the_rest_open(
    tmp_path, monkeypatch, capsys, signals_as_before
):
    names = [f"lot {i}" for i in range(5)]
    file, out = write_samples(tmp_path / "a.csv", names), tmp_path / "out"
    crew = batch_crew(Crew(lambda _: Losing(), 1, lambda _: None, lost=(GoneError,)))
    monkeypatch.setattr(batch_run, "_crew", lambda *_: crew)
    assert main(["batch", str(file), "--out", str(out), "--quiet"]) == 3
    said = capsys.readouterr().err
    assert "the scheduler was lost with 2 of 5 samples done" in said
    assert "--resume" in said
    assert list(statuses(out).items()) == [
        *((n, "done") for n in names[:2]),
        *((n, "skipped") for n in names[2:]),
    ]
    index = index_of(out)
    assert not index["finished"]
    assert all("the scheduler was lost" in row["error"] for row in index["samples"][2:])
    page = (out / "index.html").read_text("utf-8")
    assert "2 of 5 samples so far" in page
    assert "not done yet" in page


def test_a_scheduler_that_is_not_there_is_one_error(
    tmp_path, capsys, monkeypatch, signals_as_before
):
    pytest.importorskip("distributed")
    monkeypatch.setattr("pbrdf_bayes.batch.executors.CONNECT_SECONDS", 0.5)
    file = write_samples(tmp_path / "a.csv", ["one"])
    out = tmp_path / "out"
    options = ["batch", str(file), "--out", str(out), "--scheduler"]
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        assert main([*options, address]) == 2
        assert "dask scheduler" in capsys.readouterr().err
        assert not list(out.glob("[!.]*"))
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*options, "tcp://127.0.0.1:9"]) == 2
    assert "pip install 'pbrdf-bayes[cluster]'" in capsys.readouterr().err


QUIET = {
    "env": {**os.environ, "OMP_NUM_THREADS": "1"}, "stderr": subprocess.DEVNULL,
    "stdout": subprocess.DEVNULL,
}  # fmt: skip


def start_worker(tmp_path: Path, address: str, name: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [str(Path(sys.executable).parent / "dask"), "worker", address, "--nthreads", "1",
         "--no-nanny", "--no-dashboard", "--name", name, "--local-directory",
         str(tmp_path / "dask")], **QUIET,
    )  # fmt: skip


@contextmanager
def cluster(
    tmp_path: Path, workers: tuple[str, ...] = ("first", "second")
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler with two workers; the three processes."""
    bin_folder = Path(sys.executable).parent
    info = tmp_path / "scheduler.json"
    processes = [
        subprocess.Popen(
            [str(bin_folder / "dask"), "scheduler", "--port", "0", "--no-dashboard",
             "--scheduler-file", str(info)], **QUIET,
        )
    ]  # fmt: skip
    try:
        deadline = time.monotonic() + 60.0
        while not info.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        address = json.loads(info.read_text())["address"]
        processes += [start_worker(tmp_path, address, name) for name in workers]
        if workers:
            wait_for_workers(address, len(workers))
        yield address, processes
    finally:
        for one in processes:
            one.kill()
            one.wait()


def test_workers_of_a_cluster_are_asked_and_counted(tmp_path, monkeypatch):
    """None within the time given is an error; one in time will do; one that joins later counts."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "FIRST_WORKER_SECONDS", 0.5)
    with cluster(tmp_path, ()) as (address, processes):
        with (
            pytest.raises(ConfigError, match=r"no worker, and none came in 0\.5 s"),
            executors.cluster_crew(address),
        ):
            pass
        monkeypatch.setattr(executors, "FIRST_WORKER_SECONDS", 60.0)
        processes.append(start_worker(tmp_path, address, "first"))
        with executors.cluster_crew(address) as crew:
            assert (crew.n_workers, crew.count()) == (1, 1)
            mark = batch_work.leave_mark(tmp_path)
            assert list(crew.blind(tmp_path, mark)) == []
            monkeypatch.setattr(batch_work, "SEEN_WITHIN", 0.1)
            (blind,) = crew.blind(tmp_path, "the mark of another folder")
            assert blind.startswith("tcp://")
            processes.append(start_worker(tmp_path, address, "late"))
            wait_for_workers(address, 2)
            assert crew.count() == 2
            processes[0].kill()
            processes[0].wait()
            assert crew.count() == 2


def test_a_cluster_loses_nothing_when_a_worker_is_killed(tmp_path, quick):
    pytest.importorskip("distributed")
    with cluster(tmp_path) as (address, processes):
        file = write_samples(tmp_path / "many.csv", [f"lot {i}" for i in range(3)])
        out = tmp_path / "out"
        process = start([file], out, *quick, "--scheduler", address, until=DONE)
        processes[1].kill()
        _, said = process.communicate(timeout=120)
        assert process.returncode == 0, said
        assert statuses(out) == {f"lot {i}": "done" for i in range(3)}
        assert len(list(out.glob("*/summary.json"))) == 3
        logs = [p.read_text() for p in out.glob("*/log.txt")]
        assert all(text.count("report:") == 1 for text in logs)


def test_when_the_scheduler_is_killed_what_is_done_is_kept(tmp_path, quick):
    """One message and no traceback; another cluster goes on."""
    pytest.importorskip("distributed")
    file = write_samples(tmp_path / "many.csv", [f"lot {i}" for i in range(6)])
    out = tmp_path / "out"
    with cluster(tmp_path) as (address, processes):
        process = start([file], out, *quick, "--scheduler", address, until=DONE)
        processes[0].kill()
        printed, said = process.communicate(timeout=120)
    assert process.returncode == 3, said
    assert printed == ""
    assert said.count("the scheduler was lost") == 1
    assert "--resume" in said
    assert "Traceback" not in said
    assert set(statuses(out).values()) == {"done", "skipped"}
    assert not index_of(out)["finished"]
    options = [str(file), "--out", str(out), *quick, "--resume", "--quiet", "--strict"]
    done = subprocess.run([*COMMAND, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert index_of(out)["finished"]
    assert all(row["verdict"] for row in index_of(out)["samples"])


def wait_for_workers(address: str, n: int) -> None:
    from distributed import Client

    with Client(address, timeout=30, set_as_default=False) as client:
        client.wait_for_workers(n, timeout=60)
