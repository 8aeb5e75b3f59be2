"""A design as solids: GLB for viewers and Blender, STL for CAD and printing.

GLB holds a scene: a node for the frame, the rotors and the airflow envelope of every module, for each region at the
target, for the end-effector and the centre of mass. It is in metres, turned as glTF wants it, with y up. STL is one
surface in millimetres, because programs that read STL take its numbers for that, with z up.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | ends of an axis and the radii there; a cone-sphere is the hull of the two balls | (3,) | m |
| L, a | length of the axis and its direction from P_0 to P_1 | (3,) | m, - |
| theta_t | angle between a and the normals of the conical part: cos(theta_t) = -(r_1 - r_0) / L | | rad |

Vertices lie on the surface, so that a mesh of a round volume is inside of it, by less than 0.3 % of its radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from trimesh import Scene, Trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from topo_search.export import palette
from topo_search.export.air_field import AirSurface
from topo_search.export.poses import ROTOR_ANGLES, cone, cone_slant, hull, rod_of, rotation_to, shapes
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.module import Module
from topo_search.model.shape import Capsule, Cone, Polytope, Shape
from verify.kinematics import Platform, platform, rotation

Parts = Literal["all", "platform", "airflow"]
"""Solids to write: `all` adds to platform and airflow the regions and marks at the target."""

SIDES = 48
"""Sides of a circle: its sagitta is 0.21 % of the radius."""


@dataclass(frozen=True)
class Solid:
    """A mesh, and wherever it appears."""

    name: str
    mesh: Trimesh
    colour: str
    poses: list[Array]
    """Homogeneous matrices, (4, 4) [m]."""
    opacity: float = 1.0


def glb(design: Design, parts: Parts = "all", air: AirSurface | None = None) -> bytes:
    """Return a design, and air of it, as the content of a binary glTF file."""
    solids = list(_solids(design, parts))
    if air is not None:
        solids.append(Solid("air", air.mesh, palette.AIR, [np.eye(4)], opacity=0.3))
    scene = Scene(base_frame="world")
    scene.graph.update("platform", "world", matrix=pose_matrix(rotation(0, -math.pi / 2), np.zeros(3)))
    for solid in solids:
        mesh = solid.mesh.copy()
        mesh.visual = _material(solid)
        scene.geometry[solid.name] = mesh
        for i, pose in enumerate(solid.poses):
            node = f"{solid.name}_{i}"
            scene.graph.update(node, "platform", matrix=pose, geometry=solid.name)
    content: bytes = scene.export(file_type="glb")
    return content


def stl(design: Design, parts: Parts = "platform") -> bytes:
    """Return a design as the content of a binary STL file, in millimetres."""
    copies = [solid.mesh.copy().apply_transform(pose) for solid in _solids(design, parts) for pose in solid.poses]
    content: bytes = join(copies).apply_scale(1000).export(file_type="stl")
    return content


def _solids(design: Design, parts: Parts) -> Iterator[Solid]:
    """Yield what some parts of a design are made of."""
    module, at = design.task.module, platform(design)
    here = [pose_matrix(R, p) for R, p in zip(at.R, at.p, strict=True)]
    if parts != "airflow":
        yield Solid("frame", frame(module), palette.MODULE, here)
        yield Solid("rotors", join(rotor_discs(module)), palette.ROTOR, here)
        if rod := rod_of(design, at):
            tube = cone_sphere(rod.start, rod.radius, rod.end, rod.radius)
            yield Solid("rod", tube, palette.END_EFFECTOR, [np.eye(4)])
    if parts != "platform":
        yield Solid("airflow", airflow(module), palette.AIRFLOW, here, opacity=0.2)
    if parts == "all":
        for name, point, colour in (
            ("end_effector", at.end_effector, palette.END_EFFECTOR),
            ("centre_of_mass", at.p_com, palette.CENTRE_OF_MASS),
        ):
            radius = 0.2 * module.arm_length
            ball = cone_sphere(np.zeros(3), radius, np.zeros(3), radius)
            yield Solid(name, ball, colour, [pose_matrix(np.eye(3), point)])
        for number in range(len(design.task.exposure)):
            yield _region(design, number, at)


def _region(design: Design, number: int, at: Platform) -> Solid:
    """Return the region that a requirement keeps out of the airflow; of a cone, the surface that encloses it."""
    pieces = [shape for of, shape in shapes(design.task, at.p_e) if of == number]
    surface = join([region_mesh(shape, cone_slant(design, at)) for shape in pieces])
    opacity = 0.15 if isinstance(pieces[0], Cone) else 0.3
    here = [pose_matrix(np.eye(3), at.end_effector)]
    return Solid(f"exposure_{number}", surface, palette.EXPOSURE, here, opacity=opacity)


def _material(solid: Solid) -> TextureVisuals:
    """Return a colour as glTF holds it: in linear light, and seen from both sides."""
    linear = [_linear(int(solid.colour[k : k + 2], 16) / 255) for k in (1, 3, 5)]
    mode = "OPAQUE" if solid.opacity == 1 else "BLEND"
    material = PBRMaterial(
        name=solid.name,
        baseColorFactor=[*linear, solid.opacity],
        metallicFactor=0.0,
        roughnessFactor=0.8,
        alphaMode=mode,
        doubleSided=True,
    )
    return TextureVisuals(material=material)


def _linear(s: float) -> float:
    return float(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4)


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


def rotor_discs(module: Module, *, sides: int = SIDES) -> list[Trimesh]:
    """Return the rotor discs in the module frame."""
    body, l_arm = module.body, module.arm_length
    disc = trimesh.creation.cylinder(radius=body.rotor_radius, height=body.rotor_height, sections=sides)
    hubs = ((l_arm * math.cos(angle), l_arm * math.sin(angle), 0) for angle in ROTOR_ANGLES)
    return [disc.copy().apply_translation(hub) for hub in hubs]


def airflow(module: Module, *, sides: int = SIDES) -> Trimesh:
    """Return the airflow envelope in the module frame."""
    envelope, far = module.envelope, np.array([0.0, 0.0, -module.envelope.length])
    return cone_sphere(np.zeros(3), envelope.start_radius, far, envelope.end_radius, sides=sides)


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


def region_mesh(shape: Shape, slant: float) -> Trimesh:
    """Return the surface of a shape; of a cone out to a slant height."""
    match shape:
        case Capsule():
            return cone_sphere(np.array(shape.start), shape.radius, np.array(shape.end), shape.radius)
        case Polytope():
            convex_hull = hull(shape)
            return Trimesh(convex_hull.corners, convex_hull.triangles)
        case Cone():
            triangles = cone(shape, slant)
            return Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
