"""Polytopes that are proven to lie inside or outside a cone-sphere, and whether two of them overlap.

| symbol | meaning | shape |
|---|---|---|
| V, F | vertices (on the unit sphere) and triangles of an icosphere | (v,3), (f,3) |
| c | its inradius: conv(V) holds the ball of radius c | scalar |
| K | the cone-sphere with end balls (p_0, r_0), (p_1, r_1) | |
| inner, outer | conv of p_k + r_k V, conv of p_k + (r_k / c) V: inner in K, K in outer | |
| n | a direction to turn the mesh towards: the inner one has a vertex there, the outer one a tangent face | (3,) |

The two ends of a mesh are copies of one polytope in two sizes, so their hull needs no hull algorithm: every face
belongs to the end that reaches farther along its normal, and a trapezoid bridges each edge between a face of one
end and a face of the other. Untouched, inner and outer lie within r_max (1/c - 1) of K. Turned towards n, both have
exactly K's support along n: the local refinement where two bodies nearly touch, without a finer mesh.

Overlap is the one question that python-fcl answers reliably. Facts about its version 0.7 that shape `Shape`:

- `collide` of two `Convex` with the default solver is right where `distance`, the `Halfspace`, `Plane` and BVH
  paths are wrong, blind to nesting, or crash the process; nothing else is called here.
- Tolerances are absolute: coordinates are scaled so that an arm is 1e3 long, and must be near the origin.
- Faces must be packed as [3, i, j, k, ...]; NaN and infinite coordinates give nonsense without an error.
- Requests and results accumulate: both are new for every query.
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
from numpy.typing import NDArray

from verify.bodies import Array, ConeSphere, basis_across

Indices = NDArray[np.intp]

MESH_ROUNDING = 1e-12
"""Outer meshes are larger and inner ones smaller by this part of the body, to be safe from rounding."""


@dataclass(frozen=True, eq=False)
class ConvexMesh:
    """A closed convex surface of triangles that turn counter-clockwise seen from outside."""

    vertices: Array
    """Shape (v, 3)."""
    triangles: Indices
    """Shape (f, 3)."""


@dataclass(frozen=True, eq=False)
class Icosphere:
    """An icosahedron whose triangles were split in four, `level` times, and put on the unit sphere."""

    vertices: Array
    triangles: Indices
    normals: Array
    """Outward unit normals of the triangles, shape (f, 3)."""
    offsets: Array
    """Distance of the triangles' planes from the centre, shape (f,)."""
    edges: Indices
    """Start, end, the face where it runs that way, the other face: shape (e, 4)."""

    @property
    def inradius(self) -> float:
        """c: the distance of the nearest face."""
        return float(self.offsets.min())


@functools.cache
def icosphere(level: int) -> Icosphere:
    """Return the icosphere of a level, 20 * 4^level faces."""
    vertices, triangles = _icosahedron()
    for _ in range(level):
        vertices, triangles = _split_triangles(vertices, triangles)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    face_of = {(row[k], row[k - 2]): f for f, row in enumerate(triangles.tolist()) for k in range(3)}
    edges = np.array([(i, j, f, face_of[j, i]) for (i, j), f in face_of.items() if i < j], dtype=np.intp)
    # The least over the three corners, so that rounding never makes a face look farther out than it is.
    offsets = np.einsum("fkx,fx->fk", corners, normals).min(axis=1)
    return Icosphere(vertices, triangles, normals, offsets, edges)


def _icosahedron() -> tuple[Array, Indices]:
    phi = (1 + math.sqrt(5)) / 2
    vertices = np.array([np.roll((0, i, j * phi), k) for k in range(3) for i in (-1, 1) for j in (-1, 1)])
    # its edges are 2 long, all other vertices farther apart
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
    """Return a polytope inside the body, with a vertex in direction `n` if one is given."""
    sphere = icosphere(level)
    turn = np.eye(3) if n is None else _turn(sphere.vertices[0], n)
    slack = MESH_ROUNDING * body.extent
    return _hull(body, sphere, turn, 1.0, -min(slack, 0.5 * body.r))


def outer_mesh(body: ConeSphere, level: int, n: Array | None = None) -> ConvexMesh:
    """Return a polytope around the body, with a face that touches it in direction `n` if one is given."""
    sphere = icosphere(level)
    turn = np.eye(3) if n is None else _turn(sphere.normals[np.argmin(sphere.offsets)], n)
    return _hull(body, sphere, turn, 1.0 / sphere.inradius, MESH_ROUNDING * body.extent)


def box_below(x: Array, m: Array, size: float) -> ConvexMesh:
    """Return a box that fills the half-space m.y <= m.x around the point x: `size` deep and twice as wide."""
    e_1, e_2 = basis_across(m)
    signs, triangles = box_corners()
    signs[:, 0] = np.minimum(signs[:, 0], 0)
    return ConvexMesh(x + size * signs @ np.stack([m, e_1, e_2]), triangles)


def box_corners() -> tuple[Indices, Indices]:
    """Return the signs of a box' corners along its edges, shape (8, 3), and its surface, shape (12, 3).

    Corner 4 i + 2 j + k has the signs i, j, k, from -1 to 1, along three edges that are right-handed.
    """
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
    return np.array(list(product((-1, 1), repeat=3))), np.array(triangles, dtype=np.intp)


def _hull(body: ConeSphere, sphere: Icosphere, turn: Array, scale: float, slack: float) -> ConvexMesh:
    """Return the hull of the turned icosphere at both ends, with radii scale (r + slack)."""
    unit = sphere.vertices @ turn.T
    first = body.o + scale * (body.r + slack) * unit
    last = body.o + body.d + scale * (body.r + body.dr + slack) * unit
    beyond = sphere.normals @ (turn.T @ body.d) + scale * body.dr * sphere.offsets > 0
    if beyond.all():
        return ConvexMesh(last, sphere.triangles)
    if not beyond.any():
        return ConvexMesh(first, sphere.triangles)
    v = len(unit)
    start, end, left, _ = sphere.edges[beyond[sphere.edges[:, 2]] != beyond[sphere.edges[:, 3]]].T
    # Let every bridged edge run as in the face that belongs to the first end.
    start, end = np.where(beyond[left], end, start), np.where(beyond[left], start, end)
    triangles = np.concatenate(
        [
            sphere.triangles[~beyond],
            sphere.triangles[beyond] + v,
            np.stack([end, start, start + v], axis=1),
            np.stack([end, start + v, end + v], axis=1),
        ]
    )
    # FCL walks from vertex to vertex along faces, and would be lost on one that no face has.
    used, compact = np.unique(triangles, return_inverse=True)
    return ConvexMesh(np.concatenate([first, last])[used], compact.reshape(-1, 3))


def _turn(a: Array, b: Array) -> Array:
    """Return a rotation that takes the unit vector a to the unit vector b."""
    if a @ b < 0:  # a half turn first keeps the formula away from its singularity at b = -a
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        across /= np.linalg.norm(across)
        half_turn = 2 * np.outer(across, across) - np.eye(3)
        return _turn(half_turn @ a, b) @ half_turn
    x, y, z = np.cross(a, b)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + a @ b))


def encloses(mesh: ConvexMesh, body: ConeSphere) -> bool:
    """True if every face of an outer mesh lies beyond the body: the mesh's check of itself.

    A bridge between two nearly equal ends is a sliver whose normal has few digits left; each face is allowed
    what rounding of its corners can do to its plane.
    """
    corners = mesh.vertices[mesh.triangles] - body.o
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(first, second)
    beyond = np.einsum("fx,fx->f", normals, corners[:, 0]) - body.move(-body.o).support(normals)
    edge = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1))
    magnitude = float(np.abs(mesh.vertices).max()) + body.extent
    allowed = 16 * np.finfo(float).eps * magnitude * edge * (edge + body.extent)
    return bool(np.all(beyond >= -allowed))


def lies_within(mesh: ConvexMesh, body: ConeSphere) -> bool:
    """True if every vertex of an inner mesh lies in the body: the mesh's check of itself."""
    return bool(np.all(body.depth(mesh.vertices) >= 0))


SCALE = 1e3
"""FCL's length of one arm."""
LARGEST_COORDINATE = 1e6
"""Coordinates beyond this many arms have lost the digits that FCL's tolerances need."""


class Shape:
    """A convex polytope, in arm lengths, as FCL holds it."""

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

    def place(self, R: Array, p: Array) -> Shape:
        """Return the polytope turned by R, shape (3, 3), then moved by p, shape (3,); FCL makes it only once."""
        elsewhere = copy.copy(self)
        elsewhere._place(R @ self._R, R @ self._p + p)
        return elsewhere

    def overlaps(self, other: Shape) -> bool:
        """True if the two solids have a point in common, as far as FCL can tell."""
        return bool(fcl.collide(self._object, other._object, fcl.CollisionRequest(), fcl.CollisionResult()))
