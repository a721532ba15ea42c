"""Files for other programs: read back by parsers written here from the formats alone."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main
from pbrdf_bayes.io.export.astm import astm_text
from pbrdf_bayes.io.export.fred import fred_text
from pbrdf_bayes.io.export.records import Origin, Rows, SpecularGrid
from pbrdf_bayes.io.export.tensor import tensor_bytes
from pbrdf_bayes.io.export.zemax import zemax_text
from pbrdf_bayes.verbs.export import FORMATS as FORMATS_OF_VERB
from pbrdf_bayes.workflow.exporting import FORMATS

pytestmark = pytest.mark.usefixtures("signals_as_before")

GREEN = pb.GREEN_PAINT
PARAMS = '{"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}'
SHARED = Path(__file__).parents[2] / ".." / "shared" / "formats"
ORIGIN = Origin(
    sample="synthetic", program="0", statement="made up", measured=False,
    timestamp="2026-01-02T03:04:05Z", wavelengths_um=(0.65,), fitted=((),),
)  # fmt: skip


@pytest.fixture
def known() -> Path:
    folder = SHARED / "known_answers"
    if not folder.is_dir():
        pytest.skip(f"files with known answers are not here: {folder}")
    return folder


def export(out, *arguments, format="csv"):
    return main(["export", "--params", PARAMS, "--format", format, "--out", str(out), *arguments])


# parsers


def read_zemax(text):
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    assert not any(line.endswith("\t") for line in text.splitlines())
    head, axes, tis, rows = {}, {}, [], []
    at = 0
    while lines[at] != "DataBegin":
        name, *rest = lines[at].split()
        if name in ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial"):
            axes[name] = np.array(lines[at + 1].split(), dtype=float)
            assert axes[name].size == int(rest[0])
            at += 1
        elif rest:
            head[name] = rest[0]
        at += 1
    assert lines[-1] == "DataEnd"
    for line in lines[at + 1 : -1]:
        if line.startswith("TIS"):
            tis.append(float(line.split()[1]))
        else:
            rows.append(np.array(line.split(), dtype=float))
    names = ("AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
    values = np.reshape(rows, [axes[name].size for name in names])
    return head, [axes[name] for name in names], np.array(tis), values


def read_fred(text):
    first, second, *lines = text.splitlines()
    assert first.split() == ["type", "bsdf_data"]
    assert second.split()[:3] == ["format", "angles=deg", "bsdf=value"]
    found, theta_i = [], None
    for line in lines:
        numbers = [float(x) for x in line.split()]
        if len(numbers) == 2:
            theta_i = numbers[0]
        else:
            found.append([theta_i, *numbers])
    return np.array(found)


def read_astm(text):
    head, data = text.split("VARS ", 1)
    names, *lines = data.split("\r\n")
    keys = dict(line.split(" ", 1) for line in head.split("\r\n") if line)
    rows = np.array([line.split(",") for line in lines if line], dtype=float)
    assert int(keys["NUM_POINTS"]) == len(rows)
    return keys, names.split(","), rows


def read_tensor(content):
    assert content[:14] == b"tensor_file\0\x01\x00"
    at, fields = 18, {}
    for _ in range(struct.unpack_from("<I", content, 14)[0]):
        (length,) = struct.unpack_from("<H", content, at)
        name = content[at + 2 : at + 2 + length].decode()
        ndim, code, offset = struct.unpack_from("<HBQ", content, at + 2 + length)
        shape = struct.unpack_from(f"<{ndim}Q", content, at + 13 + length)
        dtype = {3: "<u2", 10: "<f4"}[code]
        assert offset % 8 == 0
        fields[name] = np.frombuffer(
            content, dtype, count=int(np.prod(shape)), offset=offset
        ).reshape(shape)
        at += 13 + length + 8 * ndim
    return fields


# the same numbers as files of others


def made_up(theta_i, theta_r, phi_r, q):
    """Truth of the known answers."""
    i, r, phi = np.deg2rad(theta_i), np.deg2rad(theta_r), np.deg2rad(phi_r)
    away = (np.sin(r) * np.cos(phi) - np.sin(i)) ** 2 + (np.sin(r) * np.sin(phi)) ** 2
    of = {"s": (0.020, 0.30), "p": (0.018, 0.20), "u": (0.019, 0.25)}
    c, a = of[q]
    return c + a * np.exp(-away / 0.25**2)


def made_up_rows(theta_i, theta_r, phi_r, q):
    n = theta_i.size
    return Rows(
        polarization=np.full(n, q), wavelength_um=np.full(n, 0.65), theta_i_deg=theta_i,
        theta_r_deg=theta_r, phi_r_deg=phi_r, value=made_up(theta_i, theta_r, phi_r, q),
        u_value=None,
    )  # fmt: skip


def test_zemax_writes_the_known_answer(known):
    text = (known / "zemax_u.bsdf").read_text()
    head, axes, tis, values = read_zemax(text)
    i, a, r = np.deg2rad(np.meshgrid(*axes, indexing="ij"))
    s = np.stack([np.sin(i), 0 * i, np.cos(i)])
    t = np.stack([-np.cos(i), 0 * i, np.sin(i)])
    y = np.stack([0 * i, 0 * i + 1, 0 * i])
    d = np.cos(r) * s + np.sin(r) * (np.cos(a) * t + np.sin(a) * y)
    theta_r, phi_r = np.rad2deg(np.arccos(np.clip(d[2], -1, 1))), np.rad2deg(np.arctan2(d[1], d[0]))
    truth = np.where(d[2] > 1e-9, made_up(np.rad2deg(i), theta_r, phi_r, "u"), 0.0)
    grid = SpecularGrid(
        theta_i_deg=axes[0], azimuth_deg=axes[1], radial_deg=axes[2], value=truth, dhr=tis
    )
    again = read_zemax(zemax_text(grid, ORIGIN, "u"))
    assert again[0] == head
    np.testing.assert_allclose(again[3], values, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(again[2], tis)


def test_fred_writes_the_known_answer(known):
    truth = read_fred((known / "fred_deg_value_inplane.txt").read_text())
    rows = made_up_rows(truth[:, 0], truth[:, 1], truth[:, 2], "u")
    again = read_fred(fred_text(rows))
    back = truth[:, 1] < 0
    assert np.array_equal(again[:, 1], np.abs(truth[:, 1]))
    assert np.array_equal(again[:, 2], np.where(back, 180.0, 0.0))
    np.testing.assert_allclose(again[:, 3], truth[:, 3], rtol=1e-6)


def test_astm_writes_the_known_answer(known):
    text = (known / "astm_s.astm").read_bytes().decode()
    _, names, truth = read_astm(text)
    degrees = np.rad2deg(truth)
    rows = made_up_rows(degrees[:, 0], degrees[:, 2], 180.0 - degrees[:, 3], "s")
    keys, again_names, again = read_astm(astm_text(rows, ORIGIN, "s"))
    assert names == again_names
    assert "polarization s" in keys["LAB_COMMENTS"]
    np.testing.assert_allclose(again, truth, atol=1.1e-6)


# against the model


def test_zemax_interpolates_to_one_per_cent(tmp_path):
    done = pb.export_brdf(GREEN, tmp_path / "z.bsdf", format="zemax", polarizations=["u"])
    assert [path.name for path in done.paths] == ["z_u.bsdf"]
    assert done.paths[0].stat().st_size < 64 * 2**20
    _, axes, tis, values = read_zemax(done.paths[0].read_text())
    np.testing.assert_allclose(tis, pb.dhr(GREEN, axes[0], "u"), atol=1e-6)
    rng = np.random.default_rng(2)
    points = np.stack(
        [rng.uniform(0, 70, 3000), rng.uniform(0, 180, 3000), rng.uniform(0, 80, 3000)]
    )
    i, a, r = np.deg2rad(points)
    x = np.cos(r) * np.sin(i) - np.sin(r) * np.cos(a) * np.cos(i)
    z = np.cos(r) * np.cos(i) + np.sin(r) * np.cos(a) * np.sin(i)
    y = np.sin(r) * np.sin(a)
    seen = z > np.sin(np.deg2rad(15.0))
    exact = pb.brdf(
        GREEN, points[0, seen], np.rad2deg(np.arccos(z[seen])), "u",
        phi_r_deg=np.rad2deg(np.arctan2(y[seen], x[seen])),
    )  # fmt: skip
    between = RegularGridInterpolator(tuple(axes), values)(points.T[seen])
    error = np.abs(between / exact - 1.0)
    assert seen.sum() > 1000
    assert np.median(error) < 0.002
    assert error.max() < 0.01


@pytest.mark.parametrize("format", ["fred", "astm"])
def test_a_hemisphere_interpolates_to_one_per_cent(tmp_path, format):
    narrow = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.05)
    done = pb.export_brdf(
        narrow, tmp_path / "h.txt", format=format, polarizations=["s"], theta_i_deg=[0.0, 40.0]
    )
    text = done.paths[0].read_bytes().decode()
    if format == "fred":
        rows = read_fred(text)
    else:
        rows = np.rad2deg(read_astm(text)[2])
        rows = np.stack([rows[:, 0], rows[:, 2], 180.0 - rows[:, 3], np.deg2rad(rows[:, 4])], 1)
    rows = rows.round(6 if format == "fred" else 5)
    rows[:, 3] = read_fred(text)[:, 3] if format == "fred" else read_astm(text)[2][:, 4]
    np.testing.assert_allclose(
        rows[:, 3], pb.brdf(narrow, rows[:, 0], rows[:, 1], "s", phi_r_deg=rows[:, 2]), rtol=3e-5
    )
    rows = rows[(rows[:, 0] == 40.0) & (rows[:, 1] > 0)]
    theta, phi = np.unique(rows[:, 1]), np.unique(rows[:, 2])
    order = np.lexsort((rows[:, 2], rows[:, 1]))
    values = rows[order, 3].reshape(theta.size, phi.size)
    rng = np.random.default_rng(3)
    at = np.stack([rng.uniform(30, 50, 3000), rng.uniform(0, 15, 3000)], 1)
    exact = pb.brdf(narrow, 40.0, at[:, 0], "s", phi_r_deg=at[:, 1])
    counted = exact > 0.01 * exact.max()
    error = np.abs(RegularGridInterpolator((theta, phi), values)(at) / exact - 1.0)[counted]
    assert counted.sum() > 1000
    assert error.max() < 0.01


def test_the_csv_reads_back(tmp_path):
    assert export(tmp_path / "a.csv", "--theta-i", "20,60", "--wavelength-um", "0.65") == 0
    m = pb.read_measurement(tmp_path / "a.csv")
    assert m.wavelength_um == 0.65
    assert "simulated" in m.sample
    for q in "spu":
        mine = m.brdf.polarization == q
        values = pb.brdf(GREEN, m.brdf.theta_i_deg[mine], m.brdf.theta_r_deg[mine], q)
        np.testing.assert_allclose(m.brdf.value[mine], values, rtol=1e-7)
    np.testing.assert_allclose(
        m.dhr.value[m.dhr.polarization == "s"], pb.dhr(GREEN, [20.0, 60.0], "s")
    )


def bird_schema():
    jsonschema = pytest.importorskip("jsonschema")
    referencing = pytest.importorskip("referencing")
    folder = SHARED / "bird" / "schema"
    if not folder.is_dir():
        pytest.skip(f"the official schemas are not here: {folder}")
    loaded = {}
    for path in folder.glob("*.json"):
        try:
            loaded[path.name] = json.loads(path.read_text("utf-8"))
        except ValueError:  # one of them is no JSON
            assert path.name.startswith("sample_holder")
    registry = referencing.Registry().with_resources(
        (schema["$id"], referencing.Resource.from_contents(schema)) for schema in loaded.values()
    )
    return jsonschema.Draft202012Validator(
        loaded["brdf_json_schema_v1.0.json"], registry=registry,
        format_checker=jsonschema.Draft202012Validator.FORMAT_CHECKER,
    )  # fmt: skip


def bird_rows(path):
    data = json.loads(path.read_text("utf-8"))["data"]
    forward = 180.0 - np.array(data["phi_r"]["values"])
    theta_r = np.array(data["theta_r"]["values"])
    assert set(forward) <= {0.0, 180.0}
    return (
        np.array(data["theta_i"]["values"]), np.where(forward == 0.0, theta_r, -theta_r),
        np.array(data["polarization_i"]["values"]), np.array(data["BRDF"]["values"]),
    )  # fmt: skip


def test_bird_is_valid_and_holds_the_model(tmp_path):
    assert export(tmp_path / "a.brdf", format="bird") == 0
    content = json.loads((tmp_path / "a.brdf").read_text("utf-8"))
    theta_i, theta_r, q, value = bird_rows(tmp_path / "a.brdf")
    for word in "spu":
        mine = q == word
        np.testing.assert_allclose(
            value[mine], pb.brdf(GREEN, theta_i[mine], theta_r[mine], word), rtol=1e-6
        )
    rows = content["metadata"]["software"]["simulation_model"]["parameters"]
    assert {row["name"]: row["value"] for row in rows} == json.loads(PARAMS)
    assert content["metadata"]["sample"]["total_reflectance"]["value"] == pytest.approx(
        100 * float(pb.dhr(GREEN, 0.0, "u")), rel=1e-5
    )
    assert list(bird_schema().iter_errors(content)) == []


def test_bird_of_a_run_has_its_uncertainties(finished_run, tmp_path, capsys):
    out = tmp_path / "run.brdf"
    assert main(["export", str(finished_run), "--format", "bird", "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    content = json.loads(out.read_text("utf-8"))
    assert list(bird_schema().iter_errors(content)) == []
    summary = json.loads((finished_run / "summary.json").read_text("utf-8"))["parameters"]
    rows = content["metadata"]["software"]["simulation_model"]["parameters"]
    for row in rows:
        assert row["value"] == pytest.approx(summary[row["name"]]["median"], rel=1e-6)
        assert row["uncertainty"] == pytest.approx(summary[row["name"]]["sd"], rel=6e-3)
    theta_i, theta_r, q, value = bird_rows(out)
    curve = tmp_path / "c.csv"
    arguments = ["--theta-i", "20", "--theta-r", "10", "--polarization", "s", "--out", str(curve)]
    assert main(["predict", str(finished_run), *arguments]) == 0
    row = dict(zip(*(line.split(",") for line in curve.read_text().splitlines()), strict=True))
    mine = (theta_i == 20.0) & (theta_r == 10.0) & (q == "s")
    assert value[mine] == pytest.approx(float(row["value"]), rel=1e-5)
    u = np.array(content["data"]["uBRDF"]["values"])[mine]
    half = (float(row["q95"]) - float(row["q05"])) / 2 / 1.645
    assert u == pytest.approx(half, rel=0.2)


def test_pbsdf_holds_the_mueller_matrices(tmp_path):
    done = pb.export_brdf(GREEN, tmp_path / "g.pbsdf", format="mitsuba", wavelength_um=3.39)
    content = done.paths[0].read_bytes()
    assert len(content) < 65 * 2**20
    fields = read_tensor(content)
    assert fields["wvls"].tolist() == [360, 478, 595, 713, 830]
    h, d, phi = (fields[name][0].astype(float) for name in ("theta_h", "theta_d", "phi_d"))
    matrix = fields["M"]
    assert matrix.shape == (phi.size, d.size, h.size, 5, 4, 4)
    assert np.isfinite(matrix).all()
    assert (phi[0], phi[-1]) == pytest.approx((-np.pi, np.pi))
    between = RegularGridInterpolator((phi, d, h), matrix[..., 0, :, :].astype(float))
    theta_i, theta_r = np.array([30.0, 60.0, 30.0, 50.0]), np.array([30.5, 30.0, 60.0, 5.0])
    at = np.deg2rad(
        np.stack([np.where(theta_r < theta_i, 0.0, 180.0), (theta_i + theta_r) / 2,
                  np.abs(theta_r - theta_i) / 2], 1)
    )  # fmt: skip
    found = between(at)
    f_s, f_p = pb.brdf(GREEN, theta_i, theta_r, "s"), pb.brdf(GREEN, theta_i, theta_r, "p")
    np.testing.assert_allclose(found[:, 0, 0] + found[:, 0, 1], f_s, rtol=0.02)
    np.testing.assert_allclose(found[:, 0, 0] - found[:, 0, 1], f_p, rtol=0.05)
    whole = pb.mueller(GREEN, theta_i, theta_r)
    np.testing.assert_allclose(found[:, :3, :3], whole, atol=0.02 * whole[:, :1, :1].max())
    assert (found[0, 2, 2] < 0) and (found[0, 3, 3] < 0)


# arguments and files


def test_the_verb_knows_every_format():
    assert set(FORMATS_OF_VERB) == set(FORMATS)


@pytest.mark.parametrize("format", ["zemax", "fred", "astm"])
def test_a_file_for_each_polarisation(tmp_path, capsys, format):
    out = tmp_path / "a.b.txt"
    assert export(out, "--theta-i", "20", "--polarization", "p,s", format=format) == 0
    told = capsys.readouterr()
    assert told.out.split() == [str(tmp_path / "a.b_p.txt"), str(tmp_path / "a.b_s.txt")]
    assert "not in the file" in told.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.b_p.txt", "a.b_s.txt"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--theta-i", "95"], "theta_i_deg"),
        (["--theta-i", "nan"], "theta_i_deg"),
        (["--theta-i", ""], "theta_i_deg"),
        (["--wavelength-um", "-1"], "wavelength_um"),
        (["--wavelength-um", "nan"], "wavelength_um"),
        (["some_run"], "--params"),
    ],
)
def test_bad_arguments_are_refused(tmp_path, capsys, arguments, named):
    assert export(tmp_path / "a.csv", *arguments) == 2
    told = capsys.readouterr()
    assert named in told.err
    assert told.out == ""
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    assert export(tmp_path / "no" / "a.csv") == 2
    assert export(tmp_path) == 2
    with pytest.raises(pb.ConfigError, match="bird"):
        pb.export_brdf(GREEN, tmp_path / "a", format="birds")


def test_a_pbsdf_has_five_wavelengths(finished_run, tmp_path):
    with pytest.raises(pb.ConfigError, match="same wavelength"):
        pb.export_brdf([finished_run] * 2, tmp_path / "a.pbsdf", format="mitsuba")
    with pytest.raises(pb.ConfigError, match="no run has"):
        pb.export_brdf(finished_run, tmp_path / "a.csv", format="csv", wavelength_um=1.0)
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_not_replaced(finished_run):
    with pytest.raises(pb.RunFolderError, match=r"summary\.json"):
        pb.export_brdf(finished_run, finished_run / "summary.json", format="csv")


def test_instrument_effects_are_left_out(tmp_path):
    effects = pb.Effects(scale_p=1.2, aperture_deg=1.0)
    done = pb.export_brdf(
        GREEN, tmp_path / "a.csv", format="csv", effects=effects, theta_i_deg=[20.0]
    )
    assert any("scale_p" in note and "aperture_deg" in note for note in done.notes)
    m = pb.read_measurement(tmp_path / "a.csv")
    p = m.brdf.polarization == "p"
    np.testing.assert_allclose(
        m.brdf.value[p], pb.brdf(GREEN, 20.0, m.brdf.theta_r_deg[p], "p"), rtol=1e-7
    )


def test_a_tensor_file_is_read_back():
    rng = np.random.default_rng(1)
    arrays = {"odd": np.arange(5, dtype="<u2"), "m": rng.random((2, 3, 1)).astype("<f4")}
    again = read_tensor(tensor_bytes(arrays))
    for name, array in arrays.items():
        assert np.array_equal(again[name], array)
