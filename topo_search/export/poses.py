"""Geometry that pictures, pages and files for other programs share: poses of modules and rod, regions, viewpoint.

Poses are from the audit's kinematics.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | connector that the rod is bolted to, p_i + l_c R_i e_a | (3,) | m |
| p'_E | end-effector in W | (3,) | m |
| m, v | mass of the rod, which solver and audit may ignore; unit vector along it | , (3,) | kg, - |

Shapes of exposure requirements have their directions, which some leave to the design, and are in metres from the
end-effector. Outlines are those of an orthographic view.

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
from dataclasses import dataclass

import numpy as np

from topo_search.model import BadInput, Design, Fault, ResolvedTask
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.shape import Cone, Hull, Polytope, Shape, convex_hull
from verify.kinematics import Platform, platform

ROTOR_ANGLES = tuple(math.radians(angle) for angle in (-45, -135, 135, 45))
"""Direction of rotor q = 0..3 from the module's centre (X layout)."""


def load_wrenches(design: Design, at: Platform) -> Iterator[tuple[int, str, str, Array, Array]]:
    """Yield load case, "force" or "torque", where it acts (in words; as a point, (3,) [m]), the vector [N, N m]."""
    for k, case in enumerate(design.task.load_cases):
        for wrench, where, point in (
            (case.at_end_effector, "end-effector", at.end_effector),
            (case.at_com, "centre of mass", at.p_com),
        ):
            yield k, "force", where, point, np.array(wrench.force)
            yield k, "torque", where, point, np.array(wrench.torque)


def largest_wrench(design: Design, at: Platform, kind: str) -> float:
    """Return the largest force [N] or torque [N m] of all load cases."""
    return max(float(np.linalg.norm(v)) for _, name, _, _, v in load_wrenches(design, at) if name == kind)


def rotation_to(a: Array) -> Array:
    """Return a rotation that takes the z axis to a unit vector, (3, 3)."""
    s = np.cross(np.eye(3)[np.argmin(np.abs(a))], a)
    s /= np.linalg.norm(s)
    return np.stack([s, np.cross(a, s), a], axis=1)


@dataclass(frozen=True)
class Rod:
    """A straight rod with round ends."""

    start: Array
    """c, in W [m]."""
    end: Array
    """p'_E, in W [m]."""
    radius: float
    """[m]"""

    @property
    def length(self) -> float:
        """Between the centres of its ends [m]."""
        return float(np.linalg.norm(self.end - self.start))


def mass_of(rod: Rod, design: Design, at: Platform) -> tuple[float, Array, Array]:
    """Return mass [kg], inertia about its middle (3, 3) [kg m^2] and that middle from the COM (3,) [m] of a rod.

    The rod is a thin tube, its inertia in W's axes.
    """
    counted = design.task.end_effector.counted_rod
    m = design.task.end_effector.rod_linear_density * rod.length if counted is None else counted.mass
    v = (rod.end - rod.start) / rod.length
    across = m * rod.length**2 / 12 * (np.eye(3) - np.outer(v, v))
    inertia = across + m * rod.radius**2 * np.outer(v, v)
    return m, inertia, (rod.start + rod.end) / 2 - at.p_com


def rod_of(design: Design, at: Platform) -> Rod | None:
    """Return the rod of a design; None if the design names no connector for it, or it has no length."""
    if design.mount is None:
        return None
    i, l_c = design.mount.module, design.task.module.connector_distance
    start = at.p[i] + l_c * at.R[i] @ PORT_DIRECTIONS[design.mount.port]
    rod = Rod(start, at.end_effector, design.task.end_effector.rod_radius)
    return rod if rod.length > 0 else None


ELEVATION_DEG = 20.0


def poses_to_draw(design: Design) -> Platform:
    """Return the poses of a design; BadInput if the end-effector is so far away that nothing else could be seen."""
    module = design.task.module
    limit = 1000.0 * (2 * module.connector_distance * design.topology.n + module.reach)
    if max(map(abs, design.end_effector_m)) > limit:
        rule = f"must be within {limit:.3g} m of the root module to be drawn, but got {list(design.end_effector_m)}"
        raise BadInput(design.task.name, [Fault("end_effector_m", rule)])
    return platform(design)


def azimuth_deg(at: Platform) -> float:
    """Return the azimuth [deg] that looks across the line from the centre of mass to p_E, and along no axis."""
    x, y, _ = at.p_e
    azimuths = (-60, -30, 30, 60)  # none is close to an axis, whose labels would then run into each other
    across = y * np.cos(np.radians(azimuths)) - x * np.sin(np.radians(azimuths))
    return azimuths[int(np.argmax(np.abs(across)))]


def towards_viewer(azimuth_deg: float) -> Array:
    """Return the unit vector towards the viewer, (3,)."""
    elevation, azimuth = math.radians(ELEVATION_DEG), math.radians(azimuth_deg)
    across = math.cos(elevation)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation)])


def shapes(task: ResolvedTask, p_E: Array) -> Iterator[tuple[int, Shape]]:
    """Yield every shape of every requirement with its number, for an end-effector p_E from the centre of mass."""
    for number, exposure in enumerate(task.exposure):
        for shape in exposure.shapes:
            yield number, shape.at(p_E)


def region_words(shape: Shape) -> str:
    """Return the legend of a region: what airflow has to do with it."""
    if not isinstance(shape, Cone):
        return "keep-out region for airflow"
    return f"{'cone' if shape.half_angle_deg < 90 else 'half-space'} that must contain all airflow"


def hull(shape: Polytope) -> Hull:
    """Return the hull of a polytope's corners."""
    return convex_hull(np.array(shape.corners))


def cone(shape: Cone, slant: float, *, sides: int = 48) -> Array:
    """Return the triangles of a cone's surface out to a slant height, (sides, 3, 3); a disc for a half-space."""
    theta, apex, d = math.radians(shape.half_angle_deg), np.array(shape.apex), np.array(shape.axis)
    rim = circle(apex + slant * math.cos(theta) * d, slant * math.sin(theta), d, points=sides)
    return np.stack([np.broadcast_to(apex, rim[1:].shape), rim[:-1], rim[1:]], axis=1)


def cone_slant(design: Design, at: Platform) -> float:
    """Return how far an infinite cone is drawn, so that it holds most of the airflow [m]."""
    return float(np.linalg.norm(at.p - at.end_effector, axis=1).max()) + 2 * design.task.module.reach / 3


def cone_sphere_outline(P_0: Array, r_0: float, P_1: Array, r_1: float, v: Array, *, points: int = 96) -> Array:
    """Return the outline of a cone-sphere, capsule or ball as a closed polygon, (points, 3) [m].

    Seen along v the volume is the hull of two discs. The hull's point with the normal u belongs to the disc
    that reaches further along u.
    """
    s, t, _ = -rotation_to(v).T  # the sign keeps drawings as they are
    angles = np.linspace(0, 2 * math.pi, points, endpoint=False)
    u = np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)
    second = (u @ P_1 + r_1 > u @ P_0 + r_0)[:, None]
    return np.asarray(np.where(second, P_1 + r_1 * u, P_0 + r_0 * u))


def circle(centre: Array, radius: float, axis: Array, *, points: int = 48) -> Array:
    """Return a closed circle about an axis, a unit vector, (points + 1, 3) [m]."""
    s, t, _ = -rotation_to(axis).T
    angles = np.linspace(0, 2 * math.pi, points + 1)
    return np.asarray(centre + radius * (np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)))
