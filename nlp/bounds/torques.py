"""Torques beyond the reach of all rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | centre of mass of modules and joints | (3,) | m |
| q | end-effector position from c | (3,) | m |
| M | mass of modules and joints, m_t - m_E | | kg |
| tau_k | torque that load case k asks for, at the end-effector and at the COM | (3,) | N m |
| f_E, f_C | its forces at the end-effector and at the COM | (3,) | N |
| g_k | force that q has as its lever, f_E + (m_E / m_t) f_C | (3,) | N |
| d_ij | joints between the modules i and j | | |

About c the rotors must produce tau_k + q x g_k, since the COM is at (m_E / m_t) q. Whatever q is, its part along
g_k is that of tau_k.

The distance of module i from the modules' centroid is (2 l_c / n) sum_j d_ij at most, that of its rotors l_arm
more; joints shift c from the centroid a little. A rotor at o with
thrust f has the torque f o x z about c, and its drag (k_tau / k_f) f along z.

The reach is far from tight: no platform has all its modules at the longest levers, all thrusts across them and
turning the same way. So a torque that is not refused here need not be possible.

The residuals of a torque about the COM and about the end-effector, both at most e, differ by the force's residual
with the lever from one to the other, (M / m_t) q; c is (m_E / m_t) q beside the COM, on the same line. So about c
the residual is e (1 + 2 m_E / M) at most, wherever the end-effector is.
"""

from __future__ import annotations

import numpy as np

from nlp import names
from nlp.bounds.refutation import (
    Refutation,
    bodies_mass,
    largest_thrust,
    modules,
    off_centre,
    unseen_thrust,
)
from topo_search.model import LoadCase, ResolvedTask, Topology
from topo_search.model.proven import excess_texts
from topo_search.model.tolerances import TOLERANCE

ROUNDING = 1e-9
"""Share of a torque that is left to rounding."""
NO_FORCE = 1e-6
"""Size of g_k under which its direction is not trusted, in m_t g and in the forces that it is the sum of."""


def torque_reach(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """All rotors at their limit, each at its longest lever, against the torque of every load case.

    Of all trees a straight chain has the largest sum of distances, sum_ij d_ij = n (n^2 - 1) / 3.
    """
    if task.heaviest_rod:  # whose weight turns a platform about any point, by a lever that is not known
        return None
    import networkx as nx

    n, module = task.n, task.module
    distances = n * (n**2 - 1) // 3 if topology is None else 2 * nx.wiener_index(topology.graph())
    lever = 2 * module.connector_distance * distances / n**2 + off_centre(task) + module.arm_length
    most = largest_thrust(task) * (lever + module.torque_coefficient / module.thrust_coefficient)
    asked = [_least_torque(task, case) for case in task.load_cases]
    k = int(np.argmax(asked))
    share = 1 + unseen_thrust(task) / largest_thrust(task)
    if asked[k] * (1 - ROUNDING) - _torque_tolerance(task, task.load_cases[k]) <= most * share:
        return None
    case, (needed, given) = task.case_labels[k], excess_texts(asked[k], most)
    return Refutation(
        names.torque(case),
        asked[k] - most,
        "N m",
        f"{case} needs a torque of at least {needed} N m about the centre of {modules(task)}: "
        f"all rotors at full thrust, as far out as they can be, give {given} N m at most",
    )


def _torque_tolerance(task: ResolvedTask, case: LoadCase) -> float:
    """Return by how much the torque about c may miss what is asked without the audit's saying so [N m]."""
    n, own = task.n, bodies_mass(task)
    unseen = TOLERANCE * task.torque_unit(n) * (1 + 2 * task.end_effector.mass / own)
    if task.end_effector.fixed_position is None:
        return unseen
    tip, com = np.array(case.at_end_effector.force), np.array(case.at_com.force)
    g = float(np.linalg.norm(tip + task.end_effector.mass / task.total_mass(n) * com))
    return unseen + TOLERANCE * task.module.arm_length * task.total_mass(n) / own * g


def _least_torque(task: ResolvedTask, case: LoadCase) -> float:
    """Return the least torque about c that a load case can ask for [N m]."""
    n, tip, com = task.n, case.at_end_effector, case.at_com
    tau = np.add(tip.torque, com.torque)
    g = np.add(tip.force, np.multiply(task.end_effector.mass / task.total_mass(n), com.force))
    position, size = task.end_effector.fixed_position, float(np.linalg.norm(g))
    if position is not None:
        q = np.multiply(task.total_mass(n) / bodies_mass(task), position)
        return float(np.linalg.norm(tau + np.cross(q, g)))
    if size == 0:
        return float(np.linalg.norm(tau))
    forces = float(np.linalg.norm(tip.force) + np.linalg.norm(com.force))
    return abs(float(tau @ g)) / size if size > NO_FORCE * max(task.force_unit(n), forces) else 0.0
