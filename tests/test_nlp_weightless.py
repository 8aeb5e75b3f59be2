"""Load cases that weigh nothing: constraints without cost, in solver, bound and audit."""

import numpy as np
import pytest
from nlp_cases import HOVER, PUSH, Table, as_point, best_design, push
from scipy.optimize import lsq_linear

from nlp import lower_bound, solve
from nlp.bounds.effort import closed_form
from nlp.requirements.balances import asked_wrenches, wrench_matrix
from topo_search.model import Design, ResolvedTask, Topology
from verify import audit

TREE = Topology.from_key("a70200")
SIDES = [
    {"carries_weight": True, "end_effector": {"force": [0.1 * x, 0.1 * y, 0.0]}, "weight": 0.0}
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))
]
"""A tenth of the weight to every side at the tip, while hovering."""


def with_sides() -> ResolvedTask:
    return push(5, load_cases=[*PUSH, *SIDES])


def least_squares(design: Design, k: int) -> float:
    """The least sum of squared inputs that produce load case k, over u_max^2, by scipy."""
    point = as_point(design)
    units = np.repeat([design.task.force_unit(5), design.task.torque_unit(5)], 3)
    A = wrench_matrix(point) * design.task.max_input / units[:, None]
    w = asked_wrenches(point)[k] / units
    stiff = 1e4
    rows, asked = np.vstack([stiff * A, np.eye(A.shape[1])]), np.append(stiff * w, np.zeros(A.shape[1]))
    return float(np.sum(lsq_linear(rows, asked, (0.0, 1.0), tol=1e-13).x ** 2))


def test_a_design_produces_them_with_the_least_inputs_and_pays_nothing_for_them():
    task = with_sides()
    design = best_design(task, TREE, 6)
    assert audit(design).verdict == "clear"
    u = design.inputs.reshape(7, -1)
    assert design.objective == pytest.approx(float(np.sum(u[:3] ** 2)), rel=1e-12)
    assert lower_bound(task) <= design.objective
    for k in range(3, 7):
        assert np.sum((u[k] / task.max_input) ** 2) == pytest.approx(least_squares(design, k), rel=1e-5)


def test_what_cannot_be_done_is_infeasible_though_it_costs_nothing():
    weightless: Table = {"carries_weight": True, "com": {"torque": [9.0, 0.0, 0.0]}, "weight": 0.0}
    far = solve(push(5, load_cases=[HOVER, weightless]), TREE, starts=range(2), seed=0)
    assert not isinstance(far, Design)
    strong: Table = {"com": {"force": [0.0, 0.0, 3.0]}, "weight": 0.0, "name": "too strong"}
    impossible = solve(push(5, load_cases=[HOVER, strong]), TREE, starts=range(1), seed=0)
    assert not isinstance(impossible, Design)
    assert impossible.status == "impossible"
    assert impossible.worst_constraint == "load case 1 (too strong), force"


def test_the_bound_knows_that_axes_must_serve_them_too():
    """Hover alone costs the closed form; with pulls to both sides besides, not all rotors can pull straight up."""
    both = [{"com": {"force": [x, 0.0, 1.0]}, "weight": 0.0} for x in (2.0, -2.0)]
    alone, more = push(4, load_cases=[HOVER]), push(4, load_cases=[HOVER, *both])
    assert lower_bound(alone) == pytest.approx(closed_form(alone))
    assert closed_form(more) == pytest.approx(closed_form(alone))
    assert lower_bound(more) > 1.5 * lower_bound(alone)
