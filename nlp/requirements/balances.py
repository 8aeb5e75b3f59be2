"""Wrench balance of every load case, and bounds on the unknowns; (2), (3), (10) of the printed problem.

| symbol | meaning | shape | unit |
|---|---|---|---|
| A | wrench of every rotor at unit input, about W's origin | (6, r n) | N, N m |
| u | inputs of every load case, r rotors a module | (K, n, r) | rad^2/s^2 |
| J | inertia about the COM, for corners that are angular accelerations | (3, 3) | kg m^2 |

Reserves, cones and sets of wrenches are already load cases here (`topo_search.model.corners`).
"""

import math

import numpy as np

from nlp.numbers.geometry import cross, ranges
from nlp.numbers.masses import TINY, masses, point_inertia
from nlp.numbers.point import Point
from topo_search.model import Array, ResolvedTask, Topology

WRENCH_TOLERANCE = 1e-8
"""Largest allowed wrench residual of a design [m_t g, l_arm m_t g]; the audit allows TOLERANCE."""


def angular_accelerations(task: ResolvedTask) -> Array:
    """Return the angular acceleration of every load case, shape (K, 3) [g / l_arm]."""
    return np.array(task.accelerations) * (task.module.arm_length / task.gravity)


def wrench_residuals(point: Point) -> Array:
    """Return the residuals of force and torque of every load case, shape (K, 2) [m_t g, l_arm m_t g].

    The torque residual is the larger of those about the COM and about p_E.
    """
    task, n = point.task, point.topology.n
    K = len(task.load_cases)
    residual = point.u.reshape(K, -1) @ wrench_matrix(point).T - required_wrenches(point)
    # from W's origin to the COM: a force residual has a torque about the origin
    residual[:, 3:] -= cross(point.p_COM, residual[:, :3])
    norms = np.linalg.norm(residual.reshape(K, 2, 3), axis=2)
    # a force residual has another lever about p_E
    at_tip = np.linalg.norm(residual[:, 3:] - cross(point.tip - point.p_COM, residual[:, :3]), axis=1)
    norms[:, 1] = np.maximum(norms[:, 1], at_tip)
    return np.asarray(norms / (task.force_unit(n), task.torque_unit(n)))


def wrench_matrix(point: Point) -> Array:
    """Return A: force [N] and torque about W's origin [N m] of every rotor at unit input, shape (6, r n)."""
    columns = np.zeros((point.topology.n, point.task.rotors_per_module, 6))
    for module, R, p, of_module in zip(point.task.modules_of_nodes, *point.poses, columns, strict=True):
        table, r = module.rotor_table, module.rotor_table.count
        rotors = p + np.einsum("ab,qb->qa", R, module.arm_length * table.positions)
        thrust_axis = np.einsum("ab,qb->qa", R, table.axes)
        k_f = module.thrust_coefficient * table.gains[:, None]
        torque = k_f * cross(rotors, thrust_axis)
        torque += table.drags[:, None] * module.torque_coefficient * thrust_axis
        of_module[:r] = np.concatenate([k_f * thrust_axis, torque], axis=-1)
    return columns.reshape(-1, 6).T


def inertia(point: Point) -> Array:
    """Return the inertia about the COM, shape (3, 3) [kg m^2]."""
    module, (R, p) = point.task.module, point.poses
    carried = masses(point.task, point.topology)
    centres = p + module.arm_length * np.einsum("iab,ib->ia", R[:, :, :2], carried.centres)
    arms, unit = np.vstack([centres, point.tip]) - point.p_COM, module.mass * module.arm_length**2
    kg = np.append(module.mass * carried.modules, carried.tip_kg)
    J = kg @ np.sum(arms**2, axis=1) * np.eye(3) - (kg * arms.T) @ arms
    J += unit * np.einsum("iab,ibd,icd->ac", R, carried.inertias, R)
    if (rod := carried.rod).mass:
        d = (point.tip - p[rod.module]) / module.arm_length - R[rod.module] @ rod.foot
        roll = np.outer(d, d) / max(float(d @ d), TINY)
        J += unit * rod.mass * (rod.radius**2 / 2 * (np.eye(3) + roll) - point_inertia(d) / 6)
    return np.asarray(J)


def required_wrenches(point: Point) -> Array:
    """Return the required wrench of every load case about W's origin, shape (K, 6) [N, N m]."""
    at_tip = [case.at_end_effector for case in point.task.load_cases]
    at_com = [case.at_com for case in point.task.load_cases]
    f_E, tau_E = np.array([wrench.force for wrench in at_tip]), np.array([wrench.torque for wrench in at_tip])
    f_C, tau_C = np.array([wrench.force for wrench in at_com]), np.array([wrench.torque for wrench in at_com])
    torque = tau_E + tau_C + cross(point.tip, f_E) + cross(point.p_COM, f_C)
    if any(map(any, point.task.accelerations)):
        torque += np.array(point.task.accelerations) @ inertia(point)
    return np.concatenate([f_E + f_C, torque], axis=1)


def variable_bounds(
    task: ResolvedTask, topology: Topology, alpha: Array | None = None
) -> tuple[list[float], list[float]]:
    """Return lower and upper bounds on the unknowns, dimensionless, in the order of `Variables.vector()`.

    Each hinge has the range nearest to its angle in alpha (n-1,) [rad], or without alpha the hull of its ranges.
    """
    free = (-math.inf, math.inf)
    bounds = [*task.search.root_ranges.values()] or [free] * 3
    bounds += zip(*ranges(task, topology, alpha), strict=True)
    bounds += [free] * (3 if task.end_effector.fixed_position is None else 0)
    shares = running_rotors(task).ravel()
    bounds += zip(task.min_thrust_to_weight * shares, task.max_thrust_to_weight * shares, strict=True)
    lower, upper = (list(side) for side in zip(*bounds, strict=True))
    return lower, upper


def running_rotors(task: ResolvedTask) -> Array:
    """Return the factor on the input limits of each rotor in each load case, shape (K, r n).

    It is 1 unless the rotor has a limit of its own; 0 for a dead one, which is exempt from the minimum input, and
    for one that a module lacks.
    """
    alive = np.tile(task.input_shares.ravel(), (len(task.load_cases), 1))
    for k, dead in enumerate(task.dead_rotors):
        if dead is not None:
            alive[k, dead] = 0.0
    return alive
