"""Masses of a platform, as a few rigid bodies with the platform's centre of mass.

| symbol | meaning | shape | unit |
|---|---|---|---|
| M_i | mass of module i with half of each of its joints, and of a rod with mass that it carries | (n,) | m |
| d_i | centre of that mass from the module's centre, x and y in the module's frame | (n, 2) | l_arm |
| I_i | inertia of that mass about its centre, in the module's frame | (n, 3, 3) | m l_arm^2 |
| M_E | mass of the end-effector with the other half of the rod | | m |
| B | sum_i M_i (p_i + R_i d_i) / sum_i M_i | (3,) | l_arm |

A joint's mass is at its connector, where both halves meet; a rod's centre of mass is in the middle between its
connector and the tip. p_COM = (sum_i M_i B + M_E p'_E) / (sum_i M_i + M_E), so an end-effector fixed at p_E from
the COM is at p'_E = B + p_E (sum_i M_i + M_E) / sum_i M_i. Half the rod's mass at each end has the rod's centre of
mass, but its inertia about the middle is m_R / 4 times that of a unit mass at d, the vector along the rod.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from topo_search.model import PORT_DIRECTIONS, Array, ResolvedTask, Topology, read_only

TINY = 1e-12
"""Square of a rod's length below which its inertia about its axis is neglected [l_arm^2]."""


class RodMass(NamedTuple):
    """Rod with mass; of zero mass if the task counts none."""

    mass: float
    """m_R [m]."""
    module: int
    """Module that carries the rod."""
    foot: tuple[float, float, float]
    """Start of the rod, from that module's centre and in its frame [l_arm]."""
    radius: float
    """Radius of the rod, a thin tube [l_arm]."""


class RigidBody(NamedTuple):
    """A module with its joints, as a rigid body."""

    mass: float
    """M_i."""
    centre: tuple[float, ...]
    """d_i."""
    inertia: tuple[tuple[float, ...], ...]
    """I_i."""


class Masses(NamedTuple):
    """Masses in units of [module]'s mass, lengths in l_arm."""

    module: float
    """m [kg]."""
    modules: Array
    """M_i."""
    centres: Array
    """d_i."""
    inertias: Array
    """I_i."""
    rod: RodMass
    tip_kg: float
    """M_E [kg]."""

    def body(self, i: int) -> RigidBody:
        """Return module i with its joints."""
        return RigidBody(
            float(self.modules[i]), tuple(self.centres[i].tolist()), tuple(map(tuple, self.inertias[i].tolist()))
        )

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
        """Ratio of p'_E - B to p_E, for a fixed end-effector."""
        return self.total / self.bodies


@lru_cache(maxsize=64)
def masses(task: ResolvedTask, topology: Topology) -> Masses:
    """Return the masses of a platform."""
    module, end_effector, at_nodes = task.module, task.end_effector, task.modules_of_nodes
    unit, moments = module.arm_length, np.zeros((topology.n, 2))
    half, l_c = module.joint_mass / module.mass / 2, task.connector_distances / unit
    modules = np.array([own.mass / module.mass for own in at_nodes])
    inertias = np.array([np.diag(own.inertia) / (module.mass * unit**2) for own in at_nodes])
    at_ports = [(module_i, port, half) for h, a, i, b in topology.bolts for module_i, port in ((h, a), (i, b))]
    tip_kg, rod, counted = end_effector.mass, RodMass(0.0, 0, (0.0, 0.0, 0.0), 0.0), end_effector.counted_rod
    if counted is not None:
        x, y, z = (l_c[counted.module] * PORT_DIRECTIONS[counted.port]).tolist()
        rod = RodMass(counted.mass / module.mass, counted.module, (x, y, z), end_effector.rod_radius / unit)
        at_ports.append((counted.module, counted.port, rod.mass / 2))
        tip_kg += counted.mass / 2
    for i, port, mass in at_ports:
        modules[i] += mass
        moments[i] += mass * l_c[i] * PORT_DIRECTIONS[port][:2]
        inertias[i] += mass * point_inertia(l_c[i] * PORT_DIRECTIONS[port])
    centres = moments / modules[:, None]
    for i, (x, y) in enumerate(centres):
        inertias[i] -= modules[i] * point_inertia(np.array([x, y, 0.0]))
    return Masses(module.mass, read_only(modules), read_only(centres), read_only(inertias), rod, tip_kg)


def point_inertia(o: Array) -> Array:
    """Return the inertia about the origin of a unit mass at o."""
    return np.asarray(o @ o * np.eye(3) - np.outer(o, o))
