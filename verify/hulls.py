r"""Convex target regions: the hull of points, and how near a cone-sphere is to it, in closed form.

| symbol | meaning | shape |
|---|---|---|
| Q | the hull of points | |
| n_f, b_f | outward unit normal and offset of a face, n_f . x <= b_f in Q | (3,), scalar |
| P(eta), r(eta) | balls of a cone-sphere K, eta in [0, 1] | (3,), scalar |
| d | min over eta of dist(P(eta), Q) - r(eta) | scalar |

dist(., Q) is nothing inside Q. Outside, the nearest point of Q lies on an edge or inside a face. The nearest ball
to an edge is that of two cone-spheres, one without radius. Over the inside of a face the distance is linear in eta,
so that its least value is at an end of the axis or on an edge after all. Where the axis enters Q, the largest
radius in there counts too; but a ball that has left Q may be deeper in it still, if it grows faster than its centre
moves away, as beside a wall at a small angle to the axis.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from verify.bodies import Array, ConeSphere, clearances
from verify.gjk import least_weights
from verify.meshes import LARGEST_COORDINATE, ConvexMesh, Indices, Shape


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polytope with its faces."""

    mesh: ConvexMesh
    normals: Array
    """n_f of the triangles, shape (f, 3)."""
    offsets: Array
    """b_f, shape (f,)."""

    @functools.cached_property
    def edges(self) -> Indices:
        """Both ends of every edge, shape (e, 2)."""
        sides = np.concatenate([self.mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        return np.unique(np.sort(sides, axis=1), axis=0)

    @property
    def size(self) -> float:
        """No two of its points are farther apart."""
        return float(np.linalg.norm(np.ptp(self.mesh.vertices, axis=0)))

    @property
    def centre(self) -> Array:
        """A point well inside, shape (3,)."""
        return np.asarray(self.mesh.vertices.mean(axis=0))

    def depth(self, x: Array) -> float:
        """Return the distance of x, shape (3,), from the nearest face's plane; negative outside."""
        return float((self.offsets - self.normals @ x).min())

    def nearest_of_surface(self, x: Array) -> Array:
        """Return the surface's point nearest to x, shape (3,), by weights of corners: it is in the region."""
        corners = self.mesh.vertices[self.mesh.triangles[:, [0, 1, 2, 2]]]
        weights, _ = least_weights(corners - x)
        points = np.einsum("fk,fkx->fx", weights, corners)
        return np.asarray(points[np.argmin(np.linalg.norm(points - x, axis=1))])

    @property
    def in_range(self) -> bool:
        """True if coordinates keep the digits that a proof needs."""
        return bool(np.all(np.abs(self.mesh.vertices) < LARGEST_COORDINATE / 16))

    def proof_mesh(self, x: Array, n: Array, level: int, *, inside: bool) -> tuple[ConvexMesh, Shape]:
        """Return the region itself with its origin at x, whatever mesh of it is asked for."""
        mesh = ConvexMesh(self.mesh.vertices - x, self.mesh.triangles)
        return mesh, Shape(mesh)

    def move(self, shift: Array) -> Hull:
        """Return the same region elsewhere."""
        mesh = ConvexMesh(self.mesh.vertices + shift, self.mesh.triangles)
        return Hull(mesh, self.normals, self.offsets + self.normals @ shift)


def hull(points: Array) -> Hull:
    """Return the hull of points, shape (k, 3).

    Raises:
        ValueError: it fails its own check: no point may lie beyond a face, and every edge must have a face on
            either side; then the half-spaces of the faces have nothing in common but the hull.
    """
    from scipy.spatial import ConvexHull  # slow to load, and few tasks need it

    convex_hull = ConvexHull(points)
    triangles = np.array(convex_hull.simplices, dtype=np.intp)
    normals = convex_hull.equations[:, :3] / np.linalg.norm(convex_hull.equations[:, :3], axis=1, keepdims=True)
    first, second, third = points[triangles].transpose(1, 0, 2)
    inwards = np.sum(np.cross(second - first, third - first) * normals, axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    offsets = (points @ normals.T).max(axis=0)
    off_face = np.abs(np.einsum("fkx,fx->fk", points[triangles], normals) - offsets[:, None]).max()
    sides = {(i, j) for face in triangles.tolist() for i, j in zip(face, face[1:] + face[:1], strict=True)}
    closed = len(sides) == triangles.size and all((j, i) in sides for i, j in sides)
    # less than proofs allow for rounding, over the scene's size
    if not closed or off_face > 1e-11 * (1.0 + float(np.abs(points).max())):
        raise ValueError("a target region's corners are too close to one another for a hull with exact faces")
    # FCL walks from vertex to vertex along faces, and would be lost on one that no face has.
    used, compact = np.unique(triangles, return_inverse=True)
    return Hull(ConvexMesh(points[used], compact.reshape(-1, 3)), normals, offsets)


class Approach(NamedTuple):
    """Point of a cone-sphere nearest to a region, or deepest in it."""

    d: float
    eta: float
    x: Array
    """The point of the region nearest to the centre of the ball that comes nearest, shape (3,)."""


def approach(body: ConeSphere, region: Hull) -> Approach:
    """Return the exact signed clearance of a cone-sphere from a region."""
    endpoints = np.array([body.o, body.o + body.d])
    corners = region.mesh.vertices
    start, end = corners[region.edges[:, 0]], corners[region.edges[:, 1]]
    edges = [ConeSphere(a, b - a, 0.0, 0.0) for a, b in zip(start, end, strict=True)]
    d, eta, gamma = clearances([(body, edge) for edge in edges])
    least = int(np.argmin(d))
    best = Approach(float(d[least]), float(eta[least]), edges[least].centre(float(gamma[least])))
    for at, x in enumerate(endpoints):
        heights = region.normals @ x - region.offsets
        face = int(np.argmax(heights))
        foot = x - heights[face] * region.normals[face]
        gap = float(heights[face]) - body.radius(float(at))
        # The foot lies in the face, or the nearest point is on an edge, or x is inside.
        if heights[face] > 0 and gap < best.d and region.depth(foot) > -1e-12 * (1.0 + region.size):
            best = Approach(gap, float(at), foot)
    entered = _largest_eta_inside(endpoints, region)
    if entered is not None and -body.radius(entered) < best.d:
        best = Approach(-body.radius(entered), entered, body.centre(entered))
    return best


def _largest_eta_inside(endpoints: Array, region: Hull) -> float | None:
    """Return the largest eta of the axis inside the region; None if all of it is outside."""
    first, last = region.normals @ endpoints[0] - region.offsets, region.normals @ endpoints[1] - region.offsets
    slope = last - first
    level = slope == 0
    if np.any(level & (first > 0)):
        return None
    crossing = -first / np.where(level, 1.0, slope)
    low = float(np.max(crossing[slope < 0], initial=0.0))
    high = float(np.min(crossing[slope > 0], initial=1.0))
    return high if low <= high else None
