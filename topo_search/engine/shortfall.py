"""How far a candidate was from feasible, in numbers that can be compared between constraints."""

from __future__ import annotations

from topo_search.model import ResolvedTask


def scaled_violation(violation: float, unit: str, task: ResolvedTask) -> float:
    """Return a violation in the task's own units: m_t g, l_arm m_t g, l_arm, u_max, rad."""
    scales = {
        "N": task.force_unit(task.n),
        "N m": task.torque_unit(task.n),
        "m": task.module.arm_length,
        "rad^2/s^2": task.module.max_input(task.gravity),
    }
    return violation / scales.get(unit, 1.0)
