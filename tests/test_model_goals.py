"""Goals of a task: their levels, the tasks that hold them, and what is wrong with them."""

import pytest
from nlp_cases import HOVER

from topo_search.model import BadInput, Task
from topo_search.model.files import validate
from topo_search.model.goals import Goals, Level

SI = {"units": "SI", "com": {"force": [0.0, 0.0, 8.0]}}


def task(**fields):
    return validate(Task, {"name": "front", "modules": 5, "load_cases": [HOVER], **fields}, "task")


def test_levels_are_all_combinations_the_loosest_first():
    goals = Goals(clearance=(5e-3, 1e-4), peak_input=(0.8, 1.0, 0.9))
    assert goals.names == ("clearance", "peak_input")
    expected = [(c, None, u) for c in (1e-4, 5e-3) for u in (1.0, 0.9, 0.8)]
    assert list(goals.levels) == [Level(*each) for each in expected]


def test_a_level_before_is_looser_in_one_goal():
    goals = Goals(clearance=(1e-4, 1e-3, 1e-2), stand_off=(0.2, 0.3), peak_input=(1.0, 0.9, 0.8, 0.7))
    levels = goals.levels
    assert goals.level_before(0) is None
    axes = [sorted(goals.clearance), sorted(goals.stand_off), sorted(goals.peak_input, reverse=True)]
    for number in range(1, len(levels)):
        before = goals.level_before(number)
        assert before < number
        steps = [
            axis.index(x) - axis.index(y)
            for axis, x, y in zip(axes, levels[number][:3], levels[before][:3], strict=True)
        ]
        assert sorted(steps) == [0, 0, 1]


def test_a_level_is_a_plain_task():
    asked = task(goals={"clearance": [1e-3, 1e-2], "stand_off": [0.3]}, end_effector={"mass": 0.1})
    plain = asked.at(asked.goals.levels[1])
    assert plain == task(search={"margin": 1e-2}, end_effector={"mass": 0.1, "stand_off": 0.3})
    assert asked.goals.levels[1].words == "search.margin = 0.01, end_effector.stand_off = 0.3"
    assert asked.resolve(5) == task(end_effector={"mass": 0.1}).resolve(5)


def test_no_goals_are_one_level_that_changes_nothing():
    assert Goals().names == ()
    assert Goals().levels == (Level(None, None, None),)
    assert task().at(Goals().levels[0]) == task()


def test_levels_of_what_a_design_can_do_beyond_its_task_are_set_in_its_flight():
    asked = task(
        goals={"force_reserve": [0.1, 0.0], "rotor_out": ["all", "none"], "joint_moment": [1.5, 2.0]},
        flight={"at": "tip", "directions": "horizontal", "rotor_out_torque": 0.02},
    )
    assert asked.goals.names == ("force_reserve", "rotor_out", "joint_moment")
    first, last = asked.goals.levels[0], asked.goals.levels[-1]
    assert (first.force_reserve, first.rotor_out, first.joint_moment) == (0.0, "none", 2.0)
    assert last.words == 'flight.force_reserve = 0.1, flight.rotor_out = "all", flight.joint_moment = 1.5'
    held = {"force_reserve": 0.1, "rotor_out": "all", "joint_moment": 1.5, "rotor_out_torque": 0.02}
    assert asked.at(last) == task(flight={"at": "tip", "directions": "horizontal", **held})
    assert asked.at(first) == task(flight={"at": "tip", "directions": "horizontal", "joint_moment": 2.0})


def test_levels_of_the_air_speed_are_those_of_every_region():
    regions = [{"kind": "local", "geometry": False, "speed": 9.0}, {"kind": "exterior"}]
    asked = task(goals={"speed": [1.0, 4.0]}, exposure=regions)
    assert [level.speed for level in asked.goals.levels] == [4.0, 1.0]
    assert asked.goals.levels[1].words == "exposure.speed = 1"
    strict = asked.at(asked.goals.levels[1])
    assert strict == task(exposure=[{**region, "speed": 1.0} for region in regions])
    assert strict.goals.names == ()


def test_levels_of_hinge_errors_are_survived():
    asked = task(goals={"hinge_angle_deg": [0.2, 0.0]}, tolerances={"position": 1e-3})
    loose, strict = (asked.at(level) for level in asked.goals.levels)
    assert loose == task(tolerances={"position": 1e-3})
    assert loose.flight.tolerances
    measured = task(
        flight={"tolerances": False}, goals={"hinge_angle_deg": [0.2, 0.0]}, tolerances={"position": 1e-3}
    )
    assert [measured.at(level).flight.tolerances for level in measured.goals.levels] == [False, True]
    assert strict == task(flight={"tolerances": True}, tolerances={"hinge_angle_deg": 0.2, "position": 1e-3})
    assert asked.goals.levels[1].words == "tolerances.hinge_angle_deg = 0.2"
    (none, some) = (
        task(goals={"hinge_angle_deg": [0.0, 0.1]}, flight={"tolerances": True}).at(level)
        for level in Goals(hinge_angle_deg=(0.0, 0.1)).levels
    )
    assert (none.flight.tolerances, some.flight.tolerances) == (None, True)
    assert task(**none.model_dump(exclude={"name", "modules", "load_cases"})) == none  # a plain task of its own
    with pytest.raises(BadInput, match=r"tolerances.hinge_angle_deg: must be left out if goals"):
        task(goals={"hinge_angle_deg": [0.2]}, tolerances={"hinge_angle_deg": 0.1})
    with pytest.raises(BadInput, match=r"goals.hinge_angle_deg\[0\]: must be at most 90"):
        task(goals={"hinge_angle_deg": [91.0]})
