r"""Nearest points of batches of convex solids, by the algorithm of Gilbert, Johnson and Keerthi.

| symbol | meaning | shape |
|---|---|---|
| A, B | cores, solids without their balls: conv(V) + a disc of radius R perpendicular to a | |
| C | Minkowski difference A - B | |
| Y | the simplex, up to four support points of C | (N, 4, 3) |
| v | the point of conv(Y) nearest to the origin, sum of weights times Y | (N, 3) |
| w | support point of C along -v | (N, 3) |

Two bounds hold at every step: |v| is the distance of a point of A from one of B, and v.w / |v| is the gap between
separating planes normal to v. They meet at the optimum [1]. A step that does not bring v nearer to the origin ends
the iteration; the caller checks the remaining gap between the bounds.

[1] E. G. Gilbert, D. W. Johnson, S. S. Keerthi, "A fast procedure for computing the distance between complex
objects in three-dimensional space", IEEE J. Robotics and Automation 4 (1988) 193-203.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Flags, Indices
from verify.bodies import norms
from verify.convex import Convex


class Iteration(NamedTuple):
    """Termination of the iteration."""

    accuracy: float = 1e-10
    """Largest gap between the bounds at convergence [l_arm], times 1 + |v|."""
    most_steps: int = 200
    """Largest number of iterations; polyhedra need about ten, the rims of cylinders a few dozen."""


ITERATION = Iteration()


class Tetrahedron(NamedTuple):
    """Vertex indices of the edges and triangles of a tetrahedron."""

    edges: Indices = np.array(list(combinations(range(4), 2)))
    triangles: Indices = np.array(list(combinations(range(4), 3)))
    opposite: Indices = 3 - np.arange(4)
    """The vertex opposite each triangle."""


TETRAHEDRON = Tetrahedron()


class Cores(NamedTuple):
    """N solids without their balls."""

    vertices: Array
    """V, shape (N, k, 3); solids with fewer than k vertices repeat their first one."""
    axis: Array
    """a, shape (N, 3)."""
    disc: Array
    """R, shape (N,)."""

    def take(self, index: Indices) -> Cores:
        """Return the rows `index`."""
        return Cores(self.vertices[index], self.axis[index], self.disc[index])

    def support(self, u: Array) -> Array:
        """Return the support point of each core along u, shape (N, 3)."""
        farthest = np.argmax(np.einsum("nkx,nx->nk", self.vertices, u), axis=1)
        across = u
        for _ in range(2):  # twice: if u is along the axis, one projection leaves a rounding error along it
            across = across - np.sum(across * self.axis, axis=1, keepdims=True) * self.axis
        length = norms(across)
        sideways = length > 1e-15 * norms(u)
        reach = np.where(sideways, self.disc / np.where(sideways, length, 1.0), 0.0)
        return np.asarray(self.vertices[np.arange(len(farthest)), farthest] + reach[:, None] * across)


def cores(solids: Sequence[Convex]) -> Cores:
    """Return the cores of solids as one batch."""
    k = max(len(solid.vertices) for solid in solids)
    vertices = [
        np.concatenate([s.vertices, np.broadcast_to(s.vertices[0], (k - len(s.vertices), 3))]) for s in solids
    ]
    return Cores(np.array(vertices), np.array([s.axis for s in solids]), np.array([s.disc for s in solids]))


class Nearest(NamedTuple):
    """Nearest points of N pairs of cores."""

    x_A: Array
    """Point of A, shape (N, 3)."""
    x_B: Array
    """Point of B, shape (N, 3)."""
    v: Array
    """x_A - x_B, shape (N, 3)."""
    overlap: Flags
    """True if the origin lies in C to within rounding, shape (N,)."""


def nearest(A: Cores, B: Cores, towards: Array, enough: Array | float = np.inf) -> Nearest:
    """Return the nearest points of N pairs of cores.

    Args:
        A: first cores.
        B: second cores.
        towards: initial guess of the direction from A to B at their nearest points, shape (N, 3).
        enough: a lower bound on the distance above this ends the iteration early, shape (N,).
    """
    N = len(A.disc)
    enough = np.broadcast_to(enough, N)
    X_A = np.repeat(A.support(towards)[:, None], 4, axis=1)
    X_B = np.repeat(B.support(-towards)[:, None], 4, axis=1)
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
    v = X_A[:, 0] - X_B[:, 0]
    overlap = np.zeros(N, dtype=bool)
    scale = np.abs(v).max(axis=1) + np.abs(X_A[:, 0]).max(axis=1) + A.disc + B.disc
    active = np.arange(N)
    for _ in range(ITERATION.most_steps):
        size = norms(v[active])
        touching = ~(size > 1e-14 * (1 + scale[active]))  # includes NaN
        overlap[active[touching]] = True
        active, size = active[~touching], size[~touching]
        A_, B_, v_ = A.take(active), B.take(active), v[active]
        a, b = A_.support(-v_), B_.support(v_)
        gap = np.sum(v_ * (a - b), axis=1) / np.where(size > 0, size, 1.0)
        unfinished = (size - gap > ITERATION.accuracy * (1.0 + size)) & (gap <= enough[active])
        active, a, b, size = active[unfinished], a[unfinished], b[unfinished], size[unfinished]
        if not len(active):
            break
        rows, slot = np.arange(len(active)), np.argmin(weights[active], axis=1)
        Y_A, Y_B = X_A[active], X_B[active]
        Y_A[rows, slot], Y_B[rows, slot] = a, b
        new_weights, inside = least_weights(Y_A - Y_B)
        v_ = np.einsum("nj,njx->nx", new_weights, Y_A - Y_B)
        nearer = inside | (norms(v_) < size)
        overlap[active[inside]] = True
        improved = active[nearer]
        X_A[improved], X_B[improved] = Y_A[nearer], Y_B[nearer]
        weights[improved], v[improved] = new_weights[nearer], v_[nearer]
        active = active[nearer & ~inside]
    x_A, x_B = np.einsum("nj,njx->nx", weights, X_A), np.einsum("nj,njx->nx", weights, X_B)
    return Nearest(x_A, x_B, v, overlap)


def least_weights(Y: Array) -> tuple[Array, Flags]:
    """Return the weights of the point of conv(Y) nearest to the origin, and whether the origin is inside.

    Every vertex, edge and triangle proposes its own nearest point; the nearest proposal wins.

    Args:
        Y: simplices of four points, some of which may coincide, shape (N, 4, 3).
    """
    N = len(Y)
    proposals = np.zeros((N, 4 + len(TETRAHEDRON.edges) + len(TETRAHEDRON.triangles), 4))
    proposals[:, :4] = np.eye(4)
    i, j = TETRAHEDRON.edges.T
    along = Y[:, j] - Y[:, i]
    length2 = np.sum(along * along, axis=-1)
    t = -np.sum(along * Y[:, i], axis=-1) / np.where(length2 > 0, length2, 1.0)
    t = np.clip(t, 0.0, 1.0)  # the ends repeat the vertices' proposals
    edge = np.arange(4, 4 + len(TETRAHEDRON.edges))
    proposals[:, edge, i], proposals[:, edge, j] = 1.0 - t, t
    corners = Y[:, TETRAHEDRON.triangles]
    a, b, c = (corners[:, :, k] for k in range(3))
    normal = _cross(b - a, c - a)
    area2 = np.sum(normal * normal, axis=-1)
    area2 = np.where(area2 > 0, area2, 1.0)
    opposite_edges = _cross(corners[:, :, [1, 2, 0]], corners[:, :, [2, 0, 1]])
    shares = np.sum(normal[:, :, None] * opposite_edges, axis=-1) / area2[..., None]
    total = shares.sum(axis=-1)
    inner = np.all(shares >= 0, axis=-1) & (total > 0.5)  # the edges of flat triangles propose instead
    shares = np.where(inner[..., None], shares / np.where(inner, total, 1.0)[..., None], np.array([1.0, 0.0, 0.0]))
    face = 4 + len(TETRAHEDRON.edges) + np.arange(len(TETRAHEDRON.triangles))
    proposals[:, face[:, None], TETRAHEDRON.triangles] += shares
    points = proposals @ Y
    best = np.argmin(np.sum(points * points, axis=-1), axis=1)
    weights = proposals[np.arange(N), best]
    # The origin is inside if it lies between every face and the opposite vertex; the ratio is that vertex's weight.
    height = np.sum(normal * (Y[:, TETRAHEDRON.opposite] - a), axis=-1)
    solid = np.all(height != 0, axis=1)
    shares = -np.sum(normal * a, axis=-1) / np.where(solid[:, None], height, 1.0)
    inside = solid & np.all(shares > 0, axis=1)
    barycentric = np.empty_like(weights)
    barycentric[:, TETRAHEDRON.opposite] = shares / np.where(inside, shares.sum(axis=1), 1.0)[:, None]
    # The heights of coplanar points are mere rounding: the origin is inside only if these weights reproduce it.
    miss = norms(np.einsum("nj,njx->nx", barycentric, Y))
    inside &= miss < 0.5 * norms(points[np.arange(N), best])
    return np.where(inside[:, None], barycentric, weights), inside


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors, shape (..., 3); several times faster than NumPy on small batches."""
    (a_x, a_y, a_z), (b_x, b_y, b_z) = ((v[..., 0], v[..., 1], v[..., 2]) for v in (a, b))
    c = np.empty_like(a)
    c[..., 0], c[..., 1], c[..., 2] = a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x
    return c
