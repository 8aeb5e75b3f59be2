"""The page in Chromium itself: it draws without an error or a network, turns, sorts, and fits a phone and paper."""

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from report_cases import design, grown, toy_page

from topo_search.compose import audit
from topo_search.model import Topology
from topo_search.report.design_page import design_page
from topo_search.report.page import render

pytestmark = pytest.mark.browser

WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""3-D drawn by the processor: test machines have no graphics card."""
CAMERA = "id => JSON.stringify(document.getElementById(id)._fullLayout.scene._scene.getCamera().eye)"
TURN = """
async () => {
  const view = document.getElementById("view");
  for (let step = 0; step < 12; step++) {
    const angle = step * 0.1;
    const eye = { x: 1.7 * Math.cos(angle), y: 1.7 * Math.sin(angle), z: 0.7 };
    await Plotly.relayout(view, { "scene.camera.eye": eye });
    await new Promise(requestAnimationFrame);
  }
}
"""


PATIENCE_MS = 300_000
"""For a page to load: on a busy machine without a graphics card it takes its time."""


@pytest.fixture(scope="module")
def launched() -> Iterator[Callable[..., Browser]]:
    """Starts Chromium."""
    found = shutil.which("chromium") or shutil.which("google-chrome")
    assert found, "these tests need Chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        yield lambda *options: playwright.chromium.launch(executable_path=found, args=["--no-sandbox", *options])


@pytest.fixture(scope="module")
def browser(launched: Callable[..., Browser]) -> Iterator[Browser]:
    with launched(*WEBGL) as browser:
        yield browser


Open = Callable[..., Page]


@pytest.fixture
def opened(browser: Browser, tmp_path: Path) -> Iterator[Open]:
    """Opens a page's text; at the end nothing may have gone wrong in any of them."""
    wrong: list[str] = []
    pages = []

    def open_text(text: str, width: int = 1200) -> Page:
        path = tmp_path / "page.html"
        path.write_text(text, encoding="utf-8")
        page = browser.new_page(viewport={"width": width, "height": 900})
        page.set_default_timeout(PATIENCE_MS)
        pages.append(page)
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
        page.goto(path.as_uri())
        page.wait_for_function("document.querySelectorAll('[data-figure]:not(.js-plotly-plot)').length === 0")
        return page

    yield open_text
    for page in pages:
        page.close()
    assert wrong == []


@pytest.fixture(scope="module")
def five() -> str:
    made = design(Topology.from_key("af0000"), "push-two-paths")
    return render(design_page(made, audit(made), "mine.json"))


def column(page: Page, name: str) -> list[str]:
    headings = page.locator("#ranking thead th button").all_inner_texts()
    place = headings.index(name) + 1
    return page.locator(f"#ranking tbody td:nth-child({place})").all_inner_texts()


def test_the_view_turns(opened: Open, five: str) -> None:
    page = opened(five)
    view = page.locator("#view canvas").first
    view.scroll_into_view_if_needed()
    before, seen = page.evaluate(CAMERA, "view"), view.screenshot()
    box = view.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 150, y + 40, steps=10)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert page.evaluate(CAMERA, "view") != before
    assert view.screenshot() != seen


def test_the_table_sorts_and_filters(opened: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_NONE", "a3010")
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4))
    ranked = column(page, "tree")
    assert len(ranked) == len({*ranked}) == 14
    objectives = [float(text) for text in column(page, "J [rad⁴/s⁴]") if text]
    assert objectives == sorted(objectives)
    heading = page.locator("#ranking th button", has_text="tree")
    heading.click()
    assert column(page, "tree") == sorted(ranked)
    heading.click()
    assert column(page, "tree") == sorted(ranked, reverse=True)
    assert page.locator("#ranking th[aria-sort=descending]").inner_text().startswith("tree")
    numbers = page.locator("#ranking th button", has_text="J / bound")
    for up in (True, False):
        numbers.click()
        found = column(page, "J / bound")
        values = [float(text) for text in found if text]
        assert values == sorted(values, reverse=not up)
        assert all(found[: len(values)])  # what has no number comes last, whichever way
    page.fill("#words", ranked[3])
    assert column(page, "tree") == [ranked[3]]
    page.fill("#words", "")
    page.select_option("#status", "infeasible")
    assert column(page, "tree") == ["a3010"]
    assert column(page, "status") == ["infeasible"]


def test_a_phone_scrolls_down_only(opened: Open, five: str) -> None:
    page = opened(five, width=360)
    assert page.evaluate("document.documentElement.scrollWidth") == 360


def test_a_hundred_modules_are_a_few_meshes(opened: Open) -> None:
    made = design(grown(100), "push-two-paths")
    page = opened(render(design_page(made, audit(made), "mine.json")))
    assert page.evaluate("document.getElementById('view').data.length") <= 20
    before = page.evaluate(CAMERA, "view")
    page.evaluate(TURN)
    assert page.evaluate(CAMERA, "view") != before


def test_on_paper_there_are_no_controls(opened: Open, five: str) -> None:
    page = opened(five)
    page.emulate_media(media="print")
    assert page.locator("#view canvas").first.is_visible()
    assert not page.locator("nav").is_visible()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details").count() == page.locator("details[open]").count() > 0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("details[open]").count() == 0
    pages = re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))
    assert 2 <= len(pages) <= 12


def test_without_webgl_the_rest_of_the_page_works(
    launched: Callable[..., Browser], tmp_path: Path, five: str
) -> None:
    path = tmp_path / "page.html"
    path.write_text(five, encoding="utf-8")
    with launched("--disable-gpu", "--disable-3d-apis") as browser:
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(path.as_uri())
        page.wait_for_selector("#inputs .main-svg")
        assert "WebGL" in page.locator("#view").inner_text()
