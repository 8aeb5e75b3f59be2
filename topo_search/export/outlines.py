"""Outlines of round volumes as an orthographic view shows them.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | ends of an axis and the radii there; the volume is the union of balls in between | (3,) | m |
| v | unit vector towards the viewer | (3,) | |
| s, t | axes of the picture plane | (3,) | |
| d, theta | unit axis and half-angle of a cone with apex A | (3,) | -, rad |
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull

from topo_search.model.arrays import Array


def cone_sphere(P_0: Array, r_0: float, P_1: Array, r_1: float, v: Array, *, points: int = 96) -> Array:
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


def cone(apex: Array, d: Array, theta: float, slant: float, *, sides: int = 48) -> Array:
    """Return the triangles of a cone's surface out to a slant height, (sides, 3, 3) [m]; a disc at 90 deg."""
    rim = circle(apex + slant * math.cos(theta) * d, slant * math.sin(theta), d, points=sides)
    return np.stack([np.broadcast_to(apex, rim[1:].shape), rim[:-1], rim[1:]], axis=1)


def _plane(normal: Array) -> tuple[Array, Array]:
    """Return two unit vectors that span the plane across a normal."""
    across = np.eye(3)[np.argmin(np.abs(normal))]
    s = np.cross(normal, across)
    s /= np.linalg.norm(s)
    return s, np.cross(normal / np.linalg.norm(normal), s)
