"""The site as it is built: it opens from the disk, fetches nothing, and its search finds what the pages say."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from dark_pages import white_boxes
from documented import ROOT
from playwright.sync_api import Browser, sync_playwright

pytestmark = pytest.mark.browser
PATIENCE_MS = 120_000


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", "docs/mkdocs.yml"]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([*command, "--site-dir", str(out)], cwd=ROOT, check=True, env=environment)
    return out


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = shutil.which("chromium") or shutil.which("google-chrome")
    assert found, "these tests need Chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield started
        started.close()


CLIPPED = """() => [
    document.documentElement.scrollWidth - innerWidth,
    ...[...document.querySelectorAll(".md-typeset__scrollwrap, pre > code")]
        .map(shown => shown.scrollWidth - shown.clientWidth),
]"""
"""Excess width of a page over the screen, of tables and code over their frames [px]; data of notebooks scroll."""


@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_no_table_and_no_line_of_code_is_clipped(site: Path, browser: Browser, size: tuple[int, int]) -> None:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    for path in sorted(site.rglob("*.html")):
        page.goto(path.as_uri())
        assert max(page.evaluate(CLIPPED)) <= 1, path
    page.close()


@pytest.mark.parametrize(
    "path", ["gallery.html", "how-to/fly.html", "explanation/air.html", "tutorials/notebooks/1_best_topology.html"]
)
def test_dark_pages_have_no_white_boxes(site: Path, browser: Browser, path: str) -> None:
    page = browser.new_page(color_scheme="dark")
    page.goto((site / path).as_uri())
    assert white_boxes(page) == 0
    page.close()


def test_the_search_works_without_a_server(site: Path, browser: Browser) -> None:
    wrong: list[str] = []
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
    page.goto((site / "tutorials/front.html").as_uri())
    page.locator(".md-search__input").click()
    page.keyboard.type("aligned")
    page.wait_for_selector(".md-search-result__item")
    assert "Glossary" in page.locator(".md-search-result__list").inner_text()
    page.close()
    assert wrong == []
