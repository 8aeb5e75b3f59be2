"""A module by the words of a data sheet: thrust a rotor, torque over thrust, least input."""

from typing import Any

import pytest

from topo_search.model import Module, Task
from topo_search.model.files import to_toml
from topo_search.model.task_file import read_task
from topo_search.report.task_warnings import task_warnings

HOVER = {"carries_weight": True}


def task(module: Any, **fields: Any) -> Task:
    return Task.model_validate({"name": "t", "modules": 3, "load_cases": [HOVER], "module": module, **fields})


@pytest.mark.parametrize("gravity", [9.81, 1.62])
def test_the_largest_thrust_of_a_rotor_is_what_it_says(gravity: float) -> None:
    for module in ({"max_thrust": 2.0, "mass": 0.3}, Module(max_thrust=2.0, mass=0.3)):
        given = task(module, gravity=gravity)
        for one in (given, given.resolve(3)):
            assert one.module.thrust_coefficient * one.max_input == pytest.approx(2.0)
            assert one.max_thrust_to_weight == pytest.approx(8.0 / (0.3 * gravity))
    half = task({"max_thrust": 2.0, "mass": 0.3}, gravity=gravity, search={"peak_input": 0.5})
    assert half.module.thrust_coefficient * half.max_input == pytest.approx(1.0)


def test_torque_over_thrust_is_what_it_says() -> None:
    for given in (Module(torque_to_thrust=0.02), Module(torque_to_thrust=0.02, thrust_coefficient=1e-6)):
        assert given.torque_coefficient / given.thrust_coefficient == pytest.approx(0.02)


def test_both_forms_may_be_given_where_they_agree_to_three_digits() -> None:
    both = {
        "max_thrust": 1.472,
        "max_thrust_to_weight": 2.5,
        "torque_to_thrust": 0.00801,
        "torque_coefficient": 3.1e-9,
    }
    assert task(both).resolve(3) == task({}).resolve(3)


def test_a_design_has_one_form_and_a_task_comes_back(tmp_path: Any) -> None:
    stated = task({"max_thrust": 2.0, "torque_to_thrust": 0.02, "min_input": 0.05})
    path = tmp_path / "task.toml"
    path.write_text(to_toml(stated))
    assert read_task(path) == stated
    written = stated.resolve(3).model_dump(mode="json")["module"]
    assert not {"max_thrust", "torque_to_thrust"} & set(written)
    assert written["min_input"] == 0.05
    unused = task({"min_input": 0.0}, flight={"defaults": False})
    assert "min_input" not in unused.resolve(3).model_dump_json()


def test_settings_change_what_a_data_sheet_says(tmp_path: Any) -> None:
    path = tmp_path / "task.toml"
    path.write_text(
        'name = "t"\nmodules = 3\nload_cases = [{ carries_weight = true }]\n[module]\nmax_thrust = 2.0\n'
    )
    heavier = read_task(path, ("module.mass=0.5", "gravity=9.8"))
    assert heavier.module.max_thrust_to_weight == pytest.approx(8.0 / (0.5 * 9.8))


def test_the_least_input_is_a_share_of_the_modules_largest_whatever_a_design_may_use() -> None:
    given = task({"min_input": 0.1}, search={"peak_input": 0.8})
    assert given.min_input == pytest.approx(0.1 * given.module.max_input(given.gravity))
    assert given.min_input == pytest.approx(given.max_input / 8)


@pytest.mark.parametrize(("at", "ratio"), [("hover", 1.0), ("full", 2.5), (1.5, 1.5)])
def test_the_thrust_of_an_air_speed_is_a_word_or_a_number(at: Any, ratio: float) -> None:
    module = task({"airflow": {"speed": 2.0, "at": at}}).module
    assert module.thrust_over_weight(module.airflow.at) == ratio


def test_too_little_thrust_names_the_field_that_was_given() -> None:
    (odd,) = (one for one in task_warnings(task({"max_thrust": 0.5})) if "produce at most" in one.words)
    assert odd.path == "module.max_thrust"
