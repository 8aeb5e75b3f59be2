"""The site as it is built: it opens from the disk, fetches nothing, and its search finds what the pages say."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documented import ROOT
from playwright.sync_api import sync_playwright

pytestmark = pytest.mark.browser
PATIENCE_MS = 120_000


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", "docs/mkdocs.yml"]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([*command, "--site-dir", str(out)], cwd=ROOT, check=True, env=environment)
    return out


def test_the_search_works_without_a_server(site: Path) -> None:
    found = shutil.which("chromium") or shutil.which("google-chrome")
    assert found, "these tests need Chromium: apt-get install chromium"
    wrong: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
        page.goto((site / "tutorials/front.html").as_uri())
        page.locator(".md-search__input").click()
        page.keyboard.type("untangling")
        page.wait_for_selector(".md-search-result__item")
        assert "Glossary" in page.locator(".md-search-result__list").inner_text()
        browser.close()
    assert wrong == []
