"""Parts of the picture in 3-D, and the shapes that they are made of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import trimesh
from trimesh import Trimesh

from topo_search.export.poses import rotation_to
from topo_search.export.solids import cone_sphere, join, pose_matrix
from topo_search.model.arrays import Array

TURN = math.radians(300)
"""Angle of a ring that is drawn [rad]."""
EDGE = math.radians(46)
"""Faces that meet at a larger angle have an edge in between, as the sides of an octagon just have none [rad]."""


class Part(NamedTuple):
    """Something of one colour, once in the axes of the task, or a copy in the frame of some modules."""

    kind: str
    name: str
    """In the legend."""
    colour: str
    mesh: Trimesh | str
    """Its surface; of copies the name of one of the meshes that all modules have."""
    modules: Sequence[int] = ()
    """Module of each copy."""
    steps: Sequence[int] = (0,)
    """Steps of the assembly from which on the copies are there."""
    opacity: float = 1.0

    def dump(self) -> dict[str, Any]:
        """Return it as the page takes it."""
        return {**self._asdict(), "mesh": self.mesh if isinstance(self.mesh, str) else triangles_of(self.mesh)}


def triangles_of(mesh: Trimesh) -> dict[str, list[float]]:
    """Return a mesh as the page takes it, with corners apart at its edges."""
    shaded = trimesh.graph.smooth_shade(mesh, angle=EDGE)
    return {"corners": shaded.vertices.round(5).ravel().tolist(), "faces": shaded.faces.ravel().tolist()}


def ball(centre: Array, radius: float) -> Trimesh:
    """Return a ball."""
    return cone_sphere(centre, radius, centre, radius, sides=16)


def tube(start: Array, end: Array, radius: float) -> Trimesh:
    """Return a tube with round ends."""
    return cone_sphere(start, radius, end, radius, sides=12)


def straight_arrow(start: Array, direction: Array, length: float, thick: float) -> tuple[Trimesh, Array]:
    """Return an arrow and its point, (3,) [m].

    Args:
        start: where it begins, (3,) [m].
        direction: unit vector, (3,).
        length: of it [m].
        thick: radius of its shaft [m].
    """
    head = min(5 * thick, length / 2)
    shaft = trimesh.creation.cylinder(radius=thick, height=length - head, sections=10)
    shaft.apply_translation((0, 0, (length - head) / 2))
    cone = trimesh.creation.cone(radius=2.4 * thick, height=head, sections=10)
    cone.apply_translation((0, 0, length - head))
    mesh = join([shaft, cone]).apply_transform(pose_matrix(rotation_to(direction), start))
    return mesh, start + length * direction


def ring(centre: Array, axis: Array, radius: float, thick: float) -> tuple[Trimesh, Array]:
    """Return an arrow that turns about an axis by the right-hand rule, and where it begins."""
    angles = np.linspace(0.0, TURN, 25)
    path = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    steps = [
        trimesh.creation.cylinder(radius=thick, segment=[one, other], sections=8)
        for one, other in itertools.pairwise(path)
    ]
    forward = np.array([-math.sin(TURN), math.cos(TURN), 0.0])
    head = trimesh.creation.cone(radius=2.4 * thick, height=5 * thick, sections=10)
    head.apply_transform(pose_matrix(rotation_to(forward), path[-1]))
    mesh = join([*steps, head]).apply_transform(pose_matrix(rotation_to(axis), centre))
    return mesh, centre + rotation_to(axis) @ path[0]
