r"""Convex target regions as hulls of points, and the clearance of cone-spheres from them in closed form.

| symbol | meaning | shape |
|---|---|---|
| Q | the hull of points | |
| n_f, b_f | outward unit normal and offset of a face; n_f . x <= b_f in Q | (3,), scalar |
| P(eta), r(eta) | balls of a cone-sphere K, eta in [0, 1] | (3,), scalar |
| d | min over eta of dist(P(eta), Q) - r(eta) | scalar |

dist(., Q) is zero inside Q. Outside, the nearest point of Q lies on an edge or inside a face. An edge is a
cone-sphere of radius zero, so its clearance is that of two cone-spheres. While the nearest point stays inside a
face, the distance is linear in eta, so the minimum is at an end of the axis or on an edge. If the axis enters Q,
the largest radius inside also counts. A ball whose centre has left Q may still be deeper in it, if it grows faster
than its centre moves away, for instance beside a wall at a small angle to the axis.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Indices
from verify.bodies import ConeSphere, clearances
from verify.gjk import least_weights
from verify.meshes import LARGEST_COORDINATE, ConvexMesh, FclPolytope


@dataclass(frozen=True, eq=False)
class HullBody:
    """A convex polytope with its faces."""

    mesh: ConvexMesh
    normals: Array
    """n_f of the triangles, shape (f, 3)."""
    offsets: Array
    """b_f, shape (f,)."""

    @functools.cached_property
    def edges(self) -> Indices:
        """Vertex indices of the ends of every edge, shape (e, 2)."""
        sides = np.concatenate([self.mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        return np.unique(np.sort(sides, axis=1), axis=0)

    @property
    def size(self) -> float:
        """Upper bound on the diameter."""
        return float(np.linalg.norm(np.ptp(self.mesh.vertices, axis=0)))

    @property
    def centre(self) -> Array:
        """An interior point, the mean of the vertices, shape (3,)."""
        return np.asarray(self.mesh.vertices.mean(axis=0))

    def depth(self, x: Array) -> float:
        """Return the distance of x, shape (3,), to the nearest face's plane; negative outside."""
        return float((self.offsets - self.normals @ x).min())

    def nearest_of_surface(self, x: Array) -> Array:
        """Return the surface point nearest to x, shape (3,); a convex combination of vertices, so in the region."""
        corners = self.mesh.vertices[self.mesh.triangles[:, [0, 1, 2, 2]]]
        weights, _ = least_weights(corners - x)
        points = np.einsum("fk,fkx->fx", weights, corners)
        return np.asarray(points[np.argmin(np.linalg.norm(points - x, axis=1))])

    @property
    def in_range(self) -> bool:
        """True if coordinates are precise enough for a proof."""
        return bool(np.all(np.abs(self.mesh.vertices) < LARGEST_COORDINATE / 16))

    def proof_mesh(self, x: Array, n: Array, level: int, *, inside: bool) -> tuple[ConvexMesh, FclPolytope]:
        """Return the region itself with its origin at x, at every level; the mesh is exact."""
        mesh = ConvexMesh(self.mesh.vertices - x, self.mesh.triangles)
        return mesh, FclPolytope(mesh)

    def move(self, shift: Array) -> HullBody:
        """Return a copy translated by `shift`, shape (3,)."""
        mesh = ConvexMesh(self.mesh.vertices + shift, self.mesh.triangles)
        return HullBody(mesh, self.normals, self.offsets + self.normals @ shift)


def hull(points: Array) -> HullBody:
    """Return the hull of points, shape (k, 3).

    Raises:
        ValueError: the hull fails its own check. No point may lie beyond a face, and every edge must have a face on
            either side, so that the half-spaces of the faces intersect in exactly the hull.
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
    # this tolerance is below what proofs allow for rounding, relative to the scene's size
    if not closed or off_face > 1e-11 * (1.0 + float(np.abs(points).max())):
        raise ValueError("a target region's corners are too close to one another for a hull with exact faces")
    # FCL walks from vertex to vertex along faces and gets stuck on a vertex without any.
    used_vertices, renumbered = np.unique(triangles, return_inverse=True)
    return HullBody(ConvexMesh(points[used_vertices], renumbered.reshape(-1, 3)), normals, offsets)


class Approach(NamedTuple):
    """Ball of a cone-sphere nearest to a region, or deepest in it."""

    d: float
    eta: float
    x: Array
    """Point of the region nearest to the ball's centre, shape (3,)."""


def approach(body: ConeSphere, region: HullBody) -> Approach:
    """Return the exact signed clearance of a cone-sphere from a region."""
    endpoints = np.array([body.o, body.o + body.d])
    corners = region.mesh.vertices
    start, end = corners[region.edges[:, 0]], corners[region.edges[:, 1]]
    edges = [ConeSphere(a, b - a, 0.0, 0.0) for a, b in zip(start, end, strict=True)]
    d, eta, gamma = clearances([(body, edge) for edge in edges])
    nearest = int(np.argmin(d))
    best = Approach(float(d[nearest]), float(eta[nearest]), edges[nearest].centre(float(gamma[nearest])))
    for k, x in enumerate(endpoints):
        heights = region.normals @ x - region.offsets
        face = int(np.argmax(heights))
        foot = x - heights[face] * region.normals[face]
        gap = float(heights[face]) - body.radius(float(k))
        # Unless the foot lies in the face, the nearest point is on an edge or x is inside.
        if heights[face] > 0 and gap < best.d and region.depth(foot) > -1e-12 * (1.0 + region.size):
            best = Approach(gap, float(k), foot)
    inside = _largest_eta_inside(endpoints, region)
    if inside is not None and -body.radius(inside) < best.d:
        best = Approach(-body.radius(inside), inside, body.centre(inside))
    return best


def _largest_eta_inside(endpoints: Array, region: HullBody) -> float | None:
    """Return the largest eta at which the axis is inside the region; None if the whole axis is outside."""
    first, last = region.normals @ endpoints[0] - region.offsets, region.normals @ endpoints[1] - region.offsets
    slope = last - first
    parallel = slope == 0
    if np.any(parallel & (first > 0)):
        return None
    crossing = -first / np.where(parallel, 1.0, slope)
    low = float(np.max(crossing[slope < 0], initial=0.0))
    high = float(np.min(crossing[slope > 0], initial=1.0))
    return high if low <= high else None
