"""Shapes of exposure requirements, which airflow must stay out of or inside, and convex hulls of points.

Points are in metres from the end-effector p_E, in the axes of the task frame W. Symmetries, pictures, pages and
exports ask a shape for its geometry; the solver states it as formulas, and the audit reads the requirements.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from topo_search.model.arrays import Array, Indices
from topo_search.model.kinds import Vector
from topo_search.model.mesh import SIDES, Mesh, circle, cone_sphere, cone_sphere_outline, rotation_to

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


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
    qhull = quickhull(points)
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


def quickhull(points: Array) -> ConvexHull:
    """Return the convex hull of points, shape (m, 3), by Qhull; ValueError if they are flat."""
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


class Shape(ABC):
    """Convex region, by default a bounded one of fixed direction that airflow must stay out of.

    An unbounded shape is cut off at an `extent` [m].
    """

    corners: tuple[Vector, ...]
    """Points whose hull it is; none for a round shape."""
    contains_airflow = False
    """True if airflow must stay inside."""

    @property
    def words(self) -> str:
        """The region in words, for legends."""
        return "keep-out region for airflow"

    @property
    def takes_direction_from_com(self) -> bool:
        """True if its direction is that of p_E."""
        return False

    def at(self, p_E: Array) -> Shape:
        """Return the shape with a fixed direction, given the end-effector from the COM p_E, (3,)."""
        return self

    @property
    @abstractmethod
    def distance(self) -> float:
        """Distance of some point of it from p_E, not necessarily of the nearest [m]."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest distance of its points, or of its apex, from p_E [m]."""

    @property
    @abstractmethod
    def landmarks(self) -> Sequence[tuple[str, tuple[float, ...], Sequence[Vector]]]:
        """Kind, numbers and vectors that isometries map onto those of an equal shape; none if all isometries do.

        Vectors of the kind "region" have no order; for others, an item is a possible order.
        """

    @abstractmethod
    def mesh(self, extent: float) -> Mesh:
        """Return its surface."""

    def faces(self, v: Array, extent: float) -> Sequence[Array]:
        """Return polygons to fill in a picture seen along v, (3,): an outline, or all triangles, (k, 3) each."""
        return list(self.mesh(extent).triangles)

    def edges(self, extent: float) -> Sequence[Array]:
        """Return lines to draw in a picture, (k, 3) each."""
        return []

    def generators(self, extent: float) -> Sequence[Array]:
        """Return finer lines that show a curved surface, (k, 3) each."""
        return []

    def outline(self, view: tuple[int, int], extent: float) -> Array:
        """Return its outline along two axes of W, right and up, (k, 2)."""
        from scipy.spatial import ConvexHull

        points = self.mesh(extent).vertices[:, view]
        return np.asarray(points[ConvexHull(points).vertices])

    @property
    def primitive(self) -> tuple[str, dict[str, tuple[float, ...]]] | None:
        """Type and sizes of an equal geom of MuJoCo; None: its mesh is one."""
        return None

    def half_spaces(self, sides: int = SIDES) -> list[tuple[Array, Array]]:
        """Return a point and the inward normal, (3,), of half-spaces around an unbounded shape.

        A half-space is the only one of its own; around a cone, `sides` of them touch it. A bounded shape has none.
        """
        return []


@dataclass(frozen=True)
class Capsule(Shape):
    """Capsule to stay out of: balls along a segment, or a single ball."""

    radius: float
    start: Vector = NOWHERE
    end: Vector = NOWHERE
    length: float | None = None
    """Length of a segment along p_E, away from the COM, instead of its end [m]."""
    corners = ()

    @property
    def takes_direction_from_com(self) -> bool:
        """True if the segment is along p_E."""
        return self.length is not None

    def at(self, p_E: Array) -> Capsule:
        """Return the capsule with a fixed end, given the end-effector from the COM p_E, (3,)."""
        return self if self.length is None else replace(self, end=_vector(self.length * _unit(p_E)), length=None)

    @property
    def distance(self) -> float:
        """See `Shape.distance`: of the start."""
        return math.hypot(*self.start)

    @property
    def reach(self) -> float:
        """See `Shape.reach`."""
        return self.radius + max(math.hypot(*self.start), math.hypot(*self.end), self.length or 0.0)

    @property
    def landmarks(self) -> Sequence[tuple[str, tuple[float, ...], Sequence[Vector]]]:
        """See `Shape.landmarks`: both ends, in either order, or from p_E."""
        if self.takes_direction_from_com or self.start == self.end:
            return []
        orders = ((self.start, self.end), (self.end, self.start))
        from_tip = [order for order in orders if order[0] == NOWHERE]
        return [("segment", (self.radius,), order) for order in from_tip or orders]

    def mesh(self, extent: float) -> Mesh:
        """See `Shape.mesh`."""
        return cone_sphere(np.array(self.start), self.radius, np.array(self.end), self.radius)

    def faces(self, v: Array, extent: float) -> Sequence[Array]:
        """Return the outline."""
        return [cone_sphere_outline(np.array(self.start), self.radius, np.array(self.end), self.radius, v)]

    def edges(self, extent: float) -> Sequence[Array]:
        """Return the equator of the far ball."""
        return [circle(np.array(self.end), self.radius, np.array([0.0, 0.0, 1.0]))]

    def outline(self, view: tuple[int, int], extent: float) -> Array:
        """See `Shape.outline`."""
        return self.faces(np.eye(3)[3 - sum(view)], extent)[0][:, view]

    @property
    def primitive(self) -> tuple[str, dict[str, tuple[float, ...]]]:
        """See `Shape.primitive`."""
        if self.start == self.end:
            return "sphere", {"pos": self.start, "size": (self.radius,)}
        return "capsule", {"fromto": (*self.start, *self.end), "size": (self.radius,)}


@dataclass(frozen=True)
class Polytope(Shape):
    """Convex hull of points to stay out of."""

    corners: tuple[Vector, ...]

    @property
    def distance(self) -> float:
        """See `Shape.distance`: of the nearest corner."""
        return min(math.hypot(*corner) for corner in self.corners)

    @property
    def reach(self) -> float:
        """See `Shape.reach`."""
        return max(math.hypot(*corner) for corner in self.corners)

    @property
    def landmarks(self) -> Sequence[tuple[str, tuple[float, ...], Sequence[Vector]]]:
        """See `Shape.landmarks`."""
        return [("region", (), self.corners)]

    def mesh(self, extent: float) -> Mesh:
        """See `Shape.mesh`."""
        hull = convex_hull(np.array(self.corners))
        return Mesh(hull.corners, hull.triangles)

    def edges(self, extent: float) -> Sequence[Array]:
        """See `Shape.edges`."""
        hull = convex_hull(np.array(self.corners))
        return list(hull.corners[hull.edges])


@dataclass(frozen=True)
class Cone(Shape):
    """Infinite cone to stay inside; a half-space at 90 degrees.

    | symbol | meaning | unit |
    |---|---|---|
    | d, theta | axis, half-angle | -, rad |
    | phi | half-angle seen along a unit vector v: sin(phi) = sin(theta) / sin(angle between d and v) | rad |
    """

    half_angle_deg: float
    axis: Vector | None
    """Unit vector from the apex into the cone; None: towards the COM."""
    apex: Vector = NOWHERE
    content: str = "airflow"
    """Things that must stay inside, in words."""
    corners = ()
    contains_airflow = True

    @property
    def words(self) -> str:
        """See `Shape.words`."""
        return f"{'cone' if self.half_angle_deg < 90 else 'half-space'} that must contain all {self.content}"

    @property
    def takes_direction_from_com(self) -> bool:
        """True if its axis points to the COM."""
        return self.axis is None

    def at(self, p_E: Array) -> Cone:
        """Return the cone with a fixed axis, given the end-effector from the COM p_E, (3,)."""
        return self if self.axis is not None else replace(self, axis=_vector(-_unit(p_E)))

    @property
    def distance(self) -> float:
        """See `Shape.distance`: of the apex."""
        return math.hypot(*self.apex)

    reach = distance

    @property
    def landmarks(self) -> Sequence[tuple[str, tuple[float, ...], Sequence[Vector]]]:
        """See `Shape.landmarks`."""
        return [] if self.axis is None else [("axis", (self.half_angle_deg,), (self.axis, self.apex))]

    def mesh(self, extent: float) -> Mesh:
        """Return its surface out to a slant height; a disc for a half-space."""
        theta, apex, d = math.radians(self.half_angle_deg), np.array(self.apex), np.array(self.axis)
        rim = circle(apex + extent * math.cos(theta) * d, extent * math.sin(theta), d)[:-1]
        k = np.arange(len(rim)) + 1
        return Mesh(np.vstack([apex, rim]), np.stack([0 * k, k, np.roll(k, -1)], axis=1))

    def edges(self, extent: float) -> Sequence[Array]:
        """Return the rim."""
        return list(self.mesh(extent).triangles[:, 1:])

    def generators(self, extent: float) -> Sequence[Array]:
        """See `Shape.generators`."""
        return list(self.mesh(extent).triangles[::6, :2])

    def outline(self, view: tuple[int, int], extent: float) -> Array:
        """See `Shape.outline`: a disc if one looks into the cone."""
        axes, theta = list(view), math.radians(self.half_angle_deg)
        right, up = np.array(self.axis)[axes]
        ratio = math.sin(theta) / max(math.hypot(right, up), 1e-12)
        phi = math.asin(min(ratio, 1.0)) if ratio < 1 + 1e-9 else math.pi
        middle = math.atan2(up, right)
        angles = np.linspace(middle - phi, middle + phi, SIDES + 1)
        arc = extent * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.asarray(np.array(self.apex)[axes] + (arc if phi == math.pi else np.vstack([np.zeros(2), arc])))

    def half_spaces(self, sides: int = SIDES) -> list[tuple[Array, Array]]:
        """See `Shape.half_spaces`."""
        d, theta = np.array(self.axis), math.radians(self.half_angle_deg)
        if self.half_angle_deg == 90:
            return [(np.array(self.apex), d)]
        angles = 2 * math.pi * np.arange(sides) / sides
        s, t, _ = rotation_to(d).T
        across = np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)
        return [(np.array(self.apex), normal) for normal in math.sin(theta) * d - math.cos(theta) * across]


def unit(direction: Vector) -> Vector:
    """Return the unit vector of a direction."""
    return _vector(np.array(direction) / math.hypot(*direction))


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length else np.array([0.0, 0.0, 1.0])


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
