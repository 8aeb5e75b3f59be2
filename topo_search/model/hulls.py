"""The convex hull of points: its corners, faces and edges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.arrays import Array

Indices = NDArray[np.intp]

FLAT = 1e-9
"""Faces whose normals differ by less are one face, so that the line between them is no edge."""


class Hull(NamedTuple):
    """A convex polytope."""

    corners: Array
    """Shape (k, 3)."""
    triangles: Indices
    """Corners of its faces, each cut into triangles, counter-clockwise seen from outside: shape (f, 3)."""
    normals: Array
    """Outward unit normals of the triangles, shape (f, 3)."""
    edges: Indices
    """Both ends of every edge, shape (e, 2)."""

    @property
    def offsets(self) -> Array:
        """Distance of the triangles' planes from the origin, shape (f,)."""
        result: Array = np.einsum("fx,fx->f", self.normals, self.corners[self.triangles[:, 0]])
        return result

    @property
    def planes(self) -> Array:
        """Normal and offset of every face, once however many triangles it is cut into, shape (p, 4)."""
        _, first = np.unique(self.normals.round(9) + 0.0, axis=0, return_index=True)
        result: Array = np.column_stack([self.normals, self.offsets])[np.sort(first)]
        return result


def convex_hull(points: Array, *, most_corners: int | None = None) -> Hull:
    """Return the hull of points that span a volume, shape (m, 3).

    Raises:
        ValueError: the points are too nearly flat to tell the hull, or it has more corners than that.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and few tasks need it

    try:
        found = ConvexHull(points)
    except QhullError:
        raise ValueError("must span a volume, but is flat") from None
    if most_corners is not None and len(found.vertices) > most_corners:
        rule = f"must have at most {most_corners} corners, but got {len(found.vertices):,}; simplify the shape"
        raise ValueError(rule)
    kept, triangles = np.unique(found.simplices, return_inverse=True)
    triangles, corners = triangles.reshape(-1, 3), points[kept]
    normals = found.equations[:, :3] / np.linalg.norm(found.equations[:, :3], axis=1, keepdims=True)
    first, second, third = corners[triangles].transpose(1, 0, 2)
    inwards = np.sum(np.cross(second - first, third - first) * normals, axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    f, across = np.nonzero(found.neighbors > np.arange(len(triangles))[:, None])  # all pairs of adjacent faces
    folded = np.linalg.norm(normals[f] - normals[found.neighbors[f, across]], axis=1) > FLAT
    sides = zip(found.simplices[f], found.simplices[found.neighbors[f, across]], strict=True)
    shared = [np.intersect1d(one, other) for one, other in sides]
    edges = np.searchsorted(kept, np.array(shared)[folded])
    return Hull(corners, triangles, normals, edges)


def has_volume(points: Array) -> bool:
    """Whether the hull of points, shape (m, 3), is neither flat nor thinner than a millionth of its length."""
    if len(points) < 4:
        return False
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[2] > 1e-6 * extents[0])
