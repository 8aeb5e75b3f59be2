"""Rotors that never stop: the least input in every form of the problem, bound, audit and flight."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import HOVER, PUSH, best_design, placed, push, random_point, random_tree
from scipy.optimize import linprog, lsq_linear

from nlp import lower_bound
from nlp.assembled import AssembledProgram
from nlp.evaluation import correct, violations, worst
from nlp.multistart import solve_starts
from nlp.requirements.balances import wrench_matrix
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, ResolvedTask, Topology
from verify import audit
from verify.kinematics import platform, required_wrench, wrench_map

TREE = Topology.from_key("a70200")
SHARE = 0.1


def idle(share: float = SHARE, n: int = 5, **fields: object) -> ResolvedTask:
    return push(n, module={"min_input": share}, **fields)


def test_a_design_keeps_to_it_and_the_audit_holds_it_to_that():
    task = idle()
    without, design = (best_design(t, TREE, 4) for t in (push(5), task))
    assert without.inputs.min() < task.min_input
    assert design.inputs.min() >= task.min_input
    assert design.objective >= without.objective * (1 - 1e-6)
    assert audit(design).verdict == "clear"
    below = audit(design.model_copy(update={"task": idle(SHARE + 1e-5)}))
    assert [row.name for row in below.residuals if row.status != "clear"] != []
    assert all("smallest rotor input" in row.name for row in below.residuals if row.status != "clear")
    (row,) = (row for row in audit(design).residuals if row.name == "load case 0, smallest rotor input")
    assert row.derived == pytest.approx(task.min_input)


def test_the_reduced_search_and_the_assembled_program_keep_to_it():
    task = idle()
    best = placed(task, TREE, 4).objective
    ends = [end.point for end in solve_starts(task, TREE, starts=range(4), seed=0, near=()) if end.worst.met]
    rounds = correct(AssembledProgram(task, TREE).solve(draw(task, TREE, generator(task, TREE, 0, seed=0))).point)
    assert worst(violations(rounds)).met
    for point in (*ends, rounds):
        assert point.u.min() >= task.min_input
    assert min(end.objective for end in ends) <= best * (1 + 1e-4)


def test_weightless_load_cases_keep_to_it_with_the_least_inputs():
    side = {"carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}, "weight": 0.0}
    design = best_design(idle(load_cases=[*PUSH, side]), TREE, 3)
    task = design.task
    A = wrench_map(platform(design), task.module) * task.max_input
    unit = np.repeat([task.force_unit(5), task.torque_unit(5)], 3)
    w = required_wrench(task.load_cases[3], platform(design).p_e) / unit
    rows = np.vstack([1e4 * A / unit[:, None], np.eye(20)])
    least = lsq_linear(rows, np.append(1e4 * w, np.zeros(20)), (SHARE, 1.0), tol=1e-13).x
    assert design.inputs[3].ravel() / task.max_input == pytest.approx(least, abs=1e-4)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32), st.integers(3, 7), st.floats(0.05, 0.9))
def test_no_inputs_undercut_the_bound(seed, n, share):
    """A platform with any inputs does the task of their wrenches; so with the least ones within limits."""
    rng = np.random.default_rng(seed)
    task = idle(share, n, load_cases=[HOVER] * 2)
    point = random_point(task, random_tree(n, rng), rng)
    A, u_max = wrench_matrix(point), task.max_input
    scale = np.abs(A).max(axis=1) * u_max
    asked = rng.uniform(task.min_input, u_max, (2, 4 * n)) @ A.T
    effort = 0.0
    for wrench in asked:
        rows = np.vstack([1e4 * A * u_max / scale[:, None], np.eye(4 * n)])
        rest = np.append(1e4 * wrench / scale, np.zeros(4 * n))
        effort += u_max**2 * float(np.sum(lsq_linear(rows, rest, (share, 1.0), tol=1e-13).x ** 2))
    cases = [{"units": "SI", "com": {"force": w[:3].tolist()}} for w in asked]
    assert lower_bound(idle(share, n, load_cases=cases)) <= effort * (1 + 1e-6)


def test_rotors_that_run_idle_cost_that_much():
    """One module, no wrench: all four at their least input."""
    task = idle(0.3, 1, load_cases=[{"com": {"torque": [0.0, 0.0, 0.01]}}])
    assert lower_bound(task) == pytest.approx(4 * task.min_input**2, rel=1e-6)
    assert lower_bound(idle(0.0, 1, load_cases=[{"com": {"torque": [0.0, 0.0, 0.01]}}])) == 0.0


def test_figures_of_flight_are_of_rotors_that_never_stop_and_a_dead_one_is_exempt():
    design = best_design(idle(), TREE, 2)
    assert isinstance(design, Design)
    found, at, task = audit(design).flight, platform(design), design.task
    assert found is not None
    unit = np.repeat([task.force_unit(5), task.torque_unit(5)], 3)
    A = wrench_map(at, task.module) * task.max_input / unit[:, None]
    lost = []
    for dead in range(20):
        bounds = [(0.0, 0.0) if j == dead else (SHARE, 1.0) for j in range(20)]
        if linprog(np.zeros(20), A_eq=A, b_eq=[0, 0, 1, 0, 0, 0], bounds=bounds).status != 0:
            lost.append((dead // 4, dead % 4))
    assert found.rotors_out_hover.lost == tuple(lost)
    weakest = found.hover.force_weakest
    assert weakest is not None
    d = np.array(weakest)
    column = np.concatenate([d, np.cross(at.p_e / task.module.arm_length, d)])
    most = linprog(
        np.append(np.zeros(20), -1.0),
        A_eq=np.column_stack([A, -column]),
        b_eq=[0, 0, 1, 0, 0, 0],
        bounds=[(SHARE, 1.0)] * 20 + [(0, None)],
    )
    assert found.hover.force_reserve_N == pytest.approx(-most.fun * task.force_unit(5), rel=1e-4)
