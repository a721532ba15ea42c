"""What a report says and shows, from synthetic analyses; how it looks is `test_browser`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from html import unescape
from html.parser import HTMLParser
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from jsonschema import Draft202012Validator

from pbrdf_bayes.io.schemas import json_schema
from pbrdf_bayes.records.summary import Summary
from pbrdf_bayes.report import render_report
from pbrdf_bayes.report.figures.axes import thinned
from pbrdf_bayes.report.numbers import rounded
from pbrdf_bayes.results import Analysis
from tests.report.synthetic import analysis
from tests.report.synthetic_cases import CASES, Case

VOID = {"meta", "link", "br", "img", "input", "hr"}
ALL = sorted(CASES)


@cache
def page(name: str) -> str:
    return render_report(analysis(name))


class Outline(HTMLParser):
    """Checks nesting and collects what the tests ask for."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.problems: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.images: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {k: v or "" for k, v in attrs}
        if len(values) != len(attrs):
            self.problems.append(f"<{tag}> repeats an attribute")
        self.tags.append((tag, values))
        self.ids += [values["id"]] if "id" in values else []
        self.targets += [values["href"][1:]] if values.get("href", "").startswith("#") else []
        self.targets += [values["aria-labelledby"]] if "aria-labelledby" in values else []
        self.targets += re.findall(r"url\(#([^)]*)\)", " ".join(values.values()))
        if values.get("role") == "img":
            self.images.append(values.get("aria-label", ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"</{tag}> closes nothing or the wrong element")


@cache
def outline(name: str) -> Outline:
    parser = Outline()
    parser.feed(page(name))
    parser.close()
    return parser


def text_of(html: str) -> str:
    html = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return re.sub(r"[ \n]+", " ", unescape(re.sub(r"<[^>]*>", " ", html)))


@pytest.mark.parametrize("name", ALL)
def test_synthetic_summaries_follow_the_schema(name: str) -> None:
    schema = json_schema(Summary)
    Draft202012Validator.check_schema(schema)
    summary = json.loads(json.dumps(analysis(name).summary, allow_nan=False))
    assert [e.message for e in Draft202012Validator(schema).iter_errors(summary)] == []


@pytest.mark.parametrize("name", ALL)
def test_page_is_well_formed(name: str) -> None:
    found = outline(name)
    assert found.problems == []
    assert found.open == []
    assert len(found.ids) == len(set(found.ids)), "ids are unique"
    assert set(found.targets) <= set(found.ids), "every reference has its target"
    tags = [tag for tag, _ in found.tags]
    assert tags.count("h1") == tags.count("main") == tags.count("header") == 1
    assert page(name).startswith("<!doctype html>")
    assert '<html lang="en">' in page(name)


@pytest.mark.parametrize("name", ALL)
def test_page_needs_nothing_from_outside(name: str) -> None:
    for forbidden in ("http", "<script", "@import", "src=", "javascript:", "<iframe", "<object"):
        assert forbidden not in page(name).replace(hostile_text(), "")
    links = [values["href"] for tag, values in outline(name).tags if tag == "link"]
    assert links == ["data:,"], "an icon of its own, so that none is fetched"


def hostile_text() -> str:
    """The one place where a page may look as if it had a source: a label of the hostile case."""
    return "&lt;img src=x onerror=alert(1)&gt;"


@pytest.mark.parametrize("name", ALL)
def test_every_picture_says_its_numbers(name: str) -> None:
    images = outline(name).images
    assert len(images) >= 8
    for words in images:
        assert re.search(r"\d", words), words


def test_alternative_of_a_scan_plane_gives_range_and_bands() -> None:
    words = next(w for w in outline("demo").images if w.startswith("BRDF at 20° incidence"))
    assert re.search(r"s: measured 0\.\d+ to 0\.\d+ per sr, 90 % model band ±[\d.]+\u202f%", words)
    assert re.search(r"p: measured 0\.\d+ to 0\.\d+ per sr", words)
    assert "90 % predictive band" in words


@pytest.mark.parametrize("name", ["demo", "misfit", "one_scan"])
def test_parameter_table_holds_every_number(name: str) -> None:
    shown = text_of(page(name))
    for p in analysis(name).summary["parameters"].values():
        r = rounded(p["mean"], p["sd"], low=p["q025"], high=p["q975"], at_map=p["map"])
        for expected in (r.value, r.uncertainty, f"{r.low} to {r.high}", r.map, p["prior"]):
            assert expected in shown
        assert f"{p['rhat']:.4f}" in shown
        assert "2\u202f381" in shown, "effective sample size"


def test_first_screen_quotes_the_physical_parameters() -> None:
    p = analysis("demo").summary["parameters"]["n"]
    r = rounded(p["mean"], p["sd"], low=p["q025"], high=p["q975"])
    first = text_of(page("demo").split("<main>")[0])
    assert f"{r.value} ± {r.uncertainty}" in first
    assert f"(95 %: {r.low} to {r.high})" in first


@pytest.mark.parametrize("name", ALL)
def test_what_did_not_pass_is_on_the_first_screen(name: str) -> None:
    summary = analysis(name).summary
    first = page(name).split("<main>")[0]
    shown = text_of(first)
    checks = [*summary["diagnostics"].values(), *summary["input"]["checks"]]
    for check in checks:
        attention = check["verdict"] in ("WARN", "FAIL")
        assert (f": {check['title']}" in shown) == attention
        if attention:
            assert f'class="icon {check["verdict"]}"' in first, "a shape, not the colour alone"
            assert unescape(check["advice"]) in shown


@pytest.mark.parametrize(
    ("name", "shout"),
    [("not_converged", "NOT CONVERGED"), ("misfit", "FAIL: do not use"), ("demo", None)],
)
def test_a_page_not_to_be_used_says_so_on_top(name: str, shout: str | None) -> None:
    above = text_of(page(name).split("<h1")[0].split("<body>")[1])
    assert (shout in above) if shout else ("FAIL" not in above and "NOT CONVERGED" not in above)


@pytest.mark.parametrize(
    ("name", "absent"),
    [
        ("demo", set()),
        ("dhr_only", {"measured", "residuals", "holdout"}),
        ("one_scan", {"holdout"}),
        ("many_points", {"holdout"}),
    ],
)
def test_sections_follow_the_data(name: str, absent: set[str]) -> None:
    sections = {values["id"] for tag, values in outline(name).tags if tag == "section"}
    assert {"parameters", "posterior", "diagnostics", "data", "provenance"} <= sections
    assert not sections & absent
    assert {"measured", "between", "dhr", "residuals", "holdout"} - absent <= sections


def test_bands_are_explained_once_and_kept_apart() -> None:
    for name in ALL:
        assert page(name).count("Two bands, never mixed.") == 1


def test_thinned_readings_are_announced() -> None:
    assert "50\u202f000 in a scan" in page("many_points")
    assert "evenly thinned" not in page("repeats")


def test_hostile_names_are_text() -> None:
    html = page("hostile")
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(&#39;x&#39;)" in html
    assert "<b>bold</b>" not in html
    assert "<i>flag</i>" not in html
    assert hostile_text() in html
    assert "{{ 7*7 }}" in html
    assert not re.search(
        "[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]", html
    )
    html.encode("utf-8")


def test_missing_values_are_dashes() -> None:
    shown = text_of(page("hostile"))
    assert not re.search(r"\b(nan|NaN|None|null|inf)\b", shown)
    assert " – " in shown


def test_same_analysis_same_page(tmp_path) -> None:
    a = analysis("one_scan")
    path = tmp_path / "posterior.nc"
    a.draws.to_netcdf(path, engine="h5netcdf")
    summary = json.loads(json.dumps(a.summary))
    with xr.open_datatree(path, engine="h5netcdf") as draws:
        from_disk = render_report(Analysis(summary, draws, a.config_toml))
    assert from_disk == page("one_scan") == render_report(a)


def test_settings_of_the_user_do_not_matter_and_are_kept() -> None:
    mine = {
        "svg.fonttype": "path",
        "font.size": 40,
        "path.simplify": False,
        "axes.facecolor": "red",
    }
    with mpl.rc_context(mine):
        assert render_report(analysis("one_scan")) == page("one_scan")
        assert {key: mpl.rcParams[key] for key in mine} == mine


@pytest.mark.parametrize("name", ALL)
def test_page_is_small(name: str) -> None:
    assert len(page(name).encode()) < 3e6


def damaged(name: str, change: Callable[[dict[str, xr.Dataset], dict[str, Any]], None]) -> Analysis:
    """Return a synthetic analysis after a change to its groups and its summary."""
    a = analysis(name)
    groups = {key: node.to_dataset() for key, node in a.draws.children.items()}
    summary = json.loads(json.dumps(a.summary))
    change(groups, summary)
    return Analysis(summary, xr.DataTree.from_dict(groups), a.config_toml)


def no_groups(groups, _summary) -> None:
    groups.clear()


def constant_and_missing_draws(groups, _summary) -> None:
    groups["posterior"]["n"][:] = 1.5
    groups["posterior"]["k"][:] = np.nan
    groups["posterior"]["rho0"][0, 0] = np.inf


def zero_and_missing_curves(groups, _summary) -> None:
    for name in ("map", "model_band", "predictive_band"):
        groups["curves"][name][0] = 0.0
        groups["curves"][name][1] = np.nan
        groups["dhr_curves"][name][:] = np.nan
    groups["constant_data"]["brdf_map"][:40] = 0.0


def unusable_readings(groups, _summary) -> None:
    groups["observed_data"]["brdf"][:] = -1.0
    groups["observed_data"]["dhr"][:] = np.nan


def out_of_plane(groups, _summary) -> None:
    n = groups["curves"].sizes["curve"]
    groups["curves"] = groups["curves"].assign_coords(curve_phi_r_deg=("curve", np.full(n, 30.0)))
    groups["constant_data"]["brdf_phi_r_deg"][:] = 30.0


def nothing_known(_groups, summary) -> None:
    for p in summary["parameters"].values():
        p.update({key: None for key, value in p.items() if isinstance(value, float)})
    for check in summary["diagnostics"].values():
        check.update(value=None, threshold=None, unit=None, advice=None)
    summary["fit"]["rms_dex"]["overall"] = summary["fit"]["lag1"]["overall"] = None
    summary["map"] = {"n_starts": 0, "optima": []}
    summary["sampling"] = dict.fromkeys(summary["sampling"])


@pytest.mark.parametrize(
    "change",
    [
        no_groups, constant_and_missing_draws, zero_and_missing_curves, unusable_readings,
        out_of_plane, nothing_known,
    ],
)  # fmt: skip
def test_damaged_records_still_make_a_page(change) -> None:
    html = render_report(damaged("not_converged", change))
    parser = Outline()
    parser.feed(html)
    assert parser.problems == []
    assert not re.search(r"\b(nan|NaN|None|inf)\b", text_of(html))
    assert ("φ<sub>r</sub> = 30°" in html) == (change is out_of_plane)


@pytest.mark.parametrize("n_points", [1, 2, 5])
def test_short_scans(n_points: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CASES, "short", Case(n_points=n_points, theta_i_deg=(0.0,), holdout=False))
    assert "too few" in render_report(analysis("short"))


def test_many_planes_are_cut_to_the_worst(monkeypatch: pytest.MonkeyPatch) -> None:
    angles = tuple(np.linspace(0, 80, 40).tolist())
    monkeypatch.setitem(CASES, "planes", Case(theta_i_deg=angles, n_points=21, holdout=False))
    shown = text_of(render_report(analysis("planes")))
    assert "The 24 worst-fitting of 40 scan planes are drawn." in shown
    assert "The 24 worst-fitting of 80 scans are drawn." in shown


def test_identified_and_not() -> None:
    first = page("misfit").split("<main>")[0]
    assert first.count("not identified") == 2
    assert "not identified</span>" not in page("demo")


def test_text_in_pictures_is_text_in_the_font_of_the_page() -> None:
    html = page("demo")
    assert "<text" in html
    assert "font-family: 'DejaVu" not in html
    assert 'font-size=".76em">r</tspan>' in html, "a subscript"


def test_outliers_are_never_thinned_away() -> None:
    values = np.zeros(10_001)
    values[[17, 5003, 9998]] = [3.0, -4.0, 5.0]
    rows = thinned(values, 160)
    assert rows.size <= 160
    assert {17, 5003, 9998} <= set(rows.tolist())


def test_the_first_screen_says_where_n_and_k_are_no_constants() -> None:
    found = analysis("demo")
    words = "The model is descriptive only: the rms is large. n and k are not material constants."
    told = {"verdict": "descriptive only", "reasons": ["x"], "statement": words}
    page = render_report(
        replace(found, summary={**found.summary, "applicability": told}), brief=True
    )
    first = page[: page.index("<main")]
    assert words in first
    assert words not in render_report(found, brief=True)


def first_screen(**changes: Any) -> str:
    found = analysis("demo")
    page = render_report(replace(found, summary={**found.summary, **changes}), brief=True)
    return unescape(re.sub(r"<[^>]*>", "", page[: page.index("<main")]))


def test_the_first_screen_says_what_was_not_tested() -> None:
    """Beside the verdict; where the fit failed without a word in favour of the model."""
    told = dict(analysis("demo").summary["applicability"])
    assert told["statement"] in first_screen()
    caveat = 'Not tested: prediction of angles left out; fit with holdout = "all".'
    told |= {"statement": f"{told['statement']} {caveat}", "caveats": [caveat]}
    assert told["statement"] in first_screen(applicability=told)
    failed = first_screen(applicability=told, verdict="FAIL")
    assert caveat in failed
    assert "Nothing speaks against" not in failed


def test_a_fixed_parameter_is_called_fixed_and_is_in_no_figure_of_the_sampling() -> None:
    found = analysis("demo")
    n = {**found.summary["parameters"]["n"], "kind": "fixed", "sd": 0.0, "mean": 1.5}
    n |= {"prior": "fixed at 1.5", "identified": False, "contraction": None}
    parameters = {**found.summary["parameters"], "n": n}
    page = render_report(replace(found, summary={**found.summary, "parameters": parameters}))
    row = next(r for r in re.findall(r"<tr>.*?</tr>", page, re.DOTALL) if "fixed at 1.5" in r)
    cells = [re.sub(r"<[^>]*>", " ", c).split() for c in re.findall(r"<td.*?</td>", row)]
    assert cells[:4] == [["1.5"], ["–"], ["fixed"], ["–"]]
    assert "not identified" not in page
    assert "assumed, not measured" in page
    assert "Held fixed: n = 1.5." in page
    labels = re.findall(r'aria-label="((?:Trace and ranks|Posterior) of [^"]*)"', page)
    assert labels
    assert not any(re.search(r"\bn\b(?! ens)", label) for label in labels)
    before = re.findall(
        r'aria-label="((?:Trace and ranks|Posterior) of [^"]*)"', render_report(found)
    )
    assert len(before) == len(labels) + 1


def test_candidates_have_one_notation_and_equal_decimals() -> None:
    found = analysis("demo")
    rms = {"rms_dex": [0.2, 0.0423], "held_out_dex": [0.3, 0.1234], "mean_held_out_dex": [0.3, 0.1]}
    candidates = [
        {
            "name": "lambert", "effects": ["lambert"], "line_shape": "cauchy", "n_free": 5,
            "score": -4.0, "difference": 0.0, "u_difference": 0.0, "microseconds": 50.0 + i,
            "at_bound": ["nu", "rho0"] if i else [], "chosen": bool(i),
            **{name: values[i] for name, values in rms.items()},
        }
        for i in range(2)
    ]  # fmt: skip
    choice = {
        "candidates": candidates, "cases": ["10 deg", "50 deg", "70 deg"], "statement": "So.",
        "symbols": {"nu": "ν", "rho0": "ρ_0"},
    }  # fmt: skip
    page = render_report(
        replace(found, summary={**found.summary, "effects_choice": choice}), brief=True
    )
    table = page[page.index('aria-label="Candidates"') :]
    rows = re.findall(r"<tr.*?</tr>", table[: table.index("</table>")], re.DOTALL)[1:]
    cells = [[re.sub(r"<[^>]*>", "", c) for c in re.findall(r"<td.*?</td>", row)] for row in rows]
    assert [row[2:5] for row in cells] == [["0.200", "0.30", "0.30"], ["0.042", "0.12", "0.10"]]
    assert [row[6] for row in cells] == ["–", "ν, ρ0"]
    assert "its rms is that of log₁₀(measured / predicted) over all its readings" in table


@pytest.mark.parametrize("caution", ["", "The choice has almost no statistics behind it."])
def test_a_choice_without_statistics_says_so_in_the_table(caution: str) -> None:
    found = analysis("demo")
    candidate = {
        "name": "lambert", "effects": ["lambert"], "line_shape": "lorentzian", "n_free": 5,
        "rms_dex": 0.01, "held_out_dex": 0.02, "score": -4.0, "difference": 0.0,
        "u_difference": 0.0, "at_bound": [], "microseconds": 50.0, "chosen": True,
    }  # fmt: skip
    choice = {"candidates": [candidate], "cases": ["10 deg", "50 deg"], "statement": "So."}
    summary = {**found.summary, "effects_choice": {**choice, "caution": caution}}
    page = render_report(replace(found, summary=summary), brief=True)
    assert ("Only 2 cases: the standard errors mean little." in page) is bool(caution)
    assert caution in page
    assert render_report(replace(found, summary={**summary, "effects_choice": choice}), brief=True)


def test_a_table_of_optima_of_many_parameters_is_turned() -> None:
    """Parameters in rows: with twelve of them in columns it would be wider than the page."""
    found = analysis("demo")
    more = {f"q{i}": {**found.summary["parameters"]["n"], "symbol": f"q_{i}"} for i in range(12)}
    optima = [{**o, "parameters": {**o["parameters"], **dict.fromkeys(more, 1.5)}}
              for o in found.summary["map"]["optima"]]  # fmt: skip
    summary = {
        **found.summary, "parameters": {**found.summary["parameters"], **more},
        "map": {**found.summary["map"], "optima": optima},
    }  # fmt: skip
    for told, turned in ((found.summary, False), (summary, True)):
        page = render_report(replace(found, summary=told), brief=True)
        table = page[page.index('aria-label="Optima"') :]
        table = table[: table.index("</table>")]
        n = len(told["parameters"])
        assert table.count("<tr>") == (4 + n if turned else 1 + len(optima))
        assert ("<thead>" in table) is not turned
