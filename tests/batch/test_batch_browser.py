"""The index in a real browser, from its file: sorted and filtered by keyboard, nothing fetched."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pbrdf_bayes.batch.index import write_index

pytestmark = pytest.mark.browser


def parameter(symbol: str, mean: float, sd: float) -> dict[str, Any]:
    return {
        "symbol": symbol, "unit": "1", "kind": "physical", "mean": mean, "sd": sd, "median": mean,
        "q025": mean - 1.96 * sd, "q975": mean + 1.96 * sd, "identified": True,
    }  # fmt: skip


def row(i: int, verdict: str | None) -> dict[str, Any]:
    theta = [-60.0, 0.0, 60.0]
    return {
        "sample": f"lot {i} <b>&", "source": "lots.csv", "wavelength_um": 3.39, "n_brdf": 6,
        "n_dhr": 2, "curves": [
            {"polarization": q, "theta_i_deg": 20.0, "theta_r_deg": theta, "value": [0.01, 0.02, 0.03]}
            for q in "sp"
        ],
        "status": "done" if verdict else "failed", "verdict": verdict, "headline": "",
        "run": f"lot_{i}-0" if verdict else None, "seconds": 10.0 - i, "conformity": None,
        "error": None if verdict else "lots.csv: 1 problem, nothing was read.", "rms_dex": 0.01 * i,
        "parameters": {"n": parameter("n", 1.5 + 0.01 * (i * 7 % 5), 0.002),
                       "rho0": parameter("ρ_0", 0.4 + 0.02 * (i % 3), 0.001)} if verdict else {},
    }  # fmt: skip


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("index")
    verdicts = ["PASS", "WARN", "PASS", None, "FAIL", "PASS", "PASS"]
    write_index(folder, [row(i, v) for i, v in enumerate(verdicts, start=1)], n_samples=7)
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
