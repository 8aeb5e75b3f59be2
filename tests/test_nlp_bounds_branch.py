"""The bound of a box, attacked: by points of the box, by designs, and by cuts just above what can be done."""

import itertools
import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from nlp_cases import HOVER, as_design, push, random_tree
from scipy.optimize import linprog
from suites import few
from test_nlp_bounds_attack import random_task

from nlp import solve
from nlp.bounds.branch import box, frames, multipliers, search, slopes, worst_vertex
from nlp.bounds.branch.arrays import centre, effort_unit, reroot, to_arrays, whole_box
from nlp.bounds.branch.crowded import AT_MIDDLE, EVERYWHERE, crowding
from nlp.bounds.branch.proof import chunk_box, prove_chunk
from nlp.numbers.point import Point
from nlp.units import Units
from topo_search.model import Design, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.corners import to_corners
from topo_search.model.files import read_json
from topo_search.model.proof import chunk_count, proof_task
from topo_search.model.proven import TOLERANCE
from topo_search.model.reserves import AskedFlight
from topo_search.model.task_file import read_task
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside
from verify.bodies import ConeSphere, clearances
from verify.kinematics import Platform, platform, poses, required_wrench, wrench_map
from verify.requirements import Scene


def seen(stated, lower, upper):
    """All that the bound of a box is computed from."""
    at = frames.empty_box(stated.tree)
    frames.fill_box(stated.tree, stated.l_c, lower, upper, at)
    frames.fill_roots(lower, upper, at)
    return at


def bound_of(stated, y, sigma, lower, upper):
    return box.bound(stated, y, sigma, seen(stated, lower, upper), box.bound_workspace(stated), math.inf)


def dual_value(task, tree, theta, tip, y, walls):
    return dual_value_in(Units.of(task), task, tree, theta, tip, y, walls, proof_task(task, "task"))


def placed(task, tree, at, tip):
    """Joints, centre of mass and end-effector of a platform, which has its tip there unless the task fixes it."""
    module, l_c, fixed = task.module, task.module.connector_distance, task.end_effector.fixed_position
    mass, on_tip, rod = task.total_mass(tree.n), task.end_effector.mass, task.end_effector.counted_rod
    joints = np.array([at.p[h] + l_c * at.R[h] @ PORT_DIRECTIONS[a] for h, _, a, _ in tree.edges()]).reshape(-1, 3)
    on_modules = module.mass * at.p.sum(axis=0) + module.joint_mass * joints.sum(axis=0)
    if rod is not None:  # half of it at either end
        foot = at.p[rod.module] + l_c * at.R[rod.module] @ PORT_DIRECTIONS[rod.port]
        on_modules, on_tip = on_modules + rod.mass / 2 * foot, on_tip + rod.mass / 2
    if fixed is None:
        return joints, (on_modules + on_tip * tip) / mass, tip
    p_COM = (on_modules + on_tip * np.array(fixed)) / (mass - on_tip)
    return joints, p_COM, p_COM + np.array(fixed)


def dual_value_in(unit, task, tree, theta, tip, y, walls, bounded):
    """The dual function with the audit's kinematics and wrenches, inputs within limits, in some units.

    `walls`: module, end of its airflow, normal and multiplier of every row; `bounded`: the task with its corners.
    """
    module, n = task.module, tree.n
    at = poses(tree, theta[:3], theta[3:], module.connector_distance)
    joints, p_COM, tip = placed(task, tree, at, tip)
    o = at.p - p_COM
    rotors = o[:, None] + np.einsum("nij,qj->nqi", at.R, module.arm_length * module.rotor_table.positions)
    axes = np.einsum("nij,qj->nqi", at.R, module.rotor_table.axes)
    platform = Platform(at, p_COM, o, tip - p_COM, tip, rotors, axes, joints - p_COM)
    A, most = wrench_map(platform, module) * unit.input, max(case.weight for case in task.load_cases)
    total, air, planes = 0.0, module.region_envelope, list(half_spaces(task))
    for i, end, normal, sigma in walls:
        e, radius = (at.p[i] - air.length * at.z[i], air.end_radius) if end else (at.p[i], air.start_radius)
        offset = min(planes, key=lambda plane: np.abs(plane[0] - normal).max())[1]
        total += sigma * (normal @ (e - tip) + radius - offset) / unit.length
    for case, dead, y_k in zip(bounded.load_cases, bounded.dead_rotors, y, strict=True):
        nu, mu = y_k[:3] / unit.force, y_k[3:] / unit.torque
        about_com = np.concatenate([nu + np.cross(mu, p_COM), mu])  # nu . F + mu . (tau + p_COM x F)
        t, weight, runs = about_com @ A, case.weight / most, np.arange(4 * n) != dead
        low, high = task.min_input / unit.input * runs, task.max_input / unit.input * runs
        u = np.clip(t / (2 * weight), low, high) if weight > 1e-300 else np.where(t > 0, high, low)
        total += about_com @ required_wrench(case, platform.p_e) - np.sum(u * (t - weight * u))
    return total


def half_spaces(task):
    """Outward normal and offset [m] of what envelopes are to stay within."""
    for asked in task.exposure:
        if asked.kind == "allowed":
            lengths = (np.linalg.norm(one.normal) for one in asked.planes)
            yield from (
                (np.array(one.normal) / a, one.offset / a) for one, a in zip(asked.planes, lengths, strict=True)
            )
        if asked.kind == "exterior" and asked.axis != "com":
            yield -np.array(asked.axis) / np.linalg.norm(asked.axis), 0.0


def multipliers_for(stated, rng):
    y = rng.normal(size=(len(stated.loads.f), 6)) * 10 ** rng.uniform(-1, 1)
    sigma = np.maximum(0.0, rng.normal(size=len(stated.walls.normal)))
    worst_vertex.enforce_condition(stated, multipliers.newton_workspace(stated), y, sigma)
    return y, sigma


def rows(stated, sigma):
    return list(zip(stated.walls.module, stated.walls.end, stated.walls.normal, sigma, strict=True))


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(40), 8))
def test_no_point_of_a_box_has_a_dual_value_under_its_bound(seed, flies):
    rng = np.random.default_rng([25, seed])
    task = random_task(rng, flies=flies)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    tree = reroot(tree, centre(task, tree))
    stated = to_arrays(task, tree)
    least, most = whole_box(task, task.n)
    middle, half = rng.uniform(least, most), 10 ** rng.uniform(-3, 0, size=len(least))
    lower, upper = np.maximum(least, middle - half), np.minimum(most, middle + half)
    y, sigma = multipliers_for(stated, rng)
    proven = bound_of(stated, y, sigma, lower, upper)
    for draw in range(60):
        theta = rng.uniform(lower, upper)
        if draw % 3 == 0:
            theta = np.where(rng.random(len(theta)) < 0.5, lower, upper)
        tip = rng.normal(size=3) * task.module.arm_length * 10 ** rng.uniform(-1, 1)
        assert dual_value(task, tree, theta, tip, y, rows(stated, sigma)) >= proven


@pytest.mark.parametrize("half", [0.01, 0.1, 0.7])
def test_the_middle_of_an_arc_has_no_dual_value_under_the_bound_of_the_arc(half):
    """Multipliers along one thrust axis: the rotors cost least where a hinge turns theirs towards it."""
    task, tree = push(2, load_cases=[HOVER]), Topology(((-1, -1, -1), (0, 0, 2)))
    stated = to_arrays(task, tree)
    y = np.zeros((len(stated.loads.f), 6))
    y[:, :3] = stated.loads.f / 4
    ends = np.array([0.0, 0.0, 0.0, half])
    proven = bound_of(stated, y, np.zeros(0), -ends, ends)
    middle, end = (dual_value(task, tree, theta, np.zeros(3), y, ()) for theta in (0 * ends, ends))
    assert proven <= middle < end


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("seed", few(range(15), 4))
def test_the_bound_of_a_point_is_its_dual_value_but_for_what_an_audit_lets_pass(seed, flies):
    rng = np.random.default_rng([26, seed])
    task = random_task(rng, flies=flies)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    tree = reroot(tree, centre(task, tree))
    stated, theta = to_arrays(task, tree), rng.uniform(*whole_box(task, task.n))
    y, sigma = multipliers_for(stated, rng)
    true = dual_value(task, tree, theta, np.zeros(3), y, rows(stated, sigma))
    proven = bound_of(stated, y, sigma, theta, theta)
    size = np.abs(stated.loads.f).sum() + np.abs(stated.loads.t).sum() + task.n * stated.u_max + sigma.sum()
    lost = np.linalg.norm(y, axis=1).sum() * (1 + stated.levers.rotor.max()) * size
    assert 0 < true - proven < 1e-3 * lost


@pytest.mark.parametrize("seed", few(range(20), 5))
def test_a_bound_ends_early_under_a_cut_alone(seed):
    rng = np.random.default_rng([33, seed])
    task = random_task(rng)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    stated, (least, most) = to_arrays(task, tree), whole_box(task, task.n)
    lower = rng.uniform(least, most)
    upper = np.minimum(most, lower + 0.3)
    multiplied, looked_at = multipliers_for(stated, rng), (seen(stated, lower, upper), box.bound_workspace(stated))
    proven = box.bound(stated, *multiplied, *looked_at, math.inf)
    assert box.bound(stated, *multiplied, *looked_at, proven) == proven
    above = proven + 1e-6 * abs(proven)
    assert proven <= box.bound(stated, *multiplied, *looked_at, above) < above


def looked_at(stated, theta, y, flat):
    """D at a point, with arrays for the multipliers' search there, and the slopes' parts."""
    at, work = seen(stated, theta, theta), multipliers.newton_workspace(stated)
    work.ridge[:] = 0.0
    multipliers.fill_wrenches(stated, at, work)
    slopes.fill(stated, at, work, flat)
    return multipliers.dual_value(stated, work, y), work


@pytest.mark.parametrize("seed", few(range(20), 5))
def test_slopes_are_those_of_the_dual_function(seed):
    """By differences: of D in every angle, of the slopes in the multipliers."""
    rng = np.random.default_rng([34, seed])
    task = random_task(rng)
    tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
    stated, theta = to_arrays(task, tree), rng.uniform(*whole_box(task, task.n))
    A, step, (y, _) = len(theta), 1e-6, multipliers_for(stated, rng)
    flat, other = slopes.empty_slopes(task.n, A), slopes.empty_slopes(task.n, A)
    _, work = looked_at(stated, theta, y, flat)

    def of(y):
        slopes._value(stated, work, flat, np.zeros(A), y, flat.g)
        return flat.g.copy()

    found = of(y)
    for a in range(A):
        by = step * np.eye(A)[a]
        ends = [looked_at(stated, theta + sign * by, y, other)[0] for sign in (1, -1)]
        assert found[a] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4, abs=1e-5 * np.abs(found).max())
    slopes._fill_slope_gradients(stated, work, flat, y)
    by = step * rng.normal(size=y.shape)
    expected = np.einsum("kal,kl->a", work.rows[:, 3:], by)
    assert (of(y + by) - of(y - by)) / 2 == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())


def test_flattened_multipliers_lose_less_towards_the_vertices():
    """What they are to maximise, D at the middle less what its slopes take, does not fall, and mostly rises."""
    rng, effort = np.random.default_rng(35), 100.0
    task, higher = push(4), list[bool]()
    least, most = whole_box(task, 4)
    for _ in range(200):
        tree = random_tree(4, rng, aligned=True)
        stated = to_arrays(task, reroot(tree, centre(task, tree)))
        lower = rng.uniform(least, most - 0.4)
        at, work, flat = (
            seen(stated, lower, lower + 0.4),
            multipliers.newton_workspace(stated),
            slopes.empty_slopes(4, 6),
        )
        multipliers.fill_wrenches(stated, at, work)
        work.ridge[:] = search.BRANCHING.ridge * 4 / 24 * (at.rho**2).sum()
        y = np.zeros((3, 6))
        y[:, :3] = 2 * stated.loads.f
        if multipliers.maximize(stated, work, y, 4, effort) > effort:
            continue
        slopes.fill(stated, at, work, flat)
        before = y.copy()
        slopes.flatten(stated, work, flat, at.rho, y, 3, effort)
        first, last = (slopes._value(stated, work, flat, at.rho, one, flat.g) for one in (before, y))
        assert last >= first
        assert multipliers.lever_sum(stated.loads.g, y) == pytest.approx((0, 0, 0), abs=1e-9 * np.abs(y).max())
        higher.append(last > first)
    assert len(higher) >= 6
    assert sum(higher) > 0.5 * len(higher)


@pytest.mark.parametrize(("number", "share"), [(18, 0.95), (26, 0.99)])
def test_reserves_beside_a_wall_close_a_chunk_in_few_boxes(number, share):
    """Multipliers of the middles, where those reserves are far out of reach, took 60,471 boxes.

    In chunk 26 Newton steps whose length has no limit end at a smallest box.
    """
    design = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    cut = share * design.objective
    assert design.topology.key == "a300"
    assert prove_chunk(design.task, design.topology, number, cut, "solver", most_boxes=6_000).outcome == "closed"


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_torque_alone_beside_a_wall_is_searched_from_zero(share):
    """No force, no first multipliers: a longest step in their length would be none."""
    wall = {"kind": "allowed", "planes": [{"normal": [1, 0, 0], "offset": 50.0}]}
    task = push(1, load_cases=[{"com": {"torque": [0, 0, 0.3]}}], exposure=[wall])
    assert prove_chunk(task, Topology(((-1, -1, -1),)), 0, share * effort_unit(task), "solver").outcome == "closed"


@pytest.mark.parametrize(
    ("seed", "rule"), [*few(((s, "airflow") for s in range(40)), 6), *few(((s, "parts") for s in range(10)), 1)]
)
def test_two_modules_are_too_close_at_every_point_of_a_crowded_box(seed, rule):
    rng = np.random.default_rng([27, seed])
    parts = {"interference": "parts", "body_clearance": False} if rule == "parts" else {}
    least = 4 if parts else 2  # of bolted modules no parts are in the way
    task = push(int(rng.integers(least, 6)), search={"connectors": "any", **parts})
    tree = random_tree(task.n, rng, aligned=False)
    stated = to_arrays(task, tree)
    least, most = whole_box(task, task.n)
    found = 0
    for _ in range(60):
        middle, half = rng.uniform(least, most), 10 ** rng.uniform(-2, -0.3)
        lower, upper = np.maximum(least, middle - half), np.minimum(most, middle + half)
        if crowding(stated, seen(stated, lower, upper), np.zeros(len(least))) != EVERYWHERE:
            continue
        found += 1
        for _ in range(10 if rule == "airflow" else 2):
            assert clearance_missed(task, tree, rng.uniform(lower, upper))
    assert found > 0


def test_a_box_whose_vertices_alone_are_too_close_is_not_crowded():
    """Two bolted centres are 0.3 cos(h / 2) m apart: farthest at h = 0, inside the box."""
    least = 0.3 * math.cos(0.04)
    task = push(2, search={"interference": "separation", "separation": least})
    tree = Topology(((-1, -1, -1), (0, 0, 2)))
    for start, crowded in ((-0.1, False), (0.2, True)):
        lower, upper = np.array([0.0, 0.0, 0.0, start]), np.array([0.0, 0.0, 0.0, 0.3])
        where = crowding(to_arrays(task, tree), seen(to_arrays(task, tree), lower, upper), np.zeros(4))
        assert (where == EVERYWHERE) is crowded


@pytest.mark.parametrize("spread", [0.03, 0.3, 3.0])
@pytest.mark.parametrize("seed", few(range(5), 2))
def test_modules_that_are_too_close_at_a_point_are_found(seed, spread):
    """Axes next to parallel overlap at their ends, others where they are nearest."""
    rng = np.random.default_rng([31, seed])
    task = push(int(rng.integers(2, 6)), search={"connectors": "any"})
    tree = random_tree(task.n, rng, aligned=False)
    stated = to_arrays(task, tree)
    least, most = whole_box(task, task.n)
    found = 0
    for _ in range(60):
        theta = np.clip(spread * rng.normal(size=len(least)), least, most)
        if clearance_missed(task, tree, theta):
            found += 1
            assert crowding(stated, seen(stated, theta, theta), np.zeros(len(least))) == EVERYWHERE
    assert found > 0


def clearance_missed(task, tree, theta):
    """Overlap of envelopes, parts in airflow or centres too close, as the audit measures them."""
    air, at = task.module.envelope, poses(tree, theta[:3], theta[3:], task.module.connector_distance)
    pairs = list(itertools.combinations(range(tree.n), 2))
    apart = [np.linalg.norm(at.p[i] - at.p[j]) for i, j in pairs if (i, j) not in tree.bolted]
    if apart and min(apart) < (task.body_clearance or 0.0):
        return True
    if task.search.interference == "airflow":
        cones = [
            ConeSphere(p, -air.length * z, air.start_radius, air.growth) for p, z in zip(at.p, at.z, strict=True)
        ]
        return clearances([(cones[i], cones[j]) for i, j in pairs]).d.min() < 0
    still = np.zeros((len(task.load_cases), tree.n, 4))
    design = as_design(Point(task, tree, theta[:3], theta[3:], np.zeros(3), still))
    found = platform(design)
    parts = Scene(design, found)
    rows = list(beside_airflow(parts.modules, parts.envelopes, counts=True))
    return any(certificate.analytic < 0 for certificate in certify_beside(rows))


EXPOSED = ["push-local", "push-directional", "push-two-paths", "push-exterior-60", "push-exterior-90"]


@pytest.mark.parametrize("example", EXPOSED)
def test_exposure_changes_nothing_in_what_boxes_are_bounded_from(example):
    """So a proof about push is one about these tasks, too."""
    tree = reroot(Topology.from_key("a70010"), 1)
    folder = resources.files("topo_search") / "examples"
    tasks = [read_task(Path(str(folder / f"{name}.toml"))).resolve(5) for name in ("push", example)]
    plain, exposed = (numbers_of(to_arrays(task, tree)) for task in tasks)
    assert tasks[1].exposure
    assert np.array_equal(plain, exposed)


def numbers_of(stated):
    """All that is stated, in a row."""
    return np.concatenate([numbers_of(one) if isinstance(one, tuple) else np.ravel(one) for one in stated])


def proven(task, tree, cut):
    """Whether all chunks of a tree are closed, looking no further than the first that is not."""
    return all(
        prove_chunk(task, tree, number, cut, most_boxes=300_000).outcome == "closed"
        for number in range(chunk_count(tree.n))
    )


@pytest.fixture(scope="module", params=few([2, 3], 1))
def best(request):
    """A task, a tree of two or three modules, and its best design by local solves."""
    task = push(request.param, load_cases=[{"end_effector": {"force": [0.25, 0.0, 0.75]}}, HOVER])
    tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 1, 3))[: request.param])
    design = solve(task, tree, starts=range(24), seed=0)
    assert isinstance(design, Design)
    return task, tree, design


def test_a_cut_under_the_best_is_proven_and_one_above_is_not(best):
    task, tree, design = best
    assert proven(task, tree, 0.99 * design.objective)
    assert not proven(task, tree, 1.002 * design.objective)


def test_brute_force_finds_nothing_under_what_is_proven(best):
    """A grid over all angles, and a descent from its best points: at fixed angles the rest is a convex problem."""
    task, tree, design = best
    tree = reroot(tree, centre(task, tree))
    stated, unit, (least, most) = to_arrays(task, tree), effort_unit(task), whole_box(task, tree.n)
    work, A = multipliers.newton_workspace(stated), len(least)
    work.ridge[:] = 1e-9

    def effort(theta):
        """A lower bound of the effort at these angles, next to it where they can do the task; else infinity."""
        if np.any(theta < least) or np.any(theta > most):
            return math.inf
        at = seen(stated, theta, theta)
        if crowding(stated, at, np.zeros(A)) >= AT_MIDDLE:
            return math.inf
        multipliers.fill_wrenches(stated, at, work)
        y = np.zeros((2, 6))
        y[:, :3] = 4 * stated.loads.f
        return multipliers.maximize(stated, work, y, 60, 1e9) * unit

    grid = itertools.product(*(np.linspace(low, high, 7) for low, high in zip(least, most, strict=True)))
    found = sorted((effort(np.array(theta)), theta) for theta in grid)
    ends = []
    for value, theta in found[:8]:
        theta, step = np.array(theta), 0.2
        while step > 1e-4:
            tried = [theta + sign * step * np.eye(A)[a] for a in range(A) for sign in (1, -1)]
            tried += [theta + step * draw for draw in np.random.default_rng(29).normal(size=(20, A))]
            lowest, at = min(((effort(one), k) for k, one in enumerate(tried)))
            if lowest < value:
                value, theta = lowest, tried[at]
            else:
                step /= 2
        ends.append(value)
    assert 0.99 * design.objective <= min(ends) < 1.01 * design.objective
    assert min(ends) <= found[0][0]


def test_the_chunk_of_a_design_has_a_bound_of_no_more_than_its_effort(best):
    task, tree, design = best
    assert centre(task, tree) == 0  # else angles are counted from another module
    theta = np.array([*design.root_orientation_rad, *design.hinge_angles_rad])
    mine = [
        number
        for number in range(chunk_count(tree.n))
        if np.all(chunk_box(task, tree.n, number)[0] <= theta)
        and np.all(theta <= chunk_box(task, tree.n, number)[1])
    ]
    assert mine
    assert prove_chunk(task, tree, mine[0], design.objective * 1.001).outcome != "closed"


@pytest.mark.parametrize(
    ("folder", "problem", "closed"),
    [("", "task", 0.97), ("", "solver", 0.995), ("flying", "task", 0.995), ("flying", "solver", 0.995)],
)
@pytest.mark.parametrize("name", ["wall-push", "window-cleaning", "survives-a-rotor"])
def test_what_is_left_out_of_a_bound_costs_a_flying_design_nothing(name, folder, problem, closed):
    """At its own angles, of which no multipliers may prove more than it costs; `task` asks for less."""
    design = read_json(Design, Path(__file__).parent / "designs" / folder / f"{name}.json")
    task, theta = design.task, np.array([*design.root_orientation_rad, *design.hinge_angles_rad])
    assert centre(task, design.topology) == 0
    lower, upper = theta - 1e-6, theta + 1e-6
    cost = design.objective / effort_unit(task)
    cuts = cost * np.array([closed, 1.0001])
    found = [search.search(to_arrays(task, design.topology, problem), lower, upper, cut, 1) for cut in cuts]
    assert [one.outcome for one in found] == [search.CLOSED, search.STUCK]


@pytest.mark.parametrize("name", ["wall-push", "window-cleaning", "survives-a-rotor"])
def test_a_design_that_an_audit_just_calls_clear_can_do_all_that_a_proof_counts_on(name):
    """By a linear program; of an error of the centre of mass a little more cannot be done."""
    design = read_json(Design, Path(__file__).parent / "designs" / "flying" / f"{name}.json")
    at, n = platform(design), design.topology.n
    units = np.repeat([design.task.force_unit(n), design.task.torque_unit(n)], 3)
    most = design.task.module.max_input(design.task.gravity)
    A = wrench_map(at, design.task.module) * most / units[:, None]

    def requiring(**flight):
        task = design.task.model_copy(update={"flight": AskedFlight(units="SI", **flight)})
        return design.model_copy(update={"task": task})

    def can_do(changed):
        wrenches = [
            required_wrench(one.case, at.p_e) / units for one in to_corners(changed.task, inner=True).corners
        ]
        assert wrenches
        costs, box = np.zeros(A.shape[1]), (design.task.min_input / most, 1.0)
        return all(linprog(costs, A_eq=A, b_eq=b, bounds=box).status == 0 for b in wrenches)

    def is_clear(changed):
        statuses = {one.name: one.status for one in audit(changed).residuals if one.name.startswith("hover, ")}
        assert len(statuses) > 0
        return set(statuses.values()) == {"clear"}

    unseen = 0.9 * TOLERANCE
    error = audit(requiring(com_error=1e-9)).flight.hover.com_error_m
    just = requiring(com_error=error + unseen * design.task.module.arm_length)
    assert is_clear(just)
    assert can_do(just)
    assert not can_do(requiring(com_error=error + 20 * TOLERANCE * design.task.module.arm_length))

    left = audit(requiring(com_error=0.9 * error)).flight.hover
    just = requiring(
        com_error=0.9 * error,
        at="com",
        directions="horizontal",
        force_reserve=left.horizontal_reserve_com_N + unseen * units[0],
        tilt_deg=left.tilt_deg + math.degrees(unseen),
    )
    assert is_clear(just)
    assert can_do(just)


def one_module(error, position):
    """A module that only hovers, by what an audit does not see askew, with an end-effector of half its mass."""
    eps, mass = 0.95 * TOLERANCE, push(1).module.mass
    hover = {"com": {"force": [eps, eps, 1.0]}}
    tip = {"mass": 0.5 * mass, "position": [eps * position, eps * position, position]}
    tree = Topology(((-1, -1, -1),))
    design = solve(push(1, load_cases=[hover], end_effector=tip), tree, starts=range(2), seed=0)
    flight = AskedFlight(units="SI", com_error=error)
    task = design.task.model_copy(update={"flight": flight})
    return design.model_copy(update={"task": task, "root_orientation_rad": (math.pi / 4, 0.0, math.sqrt(2) * eps)})


@pytest.mark.parametrize("position", [1.0, 48.0])
def test_a_heavy_end_effector_far_away_is_not_counted_on_to_hover_exactly(position):
    reserve = audit(one_module(1e-9, position)).flight.hover.com_error_m
    design = one_module(reserve - 1e-9, position)
    assert {one.status for one in audit(design).residuals} == {"clear"}
    theta = np.array(design.root_orientation_rad)
    problem, cost = to_arrays(design.task, design.topology, "task"), design.objective / effort_unit(design.task)
    assert search.search(problem, theta - 1e-7, theta + 1e-7, 1.0001 * cost, 1).outcome == search.STUCK


def test_no_hover_is_counted_on_where_an_audit_sees_no_error_of_the_centre_of_mass():
    sideways = push(1, load_cases=[{"end_effector": {"force": [0.5, 0.0, 0.0]}}])
    for error, corners in ((0.9 * TOLERANCE, False), (10 * TOLERANCE, True)):
        flight = AskedFlight(units="SI", com_error=error * sideways.module.arm_length)
        cornered = proof_task(sideways.model_copy(update={"flight": flight}), "task")
        assert (len(cornered.load_cases) > 1) == corners


def test_a_chunk_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match="`0 <= number < 64` must hold, but got 64"):
        prove_chunk(push(2), Topology(((-1, -1, -1), (0, 0, 2))), 64, 1.0)


def test_the_same_chunk_is_the_same_record():
    task, tree = push(3), Topology(((-1, -1, -1), (0, 0, 2), (0, 1, 3)))
    one, other = (prove_chunk(task, tree, 20, 1e14) for _ in range(2))
    assert one == other
    assert one.outcome == "closed"
    assert len(one.record) == one.boxes


def test_no_angle_is_halved_forever_when_multipliers_overflow():
    planes = [{"normal": [0.0, y, 0.0], "offset": 0.6} for y in (1.0, -1.0)]
    cases = [{"carries_weight": True, "end_effector": {"force": [0.2, 0.0, 0.0]}}, {"carries_weight": True}]
    task = push(3, load_cases=cases, exposure=[{"kind": "allowed", "planes": planes}])
    chunk = prove_chunk(task, Topology.from_key("a500"), 31, 7.63e13, most_boxes=300)
    lower, upper = np.array(chunk.stuck)
    assert max(upper - lower) <= 4 * min(upper - lower)
