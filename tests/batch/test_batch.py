"""Many samples, with real files and real processes: nothing lost, nothing done twice."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import psutil
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.batch import run as batch_run
from pbrdf_bayes.batch.executors import Crew
from pbrdf_bayes.batch.outcome import finished_row
from pbrdf_bayes.batch.plan import plan_batch
from pbrdf_bayes.cli import main

COMMAND = [sys.executable, "-m", "pbrdf_bayes", "batch"]
HEADER = "sample,wavelength_um,quantity,polarization,theta_i_deg,theta_r_deg,value"
FITTED = ["../../escape", "<script>alert(1)</script>", "=1+1", "Lot"]
DONE = " s)\n"
"""End of the line that says that a sample is done."""
LIMITS = """rule = "simple"
[[limit]]
name = "roughness"
parameter = "rho0"
"""
HOSTILE = [
    "../../escape", "a/b", "CON", "<script>alert(1)</script>", "'\"; rm -rf ~", "=1+1", "Lot",
    "lot", "l\u043et", "..", "n" * 200,
]  # fmt: skip
"""Names that a file may have; the last but two look alike (a Cyrillic o)."""


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
    assert "samples" in done.stderr
    assert "left; in hand: " in done.stderr
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
        assert row["conformity"] == summary["conformity"]["verdict"]
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
    names = [f"lot {i}" for i in range(4)]
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
    assert 1 <= len(before) < 4
    assert not index_of(out)["finished"]

    process = start([file], out, *quick, "--workers", "2", "--resume", until="in hand: ")
    workers_of(process)[0].send_signal(signal.SIGKILL)
    process.communicate(timeout=120)
    assert process.returncode == 0
    after = statuses(out)
    assert list(after) == names
    assert all(after[name] == "skipped" for name in before)
    assert set(after.values()) <= {"done", "skipped"}
    assert len(list(out.glob("*/summary.json"))) == 4


def test_when_the_parent_is_killed_its_workers_end(tmp_path, quick):
    file = write_samples(tmp_path / "many.csv", [f"lot {i}" for i in range(3)])
    process = start([file], tmp_path / "out", *quick, "--workers", "2", until="in hand: ")
    children = workers_of(process)
    assert len(children) == 2
    process.kill()
    process.communicate()
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []
    assert index_of(tmp_path / "out")["n_samples"] == 3


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
                waiting.set_result(row_of(one.job))
            self.pending.clear()
        return future


def row_of(job):
    summary = {
        "status": "done", "verdict": "PASS", "headline": "", "parameters": {},
        "fit": {"rms_dex_best": {"overall": 0.01}},
    }  # fmt: skip
    return finished_row(job, summary, status="done", seconds=0.1)


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
                waiting.set_result(row_of(one.job))
            self.pending.clear()
            return future

    def pool(n_workers: int) -> Executor:
        return Deadly("deadly", log) if n_workers > 1 else Alone("deadly", log)

    crew = Crew(pool, 2, lambda _: None)
    monkeypatch.setattr(batch_run, "_crew", lambda *_: batch_crew(crew))
    found = batch_run.fit_batch([file], out=tmp_path / "out")
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
    long = write_samples(tmp_path / "long.csv", ["n" * 300, "bell\a", "fine"])
    assert [bool(job.error) for job in plan_batch([long], pb.RunConfig(), seed=1)] == [
        False, True, True,
    ]  # fmt: skip


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
    twice = [job.folder for job in plan_batch([file, file], config, seed=1)]
    assert len(set(twice)) == 6
    steps = pb.RunConfig(accuracy="draft", max_steps=99_999, threads=7)
    assert [job.folder for job in plan_batch([file], steps, seed=1)][:2] == first


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


def test_a_cluster_loses_nothing_when_a_worker_is_killed(tmp_path, quick):
    pytest.importorskip("distributed")
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    bin_folder = Path(sys.executable).parent
    info = tmp_path / "scheduler.json"
    processes = [
        subprocess.Popen(
            [str(bin_folder / "dask"), "scheduler", "--port", "0", "--no-dashboard",
             "--scheduler-file", str(info)],
            env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )
    ]  # fmt: skip
    try:
        deadline = time.monotonic() + 60.0
        while not info.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        address = json.loads(info.read_text())["address"]
        processes += [
            subprocess.Popen(
                [str(bin_folder / "dask"), "worker", address, "--nthreads", "1", "--no-nanny",
                 "--no-dashboard", "--name", name, "--local-directory", str(tmp_path / "dask")],
                env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            )
            for name in ("first", "second")
        ]  # fmt: skip
        wait_for_workers(address, 2)
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
    finally:
        for one in processes:
            one.kill()
            one.wait()


def wait_for_workers(address: str, n: int) -> None:
    from distributed import Client

    with Client(address, timeout=30, set_as_default=False) as client:
        client.wait_for_workers(n, timeout=60)
