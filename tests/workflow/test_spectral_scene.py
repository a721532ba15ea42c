"""A scene at several wavelengths: each number is that of the run of its wavelength alone."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import main
from pbrdf_bayes.workflow.fitting import fit_file

pytestmark = pytest.mark.usefixtures("signals_as_before")

SCENE = """\
theta_i_deg = [20, 60]
theta_r_deg = "0:80:20"
phi_r_deg = "0:180:60"
polarizations = "s"
dhr_theta_i_deg = [10, 70]
stokes_incident = "u"
n_draws = 10
"""
VISIBLE = pb.Parameters(n=1.45, k=0.05, sigma_n0=0.2, rho0=0.8)


@pytest.fixture(scope="module")
def visible(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample of `finished_run` at another wavelength, where it is another surface."""
    folder = tmp_path_factory.mktemp("visible")
    measurement = pb.simulate_measurement(
        VISIBLE, seed=4, sample="small", wavelength_um=0.65, theta_i_deg=(20.0, 60.0),
        theta_r_deg=np.linspace(-80.0, 80.0, 17),
    )  # fmt: skip
    pb.write_tidy_csv(measurement, folder / "visible_simulated.csv")
    draft = pb.RunConfig(accuracy="draft", holdout=False)
    fit_file(folder / "visible_simulated.csv", draft, out=folder / "run", seed=1)
    return folder / "run"


def ask(text: str, *runs: object, out: str = "o") -> int:
    Path("scene.toml").write_text(text, encoding="utf-8")
    return main(["predict", *map(str, runs), "--scene", "scene.toml", "--out", out])


def test_each_wavelength_is_the_scene_of_its_run(here, finished_run, visible, capsys):
    """In the order of the wavelengths, whatever that of the folders is."""
    assert ask(SCENE, finished_run, visible) == 0
    assert capsys.readouterr().out == "o\n"
    rows = list(csv.DictReader(Path("o/scene.csv").read_text("utf-8").splitlines()))
    assert list(dict.fromkeys(row["wavelength_um"] for row in rows)) == ["0.65", "3.39"]
    with xr.open_dataset("o/scene.nc", engine="h5netcdf") as file:
        whole = file.load()
    np.testing.assert_array_equal(whole["wavelength_um"], [0.65, 3.39])
    for at, run in ((0, visible), (1, finished_run)):
        assert ask(SCENE, run, out=f"one{at}") == 0
        alone = list(csv.DictReader(Path(f"one{at}/scene.csv").read_text("utf-8").splitlines()))
        assert rows[at * len(alone) : (at + 1) * len(alone)] == alone
        with xr.open_dataset(f"one{at}/scene.nc", engine="h5netcdf") as file:
            for name in ("brdf", "dhr", "stokes", "dolp", "aolp_deg"):
                assert whole[name].dims == ("wavelength_um", *file[name].dims)
                np.testing.assert_array_equal(whole[name].isel(wavelength_um=at), file[name])
            assert float(file["wavelength_um"]) == whole["wavelength_um"][at]
            verdict = load_analysis(run).summary["verdict"]
            assert verdict == file.attrs["verdict"]
            told = whole.attrs.get("verdict") or whole["verdict"].values[at]
            assert told == verdict
    assert whole.attrs["sample"] == "small_simulated"
    assert not np.allclose(whole["dhr"][0], whole["dhr"][1], rtol=0.05)


def test_the_page_has_a_chapter_and_pictures_for_each(here, finished_run, visible):
    assert ask(SCENE, visible, finished_run) == 0
    page = Path("o/scene.html").read_text(encoding="utf-8")
    assert re.findall(r"<h2>(.*?)</h2>", page) == ["0.65 µm", "3.39 µm"]
    assert "2 wavelengths" in page
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))
    pictures = {p.name for p in Path("o").glob("scene_*.svg")}
    assert {f"scene_dhr_{w}um.svg" for w in ("0.65", "3.39")} <= pictures
    assert len(pictures) % 2 == 0


def test_only_the_wavelengths_asked_for_are_computed(here, finished_run, visible, monkeypatch):
    computed = []
    of_one = pb.predict_scene

    def counted(run, scene):
        computed.append(run.summary["wavelength_um"])
        return of_one(run, scene)

    monkeypatch.setattr("pbrdf_bayes.workflow.spectral_scene.predict_scene", counted)
    assert ask(SCENE + "wavelength_um = 0.65\n", finished_run, visible) == 0
    assert computed == [0.65]
    assert Path("o/scene_dhr.svg").exists()
    runs = [load_analysis(folder) for folder in (finished_run, visible)]
    wanted = pb.Scene(dhr_theta_i_deg=(20.0,), wavelength_um=(0.65, 3.39), n_draws=10)
    found = pb.predict_spectral_scene(runs, wanted)
    assert [v.wavelength_um for v in found] == [0.65, 3.39]
    assert [v.scene.wavelength_um for v in found] == [(0.65,), (3.39,)]


def other_sample(run: Path, folder: Path) -> Path:
    """A copy of the run under another name of the sample."""
    shutil.copytree(run, folder)
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    (folder / "summary.json").write_text(json.dumps(summary | {"sample": "other"}), "utf-8")
    return folder


@pytest.mark.parametrize(
    ("key", "runs", "told"),
    [
        ("wavelength_um = [0.65, 4.5]", "both", "there is no run of 4.5, they are of 0.65, 3.39"),
        ("wavelength_um = [0.65, 3.39]", "one", "0.65 is not that of the run, 3.39"),
        ("wavelength_um = [3.39, 0.65]", "both", "0.65 follows 3.39. Give increasing wavelengths"),
        ("wavelength_um = []", "same", "two of the runs are of 3.39 um: give one run of each"),
        ('wavelength_um = "red"', "both", "'red' is not a finite number: give micrometres"),
        ("wavelength_um = [0.65, 1e9]", "both", "give a number in [0.01, 10000]"),
        ("n_draws = 11", "other", "runs are of different samples ('small_simulated', 'other')"),
    ],
)
def test_what_does_not_fit_together_is_refused(
    here, finished_run, visible, capsys, key, runs, told
):
    given = {
        "both": (finished_run, visible), "one": (finished_run,),
        "same": (finished_run, finished_run),
    }.get(runs) or (visible, other_sample(finished_run, here / "copy"))  # fmt: skip
    text = SCENE.replace("n_draws = 10\n", "") + key + "\n"
    assert ask(text, *given) == 2
    error = capsys.readouterr().err
    assert "scene.toml: " in error
    assert told in error
    assert not Path("o").exists()


def test_given_parameters_are_of_one_wavelength(here, capsys):
    Path("scene.toml").write_text(SCENE + "wavelength_um = [0.65, 3.39]\n", encoding="utf-8")
    params = '{"n": 1.5, "k": 0.1, "sigma_n0": 0.2, "rho0": 0.5}'
    assert main(["predict", "--params", params, "--scene", "scene.toml", "--out", "o"]) == 2
    assert "parameters belong to one wavelength. Give one, or a run of each" in (
        capsys.readouterr().err
    )
    with pytest.raises(pb.ConfigError, match="no run is given"):
        pb.predict_spectral_scene([], pb.Scene(dhr_theta_i_deg=(20.0,)))


def test_a_table_is_of_one_run(here, finished_run, visible, capsys):
    assert main(["predict", str(finished_run), str(visible)]) == 2
    assert "several run folders make one table only with --scene" in capsys.readouterr().err
