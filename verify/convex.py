"""Convex solids of rigid parts: boxes and other polyhedra, cylinders, capsules.

| symbol | meaning | shape |
|---|---|---|
| C | conv(V) + a disc of radius R perpendicular to the unit vector a + a ball of radius r | |
| V | vertices of a polyhedron, or the ends of the axis of a cylinder or capsule | (k, 3) |
| a, R | axis and radius of a cylinder; R = 0 for the others | (3,), scalar |
| r | radius of a capsule; 0 for the others | scalar |
| h_C(u) | support function for a unit vector u: max u.V + R |u - (u.a) a| + r | |

One formula covers all solids, so pairs of them are evaluated in batches. Lengths are in l_arm.

A plane cuts a polyhedron:

| symbol | meaning | unit |
|---|---|---|
| n, b | unit normal and offset of the plane; the part with n.x <= b is kept | -, l_arm |
| h | height n.x - b of a vertex | l_arm |
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from topo_search.model import Array, Indices
from verify.bodies import ConeSphere, basis_across, nearest_on_axis, norms
from verify.meshes import MESH_ROUNDING, ConvexMesh, FclPolytope, box_corners, inner_mesh, outer_mesh


class SolidMeshes(NamedTuple):
    """Resolution of the polytopes inside and around solids."""

    sides: int = 16
    """Sides of the prisms inside and around a cylinder; a prism is exact in the direction it is turned towards."""
    sliver: float = 1e-9
    """Area over radius squared below which a triangle has no reliable normal and is skipped."""
    capsule_level: int = 2
    """Icosphere level of the meshes of a capsule."""


MESHES = SolidMeshes()


@dataclass(frozen=True, eq=False)
class Convex(ABC):
    """A named convex solid."""

    name: str
    """Name for messages."""
    vertices: Array
    """V, shape (k, 3)."""
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]), kw_only=True)
    """a, shape (3,)."""
    disc: float = field(default=0.0, kw_only=True)
    """R."""
    ball: float = field(default=0.0, kw_only=True)
    """r."""
    source: tuple[Convex, Array, Array] | None = field(default=None, kw_only=True, repr=False)
    """Original solid of which this is a copy, with its rotation R and translation p; None if it is no copy."""

    @functools.cached_property
    def centre(self) -> Array:
        """An interior point, the mean of the vertices, shape (3,)."""
        return np.asarray(self.vertices.mean(axis=0))

    @functools.cached_property
    def radius(self) -> float:
        """Radius of a bounding ball around the centre."""
        across = np.linalg.norm(self.vertices - self.centre, axis=1).max()
        return float(np.hypot(across, self.disc)) + self.ball

    @property
    def reach(self) -> float:
        """Upper bound on the distance of its points from the origin."""
        along = self.vertices @ self.axis
        across = np.linalg.norm(self.vertices - along[:, None] * self.axis, axis=1)
        return float(np.hypot(across + self.disc, along).max()) + self.ball

    def support(self, u: Array) -> float:
        """Return h_C(u) for a unit vector u."""
        across = float(np.linalg.norm(u - (u @ self.axis) * self.axis))
        return float((self.vertices @ u).max()) + self.disc * across + self.ball

    def supports(self, u: Array) -> Array:
        """Return h_C(u) for unit vectors u, shape (N, 3) to (N,)."""
        across = norms(u - (u @ self.axis)[:, None] * self.axis)
        return np.asarray((u @ self.vertices.T).max(axis=1) + self.disc * across + self.ball)

    @property
    def facet_normals(self) -> Array:
        """Unit normals of its flat faces, of one sign or both, shape (k, 3)."""
        return self.axis[None] if self.disc else np.zeros((0, 3))

    @property
    def edge_directions(self) -> Array:
        """Unit vectors along all its edges, of one sign or both, shape (k, 3)."""
        along = self.vertices[-1] - self.vertices[0]
        return along[None] / np.linalg.norm(along) if along.any() else np.zeros((0, 3))

    @functools.cached_property
    def shape(self) -> FclPolytope:
        """FCL shape of a polytope around the solid, built once for all copies."""
        if self.source is None:
            return FclPolytope(self.outer(self.axis))
        solid, R, p = self.source
        return solid.shape.place(R, p)

    @property
    def thick(self) -> bool:
        """True if the normals of its faces are precise enough for a proof."""
        return True

    @abstractmethod
    def depth(self, x: Array) -> float:
        """Return the radius of a ball around x, shape (3,), that lies in the solid; negative outside."""

    @abstractmethod
    def outer(self, n: Array) -> ConvexMesh:
        """Return a polytope around the solid with the same support along n."""

    @abstractmethod
    def inner(self, x: Array) -> ConvexMesh:
        """Return a polytope inside the solid that contains its point x."""

    def place(self, R: Array, p: Array) -> Self:
        """Return a copy rotated by R, shape (3, 3), then translated by p, shape (3,)."""
        return replace(self, vertices=self.vertices @ R.T + p, axis=R @ self.axis, source=(self, R, p))


@dataclass(frozen=True, eq=False)
class Polyhedron(Convex):
    """Convex hull of its vertices."""

    triangles: Indices
    """Surface triangles, counter-clockwise seen from outside, shape (f, 3)."""

    @functools.cached_property
    def faces(self) -> tuple[Array, Array]:
        """Outward unit normals, shape (f, 3), and plane offsets, shape (f,), of all faces but slivers."""
        corners = self.vertices[self.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1)
        proper = length > MESHES.sliver * self.radius**2
        normals = normals[proper] / length[proper, None]
        return normals, np.einsum("fx,fx->f", normals, corners[proper, 0])

    @property
    def facet_normals(self) -> Array:
        """Unit normals of its faces, shape (k, 3)."""
        return _without_opposites(self.faces[0])

    @property
    def edge_directions(self) -> Array:
        """Unit vectors along all its edges, and across faces of several triangles, shape (k, 3)."""
        sides = np.concatenate([self.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        along = self.vertices[sides[:, 1]] - self.vertices[sides[:, 0]]
        length = norms(along)
        return _without_opposites(along[length > 0] / length[length > 0, None])

    @property
    def thick(self) -> bool:
        """True unless all faces are slivers."""
        return len(self.faces[0]) > 0 if self.source is None else self.source[0].thick

    def depth(self, x: Array) -> float:
        """Return the distance to the nearest face's plane; minus infinity if all faces are slivers."""
        normals, offsets = self.faces
        return float((offsets - normals @ x).min()) if len(offsets) else -math.inf

    def outer(self, n: Array) -> ConvexMesh:
        """Return the polyhedron itself, enlarged by the allowance for rounding."""
        return ConvexMesh(self.centre + (1 + MESH_ROUNDING) * (self.vertices - self.centre), self.triangles)

    def inner(self, x: Array) -> ConvexMesh:
        """Return the polyhedron itself."""
        return ConvexMesh(self.vertices, self.triangles)


@dataclass(frozen=True, eq=False)
class Box(Polyhedron):
    """A box."""

    half: Array
    """Half-edge vectors as rows, right-handed and orthogonal, shape (3, 3)."""

    def place(self, R: Array, p: Array) -> Self:
        """Return a copy rotated by R, then translated by p."""
        return replace(super().place(R, p), half=self.half @ R.T)


def box(name: str, centre: Array, half: Array) -> Box:
    """Return a box with the half-edge vectors `half` as rows, right-handed and orthogonal, shape (3, 3)."""
    signs, triangles = box_corners()
    return Box(name, centre + signs @ half, triangles, half)


@dataclass(frozen=True, eq=False)
class Cylinder(Convex):
    """A cylinder with flat ends; its vertices are the centres of the lower and the upper end."""

    @functools.cached_property
    def half(self) -> float:
        """Half-height."""
        return math.dist(*self.vertices) / 2

    def depth(self, x: Array) -> float:
        """Return the distance to the nearer of the ends and the side; negative outside."""
        q = x - self.centre
        along = float(q @ self.axis)
        return min(self.disc - math.hypot(*(q - along * self.axis)), self.half - abs(along))

    def outer(self, n: Array) -> ConvexMesh:
        """Return a prism around the cylinder, with a flat side towards n."""
        radius = self.disc / math.cos(math.pi / MESHES.sides)
        return self._prism(n, (1 + MESH_ROUNDING) * radius, 0.5, 1 + MESH_ROUNDING)

    def inner(self, x: Array) -> ConvexMesh:
        """Return a prism inside the cylinder, with an edge on the side of x."""
        return self._prism(x - self.centre, (1 - MESH_ROUNDING) * self.disc, 0.0, 1.0)

    def _prism(self, towards: Array, radius: float, phase: float, stretch: float) -> ConvexMesh:
        across = towards - (towards @ self.axis) * self.axis
        length = np.linalg.norm(across)
        e_1 = across / length if length > MESH_ROUNDING else basis_across(self.axis)[0]
        angles = (np.arange(MESHES.sides) + phase) * (2 * math.pi / MESHES.sides)
        ring = np.outer(np.cos(angles), e_1) + np.outer(np.sin(angles), np.cross(self.axis, e_1))
        low, high = self.centre + stretch * (self.vertices - self.centre)
        k = np.arange(MESHES.sides)
        following = (k + 1) % MESHES.sides
        fan = np.stack([np.zeros(MESHES.sides - 2, dtype=np.intp), k[1:-1], k[2:]], axis=1)
        triangles = [
            np.stack([k, following, following + MESHES.sides], axis=1),
            np.stack([k, following + MESHES.sides, k + MESHES.sides], axis=1),
            fan[:, ::-1],
            fan + MESHES.sides,
        ]
        return ConvexMesh(np.concatenate([low + radius * ring, high + radius * ring]), np.concatenate(triangles))


def cylinder(name: str, centre: Array, axis: Array, radius: float, height: float) -> Cylinder:
    """Return a cylinder with a centre and a unit axis."""
    return Cylinder(name, centre + np.outer([-height / 2, height / 2], axis), axis=axis, disc=radius)


@dataclass(frozen=True, eq=False)
class SweptBall(Convex):
    """A ball swept from the first vertex to the second."""

    @property
    def body(self) -> ConeSphere:
        """The capsule as a cone-sphere."""
        return ConeSphere(self.vertices[0], self.vertices[1] - self.vertices[0], self.ball, 0.0)

    def depth(self, x: Array) -> float:
        """Return the depth of x in the ball that contains it most deeply; negative outside."""
        return float(self.body.depth(x))

    def outer(self, n: Array) -> ConvexMesh:
        """Return a polytope around the capsule, with a face towards n."""
        return outer_mesh(self.body, MESHES.capsule_level, n)

    def inner(self, x: Array) -> ConvexMesh:
        """Return a polytope inside the capsule, with vertices in the direction from its axis to x."""
        body = self.body
        offset = x - body.centre(float(nearest_on_axis(body.o - x, body.d, body.dr)))
        distance = np.linalg.norm(offset)
        return inner_mesh(body, MESHES.capsule_level, offset / distance if distance > 0 else self.axis)


def _without_opposites(directions: Array) -> Array:
    pivots = directions[np.arange(len(directions)), np.abs(directions).argmax(axis=1)]
    _, first = np.unique(np.round(directions * np.sign(pivots)[:, None], 12), axis=0, return_index=True)
    return directions[first]


def capsule(name: str, start: Array, end: Array, radius: float) -> SweptBall:
    """Return a capsule around a segment."""
    return SweptBall(name, np.stack([start, end]), ball=radius)


class Clipping(NamedTuple):
    """Tolerances for cutting solids by planes."""

    on_plane: float = 1e-9
    """Largest distance from the plane of a vertex that counts as on it [l_arm]."""
    thinnest: float = 1e-6
    """Thinner slices are ignored [l_arm]; nobody places a plane that precisely."""


CLIPPING = Clipping()


def clip(solid: Polyhedron, n: Array, b: float) -> Polyhedron | None:
    """Return the part of a solid with n.x <= b, under the same name; None if it is empty or a thin slice."""
    h = solid.vertices @ n - b
    if h.min() >= -CLIPPING.thinnest:
        return None
    if h.max() <= CLIPPING.thinnest:
        return solid
    vertices = list(solid.vertices)
    cuts: dict[tuple[int, int], int] = {}

    def cut(i: int, j: int) -> int:
        """Return the index of the point where the edge from i to j meets the plane."""
        key = (min(i, j), max(i, j))
        if key not in cuts:
            low, high = key
            t = h[low] / (h[low] - h[high])
            cuts[key] = len(vertices)
            vertices.append(vertices[low] + t * (vertices[high] - vertices[low]))
        return cuts[key]

    below = (h <= CLIPPING.on_plane)[solid.triangles]
    triangles = solid.triangles[below.all(axis=1)].tolist()
    for corners in solid.triangles[below.any(axis=1) & ~below.all(axis=1)].tolist():
        face = []
        for i, j in zip(corners, [*corners[1:], corners[0]], strict=True):
            if h[i] <= CLIPPING.on_plane:
                face.append(i)
            if min(h[i], h[j]) < -CLIPPING.on_plane and max(h[i], h[j]) > CLIPPING.on_plane:
                face.append(cut(i, j))
        triangles += [(face[0], *face[k : k + 2]) for k in range(1, len(face) - 1)]
    sides = {(t[k], t[(k + 1) % 3]) for t in triangles for k in range(3)}
    rim = sorted((i, j) for i, j in sides if (j, i) not in sides)  # edges of the hole, with a triangle on one side
    vertices.append(np.mean([vertices[i] for i, _ in rim], axis=0))
    triangles += [(j, i, len(vertices) - 1) for i, j in rim]
    used_vertices, renumbered = np.unique(np.array(triangles, dtype=np.intp), return_inverse=True)
    return Polyhedron(solid.name, np.array(vertices)[used_vertices], renumbered.reshape(-1, 3).astype(np.intp))
