"""Refutation of a task: a rule's proof that it is impossible.

A proof holds for every design with a clear audit, so it allows for the audit's tolerances: errors of `TOLERANCE` in
every force [m_t g], in every torque about the COM and about the end-effector [l_arm m_t g], in the limits of inputs
[u_max] and of hinge angles [rad], and in the position of a fixed end-effector [l_arm].
"""

import math
from dataclasses import dataclass

import numpy as np

from nlp.bounds.effort import gains_of, heaviest_extra
from topo_search.model import Array, ResolvedTask
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
    """Return the thrust of all rotors at their limits, r n k_f rho u_max if they are alike [N]."""
    shares = sum(count * float(shares.sum()) for shares, count in thrust_shares(task))
    return shares * task.module.thrust_coefficient * task.max_input


def thrust_shares(task: ResolvedTask) -> list[tuple[Array, int]]:
    """Return the largest thrusts of each type's rotors, (r,) [k_f u_max], and its number of modules."""
    return [(gains_of(task, kind) * task.rotor_shares(kind), count) for kind, count in task.counts]


def tolerated_thrust(task: ResolvedTask) -> float:
    """Return the audit's tolerance of the thrust of all rotors, beyond their limit and below zero [N]."""
    gains = sum(count * float(gains_of(task, kind).sum()) for kind, count in task.counts)
    return gains * task.module.thrust_coefficient * TOLERANCE * task.module.max_input(task.gravity)


def tolerated_force(task: ResolvedTask) -> float:
    """Return the audit's tolerance of a force on the heaviest platform [N]."""
    return TOLERANCE * (task.force_unit(task.n) + heaviest_extra(task) * task.gravity)


def largest_drag(task: ResolvedTask) -> float:
    """Return the largest drag torque of a rotor over its thrust [m]."""
    ratios = [
        (np.abs(kind.rotor_table.drags) / kind.rotor_table.gains).max(initial=0.0)
        * kind.torque_coefficient
        / kind.thrust_coefficient
        for kind in task.types
    ]
    return float(max(ratios))


def longest_arm(task: ResolvedTask) -> float:
    """Return the largest distance of a rotor from its module's centre [m]."""
    return max(kind.arm_length * float(kind.rotor_table.distances.max(initial=0.0)) for kind in task.types)


def bodies_mass(task: ResolvedTask) -> float:
    """Return the mass of all modules and joints, m_t - m_E [kg]."""
    return task.total_mass(task.n) - task.end_effector.mass


def centre_offset(task: ResolvedTask) -> float:
    """Return a bound on the distance of the centre of mass of modules and joints from the centroid [m].

    Modules are at most (n - 1) l_c from it; only differences to one of their masses count. A joint's connector
    is at most l_c (1 + (n - 1)^2) / n <= (n - 1) l_c from that centroid, at the end of a chain.
    With a rod of mass m_R and a fixed end-effector, the rod changes the distance of p_E from the centroid, times
    m_t - m_E, by at most m_R (|p_E| + |its middle - p_E|).
    """
    joints = (task.n - 1) * task.module.joint_mass + task.heaviest_closures
    uneven = min(sum(count * abs(kind.mass - one.mass) for kind, count in task.counts) for one in task.types)
    moment = (joints + uneven) * (task.n - 1) * task.longest_connector
    if (position := task.end_effector.fixed_position) is not None and task.heaviest_rod:
        moment += task.heaviest_rod * (math.hypot(*position) + (task.largest_reach(task.n) or 0.0) / 2)
    return moment / bodies_mass(task)


def size_text(task: ResolvedTask) -> str:
    """Return the platform's size as text."""
    return "one module" if task.n == 1 else f"{task.n} modules"
