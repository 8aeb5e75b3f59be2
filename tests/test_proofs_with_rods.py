"""Proofs of tasks whose rod counts, attacked: by platforms with any rod, and by designs of the solver."""

from types import SimpleNamespace

import numpy as np
import pytest
from nlp_cases import best_design, push, random_tree
from suites import few
from test_nlp_bounds_attack import random_task
from test_nlp_bounds_branch import bound_of, dual_value_in, multipliers_for, placed, rows
from test_verify_proof import any_corners, any_multipliers
from test_verify_proof import bound_of as checked_bound

from nlp import proof_root, prove_chunk
from nlp.bounds.branch.arrays import centre, reroot, to_arrays, whole_box
from nlp.units import Units
from topo_search.model import Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.corners import to_corners
from topo_search.model.end_effector import CountedRod
from topo_search.model.proof import proof_task
from verify import audit, check_chunk
from verify.kinematics import poses
from verify.proof.check import chunk_box
from verify.proof.platform import to_arrays as check_arrays

PAIR = Topology(((-1, -1, -1), (0, 0, 2)))
LIFT = {"carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}}
HOVER = {"carries_weight": True}
ROD = {"rod": "straight", "rod_mass": "included", "largest_reach": 0.6}
NEWTONS = push(
    1,
    load_cases=[{"units": "SI", "com": {"force": [0.0, 0.0, 3.0]}, "end_effector": {"force": [0.5, 0.0, 0.0]}}],
    end_effector=ROD,
)
"""No wrench grows with the rod, which only moves the centre of mass."""


def attacked(seed, flies):
    """A task whose rod counts, a tree rooted where its proof is, a box of angles or a point, and random numbers."""
    rng = np.random.default_rng([61, 80 if seed == "newtons" else seed])
    task = NEWTONS if seed == "newtons" else random_task(rng, flies=flies, counts_rod=True)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    least, most = whole_box(task, task.n)
    middle, half = rng.uniform(least, most), 10 ** rng.uniform(-4, -0.3, size=len(least)) * rng.integers(2)
    return (
        rng,
        task,
        reroot(tree, centre(task, tree)),
        np.maximum(least, middle - half),
        np.minimum(most, middle + half),
    )


def least_value(value, rng, task, tree, theta, bounded):
    """The least dual value, affine in a free end-effector, of platforms at some angles with a rod within reach.

    `value`: of a task with a rod, an end-effector and wrenches to be produced.
    """
    l_c, reach = task.module.connector_distance, task.largest_reach(task.n)
    at, least = poses(tree, theta[:3], theta[3:], l_c), np.inf
    for i, port in tree.free_connectors:
        foot = at.p[i] + l_c * at.R[i] @ PORT_DIRECTIONS[port]
        mass = rng.choice([0.0, rng.random(), 1.0, 1.0]) * task.heaviest_rod
        built = task.with_rod(CountedRod(module=i, port=port, mass=mass))
        own = to_corners(built.with_fields("flight", rotor_out_torque=None), inner=True)
        own = dict(zip(own.case_labels, own.load_cases, strict=True))
        cases = [own[label] for label in bounded.case_labels]
        wrenches = SimpleNamespace(load_cases=cases, dead_rotors=bounded.dead_rotors)
        if np.linalg.norm(placed(built, tree, at, foot)[2] - foot) > reach:
            continue  # from the fixed end-effector
        at_foot = value(built, foot, wrenches)
        slope = np.array([value(built, foot + reach * axis, wrenches) - at_foot for axis in np.eye(3)])
        tip = foot - reach * slope / (np.linalg.norm(slope) or 1.0)
        least = min(least, at_foot, value(built, tip, wrenches))
    return least


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(["newtons", *range(80)], 6))
def test_no_platform_with_a_rod_has_a_dual_value_under_the_bound_without_one(seed, flies):
    rng, task, tree, lower, upper = attacked(seed, flies)
    stated, bounded = to_arrays(task, tree), proof_task(task, "task")
    y, sigma = multipliers_for(stated, rng)
    y[:, :3] *= rng.choice([0.0, 1.0])  # with no forces to gain from, a rod's lever counts
    proven = bound_of(stated, y, sigma, lower, upper)
    for _ in range(2):
        theta = rng.uniform(lower, upper)

        def value(built, tip, wrenches, theta=theta):
            return dual_value_in(Units.of(task), built, tree, theta, tip, y, rows(stated, sigma), wrenches)

        assert least_value(value, rng, task, tree, theta, bounded) >= proven


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(["newtons", *range(80)], 6))
def test_no_platform_with_a_rod_has_a_dual_value_under_the_bound_of_the_check(seed, flies):
    rng, task, tree, lower, upper = attacked(seed, flies)
    corners = any_corners(task, rng)
    stated, bounded = check_arrays(task, tree, "task", corners), proof_task(task, "task")
    bounded = bounded.with_corners(corners) if corners else task
    F, l_arm = task.module.thrust_coefficient * task.max_input, task.module.arm_length
    units = SimpleNamespace(input=task.max_input, force=F, torque=F * l_arm, length=l_arm)
    y, sigma = any_multipliers(stated, rng)
    y[:, :3] *= rng.choice([0.0, 1.0])
    walls = list(zip(stated.wall_module, stated.wall_distance, stated.wall_normal, sigma, strict=True))
    proven = checked_bound(stated, y, sigma, lower, upper)
    for _ in range(2):
        theta = rng.uniform(lower, upper)

        def value(built, tip, wrenches, theta=theta):
            return dual_value_in(units, built, tree, theta, tip, y, walls, wrenches)

        assert least_value(value, rng, task, tree, theta, bounded) >= proven


@pytest.fixture(scope="module")
def lifted():
    """A task whose rod counts, designs with it and without its mass, and the chunks with their angles."""
    task = push(2, load_cases=[LIFT, HOVER], end_effector=ROD)
    designs = [best_design(each, PAIR, 8) for each in (task, task.with_fields("end_effector", rod_mass="ignored"))]
    boxes, home = [chunk_box(task, 2, number) for number in range(64)], list[int]()
    for design in designs:
        theta = (*design.root_orientation_rad, *design.hinge_angles_rad)
        home += [k for k, (lower, upper) in enumerate(boxes) if np.all(lower <= theta) and np.all(theta <= upper)]
    return task, *designs, dict.fromkeys((*home, 0, 63))


def test_the_gap_of_a_proof_is_what_the_mass_of_the_rod_costs(lifted):
    task, design, massless, numbers = lifted
    assert audit(design).verdict == audit(massless).verdict == "clear"
    assert design.task.end_effector.counted_rod.mass > 0.005
    assert massless.objective < 0.97 * design.objective
    cut, root = 0.99 * massless.objective, proof_root(task, PAIR)
    chunks = [prove_chunk(task, PAIR, number, cut) for number in numbers]
    assert {chunk.outcome for chunk in chunks} == {"closed"}
    assert [check_chunk(task, PAIR, root, cut, chunk).fault for chunk in chunks] == [None] * len(chunks)
    beyond = [prove_chunk(task, PAIR, number, 1.001 * massless.objective, most_boxes=5_000) for number in numbers]
    assert {chunk.outcome for chunk in beyond} == {"closed", "stuck"}


def test_corners_that_a_heavier_platform_lacks_are_not_counted_on():
    """Reserves are required around cases that carry the weight; one in newtons may not carry that of a rod."""
    hover = 1.005 * push(2).force_unit(2)
    cases = [{"units": "SI", "com": {"force": [0.0, 0.0, hover]}, "weight": 1.0}, LIFT]
    flight = {"around": "all", "torque_reserve": 0.1}
    for rod_mass, centres in (
        ("ignored", {"hover", "load case 0", "load case 1"}),
        ("included", {"hover", "load case 1"}),
    ):
        task = push(2, load_cases=cases, end_effector={**ROD, "rod_mass": rod_mass}, flight=flight)
        corners = proof_task(task, "task").corners
        assert {corner.label.split(",")[0] for corner in corners} == centres
