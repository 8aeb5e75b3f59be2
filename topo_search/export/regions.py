"""The one geometry of exposure requirements that pictures, pages and files for other programs draw.

Shapes have their directions, which some leave to the design, and are in metres from the end-effector. Outlines are
those of an orthographic view.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | ends of an axis and the radii there; the volume is the union of balls in between | (3,) | m |
| v | unit vector towards the viewer | (3,) | |
| s, t | axes of the picture plane | (3,) | |
| d, theta | unit axis and half-angle of a cone with apex A | (3,) | -, rad |
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from topo_search.export.poses import Poses
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.shape import Cone, Hull, Polytope, Shape, convex_hull


def shapes(task: ResolvedTask, p_E: Array) -> Iterator[tuple[int, Shape]]:
    """Yield every shape of every requirement with its number, for an end-effector p_E from the centre of mass."""
    for number, requirement in enumerate(task.exposure):
        for shape in requirement.shapes:
            yield number, shape.at(p_E)


def region_words(shape: Shape) -> str:
    """Return the legend of a region: what airflow has to do with it."""
    if not isinstance(shape, Cone):
        return "keep-out region for airflow"
    return f"{'cone' if shape.half_angle_deg < 90 else 'half-space'} that must contain all airflow"


def hull(shape: Polytope) -> Hull:
    """Return the hull of a polytope's corners."""
    return convex_hull(np.array(shape.corners))


def cone(shape: Cone, slant: float) -> Array:
    """Return the triangles of a cone's surface out to a slant height, (sides, 3, 3); a disc for a half-space."""
    assert shape.axis is not None  # as `Shape.at` leaves it
    theta = math.radians(shape.half_angle_deg)
    return cone_triangles(np.array(shape.apex), np.array(shape.axis), theta, slant)


def cone_slant(design: Design, at: Poses) -> float:
    """Return how far an infinite cone is drawn, so that it holds most of the airflow [m]."""
    return float(np.linalg.norm(at.p - at.end_effector, axis=1).max()) + 2 * design.task.module.reach / 3


def cone_sphere_outline(P_0: Array, r_0: float, P_1: Array, r_1: float, v: Array, *, points: int = 96) -> Array:
    """Return the outline of a cone-sphere, capsule or ball as a closed polygon, (points, 3) [m].

    Seen along v the volume is the hull of two discs. The hull's point with the normal u belongs to the disc
    that reaches further along u.
    """
    s, t = _plane(v)
    angles = np.linspace(0, 2 * math.pi, points, endpoint=False)
    u = np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)
    second = (u @ P_1 + r_1 > u @ P_0 + r_0)[:, None]
    return np.asarray(np.where(second, P_1 + r_1 * u, P_0 + r_0 * u))


def flat_hull(points: Array) -> Array:
    """Return the outline of points on paper, (m, 2), as a closed polygon, (k, 2)."""
    return np.asarray(points[ConvexHull(points).vertices])


def circle(centre: Array, radius: float, axis: Array, *, points: int = 48) -> Array:
    """Return a closed circle about an axis, (points + 1, 3) [m]."""
    s, t = _plane(axis)
    angles = np.linspace(0, 2 * math.pi, points + 1)
    return np.asarray(centre + radius * (np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)))


def cone_triangles(apex: Array, d: Array, theta: float, slant: float, *, sides: int = 48) -> Array:
    """Return the triangles of a cone's surface out to a slant height, (sides, 3, 3) [m]; a disc at 90 deg."""
    rim = circle(apex + slant * math.cos(theta) * d, slant * math.sin(theta), d, points=sides)
    return np.stack([np.broadcast_to(apex, rim[1:].shape), rim[:-1], rim[1:]], axis=1)


def _plane(normal: Array) -> tuple[Array, Array]:
    """Return two unit vectors that span the plane across a normal."""
    across = np.eye(3)[np.argmin(np.abs(normal))]
    s = np.cross(normal, across)
    s /= np.linalg.norm(s)
    return s, np.cross(normal / np.linalg.norm(normal), s)
