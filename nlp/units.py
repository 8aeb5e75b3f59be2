"""The dimensionless problem: lengths in l_arm, forces in m g, rotor inputs in the hover input of one module.

The rotors of a module at input 1 have its weight as their thrust: r k_f u_hover = m g with r rotors.
"""

from __future__ import annotations

from dataclasses import dataclass

from topo_search.model import ResolvedTask


@dataclass(frozen=True)
class Units:
    """SI values of the dimensionless units of a task."""

    length: float
    """l_arm [m]."""
    force: float
    """m g [N]."""
    input: float
    """u_hover = m g / (r k_f) [rad^2/s^2]."""

    @classmethod
    def of(cls, task: ResolvedTask) -> Units:
        """Return the units of a task."""
        module = task.module
        return cls(module.arm_length, module.mass * task.gravity, module.hover_input(task.gravity))

    @property
    def torque(self) -> float:
        """l_arm m g [N m]."""
        return self.length * self.force
