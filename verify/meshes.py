"""Polytopes proven to lie inside or around a cone-sphere, and their overlap test.

| symbol | meaning | shape |
|---|---|---|
| V, F | vertices (on the unit sphere) and triangles of an icosphere | (v,3), (f,3) |
| c | inradius of the icosphere: conv(V) contains the ball of radius c | scalar |
| K | the cone-sphere with end balls (p_0, r_0), (p_1, r_1) | |
| inner, outer | conv of p_k + r_k V, conv of p_k + (r_k / c) V: inner in K, K in outer | |
| n | direction to turn the mesh towards: the inner mesh has a vertex there, the outer one a tangent face | (3,) |

The two ends of a mesh are copies of one polytope in two sizes, so their hull needs no hull algorithm: every face
belongs to the end that reaches farther along its normal, and a trapezoid bridges each edge between a face of one
end and a face of the other. In any orientation, inner and outer lie within r_max (1/c - 1) of K. Turned towards n,
both have exactly K's support along n, a local refinement where two bodies nearly touch, without a finer mesh.

The overlap test is the only query that python-fcl answers reliably. Facts about its version 0.7, for `FclPolytope`:

- `collide` of two `Convex` with the default solver is right where `distance` and the `Halfspace`, `Plane` and BVH
  paths are wrong, miss nested bodies, or crash the process; nothing else is called here.
- Tolerances are absolute: coordinates are scaled so that an arm is 1e3 long, and must be near the origin.
- Faces must be packed as [3, i, j, k, ...]; NaN and infinite coordinates give nonsense without an error.
- Requests and results accumulate, so every query needs new ones.
- Objects cannot be pickled and may crash the process: run an audit in a child process.
"""

from __future__ import annotations

import copy
import functools
import math
from dataclasses import dataclass
from itertools import combinations, product

import fcl
import numpy as np

from topo_search.model import Array, Indices
from verify.bodies import ConeSphere, basis_across

MESH_ROUNDING = 1e-12
"""Margin for rounding by which outer meshes are larger and inner meshes smaller, relative to the body's size."""


@dataclass(frozen=True, eq=False)
class ConvexMesh:
    """A closed convex surface of triangles, counter-clockwise seen from outside."""

    vertices: Array
    """Shape (v, 3)."""
    triangles: Indices
    """Shape (f, 3)."""


@dataclass(frozen=True, eq=False)
class Icosphere:
    """An icosahedron on the unit sphere whose triangles are split in four `level` times."""

    vertices: Array
    triangles: Indices
    normals: Array
    """Outward unit normals of the triangles, shape (f, 3)."""
    offsets: Array
    """Distances of the triangles' planes from the centre, shape (f,)."""
    edges: Indices
    """Rows of start, end, the face in which the edge runs that way, and the other face, shape (e, 4)."""

    @property
    def inradius(self) -> float:
        """c, the distance of the nearest face."""
        return float(self.offsets.min())


@functools.cache
def icosphere(level: int) -> Icosphere:
    """Return the icosphere of a level, with 20 * 4^level faces."""
    vertices, triangles = _icosahedron()
    for _ in range(level):
        vertices, triangles = _split_triangles(vertices, triangles)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    face_of = {(row[k], row[k - 2]): f for f, row in enumerate(triangles.tolist()) for k in range(3)}
    edges = np.array([(i, j, f, face_of[j, i]) for (i, j), f in face_of.items() if i < j], dtype=np.intp)
    # The minimum over the three corners, so that rounding never overestimates a face's distance.
    offsets = np.einsum("fkx,fx->fk", corners, normals).min(axis=1)
    return Icosphere(vertices, triangles, normals, offsets, edges)


def _icosahedron() -> tuple[Array, Indices]:
    phi = (1 + math.sqrt(5)) / 2
    vertices = np.array([np.roll((0, i, j * phi), k) for k in range(3) for i in (-1, 1) for j in (-1, 1)])
    # edges have length 2; other pairs of vertices are farther apart
    faces = [
        face if np.linalg.det(vertices[list(face)]) > 0 else face[::-1]
        for face in combinations(range(12), 3)
        if all(np.linalg.norm(vertices[i] - vertices[j]) < 3 for i, j in combinations(face, 2))
    ]
    return vertices / math.hypot(1, phi), np.array(faces, dtype=np.intp)


def _split_triangles(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Return the mesh on the unit sphere with each triangle split in four at the middles of its edges."""
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2)
    edges, middle = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middles = vertices[edges].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    a, b, c = triangles.T
    ab, bc, ca = len(vertices) + middle.reshape(-1, 3).T
    split = np.stack([a, ab, ca, ab, b, bc, bc, c, ca, ab, bc, ca], axis=1).reshape(-1, 3)
    return np.concatenate([vertices, middles]), split


def inner_mesh(body: ConeSphere, level: int, n: Array | None = None) -> ConvexMesh:
    """Return a polytope inside the body, with a vertex in direction `n` if given."""
    sphere = icosphere(level)
    turn = np.eye(3) if n is None else _turn(sphere.vertices[0], n)
    slack = MESH_ROUNDING * body.extent
    return _hull(body, sphere, turn, 1.0, -min(slack, 0.5 * body.r))


def outer_mesh(body: ConeSphere, level: int, n: Array | None = None) -> ConvexMesh:
    """Return a polytope around the body, with a face tangent to it in direction `n` if given."""
    sphere = icosphere(level)
    turn = np.eye(3) if n is None else _turn(sphere.normals[np.argmin(sphere.offsets)], n)
    return _hull(body, sphere, turn, 1.0 / sphere.inradius, MESH_ROUNDING * body.extent)


def box_below(x: Array, m: Array, size: float) -> ConvexMesh:
    """Return a box that fills the half-space m.y <= m.x around the point x, `size` deep and twice as wide."""
    e_1, e_2 = basis_across(m)
    signs, triangles = box_corners()
    signs[:, 0] = np.minimum(signs[:, 0], 0)
    return ConvexMesh(x + size * signs @ np.stack([m, e_1, e_2]), triangles)


def box_corners() -> tuple[Indices, Indices]:
    """Return the signs of a box's corners along its edges, shape (8, 3), and its surface triangles, shape (12, 3).

    Corner 4 i + 2 j + k has the i-th, j-th and k-th of the signs -1 and 1 along three right-handed edges.
    """
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
    return np.array(list(product((-1, 1), repeat=3))), np.array(triangles, dtype=np.intp)


def _hull(body: ConeSphere, sphere: Icosphere, turn: Array, scale: float, slack: float) -> ConvexMesh:
    """Return the hull of the turned icosphere at both ends, with radii scale (r + slack)."""
    unit = sphere.vertices @ turn.T
    first = body.o + scale * (body.r + slack) * unit
    last = body.o + body.d + scale * (body.r + body.dr + slack) * unit
    at_last = sphere.normals @ (turn.T @ body.d) + scale * body.dr * sphere.offsets > 0
    if at_last.all():
        return ConvexMesh(last, sphere.triangles)
    if not at_last.any():
        return ConvexMesh(first, sphere.triangles)
    v = len(unit)
    start, end, face, _ = sphere.edges[at_last[sphere.edges[:, 2]] != at_last[sphere.edges[:, 3]]].T
    # Orient every bridged edge as in its face at the first end.
    start, end = np.where(at_last[face], end, start), np.where(at_last[face], start, end)
    faces = [
        sphere.triangles[~at_last],
        sphere.triangles[at_last] + v,
        np.stack([end, start, start + v], axis=1),
        np.stack([end, start + v, end + v], axis=1),
    ]
    triangles = np.concatenate(faces)
    # FCL walks from vertex to vertex along faces and gets stuck on a vertex without any.
    used_vertices, renumbered = np.unique(triangles, return_inverse=True)
    return ConvexMesh(np.concatenate([first, last])[used_vertices], renumbered.reshape(-1, 3))


def _turn(a: Array, b: Array) -> Array:
    """Return a rotation that takes the unit vector a to the unit vector b."""
    if a @ b < 0:  # a half turn first avoids the singularity at b = -a
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        across /= np.linalg.norm(across)
        half_turn = 2 * np.outer(across, across) - np.eye(3)
        return _turn(half_turn @ a, b) @ half_turn
    x, y, z = np.cross(a, b)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + a @ b))


def encloses(mesh: ConvexMesh, body: ConeSphere) -> bool:
    """True if every face of an outer mesh lies outside the body: the mesh's own check.

    A bridge between two nearly equal ends is a sliver with an imprecise normal, so each face is allowed the error
    that rounding of its corners can cause in its plane.
    """
    corners = mesh.vertices[mesh.triangles] - body.o
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(first, second)
    gaps = np.einsum("fx,fx->f", normals, corners[:, 0]) - body.move(-body.o).support(normals)
    edge = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1))
    magnitude = float(np.abs(mesh.vertices).max()) + body.extent
    allowed = 16 * np.finfo(float).eps * magnitude * edge * (edge + body.extent)
    return bool(np.all(gaps >= -allowed))


def lies_within(mesh: ConvexMesh, body: ConeSphere) -> bool:
    """True if every vertex of an inner mesh lies in the body: the mesh's own check."""
    return bool(np.all(body.depth(mesh.vertices) >= 0))


SCALE = 1e3
"""Length of one arm in FCL's coordinates."""
LARGEST_COORDINATE = 1e6
"""Larger coordinates [l_arm] are too imprecise for FCL's tolerances."""


class FclPolytope:
    """The FCL object of a convex polytope, in arm lengths."""

    def __init__(self, mesh: ConvexMesh) -> None:
        if not np.all(np.abs(mesh.vertices) <= LARGEST_COORDINATE):
            raise ValueError(f"coordinates must be finite and within {LARGEST_COORDINATE:g} arm lengths")
        faces = np.concatenate([np.full((len(mesh.triangles), 1), 3, dtype=np.int64), mesh.triangles], axis=1)
        self._convex = fcl.Convex(SCALE * mesh.vertices, len(faces), faces.ravel())
        self._place(np.eye(3), np.zeros(3))

    def _place(self, R: Array, p: Array) -> None:
        if not np.all(np.abs(p) <= LARGEST_COORDINATE):
            raise ValueError(f"coordinates must be finite and within {LARGEST_COORDINATE:g} arm lengths")
        self._R, self._p = R, p
        self._object = fcl.CollisionObject(self._convex, fcl.Transform(R, SCALE * p))

    def place(self, R: Array, p: Array) -> FclPolytope:
        """Return a copy rotated by R, shape (3, 3), then translated by p, shape (3,), that shares the FCL mesh."""
        shape = copy.copy(self)
        shape._place(R @ self._R, R @ self._p + p)
        return shape

    def overlaps(self, other: FclPolytope) -> bool:
        """True if FCL finds a common point of the two solids."""
        return bool(fcl.collide(self._object, other._object, fcl.CollisionRequest(), fcl.CollisionResult()))
