"""Designs moved to sets of hinge angles: all else is solved again, and nothing of the task is lost."""

import math

import numpy as np
import pytest
from export_cases import random_design
from nlp_cases import solved

from nlp import solve, solve_near
from nlp.hinge_sets import _Set
from nlp.numbers.point import Point
from nlp.shortest_rod import rod_length
from topo_search.compose import NotClear, audit, round_angles
from topo_search.compose.rounding import move_hinges
from topo_search.model import Design, Status, Task, Topology
from topo_search.model.task_file import read_task


def on_steps(design: Design, step_deg: float) -> Design:
    search = design.task.search.any_angle.model_copy(update={"hinge_step_deg": step_deg})
    return design.model_copy(update={"task": design.task.model_copy(update={"search": search})})


def test_its_own_angles_give_the_same_design(solved_push: Design) -> None:
    rounded, _ = move_hinges(solved_push, hinge_step_deg=0.5)
    again, audited = move_hinges(rounded, hinge_step_deg=0.5)
    assert audited.verdict == "clear"
    assert again.objective == pytest.approx(rounded.objective, rel=1e-4)
    assert again.hinge_angles_rad == rounded.hinge_angles_rad
    assert again.task == rounded.task == solved_push.task


@pytest.mark.parametrize("step", [0.1, 0.5, 5.0])
def test_a_rounded_design_is_on_the_step_clear_and_hardly_worse(solved_push: Design, step: float) -> None:
    rounded, audited, notes = round_angles(solved_push, step)
    assert audited.verdict == "clear"
    steps = np.degrees(rounded.hinge_angles_rad) / step
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert 0.999 < rounded.objective / solved_push.objective < 1 + 0.02 * step
    assert f"rounded to {step:g} deg" in notes[0]


def test_angles_whose_modules_are_too_close_are_moved_until_they_are_clear(solved_push: Design) -> None:
    """No combination of the angles beside those of the design is clear; some a little farther are."""
    angles = _Set(on_steps(solved_push, 0.1).task, solved_push.topology)
    nearest = angles.neighbours(np.array(solved_push.hinge_angles_rad))
    assert nearest
    assert all(angles._slack(combination) >= 0 for combination in nearest)


def test_ten_modules_whose_rod_would_be_too_long_are_moved_within_its_reach() -> None:
    """The tip is as far from its rod's connector as it may be; turned hinges alone put it beyond that."""
    reach = ('end_effector.rod="straight"', "end_effector.largest_reach=0.12")
    task = read_task("push", ("modules=10", "module.connector_distance=0.22", *reach)).resolve(10)
    design = solved(solve(task, Topology.from_key("ab414041100"), starts=range(2), seed=0))
    nearest = tuple(np.radians(np.round(np.degrees(design.hinge_angles_rad))))
    unmoved = audit(design.model_copy(update={"hinge_angles_rad": nearest}))
    (beyond,) = (row.value for row in unmoved.residuals if row.name == "reach of the end-effector's rod")
    assert beyond > 0.0015
    rounded, audited, notes = round_angles(design, 1.0)
    assert audited.verdict == "clear"
    assert rounded.objective / design.objective < 1.005
    assert "rounded to 1 deg" in notes[0]


def test_a_rod_whose_mass_counts_stays_as_long_as_it_was() -> None:
    """Solved with the mass of a shorter rod, the tip moves away, and the rod becomes heavier than it is worth."""
    module = {"mass": 0.035, "arm_length": 0.046, "connector_distance": 0.065, "max_thrust": 0.25}
    module |= {"thrust_coefficient": 2.2e-8, "torque_to_thrust": 0.006}
    body = {"rotor_radius": 0.023, "hub": (0.03, 0.03, 0.02), "arm_width": 0.007, "rotor_height": 0.006}
    cases = [{"units": "SI", "carries_weight": True}, {"units": "SI", "carries_weight": True}]
    cases[0]["end_effector"] = {"force": [0.05, 0.0, 0.0]}
    tables = {"module": {**module, "body": body}, "end_effector": {"mass": 0.003}, "flight": {"defaults": False}}
    task = Task.model_validate({"name": "small", "modules": 3, "load_cases": cases, **tables}).resolve(3)
    design = solved(solve(task, Topology.from_key("a300"), starts=range(4), seed=0))
    rounded, audited, _ = round_angles(design, 0.1)
    assert audited.verdict == "clear"
    assert rounded.objective / design.objective < 1.0005
    before, after = (rod_length(Point.of(one)) for one in (design, rounded))
    assert 0.9 * before < after < 1.001 * before


def test_where_no_step_is_clear_the_answer_is_why() -> None:
    level = random_design(
        Topology.from_key("a10"), 5, {"load_cases": [{"end_effector": {"force": [50.0, 0.0, 0.0]}}]}
    )
    with pytest.raises(NotClear, match=r"no rounding to 1 deg is clear: .*; nor is one to a smaller step"):
        round_angles(level, 1.0)


def test_of_a_set_only_the_multiples_are_taken(solved_push: Design) -> None:
    on_set, _ = move_hinges(solved_push, hinge_angles_deg=tuple(2.5 * k for k in range(37)))
    asked = on_steps(on_set, 2.5)
    rounded, audited, _ = round_angles(asked, 5.0)
    assert audited.verdict == "clear"
    assert {round(math.degrees(alpha), 9) % 5 for alpha in rounded.hinge_angles_rad} == {0.0}
    uneven = asked.model_copy(
        update={
            "task": asked.task.model_copy(
                update={"search": asked.task.search.any_angle.model_copy(update={"hinge_angles_deg": (7.3, 81.1)})}
            )
        }
    )
    with pytest.raises(NotClear, match="its task allows no such angle"):
        round_angles(uneven, 10.0)


def test_rotors_that_never_stop_keep_their_least_input(solved_push: Design) -> None:
    module = solved_push.task.module.model_copy(update={"min_input": 0.002})
    asked = solved_push.model_copy(update={"task": solved_push.task.model_copy(update={"module": module})})
    assert solved_push.inputs.min() < asked.task.min_input
    found = solve_near(asked, on_steps(asked, 0.5).task)
    assert isinstance(found, Design)
    assert found.inputs.min() >= asked.task.min_input * (1 - 1e-9)
    assert all(row.status is Status.CLEAR for row in audit(found).residuals)
