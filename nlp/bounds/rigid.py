r"""Refutation of a flat lattice of a given attitude: nothing is left that could turn its wrenches.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | inputs, l <= v <= h | (r n,) | u_hover |
| A, b | wrench of each rotor about the centre of mass, and that of a load case | (6, r n), (6,) | m g, l_arm m g |
| y | any multipliers; best are those of the smallest largest component of b - A v | (6,) | |

No inputs come closer to b along y than

.. math::

    y \cdot b - \max_{l \le v \le h} y \cdot A v
        = y \cdot b - \sum_j \max(l_j c_j, h_j c_j), \qquad c = A^T y, \quad \|y\|_1 = 1,

so a positive value beyond the audit's tolerances refutes the load case, whatever the program that found y.
"""

import numpy as np

from nlp.bounds.refutation import Refutation
from nlp.numbers.geometry import rotor_maps
from nlp.numbers.point import Point
from nlp.units import Units
from topo_search.model import Array, ResolvedTask, Topology
from topo_search.model.kinds import is_zero
from topo_search.model.proven import TOLERANCE, lower_text


def refute_rigid(task: ResolvedTask, topology: Topology) -> Refutation | None:
    """Refute a load case of a lattice of a given attitude, if it does not depend on where the end-effector is."""
    given, n, module, unit = task.search.root_orientation_deg, task.n, task.module, Units.of(task)
    if task.search.lattice is None or given is None or task.end_effector.mass or task.heaviest_rod:
        return None
    idle = np.zeros((len(task.load_cases), n, task.rotors_per_module))
    point = Point(task, topology, np.radians(given), np.zeros(n - 1), np.zeros(3), idle)
    A, weights = _wrenches(point), task.total_mass(n) / module.mass
    shares = task.input_shares.ravel()
    largest, least = task.max_thrust_to_weight, task.min_thrust_to_weight
    low, high = least * shares - TOLERANCE * largest, largest * shares + TOLERANCE * largest
    # residuals of force and torque, three angles of the root, and rounding
    allowance = TOLERANCE * (2 * weights + 4 * float(np.abs(A * high).sum()))
    for case, label in zip(task.load_cases, task.case_labels, strict=True):
        tip, com = case.at_end_effector, case.at_com
        if not is_zero(tip.force):
            continue
        b = np.concatenate([np.array(com.force) / unit.force, np.add(tip.torque, com.torque) / unit.torque])
        missing = (_shortfall(A, b, low, high) - allowance) / weights
        if missing > 0:
            return Refutation(
                f"{label}, wrench",
                missing,
                "m_t g, l_arm m_t g",
                f"{label} is out of reach of {topology.key} in the given attitude: a component of its force is off "
                f"by {lower_text(missing, 3)} m_t g or more, or one of its torque by as many l_arm m_t g",
            )
    return None


def _wrenches(point: Point) -> Array:
    """Return A."""
    (R, p), (force_maps, torque_maps) = point.poses, rotor_maps(point.task)
    forces, o = R @ force_maps, (p - point.p_COM) / point.task.module.arm_length
    torques = R @ torque_maps + np.cross(o[:, :, None], forces, axis=1)
    return np.asarray(np.concatenate([forces, torques], axis=1).transpose(1, 0, 2).reshape(6, -1))


def _shortfall(A: Array, b: Array, low: Array, high: Array) -> float:
    """Return a lower bound on the largest component of b - A v; 0 without one."""
    from scipy.optimize import linprog  # slow to load, and few commands need it

    size, slack = A.shape[1], -np.ones((6, 1))
    program = linprog(
        [*np.zeros(size), 1.0],
        A_ub=np.block([[A, slack], [-A, slack]]),
        b_ub=[*b, *-b],
        bounds=[*zip(low, high, strict=True), (0.0, None)],
    )
    if program.status != 0:
        return 0.0
    above, below = np.split(program.ineqlin.marginals, 2)
    y = above - below
    c = y @ A
    return float(y @ b - np.maximum(low * c, high * c).sum())
