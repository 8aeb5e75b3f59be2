"""Where the modules of a design are, as the audit derives it, for pictures and exports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topo_search.model.arrays import Array, read_only
from topo_search.model.design import Design
from topo_search.model.layout import PORT_DIRECTIONS
from verify.kinematics import platform, rotation

__all__ = ["PORTS", "Poses", "poses", "rotation", "rotation_to"]

PORTS = read_only(PORT_DIRECTIONS)
"""Directions of the ports 0..3, +x, +y, -x, -y, in the module frame."""


@dataclass(frozen=True)
class Poses:
    """A platform in the task frame W, whose origin is the root module's centre."""

    R: Array
    """Orientations, (n, 3, 3)."""
    p: Array
    """Centres of the modules, (n, 3) [m]."""
    p_com: Array
    """Centre of mass with the end-effector, (3,) [m]."""
    end_effector: Array
    """p'_E, (3,) [m]."""
    rotors: Array
    """Rotors from the centre of mass, (n, 4, 3) [m]."""

    @property
    def p_E(self) -> Array:
        """End-effector from the centre of mass, (3,) [m]."""
        return self.end_effector - self.p_com

    @property
    def z(self) -> Array:
        """Thrust axes, (n, 3)."""
        return self.R[:, :, 2]


def poses(design: Design) -> Poses:
    """Return the pose of every module by the audit's forward kinematics."""
    found = platform(design)
    places = found.poses.p, found.p_com, design.end_effector_m, found.rotors
    return Poses(read_only(found.poses.R), *map(read_only, places))


def rotation_to(a: Array) -> Array:
    """Return a rotation that takes the z axis to a unit vector, (3, 3)."""
    s = np.cross(np.eye(3)[np.argmin(np.abs(a))], a)
    s /= np.linalg.norm(s)
    return np.stack([s, np.cross(a, s), a], axis=1)
