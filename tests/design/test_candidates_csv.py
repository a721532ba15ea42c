"""Candidates of a CSV: what is read, and that every mistake is named where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pbrdf_bayes.design.candidates import Candidate, Costs
from pbrdf_bayes.errors import ConfigError, DataError
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
from pbrdf_bayes.workflow.candidates_csv import Wanted, list_wanted, parse_kinds, read_candidates

HEADER = "quantity,polarization,theta_i_deg,theta_r_lo_deg,theta_r_hi_deg,theta_r_step_deg,port_deg,minutes\n"
SCAN = (-10.0, 0.0, 10.0)
COSTS = Costs(scan_minutes=4.0, dwell_seconds=20.0, dhr_minutes=2.0)


def read(folder: Path, text: str) -> tuple[Candidate, ...]:
    path = folder / "candidates.csv"
    path.write_text(text, encoding="utf-8")
    return read_candidates(path, SCAN, costs=COSTS, port_deg=5.0)


def test_what_is_not_given_has_its_default(tmp_path: Path) -> None:
    found = read(
        tmp_path, HEADER + "brdf,p,55,-40,40,20,,7\nbrdf,s,10,,,,,\ndhr,u,75,,,,,\nddr,s,20,,,,8,\n"
    )
    assert found == (
        Candidate("brdf", "p", 55.0, minutes=7.0, theta_r_deg=(-40.0, -20.0, 0.0, 20.0, 40.0)),
        Candidate("brdf", "s", 10.0, minutes=5.0, theta_r_deg=SCAN),
        Candidate("dhr", "u", 75.0, minutes=2.0),
        Candidate("ddr", "s", 20.0, minutes=3.0, port_deg=8.0),
    )
    assert read(tmp_path, "quantity,polarization,theta_i_deg\nddr,s,20\n")[0].port_deg == 5.0


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("scan,p,55,,,,,", ["line 2, column quantity", "'scan'", "Did you mean 'brdf'?", "brdf, dhr, ddr"]),
        ("dhrr,p,55,,,,,", ["'dhrr'", "Did you mean 'dhr'?"]),
        ("dhr,x,55,,,,,", ["line 2, column polarization", "'x'", "s, p, u"]),
        ("dhr,p,abc,,,,,", ["line 2, column theta_i_deg", "'abc' is not a number"]),
        ("dhr,p,95,,,,,", ["line 2", "theta_i_deg = 95.0", "[0, 89.95]"]),
        ("dhr,p,nan,,,,,", ["'nan' is not a number"]),
        ("brdf,p,55,-40,40,,,", ["line 2, column theta_r_step_deg", "empty"]),
        ("brdf,p,55,40,-40,5,,", ["40 to -40 by 5", "lo <= hi"]),
        ("brdf,p,55,-95,40,5,,", ["theta_r_deg = -95.0", "[-90, 90]"]),
        ("dhr,p,55,-40,40,5,,", ["column theta_r_lo_deg", "belongs to scans"]),
        ("dhr,p,55,,,,5,", ["port_deg belongs to DDR"]),
        ("ddr,p,55,,,,80,", ["port_deg = 80.0", "[0.1, 45]"]),
        ("dhr,p,55,,,,,0", ["minutes = 0.0"]),
        ("dhr,p,55", ["line 2", "3 cells where the header has 8"]),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path: Path, row: str, words: list[str]) -> None:
    with pytest.raises(DataError) as caught:
        read(tmp_path, HEADER + row + "\n")
    text = str(caught.value)
    assert "candidates.csv: 1 problem" in text
    assert [word for word in words if word not in text] == []


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="2 problems") as caught:
        read(tmp_path, HEADER + "dhr,x,55,,,,,\ndhr,p,55,,,,,\ndhr,p,no,,,,,\n")
    assert "line 2" in str(caught.value)
    assert "line 4" in str(caught.value)


@pytest.mark.parametrize(
    ("row", "n", "words"),
    [
        ("scan,x,abc,-40,no,,,", 5, ["column quantity", "column polarization", "column theta_i_deg",
                                     "'no' is not a number", "column theta_r_step_deg: empty"]),
        ("dhr,x,95,,,,,", 2, ["column polarization", "theta_i_deg = 95.0"]),
        ("dhr,p,95,,,,,0", 1, ["theta_i_deg = 95.0", "minutes = 0.0"]),
        ("ddr,p,no,,,,80,", 2, ["column theta_i_deg", "port_deg = 80.0"]),
    ],
)  # fmt: skip
def test_all_that_is_wrong_in_a_row_is_told(
    tmp_path: Path, row: str, n: int, words: list[str]
) -> None:
    """And nothing that only follows from it, as a dhr with a range where a scan was meant."""
    with pytest.raises(DataError) as caught:
        read(tmp_path, HEADER + row + "\n")
    text = str(caught.value)
    assert f"{n} problem" in text
    assert [word for word in words if word not in text] == []
    assert "belongs to" not in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("quantity,polarisation,theta_i_deg\ndhr,p,5\n", ["'polarisation' is not known", "Did you mean 'polarization'?"]),
        ("quantity,theta_i_deg\ndhr,5\n", ["column polarization is missing"]),
        ("quantity,quantity,theta_i_deg\ndhr,dhr,5\n", ["twice"]),
        (HEADER, ["no candidate"]),
        ("", ["empty"]),
    ],
)  # fmt: skip
def test_a_header_that_is_wrong(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(DataError) as caught:
        read(tmp_path, text)
    assert [word for word in words if word not in str(caught.value)] == []


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there is no such file"):
        read_candidates(tmp_path / "none.csv", SCAN, costs=COSTS, port_deg=5.0)


def test_kinds_and_a_file() -> None:
    assert parse_kinds("dhr,scan,a.csv") == (("dhr", "scan"), Path("a.csv"))
    assert parse_kinds("a.csv") == ((), Path("a.csv"))
    with pytest.raises(ConfigError, match=r"'scam' is not known\. Did you mean 'scan'\?"):
        parse_kinds("scam")
    with pytest.raises(ConfigError, match="one CSV file"):
        parse_kinds("a.csv,b.csv")
    with pytest.raises(ConfigError, match="with commas"):
        parse_kinds("")


def test_the_same_candidate_is_there_once(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "quantity,polarization,theta_i_deg\ndhr,p,75\ndhr,p,75\ndhr,p,76\n", encoding="utf-8"
    )
    found = list_wanted(Wanted(kinds=("dhr",), csv=path), None)
    assert len(found) == 3 * 18 + 1


def test_twenty_thousand_rows_are_read_and_more_are_refused_with_their_line(tmp_path):
    path = tmp_path / "many.csv"
    head = "quantity,polarization,theta_i_deg\n"
    path.write_text(head + "brdf,s,10\n" * 20_000)
    found = read_candidates(path, SCAN, costs=COSTS, port_deg=5.0)
    assert len(found) == 20_000
    assert len({id(c.theta_r_deg) for c in found}) == 1
    for row in ("dhr,s,10\n", "dhr,s,x\n"):
        path.write_text(head + row * 40_000)
        with pytest.raises(DataError, match="line 20002: more than 20000 rows"):
            read_candidates(path, SCAN, costs=COSTS, port_deg=5.0)


def test_readings_of_all_scans_are_bounded(tmp_path):
    path = tmp_path / "many.csv"
    head = "quantity,polarization,theta_i_deg,theta_r_lo_deg,theta_r_hi_deg,theta_r_step_deg\n"
    path.write_text(head + "brdf,s,10,-90,90,0.1\n" * 1200)
    with pytest.raises(DataError, match="line 1112: the scans have more than 2000000 readings"):
        read_candidates(path, SCAN, costs=COSTS, port_deg=5.0)


def test_what_was_measured_is_a_candidate_too_unless_angles_are_given() -> None:
    """Off the grid of 5 degrees as well; each once."""
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(12.5, 60.0), theta_r_deg=np.arange(-60.0, 61.0, 20.0),
        dhr_theta_i_deg=(12.5, 50.0),
    )  # fmt: skip
    labels = [c.label for c in list_wanted(Wanted(), m)]
    assert len(labels) == len(set(labels)) == 162 + 4
    assert {"s scan at 12.5°", "p scan at 12.5°", "DHR_s at 12.5°", "DHR_p at 12.5°"} < set(labels)
    only = list_wanted(Wanted(kinds=("dhr",), theta_i_deg=(30.0,)), m)
    assert [c.label for c in only] == ["DHR_s at 30°", "DHR_p at 30°", "DHR_u at 30°"]
    assert len(list_wanted(Wanted(polarizations=("u",)), m)) == 54


def test_several_ports() -> None:
    found = list_wanted(
        Wanted(kinds=("ddr",), theta_i_deg=(20.0,), polarizations=("s",), port_deg=(2.0, 5.0)), None
    )
    assert [c.label for c in found] == ["DDR_s at 20°, port 2°", "DDR_s at 20°, port 5°"]
