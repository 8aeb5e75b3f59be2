"""Closed triangle meshes of the volumes of a design, for programs that show or print solids.

The rigid parts of a module also are four-cornered faces, (faces, 4, 3) [m], corners counter-clockwise from outside.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | ends of an axis and the radii there; a cone-sphere is the hull of the two balls | (3,) | m |
| L, a | length of the axis and its direction from P_0 to P_1 | (3,) | m, - |
| theta_t | angle between a and the normals of the conical part: cos(theta_t) = -(r_1 - r_0) / L | | rad |

Vertices lie on the surface, so that a mesh of a round volume is inside of it, by less than 0.3 % of its radius.
"""

from __future__ import annotations

import math

import numpy as np
import trimesh
from trimesh import Trimesh

from topo_search.export.poses import ROTOR_ANGLES, rotation_to
from topo_search.model.arrays import Array
from topo_search.model.module import Module
from verify.kinematics import rotation

SIDES = 48
"""Sides of a circle: its sagitta is 0.21 % of the radius."""


def frame(module: Module) -> Trimesh:
    """Return hub and arms, or a frame of the module's own, as closed shells that may reach into each other.

    Opposite arms are one bar, because shells with corners in common are no longer closed once corners are merged.
    """
    l_arm, w = module.arm_length, module.body.arm_width
    if module.body.frame is not None:
        return join([Trimesh(piece.vertices, piece.triangles, process=False) for piece in module.body.frame])
    hub = trimesh.creation.box(extents=module.body.hub)
    bars = []
    for angle in ROTOR_ANGLES[:2]:
        turned = pose_matrix(rotation(2, angle), np.zeros(3))
        bars.append(trimesh.creation.box(extents=(2 * l_arm, w, w), transform=turned))
    return join([hub, *bars])


def rotors(module: Module, *, sides: int = SIDES) -> Trimesh:
    """Return the four rotor discs in the module frame."""
    body, l_arm = module.body, module.arm_length
    discs = []
    for angle in ROTOR_ANGLES:
        disc = trimesh.creation.cylinder(radius=body.rotor_radius, height=body.rotor_height, sections=sides)
        discs.append(disc.apply_translation((l_arm * math.cos(angle), l_arm * math.sin(angle), 0)))
    return join(discs)


def cone_sphere(P_0: Array, r_0: float, P_1: Array, r_1: float, *, sides: int = SIDES) -> Trimesh:
    """Return the hull of two balls; a capsule where the radii are equal, a ball where one ball holds the other."""
    a = P_1 - P_0
    L = float(np.linalg.norm(a))
    theta_t = math.acos(max(-1.0, min(1.0, (r_0 - r_1) / L))) if L else math.pi
    profile = np.concatenate([_arc(0.0, theta_t, r_1, L, sides), _arc(theta_t, math.pi, r_0, 0.0, sides)])
    profile[[0, -1], 0] = 0.0  # the poles lie on the axis
    size = max(r_0, r_1)  # trimesh takes places within 1e-8 for one: small bodies are made large
    mesh: Trimesh = trimesh.creation.revolve(profile[::-1] / size, sections=sides)
    mesh.apply_scale(size)
    mesh.apply_transform(pose_matrix(rotation_to(a / L) if L else np.eye(3), P_0))
    return mesh


def pose_matrix(R: Array, p: Array) -> Array:
    """Return the pose of a body as a homogeneous matrix, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose


def join(meshes: list[Trimesh]) -> Trimesh:
    """Return several meshes as one; each keeps its shell."""
    mesh = trimesh.util.concatenate(meshes)
    assert isinstance(mesh, Trimesh)  # as all of them are
    return mesh


def _arc(start: float, end: float, r: float, height: float, sides: int) -> Array:
    """Return a part of a ball's profile, from polar angle to polar angle; rows (distance from the axis, height)."""
    steps = max(2, math.ceil((end - start) / (2 * math.pi / sides)) + 1)
    theta = np.linspace(start, end, steps) if r and end > start else np.empty(0)
    return np.stack([r * np.sin(theta), height + r * np.cos(theta)], axis=1)


_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_TURNED = _SQUARE[::-1]
CUBE = np.array(
    [
        np.insert(_SQUARE if outwards else _TURNED, axis, side, axis=1)
        for axis in range(3)
        for side, outwards in ((-1.0, axis == 1), (1.0, axis != 1))
    ]
)
"""Faces of the cube [-1, 1]^3."""


def frame_faces(module: Module) -> Array:
    """Return the faces of hub and arms, or of a frame of the module's own: triangles, their last corner twice."""
    body, l_arm, w = module.body, module.arm_length, module.body.arm_width
    if body.frame is not None:
        own = np.concatenate([np.array(piece.vertices)[np.array(piece.triangles)] for piece in body.frame])
        seen = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 1]).any(axis=1)
        return np.asarray(own[seen][:, [0, 1, 2, 2]])
    arm = CUBE * np.array([l_arm, w, w]) / 2 + np.array([l_arm / 2, 0.0, 0.0])
    return np.concatenate([CUBE * np.array(body.hub) / 2, *(arm @ _turn(angle).T for angle in ROTOR_ANGLES)])


def rotor_faces(module: Module) -> Array:
    """Return the faces of the four rotor discs."""
    disc = cylinder(module.body.rotor_radius, module.body.rotor_height)
    return np.concatenate([disc + _turn(angle) @ np.array([module.arm_length, 0.0, 0.0]) for angle in ROTOR_ANGLES])


def cylinder(radius: float, height: float, *, sides: int = 16) -> Array:
    """Return the faces of a prism about z with an even number of sides; each end is cut into strips."""
    angles = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    ring = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    top, bottom = ring + np.array([0, 0, height / 2]), ring - np.array([0, 0, height / 2])
    around = np.stack([bottom, np.roll(bottom, -1, axis=0), np.roll(top, -1, axis=0), top], axis=1)
    strips = [[k, k + 1, sides - 2 - k, sides - 1 - k] for k in range(sides // 2 - 1)]
    return np.concatenate([around, top[strips], bottom[strips][:, ::-1]])


def _turn(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
