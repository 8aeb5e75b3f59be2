"""What a rule says when it shows that something cannot be done."""

from __future__ import annotations

from dataclasses import dataclass

from topo_search.model import ResolvedTask

TOLERANCE = 1e-6
"""Largest wrench residual of a design that passes its audit [m_t g, l_arm m_t g]."""


@dataclass(frozen=True)
class Shortfall:
    """By how much a constraint is missed at least."""

    name: str
    amount: float
    """Positive, in `unit`."""
    unit: str
    message: str


def largest_thrust(task: ResolvedTask) -> float:
    """Return what all rotors at their limit pull with, 4 n k_f rho u_max [N]."""
    return 4 * task.n * task.module.thrust_coefficient * task.max_input


def modules(task: ResolvedTask) -> str:
    """Name the platform in a message."""
    return "one module" if task.n == 1 else f"{task.n} modules"
