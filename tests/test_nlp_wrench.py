"""The wrench balance as symbols, as the solver's numbers and as the audit's; spins and frames."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import as_design, hover, push, random_point, trees

from nlp import names
from nlp.evaluation import violations
from nlp.numbers.point import Point
from nlp.problem import problem
from nlp.requirements.balances import required_wrenches, wrench_matrix
from topo_search.model import Topology
from verify.kinematics import platform, wrench_errors
from verify.residuals import residuals

EVERYTHING = [
    {
        "end_effector": {"force": [0.5, -0.1, 0.3], "torque": [0.1, 0.2, -0.3]},
        "com": {"force": [0.1, 0.2, 0.9], "torque": [-0.4, 0.1, 0.2]},
        "weight": 2.5,
    },
    {"units": "SI", "end_effector": {"force": [1.0, 2.0, -3.0], "torque": [0.02, 0.05, -0.1]}},
    {"com": {"force": [0.0, 0.0, 1.0], "torque": [0.3, 0.0, 0.0]}, "weight": 0.5},
]
"""Load cases with every term."""


def random_case(topology, seed, **fields):
    # the ablation has no airflow constraints, which are slow to state and say nothing of wrenches
    search = {"connectors": "any", "interference": "separation"}
    fields = {"search": search, "load_cases": EVERYTHING, **fields}
    return random_point(push(topology.n, **fields), topology, np.random.default_rng(seed))


def stated_residuals(point):
    """Force [N] and torque about W's origin [N m] of every load case, shape (K, 6), from the stated problem."""
    task, n = point.task, point.topology.n
    stated = problem(task, point.topology)
    balances = [c.expression for c in stated.constraints if c.name.startswith("load case")]
    f = ca.Function("balances", [stated.variables.vector()], [ca.vertcat(*balances)])
    rows = np.array(f(point.pack())).reshape(-1, 6)
    force = n * task.module.mass * task.gravity
    return rows * np.repeat([force, force * task.module.arm_length], 3)


@settings(max_examples=25, deadline=None)
@given(trees(most=8), st.integers(0, 2**32), st.sampled_from(["free", "com", [0.1, -0.2, 0.3]]))
def test_three_wrench_balances_agree(topology, seed, position):
    """The problem states (3) about W's origin, the paper about the COM: they differ by p_COM x (2)."""
    point = random_case(topology, seed, end_effector={"position": position})
    K = len(point.task.load_cases)
    about_origin = point.u.reshape(K, -1) @ wrench_matrix(point).T - required_wrenches(point)
    scale = np.abs(required_wrenches(point)).max() + point.task.force_unit(point.topology.n)
    np.testing.assert_allclose(stated_residuals(point), about_origin, rtol=0, atol=1e-12 * scale)

    design = as_design(point)
    about_com = about_origin.copy()
    about_com[:, 3:] -= np.cross(point.p_COM, about_com[:, :3])
    np.testing.assert_allclose(wrench_errors(design, platform(design)), about_com, rtol=0, atol=1e-12 * scale)


@settings(max_examples=30, deadline=None)
@given(trees(most=8), st.integers(0, 2**32), st.sampled_from(["free", "com", [0.1, -0.2, 0.3]]))
def test_the_check_and_the_audit_measure_the_same(topology, seed, position):
    point = random_case(topology, seed, end_effector={"position": position})
    design = as_design(point)
    ours = {check.name: check for check in violations(point)}
    theirs = {row.name: row for row in residuals(design, platform(design))}
    for k in range(len(EVERYTHING)):
        force, torque = names.force(f"load case {k}"), names.torque(f"load case {k}")
        of_torque = [theirs[torque], theirs[f"{torque} about the end-effector"]]
        for name, rows in ((force, [theirs[force]]), (torque, of_torque)):
            assert {ours[name].unit} == {row.unit for row in rows}
            assert ours[name].amount == pytest.approx(max(row.value for row in rows), rel=1e-9)
            assert ours[name].scaled == pytest.approx(max(row.scaled for row in rows), rel=1e-9)


@pytest.mark.parametrize(("kappa", "turns_yaw"), [(0, 1), (1, -1), (2, 1), (3, -1)])
def test_an_odd_kappa_flips_the_yaw_torque_of_the_childs_rotors(kappa, turns_yaw):
    """At each place of the aligned child's rotors there is a rotor again; for odd kappa it turns the other way."""
    rng = np.random.default_rng(kappa)
    aligned, turned = (
        random_point(hover(2, search={"connectors": "any"}), Topology(((-1, -1, -1), (0, 0, b))), rng)
        for b in (2, (2 - kappa) % 4)
    )
    turned = Point(turned.task, turned.topology, aligned.root, aligned.alpha, aligned.tip, aligned.u)
    k_tau = aligned.task.module.torque_coefficient
    drag = {}
    for point in (aligned, turned):
        (R, p), A = point.poses, wrench_matrix(point)
        places = p[1] + (point.task.module.arm_length * point.task.module.rotor_table.positions) @ R[1].T
        lift = np.cross(places, A[:3, 4:].T)
        own = (A[3:, 4:].T - lift) @ R[1][:, 2]  # about the thrust axis, without the lift's moment
        order = np.lexsort(np.round(places, 9).T)
        drag[point is turned] = places[order], own[order]
    np.testing.assert_allclose(drag[True][0], drag[False][0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(drag[True][1], turns_yaw * drag[False][1], rtol=0, atol=1e-12 * k_tau)
    assert np.sort(drag[False][1]) == pytest.approx(np.array([-1, -1, 1, 1]) * k_tau)


def test_a_level_module_lifts_and_yaws_as_the_paper_says():
    """Rotor 1 at (1, -1) l_arm / sqrt(2) turns with sign -1: lift there rolls by -y f, pitches by -x f."""
    task = hover(1)
    module = task.module
    point = Point(task, Topology(((-1, -1, -1),)), np.zeros(3), np.empty(0), np.ones(3), np.zeros((1, 1, 4)))
    arm, k_f, k_tau = module.arm_length / np.sqrt(2), module.thrust_coefficient, module.torque_coefficient
    expected = np.array(
        [
            [0, 0, 0, 0],
            [0, 0, 0, 0],
            [k_f, k_f, k_f, k_f],
            [-arm * k_f, -arm * k_f, arm * k_f, arm * k_f],
            [-arm * k_f, arm * k_f, arm * k_f, -arm * k_f],
            [-k_tau, k_tau, -k_tau, k_tau],
        ]
    )
    np.testing.assert_allclose(wrench_matrix(point), expected, rtol=1e-14, atol=1e-24)
