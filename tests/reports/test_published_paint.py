"""The committed page with the paper's curves states what the model gives today."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import pbrdf_bayes as pb

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[2] / "reports" / "published_paint"


@pytest.fixture(scope="module")
def make(make_of):
    return make_of("published_paint")


@pytest.fixture(scope="module")
def committed():
    return (FOLDER / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def built(make):
    return make.build()


def stated(page):
    text = re.search(r'<script type="application/json" id="numbers">(.*?)</script>', page)[1]
    return json.loads(text)


def shown(page):
    """Every number in the tables, in order."""
    cells = re.findall(r"<t[dh]>(.*?)</t[dh]>", page)
    plain = (re.sub(r" × 10<sup>−(\d+)</sup>", r"e-\1", cell) for cell in cells)
    return [float(cell) for cell in plain if re.fullmatch(r"\d+\.\d+(e-\d+)?", cell)]


def flat(value):
    if isinstance(value, dict):
        return [x for key in value for x in flat(value[key])]
    if isinstance(value, list):
        return [x for item in value for x in flat(item)]
    return [value]


def test_the_committed_numbers_are_those_of_the_model(make, committed):
    now, then = make.numbers(), stated(committed)
    assert list(now) == list(then)
    np.testing.assert_allclose(flat(now), flat(then), rtol=2e-7)


def test_the_committed_tables_are_those_of_the_model(committed, built):
    assert len(shown(committed)) > 200
    np.testing.assert_allclose(shown(built), shown(committed), rtol=6e-3)


def test_the_tables_show_the_numbers(committed):
    found = stated(committed)
    wanted = [*flat(found["dhr"]), *flat(found["rho_q"]), *flat(found["brdf"])]
    table = np.array(shown(committed))
    nearest = [np.min(np.abs(table / value - 1.0)) for value in wanted]
    assert max(nearest) < 0.006  # three digits


def test_the_page_is_about_the_published_parameters(committed):
    assert stated(committed)["parameters"] == {
        "n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47,
    }  # fmt: skip
    for value in ("1.526 − 0.193 i", "= 0.4528<", "= 0.47<"):
        assert value in committed


def test_the_reciprocity_defect_is_the_one_the_package_computes(committed):
    for row in stated(committed)["reciprocity"]:
        for q in "spu":
            a, b = row["theta_a_deg"], row["theta_b_deg"]
            there, back = pb.brdf(pb.GREEN_PAINT, [a, b], [b, a], q, rtol=1e-10)
            assert row[q] == pytest.approx(there / back, rel=1e-6)
    assert "1.20 for s and 5.70 for p" in committed


def test_the_page_stands_alone(committed, built):
    for page in (committed, built):
        assert page.count("<svg") == page.count("</svg>") == 6
        assert len(set(re.findall(r'aria-label="([^"]+)"', page))) == 6
        assert re.findall(r"<(?:link|script|img)[^>]*(?:src|href)=\"(?!data:)[^\"]*\"", page) == []
        assert "{{" not in page
        assert "@import" not in page


def test_ids_of_the_page_are_unique_and_resolved(built):
    ids = re.findall(r' id="([^"]*)"', built)
    assert [name for name in set(ids) if ids.count(name) > 1] == []
    used = re.findall(r"url\(#([^)]*)\)|href=\"#([^\"]*)\"", built)
    assert {a or b for a, b in used} <= set(ids)


def test_only_the_public_interface_is_used():
    source = (FOLDER / "make.py").read_text(encoding="utf-8")
    assert re.findall(r"^ *(?:from|import) pbrdf_bayes.*$", source, re.MULTILINE) == [
        "import pbrdf_bayes as pb"
    ]
    assert set(re.findall(r"\bpb\.(\w+)", source)) <= set(pb.__all__)
