"""The report in a real browser: nothing fetched, nothing overflowing, printable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pbrdf_bayes.report import render_report
from tests.report.synthetic import analysis
from tests.report.synthetic_cases import CASES

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("reports")
    paths = {name: folder / f"{name}.html" for name in CASES}
    for name, path in paths.items():
        path.write_text(render_report(analysis(name)), encoding="utf-8")
    return paths


class Visit:
    """A page opened from its file with the network cut, and all it complained about."""

    def __init__(self, browser: Any, report: Path, width: int) -> None:
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.context = browser.new_context(viewport={"width": width, "height": 900})
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: self.complaints.append(dialog.message))
        self.context.route("**/*", self._route)
        self.page.goto(report.as_uri())

    def _route(self, route: Any) -> None:
        if route.request.is_navigation_request() and route.request.url.startswith("file:"):
            route.continue_()
        else:
            self.requests.append(route.request.url)
            route.abort()

    def overflow(self) -> list[str]:
        """Elements that reach beyond the window, but for those in a box that scrolls."""
        return self.page.evaluate(
            """() => {
              const wide = document.documentElement.scrollWidth > window.innerWidth;
              const out = [...document.querySelectorAll('body *')].filter(e =>
                !e.closest('.scroll') && !e.closest('svg') && !e.matches('.skip-link') &&
                e.getBoundingClientRect().right > window.innerWidth + 1);
              return [...(wide ? ['the page'] : []), ...out.map(e => e.outerHTML.slice(0, 80))];
            }"""
        )


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("name", sorted(CASES))
def test_page_fits_its_window(
    browser: Any, reports: dict[str, Path], tmp_path: Path, name: str, width: int
) -> None:
    visit = Visit(browser, reports[name], width)
    assert visit.complaints == []
    assert visit.requests == []
    assert visit.overflow() == []
    shot = tmp_path / f"{name}-{width}.png"
    visit.page.screenshot(path=shot, full_page=name != "many_scans")
    assert shot.stat().st_size > 10_000
    visit.context.close()


def test_labels_in_pictures_do_not_overlap(browser: Any, reports: dict[str, Path]) -> None:
    visit = Visit(browser, reports["demo"], 1280)
    overlapping = visit.page.evaluate(
        """() => [...document.querySelectorAll('svg.plot')].flatMap(svg => {
          const boxes = [...svg.querySelectorAll('text')].map(t =>
            ({word: t.textContent, box: t.getBoundingClientRect()}));
          return boxes.flatMap((a, i) => boxes.slice(i + 1).filter(b =>
            a.box.left < b.box.right - 1 && b.box.left < a.box.right - 1 &&
            a.box.top < b.box.bottom - 3 && b.box.top < a.box.bottom - 3
          ).map(b => svg.getAttribute('aria-label').slice(0, 30) + ': ' + a.word + ' / ' + b.word));
        })"""
    )
    assert overlapping == []
    visit.context.close()


def test_first_screen_holds_the_verdict(browser: Any, reports: dict[str, Path]) -> None:
    for name in ("demo", "misfit", "not_converged"):
        visit = Visit(browser, reports[name], 1280)
        for selector in (".stamp", ".headline", ".values", "header figure svg"):
            box = visit.page.locator(selector).first.bounding_box()
            assert box is not None
            assert box["y"] + box["height"] < 900, f"{selector} of {name} is on the first screen"
        visit.context.close()


@pytest.mark.parametrize("name", ["demo", "misfit", "hostile"])
def test_prints_on_a4(browser: Any, reports: dict[str, Path], tmp_path: Path, name: str) -> None:
    visit = Visit(browser, reports[name], 1280)
    path = tmp_path / f"{name}.pdf"
    visit.page.pdf(path=path, prefer_css_page_size=True, print_background=True)
    content = path.read_bytes()
    assert content.count(b"/Type /Page\n") > 1
    assert b"/MediaBox [0 0 594" in content or b"/MediaBox [0 0 595" in content
    visit.context.close()
