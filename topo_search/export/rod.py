"""The rod that carries the end-effector, as simulators and solids have it: without mass, like in the solver.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector that the rod is bolted to, p_i + l_c R_i e_a | (3,) | m |
| p'_E | the end-effector in W | (3,) | m |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topo_search.export.poses import PORTS, Poses
from topo_search.model.arrays import Array
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


def rod_of(design: Design, at: Poses) -> Rod | None:
    """Return the rod of a design; None if the design names no connector for it, or it has no length."""
    if design.mount is None:
        return None
    i, l_c = design.mount.module, design.task.module.connector_distance
    start = at.p[i] + l_c * at.R[i] @ PORTS[design.mount.port]
    rod = Rod(start, at.end_effector, design.task.end_effector.rod_radius)
    return rod if rod.length > 0 else None
