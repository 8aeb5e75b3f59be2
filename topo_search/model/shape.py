"""Shapes of exposure requirements, which airflow keeps out of or stays inside, and convex hulls of points.

Points are in metres from the end-effector p_E, in the axes of the task frame. Solver, symmetries and pictures look
at these shapes alone; the audit does not: it reads the requirements themselves.
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
"""Offset of the planes of an outer hull, over its size: more than rounding moves a corner."""


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
        return np.asarray(np.einsum("fx,fx->f", self.normals, self.corners[self.triangles[:, 0]]))

    @property
    def planes(self) -> Array:
        """Normal and offset of every face, once however many triangles it is cut into, shape (p, 4)."""
        _, first = np.unique(self.normals.round(9) + 0.0, axis=0, return_index=True)
        return np.asarray(np.column_stack([self.normals, self.offsets])[np.sort(first)])


def convex_hull(points: Array) -> Hull:
    """Return the hull of points that span a volume, shape (m, 3).

    Raises:
        ValueError: the points are too nearly flat to tell the hull.
    """
    qhull = _qhull(points)
    kept, triangles = np.unique(qhull.simplices, return_inverse=True)
    triangles, corners = triangles.reshape(-1, 3), points[kept]
    normals = qhull.equations[:, :3] / np.linalg.norm(qhull.equations[:, :3], axis=1, keepdims=True)
    first, second, third = corners[triangles].transpose(1, 0, 2)
    inwards = np.sum(np.cross(second - first, third - first) * normals, axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    f, across = np.nonzero(qhull.neighbors > np.arange(len(triangles))[:, None])  # all pairs of adjacent faces
    # faces whose normals hardly differ are one face, so that the line between them is no edge
    folded = np.linalg.norm(normals[f] - normals[qhull.neighbors[f, across]], axis=1) > 1e-9
    sides = zip(qhull.simplices[f], qhull.simplices[qhull.neighbors[f, across]], strict=True)
    shared = [np.intersect1d(one, other) for one, other in sides]
    edges = np.searchsorted(kept, np.array(shared)[folded])
    return Hull(corners, triangles, normals, edges)


def outer_hull(points: Array, most_corners: int) -> tuple[Array, float]:
    """Return the corners of a convex polytope that contains points, and its excess over their hull.

    It is the hull itself if that has few enough corners. Otherwise planes that touch the hull cut a box around it,
    each time at the corner that is farthest from the hull, and all are moved outwards by more than rounding.

    Args:
        points: shape (m, 3), which span a volume.
        most_corners: at least eight, those of the box.

    Returns:
        Corners, shape (k, 3), and how far the farthest one is from the hull.

    Raises:
        ValueError: the points are too nearly flat to tell the hull, or too far from the origin for their size.
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
    """Return the point of a hull that is nearest to x outside it, shape (3,), by its corners, shape (k, 3).

    Corners are taken in one by one, the farthest ahead; least distances by Lawson and Hanson, Ch. 23.
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
    """True if the hull of points, shape (m, 3), is neither flat nor thinner than a millionth of its length."""
    if len(points) < 4:
        return False
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[2] > 1e-6 * extents[0])


NOWHERE: Vector = (0.0, 0.0, 0.0)


class Capsule(NamedTuple):
    """Balls along a segment, to be kept out of; a ball where the segment has no length."""

    radius: float
    start: Vector = NOWHERE
    end: Vector = NOWHERE
    length: float | None = None
    """In place of the end: the segment leads so far along p_E, away from the COM."""

    @property
    def takes_direction_from_com(self) -> bool:
        """True if its direction is that of p_E from the COM."""
        return self.length is not None

    def at(self, p_E: Array) -> Capsule:
        """Return it with its end, where p_E is the end-effector from the COM, (3,)."""
        if self.length is None:
            return self
        return self._replace(end=_vector(self.length * _unit(p_E)), length=None)

    @property
    def farthest(self) -> float:
        """Distance of its farthest point from p_E [m]."""
        along = self.length or 0.0
        return self.radius + max(math.hypot(*self.start), math.hypot(*self.end), along)


class Polytope(NamedTuple):
    """The convex hull of points, to be kept out of."""

    corners: tuple[Vector, ...]

    @property
    def takes_direction_from_com(self) -> bool:
        """It has none."""
        return False

    def at(self, p_E: Array) -> Polytope:
        """Return it as it is."""
        return self

    @property
    def farthest(self) -> float:
        """Distance of its farthest point from p_E [m]."""
        return max(math.hypot(*corner) for corner in self.corners)


class Cone(NamedTuple):
    """An infinite cone, to be stayed inside; a half-space at 90 degrees."""

    half_angle_deg: float
    axis: Vector | None
    """Unit vector from the apex into the cone; None: to the COM."""
    apex: Vector = NOWHERE

    @property
    def takes_direction_from_com(self) -> bool:
        """True if its axis points to the COM."""
        return self.axis is None

    def at(self, p_E: Array) -> Cone:
        """Return it with its axis, where p_E is the end-effector from the COM, (3,)."""
        return self if self.axis is not None else self._replace(axis=_vector(-_unit(p_E)))


Shape = Capsule | Polytope | Cone


def unit(direction: Vector) -> Vector:
    """Return a direction as a unit vector."""
    return _vector(np.array(direction) / math.hypot(*direction))


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length else np.array([0.0, 0.0, 1.0])


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
