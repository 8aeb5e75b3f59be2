"""The live page of a run in progress, served only to browsers on this machine."""

import json
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

from topo_search.model import BadInput
from topo_search.report.page import render
from topo_search.report.progress import Follower, describe, stage
from topo_search.report.run_page import run_page
from topo_search.study import Observer, Phase, Plan, Row, RunFolder

LOOPBACK = "127.0.0.1"
"""Address of the server; other machines cannot reach it."""


class Live(Follower):
    """An observer that forwards progress to another observer, and renders the page of the run so far."""

    refresh_s = 5.0
    """Smallest time between two renderings of the page [s]."""
    largest_share = 0.1
    """Largest share of the time spent on rendering."""

    def __init__(self, path: Path, observer: Observer) -> None:
        """Observe the run in the folder `path`; `observer` receives all progress too."""
        super().__init__()
        self._path, self._observer, self._version = path, observer, 0
        self._page, self._due_s = "", 0.0
        self._rendering = threading.Lock()

    def plan(self, plan: Plan) -> None:
        """Set the plan."""
        super().plan(plan)
        self._observer.plan(plan)

    def phase(self, phase: Phase) -> None:
        """Begin a stage."""
        super().phase(phase)
        self._version += 1
        self._observer.phase(phase)

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        """Count a step."""
        super().settled(incumbent, known=known)
        self._version += 1
        self._observer.settled(incumbent, known=known)

    def note(self, text: str) -> None:
        """Forward a note."""
        self._observer.note(text)

    @property
    def status(self) -> dict[str, str | int]:
        """Progress in words, and a version number that grows with it."""
        if self._phase is None:
            return {"words": "The run is starting.", "version": 0}
        steps = "" if self._phase.is_serial else f"{self._steps_done} of {self._phase.steps}, "
        words = f"{stage(self._phase)}: {steps}{describe(self._incumbent)}, {self.time_left}"
        return {"words": words, "version": self._version}

    def page(self) -> str:
        """Return the page of the run, rendered again if it is old enough."""
        with self._rendering:
            start = time.monotonic()
            if start >= self._due_s:
                self._page = self._render()
                now = time.monotonic()
                self._due_s = now + max(self.refresh_s, (now - start) / self.largest_share)
            return self._page

    def _render(self) -> str:
        try:
            with RunFolder.load(self._path) as folder:
                page = run_page(folder)
            return render(
                page
                if page["key"] is not None
                else {**page, "answer": "No design has been found yet.", "sizes": ()}
            )
        except (BadInput, OSError, sqlite3.Error) as error:  # the folder is incomplete or deleted
            why = type(error).__name__
            return f"<!DOCTYPE html><html lang='en'><title>No page yet</title><p>No page yet: {why}."


@contextmanager
def serve_live(path: Path, observer: Observer) -> Iterator[Observer]:
    """Serve the page of a run on a free local port during the block, and note its address."""
    live = Live(path, observer)
    with ThreadingHTTPServer((LOOPBACK, 0), partial(_Handler, live)) as server:
        threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True).start()
        try:
            observer.note(f"live page: http://{LOOPBACK}:{server.server_port}/")
            yield live
        finally:
            server.shutdown()


class _Handler(BaseHTTPRequestHandler):
    """Request handler that answers only requests addressed to this machine."""

    def __init__(self, live: Live, *args: Any) -> None:
        self._live = live
        super().__init__(*args)

    def do_GET(self) -> None:
        """Send the frame page, the page inside it, or the progress."""
        _, port = self.connection.getsockname()
        # a page of another site may send a request to this address
        if self.headers.get("Host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
        elif self.path == "/":
            frame = resources.files("topo_search.report") / "templates/live.html"
            self._send("text/html", frame.read_text(encoding="utf-8"))
        elif self.path == "/page":
            self._send("text/html", self._live.page())
        elif self.path == "/status":
            self._send("application/json", json.dumps(self._live.status))
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send(self, kind: str, text: str) -> None:
        content = text.encode()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Frame-Options", "SAMEORIGIN")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing, so that the terminal stays free for the run."""
