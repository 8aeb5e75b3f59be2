"""The checker of proofs, attacked: by points of boxes, by cuts that are too high, by records that were changed."""

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from nlp_cases import HOVER, push, random_tree
from suites import few
from test_nlp_bounds_attack import random_task
from test_nlp_bounds_branch import clearance_missed, dual_value_in, seen

from nlp import proof_root, prove_chunk, solve
from nlp.bounds.branch import arrays, search
from nlp.bounds.branch import proof as branch
from nlp.bounds.branch.arrays import to_arrays, whole_box
from nlp.bounds.branch.crowded import EVERYWHERE, crowding
from nlp.units import Units
from topo_search.model import Chunk, Design, Topology
from topo_search.model.files import read_json
from topo_search.model.proof import chunk_count, proof_task
from verify import check_chunk
from verify.bodies import ConeSphere, clearances
from verify.kinematics import poses
from verify.proof import arcs, ascent, crowded, dual
from verify.proof import replay as ends
from verify.proof.check import chunk_box
from verify.proof.platform import effort_unit, reroot
from verify.proof.platform import to_arrays as check_arrays
from verify.proof.platform import whole_box as checked_box
from verify.proof.points import empty_points, fill_point, fill_slopes, is_turned_by

PAIR = Topology(((-1, -1, -1), (0, 0, 2)))
PUSH = {"end_effector": {"force": [0.25, 0.0, 0.75]}}
WALL = {"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0]}]}


def framed(stated, lower, upper):
    """Triangles of a box, and frames of all modules for each combination of their vertices."""
    triangles, frames = np.zeros((len(lower), 3, 2)), arcs.empty_frames(stated, 3)
    arcs.fill_triangles(lower, upper, 0, triangles)
    arcs.fill_frames(stated, triangles, 3, frames)
    return triangles, frames


def framed_middle(stated, theta):
    points = np.stack([np.cos(theta), np.sin(theta)], axis=-1)[:, None]
    frames = arcs.empty_frames(stated, 1)
    arcs.fill_frames(stated, points, 1, frames)
    return points, frames


def bound_of(stated, y, sigma, lower, upper):
    triangles, frames = framed(stated, lower, upper)
    return dual.bound(stated, y, sigma, triangles, frames, dual.bound_workspace(stated, len(frames.p)))


def dual_value(task, tree, theta, tip, y, walls, corners=()):
    """The dual function in units of `dual`: the largest input, its thrust, and arm lengths."""
    F, l_arm = task.module.thrust_coefficient * task.max_input, task.module.arm_length
    units = SimpleNamespace(input=task.max_input, force=F, torque=F * l_arm, length=l_arm)
    bounded = proof_task(task, "task").with_corners(corners) if corners else task
    return dual_value_in(units, task, tree, theta, tip, y, walls, bounded)


def any_multipliers(stated, rng):
    y = rng.normal(size=(len(stated.f), 6)) * 10 ** rng.uniform(-2, 1)
    sigma = np.maximum(0.0, rng.normal(size=len(stated.wall_normal)))
    ascent.enforce_condition(stated, empty_points(stated, 1, 0), y, sigma)
    return y, sigma


def any_corners(task, rng):
    """A few of the corners."""
    count = len(proof_task(task, "task").load_cases) - len(task.load_cases)
    return tuple(sorted(rng.choice(count, size=min(count, 5), replace=False).tolist()))


def any_tree(rng, *, flies=False):
    task = random_task(rng, flies=flies)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    return task, tree if task.search.root == "paper" else reroot(tree, int(rng.integers(task.n)))


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(40), 8))
def test_no_point_of_a_box_has_a_dual_value_under_its_bound(seed, flies):
    rng = np.random.default_rng([41, seed])
    task, tree = any_tree(rng, flies=flies)
    corners = any_corners(task, rng)
    stated = check_arrays(task, tree, "task", corners)
    least, most = checked_box(task, task.n)
    middle, half = rng.uniform(least, most), 10 ** rng.uniform(-3, -0.1, size=len(least))
    lower, upper = np.maximum(least, middle - half), np.minimum(most, middle + half)
    y, sigma = any_multipliers(stated, rng)
    walls = list(zip(stated.wall_module, stated.wall_distance, stated.wall_normal, sigma, strict=True))
    proven = bound_of(stated, y, sigma, lower, upper)
    for draw in range(60):
        theta = rng.uniform(lower, upper)
        if draw % 3 == 0:
            theta = np.where(rng.random(len(theta)) < 0.5, lower, upper)
        tip = rng.normal(size=3) * task.module.arm_length * 10 ** rng.uniform(-1, 1)
        assert dual_value(task, tree, theta, tip, y, walls, corners) >= proven


@pytest.mark.parametrize("half", [0.01, 0.1, 0.7])
def test_the_middle_of_an_arc_has_no_dual_value_under_the_bound_of_the_arc(half):
    """Multipliers along one thrust axis: the rotors cost least where a hinge turns theirs towards it."""
    task = push(2, load_cases=[HOVER])
    stated = check_arrays(task, PAIR)
    y = np.zeros((len(stated.f), 6))
    y[:, :3] = 2 * stated.weight[:, None] * stated.f / 8
    ends = np.array([0.0, 0.0, 0.0, half])
    proven = bound_of(stated, y, np.zeros(0), -ends, ends)
    middle, end = (dual_value(task, PAIR, theta, np.zeros(3), y, ()) for theta in (0 * ends, ends))
    assert proven <= middle < end


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(15), 4))
def test_the_bound_of_a_point_is_its_dual_value_but_for_what_an_audit_lets_pass(seed, flies):
    rng = np.random.default_rng([42, seed])
    task, tree = any_tree(rng, flies=flies)
    corners = any_corners(task, rng)
    stated = check_arrays(task, tree, "task", corners)
    theta, (y, sigma) = rng.uniform(*checked_box(task, task.n)), any_multipliers(stated, rng)
    walls = zip(stated.wall_module, stated.wall_distance, stated.wall_normal, sigma, strict=True)
    true = dual_value(task, tree, theta, np.zeros(3), y, walls, corners)
    proven = bound_of(stated, y, sigma, theta, theta)
    lever = 2 * stated.l_c * tree.n + 2
    size = np.abs(stated.f).sum() + np.abs(stated.t).sum() + lever * (np.abs(stated.h).sum() + tree.n + sigma.sum())
    assert 0 < true - proven < 1e-4 * (1 + np.linalg.norm(y, axis=1).sum()) * (1 + lever) * size


@pytest.mark.parametrize(
    ("seed", "rule"), [*few(((s, "airflow") for s in range(20)), 4), *few(((s, "parts") for s in range(10)), 1)]
)
def test_two_modules_are_too_near_at_every_point_of_a_box_that_is_said_to_be_so(seed, rule):
    rng = np.random.default_rng([43, seed])
    parts = {"interference": "parts", "body_clearance": False} if rule == "parts" else {}
    least = 4 if parts else 2  # of bolted modules no parts are in the way
    task = push(int(rng.integers(least, 6)), search={"connectors": "any", **parts})
    tree = random_tree(task.n, rng, aligned=False)
    stated, (least, most), found = check_arrays(task, tree), checked_box(task, task.n), 0
    for _ in range(60):
        middle, half = rng.uniform(least, most), 10 ** rng.uniform(-2, -0.3)
        lower, upper = np.maximum(least, middle - half), np.minimum(most, middle + half)
        triangles, _ = framed(stated, lower, upper)
        _, at = framed_middle(stated, (lower + upper) / 2)
        if crowded.find_crowded_pair(stated, triangles, at, np.zeros(2, np.int64)):
            found += 1
            draws = 10 if rule == "airflow" else 2
            assert all(clearance_missed(task, tree, rng.uniform(lower, upper)) for _ in range(draws))
    assert found > 0


@pytest.mark.parametrize("seed", few(range(20), 5))
def test_no_two_points_of_modules_are_farther_apart_than_is_said(seed):
    rng = np.random.default_rng([44, seed])
    task = push(5, search={"connectors": "any"})
    tree = random_tree(5, rng, aligned=False)
    stated, (least, most) = check_arrays(task, tree), checked_box(task, 5)
    middle, half = rng.uniform(least, most), 10 ** rng.uniform(-3, -0.2, size=7)
    lower, upper = np.maximum(least, middle - half), np.minimum(most, middle + half)
    triangles, _ = framed(stated, lower, upper)
    for i in range(5):
        for j in range(i):
            down = rng.uniform(0, stated.length, size=2)
            q_i, q_j = (*rng.normal(size=2), -down[0]), (0.0, 0.0, -down[1])
            limit = crowded.largest_squared_distance(stated, triangles, i, j, (q_i, q_j))
            for _ in range(20):
                at = poses(tree, (0.0, 0.0, 0.0), rng.uniform(lower, upper)[3:], stated.l_c)
                apart = at.p[i] + at.R[i] @ q_i - at.p[j] - at.R[j] @ q_j
                assert apart @ apart <= limit


def test_prover_and_checker_ask_for_the_solvers_distances_where_the_proof_is_about_them():
    """Envelopes, and then centres, that clear each other by less than the solver keeps, but do clear each other."""
    task, three = push(3), Topology.from_key("a300")
    air, l_c = task.module.envelope, task.module.connector_distance

    def clearance_at(angle):
        at = poses(three, (0.0, 0.0, 0.0), (angle, 0.0), l_c)
        cones = [
            ConeSphere(p, -air.length * z, air.start_radius, air.growth) for p, z in zip(at.p, at.z, strict=True)
        ]
        return clearances([(cones[0], cones[1])]).d[0]

    assert clearance_at(1.2) * clearance_at(-1.2) < 0
    low, high = sorted((1.2, -1.2), key=clearance_at)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if clearance_at(middle) < task.search.margin / 2 else (low, middle)
    far = 1.2 if clearance_at(1.2) > 0 else -1.2
    theta = np.array([0.0, 0.0, 0.0, high, -far])
    assert 0 < clearance_at(high) < task.search.margin
    assert [crowded_at(task, three, theta, problem) for problem in ("task", "solver")] == [
        (False,) * 2,
        (True,) * 2,
    ]
    stated = [check_arrays(task, three, problem) for problem in ("task", "solver")]
    kept = math.sqrt(task.centre_distance**2 + 2 * task.centre_distance * task.search.margin)
    assert [each.centre_distance for each in stated] == pytest.approx([3.0, kept / 0.1])


def crowded_at(task, tree, theta, problem):
    """Whether prover and checker find two modules too close to each other at a point."""
    stated = check_arrays(task, tree, problem)
    triangles, _ = framed(stated, theta, theta)
    _, at = framed_middle(stated, theta)
    other = to_arrays(task, tree, problem)
    return (
        crowding(other, seen(other, theta, theta), np.zeros(len(theta))) == EVERYWHERE,
        bool(crowded.find_crowded_pair(stated, triangles, at, np.zeros(2, np.int64))),
    )


@pytest.mark.parametrize("seed", few(range(20), 5))
def test_wrenches_change_with_every_angle_as_is_said(seed):
    rng = np.random.default_rng([45, seed])
    task, tree = any_tree(rng)
    stated, theta = check_arrays(task, tree), rng.uniform(-1.5, 1.5, size=tree.n + 2)

    def wrenches(theta):
        points, frames = framed_middle(stated, theta)
        at = empty_points(stated, 1, len(theta))
        fill_point(stated, points, frames, at, 0)
        fill_slopes(stated, points, frames, np.zeros(len(theta)), at)
        return at.a[0], at.slopes.beta

    (_, change), step = wrenches(theta), 1e-6
    for angle in range(len(theta)):
        by = step * np.eye(len(theta))[angle]
        measured = (wrenches(theta + by)[0] - wrenches(theta - by)[0]) / (2 * step)
        for j in range(4 * tree.n):
            above, path = j // 4, set[int]()
            while above > 0:
                path.add(above + 2)
                above = tree.parents[above]
            assert is_turned_by(stated, angle, j // 4) == (angle < 3 or angle in path)
            assert measured[j] == pytest.approx(change[angle, j], abs=1e-7 * tree.n)


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(10), 3))
def test_the_dual_function_changes_with_angles_and_its_slopes_with_multipliers_as_is_said(seed, flies):
    rng = np.random.default_rng([50, seed])
    task, tree = any_tree(rng, flies=flies)
    stated = check_arrays(task, tree, "task", any_corners(task, rng))
    theta, (y, sigma) = rng.uniform(-1.5, 1.5, size=tree.n + 2), any_multipliers(stated, rng)
    at = empty_points(stated, 1, len(theta))

    def looked_at(theta, y):
        points, frames = framed_middle(stated, theta)
        fill_point(stated, points, frames, at, 0)
        fill_slopes(stated, points, frames, np.full(len(theta), 0.1), at)
        ascent.start(stated, at, np.full(len(theta), 0.1), 1.0)
        ascent.set_kink_width(stated, at, 0.1)  # without kinks
        ascent.smoothed_value(stated, at, y, sigma, 1.0)
        return at.D[0], at.slopes.g.copy(), at.slopes.dg_dy.copy()

    (_, slope, steep), step = looked_at(theta, y), 1e-6
    size = 1 + np.abs(y).sum() ** 2 + np.abs(y).sum() + sigma.sum()
    for angle in range(len(theta)):
        by = step * np.eye(len(theta))[angle]
        measured = (looked_at(theta + by, y)[0] - looked_at(theta - by, y)[0]) / (2 * step)
        assert measured == pytest.approx(slope[angle], abs=1e-5 * size)
    by = step * rng.normal(size=y.shape)
    measured = (looked_at(theta, y + by)[1] - looked_at(theta, y - by)[1]) / 2
    assert measured == pytest.approx((steep * by).sum(axis=(1, 2)), abs=1e-5 * step * size)


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(10), 3))
def test_multipliers_for_points_get_better_by_what_the_bounds_of_points_are(seed, flies):
    rng = np.random.default_rng([49, seed])
    task, tree = any_tree(rng, flies=flies)
    stated, theta = (
        check_arrays(task, tree, "task", any_corners(task, rng)),
        rng.uniform(-1.5, 1.5, size=(5, tree.n + 2)),
    )
    at, (y, sigma) = empty_points(stated, len(theta), 0), any_multipliers(stated, rng)
    for v, one in enumerate(theta):
        fill_point(stated, *framed_middle(stated, one), at, v)
    ascent.start(stated, at, np.full(tree.n + 2, 0.1), 1.0)
    ascent.set_kink_width(stated, at, 1e-12)
    ascent.smoothed_value(stated, at, y, sigma, 0.1)
    lost = (1e-3 + stated.torque_error.max()) * (1 + np.abs(y).sum() + sigma.sum())  # to the audit's tolerance
    assert [bound_of(stated, y, sigma, one, one) for one in theta] == pytest.approx(at.D, abs=lost)
    y[:], sigma[:] = 0.0, 0.0
    y[:, :3] = stated.weight[:, None] * stated.f / (2 * tree.n)
    ascent.set_kink_width(stated, at, 0.1)
    first = ascent.smoothed_value(stated, at, y, sigma, 0.1)
    assert ascent.maximize(stated, at, y, sigma, 0.1, math.inf, math.inf, 20) > first
    assert dual.residual(stated, y, sigma) == pytest.approx((0, 0, 0), abs=1e-9 * (1 + np.abs(y).sum()))
    assert np.all(sigma >= 0)


def flying_design(name):
    """The numbers of a design's task about the solver, its angles, and what it costs."""
    design = read_json(Design, Path(__file__).parent / "designs" / f"{name}.json")
    task = design.task
    corners = range(len(proof_task(task, "solver").load_cases) - len(task.load_cases))
    theta = np.array([*design.root_orientation_rad, *design.hinge_angles_rad])
    return (
        check_arrays(task, design.topology, "solver", tuple(corners)),
        theta,
        design.objective / effort_unit(task),
    )


def settled(stated, lower, upper, cut):
    """The replay of a record that says that a bound excludes a box."""
    return ends.replay(stated, lower, upper, cut, np.frombuffer(bytes(1), np.uint8))


@pytest.mark.parametrize("name", ["wall-push", "window-cleaning", "survives-a-rotor"])
def test_a_flying_design_has_a_bound_just_under_what_it_costs(name):
    stated, theta, cost = flying_design(name)
    assert settled(stated, theta, theta, 0.995 * cost).outcome == ends.VALID
    assert settled(stated, theta, theta, 1.0001 * cost).outcome == ends.NOT_BOUNDED


def test_a_box_where_a_reserve_is_out_of_reach_is_excluded_whole():
    """4,000 cuts did not settle it with multipliers of the middles."""
    stated, _, cost = flying_design("wall-push")
    lower = np.radians([-45.0, -19.6875, 19.6875, -45.0, 33.75])
    found = settled(stated, lower, lower + np.radians([5.625, 2.8125, 2.8125, 5.625, 5.625]), 0.95 * cost)
    assert (found.outcome, found.halved) == (ends.VALID, 0)


LEAST = {"module": {"min_input": 0.2, "max_thrust_to_weight": 3.0}}  # half the weight with the end-effector
DEAD = {"flight": {"rotor_out": "hover", "rotor_out_torque": 0.0}}


@pytest.mark.parametrize(("thrust", "possible"), [(0.4, False), (0.51, True)])
def test_rotors_run_at_their_least_input_in_bounds(thrust, possible):
    assert excludes({"com": {"force": [0.0, 0.0, thrust]}}) == (False, False)
    assert excludes({"com": {"force": [0.0, 0.0, thrust]}}, **LEAST) == (not possible, not possible)


def test_a_dead_rotor_is_at_rest_in_bounds():
    assert excludes(HOVER) == (False, False)
    assert excludes(HOVER, **DEAD) == (True, True)
    assert excludes(HOVER, **DEAD, search={"peak_input": 0.9}) == (False, False)  # failures may use the full input


def test_what_is_missed_by_little_is_out_of_reach_for_the_check_too():
    """Multipliers must be long: 1 % of the weight is missing with a dead rotor."""
    loads = [{"end_effector": {"force": [0.5, 0.0, 0.6], "torque": [0.0, 0.3, 0.2]}}, HOVER]
    task = push(2, load_cases=loads, module={"min_input": 0.08, "max_thrust_to_weight": 3.0}, **DEAD)
    theta, cut = np.radians([-0.1758, 0.0, 47.46, -75.94]), 3.77
    for corners in (range(8), ()):  # and without it 0.4 % of the first load case
        stated = check_arrays(task, PAIR, "task", tuple(corners))
        assert settled(stated, theta - 1e-7, theta + 1e-7, cut).outcome == ends.VALID


@pytest.mark.parametrize("half", [1e-9, 1e-5, 1e-4])
def test_an_effort_just_over_the_cut_is_seen_where_a_wrench_is_missed_by_a_thousandth(half):
    """The effort without what is missed is 0.07 % less than the cut: only long multipliers exceed it."""
    task = push(3)
    stated = check_arrays(task, reroot(Topology.from_key("a300"), 1), "task", ())
    theta = np.array([1.10686301, -0.42061034, 0.68405207, -1.18406614, 1.1088531])
    assert settled(stated, theta - half, theta + half, 11.236).outcome == ends.VALID


def excludes(case, **fields):
    """Verdicts of prover and check on a level module, with a cut at ten times the effort of its thrust."""
    task = push(1, load_cases=[case], **fields)
    tree, level = Topology(((-1, -1, -1),)), np.zeros(3)
    problem, (*_, thrust) = to_arrays(task, tree), task.load_cases[0].at_com.force
    cut = 40 * (thrust / Units.of(task).force) ** 2
    found = search.search(problem, level - 1e-6, level + 1e-6, cut, 1)
    corners = range(len(problem.loads.f) - 1)
    stated, scale = check_arrays(task, tree, "task", tuple(corners)), arrays.effort_unit(task) / effort_unit(task)
    replayed = settled(stated, level - 1e-6, level + 1e-6, cut * scale)
    return found.outcome == search.CLOSED, replayed.outcome == ends.VALID


@pytest.fixture(scope="module")
def pair():
    """Two modules, a design near their best, and the proof of a cut under it."""
    task = push(2, load_cases=[PUSH, HOVER])
    design = solve(task, PAIR, starts=range(24), seed=0)
    assert isinstance(design, Design)
    cut = 0.99 * design.objective
    root = proof_root(task, PAIR)
    return task, root, design, cut, [prove_chunk(task, PAIR, number, cut) for number in range(chunk_count(2))]


KINDS = {
    "a reserve and a wall": {"exposure": [WALL], "flight": {"torque_reserve": 0.2}},
    "a dead rotor": DEAD,
    "an error of the centre of mass": {"flight": {"com_error": 0.005}},
    "a least input": {"module": {"min_input": 0.1, "max_thrust_to_weight": 4.0}},
    "airflow that merges": {"search": {"interference": "parts", "body_clearance": False}},
    "a set of angles": {"search": {"hinge_step_deg": 15}},
    "wrenches between two": {"load_cases": [{**PUSH, "vertices": [{"force": [0.1, 0.0, 0.8]}]}, HOVER]},
}


@pytest.mark.parametrize("kind", few(KINDS, ["a dead rotor", "a least input"]))
def test_no_start_undercuts_a_proof_of_any_kind_and_a_cut_above_the_best_is_refused(kind):
    task = push(2, **{"load_cases": [PUSH, HOVER]} | KINDS[kind])
    best = solve(task, PAIR, starts=range(24), seed=0)
    root, numbers = proof_root(task, PAIR), range(chunk_count(2))
    for cut, holds in ((0.99 * best.objective, True), (1.002 * best.objective, False)):
        chunks = [prove_chunk(task, PAIR, number, cut, "solver", most_boxes=20_000) for number in numbers]
        assert {chunk.outcome for chunk in chunks} == ({"closed"} if holds else {"closed", "stuck"})
        closed = [chunk for chunk in chunks if chunk.outcome == "closed"]
        assert not any(check_chunk(task, PAIR, root, cut, chunk, "solver").fault for chunk in closed)
    for seed in range(1, 6):
        other = solve(task, PAIR, starts=range(8), seed=seed)
        assert not isinstance(other, Design) or other.objective >= 0.99 * best.objective


def longest(chunks):
    """The chunk with most boxes that are bounded."""
    return max(chunks, key=lambda chunk: chunk.record.count(0))


def test_a_proof_is_checked(pair):
    task, root, _, cut, chunks = pair
    checked = [check_chunk(task, PAIR, root, cut, chunk) for chunk in chunks]
    assert all(each.fault is None for each in checked)
    assert [each.boxes for each in checked] == [chunk.boxes for chunk in chunks]


def test_a_cut_above_the_best_is_refused_with_the_box(pair):
    task, root, design, _, chunks = pair
    faults = [check_chunk(task, PAIR, root, 1.002 * design.objective, chunk).fault for chunk in chunks]
    refused = [fault for fault in faults if fault is not None]
    assert refused
    assert all("no bound excludes it (psi " in fault for fault in refused)


@pytest.mark.parametrize("problem", ["task", "solver"])
def test_a_proof_where_airflow_may_merge_is_checked(problem):
    task, tree = push(3, search={"interference": "parts"}), Topology.from_key("a300")
    design = solve(task, tree, starts=range(8), seed=0)
    root, cut, numbers = proof_root(task, tree), 0.9 * design.objective, range(5, chunk_count(3), 23)
    chunks = [prove_chunk(task, tree, number, cut, problem=problem) for number in numbers]
    assert {chunk.outcome for chunk in chunks} == {"closed"}
    assert [check_chunk(task, tree, root, cut, chunk, problem).fault for chunk in chunks] == [None] * len(chunks)


@pytest.fixture(scope="module")
def flying():
    """Two modules with a reserve of torque before a wall, a design, and some chunks of a proof, its own first."""
    task = push(2, load_cases=[PUSH, HOVER], exposure=[WALL], flight={"torque_reserve": 0.2})
    design = solve(task, PAIR, starts=range(8), seed=0)
    cut, theta = 0.9 * design.objective, (*design.root_orientation_rad, *design.hinge_angles_rad)
    boxes = [chunk_box(task, 2, number) for number in range(chunk_count(2))]
    home = next(k for k, (lower, upper) in enumerate(boxes) if np.all(lower <= theta) and np.all(theta <= upper))
    numbers = dict.fromkeys((home, *range(0, 64, 7)))
    return task, design, cut, [prove_chunk(task, PAIR, number, cut) for number in numbers]


def refused(task, cut, chunks):
    return [fault for chunk in chunks if (fault := check_chunk(task, PAIR, 0, cut, chunk).fault) is not None]


def test_a_proof_with_a_wall_and_a_reserve_is_checked(flying):
    task, _, cut, chunks = flying
    assert {chunk.outcome for chunk in chunks} == {"closed"}
    assert any(chunk.corners for chunk in chunks)
    assert not refused(task, cut, chunks)


def test_a_cut_above_the_best_with_a_wall_and_a_reserve_is_refused(flying):
    task, design, _, chunks = flying
    assert refused(task, 1.002 * design.objective, chunks[:1])


@pytest.mark.parametrize("directions", ["all", "horizontal"])
def test_a_proof_about_the_task_counts_on_points_of_its_reserves_alone(directions):
    flight = {"force_reserve": 0.1, "torque_reserve": 0.2, "directions": directions, "rotor_out": "hover"}
    task = push(3, flight=flight)
    bounded, n = proof_task(task, "task"), len(task.load_cases)
    assert not any(case.weight for case in bounded.load_cases[n:])
    assert bounded.dead_rotors[-12:] == tuple(range(12))
    sizes = set[tuple[float, float]]()
    for case, dead in zip(bounded.load_cases[n:], bounded.dead_rotors[n:], strict=True):
        at_tip = case.at_end_effector
        force, torque = np.linalg.norm(at_tip.force), np.linalg.norm(at_tip.torque)
        assert case.at_com.force == pytest.approx((0.0, 0.0, task.force_unit(3)))
        assert min(force, torque) == 0.0
        if dead is not None:
            assert force == torque == 0.0
            continue
        assert directions == "all" or at_tip.force[2] == 0.0
        sizes.add((round(force / task.force_unit(3), 9), round(torque / task.torque_unit(3), 9)))
    assert sizes == {(round(0.1 - 5e-6, 9), 0.0), (0.0, round(0.2 - 5e-6, 9))}


def test_hover_that_is_a_load_case_too_is_counted_once_with_each_rotor_dead():
    task = push(3, load_cases=[HOVER], flight={"rotor_out": "all"})
    assert proof_task(task, "solver").dead_rotors == proof_task(task, "task").dead_rotors == (None, *range(12))


def with_record(chunk, record):
    return Chunk.of(chunk.number, "closed", bytes(record))


def test_a_byte_that_says_less_than_is_true_is_refused(pair):
    """Bounded boxes that are said to be crowded, and the reverse; splits that are said to be leaves."""
    task, root, _, cut, chunks = pair
    chunk, rng = longest(chunks), np.random.default_rng(46)
    record = bytearray(chunk.record)
    for position in rng.choice(len(record), size=12, replace=False):
        changed = record.copy()
        changed[position] = 1 if record[position] == 0 else 0
        checked = check_chunk(task, PAIR, root, cut, with_record(chunk, changed))
        assert checked.fault is not None
        assert f"of {len(record)}: " in checked.fault


def test_a_box_that_is_dropped_or_added_is_refused(pair):
    task, root, _, cut, chunks = pair
    chunk = longest(chunks)
    record = chunk.record
    for changed, why in (
        (record[:-1], "the record ends before it"),
        (b"", "box 1 of 0: the record ends before it"),
        (record + b"\0", "the record continues after the last box"),
        (record[:3] + record[4:], "box"),
        (bytes([2 + PAIR.n + 2]) + record[1:], "box 1 of .*: the record halves an unknown angle"),
        (b"\2" * 10_000, "the record halves it more often than a number can be"),
    ):
        fault = check_chunk(task, PAIR, root, cut, with_record(chunk, changed)).fault
        assert fault is not None
        assert re.search(why, fault)


def test_what_cannot_be_looked_at_is_refused(pair):
    task, root, _, cut, chunks = pair
    three = Topology.from_key("aa00")
    for given, why in (
        ((task, PAIR, 2, cut, chunks[0]), "angles cannot be counted from module 2"),
        ((task, PAIR, root, cut, chunks[0].model_copy(update={"corners": (0,)})), "there is no corner 0"),
        ((task, three, 0, cut, chunks[0]), "the task has 2 modules, but the tree 3"),
        ((task, PAIR, root, cut, chunks[0].model_copy(update={"number": 64})), "there is no chunk 64"),
        ((task, PAIR, root, cut, chunks[0].model_copy(update={"packed": "AAAA"})), "cannot be unpacked"),
        ((task, PAIR, root, cut, Chunk.of(3, "many", b"\0")), "it is not closed"),
    ):
        assert why in check_chunk(*given).fault


@pytest.mark.parametrize("search", [{}, {"root": "paper"}, {"root_orientation_deg": [10.0, -20.0, 170.0]}])
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_chunks_of_prover_and_checker_cover_all_angles_and_share_no_more_than_faces(n, search):
    """The checker's reach as far as an audit lets angles pass."""
    task = push(n, search=search)
    most = checked_box(task, n)[1]
    assert np.all(most[3:] > math.pi / 2 + 1e-6)
    assert search or (most[0] > math.pi and most[1] >= math.pi / 2 and most[2] > math.pi)
    for chunk, whole in ((branch.chunk_box, whole_box), (chunk_box, checked_box)):
        least, most = whole(task, n)
        boxes = [chunk(task, n, number) for number in range(chunk_count(n))]
        assert sum(np.prod(upper - lower) for lower, upper in boxes) == pytest.approx(np.prod(most - least))
        assert len({(*lower, *upper) for lower, upper in boxes}) == len(boxes)


@pytest.mark.parametrize("reroot", [reroot, arrays.reroot], ids=["checker", "prover"])
def test_the_same_platform_hangs_from_any_module(reroot):
    rng = np.random.default_rng(47)
    for n in (2, 3, 5, 8):
        tree = random_tree(n, rng, aligned=False)
        for root in range(n):
            other = reroot(tree, root)
            assert reroot(other, 0).key == other.key
            assert sorted(dict(other.graph().degree).values()) == sorted(dict(tree.graph().degree).values())
            assert sum(kappa % 2 for kappa in other.kappas) == sum(kappa % 2 for kappa in tree.kappas)


@pytest.mark.slow
def test_the_check_follows_where_a_tree_costs_next_to_nothing_more_than_the_cut() -> None:
    design = read_json(Design, Path(__file__).parent / "designs/push-a70010.json")
    task, tree, cut = design.task, design.topology, 0.997 * design.objective
    chunk = prove_chunk(task, tree, 29, cut)
    assert chunk.outcome == "closed"
    assert check_chunk(task, tree, proof_root(task, tree), cut, chunk).fault is None
