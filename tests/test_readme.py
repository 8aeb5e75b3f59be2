"""What the README shows is true: its files are read, its code runs, its commands and paths exist."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from topo_search.cli import main
from topo_search.model import Task
from topo_search.model.files import read_task, to_toml

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def test_the_first_task_is_the_shipped_one_and_the_exposures_are_read():
    first, exposures, goals, tolerances = (tomllib.loads(block) for block in blocks("toml"))
    assert Task.model_validate(first) == read_task("push")
    task = Task.model_validate({**first, **exposures, **goals, **tolerances})
    assert [requirement.kind for requirement in task.exposure] == ["local", "directional", "exterior"]
    assert task.tolerances.position == 0.5e-3
    assert task.goals.names == ("clearance", "stand_off", "peak_input")


def test_the_python_code_runs_and_says_what_it_should(tmp_path):
    _, code = blocks("python")
    (tmp_path / "snippet.py").write_text(code)
    done = subprocess.run([sys.executable, "snippet.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    status, angles, verdict = done.stdout.splitlines()
    assert status.startswith("0 a300 0.09")
    assert angles.endswith(") clear")
    assert verdict == "clear"


def test_overrides_are_those_of_a_task():
    found = re.findall(r"`--set '?([^'`]+)'?`", TEXT)
    assert len(found) == 6
    for setting in found:
        assert to_toml(read_task("push", (setting,))) != to_toml(read_task("push"))


def test_every_command_is_listed_and_every_listed_command_exists():
    listed = re.findall(r"^\| `topo-search (\w+)", TEXT, re.MULTILINE)
    assert sorted(listed) == sorted(main.commands)


def test_paths_exist():
    links = re.findall(r"\]\(([^)]+)\)", TEXT)
    named = re.findall(r"`((?:topo_search|nlp|verify|tests)/[\w/.]*)`", TEXT)
    run = re.findall(r"python (tests/\S+\.py)", TEXT)
    assert links
    assert named
    assert run
    for path in (*links, *named, *run):
        assert (ROOT / path).exists(), path
    assert (ROOT / "notebooks/pictures/push.png").stat().st_size < 300_000
