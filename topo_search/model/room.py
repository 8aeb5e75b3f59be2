r"""The room that the rigid parts of a module need, whichever way its neighbours are turned.

Modules that are not bolted together cannot touch as long as the balls of radius rho around their centres do not.

Two modules that are bolted together share a hinge's axis. Seen along it, each keeps to a wedge about the line from
the axis to its centre, and the two lines are pi - |alpha| apart. Hubs and arms may meet there, but a rotor may
touch nothing. It stays at least d away from the axis, so only parts as far away as that count: a rotor and a part
meet at no angle with

.. math:: |\alpha| < \pi - \beta_r - \beta, \qquad \beta = \max \operatorname{atan2}(|z|, l_c - x)

Two rotors do meet from there on: they are mirror images in the plane that halves the angle between the lines. For a
rotor and a frame the bound is on the safe side, by what this view leaves out.

| symbol | meaning | unit |
|---|---|---|
| x, z | coordinates of a point in the module's frame, x towards the port | m |
| d | least distance of the rotors from the hinge's axis, l_c - l_arm / sqrt 2 - rotor radius | m |
| beta_r | largest elevation of rotors over the line to the centre, seen from the axis | rad |
| beta | the same of all parts beyond d | rad |
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.module import Module

ROUNDING = 1e-9
"""Share of d by which a point on the circle around the axis may seem to be inside it."""
LARGE = 4.0
"""Lengths that keep modules off the end-effector, and its rod, are seldom meant to be longer, in packed widths."""
INWARDS = 0.2
"""How far inside its connector's plane a frame may touch a bolted neighbour's [l_c]: 30 mm of the default module.

A frame that is as high as the default hub at its connector needs 20 mm when it is folded by 90 degrees.
"""
OUTWARDS = 0.05
"""How far past that plane [l_c]: room for a fitting, 7.5 mm of the default module."""
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a box with edges of 1."""


def packed_width(module: Module, n: int) -> float:
    """Return how wide n modules are, packed in a square: a scale for lengths at the target [m]."""
    return 2 * module.connector_distance * math.sqrt(n)


def body_radius(module: Module) -> float:
    """Return rho: all rigid parts lie in the ball of this radius around the module's centre [m]."""
    body = module.body
    rim = math.hypot(module.arm_length + body.rotor_radius, body.rotor_height / 2)
    return max(rim, float(np.linalg.norm(_frame_edges(module), axis=-1).max()))


def frame_reach(module: Module) -> float:
    """Return how far hub and arms, or the module's own frame, reach towards any of the four ports [m]."""
    return float(np.abs(_frame_edges(module)[..., :2]).max())


def largest_hinge_angle(module: Module, margin: float = 0.0) -> float:
    """Return how far a hinge turns at most before a rotor of one module can meet the other one [rad].

    One number for all ports, so that trees which are alike have the same designs. At most pi/2; negative where this
    view of the parts shows no angle to be clear, though `topo_search.model.folds` may find some.

    Args:
        module: the module, at either side of the hinge.
        margin: what the rotors keep clear of other parts by at least [m].
    """
    body = module.body
    d = module.connector_distance - module.arm_length / math.sqrt(2) - body.rotor_radius - margin
    rotor = math.atan2(body.rotor_height / 2 + margin, d)
    return min(math.pi / 2, math.pi - rotor - max(rotor, _elevation(module, max(d, 0.0))))


def _elevation(module: Module, d: float) -> float:
    """Return the largest elevation of the frame beyond a distance from a hinge's axis [rad], at any port.

    Along an edge the elevation rises or falls all the way to z = 0, so it is largest at an end of what is beyond d.
    """
    edges, largest = _frame_edges(module), 0.0
    for outwards in ([1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]):
        seen = np.stack([module.connector_distance - edges[..., :2] @ outwards, edges[..., 2]], axis=-1)
        if seen[..., 0].min() <= -d:
            return math.pi  # as far beyond the axis as the neighbour's rotors
        start, along = seen[:, 0], seen[:, 1] - seen[:, 0]
        a, b = np.sum(along * along, axis=1), np.sum(start * along, axis=1)
        root = np.sqrt(np.maximum(0.0, b * b - a * (np.sum(start * start, axis=1) - d * d)))
        safe = np.where(a > 0.0, a, 1.0)  # an edge along the axis is a point
        t = np.clip([(-b - root) / safe, (-b + root) / safe, np.zeros_like(a), np.ones_like(a)], 0.0, 1.0)
        points = start + t[..., None] * along
        beyond = points[np.linalg.norm(points, axis=-1) >= d * (1 - ROUNDING)]
        largest = max(largest, float(np.arctan2(np.abs(beyond[:, 1]), beyond[:, 0]).max(initial=0.0)))
    return largest


def frame_pieces(module: Module) -> list[Array]:
    """Return the corners of hub and arms, or of each convex piece of the module's own frame, shapes (k, 3) [m]."""
    body, l_arm, w = module.body, module.arm_length, module.body.arm_width
    if body.frame is not None:
        return [np.array(piece.vertices) for piece in body.frame]
    boxes = [CUBE * body.hub]
    for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        along, across = np.array([x, y, 0.0]) / math.sqrt(2), np.array([-y, x, 0.0]) / math.sqrt(2)
        axes = np.stack([l_arm * along, w * across, [0.0, 0.0, w]])
        boxes.append(l_arm / 2 * along + CUBE @ axes)
    return boxes


def _frame_edges(module: Module) -> Array:
    """Return both ends of all edges of hub and arms, or of the module's own frame, shape (m, 2, 3) [m].

    A box has its diagonals as well: they lie inside it.
    """
    if module.body.frame is not None:
        sides = [np.array(piece.vertices)[np.array(piece.triangles)] for piece in module.body.frame]
        corners = np.concatenate(sides)
        return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = list(combinations(range(len(CUBE)), 2))
    return np.concatenate([box[pairs] for box in frame_pieces(module)])
