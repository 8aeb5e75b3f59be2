"""Load cases: what they come to in N and N m for a number of modules."""

from typing import Any

import pytest

from topo_search.model import BadInput, ResolvedTask, Task
from topo_search.model.files import to_toml, validate
from topo_search.model.task_warnings import task_warnings

TORQUE = {"torque": [0.1, 0.0, 0.0]}


def task(*cases: dict[str, Any], modules: Any = 5, **fields: Any) -> Task:
    fields = {"module": {"torque_coefficient": 3.1e-9}, **fields}
    return validate(Task, {"name": "t", "modules": modules, "load_cases": list(cases), **fields}, "t")


@pytest.mark.parametrize("n", [1, 3, 40])
def test_the_weight_is_the_platforms_whatever_its_size_and_the_units(n: int) -> None:
    """m_t g by hand: n modules of 0.24 kg and an end-effector of 0.1 kg."""
    stated = task(
        {"carries_weight": True},
        {"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0], **TORQUE}},
        {"carries_weight": True, "units": "SI", "com": {"force": [0.5, 0.0, -1.0], **TORQUE}},
        {"carries_weight": True, "com": {"force": [0.0, 0.2, 0.5]}},
        modules=[n, n + 3],
        end_effector={"mass": 0.1},
    )
    weight = (n * 0.24 + 0.1) * 9.81
    cases = stated.resolve(n).load_cases
    assert [case.at_com.force for case in cases] == [
        (0.0, 0.0, pytest.approx(weight)),
        (0.0, 0.0, pytest.approx(weight)),
        (0.5, 0.0, pytest.approx(weight - 1.0)),
        (0.0, pytest.approx(0.2 * weight), pytest.approx(1.5 * weight)),
    ]
    assert cases[1].at_end_effector.force == (2.0, 0.0, 0.0)
    assert cases[2].at_com.torque == (0.1, 0.0, 0.0)
    assert not any(case.carries_weight for case in cases)


def test_it_is_the_same_task_as_with_the_weight_written_out() -> None:
    push = {"force": [0.2, 0.0, 0.0]}
    said = task({"carries_weight": True, "end_effector": push}, {"carries_weight": True})
    hover = {"com": {"force": [0.0, 0.0, 1.0]}}
    assert said.resolve(5) == task({"end_effector": push, **hover}, hover).resolve(5)


def test_a_task_is_written_with_it_and_a_design_without() -> None:
    said = task({"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0]}})
    assert "carries_weight = true" in to_toml(said)
    resolved = said.resolve(5)
    assert "carries_weight" not in resolved.model_dump_json()
    assert Task.model_validate_json(resolved.model_dump_json()).resolve(5) == resolved
    also = {"units": "SI", "carries_weight": True}
    with pytest.raises(BadInput) as told:
        validate(ResolvedTask, {**resolved.model_dump(mode="json"), "load_cases": [also]}, "d")
    assert [fault.path for fault in told.value.faults] == ["load_cases[0].carries_weight"]


def test_a_name_is_told_with_the_number_and_does_not_hide_that_two_are_the_same() -> None:
    named = task({"name": "Wand Süd +x", "carries_weight": True}, {"carries_weight": True, "weight": 0.0})
    assert named.resolve(5).case_labels == ("load case 0 (Wand Süd +x)", "load case 1")
    assert named.resolve(5).load_cases[0].name == "Wand Süd +x"
    same = task({"name": "a", "carries_weight": True}, {"name": "b", "carries_weight": True})
    assert [str(one) for one in task_warnings(same)] == ["load_cases[1]: is the same as load_cases[0]"]


def test_weights_far_apart_are_odd_and_none_at_all_is_not() -> None:
    hover, light = {"carries_weight": True}, {"carries_weight": True, "com": {"force": [0.1, 0.0, 0.0]}}
    assert task_warnings(task(hover, {**light, "weight": 0.0})) == ()
    assert "by a factor of 1e+05" in str(task_warnings(task(hover, {**light, "weight": 1e-5}))[0])


def test_sizes_compare_where_only_the_weight_grows() -> None:
    push = {"carries_weight": True, "units": "SI", "end_effector": {"force": [2.0, 0.0, 0.0]}}
    asked = task(push, {"carries_weight": True}, modules=[3, 6], goals={"modules": True})
    assert asked.goals.names == ("modules",)
    with pytest.raises(BadInput, match=r"load_cases\[1\]\.units: must be \"SI\" to compare.*carries_weight = true"):
        task(push, {"com": {"force": [0.0, 0.0, 1.0]}}, modules=[3, 6], goals={"modules": True})
