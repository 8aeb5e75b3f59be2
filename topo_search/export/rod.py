"""The rod that carries the end-effector, and its mass, which the model of solver and audit leaves out.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector that the rod is bolted to, p_i + l_c R_i e_a | (3,) | m |
| p'_E | the end-effector in W | (3,) | m |
| m, v | mass of the rod; unit vector along it | , (3,) | kg, - |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topo_search.export.poses import PORTS, Poses
from topo_search.model.arrays import Array, read_only
from topo_search.model.design import Design


@dataclass(frozen=True)
class Rod:
    """A straight rod with round ends."""

    start: Array
    """c, in W [m]."""
    end: Array
    """p'_E, in W [m]."""
    radius: float
    """[m]"""

    @property
    def length(self) -> float:
        """Between the centres of its ends [m]."""
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True)
class RodMass:
    """What a rod weighs: a thin tube."""

    mass: float
    """At `end_effector.rod_linear_density` [kg]."""
    inertia: Array
    """About its middle, in W's axes, (3, 3) [kg m^2]."""
    middle: Array
    """From the COM of the design, (3,) [m]."""


def mass_of(rod: Rod, design: Design, at: Poses) -> RodMass:
    """Return mass and inertia of the rod of a design."""
    m = design.task.end_effector.rod_linear_density * rod.length
    v = (rod.end - rod.start) / rod.length
    across = m * rod.length**2 / 12 * (np.eye(3) - np.outer(v, v))
    inertia = across + m * rod.radius**2 * np.outer(v, v)
    return RodMass(m, read_only(inertia), read_only((rod.start + rod.end) / 2 - at.p_com))


def rod_of(design: Design, at: Poses) -> Rod | None:
    """Return the rod of a design; None if the design names no connector for it, or it has no length."""
    if design.mount is None:
        return None
    i, l_c = design.mount.module, design.task.module.connector_distance
    start = at.p[i] + l_c * at.R[i] @ PORTS[design.mount.port]
    rod = Rod(start, at.end_effector, design.task.end_effector.rod_radius)
    return rod if rod.length > 0 else None
