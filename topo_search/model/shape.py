"""Shapes of exposure requirements, which airflow must stay out of or inside, and convex hulls of points.

Points are in metres from the end-effector p_E, in the axes of the task frame. Solver, symmetries and pictures use
these shapes; the audit reads the requirements themselves.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.arrays import Array
from topo_search.model.value import Vector

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Indices = NDArray[np.intp]

SLACK = 1e-9
"""Offset of the planes of an outer hull, relative to its size; exceeds rounding errors of corners."""


class Hull(NamedTuple):
    """Convex polytope."""

    corners: Array
    """Vertices, shape (k, 3)."""
    triangles: Indices
    """Vertex indices of the triangulated faces, counter-clockwise seen from outside, shape (f, 3)."""
    normals: Array
    """Outward unit normals of the triangles, shape (f, 3)."""
    edges: Indices
    """Vertex indices of every edge, shape (e, 2)."""

    @property
    def offsets(self) -> Array:
        """Distance of the triangles' planes from the origin, shape (f,)."""
        return np.asarray(np.einsum("fx,fx->f", self.normals, self.corners[self.triangles[:, 0]]))

    @property
    def planes(self) -> Array:
        """Normal and offset of every face (not triangle), shape (p, 4)."""
        _, first = np.unique(self.normals.round(9) + 0.0, axis=0, return_index=True)
        return np.asarray(np.column_stack([self.normals, self.offsets])[np.sort(first)])


def convex_hull(points: Array) -> Hull:
    """Return the convex hull of points, shape (m, 3); ValueError if they are flat or nearly so."""
    qhull = _qhull(points)
    vertices, triangles = np.unique(qhull.simplices, return_inverse=True)
    triangles, corners = triangles.reshape(-1, 3), points[vertices]
    normals = qhull.equations[:, :3] / np.linalg.norm(qhull.equations[:, :3], axis=1, keepdims=True)
    first, second, third = corners[triangles].transpose(1, 0, 2)
    inwards = np.sum(np.cross(second - first, third - first) * normals, axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    f, across = np.nonzero(qhull.neighbors > np.arange(len(triangles))[:, None])  # all pairs of adjacent triangles
    # coplanar triangles belong to one face: the line between them is not an edge
    is_edge = np.linalg.norm(normals[f] - normals[qhull.neighbors[f, across]], axis=1) > 1e-9
    sides = zip(qhull.simplices[f], qhull.simplices[qhull.neighbors[f, across]], strict=True)
    shared = [np.intersect1d(one, other) for one, other in sides]
    edges = np.searchsorted(vertices, np.array(shared)[is_edge])
    return Hull(corners, triangles, normals, edges)


def outer_hull(points: Array, most_corners: int) -> tuple[Array, float]:
    """Return the corners of a convex polytope that contains points, and its excess over their hull.

    The polytope is the hull if that has few enough corners. Otherwise a box is cut by supporting planes of the
    hull, one after the other at the corner farthest from the hull. All planes are moved outwards by more than
    rounding.

    Args:
        points: points that span a volume, shape (m, 3).
        most_corners: largest number of corners, at least eight.

    Returns:
        Corners, shape (k, 3), and the largest distance of a corner from the hull.

    Raises:
        ValueError: the points are flat or nearly so, or too far from the origin for their size.
    """
    qhull = _qhull(points)
    hull = points[np.unique(qhull.simplices)]
    if len(hull) <= most_corners:
        return hull, 0.0
    from scipy.spatial import HalfspaceIntersection, QhullError

    middle = hull.mean(axis=0)
    size = float(np.abs(hull - middle).max())
    scaled = (hull - middle) / size
    slack = SLACK + 8 * np.finfo(float).eps * float(np.abs(middle).max()) / size
    axes = np.linalg.svd(scaled, full_matrices=False)[2]
    normals, corners, excess = [*axes, *-axes], np.zeros((0, 3)), 0.0
    gaps: dict[tuple[float, ...], Array] = {}
    while True:
        offsets = (np.array(normals) @ scaled.T).max(axis=1) + slack
        try:
            cut = HalfspaceIntersection(np.column_stack([normals, -offsets]), np.zeros(3)).intersections
        except QhullError:
            raise ValueError("must be thicker for its size, to be simplified") from None
        _, first = np.unique(cut.round(9) + 0.0, axis=0, return_index=True)
        if len(first) > most_corners:
            break
        corners = cut[first]
        for key, corner in zip(map(tuple, corners.round(9).tolist()), corners, strict=True):
            if key not in gaps:
                gaps[key] = corner - _nearest(corner, scaled)
        beyond = [gaps[key] for key in map(tuple, corners.round(9).tolist())]
        lengths = np.linalg.norm(beyond, axis=1)
        excess = float(lengths.max())
        if excess <= 100 * slack:
            break
        normals.append(beyond[int(np.argmax(lengths))] / excess)
    outer = np.unique(middle + size * corners, axis=0)
    faces = _qhull(outer).equations
    if (hull @ faces[:, :3].T + faces[:, 3]).max() > 0:
        raise ValueError("must be nearer to the origin for its size, to be simplified")
    return outer, size * (excess + slack)


def _nearest(x: Array, corners: Array) -> Array:
    """Return the point of a hull nearest to a point x outside of it, shape (3,), given its corners, shape (k, 3).

    Active-set method: the corner farthest towards x enters; least distances by Lawson and Hanson, Ch. 23.
    """
    from scipy.optimize import nnls

    active = [int(np.argmin(np.linalg.norm(corners - x, axis=1)))]
    while True:
        towards = corners[active] - x
        weights = nnls(np.vstack([towards.T, np.ones(len(active))]), np.array([0.0, 0.0, 0.0, 1.0]))[0]
        nearest = np.asarray(weights @ corners[active] / weights.sum())
        ahead = corners @ (x - nearest)
        farthest = int(np.argmax(ahead))
        if farthest in active or ahead[farthest] - nearest @ (x - nearest) <= SLACK * np.linalg.norm(x - nearest):
            return nearest
        active = [*(corner for corner, weight in zip(active, weights, strict=True) if weight > 0), farthest]


def _qhull(points: Array) -> ConvexHull:
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and few tasks need it

    try:
        return ConvexHull(points)
    except QhullError:
        raise ValueError("must span a volume, but is flat") from None


def has_volume(points: Array) -> bool:
    """True if the hull of points, shape (m, 3), is at least a millionth as thick as long."""
    if len(points) < 4:
        return False
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[2] > 1e-6 * extents[0])


NOWHERE: Vector = (0.0, 0.0, 0.0)


class Capsule(NamedTuple):
    """Capsule to stay out of: balls along a segment, or a single ball."""

    radius: float
    start: Vector = NOWHERE
    end: Vector = NOWHERE
    length: float | None = None
    """Length of a segment along p_E, away from the COM, instead of its end [m]."""

    @property
    def takes_direction_from_com(self) -> bool:
        """True if the segment is along p_E."""
        return self.length is not None

    def at(self, p_E: Array) -> Capsule:
        """Return the capsule with a fixed end, given the end-effector from the COM p_E, (3,)."""
        if self.length is None:
            return self
        return self._replace(end=_vector(self.length * _unit(p_E)), length=None)

    @property
    def farthest(self) -> float:
        """Largest distance of its points from p_E [m]."""
        return self.radius + max(math.hypot(*self.start), math.hypot(*self.end), self.length or 0.0)


class Polytope(NamedTuple):
    """Convex hull of points to stay out of."""

    corners: tuple[Vector, ...]

    @property
    def takes_direction_from_com(self) -> bool:
        """False: a polytope has no direction."""
        return False

    def at(self, p_E: Array) -> Polytope:
        """Return the polytope itself."""
        return self

    @property
    def farthest(self) -> float:
        """Largest distance of its points from p_E [m]."""
        return max(math.hypot(*corner) for corner in self.corners)


class Cone(NamedTuple):
    """Infinite cone to stay inside; a half-space at 90 degrees."""

    half_angle_deg: float
    axis: Vector | None
    """Unit vector from the apex into the cone; None: towards the COM."""
    apex: Vector = NOWHERE

    @property
    def takes_direction_from_com(self) -> bool:
        """True if its axis points to the COM."""
        return self.axis is None

    def at(self, p_E: Array) -> Cone:
        """Return the cone with a fixed axis, given the end-effector from the COM p_E, (3,)."""
        return self if self.axis is not None else self._replace(axis=_vector(-_unit(p_E)))


Shape = Capsule | Polytope | Cone


def unit(direction: Vector) -> Vector:
    """Return the unit vector of a direction."""
    return _vector(np.array(direction) / math.hypot(*direction))


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length else np.array([0.0, 0.0, 1.0])


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
