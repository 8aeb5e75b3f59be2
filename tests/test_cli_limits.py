"""What is beyond a limit is refused by name; what is at one is worked on."""

import json

import pytest
from commands import invoke

from topo_search.limits import LIMITS
from topo_search.model import Topology

HEAD = 'name = "t"\nmodules = 5\n'
HOVER = "[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n"


SCALING = ["experiment", "scaling", "--small", "--out", "out"]


def said(tmp_path, *words, task=HEAD + HOVER):
    (tmp_path / "task.toml").write_text(task)
    result = invoke("check", tmp_path / "task.toml", *words, status=2)
    return result.stderr.replace(str(tmp_path / "task.toml"), "task")


BEYOND = {
    "ten thousand load cases": (HEAD + HOVER * 10_000, "load_cases: must have at most 200 entries, but got 10,000"),
    "levels": (
        HEAD + HOVER + "[goals]\n" + "".join(
            f"{name} = {[i / 1e4 for i in range(1, 1001)]}\n"
            for name in ("clearance", "stand_off", "peak_input")
        ),
        "goals: must have at most 1,000 combinations of levels, but got 1,000,000,000",
    ),
    "a seed": (
        HEAD + 'load_cases = "ten-wrenches"\ntask_seed = 0x' + "f" * 100_000,
        "task_seed: must be at most 9.22337e+18, but got a whole number of 400,000 bits",
    ),
    "a long file": (HEAD + HOVER + "#" * LIMITS.task_bytes, "must have at most 1,048,576 bytes, but has"),
}  # fmt: skip


@pytest.mark.parametrize("case", BEYOND)
def test_a_task_beyond_a_limit_is_refused_by_name(tmp_path, case):
    text, rule = BEYOND[case]
    (line,) = said(tmp_path, task=text).splitlines()
    assert line.startswith(f"task: {rule}")
    assert len(line) < 400


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["topologies", "1000000000"], "is not in the range 1<=x<=1000"),
        (["solve", "push", "--topology", "a" + "1" * 60_000 + "0"], "must have at most 200 modules, but"),
        (["run", "push", "--workers", "257"], "'--workers': 257 is not in the range 1<=x<=256"),
        (["run", "push", "--time-limit", "nan"], "'--time-limit': must be a number, but got nan"),
        (["run", "push", "--modules", "13"], "at most 2,000,000 candidates, but 13 modules have 1.1e+7"),
        ([*SCALING, "--seed", str(LIMITS.largest_integer)], "task_seed: must be at most 9.22337e+18"),
        ([*SCALING, "--topologies", "10001"], "each above 0 and at most 10,000, but got '10001'"),
    ],
)
def test_a_number_beyond_a_limit_is_refused_by_name(tmp_path, monkeypatch, words, rule):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "design.json").touch()
    result = invoke(*words, status=2)
    assert rule in result.stderr.replace("\n", " ")
    assert all(len(line) < 400 for line in result.stderr.splitlines())
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]


def test_the_largest_listed_sizes_are_counted_drawn_and_listed_as_they_come():
    assert len(invoke("topologies", "1000", "--count", "--connectors", "any").stdout) > 1000
    drawn = invoke("topologies", "1000", "--sample", "3", "--json")
    assert [Topology.from_key(key).n for key in json.loads(drawn.stdout)] == [1000] * 3
    few = invoke("topologies", "3", "--json")
    assert json.loads(few.stdout) == invoke("topologies", "3").stdout.split()


@pytest.mark.parametrize(
    ("setting", "rule"),
    [
        ("task_seed=0x" + "f" * 100_000, "task: task_seed: must be at most"),
        ("load_cases." + "1" * 60 + ".weight=1", "must be an index under 1"),
        ("load_cases.\u0663.weight=1", "must be an index under 1"),
        ("gravity=1\nmodules=3", "task: gravity: must be a number"),
    ],
)
def test_a_setting_beyond_a_limit_is_refused_by_name(tmp_path, setting, rule):
    (line,) = said(tmp_path, "--set", setting).splitlines()
    assert rule in line
    assert len(line) < 400
