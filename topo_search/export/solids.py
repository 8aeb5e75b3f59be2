"""A design as solids: GLB for viewers and Blender, STL for CAD and printing.

GLB holds a scene: a node for the frame, the rotors and the airflow envelope of every module, for each exposure
region, for the end-effector and for the centre of mass. It is in metres with y up, as glTF requires. STL holds one
surface with z up, in millimetres, which programs that read STL assume.

| symbol | meaning | shape | unit |
|---|---|---|---|
| P_0, P_1, r_0, r_1 | centres and radii of two balls; their hull is a cone-sphere | (3,), (3,), , | m |
| L, a | length of its axis, and the axis from P_0 to P_1 | , (3,) | m, - |
| theta_t | angle between a and the normals of the conical part: cos(theta_t) = -(r_1 - r_0) / L | | rad |

Vertices lie on the true surface, so the mesh of a round volume lies inside it, by less than 0.3 % of its radius.
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
"""Solids to write; `all` is platform, airflow, exposure regions, and marks of end-effector and centre of mass."""

SIDES = 48
"""Sides of a circle: its sagitta is 0.21 % of the radius."""


@dataclass(frozen=True)
class Solid:
    """A mesh and the poses of its copies."""

    name: str
    mesh: Trimesh
    colour: str
    poses: list[Array]
    """Homogeneous matrices, (4, 4) [m]."""
    opacity: float = 1.0


def glb(design: Design, parts: Parts = "all", air: AirSurface | None = None) -> bytes:
    """Return a design, with `air` if given, as the content of a binary glTF file."""
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
    """Yield the solids of the chosen parts of a design."""
    module, poses = design.task.module, platform(design)
    module_poses = [pose_matrix(R, p) for R, p in zip(poses.R, poses.p, strict=True)]
    if parts != "airflow":
        yield Solid("frame", frame(module), palette.MODULE, module_poses)
        yield Solid("rotors", join(rotor_discs(module)), palette.ROTOR, module_poses)
        if rod := rod_of(design, poses):
            tube = cone_sphere(rod.start, rod.radius, rod.end, rod.radius)
            yield Solid("rod", tube, palette.END_EFFECTOR, [np.eye(4)])
    if parts != "platform":
        yield Solid("airflow", airflow(module), palette.AIRFLOW, module_poses, opacity=0.2)
    if parts == "all":
        for name, point, colour in (
            ("end_effector", poses.end_effector, palette.END_EFFECTOR),
            ("centre_of_mass", poses.p_com, palette.CENTRE_OF_MASS),
        ):
            radius = 0.2 * module.arm_length
            ball = cone_sphere(np.zeros(3), radius, np.zeros(3), radius)
            yield Solid(name, ball, colour, [pose_matrix(np.eye(3), point)])
        for number in range(len(design.task.exposure)):
            yield _region(design, number, poses)


def _region(design: Design, number: int, poses: Platform) -> Solid:
    """Return the region of one exposure requirement; for a cone, the surface that must contain all airflow."""
    pieces = [shape for k, shape in shapes(design.task, poses.p_e) if k == number]
    surface = join([region_mesh(shape, cone_slant(design, poses)) for shape in pieces])
    opacity = 0.15 if isinstance(pieces[0], Cone) else 0.3
    tip = pose_matrix(np.eye(3), poses.end_effector)
    return Solid(f"exposure_{number}", surface, palette.EXPOSURE, [tip], opacity=opacity)


def _material(solid: Solid) -> TextureVisuals:
    """Return the material of a solid for glTF, whose colours are linear; visible from both sides."""
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
    """Return hub and arms, or the module's own frame, as closed shells that may intersect.

    Opposite arms are one bar: shells that share vertices would no longer be closed once vertices are merged.
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
    """Return the hull of two balls: a capsule if the radii are equal, a ball if one ball contains the other."""
    a = P_1 - P_0
    L = float(np.linalg.norm(a))
    theta_t = math.acos(max(-1.0, min(1.0, (r_0 - r_1) / L))) if L else math.pi
    profile = np.concatenate([_arc(0.0, theta_t, r_1, L, sides), _arc(theta_t, math.pi, r_0, 0.0, sides)])
    profile[[0, -1], 0] = 0.0  # the poles lie on the axis
    size = max(r_0, r_1)  # trimesh merges vertices within 1e-8, so small bodies are built large
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
    """Return several meshes as one, each still a shell of its own."""
    mesh = trimesh.util.concatenate(meshes)
    assert isinstance(mesh, Trimesh)  # concatenate() may also return other classes
    return mesh


def _arc(start: float, end: float, r: float, height: float, sides: int) -> Array:
    """Return the profile of a ball between two polar angles; rows (distance from the axis, height)."""
    steps = max(2, math.ceil((end - start) / (2 * math.pi / sides)) + 1)
    theta = np.linspace(start, end, steps) if r and end > start else np.empty(0)
    return np.stack([r * np.sin(theta), height + r * np.cos(theta)], axis=1)


def region_mesh(shape: Shape, slant: float) -> Trimesh:
    """Return the surface of a shape; a cone is cut off at a slant height."""
    match shape:
        case Capsule():
            return cone_sphere(np.array(shape.start), shape.radius, np.array(shape.end), shape.radius)
        case Polytope():
            convex_hull = hull(shape)
            return Trimesh(convex_hull.corners, convex_hull.triangles)
        case Cone():
            triangles = cone(shape, slant)
            return Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
