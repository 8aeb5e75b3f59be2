"""Modules with rotors of their own: what solver, audit, counts and exports make of them, and what is refused."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pytest
from commands import refused
from nlp_cases import GENTLE_PUSH, as_design, push, random_point, random_tree
from scipy.optimize import linprog

from nlp import proven_bound, solve
from nlp.assembled.platform import AssembledPlatform, Layout
from nlp.bounds.branch.arrays import reroot
from nlp.numbers.point import Point
from nlp.requirements.balances import wrench_matrix
from nlp.symbols.platform import wrench_map as symbolic_map
from nlp.units import Units
from topo_search.export.allocation import allocation
from topo_search.export.mjcf import mjcf
from topo_search.model import BadInput, Design, Module, Topology
from topo_search.model.files import to_toml, validate
from topo_search.model.rotors import x_quadrotor
from topo_search.model.task import Task
from topo_search.model.task_file import read_task
from topo_search.model.vehicle import read_vehicle
from topo_search.simulation.plant import nominal
from topo_search.topologies import Symmetry, candidates, count, exact_group, resolve_symmetry
from topo_search.topologies.family import Family
from topo_search.topologies.rooted import GROUPS as ELEMENTS
from topo_search.topologies.rooted import image, key_of, rooted_of, text_of
from verify import audit
from verify.flight.vehicle import capability
from verify.kinematics import platform, wrench_map

Table = dict[str, Any]
S = 0.1 / math.sqrt(2)
X: list[Table] = [
    {"position": [S, -S, 0.0], "spin": 1},
    {"position": [-S, -S, 0.0], "spin": -1},
    {"position": [-S, S, 0.0], "spin": 1},
    {"position": [S, S, 0.0], "spin": -1},
]
SMALL: Table = {"body": {"rotor_radius": 0.03}}


def star(tilt_deg: float, arm: float = 0.1) -> list[Table]:
    """Six rotors, tilted about their arms by alternate signs."""
    rotors = []
    for q in range(6):
        a, b = q * math.pi / 3, math.radians(tilt_deg) * (-1) ** q
        axis = [math.sin(a) * math.sin(b), -math.cos(a) * math.sin(b), math.cos(b)]
        spin = 1 if q % 2 == 0 else -1
        rotors.append({"position": [arm * math.cos(a), arm * math.sin(a), 0.0], "axis": axis, "spin": spin})
    return rotors


def own_kinds(rng: np.random.Generator, r: int) -> list[Table]:
    """Coefficients, limits and radii of r rotors, some of them the module's."""
    ranges = {"thrust_coefficient": (2e-7, 5e-7), "torque_coefficient": (3e-9, 9e-9)}
    ranges |= {"max_thrust": (1.0, 3.0), "radius": (0.015, 0.035)}
    return [{name: rng.uniform(*bounds) for name, bounds in ranges.items() if rng.random() < 0.7} for _ in range(r)]


def random_rotors(rng: np.random.Generator, tilt: float = 0.15, *, alike: bool = True) -> list[Table]:
    """Two to eight rotors around the centre, whose axes lean at random, and along z in sum."""
    r = int(rng.integers(2, 9))
    angles = 2 * np.pi * (np.arange(r) + rng.uniform(-0.1, 0.1, r)) / r
    distances = rng.uniform(0.1, 0.13, r)
    places = np.column_stack([distances * np.cos(angles), distances * np.sin(angles), rng.uniform(-0.02, 0.02, r)])
    axes = np.column_stack([tilt * rng.uniform(-1.0, 1.0, (r, 2)), np.ones(r)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    mean = axes.sum(axis=0) / np.linalg.norm(axes.sum(axis=0))
    v = np.cross(mean, [0.0, 0.0, 1.0])
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    axes = axes @ (np.eye(3) + K + K @ K / (1 + mean[2])).T
    spins = rng.choice([-1, 1], r).tolist()
    return [
        {"position": place, "axis": axis, "spin": spin, **kind}
        for place, axis, spin, kind in zip(
            places.tolist(), axes.tolist(), spins, [{}] * r if alike else own_kinds(rng, r), strict=True
        )
    ]


def own_map(module: Module, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Wrench of every rotor at unit input about the origin of p, from the fields of the task file alone."""
    columns = []
    for R_i, p_i in zip(R, p, strict=True):
        for rotor in module.rotors or ():
            a = R_i @ (np.array(rotor.axis) / np.linalg.norm(rotor.axis))
            r = p_i + R_i @ np.array(rotor.position)
            k_f = rotor.thrust_coefficient or module.thrust_coefficient
            torque = k_f * np.cross(r, a) - rotor.spin * (rotor.torque_coefficient or module.torque_coefficient) * a
            columns.append(np.concatenate([k_f * a, torque]))
    return np.array(columns).T


def own_limits(task: Any) -> np.ndarray:
    """Largest input of every rotor, from the fields of the task file alone."""
    module, rotors = task.module, task.module.rotors or ()
    weight = module.mass * task.gravity
    thrusts = [rotor.max_thrust or module.max_thrust_to_weight * weight / len(rotors) for rotor in rotors]
    coefficients = [rotor.thrust_coefficient or module.thrust_coefficient for rotor in rotors]
    return np.tile(np.array(thrusts) / coefficients, task.n)


def upright(point: Point, rng: np.random.Generator) -> Point:
    """The platform with its root level and its hinges nearly flat, which can often hover."""
    alpha = rng.uniform(-0.4, 0.4, len(point.alpha))
    return replace(point, root=np.zeros(3), alpha=alpha, tip=np.array([0.3, 0.0, -0.2]))


MODULES = [*range(8), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(8, 50))]
"""Seeds of random modules; every second one has rotors with coefficients, limits and radii of their own."""


@pytest.mark.parametrize("seed", MODULES)
def test_solver_and_audit_have_the_wrenches_of_the_task_file(seed: int) -> None:
    rng = np.random.default_rng(seed)
    task = push(int(rng.integers(1, 6)), module={"rotors": random_rotors(rng, alike=seed % 2 == 0), **SMALL})
    point = random_point(task, random_tree(task.n, rng), rng)
    (R, p), module, unit = point.poses, task.module, Units.of(task)
    expected = own_map(module, R, p)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(wrench_matrix(point), expected, rtol=0, atol=1e-12 * scale)
    design = as_design(point)
    about_com = own_map(module, R, p - point.p_COM)
    np.testing.assert_allclose(wrench_map(platform(design), module), about_com, rtol=0, atol=1e-12 * scale)

    in_units = expected * unit.input / np.repeat([unit.force, unit.torque], 3)[:, None]
    printed = symbolic_map([ca.DM(R_i) for R_i in R], [ca.DM(p_i / unit.length) for p_i in p], task)
    np.testing.assert_allclose(np.array(ca.evalf(printed)), in_units, rtol=0, atol=1e-12)
    x = np.concatenate([point.root, point.alpha, point.tip / unit.length])
    assembled = AssembledPlatform(Layout(task, point.topology), x).A * task.n
    np.testing.assert_allclose(assembled.T, in_units, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", MODULES)
def test_hover_reserves_and_single_failures_are_those_of_linear_programs(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    rotors = random_rotors(rng, alike=seed % 2 == 0)
    task = push(3, module={"rotors": rotors, "max_thrust_to_weight": 12.0, **SMALL})
    point = upright(random_point(task, Topology.from_key("a300"), rng), rng)
    design, weight = as_design(point), task.force_unit(3)
    out = audit(design).flight
    assert out is not None
    (R, p), l_arm = point.poses, task.module.arm_length
    scale = np.repeat([weight, weight * l_arm], 3)[:, None]
    A = own_map(task.module, R, p - point.p_COM) * own_limits(task) / scale
    hover = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def largest_factor(wrench: np.ndarray, added: np.ndarray, dead: int | None = None) -> float:
        """The largest multiple of a wrench that can be added; -inf if nothing can."""
        bounds = [(0.0, 0.0 if j == dead else 1.0) for j in range(A.shape[1])] + [(0.0, None)]
        A_eq = np.column_stack([A, -added])
        found = linprog([*np.zeros(A.shape[1]), -1.0], A_eq=A_eq, b_eq=wrench, bounds=bounds)
        return float(found.x[-1]) if found.status == 0 else -math.inf

    alive = largest_factor(np.zeros(6), hover)
    if alive > 1 + 1e-6:
        assert out.hover.load_factor == pytest.approx(alive, rel=1e-6)
        # the reserve is the least over all horizontal directions, and that of the reported one
        reserve, weakest = out.hover.horizontal_reserve_com_N, out.hover.horizontal_weakest_com
        directions = [(math.cos(a), math.sin(a), 0.0) for a in np.linspace(0, 2 * math.pi, 24, endpoint=False)]
        held = [weight * largest_factor(hover, np.array([*d, 0.0, 0.0, 0.0])) for d in (weakest, *directions)]
        assert reserve == pytest.approx(held[0], rel=1e-5, abs=1e-7 * weight)
        assert min(held) >= reserve * (1 - 1e-6) - 1e-7 * weight
        # no torque that linear programs hold is below the proven reserve, and the weakest one known is near it
        torques = [out.hover.torque_weakest, *rng.normal(size=(24, 3))]
        turned = [np.append(np.zeros(3), d / np.linalg.norm(d)) for d in torques]
        held = [weight * l_arm * largest_factor(hover, d) for d in turned]
        assert min(held) >= out.hover.torque_reserve_Nm * (1 - 1e-6) - 1e-7 * weight * l_arm
        assert held[0] <= out.hover.torque_reserve_at_most_Nm * (1 + 1e-6) + 1e-7 * weight * l_arm
    lost = [divmod(j, len(rotors)) for j in range(A.shape[1]) if largest_factor(np.zeros(6), hover, j) < 1 - 1e-6]
    assert set(out.rotors_out_hover.lost) == set(lost)
    assert out.rotors_out_hover.of == A.shape[1]


@pytest.mark.parametrize("seed", [1, 3])
def test_a_search_keeps_each_rotor_s_own_limits_and_its_effort_above_every_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = own_kinds(rng, 4)
    rotors = [
        {**rotor, **kind, "max_thrust": 2.0 + q / 4} for q, (rotor, kind) in enumerate(zip(X, kinds, strict=True))
    ]
    task = push(3, module={"rotors": rotors, "min_input": 0.05, **SMALL})
    assert not task.module.rotor_table.is_uniform
    design = solve(task, Topology.from_key("a300"), starts=range(6), seed=0)
    assert isinstance(design, Design)
    found = audit(design)
    assert found.verdict == "clear"
    shares = design.inputs.reshape(-1, 12) / own_limits(task)
    assert 0.05 - 1e-6 <= shares.min() <= shares.max() <= 1 + 1e-6
    assert proven_bound(task) <= design.objective
    # every load case has the least sum of squared inputs at its wrench, by another program
    A = own_map(task.module, platform(design).R, platform(design).o)
    for u in design.inputs.reshape(-1, 12):
        low, high = 0.05 * own_limits(task), own_limits(task)
        free = (u > low * (1 + 1e-4)) & (u < high * (1 - 1e-4))
        # stationary: free inputs are in the row space of their columns
        mu, *_ = np.linalg.lstsq(A[:, free].T, u[free], rcond=None)
        np.testing.assert_allclose(A[:, free].T @ mu, u[free], rtol=0, atol=1e-3 * u.max())


def test_exports_and_controller_have_the_thrusts_of_each_rotor(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    kinds = own_kinds(rng, 4)
    task = push(2, module={"rotors": [{**rotor, **kind} for rotor, kind in zip(X, kinds, strict=True)], **SMALL})
    point = random_point(task, Topology.from_key("a10"), rng)
    design, (R, p) = as_design(point), point.poses
    expected = own_map(task.module, R, p - point.p_COM) * own_limits(task)
    table, model = allocation(design), nominal(design, rod_mass=False)
    np.testing.assert_allclose(np.array(table.matrix) * own_limits(task), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(model.B * model.largest_thrust, expected, rtol=1e-9, atol=1e-12)
    (file := tmp_path / "rotors.csv").write_text(table.rotor_csv())
    vehicle = read_vehicle(file)
    largest = [rotor.k_f * rotor.u_max for rotor in vehicle.rotors]
    np.testing.assert_allclose(largest, model.largest_thrust, rtol=1e-9)
    simulated = mujoco.MjModel.from_xml_string(mjcf(design))
    np.testing.assert_allclose(simulated.actuator_ctrlrange[:, 1], model.largest_thrust, rtol=1e-6)
    ratios = [-r.spin * r.k_tau / r.k_f for r in vehicle.rotors]
    np.testing.assert_allclose(simulated.actuator_gear[:, 5], ratios, rtol=1e-6)
    discs = [g for g in range(simulated.ngeom) if simulated.geom_type[g] == mujoco.mjtGeom.mjGEOM_CYLINDER]
    radii = [kind.get("radius", 0.03) for kind in kinds] * 2
    np.testing.assert_allclose(simulated.geom_size[discs, 0], radii, rtol=1e-6)


def test_a_rotor_s_own_values_that_are_the_module_s_change_nothing() -> None:
    own = {"thrust_coefficient": 3.87e-7, "torque_coefficient": 1.06e-8, "radius": 0.05}
    assert push(3, module={"rotors": [{**rotor, **own} for rotor in X]}) == push(3)


def test_an_x_written_as_a_table_is_the_default() -> None:
    module = Module.model_validate({"rotors": X})
    for mine, its in zip(vars(module.rotor_table).values(), vars(x_quadrotor()).values(), strict=True):
        np.testing.assert_allclose(mine, its, rtol=0, atol=1e-15)
    assert module.inertia == pytest.approx(Module().inertia, rel=1e-12)
    assert push(3, module={"rotors": X}) == push(3)


def test_an_x_that_is_barely_moved_has_the_same_trees_bounds_and_efforts() -> None:
    moved = [{**rotor, "position": [*rotor["position"][:2], 1e-7]} for rotor in X]
    tables = push(3), push(3, module={"rotors": moved})
    assert tables[1].module.rotors is not None
    keys = [[tree.key for tree in candidates(3, symmetry="task", task=task)] for task in tables]
    assert keys[0] == keys[1]
    assert proven_bound(tables[0]) == pytest.approx(proven_bound(tables[1]), rel=1e-9)
    outcomes = [solve(task, Topology.from_key("a300"), starts=range(8), seed=0) for task in tables]
    efforts = [design.objective for design in outcomes if isinstance(design, Design)]
    assert len(efforts) == 2
    assert efforts[0] == pytest.approx(efforts[1], rel=1e-4)


@pytest.mark.parametrize("tilt", [30.0, math.degrees(math.acos(1 / math.sqrt(3)))])
def test_a_star_hexarotor_exerts_forces_without_torque_in_a_known_volume(tilt: float, tmp_path: Any) -> None:
    """12 sqrt 3 c s^2 of a rotor's largest thrust cubed, for rotors without drag: that of the parallelepiped."""
    module = {"rotors": star(tilt), "torque_coefficient": 1e-15, **SMALL}
    task = push(1, module=module, search={"interference": "separation"}, end_effector={"rod": "none", "mass": 0.0})
    point = random_point(task, Topology.from_key("a0"), np.random.default_rng(0))
    table = allocation(as_design(point))
    (file := tmp_path / "rotors.csv").write_text(table.rotor_csv())
    found = capability(read_vehicle(file))
    assert found is not None
    c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    expected = 12 * math.sqrt(3) * c * s * s * table.rotors[0].largest_thrust_N ** 3
    assert found.zero_torque_volume_N3 == pytest.approx(expected, rel=1e-6)
    assert found.rank == 6


SIDE = [{"position": [0.1, 0.0, 0.0], "spin": 1}, {"position": [-0.1, 0.0, 0.0], "spin": -1}]
LEANING = ([0.2, 0.1, 1.0], [0.0, 0.0, 1.0], [-0.2, -0.1, 1.0], [0.0, 0.0, 1.0])
THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
GROUPS: dict[str, tuple[list[Table], str]] = {
    "X": (X, "d2"),
    "leaning rotors": ([{**rotor, "axis": axis} for rotor, axis in zip(X, LEANING, strict=True)], "c2"),
    "three rotors": ([{"position": [0.1 * math.cos(a), 0.1 * math.sin(a), 0.0], "spin": 1} for a in THIRDS], "c1"),
    "two rotors of opposite spins": (SIDE, "c1"),
    "two rotors of one spin": ([{**rotor, "spin": 1} for rotor in SIDE], "c2"),
    "a star": (star(15.0), "c1"),
    "two strong rotors": ([{**X[0], "max_thrust": 2.0}, *X[1:2], {**X[2], "max_thrust": 2.0}, X[3]], "c2"),
    "an X with one large rotor": ([{**X[0], "radius": 0.04}, *X[1:]], "c1"),
}  # fmt: skip


@pytest.mark.parametrize("name", GROUPS)
def test_the_symmetry_of_a_module_follows_from_its_table(name: str) -> None:
    rotors, group = GROUPS[name]
    for n in range(1, 6):
        task = push(n, module={"rotors": rotors, **SMALL})
        assert exact_group(task) == group
        listed = [tree.key for tree in candidates(n, symmetry="task", task=task)]
        assert len(listed) == count(n, symmetry="task", task=task) == len(set(listed))
        plain: dict[str, Symmetry] = {"d2": "d2", "c2": "c2", "c1": "none"}
        assert listed == [tree.key for tree in candidates(n, symmetry=plain[group])]
    assert resolve_symmetry(task).exact


PAIRS = [*range(2), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 50))]
"""Seeds of pairs of trees of one class, for each group."""


@pytest.mark.parametrize("name", ["X", "leaning rotors", "three rotors"])
@pytest.mark.parametrize("seed", PAIRS)
def test_trees_of_one_class_cost_the_same_when_solved_apart(name: str, seed: int) -> None:
    """Turned or mirrored by an element of the module's group, and seen from another module."""
    (rotors, group), rng = GROUPS[name], np.random.default_rng(seed)
    task = push(3, module={"rotors": rotors, "max_thrust_to_weight": 4.0, **SMALL}, load_cases=GENTLE_PUSH)
    family = Family(3, symmetry="task", task=task)
    assert family.group == group
    listed = [one.topology for one in family.candidates()]
    tree = listed[int(rng.integers(len(listed)))]
    element = ELEMENTS[group][int(rng.integers(len(ELEMENTS[group])))]
    other = reroot(Topology.from_key(key_of(text_of(image(rooted_of(tree.key), element)))), int(rng.integers(3)))
    costs = [solve(task, one, starts=range(8), seed=seed) for one in (tree, other)]
    efforts = [one.objective if isinstance(one, Design) else None for one in costs]
    assert efforts[0] == (None if efforts[1] is None else pytest.approx(efforts[1], rel=1e-4)), (
        tree.key,
        other.key,
    )


BAD: dict[str, tuple[Table, str, str]] = {
    "overlap": (
        {"rotors": [{"position": [0.1, 0.0, 0.0], "spin": 1}, {"position": [0.15, 0.0, 0.0], "spin": 1}]},
        "module.rotors[1].position",
        "0.05 m apart",
    ),
    "crossing discs": (
        {"rotors": [
            {"position": [0.1, 0.0, 0.0], "axis": [1.0, 0.0, 1.0], "spin": 1},
            {"position": [0.1, 0.0, 0.02], "axis": [-1.0, 0.0, 1.0], "spin": 1},
        ]},
        "module.rotors[1].position",
        "0.02 m apart",
    ),
    "too far out": (
        {"rotors": [*X[:3], {"position": [0.21, 0.0, 0.0], "spin": 1}]},
        "module.rotors[3].position",
        "connector_distance + body.rotor_radius = 0.2 m",
    ),
    "no direction": (
        {"rotors": [*X[:3], {**X[3], "axis": [0.0, 0.0, 0.0]}]}, "module.rotors[3].axis", "zero vector"
    ),
    "downwards": ({"rotors": [{**rotor, "axis": [0.0, 0.0, -1.0]} for rotor in X]}, "module.rotors", "point up"),
    "aside": ({"rotors": [{**rotor, "axis": [1.0, 0.0, 1.0]} for rotor in X]}, "module.rotors", "[0.7071, 0.0,"),
    "no rotor": ({"rotors": []}, "module.rotors", "at least one"),
    "spin": ({"rotors": [*X[:3], {**X[3], "spin": 2}]}, "module.rotors[3].spin", "2"),
    "no spin": ({"rotors": [{"position": [0.1, 0.0, 0.0]}]}, "module.rotors[0].spin", "missing"),
    "speed of the envelope": (
        {"rotors": star(10.0), "airflow": {"speed": 3.0}, **SMALL}, "module.airflow.speed", "blow along"
    ),
    "tilt": ({"rotors": star(30.0), **SMALL}, "module.rotors", "30 deg"),
    "own radii": (
        {"rotors": [{**X[0], "radius": 0.07}, *X[1:3], {**X[3], "radius": 0.08}]},
        "module.rotors[3].position",
        "0.08 m",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_no_module_can_have_is_refused_with_field_rule_and_value(name: str) -> None:
    module, field, words = BAD[name]
    data = {"name": "t", "modules": 2, "module": module, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]}
    with pytest.raises(BadInput) as caught:
        validate(Task, data, "t.toml")
    assert [fault.path for fault in caught.value.faults] == [field]
    assert words in caught.value.faults[0].rule


def test_a_rotor_better_than_ideal_is_refused_with_its_number(tmp_path: Path) -> None:
    rotors = [*X[:3], {**X[3], "torque_coefficient": 1e-9}]
    data = {"name": "t", "modules": 2, "module": {"rotors": rotors}, "load_cases": [{"carries_weight": True}]}
    (file := tmp_path / "t.toml").write_text(to_toml(validate(Task, data, "t")))
    with pytest.raises(BadInput, match=r"module\.rotors\[3\]\.torque_coefficient: must give a figure of merit"):
        read_task(file)


def test_any_connectors_need_a_module_that_half_a_turn_leaves_as_it_is() -> None:
    for name, is_refused in (("leaning rotors", False), ("three rotors", True)):
        module = {"rotors": GROUPS[name][0], **SMALL}
        if is_refused:
            with pytest.raises(ValueError, match=r'search\.connectors|must be "aligned"'):
                push(3, module=module, search={"connectors": "any"})
        else:
            push(3, module=module, search={"connectors": "any"})


def test_what_is_not_known_of_other_rotors_is_refused_by_its_commands(tmp_path: Path) -> None:
    module = {"rotors": star(10.0), **SMALL}
    data = {"name": "t", "modules": 2, "module": module, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]}
    (file := tmp_path / "t.toml").write_text(to_toml(validate(Task, data, "t")))
    for words in (("airflow", file, "--speed", "3"), ("run", file, "--prove", "0.1", "--out", tmp_path / "run")):
        assert "module.rotors: must" in refused(*words)
