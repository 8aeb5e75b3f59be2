"""Tasks as people write them: first answers hold the defaults of flying tasks and fly, or say what they miss."""

from pathlib import Path

import pytest
from suites import few

from topo_search import Answer, Task, read_answer, read_design, read_task, search
from topo_search.model.flying import FLYING
from topo_search.report.task_warnings import task_warnings
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import Options

TASKS = {path.stem: path for path in sorted((Path(__file__).parent / "tasks").glob("*.toml"))}
FRAGILE = {"drill", "plug", "sensor"}
"""Tasks whose defaults no design of three modules holds: a wall keeps out the air of a heavy tool's platform."""


@pytest.mark.parametrize("name", few(sorted(TASKS), {"camera", "cart"}))
def test_the_first_answer_flies_or_says_what_it_misses(name: str, tmp_path: Path, in_process: None) -> None:
    answer = search(read_task(TASKS[name], ("modules=3",)), out=tmp_path / "run", starts=4)
    assert answer.exit_status == 0
    assert answer.audit.verdict == "clear"
    if not name.endswith("-contact"):  # there it depends on the starts whether a rod clear of airflow is found
        assert bool(answer.fragile) is (name in FRAGILE)
    if not answer.fragile:
        assert fly_all(answer.design, Options()).result.outcome == "recovered"


def hover(tmp_path: Path, **flight: float) -> Answer:
    """The answer for two modules that hover: their thrust axes lie in a plane, so no side force is held."""
    data = {
        "name": "hover",
        "modules": 2,
        "load_cases": [{"carries_weight": True}],
        "end_effector": {"rod": "none"},
    }
    return search(Task.model_validate({**data, "flight": flight}), out=tmp_path / "run", starts=2)


def test_the_best_without_the_defaults_is_fragile(tmp_path: Path, in_process: None) -> None:
    answer = hover(tmp_path)
    assert (answer.exit_status, answer.audit.verdict, answer.complete) == (0, "clear", True)
    missed = {entry.field: entry for entry in answer.fragile}
    assert missed["flight.force_reserve"].held < missed["flight.force_reserve"].asked == 0.25
    flight = answer.design.task.flight
    assert set(flight.dropped) == set(FLYING) - {"flight.at", "flight.directions"}
    assert (flight.force_reserve, flight.tilt_deg, answer.design.task.module.min_input) == (0.0, 0.0, 0.0)
    assert read_answer(answer.folder).fragile == answer.fragile == hover(tmp_path).fragile
    shared = read_design(answer.folder / "best.json")
    assert shared == answer.design
    flown = {
        result.name: result.counts
        for result in fly_all(shared, Options(), only=("return", "tilt")).result.scenarios
    }
    assert set(flown.values()) == {False}


def test_what_a_task_states_is_never_given_up(tmp_path: Path, in_process: None) -> None:
    assert hover(tmp_path, force_reserve=0.25).exit_status == 3


@pytest.mark.parametrize("name", sorted(TASKS))
def test_nothing_is_odd_about_them_but_the_side_that_the_tool_comes_from(name: str) -> None:
    task = read_task(TASKS[name])
    is_open = not task.exposure[0].solid if task.exposure else not any(case.contact for case in task.load_cases)
    told = [warning.path for warning in task_warnings(task)]
    assert all(path.endswith(".contact") for path in told)
    assert bool(told) is (
        is_open and any(any(case.to_si(1.0, 1.0).at_end_effector.force) for case in task.load_cases)
    )
