from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.io import tidy_columns, tidy_csv
from pbrdf_bayes.io.formulas import guard, unguard
from pbrdf_bayes.io.tidy_columns import COLUMNS, REQUIRED
from pbrdf_bayes.io.tidy_csv import (
    read_measurement,
    read_samples,
    read_usable_samples,
    write_tidy_csv,
)
from pbrdf_bayes.measurement import MAX_NAME, Measurement, is_label, measurement_from_columns

HEADER = ",".join(REQUIRED)
ROWS = (
    "green,3.39,brdf,s,20,10,0.02",
    "green,3.39,brdf,s,20,-10,0.01",
    "green,3.39,dhr,p,30,,0.3",
)
FIELD = {name: index for index, name in enumerate(REQUIRED)}


def table(*rows: str, header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


GOOD = table(*ROWS)


def with_cell(column: str, cell: str, *, row: int = 0) -> str:
    """Good file with one cell replaced; the optional columns are added where asked for."""
    header, rows = HEADER, [line.split(",") for line in ROWS]
    if column not in FIELD:
        header += f",{column}"
        rows = [[*cells, ""] for cells in rows]
    rows[row][FIELD.get(column, -1)] = cell
    return table(*(",".join(cells) for cells in rows), header=header)


@pytest.fixture
def write(tmp_path):
    def write(content: str | bytes, name: str = "green.csv") -> Path:
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write


def test_reads_the_good_file(write):
    m = read_measurement(write(GOOD))
    assert (m.sample, m.wavelength_um, m.source) == ("green", 3.39, "green.csv")
    assert m.brdf.theta_r_deg.tolist() == [-10, 10]
    assert m.brdf.value.tolist() == [0.01, 0.02]
    assert m.brdf.row.tolist() == [3, 2]
    assert m.dhr.value.tolist() == [0.3]
    assert np.isnan(m.dhr.theta_r_deg).all()
    assert (m.warnings, dict(m.excluded), len(m.sha256)) == ((), {}, 64)


QUOTED = [re.sub("^green", '"green, ""matt"""', row) for row in ROWS]
SHUFFLED = ["value,theta_r_deg,theta_i_deg,polarization,quantity,wavelength_um,sample"] + [
    ",".join(reversed(row.split(","))) for row in ROWS
]


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.rstrip("\n"),
        GOOD + "\n\n,,,,,,\n",
        GOOD.replace(",", " , "),
        "\n".join(SHUFFLED),
        table(*QUOTED),
        with_cell("theta_r_deg", "nan", row=2),
        with_cell("theta_r_deg", "12", row=2),
        with_cell("polarization", " s "),
        with_cell("sample", " green"),
        with_cell("sigma", ""),
        with_cell("flag", "OK"),
        with_cell("flag", " ok "),
        with_cell("phi_r_deg", "nan", row=2),
        with_cell("phi_r_deg", "-360"),
        with_cell("n_repeats", "3.0"),
        with_cell("theta_r_deg", "-90"),
        with_cell("theta_i_deg", "89.95"),
        with_cell("value", "2e-2"),
        with_cell("value", "1.0", row=2),
        with_cell("scan", '"run 1, morning"'),
    ],
)
def test_accepted_without_a_warning(write, content):
    m = read_measurement(write(content))
    assert m.n_obs == 3
    assert m.warnings == ()


REMEDY = (
    "noise floor (brdf_floor in the file of --config, or check --brdf-floor) so that the reading is "
    "treated as censored, or flag the row"
)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        # values
        (with_cell("value", "-0.003"), "line 2, column value: -0.003 is not allowed (allowed: > 0"),
        (with_cell("value", "-0.003"), REMEDY),
        (with_cell("value", "0"), "line 2, column value: 0 is not allowed"),
        (with_cell("value", "1e-400"), "line 2, column value: 1e-400 is not allowed"),
        (with_cell("value", "nan"), "line 2, column value: nan is not allowed (allowed: > 0"),
        (with_cell("value", "nan"), "Give the reading, or flag the row"),
        (with_cell("value", "inf"), "line 2, column value: inf is not allowed"),
        (with_cell("value", "-inf"), "line 2, column value: -inf is not allowed"),
        (with_cell("value", "1e999"), "line 2, column value: 1e999 is not allowed"),
        (with_cell("value", ""), "line 2, column value: empty"),
        (with_cell("value", "abc"), "line 2, column value: 'abc' is not a number"),
        (with_cell("value", "TRUE"), "line 2, column value: 'TRUE' is not a number"),
        (with_cell("value", "1_000"), "line 2, column value: '1_000' is not a number"),
        (with_cell("value", "0x1p3"), "line 2, column value: '0x1p3' is not a number"),
        (with_cell("value", '"0,02"'), "Write a decimal point, not a decimal comma"),
        (with_cell("value", "0,02"), "line 2: 8 cells where the header has 7. Write decimal point"),
        (
            with_cell("value", "30", row=2),
            "line 4, column value: 30 is not allowed (allowed: -0.05",
        ),
        (with_cell("value", "30", row=2), "divide by 100 if it is in per cent"),
        (with_cell("value", "1.051", row=2), "1.051 is not allowed (allowed: -0.05 to 1.05)"),
        (with_cell("value", "-0.06", row=2), "-0.06 is not allowed (allowed: -0.05 to 1.05)"),
        (with_cell("value", "nan", row=2), "line 4, column value: nan is not allowed"),
        # directions
        (with_cell("theta_r_deg", "90.1"), "theta_r_deg: 90.1 is not allowed (allowed: -90 to 90"),
        (with_cell("theta_r_deg", "-91"), "theta_r_deg: -91 is not allowed"),
        (with_cell("theta_r_deg", ""), "line 2, column theta_r_deg: empty (allowed: -90 to 90"),
        (with_cell("theta_r_deg", "nan"), "line 2, column theta_r_deg: nan is not allowed"),
        (with_cell("theta_r_deg", "x", row=2), "theta_r_deg: 'x' is not a number (allowed: an emp"),
        (with_cell("theta_i_deg", "89.96"), "theta_i_deg: 89.96 is not allowed (allowed: 0 to 89."),
        (with_cell("theta_i_deg", "-20"), "-20 is not allowed"),
        (with_cell("theta_i_deg", "-20"), "theta_r_deg carries the sign"),
        (with_cell("phi_r_deg", "361"), "phi_r_deg: 361 is not allowed (allowed: -360 to 360 deg)"),
        (with_cell("phi_r_deg", "nan"), "line 2, column phi_r_deg: nan is not allowed"),
        # words
        (with_cell("polarization", "S"), "'S' is not allowed (allowed: s, p, u; in lower case)."),
        (with_cell("polarization", "S"), "Did you mean 's'?"),
        (with_cell("polarization", "P"), "Did you mean 'p'?"),
        (with_cell("polarization", "unpolarized"), "Did you mean 'u'?"),
        (with_cell("polarization", "TM"), "Did you mean 'p'?"),
        (with_cell("polarization", "x"), "'x' is not allowed (allowed: s, p, u; in lower case). W"),
        (with_cell("polarization", ""), "line 2, column polarization: empty (allowed: s, p, u"),
        (with_cell("quantity", "BRDF"), "column quantity: 'BRDF' is not allowed (allowed: brdf, d"),
        (with_cell("quantity", "BRDF"), "Did you mean 'brdf'?"),
        (with_cell("quantity", "bsdf"), "Did you mean 'brdf'?"),
        (with_cell("sample", ""), "line 2, column sample: empty. Give the name"),
        (with_cell("sample", "a\x07b"), r"'a\x07b' is not allowed (allowed: up to 1000 printable"),
        (with_cell("scan", "r" * 201), "column scan: 'rrr"),
        # other numbers
        (
            with_cell("wavelength_um", "0"),
            "column wavelength_um: 0 is not allowed (allowed: > 0 um",
        ),
        (with_cell("wavelength_um", "red"), "column wavelength_um: 'red' is not a number"),
        (with_cell("sigma", "-1e-3"), "column sigma: -1e-3 is not allowed (allowed: > 0"),
        (with_cell("sigma", "0"), "line 2, column sigma: 0 is not allowed (allowed: > 0"),
        (with_cell("sigma", "1e-12"), "line 2, column sigma: 1e-12 is less than 1e-08 of value"),
        (with_cell("value", "9.9E37"), "line 2, column value: 9.9E37 is an overload word"),
        (with_cell("value", "-9.91E37"), "line 2, column value: -9.91E37 is an overload word"),
        (with_cell("value", "9.9E37", row=2), "line 4, column value: 9.9E37 is an overload word"),
        (with_cell("theta_r_deg", "\u20133"), "no digits: '\\u20133'"),
        (with_cell("sigma", "nan"), "column sigma: nan is not allowed"),
        (with_cell("sigma", "5%"), "column sigma: '5%' is not a number"),
        (with_cell("n_repeats", "0"), "n_repeats: 0 is not allowed (allowed: a whole number >= 1)"),
        (with_cell("n_repeats", "2.5"), "n_repeats: 2.5 is not allowed"),
        # header
        ("", "the file is empty"),
        (b"\xef\xbb\xbf\r\n", "the file is empty"),
        (HEADER, "the file has a header but no rows. Add the readings"),
        (HEADER + "\n\n\n", "the file has a header but no rows"),
        ("\n" + GOOD, "line 1 is empty. It must be the header"),
        ("\n".join(ROWS), "is not a header. The first line must name the columns"),
        ("# made today\n" + GOOD, "is not a header"),
        (GOOD.replace("value", "val"), "line 1, column value: this required column is missing"),
        (GOOD.replace("value", "val"), "Is it the one named 'val'? Rename that to 'value'"),
        (GOOD.replace("theta_r_deg", "Theta_R_Deg"), "Is it the one named 'Theta_R_Deg'?"),
        (GOOD.replace("theta_r_deg", "out"), "column theta_r_deg: this required column is missing"),
        (GOOD.replace("sample,", "probe,", 1), "Add it; required are sample, wavelength_um,"),
        (GOOD.replace("wavelength_um", "value"), "column value: the header names it 2 times"),
        # the file
        (GOOD.replace(",", ";"), "separated by semicolons, not by commas. Convert them"),
        (GOOD.replace(",", ";"), "sed 's/,/./g; s/;/,/g' OLD.csv > NEW.csv"),
        (GOOD.replace(",", ";").replace(".", ","), "separated by semicolons"),
        (GOOD.replace(",", "\t"), "separated by tabs"),
        (GOOD.replace(",", "|"), "separated by bars"),
        (GOOD.replace(",", " "), "separated by spaces"),
        (table(ROWS[0].replace(",", ";")), "line 2: 1 cell where the header has 7. Separate"),
        (table(*ROWS, "green,3.39"), "line 5: 2 cells where the header has 7. Fill in the missing"),
        (table(ROWS[0] + ",1"), "line 2: 8 cells where the header has 7"),
        (table(ROWS[0], '"green,3.39'), "line 3: the quotes around a cell are broken"),
        (table('"gr"een,3.39,brdf,s,20,10,0.02'), "line 2: the quotes around a cell are broken"),
        (GOOD.replace("green", "gr\xfcn").encode("latin-1"), "line 2: byte 0xFC (at byte 75)"),
        (with_cell("note", "\xb5").encode("latin-1"), "byte 0xB5 (at byte 107) is not UTF-8"),
        (GOOD.encode("utf-16"), "this is text in UTF-16, not a CSV file. Save the file as UTF-8"),
        (GOOD.encode("utf-16-be"), "line 1: a zero byte (at byte 0): a binary file"),
        (b"\x1f\x8b\x08\x00", "this is a gzip archive, not a CSV file. Unpack it first: gunzip"),
        (b"PK\x03\x04...", "the workbook cannot be read (BadZipFile)"),
        ("x" * 100_000, "line 1: 100000 bytes long (allowed: up to 65536)"),
        (table(ROWS[0], "," * 100_000), "line 3: 100000 bytes long"),
        # choices
        (table(*ROWS, ROWS[0].replace("green", "red")), "the file has 2 samples. Choose one (sam"),
        (table(*ROWS, ROWS[0].replace("green", "red")), "--sample): 'green', 'red'"),
        (table(*ROWS, ROWS[0].replace("3.39", "4.5")), "'green' has 3.39, 4.5 um. Choose one (wav"),
        (table(*(row + ",bad" for row in ROWS), header=HEADER + ",flag"), "every row is flagged"),
    ],
)
def test_refused(write, content, expected):
    with pytest.raises(DataError, match=re.escape(expected)) as info:
        read_measurement(write(content))
    assert "green.csv: " in str(info.value)
    assert "nothing was read" in str(info.value).lower()


@pytest.mark.parametrize("name", [name for name in REQUIRED if name != "value"])
def test_missing_column(write, name):
    content = re.sub(rf"\b{name}\b", "zzz", GOOD)
    with pytest.raises(DataError, match=f"line 1, column {name}: this required column is missing"):
        read_measurement(write(content))


def test_problems_of_one_kind_are_one_line(write):
    bad = "green,3.39,brdf,q,200,x,-1"
    with pytest.raises(DataError, match=r"green\.csv: 200000 problems") as info:
        read_measurement(write(table(*[bad] * 50_000)))
    lines = str(info.value).splitlines()
    assert len(lines) == 5
    for line in lines[1:]:
        assert line.startswith("  line 2, column ")
        assert line.endswith("The same in lines 3, 4, 5, ... (50000 rows in all).")


def test_a_rare_problem_is_seen_among_many_of_another_kind(write):
    """Each kind with the value of its first row, whatever the other rows have."""
    rows = [f"green,3.39,brdf,s,20,{i % 80},{-1 - i}" for i in range(500)]
    rows[300] = "green,3.39,brdf,s,20,10,abc"
    rows[400] = 'green,3.39,brdf,s,20,10,"0,5"'
    rows[450] = "red,3.39,brdf,s,20,10,-7"
    rows += ["green,3.39,brdf,s,95,10,1", "green,3.39,brdf,s,96,10,1"]
    with pytest.raises(DataError, match="502 problems") as info:
        read_measurement(write(table(*rows)), sample="green")
    lines = str(info.value).splitlines()[1:]
    assert [re.sub(r"(:) .*", "", line).strip() for line in lines] == [
        "line 2, column value", "line 302, column value", "line 402, column value",
        "line 502, column theta_i_deg",
    ]  # fmt: skip
    assert lines[0].startswith("  line 2, column value: -1 is not allowed")
    assert lines[0].endswith("The same in lines 3, 4, 5, ... (498 rows in all).")
    assert "'abc' is not a number" in lines[1]
    assert "decimal comma" in lines[2]
    assert lines[3].endswith("The same in line 503 (2 rows in all).")
    red = read_samples(write(table(*rows))).errors["red"].splitlines()
    assert len(red) == 2
    assert red[1].startswith("  line 452, column value: -7 is not allowed")
    assert "The same" not in red[1]


def test_more_than_twenty_kinds_are_counted(write):
    names = [f"{'x' * (201 + i)}" for i in range(3)]
    rows = [f"{name},3.39,{w},s,20,10,1" for name in names for w in ("brfd", "dhrr")]
    rows += [f"green,3.39,brdf,{word},20,10,1" for word in ("S", "P", "U", "TM", "x", "unpol")]
    rows += ["green,3.39,brdf,s,95,200,-1,-1,0.5,400", "green,x,y,z,x,x,x,x,x,x", "green,,,,,,,,,"]
    rows = [row + "," * (9 - row.count(",")) for row in rows]
    header = HEADER + ",sigma,n_repeats,phi_r_deg"
    with pytest.raises(DataError, match="problems") as info:
        read_measurement(write(table(*rows, header=header)))
    lines = str(info.value).splitlines()
    assert len(lines) == 22
    assert re.fullmatch(r"  \.\.\. and \d+ more\.", lines[-1])


def test_problems_of_every_kind_are_listed_in_the_order_of_the_file(write):
    content = table(ROWS[0], "green,3.39", with_cell("value", "x").splitlines()[1], ROWS[0] + ",1")
    with pytest.raises(DataError, match="3 problems") as info:
        read_measurement(write(content))
    assert re.findall(r"line (\d+)", str(info.value)) == ["3", "4", "5"]


def test_line_numbers_count_blank_lines_and_line_breaks_in_quotes(write):
    broken = '"gr\nee\r\nn",3.39,brdf,s,20,10,0.02'
    content = table(ROWS[0], "", broken, "", ROWS[0].replace("0.02", "x"))
    with pytest.raises(DataError, match=r"line 4, column sample: 'gr\\nee\\r\\nn'") as info:
        read_measurement(write(content))
    assert "line 8, column value: 'x'" in str(info.value)


def test_message_shows_no_control_characters_and_no_endless_cells(write):
    with pytest.raises(DataError, match="column value") as info:
        read_measurement(write(with_cell("value", "\x1b[31m" + "9x" * 1000)))
    assert "\x1b" not in str(info.value)
    assert len(str(info.value)) < 300


def test_missing_file_names_a_similar_one(write):
    file = write(GOOD)
    with pytest.raises(DataError, match=r"there is no such file\. Did you mean 'green\.csv'\?"):
        read_measurement(file.with_name("gren.csv"))


@pytest.mark.parametrize(
    ("name", "reason"), [(".", "this is a folder"), ("a\0b", "cannot be read")]
)
def test_unreadable_file(tmp_path, name, reason):
    with pytest.raises(DataError, match=reason):
        read_measurement(tmp_path / name)


@pytest.mark.parametrize("floor", [-1.0, float("nan"), float("inf")])
def test_brdf_floor_out_of_range(write, floor):
    with pytest.raises(ConfigError, match=r"brdf_floor = .* give a BRDF"):
        read_measurement(write(GOOD), brdf_floor=floor)


@pytest.mark.parametrize("value", ["0", "-0.003", "1e-9"])
def test_a_floor_admits_readings_of_zero_or_less(write, value):
    m = read_measurement(write(with_cell("value", value)), brdf_floor=1e-4)
    assert m.brdf.value.tolist() == [0.01, float(value)]


def test_a_floor_does_not_admit_nan(write):
    with pytest.raises(DataError, match=r"column value: nan is not allowed .allowed: a finite"):
        read_measurement(write(with_cell("value", "nan")), brdf_floor=1e-4)


def test_flagged_rows_are_counted_and_not_checked(write):
    rows = [
        ROWS[0] + ",ok",
        ROWS[1] + ",",
        "green,x,y,z,,q,hello,obscured",
        ",,,,,,,obscured",
        "green,3.39,brdf,s,200,10,-5,Lamp",
        "green,4.5,brdf,s,200,10,-5,lamp",
    ]
    m = read_measurement(write(table(*rows, header=HEADER + ",flag")))
    assert m.n_obs == 2
    assert dict(m.excluded) == {"obscured": 2, "Lamp": 1}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (
            with_cell("value", "1.02", row=2),
            "1 DHR reading outside 0 to 1 accepted as noise (line 4",
        ),
        (with_cell("value", "-0.02", row=2), "1 DHR reading outside 0 to 1"),
        (table(*ROWS, ROWS[0]), "1 row identical to an earlier one (first: line 5 equals line 2)"),
        (table(*ROWS, ROWS[2]), "(first: line 5 equals line 4)"),
        (
            with_cell("sigmaa", "1"),
            "column 'sigmaa' is not part of the format and was not read. Did",
        ),
        (with_cell("sigmaa", "1"), "Did you mean 'sigma'?"),
        (with_cell("operator", "me"), "column 'operator' is not part of the format"),
        (
            table("g,3.39,brdf,s,0.3,0.3,0.02", "g,3.39,brdf,s,0.3,-1.5,0.02"),
            "all angles lie within 1.5 in absolute value: are they in radians?",
        ),
        (GOOD.replace("3.39", "3390"), "wavelength_um is 3390: is it in nanometres?"),
    ],
)
def test_warned(write, content, expected):
    (warning,) = read_measurement(write(content)).warnings
    assert expected in warning


def test_empty_cells_at_the_end_of_rows_are_left_out(write):
    m = read_measurement(write(table(ROWS[0] + ",", ROWS[1] + ",, ,", ROWS[2])))
    assert (m.n_obs, m.brdf.row.tolist()) == (3, [3, 2])
    (warning,) = m.warnings
    assert "end of 2 lines (first: line 2)" in warning


def test_a_minus_sign_is_read_as_a_hyphen(write):
    m = read_measurement(write(GOOD.replace(",-10,", ",\u221210,")))
    assert m.brdf.theta_r_deg.tolist() == [-10, 10]
    (warning,) = m.warnings
    assert "U+2212" in warning
    assert "1 lines (first: line 3)" in warning
    assert read_measurement(write(GOOD.replace("green", "a\u2212b"))).warnings == ()


@pytest.mark.parametrize(
    ("other", "merged"), [("3.3900001", True), ("3.3903", True), ("3.3904", False)]
)
def test_wavelengths_that_differ_by_rounding_are_one(write, other, merged):
    """Within 1e-4, the one of most rows; flagged rows are counted with them."""
    rows = [row + "," for row in ROWS] + [ROWS[2].replace("3.39", other).replace("p", "s") + ","]
    rows.append(ROWS[2].replace("3.39", other) + ",lamp")
    file = write(table(*rows, header=HEADER + ",flag"))
    found = read_samples(file).measurements
    assert list(found) == (
        [("green", 3.39)] if merged else [("green", 3.39), ("green", float(other))]
    )
    if merged:
        m = read_measurement(file, wavelength_um=float(other))
        assert (len(m.dhr), m.wavelength_um, dict(m.excluded)) == (2, 3.39, {"lamp": 1})
        assert f"wavelength_um {other} is read as 3.39" in m.warnings[0]


def test_a_fine_spectrum_is_not_one_wavelength(write):
    rows = [f"a,{3.39 + i * 1e-4},dhr,s,20,,0.5" for i in range(9)]
    assert len(read_samples(write(table(*rows))).measurements) == 9


@pytest.mark.parametrize(
    ("sigma", "n_asked"), [(("2", "2", "2"), 3), (("0.05", "2", "0.001"), 2), (("0.05", "", ""), 1),
                           (("0.01", "0.001", "2"), 0), (("0.05", "0.001", "0.001"), 0)],
)  # fmt: skip
def test_a_sigma_above_most_values_is_questioned(write, sigma, n_asked):
    rows = [f"{row},{s}" for row, s in zip(ROWS, sigma, strict=True)]
    said = read_measurement(write(table(*rows, header=HEADER + ",sigma"))).warnings
    assert [f"in {n_asked} of" in text and "per cent" in text for text in said] == [True] * bool(
        n_asked
    )


@pytest.mark.parametrize(
    "rows",
    [
        ["g,3.39,brdf,s,0,0,0.02", "g,3.39,brdf,s,0,1.5,0.02"],
        ["g,3.39,brdf,s,1,1,0.02", "g,3.39,brdf,s,1,-2,0.02"],
        [ROWS[0], ROWS[0].replace("0.02", "0.021")],
    ],
)
def test_not_warned(write, rows):
    assert read_measurement(write(table(*rows))).warnings == ()


TWO = table(
    *ROWS,
    "red,3.39,brdf,s,20,10,0.02",
    "red,4.5,brdf,s,20,10,0.03",
    "Blue,4.5,dhr,s,20,,0.5",
)


def test_sample_and_wavelength_are_chosen(write):
    file = write(TWO)
    assert read_measurement(file, sample="green").n_obs == 3
    assert read_measurement(file, sample="red", wavelength_um=4.5).brdf.value.tolist() == [0.03]
    assert read_measurement(file, sample="Blue").dhr.value.tolist() == [0.5]


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (
            {"sample": "blue"},
            "'blue' has no rows to use. Did you mean 'Blue'? The file has: 'Blue'",
        ),
        ({"sample": "red"}, "sample 'red' has 3.39, 4.5 um. Choose one"),
        (
            {"sample": "red", "wavelength_um": 5.0},
            "5 um was not measured: sample 'red' has 3.39, 4",
        ),
    ],
)
def test_choice_that_is_not_there(write, choice, expected):
    with pytest.raises(DataError, match=re.escape(expected)):
        read_measurement(write(TWO), **choice)


def test_a_data_frame_is_read_as_its_csv(write):
    file = write(TWO)
    frame = pd.read_csv(file)
    for choice in ({"sample": "green"}, {"sample": "red", "wavelength_um": 4.5}):
        m, of_frame = read_measurement(file, **choice), read_measurement(frame, **choice)
        for name in ("value", "theta_r_deg", "polarization", "row"):
            np.testing.assert_array_equal(getattr(m.brdf, name), getattr(of_frame.brdf, name))
        assert of_frame.dhr.value.tolist() == m.dhr.value.tolist()
    with pytest.raises(DataError, match="line 2, column value"):
        read_measurement(frame.assign(value=-1.0), sample="green")


def test_read_samples_gives_all_of_them(write):
    file = read_samples(write(TWO))
    assert list(file.measurements) == [("Blue", 4.5), ("green", 3.39), ("red", 3.39), ("red", 4.5)]
    assert (file.n_rows, file.n_problems, dict(file.errors), file.message) == (6, 0, {}, "")


def test_one_bad_sample_leaves_the_others(write):
    content = table(*ROWS, "red,3.39,brdf,s,20,10,-1", "red,3.39,brdf,s,95,10,1")
    file = read_samples(write(content))
    assert list(file.measurements) == [("green", 3.39)]
    assert "sample 'red' was not read: 2 rows with problems from line 5 on" in file.errors["red"]
    assert "line 6, column theta_i_deg: 95" in file.errors["red"]
    assert file.message.startswith(str(write(content)))
    assert (file.n_problems, [p.line for p in file.problems]) == (2, [5, 6])
    with pytest.raises(DataError, match="2 problems"):
        read_measurement(write(content), sample="green")


def test_a_sample_with_all_rows_flagged_is_an_error_of_its_own(write):
    rows = [row + ",ok" for row in ROWS] + ["red,3.39,brdf,s,20,10,1,bad"]
    file = read_samples(write(table(*rows, header=HEADER + ",flag")))
    assert list(file.errors) == ["red"]
    assert "every row is flagged" in file.errors["red"]
    assert (file.message, list(file.measurements)) == ("", [("green", 3.39)])


@pytest.mark.parametrize("row", ["green,3.39", ",3.39,brdf,s,20,10,1"])
def test_rows_of_no_sample_refuse_the_whole_file(write, row):
    with pytest.raises(DataError, match="line 5"):
        read_samples(write(table(*ROWS, row)))


THREE = [
    f"{name},3.39,brdf,s,20,{t},{v}"
    for name, v in zip("abc", (1, 2, 3), strict=True)
    for t in (5, 6)
]
BROKEN_B = [
    b"b,3.39,brdf", b"b,3,39,brdf,s,20,5,0,1", b"b;3,39;brdf;s;20;5;0,1", b"b;3.39;brdf;s;20;5;0.1",
    b"b,3.39,brdf,s\xb0,20,5,1", b"b,3.39,brdf,s,20,5,1\0", b"b,3.39,brdf,s,20,5," + b"1" * 70_000,
    b'"b",3.39,"brdf"',
]  # fmt: skip
NAMELESS = [
    b",3.39,brdf,s,20,5,1", b" ,3.39", b"gr\xfcn,3.39,brdf,s,20,5,1", b"b\0,3.39,brdf,s,20,5,1",
    b"\xff" * 70_000, b"b\x07,3.39",
]  # fmt: skip


def with_line(row: bytes, *, header: str = HEADER, end: bytes = b"\n") -> bytes:
    """Three samples of two rows, and that one after the first row of the second."""
    lines = [header.encode(), *(line.encode() for line in THREE)]
    return end.join([*lines[:4], row, *lines[4:], b""])


def readings(m: Measurement) -> tuple[object, ...]:
    return m.sample, m.brdf.value.tolist(), m.brdf.row.tolist()


@pytest.mark.parametrize("row", BROKEN_B)
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_row_that_cannot_be_read_costs_its_sample(write, row, end):
    """`check` and `fit` refuse the file as before; what is left is on the lines where it was."""
    file = write(with_line(row, end=end))
    with pytest.raises(DataError, match=r"line 5|nothing was read"):
        read_samples(file)
    with pytest.raises(DataError):
        read_measurement(file, sample="a")
    found = read_usable_samples(file)
    assert [readings(m) for m in found.measurements.values()] == [
        ("a", [1.0, 1.0], [2, 3]), ("c", [3.0, 3.0], [7, 8]),
    ]  # fmt: skip
    assert list(found.errors) == ["b"]
    assert "line 5" in found.errors["b"]
    assert found.first_lines["b"] == 4
    assert found.n_problems == 1
    assert all(m.warnings == () for m in found.measurements.values())


@pytest.mark.parametrize("row", NAMELESS)
def test_a_row_of_no_sample_is_told_to_all(write, row):
    found = read_usable_samples(write(with_line(row)))
    assert [readings(m)[:2] for m in found.measurements.values()] == [
        ("a", [1.0, 1.0]), ("b", [2.0, 2.0]), ("c", [3.0, 3.0]),
    ]  # fmt: skip
    assert list(found.errors) == [""]
    assert found.first_lines[""] == 5
    for m in found.measurements.values():
        assert len(m.warnings) == 1
        assert m.warnings[0].startswith("not read, and may be of this sample: line 5")


def test_a_shifted_cell_is_no_name(write):
    """Where the name is not the first cell, only that of a sample of the file counts."""
    header = "wavelength_um,sample,quantity,polarization,theta_i_deg,theta_r_deg,value"
    rows = [f"3.39,{name},brdf,s,20,5,1" for name in "ab"]
    assert list(
        read_usable_samples(write(table(*rows, "3,39,a,brdf,s,20,6,1", header=header))).errors
    ) == [""]
    assert list(
        read_usable_samples(write(table(*rows, "3.39,a,brdf,s", header=header))).errors
    ) == ["a"]


@pytest.mark.parametrize(
    "row",
    [
        b'"b,3.39,brdf,s,20,5,1',
        b'"b\nb",3.39',
        b'"b\n\xfc",3.39,brdf,s,20,5,1',
        b'b"\nb,3',
        b'b\0"\n',
    ],
)
def test_nothing_is_usable_where_the_quotes_do_not_tell_rows_apart(write, row):
    with pytest.raises(DataError, match="nothing was read"):
        read_usable_samples(write(with_line(row)))


@pytest.mark.parametrize("damage", [b"\0", b"\xff", b"," * 2000, b'"'])
def test_a_damaged_header_leaves_nothing_usable(write, damage):
    with pytest.raises(DataError, match="nothing was read"):
        read_usable_samples(write(damage + with_line(b"")))


@pytest.mark.parametrize(("n", "is_usable"), [(201, True), (MAX_NAME, True), (MAX_NAME + 1, False)])
def test_a_sample_may_have_a_long_name(write, n, is_usable):
    found = read_usable_samples(write(table(*ROWS, f"{'x' * n},3.39,brdf,s,20,5,1")))
    assert (("x" * n, 3.39) in found.measurements) == is_usable
    assert ("up to 1000 printable characters" in found.errors.get("x" * n, "")) != is_usable


def test_repeated_geometries_are_kept(write):
    m = read_measurement(write(table(*ROWS, ROWS[0].replace("0.02", "0.022"))))
    assert m.brdf.value.tolist() == [0.01, 0.02, 0.022]


def test_dhr_alone_needs_no_theta_r_column(write):
    header = HEADER.replace(",theta_r_deg", "")
    assert read_measurement(write(table("g,3.39,dhr,s,20,0.5", header=header))).n_obs == 1


def test_optional_columns(write):
    header = HEADER + ",sigma,n_repeats,phi_r_deg,scan"
    m = read_measurement(
        write(table(ROWS[0] + ",0.004,4,90,a", ROWS[0] + ",0.004,,,", header=header))
    )
    assert [scan.label for scan in m.scans] == ["s 20 deg", "s 20 deg phi 90 deg a"]
    assert m.brdf.u_value.tolist() == [0.004, 0.002]
    assert m.brdf.repeated.tolist() == [False, True]


def test_azimuth_180_is_the_other_half_of_the_plane(write):
    """A file with positive angles only, and the same readings with signed ones."""
    header = HEADER + ",phi_r_deg"
    half = [f"g,3.39,brdf,s,20,{t},0.0{t},{phi}" for phi in (0, 180, -180, 360) for t in (10, 20)]
    m = read_measurement(write(table(*half, header=header)))
    assert [scan.label for scan in m.scans] == ["s 20 deg"]
    assert m.brdf.theta_r_deg.tolist() == [-20, -20, -10, -10, 10, 10, 20, 20]
    assert m.brdf.row.tolist() == [5, 7, 4, 6, 2, 8, 3, 9]
    assert not m.brdf.phi_r_deg.any()


# Writing


def test_written_columns_are_in_the_order_of_the_format(tmp_path):
    file = tmp_path / "out.csv"
    columns = dict.fromkeys(reversed(COLUMNS), 1.0)
    words = {"sample": "a", "quantity": "brdf", "polarization": "s", "scan": "1", "flag": "ok"}
    write_tidy_csv({**columns, **words}, file)
    assert file.read_text().splitlines() == [
        ",".join(COLUMNS),
        "a,1.0,brdf,s,1.0,1.0,1.0,1.0,1.0,1.0,1,ok",
    ]
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.csv"]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"valu": 1.0}, "column 'valu' is not part of the format. Did you mean 'value'?"),
        (
            {"value": [1.0, 2.0], "theta_i_deg": [1.0, 2.0, 3.0]},
            "differ in length: sample 1, wavelen",
        ),
    ],
)
def test_columns_that_cannot_be_written(tmp_path, change, expected):
    columns = {"sample": "a", "wavelength_um": 1.0, "quantity": "brdf", "polarization": "s"}
    columns |= {"theta_i_deg": 1.0, "theta_r_deg": 1.0, "value": 1.0, **change}
    with pytest.raises(DataError, match=re.escape(expected)):
        write_tidy_csv(columns, tmp_path / "out.csv")
    assert list(tmp_path.iterdir()) == []


def test_required_columns_are_asked_for(tmp_path):
    with pytest.raises(DataError, match="missing: sample, wavelength_um"):
        write_tidy_csv({"value": 1.0}, tmp_path / "out.csv")


def test_folder_that_is_not_there(tmp_path, write):
    with pytest.raises(DataError, match=r"out\.csv: the file cannot be written"):
        write_tidy_csv(read_measurement(write(GOOD)), tmp_path / "none" / "out.csv")


def test_a_failed_write_leaves_the_old_file(tmp_path, write, monkeypatch):
    m, file = read_measurement(write(GOOD)), write("old", "out.csv")

    def fail(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(DataError, match="No space left"):
        write_tidy_csv(m, file)
    assert file.read_text() == "old"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["green.csv", "out.csv"]


BLANKS = " \u00a0\u2003\u3000\u200b\ufeff\t\r\n"
SIGNS = "=+-@\uff1d\uff0b\uff0d\uff20\u2212\ufe62"


@given(st.text() | st.text(st.sampled_from("'1a" + BLANKS + SIGNS)))
def test_guard_is_undone_and_hides_formulas(text):
    assert unguard(guard(text)) == text
    assert guard(text).lstrip(BLANKS)[:1] not in set(SIGNS)


@given(st.text(st.sampled_from("'1a \u00fc,\"" + "=+-@\uff1d\u2212")).map(str.rstrip).filter(bool))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_name_is_read_as_it_was_written(tmp_path, name):
    """Leading spaces and apostrophes included, whatever the writer puts before them."""
    file = tmp_path / "named.csv"
    given = dict(zip(REQUIRED, ROWS[0].split(","), strict=True)) | {"value": 0.1}
    write_tidy_csv(given | {"sample": name, "scan": name}, file)
    m = read_measurement(file)
    assert m.sample == name
    assert m.scans[0].label == f"s 20 deg {name}"
    write_tidy_csv(m, file)
    assert read_measurement(file).sample == name


@pytest.mark.parametrize(
    ("rows", "n"),
    [
        (("paint,{}", "paint ,{}"), 1),
        (("paint,{}", '"paint ",{}'), 1),
        (('"paint",{}', '" paint",{}', "paint\u00a0,{}"), 1),
        (("paint ,{}", "paint ,{}"), 0),
        (("paint,{} ", "paint,{}"), 0),
        (("paint ,{}", "coat,{}"), 0),
    ],
)
def test_names_that_differ_by_blanks_are_told(write, rows, n):
    """Read as one sample, which may be two."""
    lines = [row.format(f"3.39,brdf,s,20,{i},0.02") for i, row in enumerate(rows)]
    content = read_samples(write(table(*lines)))
    m = content.measurements["paint", 3.39]
    told = [text for text in m.warnings if "differ by blanks at the ends" in text]
    assert len(told) == n
    assert len(m.brdf) == sum("paint" in row for row in rows)
    if n:
        assert "'paint', " in told[0] or ", 'paint'" in told[0]


numbers = st.floats(min_value=5e-324, max_value=9e29, allow_subnormal=True)
names = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=20)


@settings(max_examples=60, deadline=None)
@given(
    sample=names,
    label=names,
    rows=st.lists(
        st.tuples(
            st.sampled_from("spu"),
            st.floats(0, 89.95),
            st.floats(-90, 90),
            numbers,
            st.one_of(st.just(np.nan), st.floats(1e23, 1e300)),
            st.floats(-360, 360),
        ),
        min_size=1,
        max_size=20,
    ),
    dhr=st.lists(st.floats(-0.05, 1.05), max_size=3),
)
def test_round_trip_is_exact(tmp_path_factory, sample, label, rows, dhr):
    """Every number and every name comes back bit by bit."""
    file = tmp_path_factory.mktemp("trip") / "a.csv"
    cells = [("brdf", *row, label) for row in rows]
    cells += [("dhr", "s", 10.0, np.nan, value, np.nan, 0.0, "") for value in dhr]
    keys = ("quantity", "polarization", "theta_i_deg", "theta_r_deg", "value", "sigma")
    columns = dict(zip((*keys, "phi_r_deg", "scan"), zip(*cells, strict=True), strict=True))
    before = measurement_from_columns(sample=sample, wavelength_um=1 / 3, **columns)
    write_tidy_csv(before, file)
    after = read_measurement(file)
    assert (after.sample, after.wavelength_um) == (sample, 1 / 3)
    assert [scan.label for scan in after.scans] == [scan.label for scan in before.scans]
    for part in ("brdf", "dhr"):
        for name in ("polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg", "value", "u_value"):
            old, new = getattr(getattr(before, part), name), getattr(getattr(after, part), name)
            np.testing.assert_array_equal(old, new, strict=True)


# Anything at all

cell = st.one_of(
    st.sampled_from(
        [
            "",
            "brdf",
            "dhr",
            "s",
            "p",
            "u",
            "ok",
            "0.5",
            "-1",
            "20",
            "nan",
            "inf",
            "true",
            "1_0",
            " 3",
        ]
    ),
    st.floats(0, 80).map(repr),
    st.text(max_size=5),
)
tables = st.lists(st.lists(cell, min_size=6, max_size=8), max_size=8).map(
    lambda rows: "\n".join([HEADER, *(",".join(row) for row in rows)])
)


def _read_or_refuse(file: Path) -> None:
    try:
        assert isinstance(read_measurement(file), Measurement)
    except DataError as error:
        assert file.name in str(error)  # noqa: PT017
    try:
        file_content = read_samples(file)
    except DataError:
        return
    assert bool(file_content.message) == bool(file_content.n_problems)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    content=st.one_of(
        st.binary(max_size=200), st.text(max_size=200).map(str.encode), tables.map(str.encode)
    )
)
def test_anything_is_a_measurement_or_a_data_error(tmp_path, content):
    file = tmp_path / "any.csv"
    file.write_bytes(content)
    _read_or_refuse(file)


@pytest.mark.parametrize("header", [HEADER, HEADER + ",sigma,n_repeats,phi_r_deg,scan,flag"])
@pytest.mark.parametrize(
    "cells",
    [
        {"value": "abc"}, {"value": ""}, {"theta_r_deg": ""}, {"theta_i_deg": "95"}, {"sigma": "x"},
        {"sigma": "nan"}, {"phi_r_deg": "nan"}, {"n_repeats": "2.5"}, {"sample": ""}, {"quantity": "BRDF"},
        {"value": "inf"}, {"theta_r_deg": "1_0"}, {"polarization": "\u00fc"}, {"flag": "bad", "value": "x"},
        dict.fromkeys(COLUMNS, ""), {},
    ],
    ids=str,
)  # fmt: skip
def test_a_problem_reads_the_same_in_a_plain_and_in_a_quoted_file(write, cells, header):
    names = header.split(",")
    good = dict(zip(REQUIRED, ROWS[0].split(","), strict=True)) | {"note": "n"}
    rows = [good, good | cells, good | {"sample": "green"}]
    plain = "\n".join(",".join(row.get(n, "") for n in [*names, "note"]) for row in rows)
    answers = []
    for note in ("n", '"n,n"'):
        try:
            m = read_measurement(
                write(table(plain.replace(",n\n", f",{note}\n"), header=header + ",note"))
            )
            answers.append((m.brdf.value.tolist(), m.brdf.row.tolist(), m.excluded, m.warnings))
        except DataError as error:
            answers.append(str(error))
    assert answers[0] == answers[1]


# Size

MEASURE = """
import resource, sys, time
from pbrdf_bayes.io.tidy_csv import read_measurement
start = time.perf_counter()
try:
    n = read_measurement(sys.argv[1]).n_obs
except ValueError:
    n = -1
seconds = time.perf_counter() - start
if sys.platform == "linux":  # ru_maxrss would be that of the process that started this one
    status = open("/proc/self/status").read()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1e3
else:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
print(n, seconds, time.process_time(), peak)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs the resource module")
@pytest.mark.parametrize(
    ("quotes", "wrong"), [("", ""), ('"', ""), ("", "-"), ("", "x")],
    ids=["plain", "quoted", "values below zero", "no numbers"],
)  # fmt: skip
def test_a_million_rows(tmp_path, capsys, quotes, wrong):
    n_rows = 1_000_000
    rng = np.random.default_rng(1)
    value = (10 ** rng.normal(-2, 0.5, n_rows)).tolist()
    theta = rng.uniform(-80, 80, n_rows).round(2).tolist()
    file = tmp_path / "large.csv"
    with file.open("w") as out:
        out.write(HEADER + ",sigma,scan,flag\n")
        out.writelines(
            f"{quotes}green{quotes},3.39,brdf,{'sp'[i % 2]},{i % 5 * 20},{t},{wrong if i % 3 == 0 else ''}{x!r},{x / 50:.3g},"
            f"run {i % 3},ok\n"
            for i, (t, x) in enumerate(zip(theta, value, strict=True))
        )
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(file)], capture_output=True, text=True, check=True
    )
    n, seconds, cpu, megabytes = map(float, done.stdout.split())
    with capsys.disabled():
        sys.stdout.write(f"\nread in {seconds:.1f} s ({cpu:.1f} s CPU), {megabytes:.0f} MB ")
    assert n == (-1 if wrong else n_rows)
    assert megabytes < 1000


# Bombs: files within the stated size that ask for more than there is


def many(n: int, cells: str, header: str = HEADER) -> str:
    return table(*(cells.format(i) for i in range(n)), header=header)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (many(10_002, "a{},3,brdf,s,2,0,1"), "column sample has more than 10000 different words"),
        (many(10_002, '"a{}\n",3,brdf,s,2,0,1'), "column sample has more than 10000 different words"),
        (many(10_001, "a,{}.5,brdf,s,2,0,1"), "has 10001 samples, each wavelength counted"),
        (many(100_002, "a,3,brdf,s,2,0,1,{}", HEADER + ",scan"), "column scan has more than 100000"),
        (many(100_002, "a,3,{},s,2,0,1"), "column quantity has more than 100000"),
        (many(10_002, "a,3,brdf,s,2,0,1,{}", HEADER + ",flag"), "column flag has more than 10000"),
        (many(2, "a,3,brdf,s,2,0,1" + "," * 994, HEADER + "," * 994), "line 1 has 1001 columns"),
        (table('"' + "a\n" * 101 + '",3,brdf,s,2,0,1'), "a row of more than 100 lines"),
        (table('"' + '\n","' * 101 + '"'), "a row of more than 100 lines"),
    ],
    ids=["samples", "quoted samples", "wavelengths", "scans", "words", "flags", "columns", "cell", "row"],
)  # fmt: skip
def test_a_file_that_asks_for_too_much_is_refused(write, content, reason):
    file = write(content)
    for read in (read_samples, read_measurement):
        with pytest.raises(DataError, match=reason):
            read(file)


def test_a_sample_of_too_many_scans_is_refused_and_the_others_are_not(write, monkeypatch):
    rows = [*(f"a,3,brdf,s,{i % 80},5,1,{i // 80}" for i in range(10_001)), "b,3,brdf,s,2,0,1,0"]
    content = table(*rows, header=HEADER + ",phi_r_deg")
    found = read_samples(write(content))
    assert list(found.measurements) == [("b", 3.0)]
    reason = r"green\.csv: sample 'a': 10001 scans in one sample \(allowed: up to 10000\)"
    assert re.search(reason, found.errors["a"])
    assert re.search(reason, found.message)
    with pytest.raises(DataError, match=reason):
        read_measurement(write(content), sample="a")
    rows = [f"a{i},3,brdf,s,{j},0,1" for i in range(4) for j in range(3)]
    monkeypatch.setattr(tidy_csv, "_MOST_SCANS", 12)
    assert len(read_samples(write(table(*rows))).measurements) == 4
    monkeypatch.setattr(tidy_csv, "_MOST_SCANS", 11)
    with pytest.raises(DataError, match="more than 11 scans in all"):
        read_samples(write(table(*rows)))


@pytest.mark.parametrize("cells", ["a{},3,brdf,s,2,0,1", '"a{}\n",3,brdf,s,2,0,1'])
def test_as_many_samples_as_are_allowed(write, cells):
    found = read_samples(write(many(tidy_columns.MOST_SAMPLES, cells)))
    assert len(found.measurements) == tidy_columns.MOST_SAMPLES
    assert found.errors == {}


def test_flags_that_count_in_too_many_samples_are_refused(write):
    """Each of a thousand samples would hold a thousand of them, and so on."""
    rows = [f"a{i},3,brdf,s,2,0,1," for i in range(1001)]
    flagged = [f",,brdf,s,2,0,1,lamp {i}" for i in range(1000)]
    file = write(table(*rows, *flagged, header=HEADER + ",flag"))
    with pytest.raises(DataError, match="too many different flags"):
        read_samples(file)
    named = [f"a{i}{row}" for i, row in enumerate(flagged)]
    found = read_samples(write(table(*rows, *named, header=HEADER + ",flag")))
    assert dict(found.measurements["a7", 3.0].excluded) == {"lamp 7": 1}


def test_what_is_counted_for_which_sample_and_wavelength(write):
    """Written out: a flagged row counts where it says, and everywhere in what it leaves open."""
    rows = [f"{name},{w},brdf,s,2,0,1," for name in "ab" for w in (3, 4)]
    places = ("a,3", "a,3", "a,", "b,4", ",3", ",", "a,-1", "b,nan", "c,3")
    flagged = [f"{place},brdf,s,2,0,1,flag {i % 4}" for i, place in enumerate(places)]
    found = read_samples(write(table(*rows, *flagged, header=HEADER + ",flag"))).measurements
    for (name, wavelength), m in found.items():
        mine = [
            f"flag {i % 4}"
            for i, place in enumerate(places)
            if place.split(",")[0] in (name, "")
            and place.split(",")[1] in (f"{wavelength:g}", "", "-1", "nan")
        ]
        assert dict(m.excluded) == {flag: mine.count(flag) for flag in sorted(set(mine))}


@pytest.mark.parametrize("quote", ["", '"'])
def test_work_for_a_sample_does_not_grow_with_the_others(write, monkeypatch, quote):
    """Each word is looked up once, and problems sample by sample."""
    asked = 0

    def counted(word: str) -> bool:
        nonlocal asked
        asked += 1
        return is_label(word)

    for name in ("is_label", "is_name"):
        monkeypatch.setattr(f"pbrdf_bayes.io.tidy_rows.{name}", counted)
    n = 5000
    rows = [f'{quote}a {i}{quote},3,brdf,s,2,0,{"x" if i % 2 else 1},"scan,{i}"' for i in range(n)]
    found = read_samples(write(table(*rows, header=HEADER + ",scan")))
    assert (len(found.measurements), len(found.errors)) == (n // 2, n // 2)
    assert all(text.count("\n") == 1 for text in found.errors.values())
    assert n < asked <= 2 * n + 10


def test_a_long_label_takes_no_room_in_the_other_rows(write):
    labels = ["x" * 200] * 2 + [""] * 998
    rows = [f"a,3,brdf,s,2,{i % 500 / 100},1,{label}" for i, label in enumerate(labels)]
    m = read_measurement(write(table(*rows, header=HEADER + ",scan")))
    assert sorted((scan.label, len(scan)) for scan in m.scans) == [
        ("s 2 deg", 998), (f"s 2 deg {labels[0]}", 2)
    ]  # fmt: skip


def test_a_no_break_space_in_a_name_is_told(write):
    with pytest.raises(DataError, match=r"'green\\xa007' is not allowed .* type a plain one"):
        read_measurement(write(GOOD.replace("green", "green\u00a007")))


# Measured files


@pytest.mark.parametrize(
    ("name", "n_samples", "n_used", "n_obscured"),
    [
        ("ua_aeroglaze_z307_650nm_mean3.csv", 1, 600, 44),
        ("ua_aeroglaze_z307_650nm_runs.csv", 3, 1800, 132),
        ("ua_singularity_black_650nm_mean3.csv", 1, 600, 44),
        ("ua_anoblack_tis_as_dhr_650nm.csv", 4, 16, 0),
    ],
)
def test_measured_files(shared, name, n_samples, n_used, n_obscured):
    file = read_samples(shared / name)
    assert file.message == ""
    assert len(file.measurements) == n_samples
    assert sum(m.n_obs for m in file.measurements.values()) == n_used
    assert sum(m.excluded.get("obscured", 0) for m in file.measurements.values()) == n_obscured
    assert all(m.warnings == () for m in file.measurements.values())


def test_public_names():
    assert set(tidy_csv.__all__) == {
        "TidyFile",
        "import_readings",
        "import_to_csv",
        "read_measurement",
        "read_samples",
        "read_usable_samples",
        "write_tidy_csv",
    }
