"""What is done to the solver's point before it becomes a design: rounding errors go, nothing else changes."""

import math

import numpy as np
import pytest
from nlp_cases import hover, push, random_point, random_tree

from nlp.evaluation import correct, violations
from nlp.numbers.geometry import root_angles, root_rotation, rotation
from nlp.program import AssembledProgram
from nlp.requirements.balances import WRENCH_TOLERANCE
from nlp.starts.random_starts import draw, generator
from topo_search.model import Topology

CASES = {
    "splayed modules": (push(5), "a11210"),
    "two modules in one plane": (hover(2, module={"connector_distance": 0.22}), "a10"),
    "three modules in one plane": (hover(3, module={"connector_distance": 0.22}), "a110"),
    "the ablation": (hover(2, search={"interference": "separation"}), "a10"),
}


def residual(point):
    return max(check.scaled for check in violations(point) if check.name.startswith("load case"))


@pytest.mark.parametrize("name", CASES)
def test_a_correction_costs_nothing(name):
    """Parallel axes make sideways force all but impossible: a rounding error there must not move the inputs."""
    task, key = CASES[name]
    topology = Topology.from_key(key)
    program = AssembledProgram(task, topology)
    solved_exactly = 0
    for s in range(6):
        reached = program.solve(draw(task, topology, generator(task, topology, s, seed=0)))
        result = program.polish(reached.point)
        if result.status != "Solve_Succeeded":
            continue
        solved_exactly += 1
        done = correct(result.point)
        assert residual(done) <= max(residual(result.point) + 1e-13, 1e-12)  # rounding
        assert np.sum(done.u**2) == pytest.approx(np.sum(result.point.u**2), rel=1e-8)
        np.testing.assert_allclose(done.u, result.point.u, rtol=0, atol=1e-6 * result.point.u.max())
    assert solved_exactly


def test_corrected_inputs_are_on_the_balance_and_inside_their_bounds():
    task, topology = push(5), Topology.from_key("a11210")
    point = AssembledProgram(task, topology).solve(draw(task, topology, generator(task, topology, 0, seed=0))).point
    u_max = task.module.max_input(task.gravity)
    rough = type(point)(task, topology, point.root, point.alpha, point.tip, point.u * (1 + 1e-6))
    done = correct(rough)
    assert residual(rough) > 1e-7
    assert residual(done) < WRENCH_TOLERANCE
    assert done.u.min() >= 0.0
    assert done.u.max() <= u_max


def test_corrected_root_angles_are_in_their_ranges_and_turn_nothing():
    rng = np.random.default_rng(0)
    topology = random_tree(4, rng, aligned=True)
    point = random_point(push(4), topology, rng)
    wound = type(point)(point.task, topology, np.array([9.0, 2.5, -8.0]), point.alpha, point.tip, point.u)
    done = correct(wound)
    assert np.all(np.abs(done.root) <= [math.pi, math.pi / 2, math.pi])
    np.testing.assert_allclose(done.poses[0], wound.poses[0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("alpha_0", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("short", [0.0, 1e-12, 1e-9, 1e-6])
def test_root_angles_of_a_rounded_rotation_at_the_gimbal_lock(alpha_0, short):
    """Rounding decides psi there; alpha_1 must make up for it."""
    axis = np.array([0.36, -0.48, 0.8])
    turn = rotation(axis, 1.0)
    R = turn @ (turn.T @ root_rotation([0.7, alpha_0 * (1 - short), -1.9]))
    np.testing.assert_allclose(root_rotation(root_angles(R)), R, rtol=0, atol=1e-12)
