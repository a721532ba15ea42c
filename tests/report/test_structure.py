"""What the report says of the form of the model."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from typing import Any

from pbrdf_bayes.report import render_report
from pbrdf_bayes.report.numbers import fixed
from pbrdf_bayes.report.structure import (
    reciprocity_caption,
    reciprocity_rows,
    reciprocity_text,
    widths_text,
)
from tests.report.synthetic import analysis


def section(html: str) -> str:
    found = re.search(r'<section id="structure".*?</section>', html, re.DOTALL)
    return unescape(re.sub(r"<[^>]*>", " ", found[0])) if found else ""


def with_summary(name: str, **changes: Any):
    found = analysis(name)
    return replace(found, summary={**found.summary, **changes})


def test_the_largest_factor_is_in_words() -> None:
    shown = section(render_report(analysis("demo"), brief=True))
    assert "at most 3.32 (p, from 80° to −20°; 90 % interval 2.9 to 3.9)." in shown
    assert "effects" not in shown
    nothing = section(render_report(analysis("dhr_only"), brief=True))
    assert "No pair of angles was measured in the plane of incidence." in nothing
    assert "effects of the sample" in reciprocity_text(
        with_summary("demo", effects=["lambert"]).summary
    )


def test_every_cell_is_from_the_smaller_angle_to_the_larger() -> None:
    summary = analysis("demo").summary
    rows, factors = reciprocity_rows(summary), summary["reciprocity"]["factors"]
    assert [angle for angle, _ in rows] == [f"{10 * i}°" for i in range(9)]
    assert rows[3][1][1].text == fixed(factors["s"][1][3], 2), "s below the diagonal"
    assert rows[1][1][3].text == fixed(factors["p"][1][3], 2), "p above it"
    assert rows[2][1][7].text == rows[4][1][4].text == "–"
    assert rows[3][1][1].interval == "1.10–1.34"  # exp(0.2) less and more 10 %
    assert "median over 50 draws" in reciprocity_caption(summary)


def test_unpolarised_scans_have_a_factor_of_their_own_and_no_s_and_p() -> None:
    told = dict(analysis("demo").summary["reciprocity"])
    for level in ("factors", "q05", "q95"):
        told[level] = {"u": told[level]["s"]}
    told["largest"] = {**told["largest"], "polarization": "u"}
    summary = with_summary("demo", reciprocity=told).summary
    rows = reciprocity_rows(summary)
    assert rows[3][1][1].text == fixed(told["factors"]["u"][1][3], 2)
    assert [cell.text for cell in rows[0][1]] == ["–"] + 8 * [""]
    assert "(unpolarised, from 80° to −20°; 90 % interval" in reciprocity_text(summary)
    assert "unpolarised light, as measured" in reciprocity_caption(summary)
    assert "s below" not in reciprocity_caption(summary)


def test_an_older_run_has_the_factors_of_its_optimum() -> None:
    told = dict(analysis("demo").summary["reciprocity"])
    told["largest"] = {k: v for k, v in told["largest"].items() if k[0] != "q"}
    older = {k: told[k] for k in ("theta_deg", "factors", "largest")}
    shown = section(render_report(with_summary("demo", reciprocity=older), brief=True))
    assert "at the MAP" in shown
    assert "at most 3.32 (p, from 80° to −20°)." in shown


def test_a_run_without_these_numbers_has_no_such_section() -> None:
    found = analysis("demo")
    older = {k: v for k, v in found.summary.items() if k not in ("reciprocity", "scan_widths")}
    assert section(render_report(replace(found, summary=older), brief=True)) == ""
    refused = section(render_report(with_summary("demo", reciprocity=None), brief=True))
    assert "reflects totally" in refused


def test_the_farthest_width_is_in_words() -> None:
    shown = section(render_report(analysis("demo"), brief=True))
    assert "7 of 10 widths lie within two standard errors of Eq. (5)" in shown
    assert "scan s 20 deg, 1.0300 ± 0.0080 times Eq. (5)" in shown
    assert "exponent" not in shown
    extended = with_summary("demo", effects=["narrowing"]).summary
    assert "with the exponent g of the fit" in widths_text(extended)


def test_scans_without_a_width_are_counted() -> None:
    assert "No scan has a width inside the model's domain." in section(
        render_report(analysis("hostile"), brief=True)
    )
    summary = analysis("demo").summary
    scans = [dict(s) for s in summary["scan_widths"]]
    for name in ("rho", "u_rho"):
        scans[0][name] = None
    assert "of 9 widths" in widths_text({**summary, "scan_widths": scans})
    assert "and 1 scans have" not in widths_text({**summary, "scan_widths": scans})


def test_pictures_of_widths_follow_the_data() -> None:
    images = re.findall(r'aria-label="(Lobe width[^"]*)"', render_report(analysis("demo")))
    assert len(images) == 2
    assert all(re.search(r"s: .* in 5 scans, rms [\d.]+", words) for words in images)
    assert "Lobe width of" not in render_report(analysis("dhr_only"))
