"""The bound on the control effort that no design undercuts."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import HOVER, push, random_point, random_tree, solved

from nlp import lower_bound, solve
from nlp.evaluate import asked_wrenches, wrench_matrix
from topo_search.model import LoadCase, Topology, Wrench


def with_forces(n, forces, weights):
    cases = [
        {"com": {"force": force.tolist()}, "weight": float(weight)}
        for force, weight in zip(forces, weights, strict=True)
    ]
    return push(n, load_cases=cases)


def effort_of_axes(task, Z):
    """Least J for thrust axes Z, shape (..., 3, n), without torques, bounds, geometry; infinite if impossible."""
    F = np.array([np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases])
    weights = np.array([case.weight for case in task.load_cases])
    s = np.linalg.pinv(Z) @ F.T
    missed = np.linalg.norm(Z @ s - F.T, axis=(-2, -1)) > 1e-9 * np.linalg.norm(F)
    effort = (weights * np.sum(s**2, axis=-2)).sum(axis=-1) / (4 * task.module.thrust_coefficient**2)
    return np.where(missed, np.inf, effort)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 8), st.integers(1, 4))
def test_no_thrust_axes_undercut_it(seed, n, K):
    """60 tasks, 400 platforms each; half of them near the best axes of a hover."""
    rng = np.random.default_rng(seed)
    forces = rng.normal(size=(K, 3)) * 10 ** rng.uniform(-1, 0.5, (K, 1))
    task = with_forces(n, forces, 10 ** rng.uniform(-1, 1, K))
    Z = rng.normal(size=(400, 3, n))
    Z[200:] = forces[0][:, None] / np.linalg.norm(forces[0]) + 0.3 * Z[200:]
    Z /= np.linalg.norm(Z, axis=1, keepdims=True)
    assert np.all(effort_of_axes(task, Z) >= lower_bound(task) * (1 - 1e-9))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_no_inputs_of_a_platform_undercut_it(seed, n):
    """Least-norm inputs of random platforms, torques and all, signs free; what a platform cannot do costs more."""
    rng = np.random.default_rng(seed)
    task = push(n)
    for _ in range(20):
        point = random_point(task, random_tree(n, rng, aligned=True), rng)
        A, b = wrench_matrix(point), asked_wrenches(point).T
        u = np.linalg.lstsq(A, b)[0]
        if np.linalg.norm(A @ u - b) < 1e-9 * np.linalg.norm(b):
            assert np.sum(u**2) >= lower_bound(task) * (1 - 1e-9)


FORCES = {
    "one force": (np.array([[0.2, -0.1, 1.0]]), np.ones(1)),
    "two forces": (np.array([[0.5, 0.0, 0.5], [0.0, 0.0, 1.0]]), np.array([1.0, 3.0])),
    "push": (np.array([[0.5, 0.0, 0.5], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]), np.ones(3)),
    "opposite forces": (np.array([[0.5, 0.0, 0.2], [-0.5, 0.0, 0.2]]), np.ones(2)),
}


@pytest.mark.parametrize("name", FORCES)
def test_it_is_the_least_of_a_direct_minimisation(name):
    """Six axes are as good as any: sum_i z_i z_i^T is then every semidefinite M of trace 6."""
    n, (forces, weights) = 6, FORCES[name]
    task = with_forces(n, forces, weights)
    F = np.array([case.at_com.force for case in task.load_cases]) / task.force_unit(n)
    Z, S = ca.MX.sym("Z", 3, n), ca.MX.sym("S", n, len(F))
    effort = sum(weight * ca.sumsqr(S[:, k]) for k, weight in enumerate(weights))
    balance = ca.vec(Z @ S - ca.DM(F.T))
    unit = ca.sum1(Z**2).T - 1
    x = ca.veccat(Z, S)
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    solver = ca.nlpsol("direct", "ipopt", {"x": x, "f": effort, "g": ca.vertcat(balance, unit)}, options)
    rng = np.random.default_rng(0)
    best = min(
        float(result["f"])
        for _ in range(8)
        if (result := solver(x0=rng.normal(size=x.numel()), lbg=0, ubg=0)) and solver.stats()["success"]
    )
    in_si = best * task.force_unit(n) ** 2 / (4 * task.module.thrust_coefficient**2)
    assert in_si == pytest.approx(lower_bound(task), rel=1e-6)


def test_it_is_the_effort_of_the_closed_forms():
    """One force: F^2 / (4 n k_f^2); two at right angles, weights a, b: (sqrt(a) F + sqrt(b) G)^2 / (4 n k_f^2)."""
    k_f = push(3).module.thrust_coefficient
    one = with_forces(3, np.array([[0.0, 0.0, 1.0]]), [2.0])
    assert lower_bound(one) == pytest.approx(2 * one.force_unit(3) ** 2 / (12 * k_f**2), rel=1e-12)
    two = with_forces(3, np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 1.0]]), [4.0, 1.0])
    assert lower_bound(two) == pytest.approx(((2 * 0.3 + 1.0) * two.force_unit(3)) ** 2 / (12 * k_f**2), rel=1e-12)


def test_it_is_attained_by_one_hovering_module():
    task = push(1, load_cases=[HOVER])
    design = solved(solve(task, Topology.from_key("a0"), starts=range(1), seed=0))
    assert design.objective == pytest.approx(lower_bound(task), rel=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(0.1, 10.0))
def test_it_turns_with_the_forces_and_scales_with_their_square(angle, scale):
    forces = np.array([[0.5, 0.0, 0.5], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]])
    c, s = np.cos(angle), np.sin(angle)
    turned = (
        scale * forces @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    )
    expected = scale**2 * lower_bound(with_forces(4, forces, np.ones(3)))
    assert lower_bound(with_forces(4, turned, np.ones(3))) == pytest.approx(expected, rel=1e-9)


def test_only_the_whole_force_of_a_load_case_counts():
    """Torques, and whether a force acts at the end-effector or at the COM, are dropped."""
    whole = push(3, load_cases=[{"com": {"force": [0.2, 0.0, 1.0]}}])
    split = push(
        3,
        load_cases=[
            {
                "com": {"force": [0.0, 0.1, 0.4], "torque": [1.0, 2.0, 3.0]},
                "end_effector": {"force": [0.2, -0.1, 0.6], "torque": [0.0, 0.0, 0.1]},
            }
        ],
    )
    assert lower_bound(split) == pytest.approx(lower_bound(whole), rel=1e-12)
    assert lower_bound(push(3, load_cases=[LoadCase(com=Wrench(torque=(0.0, 0.0, 1.0)))])) == 0.0
