"""``predict --scene``: the file that asks, the files that answer, and what is refused."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import xarray as xr

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import main
from pbrdf_bayes.io.scene_arrays import COLUMNS, scene_csv, scene_dataset
from pbrdf_bayes.io.scene_toml import read_scene
from pbrdf_bayes.report.figures.scene import scene_pictures
from pbrdf_bayes.report.scene_page import render_scene, standalone_svg
from pbrdf_bayes.scenes import SCENE_HELP, Scene

pytestmark = pytest.mark.usefixtures("signals_as_before")

PARAMS = '{"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}'
WHOLE = """\
theta_i_deg = [20, 60]
theta_r_deg = "0:80:10"
phi_r_deg = "0:180:15"
polarizations = ["s", "p"]
dhr_theta_i_deg = "0:80:20"
stokes_incident = "u"
depolarisation = 0.1
"""
PLANE = 'theta_i_deg = 40\ntheta_r_deg = "-80:80:5"\npolarizations = "u"\n'


def ask(text: str, *arguments: object, out: str | None = "o") -> int:
    Path("scene.toml").write_text(text, encoding="utf-8")
    given = arguments or ("--params", PARAMS)
    target = () if out is None else ("--out", out)
    try:
        return main([str(a) for a in ("predict", *given, "--scene", "scene.toml", *target)])
    except SystemExit as stop:
        return int(str(stop.code))


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


def names(folder: Path) -> set[str]:
    return {p.name for p in folder.iterdir() if not p.name.startswith(".")}


# ------------------------------------------------------------------------------------- the answer


def test_everything_is_written_and_the_folder_is_printed(here, capsys):
    assert ask(WHOLE) == 0
    captured = capsys.readouterr()
    assert captured.out == "o\n"
    pictures = {
        f"scene_{name}_{theta}.svg"
        for name in ("brdf_s", "brdf_p", "dolp", "aolp", "plane", "plane_dolp")
        for theta in (20, 60)
    }
    written = {"scene.csv", "scene.nc", "scene.html", "scene_dhr.svg", *pictures}
    assert names(here / "o") == written
    assert not list((here / "o").glob("*.part"))


def test_the_csv_is_the_public_model(here):
    assert ask(WHOLE) == 0
    rows = rows_of(Path("o/scene.csv"))
    assert tuple(rows[0]) == COLUMNS
    n = 2 * 9 * 13
    counts = {q: sum(r["quantity"] == q for r in rows) for q in {r["quantity"] for r in rows}}
    assert counts == {"brdf": 2 * n, "S0": n, "S1": n, "S2": n, "dolp": n, "dhr": 10, "aolp_deg": n}
    for row in rows[:: len(rows) // 40]:
        if row["quantity"] == "brdf":
            at = [float(row[k]) for k in ("theta_i_deg", "theta_r_deg", "phi_r_deg")]
            expected = pb.brdf(pb.GREEN_PAINT, *at[:2], row["polarization"], phi_r_deg=at[2])
            assert float(row["value"]) == pytest.approx(float(expected), rel=1e-8)
        assert row["q05"] == row["q95"] == ""
    last = rows[-1]
    assert (last["quantity"], last["theta_i_deg"], last["theta_r_deg"]) == ("dhr", "80", "")
    expected = pb.dhr(pb.GREEN_PAINT, 80.0, "p")
    assert float(last["value"]) == pytest.approx(float(expected), rel=1e-8)


def test_csv_and_netcdf_hold_the_same_numbers_with_bands(finished_run, here):
    assert ask(WHOLE + "n_draws = 50\n", finished_run) == 0
    found = pb.predict_scene(load_analysis(finished_run), read_scene(Path("scene.toml")))
    with xr.open_dataset("o/scene.nc", engine="h5netcdf") as file:
        data = file.load()
    for name in ("brdf", "dhr", "stokes", "dolp", "aolp_deg"):
        np.testing.assert_array_equal(data[name].values, getattr(found, name))
        assert data[name].attrs["units"] in ("sr-1", "1", "degree")
    assert "modulo 180" in data["aolp_deg"].attrs["comment"]
    assert data.attrs["sample"] == "small_simulated"
    assert data.attrs["depolarisation"] == 0.1
    assert data["quantile"].values.tolist() == [0.05, 0.5, 0.95]
    assert data["theta_r_deg"].attrs["units"] == "degree"
    columns = {"value": 0.5, "q05": 0.05, "q95": 0.95}
    for row in rows_of(Path("o/scene.csv"))[::37]:
        quantity, q = row["quantity"], row["polarization"]
        if quantity == "dhr":
            cell = data["dhr"].sel(polarization=q, dhr_theta_i_deg=float(row["theta_i_deg"]))
        else:
            at = {k: float(row[k]) for k in ("theta_i_deg", "theta_r_deg", "phi_r_deg")}
            cell = {
                "brdf": lambda q=q: data["brdf"].sel(polarization=q),
                "dolp": lambda: data["dolp"],
                "aolp_deg": lambda: data["aolp_deg"],
            }.get(quantity, lambda c=quantity: data["stokes"].sel(component=c))().sel(at)
        for column, quantile in columns.items():
            expected = float(cell.sel(quantile=quantile))
            told = float(row[column] or "nan")
            assert told == pytest.approx(expected, rel=1e-8, abs=1e-300, nan_ok=True)


def test_only_what_was_asked_for_is_in_the_files(here):
    assert ask(PLANE) == 0
    assert names(here / "o") == {"scene.csv", "scene.nc", "scene.html", "scene_plane_40.svg"}
    assert {r["quantity"] for r in rows_of(Path("o/scene.csv"))} == {"brdf"}
    with xr.open_dataset("o/scene.nc", engine="h5netcdf") as file:
        assert set(file.data_vars) == {"brdf"}
        assert "dhr_theta_i_deg" not in file.coords


def test_a_scene_of_dhr_alone(here):
    assert ask('dhr_theta_i_deg = "0:80:10"\npolarizations = ["s", "p", "u"]\n') == 0
    assert names(here / "o") == {"scene.csv", "scene.nc", "scene.html", "scene_dhr.svg"}


def test_a_second_scene_replaces_the_first_whole(here):
    assert ask(WHOLE) == 0
    assert ask(PLANE) == 0
    assert names(here / "o") == {"scene.csv", "scene.nc", "scene.html", "scene_plane_40.svg"}


def test_the_same_scene_gives_the_same_files(here):
    assert ask(WHOLE) == 0
    assert ask(WHOLE, out="again") == 0
    for path in (here / "o").iterdir():
        if path.suffix in (".csv", ".html", ".svg"):
            assert path.read_bytes() == (here / "again" / path.name).read_bytes()


def test_effects_of_the_file_are_those_of_the_json(here):
    assert ask(PLANE + "[effects]\nlambert = 0.05\n", out="a") == 0
    given = PARAMS.replace("}", ', "lambert": 0.05}')
    assert ask(PLANE, "--params", given, out="b") == 0
    assert Path("a/scene.csv").read_bytes() == Path("b/scene.csv").read_bytes()


# ------------------------------------------------------------------------------------ the pictures


def pictures_of(**given: Any) -> list[Any]:
    return scene_pictures(pb.predict_scene(pb.GREEN_PAINT, Scene(**given)))


def test_pictures_are_well_formed_and_say_what_they_show():
    theta, phi = tuple(np.arange(0.0, 86.0, 5.0)), tuple(np.arange(0.0, 181.0, 20.0))
    found = pictures_of(theta_i_deg=(50.0,), theta_r_deg=theta, phi_r_deg=phi, stokes_incident="p")
    by_name = {p.name: p for p in found}
    assert set(by_name) == {
        "scene_plane_50", "scene_plane_dolp_50", "scene_brdf_s_50", "scene_brdf_p_50", "scene_dolp_50",
        "scene_aolp_50",
    }  # fmt: skip
    for picture in found:
        root = ET.fromstring(standalone_svg(picture))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert int(root.attrib["width"]) <= 390
        text = "".join(root.itertext())
        assert "60°" in text
        assert "θ" in text
        assert re.search(r"\d", root.attrib["aria-label"])
    words = "".join(ET.fromstring(standalone_svg(by_name["scene_brdf_s_50"])).itertext())
    for label in ("φ", "90°", "180°", "30°", "BRDF (sr⁻¹), s", "specular", "0.1"):
        assert label in words


def test_half_and_whole_circle_draw_the_same_angles_of_polarisation():
    """The mirror image has the other sign."""
    given = {
        "theta_i_deg": (50.0,),
        "theta_r_deg": tuple(np.arange(0.0, 86.0, 5.0)),
        "polarizations": ("s",),
        "stokes_incident": "s",
    }
    circles = (np.arange(0.0, 181.0, 20.0), np.arange(-180.0, 1.0, 20.0), np.arange(0.0, 341.0, 20))
    drawn = [
        {p.name: p for p in pictures_of(**given, phi_r_deg=tuple(phi))}["scene_aolp_50"]
        for phi in circles
    ]
    assert drawn[0].svg == drawn[1].svg == drawn[2].svg


def test_the_page_of_a_run_says_what_does_not_apply_or_was_assumed(finished_run, here, tmp_path):
    folder = Path(shutil.copytree(finished_run, tmp_path / "run"))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assumed = ["n = 1.5 was assumed, not measured."]
    cases = (("applies", [], False), ("applies", assumed, True), ("descriptive only", [], True))
    for i, (verdict, caveats, shown) in enumerate(cases):
        told = {"verdict": verdict, "caveats": caveats, "statement": "What is to be known."}
        text = json.dumps({**summary, "applicability": {**summary["applicability"], **told}})
        (folder / "summary.json").write_text(text, encoding="utf-8")
        assert ask(PLANE, folder, out=f"o{i}") == 0
        page = Path(f"o{i}/scene.html").read_text(encoding="utf-8")
        assert ("applicability of the model: What is to be known." in page) == shown


def test_half_and_whole_circle_draw_the_same_map():
    given = {
        "theta_i_deg": (50.0,),
        "theta_r_deg": tuple(np.arange(0.0, 86.0, 5.0)),
        "polarizations": ("s",),
    }
    half = pictures_of(**given, phi_r_deg=tuple(np.arange(0.0, 181.0, 20.0)))
    whole = pictures_of(**given, phi_r_deg=tuple(np.arange(0.0, 341.0, 20.0)))
    assert [p.svg for p in half] == [p.svg for p in whole]


@pytest.mark.parametrize(
    "given",
    [
        {"theta_r_deg": (10.0,)},
        {"theta_r_deg": (10.0,), "phi_r_deg": (0.0, 90.0, 180.0)},
        {"theta_r_deg": (10.0, 20.0), "phi_r_deg": (10.0, 20.0, 30.0)},
        {"theta_r_deg": (-20.0, 20.0), "phi_r_deg": (45.0,), "stokes_incident": "s"},
    ],
)
def test_what_cannot_be_drawn_is_left_out(given: dict[str, Any]):
    found = pictures_of(theta_i_deg=(30.0,), **given)
    assert [p for p in found if p.part == "hemisphere"] == []


def test_many_incidences_make_no_endless_page():
    wanted = Scene(theta_i_deg=tuple(np.arange(0.0, 89.0)), theta_r_deg=(-30.0, 0.0, 30.0))
    values = pb.predict_scene(pb.GREEN_PAINT, wanted)
    found = scene_pictures(values)
    assert len(found) == 8
    assert [found[0].name, found[-1].name] == ["scene_plane_0", "scene_plane_88"]
    assert "drawn: 8 of 89 angles of incidence" in render_scene([(values, found)])


def test_flat_maps_can_be_drawn():
    """No line can be drawn at a value that is nowhere, and a black sample has no logarithm."""
    theta, phi = tuple(np.arange(0.0, 86.0, 5.0)), tuple(np.arange(0.0, 181.0, 20.0))
    wanted = Scene(
        theta_i_deg=(0.0,), theta_r_deg=theta, phi_r_deg=phi, stokes_incident="u",
        depolarisation=1.0, dhr_theta_i_deg=(0.0, 30.0),
    )  # fmt: skip
    for strength in (0.0, 0.1):
        black = pb.Parameters(n=1.5, k=0.1, sigma_n0=0.0, rho0=0.3)
        values = pb.predict_scene(black, wanted, effects=pb.Effects(lambert=strength))
        page = render_scene([(values, scene_pictures(values))])
        assert page.count('<div class="panel">') == 7
        assert "nan" not in scene_csv(values)
        assert scene_dataset(values)["brdf"].shape == (2, 1, 18, 10, 1)


# ------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("theta_i_deg = [20]\ntheta_r = [0]\n", r"unknown key 'theta_r'\. Did you mean 'theta_r_deg'"),
        ("theta_i_deg = [20]\n", r"theta_r_deg is missing"),
        ("polarizations = ['s']\n", r"nothing is asked for: give theta_i_deg"),
        (PLANE.replace("40", "95"), r"theta_i_deg = 95\.0 is not allowed: give degrees in \[0, 89\.95\]"),
        (PLANE.replace("-80:80:5", "80:-80:5"), r"theta_r_deg = '80:-80:5' is not allowed"),
        (PLANE.replace("-80:80:5", "-80:80:0"), r'e\.g\. "-80:80:0\.5"'),
        (PLANE.replace("-80:80:5", "-80:80:1e-9"), r"fewer than 100000 angles"),
        (PLANE.replace('"-80:80:5"', "[0, 'a']"), r"theta_r_deg: 'a' in its list is not allowed: give finite numbers"),
        (PLANE.replace('"-80:80:5"', "[0, 1" + "0" * 400 + "]"), r"theta_r_deg\[2\] = 1000\d+\.\.\. is not allowed"),
        (PLANE.replace("40", "1" + "0" * 400), r"theta_i_deg\S* = 1000\d+\.\.\. is not allowed"),
        (PLANE.replace("40", "true"), r"theta_i_deg\S* .*True.* is not allowed: give finite numbers"),
        (PLANE + "n_draws = 1" + "0" * 400 + "\n", r"n_draws = 1000\d+\.\.\. is not allowed"),
        (PLANE.replace('"-80:80:5"', "[10, 0]"), r"theta_r_deg: 0\.0 follows 10\.0"),
        (PLANE.replace('"-80:80:5"', "[nan]"), r"theta_r_deg: nan in its list is not allowed"),
        (PLANE.replace('"u"', '"x"'), r"polarizations: 'x' is not known\. .*Allowed: 's', 'p', 'u'"),
        (PLANE.replace('"u"', "[]"), r"polarizations = \(\) is not allowed"),
        (PLANE + "depolarisation = 1.5\n", r"depolarisation = 1\.5 .* \[0, 1\]"),
        (PLANE + "depolarisation = 0.5\n", r"give stokes_incident"),
        (PLANE + "stokes_incident = 'c'\n", r"stokes_incident: 'c' is not known"),
        (PLANE + "stokes_incident = 's'\ninstrument = true\n", r"not available"),
        (PLANE + "phase = 'fresnell'\n", r"Did you mean 'fresnel'"),
        (PLANE + "n_draws = 3\n", r"n_draws = 3 .* whole number in \[10, 4000\]"),
        (PLANE + "instrument = 1\n", r"instrument = 1 is not allowed: give true or false"),
        (PLANE + "effects = 1\n", r"effects = 1 is not allowed: give a table"),
        (PLANE + "[effects]\nlambrt = 1\n", r"effects\.lambrt .*Did you mean 'lambert'"),
        (PLANE + "[effects]\nlambert = 'a'\n", r"lambert = 'a' is outside its range \[0, 1\]"),
        (PLANE + "phi_r_deg = '0:180:0.01'\n" + "theta_r_deg = '0:80:1'", r"not a TOML file"),
        ('theta_i_deg = 1\ntheta_r_deg = "0:80:.1"\nphi_r_deg = "0:180:.1"\n', r"allowed are 1000000"),
        ("theta_i_deg = [", r"not a TOML file"),
    ],
)  # fmt: skip
def test_a_bad_scene_is_two_with_file_key_and_remedy(here, capsys, text: str, message: str):
    assert ask(text) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("pbrdf-bayes predict: scene.toml: ")
    assert re.search(message, captured.err), captured.err
    assert not Path("o").exists()


def test_other_ways_to_ask_are_refused_beside_a_scene(here, capsys, finished_run):
    assert ask(PLANE, "--params", PARAMS, "--theta-i", "10") == 2
    assert "--theta-i with --scene" in capsys.readouterr().err
    assert ask(PLANE, out=None) == 2
    assert "--out FOLDER" in capsys.readouterr().err
    assert ask(PLANE, finished_run, "--params", PARAMS) == 2
    assert ask(PLANE, here) == 2
    assert "not a finished run" in capsys.readouterr().err
    assert ask(PLANE + "[effects]\nlambert = 0.1\n", finished_run) == 2
    assert "a run has its own" in capsys.readouterr().err
    assert names(here) == {"scene.toml"}


def test_other_files_are_not_written_over(here, capsys, finished_run):
    (here / "o").mkdir()
    (here / "o" / "mine.txt").write_text("x", encoding="utf-8")
    assert ask(PLANE) == 2
    assert "holds something else (mine.txt)" in capsys.readouterr().err
    assert ask(PLANE, out="scene.toml") == 2
    assert "is a file" in capsys.readouterr().err
    assert names(here / "o") == {"mine.txt"}


def test_no_such_scene_file(here, capsys):
    assert main(["predict", "--params", PARAMS, "--scene", "no.toml", "--out", "o"]) == 2
    assert "no.toml: cannot be read" in capsys.readouterr().err


def test_the_help_shows_a_scene_that_works(here, capsys):
    """The example in it can be copied as it stands."""
    with pytest.raises(SystemExit):
        main(["predict", "--help"])
    told = capsys.readouterr().out
    lines = [line for line in SCENE_HELP.splitlines() if line.startswith("  ")]
    assert "\n".join(lines) in told
    Path("scene.toml").write_text("\n".join(lines), encoding="utf-8")
    scene = read_scene(Path("scene.toml"))
    assert scene.n_directions == 2 * 35 * 37
    assert scene.depolarisation == 0.1


# ----------------------------------------------------------------------- wavelength, and the CSV alone


def test_a_scene_is_of_the_wavelength_of_the_run(here, capsys, finished_run):
    assert ask(PLANE + "wavelength_um = 3.39\nn_draws = 10\n", finished_run) == 0
    assert "3.39 µm" in Path("o/scene.html").read_text(encoding="utf-8")
    assert ask(PLANE + "wavelength_um = 4.5\n", finished_run, out="other") == 2
    told = capsys.readouterr().err
    assert "scene.toml: wavelength_um = 4.5 is not that of the run, 3.39" in told
    assert not Path("other").exists()
    assert ask(PLANE + "wavelength_um = 4.5\n", out="given") == 0
    assert "4.5 µm" in Path("given/scene.html").read_text(encoding="utf-8")
    assert ask(PLANE + "wavelength_um = 0\n", out="none") == 2
    assert "wavelength_um = 0 is not allowed: give a number in [0.01, 10000]" in (
        capsys.readouterr().err
    )


def test_a_dash_sends_the_csv_to_standard_output(here, capsys):
    assert ask(WHOLE) == 0
    capsys.readouterr()
    assert ask(WHOLE, out="-") == 0
    assert capsys.readouterr().out == Path("o/scene.csv").read_text(encoding="utf-8")
    assert main(["predict", "--params", PARAMS, "--theta-r", "0:10:5"]) == 0
    bare = capsys.readouterr().out
    assert main(["predict", "--params", PARAMS, "--theta-r", "0:10:5", "--out", "-"]) == 0
    assert capsys.readouterr().out == bare
    assert names(here) == {"scene.toml", "o"}


def test_a_page_without_maps_says_what_they_need(here):
    text = 'theta_i_deg = 40\ntheta_r_deg = "10:80:5"\nphi_r_deg = "20:160:20"\n'
    assert ask(text) == 0
    page = Path("o/scene.html").read_text(encoding="utf-8")
    assert "maps need theta_r from 0" in page
    assert ask(text.replace("20:160", "0:120"), out="half") == 0
    page = Path("half/scene.html").read_text(encoding="utf-8")
    assert "maps need theta_r from 0" in page


def test_a_page_says_where_s0_is_not_the_brdf(here):
    """Out of plane, and not for unpolarised light; the numbers beside it show why."""
    for incident, said in (("p", True), ("u", False)):
        assert ask(WHOLE.replace('"u"', f'"{incident}"'), out=incident) == 0
        page = Path(f"{incident}/scene.html").read_text(encoding="utf-8")
        assert ("S0 is not the BRDF out of plane" in page) == said
    rows = [r for r in rows_of(Path("p/scene.csv")) if r["theta_r_deg"] == "60" == r["theta_i_deg"]]
    at = {
        (r["quantity"], r["phi_r_deg"]): float(r["value"]) for r in rows if r["polarization"] == "p"
    }
    assert at["S0", "30"] > 2.0 * at["brdf", "30"]
    assert at["S0", "0"] == pytest.approx(at["brdf", "0"], rel=1e-9)
    assert ask(PLANE + 'stokes_incident = "p"\n', out="plane") == 0
    assert "out of plane" not in Path("plane/scene.html").read_text(encoding="utf-8")
