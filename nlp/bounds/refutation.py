"""Statement of a rule that proves that something is impossible.

A proof holds for every design that its audit calls clear, so it allows for what the audit lets pass: residuals of
`TOLERANCE` of every force [m_t g], of every torque about the COM and about the end-effector [l_arm m_t g], inputs
beyond their limits [u_max], hinge angles beyond pi/2 [rad] and a fixed end-effector off its place [l_arm].
"""

from __future__ import annotations

from dataclasses import dataclass

from topo_search.model import ResolvedTask
from topo_search.model.tolerances import TOLERANCE


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


def modules(task: ResolvedTask) -> str:
    """Name the platform in a message."""
    return "one module" if task.n == 1 else f"{task.n} modules"
