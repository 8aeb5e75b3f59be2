r"""The least inputs of a platform whose angles are given: one small convex problem a load case.

.. math:: \min_{v_{min} \le v \le 1} \tfrac12 \|v\|^2 \quad \text{subject to} \quad A v = b_k

| symbol | meaning | shape |
|---|---|---|
| v, v_min | inputs over the largest that a design may use; the least that a rotor runs at | (4n,) |
| A | wrench of the rotors at v about W's origin, in weights and arm lengths times weights | (6, 4n) |
| b_k | what load case k asks for, in the same units | (6,) |

The solver is DAQP, a dual active-set method, as CasADi brings it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlp.evaluation.correction import correct
from nlp.numbers.point import Point
from nlp.numbers.rod import weigh_rod
from nlp.requirements.balances import WRENCH_TOLERANCE, asked_wrenches, wrench_matrix
from topo_search.model import Design
from topo_search.model.arrays import Array


class NotPossible(ValueError):
    """No inputs within their limits produce a load case."""


def refit(design: Design, hinge_angles_rad: Sequence[float]) -> Design:
    """Return a design with other hinge angles and the inputs that fit them.

    The root keeps its orientation; the end-effector keeps its place, or where the task fixes it, that from the COM.

    Raises:
        NotPossible: names the first load case that rotors can no longer produce.
    """
    root, alpha = np.array(design.root_orientation_rad), np.array(hinge_angles_rad)
    topology, p_E = design.topology, np.array(design.end_effector_m)
    point = weigh_rod(Point(design.task, topology, root, alpha, p_E, design.inputs))
    task, p_E = point.task, point.p_E
    units = np.repeat([task.force_unit(topology.n), task.torque_unit(topology.n)], 3)
    A = wrench_matrix(point) * task.max_input / units[:, None]
    u = task.max_input * _least(A, asked_wrenches(point) / units, task.min_input / task.max_input)
    found = correct(Point(task, topology, root, alpha, p_E, u.reshape(point.u.shape)))
    off = np.abs(found.u.reshape(len(u), -1) / task.max_input @ A.T - asked_wrenches(point) / units).max(axis=1)
    if off.max() > WRENCH_TOLERANCE:
        raise NotPossible(f"load case {int(np.argmax(off))} cannot be produced by the rotors")
    J = found.objective
    return design.model_copy(
        update={
            "task": task,
            "hinge_angles_rad": tuple(alpha.tolist()),
            "end_effector_m": tuple(p_E.tolist()),
            "rotor_speeds_squared": tuple(tuple(u_k.ravel().tolist()) for u_k in found.u),
            "objective": J,
            "gap": None if design.lower_bound is None else Design.gap_of(J, design.lower_bound),
            "solver": None,
        }
    )


def _least(A: Array, b: Array, lowest: float) -> Array:
    """Return the least inputs of every load case, shape (K, 4n); NotPossible names one that has none."""
    N = A.shape[1]
    options = {"error_on_fail": False, "print_time": False}
    solve = ca.conic("least", "daqp", {"h": ca.Sparsity.diag(N), "a": ca.Sparsity.dense(6, N)}, options)
    found = []
    for k, b_k in enumerate(b):
        solution = solve(h=ca.DM.eye(N), g=0, a=A, lba=b_k, uba=b_k, lbx=lowest, ubx=1)
        if not solve.stats()["success"]:
            raise NotPossible(f"load case {k} cannot be produced by the rotors")
        found.append(np.asarray(solution["x"]).ravel())
    return np.array(found)
