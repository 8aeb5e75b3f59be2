"""The rigid parts of a module as four-cornered faces: hub and arms as boxes, rotor discs as short cylinders.

All in the module frame, (faces, 4, 3) [m], corners counter-clockwise from outside; sizes as in `[module.body]`.
"""

from __future__ import annotations

import math

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.module import Module

ROTOR_ANGLES = tuple(math.radians(angle) for angle in (-45, -135, 135, 45))
"""Direction of rotor q = 1..4 from the module's centre (paper, X layout)."""
ROTOR_SPINS = (-1, 1, -1, 1)
"""(-1)^q: sign of the drag torque of rotor q along the thrust axis."""

_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_TURNED = _SQUARE[::-1]
CUBE = np.array(
    [
        np.insert(_SQUARE if outwards else _TURNED, axis, side, axis=1)
        for axis in range(3)
        for side, outwards in ((-1.0, axis == 1), (1.0, axis != 1))
    ]
)
"""Faces of the cube [-1, 1]^3."""


def frame(module: Module) -> Array:
    """Return the faces of hub and arms, or of a frame of the module's own: triangles, their last corner twice."""
    body, l_arm, w = module.body, module.arm_length, module.body.arm_width
    if body.frame is not None:
        own = np.concatenate([np.array(piece.vertices)[np.array(piece.triangles)] for piece in body.frame])
        seen = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 1]).any(axis=1)
        return np.asarray(own[seen][:, [0, 1, 2, 2]])
    arm = CUBE * np.array([l_arm, w, w]) / 2 + np.array([l_arm / 2, 0.0, 0.0])
    return np.concatenate([CUBE * np.array(body.hub) / 2, *(arm @ _turn(angle).T for angle in ROTOR_ANGLES)])


def rotors(module: Module) -> Array:
    """Return the faces of the four rotor discs."""
    disc = cylinder(module.body.rotor_radius, module.body.rotor_height)
    return np.concatenate([disc + _turn(angle) @ np.array([module.arm_length, 0.0, 0.0]) for angle in ROTOR_ANGLES])


def cylinder(radius: float, height: float, *, sides: int = 16) -> Array:
    """Return the faces of a prism about z with an even number of sides; each end is cut into strips."""
    angles = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    ring = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    top, bottom = ring + np.array([0, 0, height / 2]), ring - np.array([0, 0, height / 2])
    around = np.stack([bottom, np.roll(bottom, -1, axis=0), np.roll(top, -1, axis=0), top], axis=1)
    strips = [[k, k + 1, sides - 2 - k, sides - 1 - k] for k in range(sides // 2 - 1)]
    return np.concatenate([around, top[strips], bottom[strips][:, ::-1]])


def _turn(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
