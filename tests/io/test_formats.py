"""Files as laboratories have them: one known BRDF written in every format, and every damage."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import main
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io.formats.content import UndecidedError
from pbrdf_bayes.io.formats.dispatch import FORMATS, is_tidy
from pbrdf_bayes.io.tidy_csv import read_samples

SHARED = Path(__file__).parents[3] / "shared" / "formats"
THETA_I = (20.0, 50.0)
SEMICOLONS = b"sample;wavelength_um;quantity\na;3,39;brdf\n"
THETA_R = tuple(float(a) for a in range(-70, 71, 10))


def truth(theta_i: object, theta_r: object, phi: object = 0.0, pol: str = "s") -> np.ndarray:
    """BRDF of the known answers [sr^-1]; degrees, signed theta_r."""
    i, r, p = (np.radians(np.asarray(a, dtype=float)) for a in (theta_i, theta_r, phi))
    alpha, beta = np.sin(r) * np.cos(p), np.sin(r) * np.sin(p)
    lobe = np.exp(-((alpha - np.sin(i)) ** 2 + beta**2) / 0.25**2)
    s, p_ = 0.020 + 0.30 * lobe, 0.018 + 0.20 * lobe
    return {"s": s, "p": p_, "u": (s + p_) / 2.0}[pol]


def reflectance(nm: object) -> np.ndarray:
    return 0.05 + 0.1 * np.exp(-(((np.asarray(nm, dtype=float) - 1000.0) / 600.0) ** 2))


GRID = [(i, r, float(truth(i, r))) for i in THETA_I for r in THETA_R]


def bird(**changes: object) -> str:
    """Official style: theta_r from the normal, phi_r 180 deg on the specular side."""
    i, r, f = (list(column) for column in zip(*GRID, strict=True))
    n = len(r)
    data = {
        "theta_i": {"unit": "deg", "values": i}, "phi_i": {"unit": "deg", "values": [0] * n},
        "theta_r": {"unit": "deg", "values": [abs(a) for a in r]},
        "phi_r": {"unit": "deg", "values": [180 if a > 0 else 0 for a in r]},
        "BRDF": {"unit": "1/sr", "values": f}, "uBRDF": {"unit": "%", "values": [2] * n},
        "wavelength_i": {"unit": "nm", "values": [650] * n},
        "polarization_i": {"notation": "inStokes", "values": [[1, 1, 0, 0]] * n},
    }  # fmt: skip
    return json.dumps({"metadata": {"sample": {"name": "made up"}}, "data": {**data, **changes}})


def bird_institute() -> str:
    """`value` for `values`, radians, an uncertainty and degrees of freedom of each reading."""
    i, r, f = (np.array(column) for column in zip(*GRID, strict=True))
    return json.dumps({"data": {
        "theta_i": {"unit": "rad", "value": np.radians(i).round(6).tolist()},
        "theta_r": {"unit": "rad", "value": np.radians(np.abs(r)).round(6).tolist()},
        "phi_r": {"unit": "rad", "value": np.where(r > 0, 3.141593, 0.0).tolist()},
        "BRDF": {"unit": "1/sr", "value": f.tolist(),
                 "uncertainty": {"unit": "1/sr", "value": (0.02 * f).tolist()},
                 "comments": {"degrees_of_freedom": [4] * f.size}},
        "wavelength_i": {"unit": "\u03bcm", "value": 0.65},
        "polarization_i": {"notation": "sp", "value": ["s"] * f.size},
    }})  # fmt: skip


def bird_legacy() -> str:
    return json.dumps({"head": {}, "data": {
        "wavelengths": [650], "theta_i": [g[0] for g in GRID], "phi_i": [0] * len(GRID),
        "theta_v": [-g[1] for g in GRID], "phi_v": [0] * len(GRID), "pol": "s" * len(GRID),
        "data": [[g[2] for g in GRID]],
    }})  # fmt: skip


def astm(end: str = "\r\n", vars_: str = "theta_i,phi_i,theta_s,phi_s,650nm") -> str:
    lines = ["LAB_COMMENTS incident polarization s", "SAMPLE_NAME made up", f"NUM_POINTS {len(GRID)}",
             f"VARS {vars_}", ""]  # fmt: skip
    lines += [
        f"{np.radians(i):.6f},0.000000,{np.radians(abs(r)):.6f},{np.pi if r > 0 else 0:.6f},{f:.6e}"
        for i, r, f in GRID
    ]
    return end.join([*lines, ""])


RADIAL, AZIMUTH = (0, 5, 10, 20, 40, 60, 90), (0, 90, 180)


def zemax(extra: str = "") -> str:
    """Azimuth 0 is towards the normal, so that theta_r = theta_i - R there."""
    lines = ["# made up, 650 nm", "Source\tMeasured", "Symmetry\tPlaneSymmetrical",
             "SpectralContent\tMonochrome", "ScatterType\tBRDF", "SampleRotation\t1", "0",
             f"AngleOfIncidence\t{len(THETA_I)}", "\t".join(map(str, THETA_I)),
             f"ScatterAzimuth\t{len(AZIMUTH)}", "0\t90", "180\t", f"ScatterRadial {len(RADIAL)}",
             "\t".join(map(str, RADIAL)), "", "Monochrome", "DataBegin"]  # fmt: skip
    for i in THETA_I:
        lines.append("TIS 0.12")
        for azimuth in AZIMUTH:
            a, r, t = np.radians(azimuth), np.radians(RADIAL), np.radians(i)
            x = np.cos(r) * np.sin(t) - np.sin(r) * np.cos(a) * np.cos(t)
            y, z = np.sin(r) * np.sin(a), np.cos(r) * np.cos(t) + np.sin(r) * np.cos(a) * np.sin(t)
            f = truth(i, np.degrees(np.arccos(np.clip(z, 0, 1))), np.degrees(np.arctan2(y, x)))
            lines.append("\t".join(f"{v:.8e}" for v in np.where(z > 1e-9, f, 0.0)))
    return "\n".join([*lines, "DataEnd", extra])


def fred(angles: str = "deg", bsdf: str = "value") -> str:
    lines = ["type bsdf_data", f"format angles={angles} bsdf={bsdf} scale=1"]
    for i in THETA_I:
        lines.append(f"{i}\t0" if angles == "deg" else f"0 {np.sin(np.radians(i)):.8f}")
        for r in THETA_R:
            f = truth(i, r) if bsdf == "value" else np.log10(truth(i, r))
            where = f"{r} 0" if angles == "deg" else f"0 {np.sin(np.radians(r)):.8f}"
            lines.append(f"{where} {f:.8f}")
    return "\n".join(lines)


def lighttools() -> str:
    """Light from azimuth 90, so that 270 is the specular side."""
    polar = (0, 10, 20, 30, 40, 50, 60, 70)
    lines = ["Symmetry PlaneSymmetrical", "SpectralContent Monochrome", "ScatterAzimuth 2", "90 270",
             f"ScatterRadial {len(polar)}", " ".join(map(str, polar)), "DataBegin"]  # fmt: skip
    for i in THETA_I:
        lines += [
            f"AOI {i}",
            "POI 90",
            "Side Front",
            "Wavelength 650",
            "ScatterType BRDF",
            "TIS 0.12",
        ]
        lines += [
            " ".join(f"{v:.8f}" for v in truth(i, sign * np.array(polar))) for sign in (-1, 1)
        ]
    return "\n".join([*lines, "DataEnd"])


def jdv() -> str:
    lines = []
    for i in THETA_I:
        lines += [
            "DataType:\tBRDF(RT-300S)\t ",
            f"Incidence:\t{i}\t",
            "Raw data",
            "\t" + "\t".join(map(str, THETA_R)),
        ]
        lines += ["-90\t" + "\t".join(f"{v:.8f}" for v in truth(i, np.array(THETA_R))), "\t\t", ""]
    return "\r".join(lines)


def matrix(separator: str = ";") -> str:
    rows = [["theta_r\\theta_i", *(f"{i:g}" for i in THETA_I)]]
    rows += [[f"{r:g}", *(f"{truth(i, r):.8f}" for i in THETA_I)] for r in THETA_R]
    text = "\n".join(separator.join(row) for row in rows)
    title = "BRDF [1/sr] (s, 0.65 \u00b5m)\n"
    return title.replace(".", ",") + text.replace(".", ",") if separator == ";" else title + text


def listed() -> str:
    rows = [" Incident_angle,Measure_angle, 640nm , 650nm "]
    rows += [f"{i:g},{r:g},{0.9 * f:.8f},{f:.8f}" for i, r, f in GRID]
    return "\n".join(["BRDF s-polarized", *rows])


def workbook() -> bytes:
    book, out = openpyxl.Workbook(), io.BytesIO()
    sheet = book.active
    sheet.append(["made up, BRDF, polarization s, 650 nm"])
    sheet.append(["theta_r\\theta_i", *THETA_I])
    for r in THETA_R:
        sheet.append([r, *(float(truth(i, r)) for i in THETA_I)])
    book.save(out)
    return out.getvalue()


BRDF_FILES: dict[str, tuple[str, Callable[[], str | bytes], dict[str, object]]] = {
    "bird": ("bird", bird, {}),
    "bird of an institute": ("bird", bird_institute, {}),
    "bird legacy": ("bird", bird_legacy, {}),
    "astm": ("astm", astm, {}),
    "astm LF, one column not in VARS": (
        "astm",
        lambda: astm("\n", "theta_i,phi_i,theta_s,650nm"),
        {},
    ),
    "zemax": ("zemax", zemax, {"polarization": "s"}),
    "fred": ("fred", fred, {"polarization": "s", "wavelength_um": 0.65}),
    "fred sin log": (
        "fred",
        lambda: fred("sin", "log"),
        {"polarization": "s", "wavelength_um": 0.65},
    ),
    "lighttools": ("lighttools", lighttools, {"polarization": "s"}),
    "jdv": ("rt300s", jdv, {"polarization": "s", "wavelength_um": 0.65}),
    "matrix with decimal commas": ("table", matrix, {}),
    "matrix with tabs": ("table", lambda: matrix("\t"), {}),
    "matrix with commas": ("table", lambda: matrix(","), {}),
    "list": ("table", listed, {"wavelength_um": 0.65}),
    "xlsx": ("table", workbook, {}),
}


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def write(content: str | bytes, name: str = "any.dat") -> Path:
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write


def assert_truth(m: pb.Measurement, *, rtol: float = 3e-5) -> None:
    """In-plane readings of both signs, and every reading is that of its direction."""
    assert m.wavelength_um == pytest.approx(0.65)
    assert set(m.brdf.polarization.tolist()) == {"s"}
    assert m.brdf.theta_r_deg.min() < -30.0 < 30.0 < m.brdf.theta_r_deg.max()
    wanted = truth(m.brdf.theta_i_deg, m.brdf.theta_r_deg, m.brdf.phi_r_deg)
    np.testing.assert_allclose(m.brdf.value, wanted, rtol=rtol)


@pytest.mark.parametrize("name", list(BRDF_FILES))
def test_the_known_brdf_is_read_from_every_format(write, name):
    wanted, make, decided = BRDF_FILES[name]
    m = pb.import_readings(write(make()), **decided)
    assert m.warnings[0] == f"format: {wanted}"
    assert_truth(m)


@pytest.mark.parametrize("name", [n for n, (_, _, decided) in BRDF_FILES.items() if not decided])
def test_what_is_decided_by_the_file_is_read_by_all_verbs(write, name, capsys):
    file = write(BRDF_FILES[name][1](), "lab.csv")
    assert_truth(pb.read_measurement(file))
    assert list(read_samples(file).measurements)
    assert main(["check", str(file)]) == 0
    assert "format: " in capsys.readouterr().out


def test_uncertainties_of_bird(write):
    m = pb.import_readings(write(bird()))
    np.testing.assert_allclose(m.brdf.u_value, 0.02 * m.brdf.value)
    assert not m.brdf.repeated.any()
    m = pb.import_readings(write(bird_institute()))
    np.testing.assert_allclose(m.brdf.u_value, 0.02 * m.brdf.value)  # dof + 1 readings each
    assert m.brdf.repeated.all()


def test_total_reflectances_become_dhr(write):
    for make in (zemax, lighttools):
        m = pb.import_readings(write(make()), polarization="s")
        assert m.dhr.theta_i_deg.tolist() == list(THETA_I)
        assert m.dhr.value.tolist() == [0.12, 0.12]
    one = json.loads(bird())
    one["metadata"]["sample"]["total_reflectance"] = {"value": 12.0, "unit": "%"}
    m = pb.import_readings(write(json.dumps(one)), theta_i_deg=20.0)
    assert (m.dhr.theta_i_deg.tolist(), m.dhr.value.tolist()) == ([20.0], [0.12])


def test_kinds_of_values(write):
    """Reflectance factors are pi BRDF; cosine-weighted ones are BRDF cos theta_r."""
    brf = fred().splitlines()
    brf[2:] = [_scaled(line, np.pi) for line in brf[2:]]
    decided = {"polarization": "s", "wavelength_um": 0.65}
    m = pb.import_readings(write("\n".join(brf)), value="brf", **decided)
    assert_truth(m)
    cosine = fred().splitlines()
    cosine[2:] = [_scaled(line, np.cos(np.radians(float(line.split()[0])))) for line in cosine[2:]]
    assert_truth(pb.import_readings(write("\n".join(cosine)), value="brdf_cos", **decided))


def _scaled(line: str, factor: float) -> str:
    cells = line.split()
    return " ".join([*cells[:2], *(f"{float(c) * factor:.9f}" for c in cells[2:])])


def test_the_forward_side_is_found_or_asked_for(write):
    turned = json.loads(bird())
    turned["data"]["phi_r"]["values"] = [180 - p for p in turned["data"]["phi_r"]["values"]]
    m = pb.import_readings(write(json.dumps(turned)))
    assert any("forward side: phi0, from the lobe" in text for text in m.warnings)
    assert_truth(m)
    flat = json.loads(bird())
    flat["data"]["BRDF"]["values"] = [0.1] * len(GRID)
    with pytest.raises(UndecidedError, match="--forward phi0"):
        pb.import_readings(write(json.dumps(flat)))
    m = pb.import_readings(write(json.dumps(flat)), forward="phi180")
    assert len(m.brdf) == len(GRID)


# Spectra

NM = np.arange(2500, 250, -100)


def cary(unit: str = "%R") -> str:
    rows = [f"{x},{100 * reflectance(x):.6f},{x},99.0" for x in NM]
    head = ["paint s-pol,,Baseline 100%T,", f"Wavelength (nm),{unit},Wavelength (nm),%R"]
    return "\r\n".join(
        [*head, *rows, ",,,", "paint s-pol,,,", "Collection Time: 02-Jan-26 3:04:05 PM"]
    )


def perkinelmer(unit: str = "%R", comma: bool = False) -> str:
    rows = [f"{x:.6f}\t{100 * reflectance(x):.6f}" for x in NM]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    head = ["PE UV       SUBTECH     SPECTRUM    ASCII       PEDS        4.00", *["x"] * 7,
            "paint 8 deg s", *["-1"] * 66, "#HDR", "-1", "-1", "#GR", "nm", unit, "1.0", "0.0",
            "2500", "-100", str(len(NM)), "8", "1", "0", "#DATA"]  # fmt: skip
    return "\r\n".join([*head, *rows, ""])


def perkinelmer_csv() -> str:
    rows = [f"{x:.1f};{100 * reflectance(x):.6f}".replace(".", ",") for x in NM]
    return "\n".join(["Created as New Dataset;", "nm;%R", *rows])


def ecostress() -> str:
    head = ["Name: paint", "Type: manmade", "Measurement: Directional (10 Degree) Hemispherical Reflectance",
            "X Units: Wavelength (micrometers)", "Y Units: Reflectance (percent)",
            f"Number of X Values: {len(NM)}", ""]  # fmt: skip
    return "\n".join([*head, *(f"{x / 1000:.4f}\t{100 * reflectance(x):.6f}" for x in NM)])


def spectrum(unit: str) -> str:
    x = {"nm": NM, "um": NM / 1000.0, "cm^-1": 1e7 / NM}[unit]
    rows = [f"{a:.6f},{reflectance(nm):.8f},0.001" for a, nm in zip(x, NM, strict=True)]
    return "\n".join([f"x ({unit}),Reflectance,RMS", *rows])


ALL = {"theta_i_deg": 8.0, "polarization": "s"}
SPECTRA: dict[str, tuple[str, Callable[[], str], dict[str, object]]] = {
    "cary": ("cary", cary, {"theta_i_deg": 8.0}),
    "perkinelmer": ("perkinelmer", perkinelmer, {}),
    "perkinelmer with decimal commas": ("perkinelmer", lambda: perkinelmer(comma=True), {}),
    "perkinelmer csv": ("perkinelmer", perkinelmer_csv, ALL),
    "ecostress": ("ecostress", ecostress, {"theta_i_deg": 8.0, "polarization": "s"}),
    "nm": ("spectrum", lambda: spectrum("nm"), ALL),
    "um": ("spectrum", lambda: spectrum("um"), ALL),
    "wavenumber": ("spectrum", lambda: spectrum("cm^-1"), ALL),
}


@pytest.mark.parametrize("name", list(SPECTRA))
def test_a_spectrum_gives_the_dhr_at_the_wavelength_asked_for(write, name):
    wanted, make, decided = SPECTRA[name]
    file = write(make())
    m = pb.import_readings(file, wavelength_um=0.7, **decided)
    assert m.warnings[0] == f"format: {wanted}"
    assert (m.dhr.polarization.tolist(), m.dhr.theta_i_deg.tolist()) == (["s"], [8.0])
    assert m.dhr.value[0] == pytest.approx(reflectance(700), rel=1e-6)
    between = pb.import_readings(file, wavelength_um=0.65, **decided)
    assert between.dhr.value[0] == pytest.approx(np.mean(reflectance([600, 700])), rel=1e-5)
    assert any("50 nm from the next" in text for text in between.warnings)
    with pytest.raises(DataError, match="3 um is outside the spectrum"):
        pb.import_readings(file, wavelength_um=3.0, **decided)
    with pytest.raises(UndecidedError, match="--wavelength-um"):
        pb.import_readings(file, **decided)


def test_ecostress_says_its_angle_and_no_polarisation(write):
    m = pb.import_readings(write(ecostress()), wavelength_um=0.7)
    assert (m.dhr.theta_i_deg.tolist(), m.dhr.polarization.tolist()) == ([10.0], ["u"])


def test_several_files_are_one_measurement(write):
    files = [write(bird(), "a.brdf"), write(perkinelmer(), "b.asc")]
    m = pb.import_readings(*files, wavelength_um=0.65)
    assert (m.sample, len(m.brdf), len(m.dhr)) == ("made up", len(GRID), 1)
    assert {text.split(":")[0] for text in m.warnings} == {"a.brdf", "b.asc"}


# What is left open, and damage


@pytest.mark.parametrize(
    ("content", "option"),
    [
        (fred(), "--wavelength-um"),
        (listed().replace("BRDF s-polarized", "s-polarized"), "--value"),
        (listed().replace("s-polarized", ""), "--polarization"),
        (cary().replace("Baseline 100%T", "other"), "--sample"),
        (cary(), "--theta-i"),
        (spectrum("nm"), "--theta-i"),
    ],
)
def test_what_a_file_leaves_open_is_asked_for(write, tmp_path, content, option, capsys):
    file, out = write(content), tmp_path / "out.csv"
    assert main(["import", str(file), "--out", str(out)]) == 2
    assert option in capsys.readouterr().err
    assert main(["check", str(file)]) == 2
    assert not out.exists()


def test_sheets_are_asked_for(write):
    book, out = openpyxl.load_workbook(io.BytesIO(workbook())), io.BytesIO()
    book.copy_worksheet(book.active).title = "second"
    book.save(out)
    with pytest.raises(UndecidedError, match="--sheet"):
        pb.import_readings(write(out.getvalue()))
    m = pb.import_readings(write(out.getvalue()), sheet="second")
    assert m.sample == "second"
    assert_truth(m)


def test_the_verb_writes_a_tidy_csv_and_prints_decisions(write, tmp_path, capsys):
    out = tmp_path / "tidy.csv"
    assert main(["import", str(write(zemax())), "--polarization", "s", "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(out)
    assert {line.split(":")[0] for line in said.err.splitlines()} >= {
        "format", "forward side", "values", "wavelength", "dropped", "total reflectance", "level",
    }  # fmt: skip
    assert is_tidy(out.read_bytes())
    assert_truth(pb.read_measurement(out))


MAKERS = {
    **{n: (m, d) for n, (_, m, d) in BRDF_FILES.items()},
    **{n: (m, d) for n, (_, m, d) in SPECTRA.items()},
}


@pytest.mark.parametrize("name", list(MAKERS))
def test_a_damaged_file_is_refused_or_read_and_never_crashes(write, name):
    """Cut off anywhere, bytes replaced, numbers out of range: an error of this package or a result."""
    make, decided = MAKERS[name]
    whole = make()
    data = whole if isinstance(whole, bytes) else whole.encode()
    decided = {"wavelength_um": 0.65, **decided}
    rng = np.random.default_rng(1)
    damaged = [data[: int(len(data) * share)] for share in (0.02, 0.3, 0.6, 0.9, 0.99)]
    for insert in (b"\0", b"\xff\xfe", b"1e400", b"-", b"9.9E37", b",", b"nan", b"\n"):
        places = rng.integers(0, len(data), 2).tolist()
        damaged += [data[:at] + insert + data[at:] for at in places]
    refused = 0
    for content in damaged:
        try:
            pb.import_readings(write(content), **decided)
        except DataError as error:
            refused += 1
            assert "any.dat" in str(error)  # noqa: PT017
    assert refused >= 3


@pytest.mark.parametrize(
    "name", ["zemax", "fred", "lighttools", "perkinelmer", "ecostress", "xlsx"]
)
def test_a_file_cut_in_half_is_refused(write, name):
    make, decided = MAKERS[name]
    whole = make()
    data = whole if isinstance(whole, bytes) else whole.encode()
    data = data[: data.rindex(b" ") if name == "fred" else int(len(data) * 0.7)]
    with pytest.raises(DataError, match=r"any\.dat"):
        pb.import_readings(write(data), **{"wavelength_um": 0.65, **decided})


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"\n \n", "empty"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "none of the formats"),
        (b"PK\x03\x04" + b"x" * 100, "cannot be read"),
        (b"\xd0\xcf\x11\xe0" + b"x" * 600, "cannot be read"),
        (b'{"data": {"theta_i": ' + b"[" * 100_000, "JSON"),
        (b"OPTIS - Anisotropic BSDF surface file v8.0\n", "Speos"),
        (bird(theta_r={"unit": "deg", "values": [95] * len(GRID)}).encode(), "beyond 90"),
        (bird(theta_r={"unit": "grad", "values": [5] * len(GRID)}).encode(), "unit of theta_r"),
        (bird(BRDF={"unit": "1/sr", "values": [1, 2]}).encode(), "2 values where"),
        (bird(BRDF={"unit": "1/sr", "values": ["x"] * len(GRID)}).encode(), "list of numbers"),
        (bird(BRDF={"unit": "1/sr", "values": [g[2] * 1e35 for g in GRID]}).encode(), "overload"),
        (bird(polarization_r={"notation": "sp", "values": ["s"] * len(GRID)}).encode(), "analyser"),
        (astm().replace("VARS theta_i", "VARS theta_x,theta_i").encode(), "names 6 columns"),
        (zemax().replace("ScatterType\tBRDF", "ScatterType\tBTDF").encode(), "btdf"),
        (zemax().replace("Content\tMono", "Content\tXYZMono").encode(), "SpectralContent"),
        (cary("%T").encode(), "not a reflectance"),
        (perkinelmer("A").encode(), "not a reflectance"),
        (SEMICOLONS, "tidy CSV"),
    ],
)
def test_what_is_wrong_is_named(write, content, reason):
    with pytest.raises(DataError, match=reason):
        pb.import_readings(write(content), wavelength_um=0.65, polarization="s", theta_i_deg=8.0)


def test_decisions_that_are_none(write):
    file = write(bird())
    for wrong in (
        {"forward": "up"},
        {"polarization": "x"},
        {"theta_i_deg": 95.0},
        {"colour": "red"},
    ):
        with pytest.raises(ConfigError):
            pb.import_readings(file, **wrong)
    with pytest.raises(DataError, match="not a file of format zemax"):
        pb.import_readings(file, format="zemax")


def test_a_tidy_header_with_semicolons_is_refused_with_the_way_out(write):
    with pytest.raises(DataError, match="separated by semicolons"):
        pb.read_measurement(write(SEMICOLONS))


def test_every_format_has_a_test():
    assert {wanted for wanted, _, _ in (*BRDF_FILES.values(), *SPECTRA.values())} == set(FORMATS)


# Real files and known answers


@pytest.fixture
def formats() -> Path:
    if not SHARED.is_dir():
        pytest.skip(f"files of laboratories are not here: {SHARED}")
    return SHARED


@pytest.mark.parametrize(
    ("name", "decided", "pol", "rtol"),
    [
        ("bird_strict.brdf", {}, "spu", 1e-12), ("astm_s.astm", {}, "s", 3e-5),
        ("zemax_u.bsdf", {"wavelength_um": 0.65}, "u", 2e-3),  # azimuths within 0.05 deg are one
        ("fred_deg_value_inplane.txt", {"wavelength_um": 0.65}, "u", 1e-6),
    ],
)  # fmt: skip
def test_known_answers(formats, name, decided, pol, rtol):
    m = pb.import_readings(formats / "known_answers" / name, **decided)
    assert set(m.brdf.polarization.tolist()) == set(pol)
    for q in pol:
        rows = m.brdf.polarization == q
        b = m.brdf
        wanted = truth(b.theta_i_deg[rows], b.theta_r_deg[rows], b.phi_r_deg[rows], q)
        np.testing.assert_allclose(b.value[rows], wanted, rtol=rtol)


def test_an_anodised_coating_is_alike_in_zemax_and_fred(formats):
    zemax_, fred_ = (
        pb.import_readings(formats / name, wavelength_um=0.65)
        for name in ("zemax/AnoBlackEC1onAlum.bsdf", "fred/AnoBlackEC1onAlum.txt")
    )
    of = {s.theta_i_deg: s.rows for s in fred_.scans if s.phi_r_deg == 0.0}
    for scan in (s for s in zemax_.scans if s.phi_r_deg == 0.0):
        x, y = zemax_.brdf.theta_r_deg[scan.rows], np.log10(zemax_.brdf.value[scan.rows])
        theta, value = (a[of[scan.theta_i_deg]] for a in (fred_.brdf.theta_r_deg, fred_.brdf.value))
        inside = (theta >= x.min()) & (theta <= x.max())
        away = np.abs(np.interp(theta[inside], x, y) - np.log10(value[inside]))
        assert np.median(away) <= 0.02


@pytest.mark.parametrize(
    ("name", "decided", "reason"),
    [
        ("tables/ansys_brdf_viewer_2D_data.csv", {}, "--value"),
        ("tables/blacklab_20250210_S7_sample_final.txt", {"polarization": "u"}, "--forward"),
        ("dhr/cary7000_mittma_0020_Cu_G_R.csv", {}, "--theta-i"),
        ("dhr/perkinelmer_KTF-D.Probe.Raw.asc", {}, "%T"),
        ("goniometer/test_excel.xls", {}, "--value"),
        ("goniometer/test_jdv.jdv", {}, "--wavelength-um"),
        ("goniometer/test_lighttools.txt", {}, "--wavelength-um"),
        ("goniometer/test_raywiz.jdv", {}, "RayWiz"),
        ("goniometer/test_speos.rtd", {}, "Speos"),
    ],
)
def test_real_files_say_what_they_leave_open(formats, name, decided, reason):
    with pytest.raises(DataError, match=reason):
        pb.import_readings(formats / name, **decided)


def test_real_files_are_read(formats):
    m = pb.import_readings(
        formats / "tables/blacklab_20250210_S7_sample_final.txt", polarization="u",
        forward="phi180", wavelength_um=0.63,
    )  # fmt: skip
    assert m.wavelength_um == pytest.approx(0.63079)
    first = m.brdf.row.tolist().index(2)
    assert m.brdf.value[first] == pytest.approx(1.018843 / np.pi)  # 0 deg, viewed at 45 deg, BRF
    assert m.brdf.theta_r_deg[first] == 45.0
    m = pb.import_readings(
        formats / "dhr/cary7000_mittma_0020_Cu_G_R.csv", sample="Cu7PS6_R", theta_i_deg=8.0,
        polarization="u", wavelength_um=2.0,
    )  # fmt: skip
    assert m.dhr.value[0] == pytest.approx(0.1887113571)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"type bsdf_data\n" + b"1 0 .5 " * 200_000, "bytes long"),
        (b"type bsdf_data\n" + b"1 0 1\n" * 1_000_001, "more than 1000000 lines"),
        (b"{" + b" " * 2**25, "larger than 32 MiB"),
    ],
    ids=["line", "lines", "bytes"],
)
def test_a_file_that_asks_for_too_much_is_refused(write, content, reason):
    with pytest.raises(DataError, match=reason):
        pb.import_readings(write(content))
