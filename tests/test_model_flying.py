"""Defaults of a new task: what hovering needs, and the masses of rod and joints."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from topo_search.model import Design, Task
from topo_search.model.files import read_json, to_toml
from topo_search.model.flying import FLYING, fallback, find_missed
from topo_search.model.joint_mass import joint_mass
from topo_search.model.task_file import examples, read_task
from verify import audit

DESIGNS = Path(__file__).parent / "designs"
PUSH = {"units": "SI", "carries_weight": True, "end_effector": {"force": [2.0, 0.0, 0.0]}}
BARE = {"com": {"force": [0.0, 0.0, 1.0]}}


def task(*cases: dict[str, Any], **tables: Any) -> Task:
    return Task.model_validate({"name": "t", "modules": 3, "load_cases": list(cases or (PUSH,)), **tables})


def values(given: Task) -> dict[str, Any]:
    return {path: getattr(getattr(given, path.split(".")[0]), path.split(".")[1]) for path in FLYING}


def test_a_task_that_carries_the_weight_asks_for_what_the_shipped_flying_tasks_ask_for() -> None:
    given = task()
    assert values(given) == FLYING == values(read_task("wall-push"))
    assert set(given.flight.filled) == set(FLYING)
    assert given.flight.tolerances
    point = {"flight.at": "tip", "flight.directions": "all"}  # the fallback keeps those of the default
    assert values(task(BARE)) == values(task(flight={"defaults": False})) == {**values(fallback(given)), **point}
    assert not task(BARE).flight.asks
    assert not fallback(given).resolve(3).flight.asks
    assert fallback(given).search.maximize == "force_reserve"
    assert fallback(task(flight={"force_reserve": 0.1})).search.maximize is None


@pytest.mark.parametrize("name", examples())
def test_shipped_tasks_state_every_field(name: str) -> None:
    given = read_task(name)
    assert not given.flight.filled
    assert {"joint_mass"} <= given.module.model_fields_set


@pytest.mark.parametrize(
    ("tables", "path", "value"),
    [
        ({"flight": {"tilt_deg": 0.0}}, "flight.tilt_deg", 0.0),
        ({"flight": {"force_reserve": 0.1}}, "flight.at", "both"),
        ({"flight": {"force_reserve": 0.1}}, "flight.directions", "all"),
        ({"flight": {"force_reserve": 0.1, "at": "com"}}, "flight.at", "com"),
        ({"flight": {"at": "tip"}}, "flight.at", "tip"),
        ({"tolerances": {"hinge_angle_deg": 0.0}}, "tolerances.hinge_angle_deg", 0.0),
        ({"module": {"min_input": 0.0}}, "module.min_input", 0.0),
        ({"goals": {"force_reserve": [0.0, 0.1]}}, "flight.force_reserve", 0.0),
        ({"search": {"interference": "parts"}}, "tolerances.position", 0.0),
    ],
)
def test_what_is_stated_stays(tables: dict[str, Any], path: str, value: object) -> None:
    given = task(**tables)
    assert values(given)[path] == value
    assert path not in given.flight.filled
    assert given.flight.filled  # others are still left out


def test_a_reserve_left_out_is_a_share_of_the_weight_in_any_unit() -> None:
    for units in ("SI", "weight"):
        resolved = task(flight={"units": units}).resolve(3)
        assert resolved.flight.force_reserve == pytest.approx(0.25 * resolved.force_unit(3))


def test_a_run_s_task_file_is_the_same_task_and_a_changed_field_is_stated() -> None:
    given = task()
    data = tomllib.loads(to_toml(given))
    assert Task.model_validate(data) == given
    data["flight"]["tilt_deg"] = 5.0
    changed = Task.model_validate(data)
    assert changed.flight.tilt_deg == 5.0
    assert set(given.flight.filled) - set(changed.flight.filled) == {"flight.tilt_deg"}
    assert given.replace(load_cases=(BARE,)).flight.force_reserve == 0.0
    off = task(flight={"defaults": False, "tilt_deg": 0.0}, end_effector={"rod_mass": "ignored"})
    assert Task.model_validate(tomllib.loads(to_toml(off))) == off


def test_rod_and_joints_weigh_something_unless_a_task_says_otherwise() -> None:
    given = task(BARE)
    assert given.end_effector.rod_mass == "included"
    assert given.module.joint_mass == joint_mass(given.module)
    assert task(end_effector={"rod": "none"}).end_effector.rod_mass == "ignored"
    assert task(module={"joint_mass": 0.0}).module.joint_mass == 0.0


def without_defaults(design: Design) -> Design:
    """The design as if its task had dropped every default."""
    dropped = fallback(task()).flight.dropped
    return design.model_copy(update={"task": design.task.with_fields("flight", dropped=dropped)})


def test_what_a_design_holds_is_measured_by_its_audit() -> None:
    names = ("wall-push-without-reserves", "flying/wall-push")
    designs = [read_json(Design, DESIGNS / f"{name}.json") for name in names]
    bare, flying = ({entry.field for entry in find_missed(without_defaults(one), audit(one))} for one in designs)
    assert bare >= {"flight.force_reserve", "flight.tilt_deg", "flight.angular_acceleration"}
    assert flying == set(FLYING) - {"flight.at", "flight.directions"}  # none missed: all that were dropped
