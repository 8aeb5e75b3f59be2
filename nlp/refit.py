r"""Designs with other hinge angles: rotor inputs that fit them.

One small convex problem per load case:

.. math:: \min_{v_{min} \le v \le 1} \tfrac12 \|v\|^2 \quad \text{subject to} \quad A v = b_k

| symbol | meaning | shape |
|---|---|---|
| v, v_min | inputs and minimum input, over the maximum input | (r n,) |
| A | wrench of the rotors at v about W's origin, in weights and arm lengths times weights | (6, r n) |
| b_k | required wrench of load case k, in the same units | (6,) |

The solver is DAQP, a dual active-set method that comes with CasADi.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlp.evaluation import correct
from nlp.numbers.point import Point, weigh_rod
from nlp.requirements.balances import WRENCH_TOLERANCE, required_wrenches, wrench_matrix
from topo_search.model import Design
from topo_search.model.arrays import Array


class NotPossible(ValueError):
    """No inputs within their bounds produce a load case."""


def refit(design: Design, hinge_angles_rad: Sequence[float]) -> Design:
    """Return a design with other hinge angles and matching inputs.

    The root keeps its orientation. The end-effector keeps its position in the world, or from the COM if the task
    fixes that.

    Raises:
        NotPossible: names the first load case that the rotors cannot produce.
    """
    root, alpha = np.array(design.root_orientation_rad), np.array(hinge_angles_rad)
    topology, tip = design.topology, np.array(design.end_effector_m)
    point = weigh_rod(Point(design.task, topology, root, alpha, tip, design.inputs))
    task, tip = point.task, point.tip
    units = np.repeat([task.force_unit(topology.n), task.torque_unit(topology.n)], 3)
    A = wrench_matrix(point) * task.max_input / units[:, None]
    u = task.max_input * _solve_inputs(A, required_wrenches(point) / units, task.min_input / task.max_input)
    corrected = correct(Point(task, topology, root, alpha, tip, u.reshape(point.u.shape)))
    produced = corrected.u.reshape(len(u), -1) / task.max_input @ A.T
    residuals = np.abs(produced - required_wrenches(point) / units).max(axis=1)
    if residuals.max() > WRENCH_TOLERANCE:
        raise NotPossible(f"load case {int(np.argmax(residuals))} cannot be produced by the rotors")
    J = corrected.objective
    return design.model_copy(
        update={
            "task": task,
            "hinge_angles_rad": tuple(alpha.tolist()),
            "end_effector_m": tuple(tip.tolist()),
            "rotor_speeds_squared": tuple(tuple(u_k.ravel().tolist()) for u_k in corrected.u),
            "objective": J,
            "gap": None if design.lower_bound is None else Design.gap_of(J, design.lower_bound),
            "solver": None,
        }
    )


def _solve_inputs(A: Array, b: Array, v_min: float) -> Array:
    """Return the minimum inputs of every load case, shape (K, r n); raise NotPossible if one is infeasible."""
    N = A.shape[1]
    options = {"error_on_fail": False, "print_time": False}
    solve = ca.conic("least", "daqp", {"h": ca.Sparsity.diag(N), "a": ca.Sparsity.dense(6, N)}, options)
    inputs = []
    for k, b_k in enumerate(b):
        solution = solve(h=ca.DM.eye(N), g=0, a=A, lba=b_k, uba=b_k, lbx=v_min, ubx=1)
        if not solve.stats()["success"]:
            raise NotPossible(f"load case {k} cannot be produced by the rotors")
        inputs.append(np.asarray(solution["x"]).ravel())
    return np.array(inputs)
