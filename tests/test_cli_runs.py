"""`list`, `show`, `open` and `compare`: finished runs, read again."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from toy_problem import toy_run

from topo_search.cli import GROUPS, main


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for name, modules in (("three", 3), ("four", 4)):
        toy_run(folder / name, modules=modules)
    return folder


def invoke(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def test_list_and_show_tell_what_the_runs_found(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs)
    listed = invoke("list", ".")
    assert listed.exit_code == 0
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


def test_compare_prints_and_draws_the_best_of_two_runs_or_designs(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    figures = json.loads(invoke("compare", runs / "three", runs / "four", "--out", page, "--json").stdout)
    best = [json.loads((runs / name / "best.json").read_text()) for name in ("three", "four")]
    assert [side["objective"] for side in figures.values()] == [design["objective"] for design in best]
    assert [side["modules"] for side in figures.values()] == [3, 4]
    text = page.read_text()
    assert all(f'id="card-{name}"' in text for name in figures)

    printed = invoke("compare", runs / "three", runs / "four" / "best.json", "--out", page).stdout
    rows = {line.split()[0]: line.split()[-2:] for line in printed.splitlines() if len(line.split()) in (3, 4)}
    assert rows["modules"] == ["3", "4"]
    for name, effort in zip(("three", "four"), rows["J"], strict=True):
        assert f"J = {effort} rad^4/s^4, gap to the lower bound" in invoke("show", runs / name).stdout
    assert " %" in next(line for line in printed.splitlines() if line.startswith("gap"))


@pytest.mark.parametrize(
    "words", [("show", "nowhere"), ("open", "nowhere"), ("list", "nowhere"), ("compare", "x", "y")]
)
def test_what_is_no_run_is_refused_by_name(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*words)
    assert result.exit_code == 2
    assert words[1] in result.stderr


def test_open_launches_the_page(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    monkeypatch.setattr("click.launch", lambda page: opened.append(page) or len(opened) - 1)
    assert "topo-search report" in invoke("open", runs / "three").stderr
    assert invoke("report", runs / "three").exit_code == 0
    assert invoke("open", runs / "three").exit_code == 0
    assert opened == [str(runs / "three" / "report.html")]
    assert "no program" in invoke("open", runs / "three").stderr


def test_help_lists_every_command_once_with_its_whole_summary() -> None:
    text = " ".join(invoke("--help").stdout.split())
    commands = [command for group in GROUPS.values() for command in group]
    assert sorted(command.name for command in commands) == sorted(main.commands)
    for command in commands:
        summary = " ".join(command.help.partition("\n\n")[0].split())
        assert summary.endswith(".")
        assert summary in text
