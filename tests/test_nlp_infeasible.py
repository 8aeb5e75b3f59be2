"""What is said when there is no design: the reason in the user's words, with its amount and unit."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from nlp_cases import HOVER, as_design, as_point, hover, push, random_point, random_tree
from suites import few

from nlp import lower_bound, prove_impossible, solve
from nlp.evaluation import violations
from nlp.ipopt import IpoptResult
from nlp.multistart import solve_starts
from nlp.numbers.geometry import SPLAY, Swept, clearance, poses
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.requirements.balances import wrench_matrix
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.proven import lower_text, upper_text
from topo_search.topologies import candidates
from verify import audit

PAIR, FIVE = Topology.from_key("a10"), Topology.from_key("a11210")


def failed(task, topology, starts=3, seed=0):
    result = solve(task, topology, starts=range(starts), seed=seed)
    assert isinstance(result, Infeasible)
    return result


@pytest.mark.parametrize(
    ("fields", "word", "unit"),
    [
        ({"load_cases": [{"com": {"force": [0, 0, 1], "torque": [0, 0, 9.0]}}]}, "torque", "N m"),
        ({"search": {"body_clearance": 0.42}}, "", ""),
        ({"end_effector": {"position": [0.0, 0.0, 0.01]}, "exposure": [{"kind": "local", "radius": 2.0}]}, "", ""),
    ],
)
def test_the_reason_is_the_worst_violation_of_the_closest_start(fields, word, unit):
    """Everything that is said can be found again from the starts alone."""
    task, key = push(5, **fields), FIVE.key
    result = failed(task, FIVE)
    assert word in result.worst_constraint
    assert result.unit == unit or not unit
    assert result.violation > 0
    assert (result.status, result.topology, result.topology_key) == ("infeasible", FIVE, key)
    assert result.message.startswith(
        f"the closest of 3 starts misses {result.worst_constraint} by {result.violation:.3g} {result.unit}; "
    )
    reasons = [
        max(violations(outcome.point), key=lambda check: check.scaled - check.tolerance)
        for outcome in solve_starts(task, FIVE, starts=range(3), seed=0, carried={})
    ]
    closest = min(reasons, key=lambda check: check.scaled)
    assert (result.worst_constraint, result.unit) == (closest.name, closest.unit)
    assert result.violation == pytest.approx(closest.amount, rel=1e-9)
    tally = Counter(reason.name for reason in reasons)
    assert {shortfall.constraint: shortfall.starts for shortfall in result.shortfalls} == tally
    for shortfall in result.shortfalls:
        least = min(reason.amount for reason in reasons if reason.name == shortfall.constraint)
        assert shortfall.violation == pytest.approx(least, rel=1e-9)
        by = f"{lower_text(shortfall.violation, 2)} {shortfall.unit}"
        assert f"{shortfall.constraint} (by {by} or more)" in result.message
    assert reasons[result.solver.start] is closest
    assert (result.solver.starts, result.solver.starts_feasible, result.solver.seed) == (3, 0, 0)


def test_what_is_proven_impossible_is_not_tried():
    """Two thrust axes span a plane; the three load cases of push do not lie in one."""
    result = solve(push(2), PAIR, starts=range(3), seed=0)
    assert result == prove_impossible(push(2), PAIR)
    assert (result.status, result.solver) == ("impossible", None)


def test_a_torque_beyond_the_drag_of_all_rotors_is_missed_by_the_rest():
    """One module yaws with 2 k_tau u_max at most while it hovers with the other two rotors' share."""
    task = hover(1)
    module, weight = task.module, task.force_unit(1)
    # rotors 2 and 4 at u_max, 1 and 3 carry the rest of the weight: the largest yaw torque of a hover
    u_max = module.max_input(task.gravity)
    rest = weight / module.thrust_coefficient - 2 * u_max
    most = module.torque_coefficient * (2 * u_max - max(rest, 0.0))
    if rest < 0:
        most = module.torque_coefficient * weight / module.thrust_coefficient
    asked = {"com": {"force": [0, 0, 1], "torque": [0, 0, 1.05 * most / task.torque_unit(1)]}}
    within = {"com": {"force": [0, 0, 1], "torque": [0, 0, 0.95 * most / task.torque_unit(1)]}}
    alone = Topology.from_key("a0")
    assert isinstance(solve(hover(1, load_cases=[within]), alone, starts=range(2), seed=0), Design)
    assert failed(hover(1, load_cases=[asked]), alone).worst_constraint.startswith("load case 0")


@pytest.mark.parametrize(("n", "modules"), [(1, "one module"), (5, "5 modules")])
def test_an_impossible_task_is_proven_before_anything_is_solved(n, modules):
    """u_max is 2.5 times hovering, of the modules' weight without the end-effector's."""
    probe = hover(n)
    most = 2.5 * n * probe.module.mass * probe.gravity
    asked = 3.1 * most
    result = prove_impossible(hover(n, load_cases=[HOVER, {"com": {"force": [0, 0, asked / probe.force_unit(n)]}}]))
    assert (result.status, result.topology, result.topology_key, result.solver) == ("impossible", None, None, None)
    assert (result.worst_constraint, result.unit) == ("load case 1, force", "N")
    assert result.violation == pytest.approx(asked - most)
    assert result.message.startswith(f"load case 1 needs 3.1 times what {modules} can lift")
    assert f"give {upper_text(most, 4)} N at most" in result.message
    assert f"needs {lower_text(asked, 4)} N" in result.message


@pytest.mark.parametrize("over", [0.999, 1.001])
def test_the_proof_is_sharp(over):
    """One module can pull with just all its rotors, and no more; the force counts in whatever direction."""
    probe = hover(1)
    size = over * 2.5 * probe.module.mass / probe.total_mass(1)
    direction = np.array([0.6, 0.0, 0.8]) * size
    halves = {"com": {"force": (direction / 2).tolist()}, "end_effector": {"force": (direction / 2).tolist()}}
    task = push(1, load_cases=[halves])
    assert (prove_impossible(task) is None) == (over < 1)
    assert isinstance(solve(task, Topology.from_key("a0"), starts=range(3), seed=0), Design) == (over < 1)


def pulling(n, forces, **fields):
    return push(n, load_cases=[{"com": {"force": [float(x) for x in force]}} for force in forces], **fields)


@pytest.mark.parametrize("over", [0.995, 1.005])
def test_opposite_forces_cannot_both_have_more_than_half_of_the_modules(over):
    """Each alone is less than half of what the rotors can pull; every module can help with one of the two only."""
    probe = hover(5)
    most = 2.5 * 5 * probe.module.mass / probe.total_mass(5)
    forces = [[0.45 * most * over, 0, 0], [-0.55 * most * over, 0, 0]]
    result = prove_impossible(pulling(5, forces))
    assert (result is None) == (over < 1)
    if result is not None:
        assert (result.status, result.topology, result.unit) == ("impossible", None, "N")
        assert result.worst_constraint == "load cases 0, 1, forces"
        assert result.violation == pytest.approx((over - 1) * most * probe.force_unit(5), rel=0.1)
        assert "the load cases 0, 1 without leaning: summed along one direction each" in result.message


@pytest.mark.parametrize("seed", few(range(30), 6))
def test_what_a_platform_does_is_never_proven_impossible(seed):
    """Axes and thrusts up to their limit, all at once: the forces that they make are possible."""
    rng = np.random.default_rng(seed)
    n, K = int(rng.integers(1, 7)), int(rng.integers(2, 6))
    probe = hover(n)
    z = rng.normal(size=(n, 3))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    if n == 2:
        z[:, 1] = 0.0
        z /= np.linalg.norm(z, axis=1, keepdims=True)
    s = np.clip(rng.uniform(-1.0, 3.0, (K, n)), 0.0, 1.0) * 2.5 * probe.module.mass * probe.gravity
    if n == 1:
        s[0] = 1.0
    assert prove_impossible(pulling(n, s @ z / probe.force_unit(n))) is None


def test_one_module_pulls_along_one_axis_and_two_in_one_plane():
    along = [[0.1, 0.0, 0.5], [0.2, 0.0, 1.0]]
    across = [*along, [0.0, 0.0, 0.5]]
    beside = [*across, [0.0, 0.3, 0.5]]
    assert prove_impossible(pulling(1, along)) is None
    assert "a single module thrusts along one axis" in prove_impossible(pulling(1, across)).message
    assert prove_impossible(pulling(2, across)) is None
    result = prove_impossible(pulling(2, beside))
    assert "2 modules in a straight chain lie in one plane" in result.message
    assert "without leaning" in result.message
    assert (result.topology, result.worst_constraint, result.unit) == (None, "load cases, forces", "N")
    assert prove_impossible(pulling(3, beside)) is None


def test_what_is_said_to_be_missed_is_the_least_of_the_largest_residual():
    """Of the planes through the origin none misses the worst of the forces by less."""
    F = np.array([[0.1, 0.0, 0.5], [0.2, 0.0, 1.0], [0.0, 0.3, 0.5], [0.2, 0.1, 0.3]])
    task = pulling(2, F)
    normals = np.random.default_rng(0).normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    least = np.abs(normals @ F.T).max(axis=1).min() * task.force_unit(2)
    assert 0.3 * least < prove_impossible(task).violation <= least


@pytest.mark.parametrize("key", ["a52020", "aa2020"])
def test_a_straight_chain_cannot_push_two_ways(key):
    """All its hinge axes are parallel, so the thrust axes of any angles lie in a plane."""
    chain = Topology.from_key(key)
    assert prove_impossible(push(5)) is None
    result = prove_impossible(push(5), chain)
    assert (result.status, result.topology, result.topology_key) == ("impossible", chain, key)
    assert prove_impossible(hover(5), chain) is None
    axes = [random_point(push(5), chain, np.random.default_rng(s)).poses[0][:, :, 2] for s in range(20)]
    assert max(np.linalg.svd(z, compute_uv=False)[2] for z in axes) < 1e-14


@pytest.mark.parametrize(
    ("fields", "unfit"), [({}, {"a34010", "a64010"}), ({"search": {"body_clearance": False}}, set())]
)
def test_straight_chains_and_closed_squares_of_five_are_proven_unfit_for_push(fields, unfit):
    task = push(5, **fields)
    keys = {c.key for c in candidates(5) if prove_impossible(task, c.topology) is not None}
    assert keys == {"a52020", "aa2020"} | unfit


@pytest.mark.parametrize("seed", few(range(60), 10))
def test_what_a_platform_does_is_possible_for_its_tree(seed):
    """Inputs up to their limit, some for as much torque as there is; the wrench that they make, split anyhow."""
    rng = np.random.default_rng(seed)
    n, K = int(rng.integers(1, 9)), int(rng.integers(1, 4))
    anywhere = {"interference": "separation", "separation": 1e-3}  # the platform need not clear its own airflow
    fixed = {
        "search": anywhere,
        **({"end_effector": {"position": rng.normal(size=3).tolist()}} if seed % 2 else {}),
    }
    tree = random_tree(n, rng)
    point = random_point(push(n, load_cases=[HOVER] * K, **fixed), tree, rng)
    A, (_, p), u_max = wrench_matrix(point), point.poses, point.task.module.max_input(point.task.gravity)
    about_centre = A[3:] - np.cross(p.mean(axis=0), A[:3], axis=0)
    along = (about_centre.T @ rng.normal(size=(3, K))).T > 0
    u = np.where(rng.random((K, 1)) < 0.7, along * u_max, rng.uniform(0.0, u_max, (K, 4 * n)))
    cases = []
    for wrench in u @ A.T:
        force, tip = wrench[:3], rng.normal(size=3)
        torque = wrench[3:] - np.cross(point.tip, tip) - np.cross(point.p_COM, force - tip)
        com = {"force": (force - tip).tolist(), "torque": torque.tolist()}
        cases.append({"units": "SI", "com": com, "end_effector": {"force": tip.tolist()}})
    task = push(n, load_cases=cases, **fixed)
    assert prove_impossible(task, tree) is None
    assert lower_bound(task) <= np.sum(u**2) * (1 + 1e-9)


def gaps_of(task, tree, alpha):
    """All clearances between modules, by the solver's independent evaluation."""
    point = random_point(task, tree, np.random.default_rng(0))
    point = Point(task, tree, point.root, alpha, point.tip, point.u)
    return [-check.amount for check in violations(point) if check.name.startswith(("airflow", "separation"))]


def test_five_modules_around_a_square_are_in_their_own_way():
    """No angle of very many, the best of them improved, clears them; without body clearance some do."""
    square, rng = Topology.from_key("a34010"), np.random.default_rng(0)
    task = push(5)
    result = prove_impossible(task, square)
    assert (result.status, result.topology, result.unit) == ("impossible", square, "m")
    assert "5 modules in a row that go right, right, right (or the mirror image)" in result.message
    ports = [a for _, _, a, _ in square.edges()]
    alpha = SPLAY[ports] * rng.uniform(0.0, np.pi / 2, (150, 4))
    worst = [min(gaps_of(task, square, angles)) for angles in alpha]
    best, least = alpha[np.argmax(worst)], max(worst)
    for step in 0.3 * 0.95 ** np.arange(150):
        angles = np.clip(best + step * rng.normal(size=4), -np.pi / 2, np.pi / 2)
        if (gap := min(gaps_of(task, square, angles))) > least:
            best, least = angles, gap
    assert -0.03 < least < -0.013  # 13.3 mm, by a longer search


SMALL_ROTORS = {"body": {"rotor_radius": 0.02}}
"""They end inside connectors of 0.091 m and more."""


@pytest.mark.parametrize("l_c", few([0.13, 0.11, 0.15], 1))
def test_a_tree_with_angles_that_clear_it_is_not_proven_to_be_in_its_way(l_c):
    """Random trees at random splayed angles; the clear ones are a counter-example to any proof."""
    rng, clear = np.random.default_rng(0), 0
    for _ in range(300):
        n = int(rng.integers(2, 6))
        task, tree = hover(n, module={"connector_distance": l_c, **SMALL_ROTORS}), random_tree(n, rng)
        ports = [a for _, _, a, _ in tree.edges()]
        if min(gaps_of(task, tree, SPLAY[ports] * rng.uniform(0.0, np.pi / 2, n - 1))) >= 0:
            clear += 1
            assert prove_impossible(task, tree) is None
    assert clear >= 10


@pytest.mark.parametrize("over", [-1e-4, 1e-4])
def test_rotors_that_reach_beyond_the_connectors_are_impossible_with_body_clearance(over):
    """At no angle does a design of two such modules pass its audit; without body clearance it does."""
    module = {"connector_distance": 0.1 / math.sqrt(2) + 0.05 - over}
    proof = prove_impossible(hover(2, module=module))
    assert (proof is not None) == (over > 0)
    assert prove_impossible(hover(2, module=module, search={"body_clearance": False})) is None
    if proof is not None:
        assert (proof.status, proof.unit) == ("impossible", "m")
        assert proof.violation == pytest.approx(over, rel=1e-6)
        assert (
            "overlap at any hinge angle: they reach from 0.02072 to 0.12071 m towards a connector" in proof.message
        )
        assert prove_impossible(hover(1, module=module), Topology.from_key("a0")) is None
    for angle in (0.0, 0.5, -1.0, math.pi / 2):
        point = random_point(hover(2, module=module), PAIR, np.random.default_rng(0))
        design = as_design(Point(point.task, PAIR, point.root, np.array([angle]), point.tip, point.u))
        (parts,) = [pair for pair in audit(design).pairs if pair.kind == "body"]
        assert (parts.analytic_m < 0) == (over > 0 or angle != 0)


def turning(torque, **fields):
    return push(5, load_cases=[{"com": {"force": [0, 0, 1], "torque": [0, 0, torque]}}], **fields)


def test_a_torque_beyond_the_longest_levers_is_impossible_for_compact_trees_first():
    """Modules at 2 l_c times the mean distance of two of them at most: 1.6 joints in a chain, 1.28 in a star."""
    star, chain = Topology.from_key("af0000"), Topology.from_key("a52020")
    module, task = turning(1).module, turning(1)
    for tree, joints in ((star, 1.28), (chain, 1.6)):
        lever = 2 * module.connector_distance * joints + module.arm_length
        lever += module.torque_coefficient / module.thrust_coefficient
        most = lever * 2.5 * 5 * module.mass * task.gravity / task.torque_unit(5)
        assert prove_impossible(turning(0.999 * most), tree) is None
        result = prove_impossible(turning(1.001 * most), tree)
        assert (result.worst_constraint, result.unit) == ("load case 0, torque", "N m")
        assert result.violation == pytest.approx(0.001 * most * task.torque_unit(5), rel=1e-6)
        assert result.topology == (star if tree == star else None)  # no tree is longer than the chain


def test_an_end_effector_too_far_from_the_centre_is_impossible():
    """Half the weight at the tip; the end-effector's place alone decides, and free it is never too far."""
    assert prove_impossible(push(5, end_effector={"position": [0.0, 0.0, 9.0]})) is not None
    assert prove_impossible(push(5, end_effector={"position": [1.0, 0.0, 0.0]})) is None
    along = [{"end_effector": {"force": [0.0, 0.0, 1.0]}}]  # no lever about its own line
    assert prove_impossible(push(5, load_cases=along, end_effector={"position": [0.0, 0.0, 9.0]})) is None


@pytest.mark.parametrize("shorter", [False, True])
def test_connectors_too_short_for_the_airflow_are_impossible(shorter):
    """Centres that are bolted are 2 l_c apart at most: under 2 r_air the envelopes overlap where they begin."""
    task = push(5, module={"connector_distance": 0.0985 if shorter else 0.102, **SMALL_ROTORS})
    result = prove_impossible(task)
    assert (result is not None) == shorter
    air, alpha = task.module.envelope, np.linspace(-np.pi / 2, np.pi / 2, 2001)
    gaps = []
    for angle in alpha:
        R, p = poses(PAIR, np.eye(3), np.array([angle]), task.module.connector_distance)
        one, other = (Swept(p[i], -air.length * R[i, :, 2], air.start_radius, air.growth) for i in range(2))
        gaps.append(clearance(one, other))
    assert (max(gaps) < 0) == shorter
    if result is not None:
        assert 0 < result.violation <= -max(gaps)
        assert result.unit == "m"
        assert result.message.startswith("2 modules in a row come too close to each other at any hinge angles")
        assert "connector_distance = 0.0985 m is too short" in result.message
        search = {"interference": "separation", "separation": 0.196}
        assert prove_impossible(push(5, module={"connector_distance": 0.0985}, search=search)) is None
        assert prove_impossible(push(5, module={"connector_distance": 0.095}, search=search)) is not None
        assert prove_impossible(hover(1, module={"connector_distance": 0.0985}), Topology.from_key("a0")) is None


def test_a_tree_of_another_size_and_no_starts_are_refused():
    other_size = r"`task\.n == topology\.n` must hold, but got 5 != 2"
    with pytest.raises(ValueError, match=other_size):
        prove_impossible(push(5), PAIR)
    with pytest.raises(ValueError, match=other_size):
        solve(push(5), PAIR, starts=range(1), seed=0)
    with pytest.raises(ValueError, match=r"`starts` must have at least one index, but got range\(3, 3\)"):
        solve(push(5), FIVE, starts=range(3, 3), seed=0)


def test_a_success_word_alone_is_not_believed(monkeypatch):
    """Parallel modules that blow into each other, handed back as solved, are judged by their violations."""

    def flat(_self, start):
        return IpoptResult(dataclasses.replace(start, alpha=np.zeros_like(start.alpha)), "Solve_Succeeded", 0)

    monkeypatch.setattr(AssembledProgram, "polish", flat)
    assert isinstance(solve(push(5), FIVE, starts=range(2), seed=0), Infeasible)


def test_a_failure_word_alone_is_not_believed(monkeypatch):
    """A feasible point counts, whatever Ipopt says of it."""
    polish = AssembledProgram.polish

    def pessimist(self, start):
        result = polish(self, start)
        return IpoptResult(result.point, "Maximum_Iterations_Exceeded", result.iterations)

    monkeypatch.setattr(AssembledProgram, "polish", pessimist)
    result = solve(hover(1), Topology.from_key("a0"), starts=range(4), seed=0)
    assert isinstance(result, Design)
    assert result.solver["status"] == "Maximum_Iterations_Exceeded"
    assert result.objective == pytest.approx(lower_bound(hover(1)), rel=1e-8)


def test_the_audit_finds_the_violation_that_was_reported():
    """The closest point of an infeasible task, written as a design, is violated by as much."""
    task = hover(1, end_effector={"position": "com"})
    alone = Topology.from_key("a0")
    result = failed(task, alone, starts=1)
    (outcome,) = solve_starts(task, alone, starts=range(1), seed=0, carried={})
    design = as_design(outcome.point)
    (pair,) = [pair for pair in audit(design).pairs if pair.kind == "exclusion"]
    assert pair.analytic_m == pytest.approx(-result.violation)
    np.testing.assert_allclose(as_point(design).p_COM, as_point(design).poses[1][0], atol=1e-12)
