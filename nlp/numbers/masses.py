"""Masses of a platform as the few rigid bodies that its centre of mass follows from.

| symbol | meaning | shape | unit |
|---|---|---|---|
| M_i | mass of module i with half of each of its joints and of the rod, if it holds one that counts | (n,) | m |
| d_i | centre of that mass from the module's centre, x and y in the module's frame | (n, 2) | l_arm |
| M_E | mass of the end-effector with the other half of that rod | | m |
| B | sum_i M_i (p_i + R_i d_i) / sum_i M_i | (3,) | l_arm |

A joint's mass is at its connector, where both halves meet, a rod's in the middle between its connector and the tip.
p_COM = (sum_i M_i B + M_E p'_E) / (sum_i M_i + M_E), so that an end-effector fixed at p_E from the COM is at
p'_E = B + p_E (sum_i M_i + M_E) / sum_i M_i.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array, read_only
from topo_search.model.layout import PORT_DIRECTIONS


class Masses(NamedTuple):
    """Masses in those of a module, lengths in l_arm."""

    module: float
    """m [kg]."""
    modules: Array
    """M_i."""
    centres: Array
    """d_i."""
    tip_kg: float
    """M_E [kg]."""

    @property
    def tip(self) -> float:
        """M_E."""
        return self.tip_kg / self.module

    @property
    def bodies(self) -> float:
        """Sum of M_i."""
        return float(self.modules.sum())

    @property
    def total(self) -> float:
        """m_t."""
        return self.bodies + self.tip

    @property
    def lever(self) -> float:
        """p'_E - B over p_E."""
        return self.total / self.bodies


def masses(task: ResolvedTask, topology: Topology) -> Masses:
    """Return the masses of a task's platform."""
    module, modules = task.module, np.ones(topology.n)
    moments, half = np.zeros((topology.n, 2)), module.joint_mass / module.mass / 2
    at_ports = [(one, port, half) for h, i, a, b in topology.edges() for one, port in ((h, a), (i, b))]
    tip_kg, rod = task.end_effector.mass, task.end_effector.counted_rod
    if rod is not None:
        at_ports.append((rod.module, rod.port, rod.mass / module.mass / 2))
        tip_kg += rod.mass / 2
    for i, port, mass in at_ports:
        modules[i] += mass
        moments[i] += mass * module.connector_distance / module.arm_length * PORT_DIRECTIONS[port][:2]
    return Masses(module.mass, read_only(modules), read_only(moments / modules[:, None]), tip_kg)
