"""Where the modules of a design are: forward kinematics in plain numbers, for pictures and exports.

| symbol | meaning | shape | unit |
|---|---|---|---|
| W | task frame, origin at the root module's centre | | |
| h, i | parent, child; a, b: their ports of the joint | | |
| e_0..e_3 | port directions +x, +y, -x, -y in the module frame | (4, 3) | |
| kappa | (a + 2 - b) mod 4 | | |
| R_i, p_i | orientation and centre of module i in W | (3, 3), (3,) | -, m |
| alpha_i | hinge angle of the joint h-i | | rad |
| p'_E, p_COM | end-effector, platform centre of mass in W | (3,) | m |
| p_E | p'_E - p_COM | (3,) | m |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from topo_search.model.arrays import Array, read_only
from topo_search.model.design import Design

PORTS = read_only([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
"""e_0..e_3."""


@dataclass(frozen=True)
class Poses:
    """A platform in the task frame."""

    R: Array
    """Orientations, (n, 3, 3)."""
    p: Array
    """Centres of the modules, (n, 3) [m]."""
    p_com: Array
    """Centre of mass with the end-effector, (3,) [m]."""
    end_effector: Array
    """p'_E, (3,) [m]."""

    @property
    def p_E(self) -> Array:
        """End-effector from the centre of mass, (3,) [m]."""
        return self.end_effector - self.p_com

    @property
    def z(self) -> Array:
        """Thrust axes, (n, 3)."""
        return self.R[:, :, 2]


def poses(design: Design) -> Poses:
    """Return the pose of every module, walking the tree from the root (paper, Sec. II)."""
    task, l_c = design.task, design.task.module.connector_distance
    psi, alpha_0, alpha_1 = design.root_orientation_rad
    R = [rotation("z", psi) @ rotation("x", alpha_0) @ rotation("y", alpha_1)]
    p = [np.zeros(3)]
    for (h, _, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True):
        R_hinged = R[h] @ rotation("y" if a % 2 == 0 else "x", alpha)
        kappa = (a + 2 - b) % 4
        R.append(R_hinged @ rotation("z", kappa * math.pi / 2))
        p.append(p[h] + l_c * (R[h] + R_hinged) @ PORTS[a])
    end_effector = np.array(design.end_effector_m)
    m, m_E = task.module.mass, task.end_effector.mass
    p_com = (m * np.sum(p, axis=0) + m_E * end_effector) / task.total_mass(design.topology.n)
    return Poses(read_only(R), read_only(p), read_only(p_com), read_only(end_effector))


def rotation(axis: str, angle: float) -> Array:
    """Return the rotation by `angle` [rad] about a coordinate axis, `x`, `y` or `z`; (3, 3)."""
    j, k = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[j, j] = R[k, k] = math.cos(angle)
    R[k, j] = math.sin(angle)
    R[j, k] = -R[k, j]
    return R


def rotation_to(a: Array) -> Array:
    """Return a rotation that takes the z axis to a unit vector, (3, 3)."""
    s = np.cross(np.eye(3)[np.argmin(np.abs(a))], a)
    s /= np.linalg.norm(s)
    return np.stack([s, np.cross(a, s), a], axis=1)
