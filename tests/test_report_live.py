"""The live page: served while a run goes on, to this machine alone, and gone with it."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

import pytest
from processes import eventually

from topo_search import read_task, search
from topo_search.report import live
from topo_search.study import SilentObserver

ADDRESS = re.compile(r"live page: (http://127\.0\.0\.1:\d+/)")
HOVER = "load_cases=[{com={force=[0.0,0.0,1.0]}}]"


def fetch(address: str) -> str:
    with urlopen(address, timeout=60) as answer:
        return answer.read().decode()


class Browser(SilentObserver):
    """Asks for the progress after every step, and for the page after the first and after audits."""

    def __init__(self) -> None:
        self.address = ""
        self.seen: list[dict[str, str | int]] = []
        self.pages: list[str] = []

    def note(self, text: str) -> None:
        if match := ADDRESS.fullmatch(text):
            self.address = match[1]

    def settled(self, incumbent: object, *, known: bool = False) -> None:
        self.seen.append(json.loads(fetch(f"{self.address}status")))
        if not self.pages or "auditing" in str(self.seen[-1]["words"]):
            self.pages.append(fetch(f"{self.address}page"))


@pytest.fixture
def eager(monkeypatch):
    """Pages as new as can be."""
    monkeypatch.setattr(live.Live, "refresh_s", 0.0)
    monkeypatch.setattr(live.Live, "largest_share", 1e9)


def test_a_search_is_seen_from_its_first_step_to_its_audits_and_no_longer(in_process, eager, tmp_path):
    browser = Browser()
    answer = search(
        read_task("push", ("modules=2", HOVER)), out=tmp_path / "run", starts=1, live=True, observer=browser
    )
    assert [one["version"] for one in browser.seen] == sorted({one["version"] for one in browser.seen})
    assert all("left" in str(one["words"]) for one in browser.seen)
    assert "auditing 2 modules" in str(browser.seen[-1]["words"])
    assert answer.best.key in browser.pages[-1]
    assert "No design has been found yet." in browser.pages[0] or answer.best.key in browser.pages[0]
    with pytest.raises(URLError):
        fetch(browser.address)


def test_only_this_machine_by_its_own_name_is_answered(tmp_path):
    browser = Browser()
    with live.serve_live(tmp_path / "none", browser):
        assert "<iframe" in fetch(browser.address)
        assert "No page yet" in fetch(f"{browser.address}page")
        assert json.loads(fetch(f"{browser.address}status"))["version"] == 0
        with pytest.raises(HTTPError, match="421"):
            urlopen(Request(browser.address, headers={"Host": "evil.example"}), timeout=60)
        with pytest.raises(HTTPError, match="404"):
            fetch(f"{browser.address}../etc/passwd")
        port = int(browser.address.rsplit(":", 1)[1].strip("/"))
        for address in ("127.0.0.2", "::1"):
            with pytest.raises(OSError):  # noqa: PT011 (refused or unreachable, as the system has it)
                http.client.HTTPConnection(address, port, timeout=5).request("GET", "/")
        with live.serve_live(tmp_path / "none", second := Browser()):
            assert second.address != browser.address


def test_the_command_serves_while_it_runs_and_ends_on_ctrl_c(tmp_path: Path):
    log = tmp_path / "log"
    command = [sys.executable, "-m", "topo_search", "run", "push", "--modules", "4", "--starts", "500", "--live"]
    with log.open("w") as stream:
        run = subprocess.Popen(
            [*command, "--workers", "1", "--out", str(tmp_path / "run")], stderr=stream, start_new_session=True
        )
    try:
        eventually(lambda: ADDRESS.search(log.read_text()))
        address = ADDRESS.search(log.read_text())
        assert "words" in json.loads(fetch(f"{address[1]}status"))
        os.killpg(run.pid, signal.SIGINT)
        assert run.wait(timeout=120) == 130
    finally:
        run.kill()
    with pytest.raises(URLError):
        fetch(address[1])
