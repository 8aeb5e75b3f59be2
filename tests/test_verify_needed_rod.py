"""A task may ask for a straight rod: then the audit judges what it otherwise tells."""

import pytest
from verify_cases import design

from topo_search.model import ResolvedTask, Status, Task, Topology
from topo_search.model.files import to_toml
from verify import audit

ONE = Topology(((-1, -1, -1),))
WALLS = {"hub": [0.28, 0.28, 0.5], "rotor_radius": 0.005, "rotor_height": 0.001}
NAME = "straight rod to the end-effector"


def judged(rod, tip, **task):
    """The verdict, and what of the rod is not clear and counts."""
    end_effector = {**task.pop("end_effector", {}), "rod": rod}
    return audit(design(ONE, {"end_effector": end_effector, **task}, hinges=(), end_effector=tip))


def test_a_clear_rod_is_clear_either_way():
    for rod in ("none", "straight"):
        result = judged(rod, (0.0, 0.0, 0.36))
        assert result.verdict is Status.CLEAR
        assert [row.status for row in result.residuals if row.name == NAME] == [Status.CLEAR] * (rod == "straight")


def test_a_rod_in_airflow_violates_where_one_is_asked_for():
    """Below the module it passes through the airflow, on a task that gives everything else up."""
    loose = {"search": {"body_clearance": False}, "end_effector": {"exclusion": False}}
    plain, asked = (judged(rod, (0.0, 0.0, -0.6), **loose) for rod in ("none", "straight"))
    assert plain.verdict is Status.CLEAR
    assert asked.verdict is Status.VIOLATED
    assert [pair.kind for pair in asked.pairs if pair.status is not Status.CLEAR] == ["rod-airflow"]


@pytest.mark.parametrize("clearance", [False, None])
def test_where_no_straight_rod_reaches_a_row_says_so(clearance):
    blocked = {
        "module": {"body": WALLS},
        "end_effector": {"exclusion": False},
        "search": {} if clearance is None else {"body_clearance": clearance},
    }
    plain, asked = (judged(rod, (0.0, 0.0, 0.1), **blocked) for rod in ("none", "straight"))
    assert not [row for row in plain.residuals if row.name == NAME]
    (row,) = (row for row in asked.residuals if row.name == NAME)
    assert (row.status, row.value) == (Status.VIOLATED, 1.0)
    assert asked.verdict is Status.VIOLATED


def test_the_reach_of_its_rod_is_judged_where_it_is_limited():
    """The nearest connector is 0.15 m beside the centre: 0.39 m from a tip that is 0.36 m above it."""
    for reach, status in ((0.4, Status.CLEAR), (0.38, Status.VIOLATED)):
        result = judged("none", (0.0, 0.0, 0.36), end_effector={"largest_reach": reach})
        (row,) = (row for row in result.residuals if row.name == "reach of the end-effector's rod")
        assert (row.status, result.verdict) == (status, status)
        assert row.derived == pytest.approx(0.39)
        assert row.value == pytest.approx(max(0.0, 0.39 - reach))
    plain = judged("none", (0.0, 0.0, 0.36))
    assert not [row for row in plain.residuals if row.name == "reach of the end-effector's rod"]


def test_where_digits_are_lost_it_is_undecided():
    result = judged("straight", (0.0, 0.0, 1e12), end_effector={"exclusion": False})
    (row,) = (row for row in result.residuals if row.name == NAME)
    assert row.status is Status.UNDECIDED


def test_what_a_design_does_not_state_was_not_asked_for():
    """A task asks for a rod of some length by default; a design of before such tasks is judged as it was."""
    task = Task.model_validate({"name": "t", "modules": 1, "load_cases": [{"carries_weight": True}]})
    assert 'rod = "straight"' in to_toml(task)
    stated = task.resolve(1)
    assert (stated.end_effector.rod, stated.largest_reach(1)) == ("straight", task.largest_reach(1))
    assert stated.largest_reach(1) is not None
    plain = stated.model_dump(mode="json")
    del plain["end_effector"]["rod"], plain["end_effector"]["largest_reach"]
    older = ResolvedTask.model_validate(plain)
    assert (older.end_effector.rod, older.largest_reach(1)) == ("none", None)
