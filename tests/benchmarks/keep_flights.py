"""Update the flights that the documentation shows.

    MUJOCO_GL=egl python tests/benchmarks/keep_flights.py

The designs are in `tests/designs`: the winner of push, the winner of wall-push without its reserves, and in
`flying` the winners of three flying examples (`topo-search run NAME`). They are flown as by `topo-search fly DESIGN
--rotor-out`. Results go to `notebooks/results/flight-NAME.json`; plots of the FILMED ones to
`notebooks/pictures/flight-NAME.png`, stills to `flight-stills.png`, and the flights on the page of wall-push to
`flight-page.png` in the same folder. Needs Chromium and EGL.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from topo_search import compose
from topo_search.model import Design
from topo_search.model.files import read_json, to_json, write_atomically
from topo_search.simulation import files
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import EVERY, Options, Watch
from topo_search.simulation.plant import STEP
from topo_search.simulation.scenarios import Scenario

ROOT = Path(__file__).parents[2]
DESIGNS = ROOT / "tests/designs"
PICTURES, RESULTS = ROOT / "notebooks/pictures", ROOT / "notebooks/results"
NAMES = (
    "push-a70010",
    "wall-push-without-reserves",
    "flying/wall-push",
    "flying/window-cleaning",
    "flying/survives-a-rotor",
)
FILMED = {"push-a70010": "the winner of push", "wall-push": "wall-push"}
STILLS = (0.0, 0.8, 1.6, 2.4, 3.2)
"""Times of the stills in the return from +x [s]."""
WIDTH = 1000
"""Width of the page [pixels]."""


def main() -> None:
    """Fly all designs, and write results and pictures."""
    films, campaigns = {}, {}
    for path in NAMES:
        design, name = read_json(Design, DESIGNS / f"{path}.json"), Path(path).name
        film = films.setdefault(name, files.Film(files.radius(design))) if name in FILMED else None

        def watch(scenario: Scenario, film: files.Film | None = film) -> Watch | None:
            return film.watch(scenario.name) if film is not None and scenario.name == "return from +x" else None

        campaign = campaigns[name] = fly_all(design, Options(), rotor_out=True, watch=watch)
        write_atomically(RESULTS / f"flight-{name}.json", to_json(campaign.result))
        if film is not None:
            write_atomically(PICTURES / f"flight-{name}.png", files.plot(campaign.flown, campaign.result))
    write_atomically(PICTURES / "flight-stills.png", _stills(films))
    with TemporaryDirectory() as folder:
        files.write_flight(campaigns["wall-push"], Path(folder))
        page = compose.write_report(
            DESIGNS / "flying/wall-push.json", out=Path(folder) / "page.html", flight=folder
        )
        write_atomically(PICTURES / "flight-page.png", _section(page))


def _stills(films: dict[str, files.Film]) -> bytes:
    """Return a picture (PNG) with a row of stills for each film."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 1.9 * len(films)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(films), len(STILLS), squeeze=False)
    for row, (name, film) in zip(axes, films.items(), strict=True):
        for axis, t in zip(row, STILLS, strict=True):
            frame = film.frames[round(t / (files.FRAMES_EVERY * EVERY * STEP))]
            axis.imshow(Image.open(io.BytesIO(frame)).convert("RGB"))
            axis.set_title(f"{t:g} s", fontsize=8)
            axis.set(xticks=[], yticks=[])
        row[0].set_ylabel(FILMED[name], fontsize=9)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110, metadata={"Software": None})
    return content.getvalue()


def _section(page: Path) -> bytes:
    """Return a picture (PNG) of the section with the flights on a page."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": WIDTH, "height": 900}, color_scheme="light")
        view.goto(page.as_uri())
        section = view.locator("#simulated")
        section.scroll_into_view_if_needed()
        section.locator(".js-plotly-plot").first.wait_for()
        content: bytes = section.screenshot(style="nav { visibility: hidden }")  # the navigation sticks to the top
        browser.close()
    return content


if __name__ == "__main__":
    main()
