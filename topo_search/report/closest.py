"""Where two volumes come closest: what a picture marks. The audit proves how far they are apart, not this module.

| symbol | meaning | shape | unit |
|---|---|---|---|
| s, t | places on the axes of two cone-spheres, 0 at the start and 1 at the end | | |
| P(s), r(s) | ball of a cone-sphere | (3,) | m |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from trimesh.triangles import closest_point

from topo_search.export.poses import PORTS, Poses
from topo_search.export.regions import hull
from topo_search.model import Clearance, Design
from topo_search.model.arrays import Array
from topo_search.model.shape import Capsule, Cone, Polytope

SPLITS = 64
"""Cells of the grid along s and t; each finer grid covers four cells of the one before, about its best point."""
ZOOMS = 8


class ConeSphere(NamedTuple):
    """A union of balls along a segment."""

    start: Array
    end: Array
    start_radius: float
    end_radius: float

    def ball(self, s: Array) -> tuple[Array, Array]:
        """Return centres (..., 3) and radii (...) at places on the axis."""
        s = np.asarray(s, dtype=float)
        return (
            self.start + s[..., None] * (self.end - self.start),
            self.start_radius + s * (self.end_radius - self.start_radius),
        )


def closest_points(design: Design, at: Poses, pair: Clearance, mount: Array | None) -> tuple[Array, Array]:
    """Return the points, one on each side of a clearance, that are closest; (3,) each [m].

    For rigid parts these are their modules' centres, those of rotors, the connector of a bracket, and the point of
    the rod closest to one.

    Args:
        design: the design.
        at: its poses.
        pair: the clearance.
        mount: the connector that carries the rod, if there is one.
    """
    if pair.kind == "exclusion" or (pair.kind == "rod" and mount is None):
        return at.p[pair.a], at.end_effector
    if pair.kind == "rod" and mount is not None:
        centre = ConeSphere(at.p[pair.a], at.p[pair.a], 0.0, 0.0)
        return between(centre, ConeSphere(mount, at.end_effector, 0.0, 0.0))
    if pair.kind == "rod-airflow":
        rod, foot = design.task.end_effector.rod_radius, at.end_effector if mount is None else mount
        return between(ConeSphere(foot, at.end_effector, rod, rod), _envelope(design, at, pair.b))
    if pair.kind == "rotor-airflow":
        part = at.p[pair.a] if pair.segment is None else at.p[pair.a] + at.R[pair.a] @ arms(design)[pair.segment]
        return between(ConeSphere(part, part, 0.0, 0.0), _envelope(design, at, pair.b))
    if pair.kind in ("part-region", "rod-region"):
        return at.p[pair.a], at.end_effector
    if pair.kind in ("bracket-airflow", "bracket-rotor"):
        joint = _joint(design, at, pair.a)
        if pair.kind == "bracket-rotor":
            return joint, at.p[pair.b]
        return between(ConeSphere(joint, joint, 0.0, 0.0), _envelope(design, at, pair.b))
    if pair.kind in ("separation", "body"):
        return at.p[pair.a], at.p[pair.b]
    envelope = _envelope(design, at, pair.a)
    if pair.kind == "airflow":
        return between(envelope, _envelope(design, at, pair.b))
    apex = at.end_effector
    match design.task.exposure[pair.b].shapes[pair.segment or 0].at(at.p_E):
        case Cone() as cone:
            return to_cone(envelope, apex + cone.apex, np.array(cone.axis), math.radians(cone.half_angle_deg))
        case Polytope() as region:
            corners, triangles, *_ = hull(region)
            return to_polytope(envelope, apex + corners[triangles])
        case Capsule(radius=r, start=start, end=end):
            return between(envelope, ConeSphere(apex + start, apex + end, r, r))


def between(one: ConeSphere, other: ConeSphere) -> tuple[Array, Array]:
    """Return the points of two cone-spheres' surfaces on the line between the balls that come closest.

    The distance of the balls is convex in (s, t), so that finer and finer grids about the best point find it.
    """
    middle, half = np.array([0.5, 0.5]), 0.5
    for _ in range(ZOOMS):
        s, t = (np.clip(m + half * np.linspace(-1, 1, SPLITS + 1), 0, 1) for m in middle)
        P, r = one.ball(s)
        Q, q = other.ball(t)
        distance = np.linalg.norm(P[:, None] - Q[None], axis=-1) - r[:, None] - q[None]
        i, j = np.unravel_index(np.argmin(distance), distance.shape)
        middle, half = np.array([s[i], t[j]]), 4 * half / SPLITS
    (P, r), (Q, q) = one.ball(middle[0]), other.ball(middle[1])
    across = Q - P
    gap = float(np.linalg.norm(across))
    n = across / gap if gap else np.array([0.0, 0.0, 1.0])
    return P + r * n, Q - q * n


def to_polytope(body: ConeSphere, triangles: Array) -> tuple[Array, Array]:
    """Return the points of a cone-sphere and of the surface of triangles, (f, 3, 3), that come closest."""
    middle, half = 0.5, 0.5
    for _ in range(ZOOMS):
        s = np.clip(middle + half * np.linspace(-1, 1, SPLITS + 1), 0, 1)
        P, r = body.ball(s)
        each, place = np.repeat(triangles, len(s), axis=0), np.tile(P, (len(triangles), 1))
        nearest = closest_point(each, place).reshape(len(triangles), len(s), 3)
        distance = np.linalg.norm(nearest - P, axis=-1) - r
        f, i = np.unravel_index(np.argmin(distance), distance.shape)
        middle, half = float(s[i]), 4 * half / SPLITS
        on_body, on_surface = P[i], nearest[f, i]
    across = on_surface - on_body
    gap = float(np.linalg.norm(across))
    n = across / gap if gap else np.array([0.0, 0.0, 1.0])
    return on_body + body.ball(np.array(middle))[1] * n, on_surface


def to_cone(body: ConeSphere, apex: Array, axis: Array, theta: float) -> tuple[Array, Array]:
    """Return the points of a cone-sphere and of a cone's surface around it that come closest."""
    candidates = []
    for s in (0.0, 1.0):  # the clearance is linear or concave along the axis of the body: least at an end
        P, r = body.ball(np.array(s))
        along = float((P - apex) @ axis)
        radial = P - apex - along * axis
        out = float(np.linalg.norm(radial))
        n = math.cos(theta) * radial / out if out else np.zeros(3)
        n = n - math.sin(theta) * axis
        depth = math.sin(theta) * along - math.cos(theta) * out
        candidates.append((depth - float(r), P + r * n, P + depth * n))
    _, on_body, on_cone = min(candidates, key=lambda found: found[0])
    return on_body, on_cone


def arms(design: Design) -> Array:
    """Return where a module's rotors are in its frame, shape (4, 3) [m]."""
    signs = np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    return design.task.module.arm_length / math.sqrt(2) * signs


def _joint(design: Design, at: Poses, child: int) -> Array:
    """Return the connector by which a module is bolted to its parent, (3,) [m]."""
    parent, port, _ = design.topology.joints[child]
    return np.asarray(at.p[parent] + design.task.module.connector_distance * at.R[parent] @ PORTS[port])


def _envelope(design: Design, at: Poses, i: int) -> ConeSphere:
    envelope = design.task.module.envelope
    return ConeSphere(at.p[i], at.p[i] - envelope.length * at.z[i], envelope.start_radius, envelope.end_radius)
