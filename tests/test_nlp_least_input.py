"""Rotors that never stop: the least input in every form of the problem, bound, audit and flight."""

import numpy as np
import pytest
from nlp_cases import PUSH, best_design, push
from scipy.optimize import linprog, lsq_linear

from nlp import lower_bound
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


def test_rotors_that_run_idle_cost_that_much():
    """One module, no wrench: all four at their least input."""
    task = idle(0.3, 1, load_cases=[{"com": {"torque": [0.0, 0.0, 0.01]}}])
    assert lower_bound(task) == pytest.approx(4 * task.min_input**2, rel=1e-6)
    assert lower_bound(idle(0.0, 1, load_cases=[{"com": {"torque": [0.0, 0.0, 0.01]}}])) == 0.0


def test_figures_of_flight_are_of_rotors_that_never_stop_and_a_dead_one_is_exempt():
    design = best_design(idle(), TREE, 2)
    assert isinstance(design, Design)
    found, at, task = audit(design).flight, platform(design), design.task
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
