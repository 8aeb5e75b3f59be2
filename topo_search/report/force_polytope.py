"""All forces that a platform can add at its end-effector while it hovers: a convex polytope, for a picture.

| symbol | meaning | shape | unit |
|---|---|---|---|
| u | rotor inputs, module-major, 0 <= u <= u_max | (4 n,) | rad^2/s^2 |
| F, T | forces and torques about the centre of mass of unit inputs | (3, 4 n) | N s^2, N m s^2 |
| f | force added at the end-effector: F u = m_t g e_z + f, T u = p_E x f | (3,) | N |

All in the axes of the task. A linear program gives the vertex that is farthest along a direction. Facets of the
hull of the vertices so far ask for more along their normals, until none lies beyond any: then the hull is the
polytope. What is told in figures is the audit's, which proves it; this module only draws.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from topo_search.export.allocation import thrust_matrix
from topo_search.export.poses import Poses
from topo_search.model import Design
from topo_search.model.arrays import Array

MOST = 200
"""Linear programs that a picture may take; the hull of what they found lies inside the polytope."""
FLAT = 1e-6
"""Least thickness of a polytope that is drawn, over its size; also by how much a vertex lies beyond a facet."""


class ForcePolytope(NamedTuple):
    """A convex polytope around the origin or beside it."""

    vertices: Array
    """(m, 3) [N]."""
    triangles: Array
    """(t, 3), indices of vertices."""


def force_polytope(design: Design, at: Poses) -> ForcePolytope | None:
    """Return the polytope; None where the platform cannot hover, or where all forces lie in a plane."""
    module = design.task.module
    largest = module.max_input(design.task.gravity) * module.thrust_coefficient
    F, T = np.split(largest * thrust_matrix(module, at), 2)
    weight = design.task.force_unit(design.topology.n)
    x, y, z = at.p_E
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # lever @ f = p_E x f
    scale = np.repeat([weight, weight * design.task.module.arm_length], 3)
    A = np.block([[F, -np.eye(3)], [T, -lever]]) / scale[:, None]
    b = np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]) / scale
    bounds = [(0.0, 1.0)] * F.shape[1] + [(None, None)] * 3

    def farthest(direction: Array) -> Array | None:
        """Return the vertex that is farthest along a direction, (3,) [N]."""
        cost = np.concatenate([np.zeros(F.shape[1]), -direction])
        found = linprog(cost, A_eq=A, b_eq=b, bounds=bounds, method="highs")
        return None if found.x is None else np.asarray(found.x[-3:])

    return _hull(farthest)


def _hull(farthest: Callable[[Array], Array | None]) -> ForcePolytope | None:
    """Return the hull of the vertices that linear programs find, facet by facet."""
    first = [farthest(sign * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]
    points = [point for point in first if point is not None]
    if len(points) < len(first) or (size := float(np.ptp(points, axis=0).max())) == 0:
        return None
    *_, thinnest = np.linalg.svd(np.array(points) - points[0])[2]
    points += [point for sign in (1.0, -1.0) if (point := farthest(sign * thinnest)) is not None]
    if np.linalg.svd(np.array(points) - points[0], compute_uv=False)[2] < FLAT * size:
        return None
    asked: set[tuple[float, ...]] = set()
    while True:
        hull = ConvexHull(np.array(points))
        new = []
        nearest_first = sorted(np.unique(hull.equations.round(9), axis=0).tolist(), key=lambda facet: -facet[3])
        for *normal, offset in nearest_first:
            if tuple(normal) in asked or len(asked) >= MOST:
                continue
            asked.add(tuple(normal))
            point = farthest(np.array(normal))
            if point is not None and point @ normal + offset > FLAT * size:
                new.append(point)
        if not new:
            return ForcePolytope(hull.points, hull.simplices)
        points = [*hull.points[hull.vertices], *new]
