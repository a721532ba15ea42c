"""The committed data sets: unchanged, labelled for what they are, and reproducible."""

import csv
import hashlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main

DATA = Path(__file__).parents[2] / "data"
SETS = sorted(folder for folder in DATA.iterdir() if folder.is_dir())
GREEN = DATA / "green_paint_simulated" / "green_paint_simulated.csv"


def _rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("folder", SETS, ids=lambda folder: folder.name)
def test_every_set_has_a_readme_and_matches_its_checksums(folder):
    assert (folder / "README.md").is_file()
    lines = (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    stated = {name: digest for digest, name in (line.split(maxsplit=1) for line in lines)}
    assert set(stated) == {path.name for path in folder.glob("*.csv")}
    for name, digest in stated.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name


def test_the_index_names_every_set():
    index = (DATA / "README.md").read_text(encoding="utf-8")
    assert [folder.name for folder in SETS if f"({folder.name}/README.md)" not in index] == []


def test_simulated_readings_say_so_everywhere():
    assert "simulated" in GREEN.parent.name
    assert "simulated" in GREEN.name
    assert {row["sample"] for row in _rows(GREEN)} == {"green_paint_simulated"}
    assert "not measurements" in (GREEN.parent / "README.md").read_text(encoding="utf-8")


def test_the_green_paint_lies_on_the_grid_of_the_paper():
    measurement = pb.read_measurement(GREEN)
    angles = {(scan.polarization, scan.theta_i_deg) for scan in measurement.scans}
    assert angles == {(q, theta) for q in "sp" for theta in (0.0, 20.0, 40.0, 60.0, 80.0)}
    for scan in measurement.scans:
        grid = measurement.brdf.theta_r_deg[scan.rows]
        np.testing.assert_allclose(grid, np.arange(-80.0, 80.25, 0.5))
    for q in "sp":
        dhr_angles = measurement.dhr.theta_i_deg[measurement.dhr.polarization == q]
        np.testing.assert_allclose(dhr_angles, np.arange(10.0, 81.0, 10.0))
    assert measurement.wavelength_um == 3.39


def test_the_stated_noise_is_the_noise():
    measurement = pb.read_measurement(GREEN)
    for scan in measurement.scans:
        rows = scan.rows
        model = pb.brdf(
            pb.GREEN_PAINT, scan.theta_i_deg, measurement.brdf.theta_r_deg[rows], scan.polarization
        )
        deviation = np.log(measurement.brdf.value[rows] / model)
        assert deviation.std() == pytest.approx(0.02, rel=0.2)  # 5 standard errors of 321 readings
        assert abs(deviation.mean()) < 4.0 * 0.02 / np.sqrt(deviation.size)


def test_the_documented_command_makes_the_same_file(tmp_path):
    readme = (GREEN.parent / "README.md").read_text(encoding="utf-8")
    command = shlex.split(re.search(r"^pbrdf-bayes (simulate .*)$", readme, re.MULTILINE)[1])
    out = tmp_path / command[-1]
    assert main([*command[:-1], str(out)]) == 0
    if out.read_bytes() == GREEN.read_bytes():
        return
    again, committed = _rows(out), _rows(GREEN)  # another libm: the last digit may differ
    labels = [name for name in committed[0] if name != "value"]
    assert [[r[n] for n in labels] for r in again] == [[r[n] for n in labels] for r in committed]
    np.testing.assert_allclose(
        [float(r["value"]) for r in again], [float(r["value"]) for r in committed], rtol=1e-12
    )
