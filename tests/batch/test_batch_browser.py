"""The index in a real browser, from its file: sorted and filtered by keyboard, nothing fetched."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from pbrdf_bayes.batch.index import write_index
from pbrdf_bayes.batch.outcome import RISKS

pytestmark = pytest.mark.browser
ERROR = (
    "lots.csv: 2 problems, nothing was read.\n  line 12, column value: -1 is not allowed, it must be "
    "> 0 sr^-1. Give the instrument's noise floor (brdf_floor in the file of --config) so that the "
    "reading is treated as censored, or flag the row.\n  line 13, column value: the last word is here"
)


def parameter(symbol: str, mean: float, sd: float) -> dict[str, Any]:
    return {
        "symbol": symbol, "unit": "1", "kind": "physical", "mean": mean, "sd": sd, "median": mean,
        "q025": mean - 1.96 * sd, "q975": mean + 1.96 * sd, "identified": True,
    }  # fmt: skip


def row(i: int, verdict: str | None, **found: Any) -> dict[str, Any]:
    theta = [-60.0, 0.0, 60.0]
    return {
        "sample": f"lot {i} <b>&", "source": "lots.csv", "wavelength_um": 3.39, "n_brdf": 6,
        "n_dhr": 2, "curves": [
            {"polarization": q, "theta_i_deg": 20.0, "theta_r_deg": theta, "value": [0.01, 0.02, 0.03]}
            for q in "sp"
        ],
        "status": "done" if verdict else "failed", "verdict": verdict, "headline": "",
        "run": f"lot_{i}-0" if verdict else None, "seconds": 10.0 - i, "conformity": None,
        "error": None if verdict else ERROR, "rms_dex": 0.01 * i, "repeat_of": None, "notice": None,
        **dict.fromkeys(RISKS),
        "parameters": {"n": parameter("n", 1.5 + 0.01 * (i * 7 % 5), 0.002),
                       "rho0": parameter("ρ_0", 0.4 + 0.02 * (i % 3), 0.001)} if verdict else {},
        **found,
    }  # fmt: skip


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("index")
    verdicts = ["PASS", "WARN", "PASS", None, "FAIL", "PASS", "PASS"]
    write_index(folder, [row(i, v) for i, v in enumerate(verdicts, start=1)], n_samples=7)
    return folder / "index.html"


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten samples that all pass their checks, of which the limits let none pass; one without."""
    folder = tmp_path_factory.mktemp("judged")
    p = {"p_conformity": 0.0, "u_p_conformity": 0.0, "p_conformity_low": 0.0,
         "p_conformity_high": 0.0037, "consumer_risk": 1.0, "producer_risk": 0.0}  # fmt: skip
    rows = [row(i, "PASS", conformity="REJECT", **p) for i in range(1, 11)]
    write_index(folder, [*rows, row(11, None)], n_samples=11)
    return folder / "index.html"


def shown(page: Any) -> list[str]:
    script = "[...document.querySelectorAll('#table tbody tr')].filter(r => !r.hidden)"
    numbers: list[str] = page.evaluate(f"{script}.map(r => r.cells[0].textContent)")
    return numbers


def test_sorted_and_filtered_by_keyboard(browser, index):
    complaints: list[str] = []
    context = browser.new_context(offline=True)
    page = context.new_page()
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(index.as_uri())
    assert shown(page) == list("1234567")
    page.get_by_role("button", name="Verdict").focus()
    page.keyboard.press("Enter")
    assert shown(page) == list("5213674")
    head = page.locator("th[aria-sort=ascending]")
    assert head.count() == 1
    assert head.inner_text().startswith("Verdict")
    page.keyboard.press("Enter")
    assert page.locator("th[aria-sort=descending]").count() == 1
    page.get_by_role("button", name="n", exact=True).click()
    assert shown(page)[0] == "5"  # i = 5 has the smallest n; the failed one comes last
    assert shown(page)[-1] == "4"
    page.get_by_label("Sample contains").fill("lot 3")
    assert shown(page) == ["3"]
    assert page.locator("#shown").inner_text() == "1 of 7 shown"
    page.get_by_label("Sample contains").fill("")
    page.get_by_label("Verdict").select_option("none")
    assert shown(page) == ["4"]
    assert complaints == []
    context.close()


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_sticks_out_and_it_reads_without_scripts(browser, index, width):
    context = browser.new_context(
        viewport={"width": width, "height": 900}, java_script_enabled=False
    )
    page = context.new_page()
    page.goto(index.as_uri())
    assert page.locator("#table tbody tr").count() == 7
    assert page.locator("form.tools").is_hidden()
    assert page.locator("caption").count() == 2
    assert page.locator("svg:not([aria-label])").count() == 0
    context.close()
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme="dark")
    page = context.new_page()
    page.goto(index.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    ink, paper = page.evaluate(
        "[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]"
    )
    assert (ink, paper) == ("rgb(230, 233, 236)", "rgb(21, 24, 28)")
    context.close()


def test_rejections_lead_and_have_a_filter(browser, judged):
    """Green fits do not hide them: the large numbers are those of the limits, in their colours."""
    context = browser.new_context(offline=True)
    page = context.new_page()
    page.goto(judged.as_uri())
    tally = page.locator(".tally div")
    assert [part.inner_text().split("\n") for part in tally.all()] == [
        ["0", "accepted"], ["10", "rejected"], ["0", "undecided"], ["1", "without a result"],
    ]  # fmt: skip
    assert tally.nth(1).get_attribute("class") == "FAIL"
    lead = page.inner_text(".headline")
    assert lead.startswith(
        "By the limits given none of 10 samples judged is accepted, 10 rejected."
    )
    cell = page.locator("#table tbody tr").first.locator("td.verdict").first
    assert cell.inner_text().split("\n") == [
        "Reject",
        "pc below 0.37\u202f%",
        "risk below 0.37\u202f%",
    ]
    page.get_by_label("Conformity").select_option("REJECT")
    assert shown(page) == [str(i) for i in range(1, 11)]
    page.get_by_label("Conformity").select_option("none")
    assert shown(page) == ["11"]
    page.get_by_label("Fit").select_option("PASS")
    assert shown(page) == []
    context.close()


@pytest.mark.parametrize(
    ("decided", "said"),
    [
        ("A", "the one sample judged is accepted. Fits: 1 pass. 1 sample, all with a result."),
        ("R", "none of 1 sample judged is accepted, 1 rejected."),
        ("AAA", "all 3 samples judged are accepted."),
        ("AARU", "2 of 4 samples judged are accepted, 1 rejected, 1 undecided."),
    ],
)
def test_the_lead_is_a_sentence(tmp_path, decided, said):
    words = {"A": "ACCEPT", "R": "REJECT", "U": "UNDECIDED"}
    rows = [row(i, "PASS", conformity=words[c]) for i, c in enumerate(decided, start=1)]
    write_index(tmp_path, rows, n_samples=len(rows))
    page = (tmp_path / "index.html").read_text("utf-8")
    assert f'<p class="headline">By the limits given {said}' in page


@pytest.mark.parametrize("width", [1280, 390])
def test_an_error_is_seen_whole(browser, judged, index, width):
    """Without scrolling sideways, which nobody does for a text that seems to end."""
    for file, number in ((judged, 11), (index, 4)):
        context = browser.new_context(viewport={"width": width, "height": 900})
        page = context.new_page()
        page.goto(file.as_uri())
        failed = page.locator("#table tbody tr").nth(number - 1)
        text = failed.get_by_text("the last word is here")
        seen = [one for one in text.all() if one.is_visible()]
        assert len(seen) == 1
        box = seen[0].bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        context.close()


def wide_row(i: int, **found: Any) -> dict[str, Any]:
    """A row as it is in practice: four parameters of three or four digits, judged."""
    values = {
        "n": (1.5241, 0.004),
        "k": (0.1848, 0.009),
        "sigma_n0": (0.4481, 0.002),
        "rho0": (0.437, 0.01),
    }
    p = {"p_conformity": 0.97, "u_p_conformity": 0.003, "p_conformity_low": 0.96,
         "p_conformity_high": 0.98, "consumer_risk": 0.03, "producer_risk": 0.97}  # fmt: skip
    parameters = {name: parameter(name, *pair) for name, pair in values.items()}
    if i == 3:
        parameters["k"] |= {"identified": False}
    verdict = "WARN" if i == 2 else "PASS"
    return row(i, verdict, conformity="ACCEPT", parameters=parameters, **p, **found) | {
        "sample": f"Lot 2026-{i:03d} green"
    }


@pytest.mark.parametrize("width", [1400, 1280])
def test_a_judged_table_is_seen_whole(browser, tmp_path, width):
    write_index(tmp_path, [wide_row(i) for i in range(1, 6)], n_samples=5)
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto((tmp_path / "index.html").as_uri())
    for region in page.locator(".scroll").all():
        assert region.evaluate("e => e.scrollWidth - e.clientWidth") <= 0
    page.close()


def test_a_printed_table_is_seen_whole(browser, tmp_path):
    """On A4 landscape, whose text is 273 mm wide; with two wavelengths and an error as well."""
    rows = [wide_row(i, wavelength_um=3.39 if i % 2 else 10.6) for i in range(1, 40)]
    write_index(tmp_path, [*rows, row(40, None)], n_samples=40)
    page = browser.new_page(viewport={"width": int(273 / 25.4 * 96), "height": 700})
    page.goto((tmp_path / "index.html").as_uri())
    printed = page.pdf(prefer_css_page_size=True)
    width, height = map(float, re.findall(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", printed)[0])
    assert (width, height) == (pytest.approx(841.9, abs=1.0), pytest.approx(595.3, abs=1.0))
    page.emulate_media(media="print")
    ends = page.evaluate(
        "[...document.querySelectorAll('caption > span, #table td, #table th, figure')]"
        ".map(e => e.getBoundingClientRect().right)"
    )
    assert len(ends) > 400
    assert max(ends) <= page.evaluate("document.documentElement.clientWidth") + 0.5
    assert page.locator("#table .error").get_by_text("the last word is here").is_visible()
    assert page.locator("#table .narrow-error").is_hidden()
    page.close()


def test_tables_are_numbered_through(browser, index):
    """What contains its style counts for itself: no ancestor of a caption may."""
    page = browser.new_page()
    page.goto(index.as_uri())
    contained = page.evaluate(
        "[...document.querySelectorAll('caption')].map(c => { for (let e = c; e; e = e.parentElement)"
        " if (/style|content|strict/.test(getComputedStyle(e).contain) ||"
        " getComputedStyle(e).containerType !== 'normal') return true; return false; })"
    )
    assert contained == [False, False]
    page.close()


def test_a_page_that_is_loaded_again_keeps_what_was_chosen(browser, tmp_path):
    """Filter, order, focus and caret; the page of a batch that has ended is not loaded again."""
    rows = [row(i, "WARN" if i == 3 else "PASS") for i in range(1, 8)]
    write_index(tmp_path, rows, n_samples=9, running=True)
    context = browser.new_context()
    page = context.new_page()
    page.clock.install()
    page.goto((tmp_path / "index.html").as_uri())
    page.get_by_role("button", name="No.").click()
    page.get_by_label("Verdict").select_option("PASS")
    page.get_by_label("Sample contains").fill("lot")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert shown(page) == list("765421")
    write_index(tmp_path, [*rows, row(8, "PASS")], n_samples=9, running=True)
    with page.expect_navigation():
        page.clock.fast_forward(15_100)
    assert shown(page) == list("8765421")
    assert page.locator("#shown").inner_text() == "7 of 8 shown"
    page.keyboard.type("x")
    assert page.get_by_label("Sample contains").input_value() == "lxot"
    assert page.locator("th[aria-sort=descending]").inner_text().startswith("No.")
    write_index(tmp_path, [*rows, row(8, "PASS"), row(9, "PASS")], n_samples=9)
    with page.expect_navigation():
        page.clock.fast_forward(15_100)
    assert "9 of 9 samples" in page.inner_text(".kicker")
    assert reloads(page, 30) == 0
    assert page.locator("#stale").count() == 0
    context.close()


def test_a_page_that_stays_the_same_is_not_loaded_for_ever(browser, tmp_path):
    write_index(tmp_path, [row(1, "PASS")], n_samples=9, running=True)
    context = browser.new_context()
    page = context.new_page()
    page.clock.install()
    page.goto((tmp_path / "index.html").as_uri())
    assert page.locator("#stale").is_hidden()
    assert 18 <= reloads(page, 60) <= 22  # five minutes, four a minute
    assert page.locator("#stale").is_visible()
    context.close()


def reloads(page: Any, most: int) -> int:
    """How often it is loaded again in that many times fifteen seconds."""
    count = 0
    for _ in range(most):
        page.evaluate("window.here = true")
        page.clock.fast_forward(15_100)
        page.wait_for_timeout(50)
        page.wait_for_load_state()
        gone = not page.evaluate("window.here === true")
        count += gone
        if not gone:
            break
    return count
