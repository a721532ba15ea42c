"""Nothing is lost: a fit that is killed goes on to the draws it would have had.

Fits are killed in processes of their own, which store every state they reach and walk in short
pieces; the run they are held against walks in one process, undisturbed and with one thread.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import main
from pbrdf_bayes.inference.effects_choice.choose import as_chosen
from pbrdf_bayes.io.checkpoint import read_checkpoint
from pbrdf_bayes.workflow import resume
from pbrdf_bayes.workflow.fitting import fit_file

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="POSIX signals and limits"),
    pytest.mark.usefixtures("signals_as_before"),
]

RESULTS = {"summary.json", "posterior.nc", "config.toml", "report.html", "log.txt"}
CHECKPOINT = "checkpoint_sample.npz"
UNFINISHED = RESULTS | {CHECKPOINT}
"""Of a run that ended at max_steps: it can be gone on with."""
KEPT = 100
CONFIG = f"holdout = false\nn_walkers = 16\nmax_steps = {KEPT}\nthreads = {{}}\n"
PIECE = 5
"""Steps from one stored state to the next in the processes that are killed."""
RESTLESS = f"""
import sys, time
from pbrdf_bayes.inference.sampling import ensembles
from pbrdf_bayes.io import checkpoint
last = int(sys.argv.pop(1))
advance = ensembles.advance
def halting(posterior, state, *others):
    while state.n_steps >= last:
        time.sleep(0.05)
    return advance(posterior, state, *others)
ensembles.advance = halting
ensembles._steps_of_a_piece = lambda state: {PIECE}
checkpoint.EVERY_SECONDS = 0.0
sys.argv[0] = "pbrdf-bayes"
from pbrdf_bayes.cli import run_program
run_program()
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with few readings, and a configuration."""
    folder = tmp_path_factory.mktemp("inputs")
    m = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=1, theta_i_deg=(30.0,), theta_r_deg=np.linspace(-60.0, 60.0, 9),
        dhr_theta_i_deg=(20.0, 70.0), polarizations=("s",),
    )  # fmt: skip
    pb.write_tidy_csv(m, folder / "tiny_simulated.csv")
    for threads in (1, 2):
        (folder / f"{threads}.toml").write_text(CONFIG.format(threads), encoding="utf-8")
    return folder


def fit_arguments(inputs: Path, folder: Path, *more: object, threads: int = 2) -> list[str]:
    return [
        "fit", str(inputs / "tiny_simulated.csv"), "--out", str(folder),
        "--config", str(inputs / f"{threads}.toml"), "--quiet", *map(str, more),
    ]  # fmt: skip


def resumed(inputs: Path, folder: Path, *more: object) -> int:
    """Exit code of --resume in this process."""
    return main(fit_arguments(inputs, folder, "--resume", *more))


@pytest.fixture(scope="module")
def whole(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run that nothing disturbed, with one thread; it ends at max_steps."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    assert main(fit_arguments(inputs, folder, threads=1)) == 3
    assert {p.name for p in folder.iterdir()} == UNFINISHED | {".lock"}
    return folder


class Fit:
    """A fit in a process of its own that stores every state.

    It halts, alive, two pieces after the step that is waited for: however late the signal comes,
    it does not find a fit that has ended.
    """

    def __init__(self, inputs: Path, folder: Path, n_steps: int) -> None:
        self.folder, self.n_steps = folder, n_steps
        arguments = fit_arguments(inputs, folder, "--resume")
        self.process = subprocess.Popen(
            [sys.executable, "-c", RESTLESS, str(n_steps + 2 * PIECE), *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def __enter__(self) -> Fit:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def wait(self) -> None:
        """Until the checkpoint holds the step."""
        deadline = time.monotonic() + 240.0
        while steps_in(self.folder) < self.n_steps:
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.1)

    def end(self, number: int) -> tuple[int, str]:
        """Exit code and what was said on standard error."""
        self.process.send_signal(number)
        _, told = self.process.communicate(timeout=60)
        return self.process.returncode, told


def steps_in(folder: Path) -> int:
    """Steps of the walk that the checkpoint holds."""
    if not (folder / CHECKPOINT).exists():
        return 0
    arrays, _ = read_checkpoint(folder / CHECKPOINT)
    return int(arrays["z"].shape[1])


@pytest.fixture(scope="module")
def killed(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Copies of one run folder, killed at 20 % of its steps, and on the way on at 50 and 80 %."""
    root = tmp_path_factory.mktemp("killed")
    copies = {}
    for percent in (20, 50, 80):
        with Fit(inputs, root / "run", KEPT * percent // 100) as fit:
            fit.wait()
            assert fit.end(signal.SIGKILL)[0] == -signal.SIGKILL
        copies[percent] = Path(shutil.copytree(root / "run", root / str(percent)))
    return copies


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.name != ".lock"}


def assert_same_run(folder: Path, whole: Path) -> None:
    again, before = load_analysis(folder), load_analysis(whole)
    for group in ("posterior", "sample_stats", "posterior_predictive"):
        xr.testing.assert_identical(
            again.draws[group].to_dataset(), before.draws[group].to_dataset()
        )
    for key in ("parameters", "sampling", "map", "diagnostics", "rejected"):
        assert again.summary[key] == before.summary[key]


@pytest.mark.parametrize("percent", [20, 50, 80])
def test_a_killed_fit_goes_on_to_the_same_draws(
    percent: int, killed: dict[int, Path], whole: Path, inputs: Path, tmp_path: Path
) -> None:
    """At 50 and 80 % the run had been killed before: any number of interruptions."""
    folder = Path(shutil.copytree(killed[percent], tmp_path / "run"))
    n_steps = steps_in(folder)
    assert percent / 100 <= n_steps / KEPT < 1.0
    assert not RESULTS & set(contents(folder))
    (folder / ".posterior.nc.abc.part").write_bytes(b"what a killed process was writing")
    assert resumed(inputs, folder) == 3
    assert set(contents(folder)) == UNFINISHED
    assert_same_run(folder, whole)
    log = (folder / "log.txt").read_text(encoding="utf-8")
    assert f"sample: gone on from step {n_steps} of a checkpoint" in log


def test_sigterm_is_an_interrupt_and_a_second_process_is_refused(
    killed: dict[int, Path], whole: Path, inputs: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = Path(shutil.copytree(killed[20], tmp_path / "run"))
    with Fit(inputs, folder, steps_in(folder) + 1) as fit:
        fit.wait()
        assert resumed(inputs, folder) == 2
        assert "another process is writing this run" in capsys.readouterr().err
        code, told = fit.end(signal.SIGTERM)
    assert code == 130
    assert f"go on with: --out {folder} --resume" in told
    assert "Traceback" not in told
    assert set(contents(folder)) == {CHECKPOINT}
    assert resumed(inputs, folder) == 3
    assert_same_run(folder, whole)


def test_an_unfinished_run_is_not_begun_again_without_resume(
    killed: dict[int, Path], inputs: Path, capsys: Any
) -> None:
    before = contents(killed[20])
    assert main(fit_arguments(inputs, killed[20])) == 2
    assert "not empty (checkpoint_sample.npz). Add --resume" in capsys.readouterr().err
    assert contents(killed[20]) == before


DIFFERENCES = [
    ("seed", "  seed: 1 there, 2 now"),
    ("config", "  n_walkers: 16 there, 18 now"),
    ("data", "  data: '"),
    ("package", "  version of pbrdf-bayes: '{}' there, '99.0' now"),
    ("numpy", "  version of numpy: '{}' there, '99.0' now"),
]


def test_a_finished_run_is_the_same_whatever_the_versions_are(
    whole: Path, inputs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, versions = contents(whole), resume.versions()
    monkeypatch.setattr(resume, "versions", lambda: versions | {"numpy": "99.0"})
    assert main([*fit_arguments(inputs, whole, threads=1), "--resume"]) == 3
    assert contents(whole) == before


@pytest.mark.parametrize(
    ("change", "line", "finished"),
    [(*d, False) for d in DIFFERENCES] + [(*d, True) for d in DIFFERENCES[:3]],
)
def test_another_run_is_refused_with_a_diff(
    change: str, line: str, finished: bool, killed: dict[int, Path], whole: Path, inputs: Path,
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = Path(shutil.copytree(whole if finished else killed[20], tmp_path / "run"))
    here = Path(shutil.copytree(inputs, tmp_path / "inputs"))
    if finished:
        shutil.copy(here / "1.toml", here / "2.toml")
    before, more, versions = contents(folder), [], resume.versions()
    if change == "seed":
        more = ["--seed", "2"]
    elif change == "config":
        text = (here / "2.toml").read_text(encoding="utf-8")
        (here / "2.toml").write_text(
            text.replace("n_walkers = 16", "n_walkers = 18"), encoding="utf-8"
        )
    elif change == "data":
        csv = here / "tiny_simulated.csv"
        csv.write_text(csv.read_text(encoding="utf-8").replace("0.1", "0.2"), encoding="utf-8")
    else:
        name = {"package": "pbrdf-bayes"}.get(change, change)
        line = line.format(versions[name])
        monkeypatch.setattr(resume, "versions", lambda: versions | {name: "99.0"})
    assert resumed(here, folder, *more) == 2
    told = capsys.readouterr().err
    assert f"{folder}" in told
    assert line in told
    assert "give another --out" in told.lower()
    assert len(told.splitlines()) == 3
    assert contents(folder) == before


@pytest.mark.parametrize("damage", ["truncated", "empty", "flipped"])
def test_a_damaged_checkpoint_is_named_with_the_remedy(
    damage: str, killed: dict[int, Path], inputs: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = Path(shutil.copytree(killed[20], tmp_path / "run"))
    path = folder / CHECKPOINT
    stored = bytearray(path.read_bytes())
    stored[len(stored) // 2] ^= 1
    kept = {"truncated": len(stored) // 2, "empty": 0, "flipped": len(stored)}[damage]
    path.write_bytes(stored[:kept])
    before = contents(folder)
    assert resumed(inputs, folder) == 2
    told = capsys.readouterr().err
    assert f"{path}: the checkpoint is damaged" in told
    assert "Delete this file" in told
    assert contents(folder) == before


def test_a_checkpoint_that_cannot_grow_leaves_the_last_one(
    killed: dict[int, Path], inputs: Path, tmp_path: Path, capsys: Any
) -> None:
    """Files may not become larger than the last checkpoint is: as on a full disk."""
    import resource

    folder = Path(shutil.copytree(killed[20], tmp_path / "run"))
    before = contents(folder)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before[CHECKPOINT]) + 1, limits[1]))
    try:
        assert resumed(inputs, folder) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    told = capsys.readouterr().err
    assert f"{folder / CHECKPOINT}: cannot be written (File too large)" in told
    assert "goes on with --resume" in told
    assert contents(folder) == before


def test_a_read_only_folder_is_an_error_that_changes_nothing(
    killed: dict[int, Path], inputs: Path, capsys: Any
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(shutil.copytree(killed[20], Path(name) / "run"))
        here = Path(shutil.copytree(inputs, Path(name) / "inputs"))
        before = contents(folder)
        for path in (folder, Path(name), here):
            path.chmod(0o555)
        (folder / ".lock").chmod(0o444)
        root = os.geteuid() == 0
        if root:  # for whom no folder is closed
            os.seteuid(65534)
        try:
            assert resumed(here, folder) == 2
        finally:
            if root:
                os.seteuid(0)
            for path in (folder, Path(name), here):
                path.chmod(0o755)
        assert f"{folder}: cannot write there (Permission denied)" in capsys.readouterr().err
        assert contents(folder) == before


def test_a_checkpoint_left_beside_a_finished_run_goes(
    killed: dict[int, Path], whole: Path, inputs: Path, tmp_path: Path
) -> None:
    """Killed between the last file of the run and the removal of the checkpoint."""
    folder = Path(shutil.copytree(whole, tmp_path / "run"))
    shutil.copy(killed[80] / CHECKPOINT, folder)
    summary = folder / "summary.json"
    told = summary.read_text(encoding="utf-8").replace('"not_converged"', '"done"')
    summary.write_text(told, encoding="utf-8")
    before = (folder / "posterior.nc").read_bytes()
    assert main(fit_arguments(inputs, folder, "--resume", threads=1)) == 0
    assert set(contents(folder)) == RESULTS
    assert (folder / "posterior.nc").read_bytes() == before


def test_a_run_out_of_steps_goes_on_with_more_of_them(
    whole: Path, inputs: Path, tmp_path: Path, capsys: Any
) -> None:
    """The steps that are there stay; the same budget gives the same run, without a step more."""
    folder = Path(shutil.copytree(whole, tmp_path / "run"))
    before = contents(folder)
    assert main(fit_arguments(inputs, folder, "--resume", threads=1)) == 3
    assert (
        "Raise max_steps in the configuration, and go on with --resume" in capsys.readouterr().err
    )
    assert contents(folder) == before
    text = CONFIG.format(2).replace(f"max_steps = {KEPT}", "max_steps = 150")
    (tmp_path / "more.toml").write_text(text, encoding="utf-8")
    more = ["--config", str(tmp_path / "more.toml"), "--resume"]
    assert main([*fit_arguments(inputs, folder, threads=1), *more]) == 3
    assert set(contents(folder)) == UNFINISHED
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["sampling"]["n_steps"] == 150
    assert f"gone on from step {KEPT}" in (folder / "log.txt").read_text(encoding="utf-8")


def test_the_summary_counts_no_rejected_points_where_there_are_none(whole: Path) -> None:
    summary = json.loads((whole / "summary.json").read_text(encoding="utf-8"))
    assert summary["rejected"] == {"n": 0, "examples": []}


def test_a_finished_run_that_chose_its_effects_does_not_choose_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measurement = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=1, theta_i_deg=(20.0, 60.0), polarizations=("u",),
        theta_r_deg=np.linspace(-80.0, 80.0, 9), dhr_theta_i_deg=(10.0, 40.0, 70.0),
    )  # fmt: skip
    csv, out = tmp_path / "readings.csv", tmp_path / "run"
    pb.write_tidy_csv(measurement, csv)
    config = pb.RunConfig(effects=("auto",), accuracy="draft", holdout=False)
    first = fit_file(csv, config, out=out, seed=1)
    found = load_analysis(out)
    told, readings = found.summary, pb.read_measurement(csv)
    assert told["effects_choice"]["candidates"]
    choice = {"effects": tuple(told["effects"]), "line_shape": told["line_shape"]}
    fitted = pb.build_posterior(readings, as_chosen(readings, config, **choice))
    x = fitted.sample_prior(np.random.default_rng(1), 5)
    assert found.posterior().log_prob(x).tobytes() == fitted.log_prob(x).tobytes()

    def choose(*_: object, **__: object) -> None:
        pytest.fail("chosen once more")

    monkeypatch.setattr("pbrdf_bayes.workflow.fitting.choose_effects", choose)
    assert fit_file(csv, config, out=out, seed=1, resume=True) == first
    with pytest.raises(pb.RunFolderError, match="not empty"):
        fit_file(csv, config, out=out, seed=1)
    with pytest.raises(pb.RunFolderError, match="seed"):
        fit_file(csv, config, out=out, seed=2, resume=True)


def test_a_run_of_named_effects_is_not_one_that_chose_them(small_csv: Path, tmp_path: Path) -> None:
    draft = pb.RunConfig(accuracy="draft", holdout=False)
    fit_file(small_csv, draft, out=tmp_path / "run")
    with pytest.raises(pb.RunFolderError, match="effects"):
        fit_file(small_csv, replace(draft, effects=("auto",)), out=tmp_path / "run", resume=True)
