"""`list`, `show`, `open` and `compare`: finished runs, read again."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import pytest
from commands import invoke, refused
from report_cases import design
from toy_problem import toy_run

from topo_search.cli import GROUPS, main
from topo_search.limits import figures as words
from topo_search.model import Topology
from topo_search.model.files import to_json


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for name, modules in (("three", 3), ("four", 4)):
        toy_run(folder / name, modules=modules)
    return folder


def test_list_and_show_tell_what_the_runs_found(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs)
    listed = invoke("list", ".")
    assert "J [rad^4/s^4]" in listed.stdout.splitlines()[0]
    answers = json.loads(invoke("list", ".", "--json").stdout)
    assert [Path(answer["folder"]).name for answer in answers] == ["four", "three"]
    for answer in answers:
        shown = invoke("show", answer["folder"])
        assert shown.exit_code == answer["exit_status"] == 0
        key = answer["best"]["key"]
        assert f"best design: {key}," in shown.stdout
        assert any(key in line and Path(answer["folder"]).name in line for line in listed.stdout.splitlines())
        assert json.loads(invoke("show", answer["folder"], "--json").stdout) == answer


FIGURES = ("Control effort", "Proven gap", "Modules")


def test_compare_prints_and_draws_the_best_of_two_runs_or_designs(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    figures = json.loads(invoke("compare", runs / "three", runs / "four", "--out", page, "--json").stdout)
    best = [json.loads((runs / name / "best.json").read_text()) for name in ("three", "four")]
    assert [side["objective"] for side in figures.values()] == [design["objective"] for design in best]
    assert [side["modules"] for side in figures.values()] == [3, 4]
    text = page.read_text()
    assert all(f'id="card-{name}"' in text for name in figures)

    printed = invoke("compare", runs / "three", runs / "four" / "best.json", "--out", page).stdout
    told = {name: next(line for line in printed.splitlines() if line.startswith(name)) for name in FIGURES}
    assert told["Modules"].split() == ["Modules", "3", "4"]
    assert [words(design["objective"], 5) in told["Control effort"] for design in best] == [True, True]
    assert " %" in told["Proven gap"]


@pytest.mark.parametrize(
    "words", [("show", "nowhere"), ("open", "nowhere"), ("list", "nowhere"), ("compare", "x", "y")]
)
def test_what_is_no_run_is_refused_by_name(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert words[1] in invoke(*words, status=2).stderr


def test_open_launches_the_page(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    monkeypatch.setattr("click.launch", lambda page: opened.append(page) or len(opened) - 1)
    assert "topo-search report" in invoke("open", runs / "three", status=2).stderr
    invoke("report", runs / "three")
    invoke("open", runs / "three")
    assert opened == [str(runs / "three" / "report.html")]
    assert "no program" in invoke("open", runs / "three", status=2).stderr


def test_help_lists_every_command_once_with_its_whole_summary() -> None:
    text = " ".join(invoke("--help").stdout.split())
    commands = [command for group in GROUPS.values() for command in group]
    assert sorted(command.name for command in commands) == sorted(main.commands)
    for command in commands:
        summary = " ".join(command.help.partition("\n\n")[0].split())
        assert summary.endswith(".")
        assert summary in text


def test_help_of_a_command_lists_options_in_groups_and_no_argument_among_them() -> None:
    rows = invoke("run", "--help").stdout.partition("\nOptions:\n")[2].partition("\n  Example:")[0]
    assert re.findall(r"^(\w+):$", rows, re.MULTILINE) == ["Task", "Output", "Advanced"]
    assert all(name.startswith("-") for name in re.findall(r"^  (\S+)", rows, re.MULTILINE))


# ---- `topo-search report`: what it writes where, and what it says when it cannot; `run` writes its page by
# itself.


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of the toy problem."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    toy_run(folder)
    return folder


@pytest.fixture
def command(finished, tmp_path, monkeypatch):
    """The command in a folder with a run of the toy problem, a design, and one that cannot be drawn."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(finished, tmp_path / "run")
    (tmp_path / "mine.json").write_text(to_json(design(Topology.from_key("a0"))))
    (tmp_path / "far.json").write_text(to_json(design(Topology.from_key("a0"), end_effector_m=[1e200, 0.0, 0.0])))
    return partial(invoke, "report")


@pytest.mark.parametrize(
    ("words", "page", "title"),
    [
        (["run"], "run/report.html", "toy: 3 modules, a"),
        (["run/", "--out", "deep/page.html"], "deep/page.html", "toy: 3 modules, a"),
        (["mine.json"], "mine.html", "push: 1 module, a0"),
        (["mine.json", "--out", "mine.page"], "mine.page", "push: 1 module, a0"),
    ],
)
def test_the_page_is_where_it_says(command, tmp_path, words, page, title):
    assert command(*words).stdout == f"the page is in {page}\n"
    assert f"<title>{title}" in (tmp_path / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere: no such file"),
        (["."], "is not a run folder: it has no ledger.sqlite"),
        (["run/task.toml"], "is not a JSON file"),
        (["run", "--out", "."], "is a directory"),
        (["far.json"], "end_effector_m: must be within"),
    ],
)
def test_bad_input_is_status_two_and_writes_nothing(command, tmp_path, words, said):
    assert said in refused("report", *words)
    assert not [path for path in tmp_path.rglob("*") if path.suffix == ".html"]


@pytest.mark.parametrize(
    ("name", "out"),
    [
        ("best.json", ()),
        ("candidates.csv", ("--out", "page.html")),
        ("designs/a300.json", ()),
        ("task.toml", ("--out", "page.html")),
    ],
)
def test_a_file_that_somebody_changed_is_named_and_not_shown(command, tmp_path, name, out):
    path = tmp_path / "run" / name
    path.write_bytes(path.read_bytes() + b"\n")
    result = command("run", *out)
    assert result.stderr == (
        f"warning: {name} is not the file that this run wrote; the page shows what the run wrote\n"
    )


@pytest.mark.usefixtures("in_process")
def test_a_run_ends_in_its_page(tmp_path):
    invoke("run", "push", "--modules", "1", "--starts", "1", "--out", tmp_path / "run", status=3)
    assert "No design was found for push" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
