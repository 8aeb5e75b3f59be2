"""What is beyond a limit is refused by name; what is at one is worked on."""

import json

import numpy as np
import pytest
from commands import invoke

from topo_search.limits import LIMITS
from topo_search.model import Task, Topology
from topo_search.model.files import read_task, to_toml

HEAD = 'name = "t"\nmodules = 5\n'
HOVER = "[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n"


SCALING = ["experiment", "scaling", "--small", "--out", "out"]


def said(tmp_path, *words, task=HEAD + HOVER):
    (tmp_path / "task.toml").write_text(task)
    result = invoke("check", tmp_path / "task.toml", *words, status=2)
    return result.stderr.replace(str(tmp_path / "task.toml"), "task")


BEYOND = {
    "ten thousand load cases": (HEAD + HOVER * 10_000, "load_cases: must have at most 200 entries, but got 10,000"),
    "a wide range": (HEAD.replace("5", "[1, 21]") + HOVER, "modules: must be at most 20 sizes, but got [1, 21]"),
    "segments of several": (
        HEAD + HOVER + ('[[exposure]]\nkind = "directional"\nsegments = [' + "[1, 0, 0]," * 101 + "]\n") * 2,
        "exposure: must have at most 200 segments in all, but got 202",
    ),
    "requirements": (
        HEAD + HOVER + '[[exposure]]\nkind = "local"\n' * 21,
        "exposure: must have at most 20 entries, but got 21",
    ),
    "levels": (
        HEAD + HOVER + "[goals]\n" + "".join(
            f"{name} = {[i / 1e4 for i in range(1, 1001)]}\n"
            for name in ("clearance", "stand_off", "peak_input")
        ),
        "goals: must have at most 1,000 combinations of levels, but got 1,000,000,000",
    ),
    "a long name": (HEAD + HOVER + "a" * 100_000 + " = 1", "unknown field"),
    "digits": (HEAD + HOVER + "gravity = " + "9" * 100_000, "is not a TOML file, or only a part of one"),
    "hexadecimal digits": (
        HEAD.replace("5", "0x" + "f" * 100_000) + HOVER,
        "modules: must be at most 200, but got a whole number of 400,000 bits",
    ),
    "a seed": (
        HEAD + 'load_cases = "ten-wrenches"\ntask_seed = 0x' + "f" * 100_000,
        "task_seed: must be at most 9.22337e+18, but got a whole number of 400,000 bits",
    ),
    "brackets": (HEAD + HOVER + "x = " + "[" * 2000 + "]" * 2000, "is not a TOML file, or only a part of one"),
    "a long file": (HEAD + HOVER + "#" * LIMITS.task_bytes, "must have at most 1,048,576 bytes, but has"),
}  # fmt: skip


@pytest.mark.parametrize("case", BEYOND)
def test_a_task_beyond_a_limit_is_refused_by_name(tmp_path, case):
    text, rule = BEYOND[case]
    (line,) = said(tmp_path, task=text).splitlines()
    assert line.startswith(f"task: {rule}") or rule == "unknown field" in line
    assert len(line) < 400


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


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["topologies", "1000000000"], "is not in the range 1<=x<=1000"),
        (["topologies", "5", "--sample", "1000000000"], "is not in the range 1<=x<=1000000"),
        (["topologies", "9" * 5000], "is not"),
        (["solve", "push", "--topology", "a" + "1" * 60_000 + "0"], "must have at most 200 modules, but"),
        (["run", "push", "--workers", "257"], "'--workers': 257 is not in the range 1<=x<=256"),
        (["run", "push", "--starts", "10001"], "'--starts': 10001 is not in the range 1<=x<=10000"),
        (["run", "push", "--time-limit", "1e300"], "1e+300 is not in the range 0<x<=1000000000"),
        (["run", "push", "--time-limit", "nan"], "'--time-limit': must be a number, but got nan"),
        (["run", "push", "--time-limit", "0"], "0.0 is not in the range 0<x<=1000000000"),
        (
            ["run", "push", "--strategy", "optuna", "--trials", "100001"],
            "'--trials': 100001 is not in the range 1<=x<=100000",
        ),
        (["run", "push", "--modules", "13"], "at most 2,000,000 candidates, but 13 modules have 1.1e+7"),
        ([*SCALING, "--seed", str(LIMITS.largest_integer)], "task_seed: must be at most 9.22337e+18"),
        ([*SCALING, "--topologies", "10001"], "each above 0 and at most 10,000, but got '10001'"),
        ([*SCALING, "--topologies", "9" * 5000], "each above 0 and at most 10,000, but got '9"),
        ([*SCALING, "--sizes", "201"], "each above 0 and at most 200, but got '201'"),
    ],
)
def test_a_number_beyond_a_limit_is_refused_by_name(tmp_path, monkeypatch, words, rule):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "design.json").touch()
    result = invoke(*words, status=2)
    assert rule in result.stderr.replace("\n", " ")
    assert all(len(line) < 400 for line in result.stderr.splitlines()) or len(words[1]) > 400
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]


def test_the_largest_listed_sizes_are_counted_drawn_and_listed_as_they_come():
    assert len(invoke("topologies", "1000", "--count", "--connectors", "any").stdout) > 1000
    drawn = invoke("topologies", "1000", "--sample", "3", "--json")
    assert [Topology.from_key(key).n for key in json.loads(drawn.stdout)] == [1000] * 3
    few = invoke("topologies", "3", "--json")
    assert json.loads(few.stdout) == invoke("topologies", "3").stdout.split()


def test_a_task_at_its_limits_is_read_again_from_what_is_written(tmp_path):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(9, LIMITS.corners, 3))
    segments = rng.normal(size=(LIMITS.segments, 3)).tolist()
    wrench = {"force": rng.normal(size=3).tolist(), "torque": rng.normal(size=3).tolist()}
    task = Task.model_validate(
        {
            "name": "largest",
            "modules": LIMITS.modules,
            "load_cases": [{"end_effector": wrench, "com": wrench, "units": "SI"}] * LIMITS.load_cases,
            "exposure": [
                *({"kind": "local", "vertices": corners.tolist()} for corners in points),
                {"kind": "directional", "segments": segments},
                *({"kind": "local", "vertices": corners.tolist()} for corners in points),
            ],
            "goals": {"clearance": [i * 1e-5 for i in range(LIMITS.levels)]},
        }
    )
    text = to_toml(task)
    assert len(text) < LIMITS.task_bytes
    (tmp_path / "task.toml").write_text(text)
    assert read_task(tmp_path / "task.toml") == task
