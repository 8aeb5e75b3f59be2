"""The greatest value of a convex function on the unit sphere, bounded from above by proof.

The sphere is covered by the cones of triangles with unit corners a, b, c. A point z of such a cone's part of the
sphere is y / ||y|| for a point y of the flat triangle, and ||y|| >= d, the distance of its plane from the origin. A
convex h >= 0 with h(0) = 0 grows along every ray and is largest at a corner, so

    h(z) <= h(y / d) <= max(h(a / d), h(b / d), h(c / d)),

which exceeds h at the corners themselves by the order of the triangle's area. Triangles where that still matters
are split into four.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from topo_search.model.arrays import Array

Function = Callable[[Array], Array]
"""From points (m, 3) to values (m,)."""

ACCURACY = 2e-4
"""Triangles whose bound exceeds the greatest value seen by less than this share of it are not split."""
MOST_TRIANGLES = 300_000
"""Nothing is split beyond this number; the bound is then coarser and as valid."""
ROUNDING = 1e-12
"""Share added to the bound, for the rounding of d and of the corners."""


def octahedron() -> Array:
    """Return the eight triangles of the octahedron, shape (8, 3, 3)."""
    x, y, z = np.eye(3)
    return np.array([[i * x, j * y, k * z] for i in (1, -1) for j in (1, -1) for k in (1, -1)])


def split(triangles: Array) -> Array:
    """Return four triangles for each, with corners at the middles of its sides on the sphere."""
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = (_unit(a + b), _unit(b + c), _unit(c + a))
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(corners, axis=1) for corners in quarters])


def directions(splits: int) -> Array:
    """Return 4^(splits + 1) + 2 directions, evenly spread, shape (m, 3)."""
    triangles = octahedron()
    for _ in range(splits):
        triangles = split(triangles)
    return np.unique(np.round(triangles.reshape(-1, 3), 12), axis=0)


def ring_around(axes: Array, angle: float) -> Array:
    """Return unit axes (m, 3) and six directions at an angle [rad] around each, shape (7 m, 3)."""
    across = _unit(np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)]))
    turns = np.arange(6) * np.pi / 3
    ring = np.multiply.outer(np.cos(turns), across) + np.multiply.outer(np.sin(turns), np.cross(axes, across))
    return np.concatenate([axes, (np.cos(angle) * axes + np.sin(angle) * ring).reshape(-1, 3)])


def greatest(h: Function) -> float:
    """Return an upper bound on h over the unit sphere; h is convex, not negative, and h(0) = 0."""
    triangles, seen, settled = octahedron(), 0.0, 0.0
    while True:
        seen = max(seen, float(h(triangles.reshape(-1, 3)).max()))
        outer = triangles / _distance(triangles)[:, None, None]
        bound = h(outer.reshape(-1, 3)).reshape(-1, 3).max(axis=1)
        open_ = bound > (1 + ACCURACY) * seen
        if 4 * np.count_nonzero(open_) > MOST_TRIANGLES:
            open_[:] = False
        settled = max(settled, float(bound[~open_].max(initial=0.0)))
        triangles = split(triangles[open_])
        if not len(triangles):
            return settled * (1 + ROUNDING)


def _distance(triangles: Array) -> Array:
    """Return the distance d of every triangle's plane from the origin."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    return np.asarray(np.abs(np.sum(normal * a, axis=1)) / np.linalg.norm(normal, axis=1))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
