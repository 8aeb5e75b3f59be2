"""Goals of a task: their levels, the tasks that hold them, and what is wrong with them."""

import pytest
from nlp_cases import HOVER

from topo_search.model import BadInput, Task
from topo_search.model.files import validate
from topo_search.model.search import Goals, Level

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


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"goals": {"clearance": [1e-3, 1e-3]}}, "goals.clearance: must all be different, but got [0.001, 0.001]"),
        ({"goals": {"clearance": [-1e-3]}}, "goals.clearance[0]: must be at least 0, but got -0.001"),
        ({"goals": {"clearance": 1e-3}}, "goals.clearance: must be a list, but got 0.001"),
        ({"goals": {"stand_off": [0.0]}}, "goals.stand_off[0]: must be greater than 0, but got 0.0"),
        ({"goals": {"peak_input": [0.5, 1.1]}}, "goals.peak_input[1]: must be at most 1, but got 1.1"),
        ({"goals": {"effort": [1.0]}}, "goals.effort: unknown field; valid names are"),
        (
            {"goals": {"modules": True}},
            "goals.modules: needs a range of sizes, [fewest, most], but got modules = 5",
        ),
        (
            {"goals": {"clearance": [1e-3]}, "modules": [4, 5], "load_cases": [SI, HOVER]},
            'load_cases[1].units: must be "SI" to compare efforts of several sizes, but got "weight"',
        ),
        (
            {"goals": {"modules": True}, "modules": [4, 5], "load_cases": "ten-wrenches", "task_seed": 0},
            'load_cases: units must be "SI" to compare efforts of several sizes, but got "weight"',
        ),
    ],
)
def test_what_is_wrong_with_goals_is_told(fields, fault):
    with pytest.raises(BadInput) as told:
        task(**fields)
    assert [str(each)[: len(fault)] for each in told.value.faults] == [fault]


def test_sizes_compare_in_si():
    asked = task(goals={"modules": True}, modules=[4, 6], load_cases=[SI])
    assert asked.goals.names == ("modules",)
    assert len(asked.goals.levels) == 1


def test_levels_of_what_a_design_can_do_beyond_its_task_are_set_in_its_flight():
    asked = task(
        goals={"force_reserve": [0.1, 0.0], "rotor_out": ["all", "none"], "joint_moment": [1.5, 2.0]},
        flight={"directions": "horizontal", "rotor_out_torque": 0.02},
    )
    assert asked.goals.names == ("force_reserve", "rotor_out", "joint_moment")
    first, last = asked.goals.levels[0], asked.goals.levels[-1]
    assert (first.force_reserve, first.rotor_out, first.joint_moment) == (0.0, "none", 2.0)
    assert last.words == 'flight.force_reserve = 0.1, flight.rotor_out = "all", flight.joint_moment = 1.5'
    held = {"force_reserve": 0.1, "rotor_out": "all", "joint_moment": 1.5, "rotor_out_torque": 0.02}
    assert asked.at(last) == task(flight={"directions": "horizontal", **held})
    assert asked.at(first) == task(flight={"directions": "horizontal", "joint_moment": 2.0})
    assert "torque_reserve" not in asked.model_dump_json(include={"goals"})


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
    with pytest.raises(BadInput, match=r"tolerances.hinge_angle_deg: must be left out where goals"):
        task(goals={"hinge_angle_deg": [0.2]}, tolerances={"hinge_angle_deg": 0.1})
    with pytest.raises(BadInput, match=r"goals.hinge_angle_deg\[0\]: must be at most 90"):
        task(goals={"hinge_angle_deg": [91.0]})


@pytest.mark.parametrize(
    ("flight", "goals", "fault"),
    [
        (
            {"force_reserve": 0.2},
            {"force_reserve": [0.1, 0.3]},
            r"flight.force_reserve: must be left out where goals.force_reserve has levels of it, but got 0.2",
        ),
        ({}, {"rotor_out": ["one"]}, r'goals.rotor_out\[0\]: must be "none", "hover" or "all", but got "one"'),
        ({}, {"speed": [1.0]}, r"goals.speed: needs an exposure"),
        ({}, {"speed": [0.0]}, r"goals.speed\[0\]: must be greater than 0"),
        ({}, {"joint_moment": [0.0]}, r"goals.joint_moment\[0\]: must be greater than 0"),
        ({}, {"torque_reserve": [0.1, 1e15]}, r"flight.torque_reserve: must be at most 1e\+15 N and N m"),
    ],
)
def test_levels_that_contradict_the_flight_are_refused(flight, goals, fault):
    with pytest.raises(BadInput, match=fault):
        task(flight=flight, goals=goals)
