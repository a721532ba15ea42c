"""What scripts outside rely on: exit codes, standard output, interrupts, nothing half written."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pbrdf_bayes.cli import main

COMMAND = [sys.executable, "-m", "pbrdf_bayes"]
DRAFT = ["--accuracy", "draft", "--quiet"]
PARAMETERS = '{"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}'
MISFIT_DEX = {"aeroglaze_z307": 0.1143, "singularity_black": 0.2331}


def start_fit(csv: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    """A real process, past its imports and inside the computation."""
    process = subprocess.Popen(
        [*COMMAND, "fit", str(csv), "--out", str(out), *options],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("sample"):
            break
    return process


def stop(process: subprocess.Popen[str], kind: signal.Signals) -> int:
    """Signal the process, read what it still says, return its exit code."""
    process.send_signal(kind)
    try:
        process.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
    return process.returncode


def posterior_draws(folder: Path) -> dict[str, np.ndarray]:
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        return {name: values.values for name, values in tree["posterior"].data_vars.items()}


def visible(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if not p.name.startswith("."))


def test_fit_prints_the_folder_alone(small_csv, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["fit", str(small_csv), "--out", str(out), *DRAFT]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert visible(out) == ["config.toml", "log.txt", "posterior.nc", "report.html", "summary.json"]
    assert main(["fit", str(small_csv), "--out", str(out), *DRAFT]) == 2
    assert "not empty" in capsys.readouterr().err
    assert main(["fit", str(small_csv), "--out", str(out), *DRAFT, "--resume"]) == 0
    assert main(["fit", str(small_csv), "--out", str(out), *DRAFT, "--resume", "--seed", "9"]) == 2
    assert "seed: 1 there, 9 now" in capsys.readouterr().err


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_nothing_half_written(small_csv, tmp_path, kind):
    out = tmp_path / "run"
    process = start_fit(small_csv, out, "--accuracy", "reference")
    assert stop(process, kind) == 130
    assert visible(out) == []


def test_a_killed_run_gives_the_same_draws_when_resumed(small_csv, tmp_path):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = start_fit(small_csv, killed)
    time.sleep(0.2)
    assert stop(process, signal.SIGKILL) == -signal.SIGKILL
    assert not (killed / "summary.json").exists()
    assert main(["fit", str(small_csv), "--out", str(killed), "--quiet", "--resume"]) == 0
    assert main(["fit", str(small_csv), "--out", str(whole), "--quiet"]) == 0
    first, second = posterior_draws(killed), posterior_draws(whole)
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name])


def test_a_second_process_is_refused(small_csv, tmp_path, capsys):
    out = tmp_path / "run"
    process = start_fit(small_csv, out, "--accuracy", "reference")
    try:
        assert main(["fit", str(small_csv), "--out", str(out), *DRAFT, "--resume"]) == 2
        assert "another process" in capsys.readouterr().err
    finally:
        stop(process, signal.SIGKILL)


def test_a_run_that_does_not_converge_is_kept_and_marked(small_csv, tmp_path, capsys):
    config = tmp_path / "short.toml"
    config.write_text("max_steps = 100\n", encoding="utf-8")
    out = tmp_path / "run"
    assert main(["fit", str(small_csv), "--out", str(out), "--config", str(config), "--quiet"]) == 3
    assert "not converged" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["status"] == "not_converged"
    assert summary["verdict"] == "FAIL"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--effects", "lambrt"], "Did you mean 'lambert'"),
        (["--effects", "lambert,bulk"], "alternative"),
        (["--accuracy", "hihg"], "Allowed: 'draft', 'standard', 'reference'"),
        (["--sample", "other"], "has no rows to use"),
    ],
)
def test_bad_usage_writes_nothing(small_csv, tmp_path, capsys, options, message):
    out = tmp_path / "run"
    assert main(["fit", str(small_csv), "--out", str(out), *options]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_dhr_alone_is_enough(tmp_path):
    """The first step of the paper's recipe: DHR gives n, k and sigma_N0, nothing gives rho0."""
    csv = tmp_path / "dhr.csv"
    options = ["--params", PARAMETERS, "--theta-i", "", "--out", str(csv)]
    assert main(["simulate", *options]) == 0
    assert main(["fit", str(csv), "--out", str(tmp_path / "run"), *DRAFT]) == 0
    text = (tmp_path / "run" / "summary.json").read_text(encoding="utf-8")
    parameters = json.loads(text)["parameters"]
    assert not parameters["rho0"]["identified"]
    assert parameters["sigma_n0"]["identified"]


@pytest.mark.parametrize("verb", ["fit", "simulate"])
def test_a_negative_seed_is_refused(verb, tmp_path, capsys):
    given = {"fit": ["x.csv"], "simulate": ["--params", PARAMETERS, "--out", "x.csv"]}[verb]
    with pytest.raises(SystemExit) as stopped:
        main([verb, *given, "--seed", "-1"])
    assert stopped.value.code == 2
    assert "not negative" in capsys.readouterr().err


def test_predict_has_the_columns_of_the_contract(finished_run, capsys):
    given = ["--theta-i", "30", "--theta-r=-10:10:10", "--dhr-theta-i", "30"]
    assert main(["predict", str(finished_run), *given]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        "quantity,polarization,theta_i_deg,theta_r_deg,value,q05,q25,q75,q95,pred_q05,pred_q95"
    )
    assert len(lines) == 1 + 2 * 3 + 2
    for line in lines[1:]:
        value, q05, q25, q75, q95, low, high = (float(v) for v in line.split(",")[4:])
        assert low < q05 < q25 < value < q75 < q95 < high
    assert main(["predict", "--params", PARAMETERS, *given]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("brdf,s,30,-10,")


def test_simulated_readings_say_so(tmp_path, capsys):
    csv = tmp_path / "a.csv"
    options = ["--theta-i", "20", "--theta-r=-60:60:20", "--sample", "red"]
    assert main(["simulate", "--params", PARAMETERS, *options, "--out", str(csv)]) == 0
    assert "red_simulated" in csv.read_text(encoding="utf-8").splitlines()[1]
    assert main(["check", str(csv)]) == 0
    assert "red_simulated" in capsys.readouterr().out


def test_strict_turns_a_fail_into_4(shared, tmp_path):
    csv = shared / "ua_aeroglaze_z307_650nm_mean3.csv"
    assert main(["fit", str(csv), "--out", str(tmp_path / "run"), *DRAFT, "--strict"]) == 4


@pytest.mark.parametrize("sample", list(MISFIT_DEX))
def test_measured_black_paints_are_said_to_misfit(shared, tmp_path, sample):
    """Real scans: unpolarised, no DHR. The rms figures are those of an independent fit."""
    csv = shared / f"ua_{sample}_650nm_mean3.csv"
    out = tmp_path / "run"
    assert main(["fit", str(csv), "--out", str(out), *DRAFT]) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["verdict"] == "FAIL"
    assert summary["fit"]["rms_dex_best"]["overall"] == pytest.approx(MISFIT_DEX[sample], abs=0.002)
    assert summary["diagnostics"]["misfit"]["verdict"] == "FAIL"
    assert summary["diagnostics"]["identifiability"]["verdict"] == "WARN"
    assert not summary["parameters"]["n"]["identified"]


def test_several_samples_need_a_choice(shared, tmp_path, capsys):
    csv = shared / "ua_aeroglaze_z307_650nm_runs.csv"
    assert main(["fit", str(csv), "--out", str(tmp_path / "run"), *DRAFT]) == 2
    assert "aeroglaze_z307_run2" in capsys.readouterr().err
    options = ["--sample", "aeroglaze_z307_run2", "--out", str(tmp_path / "run"), *DRAFT]
    assert main(["fit", str(csv), *options]) == 0


def test_help_of_every_verb(capsys):
    for verb in ("check", "fit", "report", "predict", "simulate"):
        with pytest.raises(SystemExit) as stop:
            main([verb, "--help"])
        assert stop.value.code == 0
        assert verb in capsys.readouterr().out


def test_a_closed_pipe_is_no_error():
    command = f"{' '.join(COMMAND)} predict --params '{PARAMETERS}' | head -n 1"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command}"], capture_output=True, text=True, check=False,
        env={**os.environ},
    )  # fmt: skip
    assert done.returncode == 0
    assert done.stderr == ""
