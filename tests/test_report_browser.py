"""The page in Chromium itself: it draws without an error or a network, turns, sorts, and fits a phone and paper."""

import csv
import html
import itertools
import re
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from dark_pages import white_boxes
from nlp_cases import as_design, push, random_point
from playwright.sync_api import Browser, Page, sync_playwright
from report_cases import design, grown, toy_page
from scipy.spatial.transform import Rotation
from test_rotors import SMALL, star
from toy_problem import BACKENDS
from verify_cases import design as solved

from topo_search.compose import audit, fly
from topo_search.model import Audit, Clearance, Design, Status, Topology
from topo_search.model.files import read_json
from topo_search.report.design_page import design_page, read_simulated
from topo_search.report.page import render
from verify.air.bound import case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene

pytestmark = pytest.mark.browser

WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""3-D drawn by the processor: test machines have no graphics card."""
CAMERA = "JSON.stringify(views[0].stage.orbit)"
PICTURE = "(stage => (stage.picture(), stage.canvas.toDataURL()))(views[0].stage)"
DRAWN = "({ stage }) => stage.content.children.map(object => object.name)"
BESIDE = "document.querySelectorAll('#beside .stage canvas').length === 2"


PATIENCE_MS = 300_000
"""For a page to load: on a busy machine without a graphics card it takes its time."""


def until(page: Page, expression: str) -> None:
    """Wait until an expression is true: the page's own policy keeps Playwright from waiting inside of it."""
    end = time.monotonic() + PATIENCE_MS / 1000
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(100)


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
        until(page, "document.querySelectorAll('.plot:not(.js-plotly-plot), .stage > svg').length === 0")
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
    before, seen = page.evaluate(CAMERA), view.screenshot()
    box = view.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 150, y + 40, steps=10)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert page.evaluate(CAMERA) != before
    assert view.screenshot() != seen


def parts(page: Page) -> list[str]:
    """Return which parts are drawn in 3-D."""
    return list(page.evaluate(f"({DRAWN})(views[0])"))


def copies(page: Page, kind: str) -> list[list[float]]:
    """Return the poses of all copies of a part that are drawn, column by column."""
    return list(
        page.evaluate(
            "kind => views[0].stage.content.children.filter(object => object.name === kind).flatMap(object =>"
            " Array.from({length: object.count}, (_, k) =>"
            " [...object.instanceMatrix.array.slice(16 * k, 16 * k + 16)]))",
            kind,
        )
    )


def test_the_view_opens_on_the_platform_and_shows_what_is_chosen(opened: Open) -> None:
    made = design(Topology.from_key("af0000"), "push-two-paths")
    at = platform(made)
    page = opened(render(design_page(made, audit(made), "mine.json")))
    assert {"regions", "modules", "rotors", "spin", "joints", "tip"} <= {*parts(page)}
    assert not {"airflow", "closest", "connectors"} & {*parts(page)}
    for matrix, R, p in zip(copies(page, "modules"), at.R, at.p, strict=True):
        pose = np.array(matrix).reshape(4, 4).T
        np.testing.assert_allclose(pose[:3], np.column_stack([R, p]), atol=2e-6)
    labels = page.evaluate(POINTS_AT)

    page.click("[data-choice=case][data-number='1']")
    assert {"case", "rotors"} <= {*parts(page)}
    page.click("[data-part=airflow]")
    assert page.get_attribute("[data-part=airflow]", "aria-pressed") == "true"
    assert {"case", "airflow"} <= {*parts(page)}
    assert page.inner_text(".description").startswith("load case 1: force")
    page.click("[data-choice=platform]")
    assert "airflow" in parts(page)
    page.evaluate(PICTURE)
    assert page.evaluate(POINTS_AT) == pytest.approx(labels)  # jets of over a metre leave the platform its size
    page.click("[data-part=airflow]")
    assert "airflow" not in parts(page)

    page.click("[data-choice=assembly]")
    assert page.get_attribute("[data-choice=assembly]", "aria-pressed") == "true"
    assert page.get_attribute("[data-choice=platform]", "aria-pressed") == "false"
    assert page.inner_text(".description").startswith("Step 1 of 6: Start with module 0")
    for step in range(1, 6):
        assert len(copies(page, "modules")) == step
        assert len(copies(page, "joints")) == 2 * (step - 1)
        assert not copies(page, "tip")
        page.click("[data-step='1']")
    assert copies(page, "tip")
    page.click("[data-step='-1']")
    assert page.inner_text(".description").startswith("Step 5 of 6")


def test_rotors_have_the_colour_of_their_throttle(opened: Open) -> None:
    made = design(Topology.from_key("af0000"), "push")
    page = opened(render(design_page(made, audit(made), "mine.json")))
    page.click("[data-choice=case][data-number='1']")
    hues = page.evaluate(
        "views[0].stage.content.children.filter(object => object.name === 'rotors').map(object =>"
        " Array.from({length: object.count}, (_, k) => object.instanceColor.array[3 * k + 2]))"
    )
    throttle = made.inputs[1].T.ravel()
    blue = np.array(hues).ravel()[np.argsort(throttle)]
    assert np.all(np.diff(blue) <= 1e-6)  # the more throttle, the less blue
    assert blue[0] > blue[-1]


def test_forces_that_can_be_added_are_shown_at_the_tip(opened: Open) -> None:
    able = {"module": {"max_thrust_to_weight": 4.0}}
    made = solved(Topology.from_key("af0000"), able, hinges=(-0.5, 0.6, 0.5, -0.6), end_effector=(0.1, 0.05, 0.3))
    page = opened(render(design_page(made, audit(made), "mine.json")))
    assert "forces" not in parts(page)
    page.click("[data-choice=forces]")
    assert "forces" in parts(page)
    assert "in any direction" in page.inner_text(".description")
    page.click("[data-choice=platform]")
    assert "forces" not in parts(page)


TIP = "[...document.querySelectorAll('.view .labels text')].find(t => t.textContent === 'tip')"
POINTS_AT = f"(l => [l.getAttribute('x1'), l.getAttribute('y1')].map(Number))({TIP}.previousElementSibling)"


@pytest.mark.parametrize("tilt_deg", [15.0, 45.0])
def test_air_of_tilted_rotors_has_the_speeds_of_the_audit(opened: Open, tilt_deg: float) -> None:
    task = push(2, module={"rotors": star(tilt_deg), **SMALL}, search={"interference": "separation"})
    made = as_design(random_point(task, Topology.from_key("a10"), np.random.default_rng(1)))
    at, whole = platform(made), Scene(made, platform(made))
    points = at.end_effector + np.random.default_rng(0).normal(0.0, 0.6, (300, 3))
    page = opened(render(design_page(made, audit(made), "mine.json")))
    _, blown = next(case_jets(whole))
    in_scene = whole.tip + (points - at.end_effector) / task.module.arm_length
    shown = page.evaluate("p => p.map(x => new Air(read('view-data'), 0).at(x))", points.tolist())
    np.testing.assert_allclose(shown, speeds(blown, in_scene).sum(axis=1), rtol=1e-3, atol=1e-3)


def test_air_has_the_speeds_of_the_audit_and_the_platform_keeps_its_size(opened: Open) -> None:
    made = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    at, whole = platform(made), Scene(made, platform(made))
    points = at.end_effector + np.random.default_rng(0).normal(0.0, (0.3, 0.3, 0.6), (300, 3))
    cases = list(case_jets(whole))
    page = opened(render(design_page(made, audit(made), "mine.json")))
    for k, (_, blown) in enumerate(cases):
        in_scene = whole.tip + (points - at.end_effector) / made.task.module.arm_length
        shown = page.evaluate(f"p => p.map(x => new Air(read('view-data'), {k}).at(x))", points.tolist())
        np.testing.assert_allclose(shown, speeds(blown, in_scene).sum(axis=1), rtol=1e-3, atol=1e-3)

    page.click("[data-choice=case][data-number='1']")
    page.evaluate(PICTURE)
    before = page.evaluate(POINTS_AT)
    page.select_option("[data-air=speed]", "1")
    page.select_option("[data-air=across]", "y")
    assert {"air", "slice"} <= {*parts(page)}
    speeds_there = page.evaluate(
        "(air => { const at = views[0].stage.content.getObjectByName('air').geometry.attributes.position;"
        " return Array.from({length: at.count}, (_, i) => air.at([at.getX(i), at.getY(i), at.getZ(i)])); })"
        "(new Air(read('view-data'), 1))"
    )
    assert len(speeds_there) > 1000
    assert np.quantile(speeds_there, [0.05, 0.95]) == pytest.approx(1.0, abs=0.15)
    page.evaluate(PICTURE)
    assert page.evaluate(POINTS_AT) == pytest.approx(before, abs=0.5)
    assert page.locator("output:visible").inner_text().endswith(", through the tip")
    slider = page.locator("[data-air=at]")
    middle = float(slider.input_value())
    slider.press("ArrowRight")
    corners = "[...views[0].stage.content.getObjectByName('slice').geometry.attributes.position.array]"
    at_y = {round(y, 5) for y in page.evaluate(corners)[1::3]}
    assert at_y == {round(float(slider.input_value()), 5)} != {round(middle, 5)}
    page.click("[data-choice=platform]")
    assert not {"air", "slice"} & {*parts(page)}


def test_labels_do_not_lie_over_each_other(opened: Open, five: str) -> None:
    page = opened(five)
    labels = page.locator(".view .labels text")
    assert labels.all_text_contents() == [*"01234", "tip", "centre of mass", *"xyz", "squares of 0.2 m"]
    boxes = page.evaluate(
        "[...document.querySelectorAll('.view .labels text')].map(t => t.getBoundingClientRect().toJSON())"
    )
    for one, other in itertools.combinations(boxes, 2):
        across = min(one["right"], other["right"]) - max(one["left"], other["left"])
        down = min(one["bottom"], other["bottom"]) - max(one["top"], other["top"])
        assert across <= 1 or down <= 1


def test_the_pointer_on_a_module_shows_its_numbers(opened: Open, five: str) -> None:
    page = opened(five)
    view = page.locator("#view")
    view.scroll_into_view_if_needed()
    box = view.bounding_box()
    lines = page.locator(".view .labels line")
    x, y = (float(lines.nth(1).get_attribute(name) or 0) for name in ("x1", "y1"))
    told = page.locator(".view .hover:visible")
    end = time.monotonic() + PATIENCE_MS / 1000
    while not told.count():
        assert time.monotonic() < end
        for aside in (0, 3, -3):
            page.mouse.move(box["x"] + x + aside, box["y"] + y + aside)
            page.wait_for_timeout(100)
    text = " ".join(told.all_text_contents())
    assert re.search(r"module \d", text)
    assert "throttle" in text


def test_keys_turn_the_view(opened: Open, five: str) -> None:
    page = opened(five)
    page.focus("#view")
    for key in ("ArrowLeft", "ArrowUp", "+"):
        before = page.evaluate(CAMERA)
        page.keyboard.press(key)
        assert page.evaluate(CAMERA) != before


def test_the_page_is_dark_where_the_reader_wants_it(opened: Open, five: str) -> None:
    page = opened(five)
    ink = "document.getElementById('inputs').layout.font.color"
    ground = "getComputedStyle(document.body).backgroundColor"
    assert (page.evaluate(ink), page.evaluate(ground)) == ("#222222", "rgb(255, 255, 255)")
    page.emulate_media(color_scheme="dark")
    until(page, f"{ink} === '#e8eaed'")
    assert page.evaluate(ground) == "rgb(22, 25, 30)"
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert white_boxes(page) == 0
    page.click("#theme")
    assert white_boxes(page) > 0
    assert (page.evaluate(ink), page.evaluate(ground)) == ("#222222", "rgb(255, 255, 255)")
    page.click("#theme")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(ink) == "#222222"


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
    numbers = page.locator("#ranking th button", has_text="J over bound")
    for up in (True, False):
        numbers.click()
        found = column(page, "J over bound")
        values = [float(text) for text in found if text]
        assert values == sorted(values, reverse=not up)
        assert all(found[: len(values)])  # what has no number comes last, whichever way
    page.fill("#words", ranked[3])
    assert column(page, "tree") == [ranked[3]]
    page.fill("#words", "")
    page.select_option("#status", "infeasible")
    assert column(page, "tree") == ["a3010"]
    assert column(page, "status") == ["infeasible"]


def test_a_row_shows_its_design_beside_the_best(opened: Open, tmp_path: Path) -> None:
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4))
    ranked = column(page, "tree")
    openers = page.locator("#ranking tbody button")
    assert openers.all_inner_texts() == ranked[:10]
    assert page.locator("#beside").is_hidden()

    page.locator("#ranking tbody tr").nth(3).locator("td").nth(2).click()
    assert page.inner_text("#beside h3") == f"{ranked[3]} compared with the best, {ranked[0]}"
    assert page.locator("#ranking tr[aria-current]").inner_text().startswith(ranked[3])
    trees = page.locator("#beside .tree svg")
    assert [trees.nth(i).get_attribute("aria-label") for i in range(2)] == [
        f"tree of the 4 modules, {key}" for key in (ranked[0], ranked[3])
    ]
    until(page, BESIDE)

    page.locator("#beside [data-part=airflow]").first.click()  # both show the same
    for button in page.locator("#beside [data-part=airflow]").all():
        assert button.get_attribute("aria-pressed") == "true"
    page.locator("#beside [data-choice=case]").last.click()
    drawn = page.evaluate(f"comparison.views.map({DRAWN})")
    assert all({"case", "airflow"} <= {*names} for names in drawn)
    page.locator("#beside .stage").last.press("ArrowLeft")
    one, other = page.evaluate("comparison.views.map(({ stage }) => stage.orbit.across)")
    assert one == other != page.evaluate("comparison.views[0].stage.first.across")

    page.click("#beside [data-move='1']")
    assert page.inner_text("#beside h3").startswith(ranked[4])
    page.click("#beside [data-close]")
    assert page.locator("#beside").is_hidden()
    assert page.locator("#ranking tr[aria-current]").count() == 0

    openers.nth(0).focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert page.inner_text("#beside h3").startswith(ranked[1])
    page.locator("#ranking tbody tr").nth(12).click()  # of which the page has no design
    assert page.inner_text("#beside h3").startswith(ranked[1])


def test_two_designs_of_any_rank_are_compared_and_the_address_links_to_them(opened: Open, tmp_path: Path) -> None:
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4))
    ranked = column(page, "tree")
    page.locator("#ranking tbody button").nth(3).click()
    page.select_option("[data-against]", ranked[2])
    assert page.inner_text("#beside h3") == f"{ranked[3]} compared with {ranked[2]}"
    figures = page.evaluate(
        "[...document.querySelectorAll('#beside .cards > div')].map(card => Object.fromEntries("
        "[...card.querySelectorAll('dd strong')].map(strong => [strong.closest('dd').previousSibling.textContent,"
        " [strong.textContent, strong.classList.contains('differs')]])))"
    )
    for name in figures[0].keys() & figures[1].keys():
        (one, marked), (other, marked_too) = figures[0][name], figures[1][name]
        assert marked == marked_too == (one != other), name

    link = page.url
    assert link.endswith(f"#design={ranked[3]},{ranked[2]}")
    page.keyboard.press("Escape")
    assert page.locator("#beside").is_hidden()
    assert "design=" not in page.url
    page.goto("about:blank")
    page.goto(link)
    until(page, BESIDE)
    assert page.inner_text("#beside h3") == f"{ranked[3]} compared with {ranked[2]}"


def test_the_plot_shows_the_audited_designs_that_the_filters_leave(opened: Open, tmp_path: Path) -> None:
    def audit_pair(made: Design) -> Audit:
        mm = sum(map(ord, made.topology.key)) % 7
        bounds = {"lower_m": mm / 1000, "analytic_m": mm / 1000, "upper_m": mm / 1000}
        pair = Clearance(kind="airflow", a=0, b=1, status=Status.CLEAR, level=0, **bounds)
        return BACKENDS.audit(made).model_copy(update={"pairs": (pair,)})

    backends = replace(BACKENDS, audit=audit_pair)
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4, backends=backends))
    points = "document.getElementById('choice').data.flatMap(trace => trace.customdata ?? [])"
    audited = [key for key, audit in zip(column(page, "tree"), column(page, "audit"), strict=True) if audit]
    assert audited
    assert sorted(page.evaluate(points)) == sorted(audited)

    page.select_option("#up", "J [rad⁴/s⁴]")
    page.select_option("#across", "clearance [mm]")
    front = page.evaluate(
        "(({ x, y }) => x.map((_, i) => [x[i], y[i]]))(document.getElementById('choice').data[0])"
    )
    clear = [
        (float(J), float(mm))
        for J, mm, audit in zip(
            *(column(page, name) for name in ("J [rad⁴/s⁴]", "clearance [mm]", "audit")), strict=True
        )
        if audit.startswith("clear")
    ]
    better = [(J, mm) for J, mm in clear if not any(a <= J and b >= mm and (a, b) != (J, mm) for a, b in clear)]
    assert sorted(mm for mm, _ in front) == pytest.approx(sorted({mm for _, mm in better}))

    page.fill("#words", audited[1])
    assert page.evaluate(points) == [audited[1]]
    clicked = (
        f"document.getElementById('choice').emit('plotly_click', {{points: [{{customdata: '{audited[1]}'}}]}})"
    )
    page.evaluate(clicked)
    assert page.inner_text("#beside h3").startswith(audited[1])


def test_a_page_is_as_tall_as_can_be_read(opened: Open, tmp_path: Path) -> None:
    page = opened(toy_page(tmp_path / "run", modules=5, starts=4), width=1440)
    assert page.evaluate("document.documentElement.scrollHeight") <= 4500
    assert page.locator("#ranking tbody tr").count() == 15
    page.click("#more")
    assert page.locator("#ranking tbody tr").count() > 15


def test_the_ranking_fits_and_shows_more_columns_on_demand(opened: Open, tmp_path: Path) -> None:
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4), width=1440)
    beyond = "(shown => shown.scrollWidth - shown.clientWidth)(document.getElementById('ranking').parentElement)"
    assert page.evaluate(beyond) <= 0
    for width in (1440, 390):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.get_by_role("columnheader", name="hits").is_hidden()
        page.check("#every")
        assert page.get_by_role("columnheader", name="hits").is_visible()
        page.uncheck("#every")


def test_a_page_without_a_design_says_what_to_relax(opened, tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    page = opened(toy_page(tmp_path / "run", modules=(3, 5), starts=4), width=1280)
    assert "no single limit" in page.inner_text("header")
    assert page.evaluate("document.documentElement.scrollHeight") <= 2500  # most of it is folded
    assert page.evaluate(f"views.map({DRAWN})")[0]  # the nearest miss
    assert page.locator("#reasons table").first.is_hidden()
    page.click("nav a[href='#reasons']")
    assert "none found" in page.inner_text("#reasons")
    page.evaluate("document.querySelectorAll('details').forEach((details) => (details.open = true))")
    violations = Axe().run(page).response["violations"]
    assert [one["id"] for one in violations] == []


def test_on_a_phone_nothing_runs_off_the_screen(opened: Open, five: str, tmp_path: Path) -> None:
    page = opened(five, width=360)
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    text = "section :is(td, th, p, li, dd, dt, h2, h3, caption, figcaption, label, button)"
    beyond = f"[...document.querySelectorAll('{text}')].filter(e => e.offsetParent && e.innerText.trim() && " + (
        "getComputedStyle(e.closest('thead') ?? e).position !== 'absolute' && "
        "e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert page.evaluate(beyond) == []


@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (360, "dark")])
def test_everybody_can_read_the_page(opened, tmp_path, monkeypatch, width, scheme):
    """By axe-core: contrast, names of what can be seen or pressed, order of headings, reach by keys."""
    monkeypatch.setenv("TOY_NONE", "a3010")
    page = opened(toy_page(tmp_path / "run", modules=4, starts=4), width=width)
    page.emulate_media(color_scheme=scheme)
    page.locator("#ranking tbody button").nth(2).click()
    until(page, BESIDE)
    violations = Axe().run(page).response["violations"]
    assert [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in violations] == []
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_a_hundred_modules_are_a_few_meshes(opened: Open) -> None:
    made = design(grown(100), "push-two-paths")
    page = opened(render(design_page(made, audit(made), "mine.json")))
    assert len(parts(page)) <= 30
    assert len(copies(page, "modules")) == 100
    before = page.evaluate(PICTURE)
    page.locator("#view").press("ArrowLeft")
    assert page.evaluate(PICTURE) != before


def test_on_paper_there_are_no_controls(opened: Open, five: str) -> None:
    page = opened(five)
    page.emulate_media(media="print")
    assert page.locator("#view canvas").is_visible()
    assert not page.locator("nav").is_visible()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details").count() == page.locator("details[open]").count() > 0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("details[open]").count() == 0
    assert page.locator("img.still").count() == 0
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    still = page.locator("img.still").evaluate("i => i.decode().then(() => [i.naturalWidth, i.src.length])")
    assert still[0] > 100
    assert still[1] > 10_000  # paper would show an empty canvas
    page.set_viewport_size({"width": 700, "height": 900})  # paper is narrow, and no phone
    assert page.locator("table.stacked thead").first.is_visible()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))) <= 12


def test_without_webgl_the_rest_of_the_page_works(launched, tmp_path, five):
    path = tmp_path / "page.html"
    path.write_text(five, encoding="utf-8")
    with launched("--disable-gpu", "--disable-3d-apis") as browser:
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(path.as_uri())
        until(page, "document.querySelectorAll('.plot:not(.js-plotly-plot)').length === 0")
        page.evaluate("for (const part of document.querySelectorAll('details')) part.open = true")
        page.wait_for_selector("#inputs .main-svg")
        assert "WebGL" in page.locator("#view").inner_text()
        assert page.locator("#view svg").is_visible()


@pytest.fixture(scope="module")
def cell() -> str:
    """A view with two flights, as a cell of a notebook holds it."""
    made = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    return fly(made, only=("return from +x", "load case 0 (push), wall"), wake=False).view()._repr_html_()


CELLS = "[...document.querySelectorAll('iframe')].map(cell => cell.contentDocument)"
AWAKE = f"{CELLS}.map(cell => cell.querySelectorAll('canvas').length)"


def test_twenty_cells_of_a_notebook_draw_while_they_are_looked_at(opened: Open, cell: str) -> None:
    page = opened(f"<!doctype html><body data-jp-theme-light=true>{cell * 20}", width=900)
    lost: list[str] = []
    page.on("console", lambda message: lost.append(message.text) if "context" in message.text.lower() else None)
    for number in range(20):
        page.evaluate(f"document.querySelectorAll('iframe')[{number}].scrollIntoView()")
        until(page, f"{AWAKE}[{number}] === 1")
        page.wait_for_timeout(200)
        assert sum(page.evaluate(AWAKE)) <= 4
    seen = "cell => cell.querySelector('.stage > img.still')?.naturalWidth > 100"
    until(page, f"{CELLS}.slice(0, 15).every({seen})")  # what was looked at before stays as a picture
    assert lost == []

    first = page.frames[1]
    page.evaluate("document.querySelector('iframe').scrollIntoView()")
    until(page, f"{AWAKE}[0] === 1")
    first.click("[data-choice=assembly]")
    first.press(".stage", "ArrowLeft")
    turned = first.evaluate("JSON.stringify(shown.stage.orbit)")
    page.evaluate("document.querySelectorAll('iframe')[19].scrollIntoView()")
    until(page, f"{AWAKE}[0] === 0")
    page.evaluate("document.querySelector('iframe').scrollIntoView()")
    until(page, f"{AWAKE}[0] === 1")
    assert first.evaluate("JSON.stringify(shown.stage.orbit)") == turned
    assert first.inner_text(".description").startswith("Step 1 of")
    bottom, height = "document.documentElement.offsetHeight", "frameElement.offsetHeight"
    assert first.evaluate(bottom) == pytest.approx(first.evaluate(height), abs=1)

    theme = "document.documentElement.dataset.theme"
    assert first.evaluate(theme) == "light"
    page.evaluate("document.body.dataset.jpThemeLight = 'false'")
    assert first.evaluate(theme) == "dark"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everybody_can_read_a_cell(opened: Open, cell: str, scheme: str) -> None:
    text = re.findall('srcdoc="([^"]+)"', cell)[0]
    page = opened(html.unescape(text), width=700)
    page.emulate_media(color_scheme=scheme)
    page.select_option("[data-flights]", "1")
    violations = Axe().run(page, options={"rules": {"page-has-heading-one": {"enabled": False}}}).response
    assert [one["id"] for one in violations["violations"] if one["id"] not in ("landmark-one-main", "region")] == []
    assert page.evaluate("document.documentElement.scrollWidth") == 700


def test_a_flight_is_played_as_it_was_recorded(opened: Open, tmp_path: Path) -> None:
    made = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    fly(made, only=("return from +x",), wake=False, out=tmp_path / "flight")
    page = opened(render(design_page(made, audit(made), "mine.json", read_simulated(tmp_path / "flight", made))))
    rows = csv.DictReader((tmp_path / "flight/flight.csv").read_text().splitlines())
    row = next(row for row in rows if row["time_s"] == "0.48")
    early = "(frame => (step) => frame((now) => step(now - 10_000)))(requestAnimationFrame)"
    page.evaluate(f"void (window.requestAnimationFrame = {early})")  # a frame may begin before the click on Play
    page.select_option("[data-flights]", "0")
    until(page, "views[0].time > 0")
    page.click("[data-play]")
    page.evaluate("views[0].seek(0.48)")
    poses = page.evaluate(
        "(object => Array.from({length: object.count}, (_, k) => [...object.matrix.clone().multiply("
        "new THREE.Matrix4().fromArray(object.instanceMatrix.array, 16 * k)).elements]))"
        "(views[0].stage.content.getObjectByName('modules'))"
    )
    at, turn = platform(made), np.array([float(row[f"q_{axis}"]) for axis in "wxyz"])
    turned = Rotation.from_quat(turn, scalar_first=True).as_matrix()
    shift = np.array([float(row[f"{axis}_m"]) for axis in "xyz"])
    for pose, R, p in zip(poses, at.R, at.p, strict=True):
        shown = np.array(pose).reshape(4, 4).T
        np.testing.assert_allclose(shown[:3, :3], turned @ R, atol=2e-4)
        np.testing.assert_allclose(shown[:3, 3], turned @ (p - at.p_com) + at.p_com + shift, atol=2e-4)
    assert page.inner_text(".readout").startswith("0.48 s: ")
    page.locator("[data-time]").press("ArrowRight")
    assert page.evaluate("views[0].time") != 0.48
    last = page.evaluate("(rows => (views[0].seek(rows.at(-1)[0]), rows.at(-1)))(views[0].value.flights[0].rows)")
    assert page.inner_text(".readout").startswith(f"{last[0]:.2f} s: {last[7]:.1f} cm off, {last[8]:.1f}° tilted")
    page.click("[data-choice=platform]")
    assert page.locator("[data-time]").is_hidden()


def test_without_webgl_a_cell_has_a_picture(launched: Callable[..., Browser], cell: str, tmp_path: Path) -> None:
    (tmp_path / "cell.html").write_text(cell, encoding="utf-8")
    with launched("--disable-gpu", "--disable-3d-apis") as browser:
        page = browser.new_page()
        page.goto((tmp_path / "cell.html").as_uri())
        until(page, f"!!{CELLS}[0].querySelector('.description').textContent")
        assert page.frames[1].locator("#cell svg").is_visible()
        assert "WebGL" in page.frames[1].inner_text("#cell")
