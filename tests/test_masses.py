"""Masses of joints and rods: solver, audit and exports agree, and bounds stay bounds."""

from dataclasses import replace
from typing import Any

import casadi as ca
import mujoco
import numba
import numpy as np
import pytest
from nlp_cases import as_design, push, random_point, random_tree
from suites import few

from nlp import lower_bound, pseudo_inverse
from nlp.joints import _vectors, limited_loads
from nlp.numbers.masses import masses
from nlp.numbers.point import weigh_rod
from nlp.problem import Variables
from nlp.reduced import inputs
from nlp.reduced import platform as poses
from nlp.reduced.arrays import to_arrays
from nlp.requirements.balances import inertia as point_inertia
from nlp.requirements.balances import required_wrenches, wrench_matrix, wrench_residuals
from nlp.units import Units
from nlp.user_constraints.rows import symbolic_platform
from topo_search.compose import BACKENDS
from topo_search.engine import Job
from topo_search.export.allocation import allocation
from topo_search.export.mjcf import SPIN, mjcf
from topo_search.export.urdf import urdf
from topo_search.model import BadInput, Design, Status, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.files import validate
from verify import audit
from verify.flight.joints import inertia, joint_loads, rod_inertia
from verify.kinematics import platform

JOINTS: dict[str, Any] = {"joint_mass": 0.04}


@numba.njit
def reduced_platform(problem, x):
    return poses.platform(problem, x)


@numba.njit
def reduced_inertia(rotors, pose):
    return inputs.inertia(rotors, pose)


@pytest.mark.parametrize("position", ["free", [0.1, 0.1, 0.3]])
@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_the_centre_of_mass_with_joints_is_one_and_the_same_everywhere(n: int, position: Any) -> None:
    """By definition, in the audit, at a point of the solver and in the compiled search, there with its slopes."""
    rng = np.random.default_rng(n)
    task, topology = push(n, module=JOINTS, end_effector={"position": position}), random_tree(n, rng)
    point = random_point(task, topology, rng)
    R, p = point.poses
    l_c, m, m_E = task.module.connector_distance, task.module.mass, task.end_effector.mass
    joints = [p[i] + l_c * R[i] @ PORT_DIRECTIONS[b] for _, i, _, b in topology.edges()]
    m_t = n * m + m_E + 0.04 * len(joints)
    expected = (m * p.sum(axis=0) + m_E * point.tip + 0.04 * np.sum(joints, axis=0)) / m_t
    found = platform(as_design(point))
    assert task.total_mass(n) == pytest.approx(m_t, rel=1e-14)
    assert m * masses(task, topology).total == pytest.approx(m_t, rel=1e-14)
    np.testing.assert_allclose(found.p_com, expected, atol=1e-12)
    np.testing.assert_allclose(found.joints, np.reshape(joints, (-1, 3)) - expected, atol=1e-12)
    np.testing.assert_allclose(point.p_COM, expected, atol=1e-12)
    if position != "free":
        np.testing.assert_allclose(found.p_e, position, atol=1e-12)

    stated, h = to_arrays(task, topology), 1e-6
    x = point.pack()[: len(stated.lower)]
    there = reduced_platform(stated, x)
    np.testing.assert_allclose(there.p_COM * task.module.arm_length, expected, atol=1e-12)
    for l in range(n + 2):
        up, down = (reduced_platform(stated, x + s * h * np.eye(len(x))[l]) for s in (1, -1))
        np.testing.assert_allclose(there.dC[l], (up.p_COM - down.p_COM) / (2 * h), atol=1e-8)


WALL: dict[str, Any] = {
    "module": {"joint_mass": 0.02, "max_thrust_to_weight": 3.0},
    "end_effector": {"rod": "straight", "rod_mass": "included", "rod_linear_density": 0.1, "largest_reach": None},
    "load_cases": [
        {"carries_weight": True, "units": "SI", "end_effector": {"force": [1.5, 0.0, 0.0]}},
        {"com": {"force": [0.0, 0.0, 1.1]}},
    ],
    "flight": {"torque_reserve": 0.05},
}


@pytest.fixture(scope="module")
def held() -> Design:
    """A design of four modules whose rod weighs a twentieth of the platform."""
    task = push(4, **WALL)
    outcome = BACKENDS.solve(Job(task, Topology.from_key("a3020"), starts=range(1), seed=0))
    assert isinstance(outcome, Design)
    assert outcome.task == task.with_rod(outcome.task.end_effector.counted_rod)  # bit by bit, as ledgers compare it
    return outcome


def test_a_rod_that_counts_weighs_what_it_is_long_and_no_load_case_is_missed(held: Design) -> None:
    task, rod = held.task, held.task.end_effector.counted_rod
    audited = audit(held)
    assert audited.verdict == Status.CLEAR
    tip = audited.assembly.end_effector
    assert (rod.module, rod.port) == (tip.mount.module, tip.mount.port)
    assert rod.mass == pytest.approx(0.1 * tip.rod.length_m, rel=1e-9)
    m_t = 4 * 0.24 + 0.048 + 3 * 0.02 + rod.mass
    assert task.total_mass(4) == pytest.approx(m_t, rel=1e-14)
    push_case, lift = task.load_cases
    assert push_case.at_com.force[2] == pytest.approx(m_t * 9.81, rel=1e-12)
    assert push_case.at_end_effector.force == (1.5, 0.0, 0.0)
    assert lift.at_com.force[2] == pytest.approx(1.1 * m_t * 9.81, rel=1e-12)
    assert task.flight.torque_reserve == pytest.approx(0.05 * task.torque_unit(4), rel=1e-12)
    assert held.lower_bound <= held.objective
    assert lower_bound(task) == pytest.approx(lower_bound(push(4, **WALL)), rel=1e-6)


def test_a_design_whose_rod_weighs_more_than_it_counts_is_violated(held: Design) -> None:
    rod = held.task.end_effector.counted_rod
    lighter = held.task.with_rod(rod.model_copy(update={"mass": 0.9 * rod.mass}))
    forgotten = held.model_copy(update={"task": lighter})
    broken = [row.name for row in audit(forgotten).residuals if row.status == Status.VIOLATED]
    assert "mass of the end-effector's rod" in broken
    unmounted = held.model_dump(mode="json") | {"mount": None}
    with pytest.raises(BadInput, match="counted_rod"):
        validate(Design, unmounted, "design")


def test_mass_and_inertia_of_exports_are_those_of_the_audit(held: Design) -> None:
    found = platform(held)
    J, m_t = inertia(held, found), held.task.total_mass(4)
    for text, root in ((mjcf(held), "platform"), (urdf(held), "module_0")):
        spec = mujoco.MjSpec.from_string(text)
        if root == "module_0":
            spec.body(root).add_freejoint()
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        M, com = np.zeros((6, 6)), data.body(root).subtree_com
        mujoco.mj_fullM(model, data, M)
        assert M[0, 0] == pytest.approx(m_t, rel=1e-12)
        np.testing.assert_allclose(com, found.p_com if root == "module_0" else np.zeros(3), atol=1e-12)
        about_com = M[3:, 3:] - m_t * (com @ com * np.eye(3) - np.outer(com, com))
        np.testing.assert_allclose(
            about_com, J, rtol=0, atol=10 * SPIN
        )  # exports give it to ten point masses at most
    acts = allocation(held)
    assert acts.mass_kg == m_t
    np.testing.assert_allclose(acts.inertia_kg_m2, J, atol=1e-14)


def test_a_rod_is_a_thin_tube(held: Design) -> None:
    """As two rings of points where Gauss integrates squares exactly."""
    wide = held.task.end_effector.model_copy(update={"rod_radius": 0.05})
    design = held.model_copy(update={"task": held.task.model_copy(update={"end_effector": wide})})
    found, m = platform(design), wide.counted_rod.mass
    half = found.rod[0, 1]
    sides = np.linalg.svd(half[None])[2][1:]
    angles = np.arange(8) * np.pi / 4
    ring = 0.05 * np.column_stack([np.cos(angles), np.sin(angles)]) @ sides
    points = np.concatenate([ring + sign * half / np.sqrt(3) for sign in (1, -1)])
    J = np.sum(points**2) * np.eye(3) - points.T @ points
    np.testing.assert_allclose(rod_inertia(design, found), m * J / len(points), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("position", ["free", [0.1, 0.1, 0.3]])
def test_the_inertia_is_that_of_the_audit_wherever_a_torque_is_asked_for(position: Any) -> None:
    """At a point of the solver, in its rows, in the compiled search and in what a user's constraints get."""
    rng = np.random.default_rng(3)
    tip = {**WALL["end_effector"], "position": position}
    for n in (1, 4, 7):
        tree = random_tree(n, rng)
        point = random_point(push(n, **{**WALL, "end_effector": tip}), tree, rng)
        light = inertia(as_design(point), platform(as_design(point)))
        point = weigh_rod(point, tree.free_connectors[int(rng.integers(len(tree.free_connectors)))])
        task, unit = point.task, point.task.module.mass * point.task.module.arm_length**2
        J = inertia(as_design(point), platform(as_design(point)))
        assert np.abs(J - light).max() > 1e-3 * np.abs(J).max()
        np.testing.assert_allclose(point_inertia(point), J, rtol=1e-10, atol=1e-14)
        stated = to_arrays(task, tree)
        there = reduced_platform(stated, point.pack()[: len(stated.lower)])
        np.testing.assert_allclose(reduced_inertia(stated.rotors, there) * unit, J, rtol=1e-10, atol=1e-14)
        x = Variables.of(task, tree)
        inertia_of = pseudo_inverse._inertia(symbolic_platform(task, tree, x))
        symbolic = ca.Function("J", [x.vector()], [inertia_of])
        np.testing.assert_allclose(np.array(symbolic(point.pack())), J, rtol=1e-10, atol=1e-14)


HEAVY: dict[str, Any] = {
    "module": {"joint_mass": 0.03},
    "end_effector": {"rod": "straight", "rod_mass": "included", "largest_reach": None},
    "load_cases": [{"carries_weight": True}, {"carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}}],
}


@pytest.mark.parametrize(("allocator", "about_x"), few([("optimal", 20.0), ("pseudo-inverse", 14.0)], 1))
def test_a_heavy_platform_has_the_accelerations_and_reserves_that_are_asked_for(allocator, about_x):
    """Its inertia is that of the audit, and reserves in weights grow with the rod's, by either allocator."""
    flight = {"angular_acceleration": [about_x, 3.0, 2.0], "force_reserve": 0.05, "directions": "horizontal"}
    task = push(4, **HEAVY, flight={**flight, "allocator": allocator})
    design = BACKENDS.solve(Job(task, Topology.from_key("a3020"), starts=range(1), seed=0))
    assert isinstance(design, Design)
    judged = audit(design)
    rows = {row.name: row for row in judged.residuals if row.name.startswith("hover, ") and row.stated}
    assert judged.verdict == Status.CLEAR
    assert rows["hover, horizontal force reserve"].stated == pytest.approx(0.05 * design.task.force_unit(4))
    assert min(row.derived / row.stated for row in rows.values()) == pytest.approx(1.0, abs=1e-4)


def test_a_rod_stays_where_it_counts_though_another_is_nearer_without_its_mass() -> None:
    """Solved with the rod at either of two connectors, the other one is nearer: each is a design of its own."""
    fields = {"end_effector": WALL["end_effector"], "load_cases": [{"carries_weight": True}]}
    task = push(4, **fields, flight={"tilt_deg": 3.0})
    design = BACKENDS.solve(Job(task, Topology.from_key("a3020"), starts=range(1), seed=0))
    assert isinstance(design, Design)
    judged = audit(design)
    assert judged.verdict == Status.CLEAR
    rods = {(one.module, one.port): one.length_m for one in judged.assembly.end_effector.connectors}
    assert rods[design.mount.module, design.mount.port] > min(rods.values())


def test_every_local_optimum_counts_its_rod() -> None:
    tree = Topology.from_key("a3020")
    found = BACKENDS.local_optima(Job(push(4, **HEAVY), tree, range(2), 0), 1.2e14)
    assert len({design.task.end_effector.counted_rod.mass for design in found}) > 1
    assert {audit(design).verdict for design in found} == {Status.CLEAR}


def test_solver_and_audit_agree_on_a_platform_with_a_rod_that_counts() -> None:
    """At any balanced point: where the centre of mass is, and what joints bear under inertia."""
    rng = np.random.default_rng(7)
    turning = {"com": {"force": [0.0, 0.1, 0.9], "torque": [0.2, 0.1, -0.3]}}
    fields = {**WALL, "load_cases": [turning], "flight": {"joint_moment": 1.0, "joint_force": 1.0}}
    for n in (4, 5, 6):
        tree = random_tree(n, rng)
        point = random_point(push(n, **fields), tree, rng)
        connector = tree.free_connectors[int(rng.integers(len(tree.free_connectors)))]
        point = weigh_rod(point, connector)
        u = np.linalg.lstsq(wrench_matrix(point), required_wrenches(point).T, rcond=None)[0].T
        point = replace(point, u=u.reshape(point.u.shape))
        design = as_design(point)
        found = platform(design)
        np.testing.assert_allclose(point.p_COM, found.p_com, atol=1e-12)
        if wrench_residuals(point).max() > 1e-9:
            continue
        limits = tuple(limited_loads(point.task, tree))
        for held_by in (connector[0], None):
            x, vectors = _vectors(point.task, tree, held_by, limits)
            sizes = [ca.mmax(ca.vertcat(*map(ca.norm_2, sides))) for sides in vectors]
            solved = np.asarray(ca.Function("sizes", [x], [ca.vertcat(*sizes)])(point.pack())).ravel()
            rows = list(joint_loads(design, found, point.task.load_cases[0], point.u[0], "", held_by))
            unit = Units.of(point.task)
            audited = [r.force_N / unit.force for r in rows] + [r.moment_Nm / unit.torque for r in rows]
            np.testing.assert_allclose(solved, audited, rtol=1e-9)
