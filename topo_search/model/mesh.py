"""Surfaces of triangles, and outlines of round volumes, for pictures, pages and exported files.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | centres and radii of two balls; their hull is a cone-sphere | (3,), (3,), , | m |
| L, a | length of its axis, and the axis from P_0 to P_1 | , (3,) | m, - |
| theta_t | angle between a and the normals of the conical part: cos(theta_t) = -(r_1 - r_0) / L | | rad |
| v | unit vector towards the viewer | (3,) | |
| s, t | axes of the picture plane, or of a plane across an axis | (3,) | |
| u | unit vectors in the picture plane | (points, 3) | |

Vertices lie on the true surface, so the mesh of a round volume lies inside it, by less than 0.3 % of its radius.
Outlines are orthographic.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model.arrays import Array, Indices

SIDES = 48
"""Sides of a circle: its sagitta is 0.21 % of the radius."""


class Mesh(NamedTuple):
    """A surface of triangles."""

    vertices: Array
    """(v, 3) [m]."""
    faces: Indices
    """Vertices of the triangles, counter-clockwise seen from outside, (f, 3)."""

    @property
    def triangles(self) -> Array:
        """Corners of the triangles, (f, 3, 3) [m]."""
        return self.vertices[self.faces]

    def move(self, R: Array, p: Array) -> Mesh:
        """Return the mesh turned by R, (3, 3), then shifted by p, (3,)."""
        return Mesh(self.vertices @ R.T + p, self.faces)


def rotation_to(a: Array) -> Array:
    """Return a rotation from the z axis to a unit vector, (3, 3)."""
    s = np.cross(np.eye(3)[np.argmin(np.abs(a))], a)
    s /= np.linalg.norm(s)
    return np.stack([s, np.cross(a, s), a], axis=1)


def cone_sphere(P_0: Array, r_0: float, P_1: Array, r_1: float, *, sides: int = SIDES) -> Mesh:
    """Return the hull of two balls: a capsule if the radii are equal, a ball if one ball contains the other."""
    a = P_1 - P_0
    L = float(np.linalg.norm(a))
    theta_t = math.acos(max(-1.0, min(1.0, (r_0 - r_1) / L))) if L else math.pi
    profile = np.concatenate([_arc(0.0, theta_t, r_1, L, sides), _arc(theta_t, math.pi, r_0, 0.0, sides)])
    profile[[0, -1], 0] = 0.0  # the poles lie on the axis
    apart = np.linalg.norm(np.diff(profile, axis=0), axis=1) > 1e-8 * max(r_0, r_1)
    profile = profile[np.append(True, apart)]  # no slivers where the arcs meet
    return revolve(profile[::-1], sides).move(rotation_to(a / L) if L else np.eye(3), P_0)


def revolve(profile: Array, sides: int) -> Mesh:
    """Return the surface of a profile turned about z; rows (distance from the axis, height), at both ends on it."""
    angles, m = np.linspace(0.0, 2 * math.pi, sides, endpoint=False), len(profile)
    across = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None] * profile[:, :1]
    points = np.concatenate([across, np.broadcast_to(profile[:, 1:], (sides, m, 1))], axis=-1)
    here = np.arange(m) + (m - 2) * np.arange(sides)[:, None] + 1  # the ends are vertices of the first turn only
    here[0], here[:, 0], here[:, -1] = np.arange(m), 0, m - 1
    after = np.roll(here, -1, axis=0)
    quads = [here[:, :-1], after[:, :-1], here[:, 1:], here[:, 1:], after[:, :-1], after[:, 1:]]
    faces = np.stack(quads, axis=-1).reshape(sides, -1, 3)[:, 1:-1]  # at the ends a quad is one triangle
    return Mesh(np.concatenate([points[0], points[1:, 1:-1].reshape(-1, 3)]), faces.reshape(-1, 3))


def _arc(start: float, end: float, r: float, height: float, sides: int) -> Array:
    steps = max(2, math.ceil((end - start) / (2 * math.pi / sides)) + 1)
    theta = np.linspace(start, end, steps) if r and end > start else np.empty(0)
    return np.stack([r * np.sin(theta), height + r * np.cos(theta)], axis=1)


def circle(centre: Array, radius: float, axis: Array, *, points: int = SIDES) -> Array:
    """Return a closed circle about an axis (a unit vector), (points + 1, 3) [m]."""
    s, t, _ = -rotation_to(axis).T  # the sign fixes the order of the points
    angles = np.linspace(0, 2 * math.pi, points + 1)
    return np.asarray(centre + radius * (np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)))


def cone_sphere_outline(P_0: Array, r_0: float, P_1: Array, r_1: float, v: Array, *, points: int = 96) -> Array:
    """Return the outline of a cone-sphere, capsule or ball as a closed polygon, (points, 3) [m].

    Seen along v, the volume is the hull of two discs; its point with normal u lies on the disc that extends
    further along u.
    """
    u = circle(np.zeros(3), 1.0, v, points=points)[:-1]
    second = (u @ P_1 + r_1 > u @ P_0 + r_0)[:, None]
    return np.asarray(np.where(second, P_1 + r_1 * u, P_0 + r_0 * u))
