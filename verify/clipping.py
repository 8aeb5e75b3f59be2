"""The part of a convex polyhedron on one side of a plane.

| symbol | meaning | unit |
|---|---|---|
| n, b | unit normal and offset of the plane; what is kept has n.x <= b | -, l_arm |
| h | n.x - b of a vertex | l_arm |
"""

from __future__ import annotations

import numpy as np

from verify.bodies import Array
from verify.convex import Polyhedron

ON = 1e-9
"""Vertices as near to the plane lie on it [l_arm]."""
SLICE = 1e-6
"""Thinner slices are not told [l_arm]: far thinner than anybody places a plane."""


def clip(solid: Polyhedron, n: Array, b: float) -> Polyhedron | None:
    """Return the part of a solid with n.x <= b, under its name; None where that is no more than a slice."""
    h = solid.vertices @ n - b
    if h.min() >= -SLICE:
        return None
    if h.max() <= SLICE:
        return solid
    vertices = list(solid.vertices)
    cuts: dict[tuple[int, int], int] = {}

    def cut(i: int, j: int) -> int:
        """Return the number of the point where the edge from i to j meets the plane."""
        key = (min(i, j), max(i, j))
        if key not in cuts:
            low, high = key
            t = h[low] / (h[low] - h[high])
            cuts[key] = len(vertices)
            vertices.append(vertices[low] + t * (vertices[high] - vertices[low]))
        return cuts[key]

    kept = (h <= ON)[solid.triangles]
    triangles = solid.triangles[kept.all(axis=1)].tolist()
    for corners in solid.triangles[kept.any(axis=1) & ~kept.all(axis=1)].tolist():
        face = []
        for i, j in zip(corners, [*corners[1:], corners[0]], strict=True):
            if h[i] <= ON:
                face.append(i)
            if min(h[i], h[j]) < -ON and max(h[i], h[j]) > ON:
                face.append(cut(i, j))
        triangles += [(face[0], *face[k : k + 2]) for k in range(1, len(face) - 1)]
    rim = _open_edges(triangles)
    vertices.append(np.mean([vertices[i] for i, _ in rim], axis=0))
    triangles += [(j, i, len(vertices) - 1) for i, j in rim]
    used, numbers = np.unique(np.array(triangles, dtype=np.intp), return_inverse=True)
    return Polyhedron(solid.name, np.array(vertices)[used], numbers.reshape(-1, 3).astype(np.intp))


def _open_edges(triangles: list[tuple[int, ...]]) -> list[tuple[int, int]]:
    """Return the edges of a surface that no triangle runs along the other way."""
    there = {(t[k], t[(k + 1) % 3]) for t in triangles for k in range(3)}
    return sorted((i, j) for i, j in there if (j, i) not in there)
