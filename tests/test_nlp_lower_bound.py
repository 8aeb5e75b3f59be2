"""The bounds on the control effort that no design undercuts: the closed form, and the dual that knows signs."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import HOVER, push, random_point, random_tree
from scipy.optimize import lsq_linear

from nlp import lower_bound
from nlp.bounds.duality import directions, dual_value, sphere_maximum
from nlp.bounds.effort import closed_form
from nlp.requirements.balances import wrench_matrix
from topo_search.model import LoadCase, Wrench


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


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 8), st.integers(1, 4))
def test_no_thrust_axes_undercut_the_closed_form(seed, n, K):
    """60 tasks, 400 platforms each; half of them near the best axes of a hover."""
    rng = np.random.default_rng(seed)
    forces = rng.normal(size=(K, 3)) * 10 ** rng.uniform(-1, 0.5, (K, 1))
    task = with_forces(n, forces, 10 ** rng.uniform(-1, 1, K))
    Z = rng.normal(size=(400, 3, n))
    Z[200:] = forces[0][:, None] / np.linalg.norm(forces[0]) + 0.3 * Z[200:]
    Z /= np.linalg.norm(Z, axis=1, keepdims=True)
    assert np.all(effort_of_axes(task, Z) >= closed_form(task) * (1 - 1e-9))


FORCES = {
    "one force": (np.array([[0.2, -0.1, 1.0]]), np.ones(1)),
    "two forces": (np.array([[0.5, 0.0, 0.5], [0.0, 0.0, 1.0]]), np.array([1.0, 3.0])),
    "push": (np.array([[0.5, 0.0, 0.5], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]), np.ones(3)),
    "opposite forces": (np.array([[0.5, 0.0, 0.2], [-0.5, 0.0, 0.2]]), np.ones(2)),
}


@pytest.mark.parametrize("name", FORCES)
def test_the_closed_form_is_the_least_of_a_direct_minimisation(name):
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
    assert in_si == pytest.approx(closed_form(task), rel=1e-6)


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
    assert closed_form(split) == pytest.approx(closed_form(whole), rel=1e-12)
    assert closed_form(push(3, load_cases=[LoadCase(com=Wrench(torque=(0.0, 0.0, 1.0)))])) == 0.0


def random_forces(rng, K):
    """Load cases of any direction, and their weights."""
    return rng.normal(size=(K, 3)) * 10 ** rng.uniform(-1, 0, (K, 1)), 10 ** rng.uniform(-1, 1, K)


@pytest.mark.parametrize("weightless", [False, True])
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32), K=st.integers(2, 5))
def test_whatever_the_multipliers_no_thrusts_undercut_their_dual_value(weightless, seed, K):
    """2000 sets of axes and thrusts for each: half of them the best for the multipliers at hand."""
    rng = np.random.default_rng(seed)
    n, T = 4, rng.uniform(0.3, 3.0)
    nu, weights = random_forces(rng, K)
    if weightless:
        weights[rng.integers(1, K) :] = 0.0
    z = rng.normal(size=(2000, n, 3))
    peaks = directions(4)
    with np.errstate(divide="ignore", invalid="ignore"):
        worth = np.where(weights > 0, np.maximum(peaks @ nu.T, 0.0) ** 2 / weights, np.maximum(peaks @ nu.T, 0.0))
    peaks = peaks[np.argsort(-worth.sum(axis=1))[:20]]
    z[1000:] = peaks[rng.integers(len(peaks), size=(1000, n))] + 0.02 * z[1000:]
    z /= np.linalg.norm(z, axis=2, keepdims=True)
    t, s = z @ nu.T, rng.uniform(0.0, T, (2000, n, K))
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.where(weights > 0, np.clip(t / (2 * weights), 0.0, T), np.where(t > 0, T, 0.0))
    s[1000:] = best[1000:]
    f = np.einsum("mik,mia->mka", s, z) / n
    effort = np.sum(weights * np.mean(s**2, axis=1), axis=1)
    dual = dual_value(nu, f[0], weights, T) + np.sum(nu * (f - f[0]), axis=(1, 2))  # it is affine in f
    assert np.all(effort >= dual - 1e-9 * np.abs(dual))
    assert weightless or np.min(effort - dual) < 0.2 * np.max(np.abs(dual))


@pytest.mark.parametrize("kind", ["plain", "least input", "weightless cases"])
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32), n=st.integers(3, 8), K=st.integers(1, 4))
def test_no_design_of_its_own_task_undercuts_it(kind, seed, n, K):
    """A platform with any inputs does the task that asks for their wrenches; so with the least inputs that do."""
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.05, 0.9) if kind == "least input" else 0.0
    point = random_point(push(n, load_cases=[HOVER] * K), random_tree(n, rng), rng)
    A, u_max = wrench_matrix(point), point.task.max_input
    asked = (share + (1 - share) * rng.random((K, 1)) * rng.random((K, 4 * n))) * u_max @ A.T
    weights = np.ones(K)
    if kind == "weightless cases":
        weights = np.where(np.arange(K) < rng.integers(1, K + 1), 10 ** rng.uniform(-2, 2, K), 0.0)
    scale = np.abs(A).max(axis=1) * u_max
    stiff = np.vstack([1e4 * A * u_max / scale[:, None], np.eye(4 * n)])
    least = [
        lsq_linear(stiff, np.append(1e4 * wrench / scale, np.zeros(4 * n)), (share, 1.0), tol=1e-13).x
        for wrench in asked
    ]
    effort = u_max**2 * weights @ np.sum(np.square(least), axis=1) * (1 + 1e-6)
    cases = [
        {"units": "SI", "com": {"force": wrench[:3].tolist()}, "weight": weight}
        for wrench, weight in zip(asked, weights.tolist(), strict=True)
    ]
    task = push(n, load_cases=cases, module={"min_input": share})
    assert closed_form(task) <= effort
    assert lower_bound(task) <= effort
    if kind == "plain":
        assert closed_form(task) <= lower_bound(task)


@pytest.mark.parametrize("weight", [0.2, 1.0, 30.0])
@pytest.mark.parametrize("largest", [0.95, 1.2, 2.4])
def test_two_opposite_forces_share_the_modules_by_the_closed_form(weight, largest):
    """A share w pulls with a / w, the rest with b / (1 - w), neither with more than T."""
    a, b, n = 0.5, 0.3, 4
    task = with_forces(n, np.array([[a, 0.0, 0.0], [-b, 0.0, 0.0]]), [weight, 1.0])
    task = task.model_copy(update={"module": task.module.model_copy(update={"max_thrust_to_weight": largest})})
    T = 4 * n * task.module.thrust_coefficient * task.module.max_input(task.gravity) / task.force_unit(n)
    w = np.sqrt(weight) * a / (np.sqrt(weight) * a + b)
    w = np.clip(w, a / T, 1 - b / T)
    expected = weight * a**2 / w + b**2 / (1 - w)
    in_si = expected * task.force_unit(n) ** 2 / (4 * n * task.module.thrust_coefficient**2)
    assert lower_bound(task) == pytest.approx(in_si, rel=1e-3)
    assert lower_bound(task) <= in_si * (1 + 1e-12)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_the_greatest_value_on_the_sphere_is_above_all_and_near(seed, K):
    rng = np.random.default_rng(seed)
    nu, power = rng.normal(size=(K, 3)), rng.uniform(1.0, 3.0)
    bound = sphere_maximum(lambda z: np.sum(np.maximum(z @ nu.T, 0.0) ** power, axis=-1))
    z = rng.normal(size=(200_000, 3))
    values = np.sum(np.maximum(z / np.linalg.norm(z, axis=1, keepdims=True) @ nu.T, 0.0) ** power, axis=-1)
    assert values.max() <= bound <= 1.003 * values.max()


@settings(max_examples=2, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.1, 10.0))
def test_the_bound_turns_with_the_forces_scales_with_the_weights_and_falls_with_more_thrust(seed, scale):
    rng = np.random.default_rng(seed)
    forces, weights = random_forces(rng, 3)
    forces *= 0.5 / np.linalg.norm(forces, axis=1).max()
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    bound = lower_bound(with_forces(4, forces, weights))
    assert lower_bound(with_forces(4, forces @ turn, weights)) == pytest.approx(bound, rel=2e-3)
    assert lower_bound(with_forces(4, forces, scale * weights)) == pytest.approx(scale * bound, rel=2e-3)
    task = with_forces(4, forces, weights)
    stronger = task.model_copy(update={"module": task.module.model_copy(update={"max_thrust_to_weight": 5.0})})
    assert lower_bound(stronger) <= bound * (1 + 2e-3)
