"""The solver on platforms of several types of module: physics from scratch, one program in three forms, bounds."""

from dataclasses import replace
from typing import Any

import networkx as nx
import numpy as np
import pytest
from nlp_cases import GENTLE_PUSH, LOCAL, as_design, push, random_point, random_tree, solved, with_masses
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation
from test_nlp_assembled import assert_printed
from test_nlp_reduced import assert_derivatives

from nlp import largest_value, lower_bound, prove_impossible, solve
from nlp.bounds.refutation import tolerated_thrust
from nlp.evaluation import violations
from nlp.numbers.geometry import root_angles
from nlp.numbers.masses import masses
from nlp.numbers.point import Point
from nlp.reduced.arrays import to_arrays
from nlp.requirements import clearances
from nlp.requirements.balances import inertia, wrench_matrix
from topo_search.model import PORT_DIRECTIONS, Module, ResolvedTask, Topology
from topo_search.model.corners import to_corners
from topo_search.model.proven import TOLERANCE
from topo_search.model.room import body_radius
from topo_search.topologies import candidate_of, sample
from verify import audit

SIX = [
    {
        "position": [0.1 * np.cos(a), 0.1 * np.sin(a), 0.01],
        "axis": [0.1 * np.sin(3 * a), 0.0, 1.0],
        "spin": 1 if k % 2 else -1,
    }
    for k, a in enumerate(np.arange(6) * np.pi / 3)
]
MIXED: list[dict[str, Any]] = [
    {"name": "quad", "count": 2},
    {
        "name": "hexa",
        "count": 1,
        "mass": 0.4,
        "rotors": SIX,
        "thrust_coefficient": 5e-7,
        "connector_distance": 0.2,
        "body": {"rotor_radius": 0.04},
        "airflow": {"start_radius": 0.14, "spread_angle_deg": 14.0},
    },
    {"name": "battery", "count": 1, "mass": 0.3, "rotors": [], "connector_distance": 0.1, "arm_length": 0.04},
]
TREES = [Topology.from_key(key) for key in ("a7000-caba", "a3010-abca", "a1300-baac")]


def mixed(topology: Topology, types: list[dict[str, Any]] = MIXED, **fields: Any) -> ResolvedTask:
    """A task for a tree of quadrotors, a hexarotor with larger rotors, and a battery."""
    return push(topology.n, module_types=types, **fields).on(topology)


@pytest.mark.parametrize("topology", TREES, ids=lambda tree: tree.key)
def test_masses_and_wrenches_are_those_of_each_module(topology: Topology) -> None:
    rng = np.random.default_rng(3)
    task = mixed(topology, module={"joint_mass": 0.04}, end_effector={"mass": 0.1})
    point = random_point(task, topology, rng)
    modules: list[Module] = [task.module_types[k] for k in topology.types]
    R, p = point.poses
    for h, i, a, b in topology.edges():  # both connectors are in one place
        connectors = (
            p[k] + modules[k].connector_distance * R[k] @ PORT_DIRECTIONS[port] for k, port in ((h, a), (i, b))
        )
        np.testing.assert_allclose(*connectors, atol=1e-12)
    bodies = [(module.mass, centre) for module, centre in zip(modules, p, strict=True)]
    for h, _, a, _ in topology.edges():
        bodies.append((0.04, p[h] + modules[h].connector_distance * R[h] @ PORT_DIRECTIONS[a]))
    bodies.append((0.1, point.tip))
    m_t = sum(mass for mass, _ in bodies)
    com = sum((mass * centre for mass, centre in bodies), start=np.zeros(3)) / m_t
    assert task.total_mass(4) == pytest.approx(m_t, rel=1e-14)
    np.testing.assert_allclose(point.p_COM, com, atol=1e-12)
    J = sum(R_i @ np.diag(module.inertia) @ R_i.T for module, R_i in zip(modules, R, strict=True))
    J += sum(mass * ((o - com) @ (o - com) * np.eye(3) - np.outer(o - com, o - com)) for mass, o in bodies)
    np.testing.assert_allclose(inertia(point), J, atol=1e-12)

    wrench = np.zeros(6)
    for module, R_i, p_i, u_i in zip(modules, R, p, point.u[0], strict=True):
        table = module.rotor_table
        assert not u_i[table.count :].any()
        for q, u in enumerate(u_i[: table.count]):
            axis, at = R_i @ table.axes[q], p_i + module.arm_length * R_i @ table.positions[q]
            force = module.thrust_coefficient * table.gains[q] * u * axis
            wrench[:3] += force
            wrench[3:] += np.cross(at, force) + module.torque_coefficient * table.drags[q] * u * axis
    np.testing.assert_allclose(wrench_matrix(point) @ point.u[0].ravel(), wrench, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("topology", TREES, ids=lambda tree: tree.key)
def test_program_and_compiled_search_are_the_printed_problem(topology: Topology) -> None:
    """With joints and a rod that weigh, a solid region, reserves and accelerations."""
    flight = {"angular_acceleration": [10.0, 0.0, 5.0]}
    task = mixed(topology, exposure=[{**LOCAL, "solid": True}], flight=flight, load_cases=GENTLE_PUSH)
    task = to_corners(with_masses(task, topology))
    assert_printed(task, topology)
    assert_derivatives(task, topology)


def test_only_modules_with_rotors_have_airflow_and_all_parts_keep_out_of_it() -> None:
    topology = TREES[0]
    task = mixed(topology, search={"interference": "airflow"})
    names = [name for requirement in clearances(task, topology) for name, *_ in requirement.rows()]
    assert "airflow of modules 1 and 2" in names
    assert not any(name.startswith("airflow") and " 0" in name for name in names)  # the battery is the root
    assert not [name for name in names if name.endswith("airflow of module 0")]
    battery = task.modules_of_nodes[topology.types.index(2)]
    cover = task.part_cover(battery)
    assert np.max(np.linalg.norm(cover.centres, axis=1) + cover.radii) >= body_radius(battery) - 1e-9


@pytest.mark.parametrize("key", ["a7000", "a600"])
def test_two_equal_types_are_one(key: str) -> None:
    n = len(key) - 1
    plain, cases = Topology.from_key(key), {"load_cases": GENTLE_PUSH}
    tree = Topology.from_key(f"{key}-{'ab' * n}"[: len(key) + 1 + n])
    counts = [tree.types.count(0), tree.types.count(1)]
    types = [{"name": name, "count": count} for name, count in zip(("one", "other"), counts, strict=True)]
    whole, parted = push(n, **cases), mixed(tree, types, **cases)
    assert lower_bound(parted) == pytest.approx(lower_bound(whole), rel=1e-12)
    results = [solve(task, at, starts=range(8), seed=0) for task, at in ((whole, plain), (parted, tree))]
    assert results[1].status == results[0].status if not hasattr(results[0], "objective") else True
    first, second = (getattr(result, "objective", 0.0) for result in results)
    assert second == pytest.approx(first, rel=1e-9)


def test_a_design_of_quadrotors_and_a_battery_is_clear() -> None:
    tree = Topology.from_key("a7000-baaa")
    types = [{"name": "quad", "count": 3}, {"name": "battery", "count": 1, "mass": 0.2, "rotors": []}]
    light = [{"carries_weight": True, "units": "SI", "end_effector": {"force": [0.5, 0.0, 0.0]}}]
    task = mixed(tree, types, load_cases=light)
    design = solved(solve(task, tree, starts=range(6), seed=0))
    assert design.types == ("battery", "quad", "quad", "quad")
    assert not design.inputs[:, 0].any()
    assert all(violation.met for violation in violations(Point.of(design)))
    assert audit(design).verdict == "clear"


@pytest.mark.parametrize("seed", range(12))
def test_no_platform_beats_a_bound(seed: int) -> None:
    """Inputs of least effort at random angles, found by another program, for forces that the platform produces."""
    rng = np.random.default_rng(seed)
    topology = Topology(
        random_tree(4, rng, aligned=True).joints, types=tuple(rng.permutation([0, 0, 1, 2]).tolist())
    )
    fields: dict[str, Any] = {"end_effector": {"mass": 0.0, "position": [0.0, 0.0, 0.0], "exclusion": False}}
    fields["search"] = {"interference": "separation"}
    task = mixed(topology, **fields)
    point = random_point(task, topology, rng)
    A = wrench_matrix(point)
    A[3:] -= np.cross(point.p_COM, A[:3].T).T
    limits = task.input_limits.ravel()
    u = rng.uniform(0.0, 1.0, A.shape[1]) * limits
    w = A @ u
    case = {"units": "SI", "com": {"force": w[:3].tolist(), "torque": w[3:].tolist()}}
    given = mixed(topology, load_cases=[case], **fields)
    least = minimize(
        lambda v: (v @ v, 2 * v),
        u / limits.max(),
        jac=True,
        bounds=[(0.0, limit / limits.max()) for limit in limits],
        constraints={"type": "eq", "fun": lambda v: A @ v * limits.max() - w, "jac": lambda _: A * limits.max()},
        method="SLSQP",
    )
    assert lower_bound(given) <= float(u @ u)
    if least.success:
        assert lower_bound(given) <= least.fun * limits.max() ** 2 * (1 + 1e-6)
    assert prove_impossible(given) is None
    assert prove_impossible(given, topology) is None


@pytest.mark.parametrize("maximize", ["force_reserve", "torque_reserve"])
def test_no_platform_has_more_than_the_largest_value(maximize: str) -> None:
    rng = np.random.default_rng(7)
    best = 0.0
    for _ in range(40):
        types = tuple(rng.permutation([0, 0, 1, 2]).tolist())
        topology = Topology(random_tree(4, rng, aligned=True).joints, types=types)
        tip = {"mass": 0.0, "position": [0.0, 0.0, 0.0], "exclusion": False}
        hover = [{"name": "hover", "com": {"force": [0.0, 0.0, 1.0]}}]
        search = {"interference": "separation", "maximize": maximize}
        task = mixed(topology, end_effector=tip, load_cases=hover, search=search, flight={"directions": "all"})
        flat = replace(random_point(task, topology, rng), root=np.zeros(3), alpha=rng.uniform(-0.4, 0.4, 3))
        thrust = (wrench_matrix(flat) @ task.input_limits.ravel())[:3]
        upright, _ = Rotation.align_vectors([0.0, 0.0, 1.0], thrust)
        point = replace(flat, root=root_angles(upright.as_matrix()))
        A = wrench_matrix(point)
        A[3:] -= np.cross(point.p_COM, A[:3].T).T
        A *= task.input_limits.ravel()
        weight = np.array([0.0, 0.0, task.force_unit(4), 0.0, 0.0, 0.0])
        reserve = np.inf
        for axis in np.vstack([np.eye(3), -np.eye(3)]):
            d = np.append(axis, np.zeros(3)) if maximize == "force_reserve" else np.append(np.zeros(3), axis)
            found = linprog(
                np.append(np.zeros(A.shape[1]), -1.0),
                A_eq=np.column_stack([A, -d]),
                b_eq=weight,
                bounds=[*((0.0, 1.0) for _ in A.T), (0.0, None)],
            )
            reserve = min(reserve, float(found.x[-1]) if found.status == 0 else 0.0)
        best = max(best, reserve)
        assert reserve / np.sqrt(3) <= largest_value(task)
    assert best > 0.0


def test_arrays_of_the_compiled_search_have_no_rotors_that_a_module_lacks() -> None:
    topology = TREES[0]
    stated = to_arrays(mixed(topology), topology)
    r = 6
    assert stated.rotors.forces.shape == (4 * r, 3)
    lacking = np.flatnonzero(np.asarray(stated.rotors.u_max) == 0)
    assert not stated.rotors.forces[lacking].any()
    assert len(lacking) == 6 + 2 * 2
    assert masses(mixed(topology), topology).modules[0] == pytest.approx(0.3 / 0.24)
    assert as_design(random_point(mixed(topology), topology, np.random.default_rng(0))).types[0] == "battery"


@pytest.mark.slow
def test_merged_trees_cost_the_same_when_solved_apart() -> None:
    """Fifty candidates, each with the same platform seen from another module, and half a turn on."""
    rng = np.random.default_rng(1)
    light = [{"carries_weight": True, "units": "SI", "end_effector": {"force": [0.5, 0.0, 0.0]}}]
    types = [{"name": "quad", "count": 3}, {"name": "battery", "count": 1, "mass": 0.2, "rotors": []}]
    compared = 0
    for connectors in ("aligned", "any"):
        task = push(4, module_types=types, load_cases=light, search={"connectors": connectors})
        options = {"task": task, "symmetry": "task", "connectors": connectors}
        for candidate in sample(4, 25, seed=3, **options):
            graph = candidate.graph()
            order = [*rng.permutation(4).tolist()]
            other = nx.Graph()
            other.add_nodes_from((i, graph.nodes[i]) for i in order)
            for first, second, data in graph.edges(data=True):
                turned = {node: (port + 2) % 4 for node, port in data["ports"].items()}
                other.add_edge(first, second, ports=turned)
            apart = Topology.from_graph(other)
            assert candidate_of(apart, **options).key == candidate.key
            results = [solve(task.on(tree), tree, starts=range(24), seed=0) for tree in (candidate, apart)]
            efforts = [getattr(result, "objective", np.inf) for result in results]
            assert efforts[1] == pytest.approx(efforts[0], rel=2e-3), (candidate.key, apart.key)
            compared += np.isfinite(efforts[0])
    assert compared > 10


def test_bounds_allow_every_rotor_what_the_audit_allows() -> None:
    """Inputs beyond their limits, in u_max of [module], whatever that of the rotor's own type."""
    tree = Topology.from_key("a10-ab")
    task = mixed(tree, [{"name": "quad", "count": 1}, {"name": "small", "count": 1, "max_thrust": 0.2}])
    point = random_point(task, tree, np.random.default_rng(0))
    beyond = 0.99 * TOLERANCE * task.module.max_input(task.gravity)
    audited = audit(as_design(replace(point, u=np.array([task.input_limits + beyond] * len(point.u)))))
    allowed = [row.status for row in audited.residuals if "largest rotor input" in row.name]
    assert allowed
    assert set(allowed) == {"clear"}
    gains = [kind.thrust_coefficient * kind.rotor_table.gains.sum() for kind in task.module_types]
    assert tolerated_thrust(task) >= beyond * sum(gains)
