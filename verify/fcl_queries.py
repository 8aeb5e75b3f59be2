"""The one question that python-fcl answers reliably: do two convex polytopes overlap?

Facts about python-fcl 0.7 that shape this module:

- `collide` of two `Convex` with the default solver is right where `distance`, the `Halfspace`, `Plane` and BVH
  paths are wrong, blind to nesting, or crash the process; nothing else is called here.
- Tolerances are absolute: coordinates are scaled so that an arm is 1e3 long, and must be near the origin.
- Faces must be packed as [3, i, j, k, ...]; NaN and infinite coordinates give nonsense without an error.
- Requests and results accumulate: both are new for every query.
- Objects cannot be pickled and may crash the process: run an audit in a child process.
"""

from __future__ import annotations

import copy

import fcl
import numpy as np

from verify.bodies import Array
from verify.meshes import ConvexMesh

SCALE = 1e3
"""FCL's length of one arm."""
FARTHEST = 1e6
"""Coordinates beyond this many arms have lost the digits that FCL's tolerances need."""


class Shape:
    """A convex polytope, in arm lengths, as FCL holds it."""

    def __init__(self, mesh: ConvexMesh) -> None:
        if not np.all(np.abs(mesh.vertices) <= FARTHEST):
            raise ValueError(f"coordinates must be finite and within {FARTHEST:g} arm lengths")
        faces = np.concatenate([np.full((len(mesh.triangles), 1), 3, dtype=np.int64), mesh.triangles], axis=1)
        self._convex = fcl.Convex(SCALE * mesh.vertices, len(faces), faces.ravel())
        self._place(np.eye(3), np.zeros(3))

    def _place(self, R: Array, p: Array) -> None:
        if not np.all(np.abs(p) <= FARTHEST):
            raise ValueError(f"coordinates must be finite and within {FARTHEST:g} arm lengths")
        self._R, self._p = R, p
        self._object = fcl.CollisionObject(self._convex, fcl.Transform(R, SCALE * p))

    def place(self, R: Array, p: Array) -> Shape:
        """Return the polytope turned by R, shape (3, 3), then moved by p, shape (3,); FCL makes it only once."""
        elsewhere = copy.copy(self)
        elsewhere._place(R @ self._R, R @ self._p + p)
        return elsewhere

    def overlaps(self, other: Shape) -> bool:
        """True if the two solids have a point in common, as far as FCL can tell."""
        return bool(fcl.collide(self._object, other._object, fcl.CollisionRequest(), fcl.CollisionResult()))
