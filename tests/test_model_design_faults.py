"""A design file of another program is read if it describes a platform, and answered field by field if not."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wording import told

from topo_search.model import BadInput, Design
from topo_search.model.files import to_json, validate

N = 3
DATA: dict[str, Any] = {
    "format": "topo-search/design",
    "version": 1,
    "task": {
        "name": "lift",
        "modules": N,
        "load_cases": [
            {"units": "SI", "com": {"force": [0.0, 0.0, 7.0]}},
            {"units": "SI", "end_effector": {"force": [0.0, 0.0, 7.0]}, "weight": 2.0},
        ],
    },
    "topology": [[-1, -1, -1], [0, 0, 2], [1, 1, 3]],
    "topology_key": "a120",
    "root_module": 0,
    "root_orientation_rad": [0.0, 0.1, 0.2],
    "hinge_angles_rad": [0.3, -0.3],
    "end_effector_m": [0.5, 0.0, 0.0],
    "rotor_speeds_squared": [[1.0e6] * (4 * N), [2.0e6] * (4 * N)],
    "objective": 1.08e14,
    "lower_bound": 1.0e14,
    "gap": 0.074,
    "solver": {"status": "Solve_Succeeded", "seconds": 1.5},
}


def changed(path: tuple[str | int, ...], value: Any) -> dict[str, Any]:
    data = copy.deepcopy(DATA)
    place: Any = data
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    return data


def messages(data: Any) -> list[str]:
    with pytest.raises(BadInput) as caught:
        validate(Design, data, "design.json")
    return [str(fault) for fault in caught.value.faults]


def test_a_foreign_design_is_read() -> None:
    design = validate(Design, DATA, "design.json")
    assert design.topology.n == N
    assert design.task.load_cases[1].weight == 2.0
    assert design.task.search.body_clearance == pytest.approx(0.30)  # defaults left out are filled in
    assert design.inputs.shape == (2, N, 4)
    assert json.loads(to_json(design))["solver"] == DATA["solver"]


@pytest.mark.parametrize("field", ["topology_key", "lower_bound", "gap", "solver"])
@pytest.mark.parametrize("value", ["\ud800", float("nan"), {"x": [{}]}])
def test_an_informative_field_is_never_a_reason_to_refuse(field: str, value: Any) -> None:
    design = validate(Design, changed((field,), value), "design.json")
    assert validate(Design, json.loads(to_json(design)), "again") == design
    got = getattr(design, field)
    assert got is None or got == value


@pytest.mark.parametrize(
    "field", ["format", "version", "topology_key", "lower_bound", "gap", "solver", "root_module"]
)
def test_informative_fields_may_be_missing(field: str) -> None:
    data = {name: value for name, value in DATA.items() if name != field}
    assert validate(Design, data, "design.json").topology.n == N


def test_a_file_that_says_nothing_of_the_rod_did_not_ask_for_one() -> None:
    """Files from before the default was a straight rod are judged as they were."""
    silent, asking = DATA, changed(("task", "end_effector"), {"rod": "straight", "largest_reach": 2.0})
    told = [validate(Design, data, "x.json").task.end_effector for data in (silent, asking)]
    assert [(one.rod, one.largest_reach) for one in told] == [("none", False), ("straight", 2.0)]
    written = json.loads(to_json(validate(Design, asking, "x.json")))
    assert validate(Design, written, "x.json").task.end_effector == told[1]


def test_fields_of_another_program_are_ignored() -> None:
    assert validate(Design, {**DATA, "author": {"name": "x"}}, "a") == validate(Design, DATA, "b")


def test_a_family_of_load_cases_is_drawn_again() -> None:
    task = {"name": "t", "modules": N, "load_cases": "ten-wrenches", "task_seed": 4}
    data = {**DATA, "task": task, "rotor_speeds_squared": [[1.0] * 12] * 10}
    design = validate(Design, data, "design.json")
    assert len(design.task.load_cases) == 10
    assert {case.units for case in design.task.load_cases} == {"SI"}


ROWS = "must be a list of [parent, parent_port, child_port] in whole numbers, but got"


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (("version",), 2, "version: must be 1, but got 2"),
        (("format",), "x", 'format: must be "topo-search/design", but got "x"'),
        # topology
        (("topology",), "a120", f'topology: {ROWS} "a120"'),
        (("topology",), [], "topology: a topology must have at least one module, but got none"),
        (("topology", 1), [0, True, 2], f"topology: {ROWS} [0, true, 2] for module 1"),
        (("topology", 1), [1, 0, 2], "topology: `0 <= parent < 1` must hold in joint 1, but got parent 1"),
        (("topology", 2), [1, 4, 3], "topology: the parent port must be 0, 1, 2 or 3 in joint 2, but got 4"),
        (("topology", 2), [0, 0, 2], "topology: port 0 of module 0 carries one joint, but joints 1 and 2 use..."),
        # counts
        (("task", "modules"), 4, "task.modules: must be the number of rows of `topology`, 3, but got 4"),
        (("task", "modules"), [3, 4], "task: `modules` must be one number here, but got [3, 4]"),
        (("hinge_angles_rad",), [0.1], "hinge_angles_rad: must have one angle per non-root module, 2, but got..."),
        (("rotor_speeds_squared",), [[1.0] * 12], "rotor_speeds_squared: must have one list per load case, 2..."),
        (("rotor_speeds_squared", 1), [1.0] * 11, "rotor_speeds_squared[1]: must have one value per rotor..."),
        (("rotor_speeds_squared", 0, 3), float("inf"), "rotor_speeds_squared[0][3]: must be a finite number..."),
        (("hinge_angles_rad", 0), "0.3", 'hinge_angles_rad[0]: must be a number, but got "0.3"'),
        # the task inside
        (("task", "gravty"), 3, "task.gravty: unknown field; did you mean `gravity`?"),
    ],
)
def test_a_fault_gets_one_message(path: tuple[str | int, ...], value: Any, expected: str) -> None:
    found = messages(changed(path, value))
    assert told(found, [expected]), found


@pytest.mark.parametrize(
    "field",
    [
        "task",
        "topology",
        "root_orientation_rad",
        "hinge_angles_rad",
        "end_effector_m",
        "rotor_speeds_squared",
        "objective",
    ],
)
def test_what_describes_the_platform_may_not_be_missing(field: str) -> None:
    data = {name: value for name, value in DATA.items() if name != field}
    assert messages(data) == [f"{field}: is required, but missing"]


def test_another_kind_of_file_is_told_so_and_no_more() -> None:
    assert messages({"format": "topo-search/audit", "version": 1}) == [
        'format: must be "topo-search/design", but got "topo-search/audit"'
    ]


def test_several_faults_are_told_at_once() -> None:
    data = {**DATA, "hinge_angles_rad": [], "rotor_speeds_squared": [[1.0]]}
    assert [message.split(":")[0] for message in messages(data)] == [
        "hinge_angles_rad",
        "rotor_speeds_squared",
        "rotor_speeds_squared[0]",
    ]


leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)
anything = st.recursive(
    leaves, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
)


@given(st.sampled_from(sorted(DATA)), anything)
def test_a_spoilt_field_is_read_or_told(field: str, value: Any) -> None:
    try:
        design = validate(Design, {**DATA, field: value}, "design.json")
    except BadInput as error:
        roots = {fault.path.split(".")[0].split("[")[0] for fault in error.faults}
    else:
        roots = set()
        assert validate(Design, json.loads(to_json(design)), "again") == design
    assert roots <= {field}
    if field in ("topology_key", "lower_bound", "gap", "solver"):
        assert not roots


def test_angles_and_inputs_out_of_bounds_are_for_the_audit_to_judge() -> None:
    data = changed(("hinge_angles_rad", 0), 3.0)
    data["rotor_speeds_squared"][0][0] = -1.0
    data["objective"] = 0.0
    np.testing.assert_array_equal(validate(Design, data, "design.json").inputs[0, 0], [-1.0, 1e6, 1e6, 1e6])


def test_nested_where_a_number_belongs(tmp_path: Path) -> None:
    deep: Any = 0.0
    for _ in range(100_000):
        deep = [deep]
    (message,) = messages({**DATA, "objective": deep})
    assert message.startswith("objective: must be a number, but got [[[")
