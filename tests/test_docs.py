"""What README and documentation show is true: files are read, code runs, commands, fields and paths exist."""

import doctest
import json
import math
import os
import re
import runpy
import shlex
import subprocess
import sys
import time
import tomllib
from importlib import import_module
from pathlib import Path

import matplotlib
import pytest
import toy_problem
from commands import invoke
from documented import PAGES, ROOT, TEXT, blocks, same
from toy_problem import BACKENDS, InProcess

import topo_search
from topo_search import compose, search
from topo_search.compose import binding, searching
from topo_search.export import formats
from topo_search.model import Task
from topo_search.model.files import to_toml
from topo_search.model.flying import FLYING
from topo_search.model.task_file import read_task
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import Options

CORE_PATH = (
    *("tutorials/first-search.md", "tutorials/own-module.md", "how-to/load-cases.md"),
    *("how-to/exposure.md", "how-to/infeasible.md", "tutorials/design-to-flight.md"),
)
"""Pages from a fresh clone to a flight of one's own platform."""


def test_the_first_task_is_the_shipped_one_and_the_exposures_are_read():
    (first, own), (exposures, mesh, air, contact, wall), (goals,), (tolerances,) = (
        [tomllib.loads(block) for block in blocks("toml", page)]
        for page in ("tutorials/first-search.md", "how-to/exposure.md", "how-to/goals.md", "explanation/audit.md")
    )
    assert Task.model_validate(first) == read_task("push")
    assert Task.model_validate(own).flight.asks
    task = Task.model_validate({**first, **exposures, **goals})
    assert [requirement.kind for requirement in task.exposure] == ["local", "directional", "exterior", "allowed"]
    assert Task.model_validate({**first, **tolerances}).tolerances.position == 0.5e-3
    assert task.goals.names == (
        *("clearance", "stand_off", "peak_input"),
        *("force_reserve", "rotor_out", "joint_moment", "hinge_angle_deg", "speed"),
    )
    assert mesh["exposure"][0].keys() == {"kind", "mesh", "scale", "offset"}
    (solid,) = Task.model_validate({**first, **wall}).exposure
    assert solid.solid
    (pushed,) = Task.model_validate({**first, **contact}).resolve(5).exposure
    assert pushed.solid
    assert not pushed.geometry
    assert [one.speed for one in Task.model_validate({**first, **air}).exposure] == [1.0, 2.0]


def test_the_tasks_of_other_pages_are_read():
    first, _ = map(tomllib.loads, blocks("toml", "../../README.md"))
    assert Task.model_validate(first) == read_task("push")
    (bridge,) = (Task.model_validate(tomllib.loads(block)) for block in blocks("toml", "how-to/bridge.md"))
    assert bridge.exposure[0].solid
    assert bridge.end_effector.stand_off == 0.4
    sets, axis, reserves = map(tomllib.loads, blocks("toml", "how-to/load-cases.md"))
    task = Task.model_validate({**sets, **axis, **reserves}).resolve(4)
    assert task.flight.force_reserve == pytest.approx(0.25 * task.force_unit(4))
    stated = {path: reserves[table][field] for path in FLYING for table, field in [path.split(".")]}
    assert stated == {**FLYING, "flight.angular_acceleration": [11, 11, 11]}
    press, screw, hover = task.load_cases
    assert [len(case.corners) for case in (press, screw, hover)] == [9, 2, 0]
    assert math.hypot(*press.corners[1].at_end_effector.force) == pytest.approx(2.69, abs=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "number"), [("../../README.md", 1), ("tutorials/first-search.md", 1), ("how-to/bridge.md", 0)]
)
def test_the_tasks_of_pages_that_hover_fly_as_printed(page, number, tmp_path, in_process):
    task = Task.model_validate(tomllib.loads(blocks("toml", page)[number]))
    answer = search(task, out=tmp_path / "run", starts=4)
    assert answer.exit_status == 0
    assert not answer.fragile
    assert fly_all(answer.design, Options()).result.outcome == "recovered"


def test_the_geometry_without_inputs_is_audited_as_shown(tmp_path, monkeypatch):
    (tmp_path / "mine.json").write_text(*blocks("json", "how-to/reading-an-audit.md"))
    monkeypatch.chdir(tmp_path)
    (text,) = blocks("console", "how-to/reading-an-audit.md")
    command, *shown, rest = text.splitlines()
    assert rest == "..."
    assert all(map(same, shown, invoke(*shlex.split(command.removeprefix("$ topo-search "))).stdout.splitlines()))


def test_the_recipes_of_the_command_line_run(tmp_path, monkeypatch):
    """As a shell reads them, with designs that are made up."""
    log, command = tmp_path / "log", tmp_path / "topo-search"
    tell = "import json, sys; print(json.dumps(sys.argv[1:]))"
    command.write_text(f"#!/bin/sh\n{sys.executable} -Ssc '{tell}' \"$@\" >>{log}\n")
    command.chmod(0o755)
    script = "\n".join(blocks("sh", "how-to/recipes.md"))
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["bash", "-euc", script], cwd=tmp_path, env={**os.environ, "PATH": path}, check=True)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(binding, "backends", lambda _: BACKENDS)
    monkeypatch.setattr(binding, "open_engine", lambda *_: InProcess(1))
    monkeypatch.setattr(searching, "write_page", lambda _: None)
    called = list(map(json.loads, log.read_text().splitlines()))
    assert [words[0] for words in called] == ["run", "run", "run", "compare", "topologies", "run", "run"]
    for words in called:
        fewer = ["--modules", "3"] if "wall-push" in words else []
        done = invoke(*words, *fewer)
        if words[0] == "topologies":
            Path("some.txt").write_text(done.stdout)
    assert len(Path("some/candidates.csv").read_text().splitlines()) == 1 + 50


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Runs a script in an empty folder, and returns what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compose.binding, "Workers", InProcess)

    def run(code):
        Path("snippet.py").write_text(code)
        runpy.run_path("snippet.py", run_name="__main__")
        return capsys.readouterr().out

    return run


def test_the_recipe_draws_an_answer(run, tmp_path):
    interactive, paper = blocks("python", "how-to/recipes.md")
    assert "a300" in run(interactive)
    assert "force reserve" in (tmp_path / "plot.html").read_text()
    with matplotlib.rc_context():
        run(paper)
    assert all((tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF") for name in ("candidates", "platform"))


STUDY = "how-to/notebook-study.md"


def test_a_study_takes_three_short_notebooks_with_public_names_alone():
    notebooks = blocks("python", STUDY)
    assert len(notebooks) == 3
    assert max(len(notebook.splitlines()) for notebook in notebooks) <= 25
    modules = re.findall(r"^(?:from|import) ([\w.]+)", "".join(notebooks), re.MULTILINE)
    assert {*modules} == {"matplotlib.pyplot", "numpy", "pandas", "topo_search"}


@pytest.mark.slow
@pytest.mark.parametrize(("number", "figure"), [(0, "trees"), (1, "effort"), (2, "flight")])
def test_a_short_notebook_ends_with_a_figure_for_a_paper(run, tmp_path, number, figure):
    with matplotlib.rc_context():
        run(blocks("python", STUDY)[number])
    assert (tmp_path / f"{figure}.pdf").read_bytes().startswith(b"%PDF")


def test_the_python_code_runs_and_says_what_it_should(run):
    answer, best, angles, verdict = run(*blocks("python", "how-to/python.md")).splitlines()
    assert answer.startswith("a300, 3 modules, J = ")
    assert answer.endswith("audit clear; everything is in push-3")
    assert best.startswith("a300 0.09")
    assert angles.endswith(") clear")
    assert verdict == "clear"


SAID = (
    ("a500, J = ", "audit clear", "largest span met: 0.55 m", "equal folds met: ", "symmetric pair met: "),
    ("audit clear; everything is in listed",),
    ("a5100, J = ", "audit clear"),
    ("everything is in mine", "everything is in qmc"),
    ("design.hinges",),
)
"""What the examples of own code print, in the order of the page."""


@pytest.mark.filterwarnings("ignore:QMCSampler is experimental")
@pytest.mark.parametrize("number", range(len(SAID)))
def test_the_examples_of_own_code_run(run, monkeypatch, number):
    examples = blocks("python", "how-to/own-code.md")
    assert len(examples) == len(SAID)
    monkeypatch.setattr(formats, "_registered", {one.name: one for one in formats.BUILT_IN})
    said = run(examples[number])
    for words in SAID[number]:
        assert words in said, said


def test_the_entry_point_of_a_format_is_the_one_that_is_looked_for():
    (entry,) = map(tomllib.loads, blocks("toml", "how-to/own-code.md"))
    assert [*entry["project"]["entry-points"]] == [formats.GROUP]


def test_overrides_are_those_of_a_task():
    found = re.findall(r"`--set '?([^'`]+)'?`", TEXT)
    assert len(found) >= 6
    for setting in found:
        assert to_toml(read_task("push", (setting,))) != to_toml(read_task("push")), setting


def test_paths_exist():
    named = re.findall(r"`((?:topo_search|nlp|verify|tests|notebooks|docs)/[\w/.-]*)`", TEXT)
    run = re.findall(r"python (tests/\S+\.py)", TEXT)
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert named
    assert run
    assert links
    for path in (*named, *run, *links):
        assert (ROOT / path).exists(), path
    assert (ROOT / "notebooks/pictures/push.png").stat().st_size < 300_000
    assert (ROOT / "notebooks/pictures/turning.webp").stat().st_size < 2_000_000


def words(path: Path) -> int:
    """Return how many words a page has, its code as well, as `wc -w` counts them."""
    return len(path.read_text(encoding="utf-8").split())


def test_the_documentation_is_short():
    assert words(ROOT / "README.md") < 950
    assert sum(map(words, PAGES.rglob("*.md"))) <= 18_000
    assert sum(words(PAGES / page) for page in CORE_PATH) <= 3_700


def test_every_page_of_the_core_path_opens_with_a_picture():
    for page in CORE_PATH:
        opening = (PAGES / page).read_text(encoding="utf-8").partition("\n## ")[0].partition("```")[0]
        assert "![" in opening, page


def test_a_version_is_stated_once():
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited
    assert cited[1] == stated
    assert f"## [{stated}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_page_is_in_the_navigation():
    navigation = (Path(PAGES).parent / "mkdocs.yml").read_text(encoding="utf-8")
    for path in PAGES.rglob("*.md"):
        assert f": {path.relative_to(PAGES)}\n" in navigation, path


# ---- The drawings of the documentation: current, described in words, and shown.

FIGURES = runpy.run_path(str(ROOT / "docs/figures.py"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.mark.parametrize("name", FIGURES["DRAWN"])
def test_a_drawing_is_current(name):
    kept, drawn = (PAGES / f"figures/{name}.svg").read_text(encoding="utf-8"), FIGURES["svg"](name)
    if kept == drawn:
        return
    assert NUMBER.sub("#", kept) == NUMBER.sub("#", drawn), "run `.venv/bin/python docs/figures.py`"
    pairs = zip(NUMBER.findall(kept), NUMBER.findall(drawn), strict=True)  # processors round differently
    assert all(math.isclose(float(a), float(b), rel_tol=1e-6, abs_tol=1e-4) for a, b in pairs)


def test_every_drawing_is_shown_and_no_other_is_kept():
    kept = {path.stem for path in (PAGES / "figures").glob("*.svg")}
    assert kept == {*FIGURES["DRAWN"]} == set(re.findall(r"figures/([\w-]+)\.svg\)", TEXT))


def test_forty_pictures_are_shown_and_each_is_described_in_words():
    shown = re.findall(r"!\[([^]]*)\]\(([^)]*)\)", TEXT)
    assert len({path.rpartition("/")[2] for _, path in shown}) >= 40
    assert min(len(words) for words, _ in shown) > 20


# ---- Examples in docstrings run and print what they say; each function of the reference has one.

MODULES = (
    "topo_search.compose.asking",
    "topo_search.compose.designs",
    "topo_search.compose.drawer",
    "topo_search.compose.rounding",
    "topo_search.compose.searching",
    "topo_search.export.audits",
    "topo_search.export.formats",
    "topo_search.export.kit",
    "topo_search.model.files",
    "topo_search.model.proven",
    "topo_search.model.task_file",
    "topo_search.model.topology",
    "topo_search.report.charts",
    "topo_search.report.progress",
    "topo_search.report.task_warnings",
    "topo_search.study.answering",
    "topo_search.topologies.features",
    "verify.kinematics",
)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run that examples read: that of the example of `search`."""
    folder = tmp_path_factory.mktemp("examples")
    task = read_task("push", ("modules=2", "load_cases=[{com={force=[0.0,0.0,1.0]}}]"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("topo_search.compose.binding.Workers", toy_problem.InProcess)
        search(task, out=folder / "hover-2", starts=1)
    return folder


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, run_folder, in_process, monkeypatch):
    monkeypatch.chdir(run_folder)
    monkeypatch.setattr(formats, "_registered", dict(formats._registered))
    result = doctest.testmod(import_module(name))
    assert result.attempted
    assert not result.failed


def test_each_function_of_the_reference_has_an_example():
    names = re.findall(r"^::: topo_search\.([a-z_]+)$", (PAGES / "reference/python.md").read_text(), re.MULTILINE)
    assert len(names) > 10
    assert [name for name in names if ">>>" not in (getattr(topo_search, name).__doc__ or "")] == []


# ---- The newcomer's path: every command of the first tutorial runs, in order, and prints what the page shows.

PAGE = "tutorials/first-search.md"


def sessions() -> list[tuple[str, list[str]]]:
    """Return every command of the page with the lines shown below it."""
    found = []
    for block in blocks("console", PAGE):
        command, *shown = block.splitlines()
        assert command.startswith("$ topo-search ")
        found.append((command.removeprefix("$ "), shown))
    return found


@pytest.mark.slow
def test_the_newcomers_path_runs_as_it_is_shown(tmp_path):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    (_, task) = blocks("toml", PAGE)
    (tmp_path / "wall.toml").write_text(task, encoding="utf-8")
    for command, shown in sessions():
        began = time.perf_counter()
        done = subprocess.run(
            shlex.split(command), cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
        )
        print(f"{time.perf_counter() - began:6.1f} s  {command}")
        assert done.returncode in (0, 1), done.stderr
        printed = iter(done.stdout.splitlines())
        for line in shown:
            if line != "...":
                assert any(same(line, other) for other in printed), f"{command}: not printed, in order: {line}"
    (page,) = tmp_path.glob("runs/push-*/report.html")
    assert page.stat().st_size > 1_000_000
    for made in ("kit/allocation.json", "kit/platform.params", "kit/assembly.html", "flight/flight.json"):
        assert (tmp_path / made).is_file(), made
