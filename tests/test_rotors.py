"""Modules with rotors of their own: what solver, audit, counts and exports make of them, and what is refused."""

import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from commands import refused
from nlp_cases import as_design, push, random_point, random_tree
from scipy.optimize import linprog

from nlp import proven_bound, solve
from nlp.assembled.platform import AssembledPlatform, Layout
from nlp.requirements.balances import wrench_matrix
from nlp.symbols.platform import wrench_map as symbolic_map
from nlp.units import Units
from topo_search.export.allocation import allocation
from topo_search.model import BadInput, Design, Module, Topology
from topo_search.model.files import to_toml, validate
from topo_search.model.rotors import x_quadrotor
from topo_search.model.task import Task
from topo_search.model.vehicle import read_vehicle
from topo_search.topologies import Symmetry, candidates, count, exact_group, resolve_symmetry
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


def random_rotors(rng: np.random.Generator, tilt: float = 0.15) -> list[Table]:
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
        {"position": place, "axis": axis, "spin": spin}
        for place, axis, spin in zip(places.tolist(), axes.tolist(), spins, strict=True)
    ]


def own_map(module: Module, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Wrench of every rotor at unit input about the origin of p, from the fields of the task file alone."""
    columns = []
    for R_i, p_i in zip(R, p, strict=True):
        for rotor in module.rotors or ():
            a = R_i @ (np.array(rotor.axis) / np.linalg.norm(rotor.axis))
            r = p_i + R_i @ np.array(rotor.position)
            torque = module.thrust_coefficient * np.cross(r, a) - rotor.spin * module.torque_coefficient * a
            columns.append(np.concatenate([module.thrust_coefficient * a, torque]))
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(12))
def test_solver_and_audit_have_the_wrenches_of_the_task_file(seed: int) -> None:
    rng = np.random.default_rng(seed)
    task = push(int(rng.integers(1, 6)), module={"rotors": random_rotors(rng), **SMALL})
    point = random_point(task, random_tree(task.n, rng), rng)
    (R, p), module, unit = point.poses, task.module, Units.of(task)
    expected = own_map(module, R, p)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(wrench_matrix(point), expected, rtol=0, atol=1e-12 * scale)
    design = as_design(point)
    about_com = own_map(module, R, p - point.p_COM)
    np.testing.assert_allclose(wrench_map(platform(design), module), about_com, rtol=0, atol=1e-12 * scale)

    in_units = expected * unit.input / np.repeat([unit.force, unit.torque], 3)[:, None]
    printed = symbolic_map([ca.DM(R_i) for R_i in R], [ca.DM(p_i / unit.length) for p_i in p], module)
    np.testing.assert_allclose(np.array(ca.evalf(printed)), in_units, rtol=0, atol=1e-12)
    x = np.concatenate([point.root, point.alpha, point.tip / unit.length])
    assembled = AssembledPlatform(Layout(task, point.topology), x).A * task.n
    np.testing.assert_allclose(assembled.T, in_units, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_hover_and_single_failures_are_those_of_linear_programs(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    task = push(3, module={"rotors": random_rotors(rng), "max_thrust_to_weight": 4.0, **SMALL})
    design = as_design(random_point(task, Topology.from_key("a300"), rng))
    out = audit(design).flight
    assert out is not None
    A = wrench_map(platform(design), task.module) * task.module.max_input(task.gravity)
    hover = np.array([0, 0, task.force_unit(3), 0, 0, 0])

    def largest_factor(dead: int | None) -> float:
        """The largest multiple of the weight that can be carried; -1 if none can."""
        bounds = [(0.0, 0.0 if j == dead else 1.0) for j in range(A.shape[1])] + [(0.0, None)]
        found = linprog(
            [*np.zeros(A.shape[1]), -1.0], A_eq=np.column_stack([A, -hover]), b_eq=np.zeros(6), bounds=bounds
        )
        return float(found.x[-1])

    alive = largest_factor(None)
    if alive > 1 + 1e-6:
        assert out.hover.load_factor == pytest.approx(alive, rel=1e-6)
    lost = [divmod(j, len(task.module.rotors or ())) for j in range(A.shape[1]) if largest_factor(j) < 1 - 1e-6]
    assert set(out.rotors_out_hover.lost) == set(lost)
    assert out.rotors_out_hover.of == A.shape[1]


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
}  # fmt: skip


@pytest.mark.parametrize("name", GROUPS)
def test_the_symmetry_of_a_module_follows_from_its_table(name: str) -> None:
    rotors, group = GROUPS[name]
    for n in range(1, 5):
        task = push(n, module={"rotors": rotors, **SMALL})
        assert exact_group(task) == group
        listed = [tree.key for tree in candidates(n, symmetry="task", task=task)]
        assert len(listed) == count(n, symmetry="task", task=task) == len(set(listed))
        plain: dict[str, Symmetry] = {"d2": "d2", "c2": "c2", "c1": "none"}
        assert listed == [tree.key for tree in candidates(n, symmetry=plain[group])]
    assert resolve_symmetry(task).exact


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
        {"rotors": star(10.0), "airflow": {"speed": 3.0}, **SMALL}, "module.airflow.speed", "other than an X"
    ),
    "tilt": ({"rotors": star(30.0), **SMALL}, "module.rotors", "30 deg"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_no_module_can_have_is_refused_with_field_rule_and_value(name: str) -> None:
    module, field, words = BAD[name]
    data = {"name": "t", "modules": 2, "module": module, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]}
    with pytest.raises(BadInput) as caught:
        validate(Task, data, "t.toml")
    assert [fault.path for fault in caught.value.faults] == [field]
    assert words in caught.value.faults[0].rule


def test_air_speeds_of_other_rotors_are_refused_and_not_guessed() -> None:
    region = {"kind": "local", "radius": 0.1, "speed": 3.0}
    with pytest.raises(ValueError, match="other than an X"):
        push(2, module={"rotors": star(10.0), **SMALL}, exposure=[region])
    task = push(2, module={"rotors": star(10.0), **SMALL})
    design = as_design(random_point(task, Topology.from_key("a10"), np.random.default_rng(0)))
    assert audit(design).air is None
    assert (
        audit(as_design(random_point(push(2), Topology.from_key("a10"), np.random.default_rng(0)))).air is not None
    )


def test_what_is_not_known_of_other_rotors_is_refused_by_its_commands(tmp_path: Path) -> None:
    module = {"rotors": star(10.0), **SMALL}
    data = {"name": "t", "modules": 2, "module": module, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]}
    (file := tmp_path / "t.toml").write_text(to_toml(validate(Task, data, "t")))
    for words in (("airflow", file, "--speed", "3"), ("run", file, "--prove", "0.1", "--out", tmp_path / "run")):
        assert "module.rotors: must be" in refused(*words)
