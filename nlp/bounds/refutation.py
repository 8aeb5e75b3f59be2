"""Statement of a rule that proves that something is impossible.

A proof holds for every design that its audit calls clear, so it allows for what the audit lets pass: residuals of
`TOLERANCE` of every force [m_t g], of every torque about the COM and about the end-effector [l_arm m_t g], inputs
beyond their limits [u_max], hinge angles beyond pi/2 [rad] and a fixed end-effector off its place [l_arm].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from topo_search.model import ResolvedTask
from topo_search.model.proven import TOLERANCE


@dataclass(frozen=True)
class Refutation:
    """Lower bound on the violation of a constraint."""

    name: str
    amount: float
    """Positive, in `unit`."""
    unit: str
    message: str


def largest_thrust(task: ResolvedTask) -> float:
    """Return what all rotors at their limit pull with, 4 n k_f rho u_max [N]."""
    return 4 * task.n * task.module.thrust_coefficient * task.max_input


def unseen_thrust(task: ResolvedTask) -> float:
    """Return how much more the audit lets pass, and as much below zero [N]."""
    return 4 * task.n * task.module.thrust_coefficient * TOLERANCE * task.module.max_input(task.gravity)


def tolerated_force(task: ResolvedTask) -> float:
    """Return by how much the audit lets a force be missed, whatever the rod weighs [N]."""
    return TOLERANCE * (task.force_unit(task.n) + task.heaviest_rod * task.gravity)


def bodies_mass(task: ResolvedTask) -> float:
    """Return the mass of all modules and joints, m_t - m_E [kg]."""
    return task.total_mass(task.n) - task.end_effector.mass


def off_centre(task: ResolvedTask) -> float:
    """Return how far the centre of mass of all modules and joints is from the mean of the modules' centres [m].

    A joint's connector is l_c (1 + (n - 1)^2) / n <= (n - 1) l_c from that mean at most: at the end of a chain.
    With a rod that counts, of mass m_R, and a fixed end-effector it is by how much its weight changes the distance
    of p_E from the mean, times m_t - m_E: m_R (|p_E| + |its middle - p_E|) at most.
    """
    joints = (task.n - 1) * task.module.joint_mass
    moment = joints * (task.n - 1) * task.module.connector_distance
    if (position := task.end_effector.fixed_position) is not None and task.heaviest_rod:
        moment += task.heaviest_rod * (math.hypot(*position) + (task.largest_reach(task.n) or 0.0) / 2)
    return moment / bodies_mass(task)


def modules(task: ResolvedTask) -> str:
    """Name the platform in a message."""
    return "one module" if task.n == 1 else f"{task.n} modules"
