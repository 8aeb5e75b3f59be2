"""A design as solids: GLB for viewers and Blender, STL for CAD and printing.

GLB holds a scene: a node for the frame, the rotors and the airflow envelope of every module, for each exposure
region, for the end-effector and for the centre of mass. It is in metres with y up, as glTF requires. STL holds one
surface with z up, in millimetres, which programs that read STL assume.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from topo_search.export import palette
from topo_search.export.poses import arms, cone_slant, kinds, rod_of, rotor_rotations, shapes
from topo_search.model import Array, Design, Module
from topo_search.model.mesh import SIDES, Mesh, cone_sphere, revolve
from verify.kinematics import Platform, platform, rotation

if TYPE_CHECKING:
    from topo_search.export.air_field import AirSurface

Parts = Literal["all", "platform", "airflow"]
"""Solids to write; `all` is platform, airflow, exposure regions, and marks of end-effector and centre of mass."""


@dataclass(frozen=True)
class MeshCopies:
    """A mesh and the poses of its copies."""

    name: str
    mesh: Mesh
    colour: str
    poses: list[Array]
    """Homogeneous matrices, (4, 4) [m]."""
    opacity: float = 1.0


def glb(design: Design, parts: Parts = "all", air: AirSurface | None = None) -> bytes:
    """Return a design, with `air` if given, as the content of a binary glTF file."""
    from trimesh import Scene, Trimesh  # slow to import, and pages need only the meshes

    solids = list(_solids(design, parts))
    if air is not None:
        surface = Mesh(air.mesh.vertices, air.mesh.faces)
        solids.append(MeshCopies("air", surface, palette.AIR, [np.eye(4)], opacity=0.3))
    scene = Scene(base_frame="world")
    scene.graph.update("platform", "world", matrix=pose_matrix(rotation(0, -math.pi / 2), np.zeros(3)))
    for solid in solids:
        scene.geometry[solid.name] = Trimesh(*solid.mesh, process=False, visual=_material(solid))
        for i, pose in enumerate(solid.poses):
            node = f"{solid.name}_{i}"
            scene.graph.update(node, "platform", matrix=pose, geometry=solid.name)
    content: bytes = scene.export(file_type="glb")
    return content


def stl(design: Design, parts: Parts = "platform") -> bytes:
    """Return a design as the content of a binary STL file, in millimetres."""
    from trimesh import Trimesh

    copies = [
        solid.mesh.move(pose[:3, :3], pose[:3, 3]) for solid in _solids(design, parts) for pose in solid.poses
    ]
    content: bytes = Trimesh(*join(copies), process=False).apply_scale(1000).export(file_type="stl")
    return content


def _solids(design: Design, parts: Parts) -> Iterator[MeshCopies]:
    """Yield the solids of the chosen parts of a design."""
    poses = platform(design)
    copies = [(kind, [pose_matrix(poses.R[i], poses.p[i]) for i in kind.nodes]) for kind in kinds(design)]
    if parts != "airflow":
        for kind, module_poses in copies:
            name = kind.name and f" of {kind.name}"
            yield MeshCopies(f"frame{name}", frame(kind.module), kind.colour, module_poses)
            if kind.module.rotor_table.count:
                discs = join(rotor_discs(kind.module))
                yield MeshCopies(f"rotors{name}", discs, palette.ROTOR, module_poses)
        if rod := rod_of(design, poses):
            tube = cone_sphere(rod.start, rod.radius, rod.end, rod.radius)
            yield MeshCopies("rod", tube, palette.END_EFFECTOR, [np.eye(4)])
    if parts != "platform":
        for kind, module_poses in copies:
            if kind.module.envelopes:
                name = "airflow" + (kind.name and f" of {kind.name}")
                yield MeshCopies(name, airflow(kind.module), palette.AIRFLOW, module_poses, opacity=0.2)
    if parts == "all":
        for name, point, colour in (
            ("end_effector", poses.end_effector, palette.END_EFFECTOR),
            ("centre_of_mass", poses.p_com, palette.CENTRE_OF_MASS),
        ):
            radius = 0.2 * design.task.module.arm_length
            ball = cone_sphere(np.zeros(3), radius, np.zeros(3), radius)
            yield MeshCopies(name, ball, colour, [pose_matrix(np.eye(3), point)])
        for number in range(len(design.task.exposure)):
            yield _region(design, number, poses)


def _region(design: Design, number: int, poses: Platform) -> MeshCopies:
    """Return the region of one exposure requirement; for a cone, the surface that must contain all airflow."""
    pieces = [shape for k, shape in shapes(design.task, poses.p_e) if k == number]
    surface = join([shape.mesh(cone_slant(design, poses)) for shape in pieces])
    opacity = 0.15 if pieces[0].contains_airflow else 0.3
    tip = pose_matrix(np.eye(3), poses.end_effector)
    return MeshCopies(f"exposure_{number}", surface, palette.EXPOSURE, [tip], opacity=opacity)


def _material(solid: MeshCopies) -> Any:
    """Return the material of a solid for glTF, whose colours are linear; visible from both sides."""
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    linear = [_linear(int(solid.colour[k : k + 2], 16) / 255) for k in (1, 3, 5)]
    look: Any = {
        "alphaMode": "OPAQUE" if solid.opacity == 1 else "BLEND",
        "baseColorFactor": [*linear, solid.opacity],
    }
    look |= {"metallicFactor": 0.0, "roughnessFactor": 0.8, "doubleSided": True}
    return TextureVisuals(material=PBRMaterial(name=solid.name, **look))


def _linear(s: float) -> float:
    return float(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4)


SAME_PLACE = 1e-9
"""Distance below which two points are one [l_arm]."""


def frame(module: Module) -> Mesh:
    """Return hub and arms, or the module's own frame, as closed shells that may intersect.

    Opposite arms are one bar: shells that share vertices would no longer be closed once vertices are merged.
    """
    w = module.body.arm_width
    if module.body.frame is not None:
        return join([Mesh(np.array(piece.vertices), np.array(piece.triangles)) for piece in module.body.frame])
    bars, positions = list[Mesh](), module.rotor_table.positions
    for q, arm in enumerate(arms(module)):
        if not arm.length:
            continue
        opposite = np.flatnonzero(np.linalg.norm(positions + positions[q], axis=1) < SAME_PLACE)
        if not len(opposite):
            bars.append(box((arm.length, w, w)).move(arm.R, arm.end / 2))
        elif q < opposite[0]:
            bars.append(box((2 * arm.length, w, w)).move(arm.R, np.zeros(3)))
    return join([box(module.body.hub), *bars])


def rotor_discs(module: Module, *, sides: int = SIDES) -> list[Mesh]:
    """Return the rotor discs in the module frame."""
    hubs = module.arm_length * module.rotor_table.positions
    discs = zip(module.rotor_radii.tolist(), rotor_rotations(module), hubs, strict=True)
    return [cylinder(radius, module.body.rotor_height, sides).move(turn, hub) for radius, turn, hub in discs]


def airflow(module: Module, *, sides: int = SIDES) -> Mesh:
    """Return the airflow envelopes of a module in its frame."""
    ends = ((np.array(air.origin), air.length * np.array(air.upstream), air) for air in module.envelopes)
    return join([cone_sphere(o, air.start_radius, o - path, air.end_radius, sides=sides) for o, path, air in ends])


def cylinder(radius: float, height: float, sides: int) -> Mesh:
    """Return a cylinder about z, with its middle at the origin."""
    top = height / 2
    return revolve(np.array([[0.0, -top], [radius, -top], [radius, top], [0.0, top]]), sides)


def box(size: Sequence[float]) -> Mesh:
    """Return a box of a size, (3,), with its middle at the origin."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    faces = "130 410 032 240 173 514 571 372 642 276 654 756"
    return Mesh(corners * size, np.array([[*map(int, face)] for face in faces.split()]))


def pose_matrix(R: Array, p: Array) -> Array:
    """Return the pose of a body as a homogeneous matrix, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one, each still a shell of its own."""
    vertices, faces = zip(*meshes, strict=True)
    first = np.cumsum([0, *map(len, vertices)])
    return Mesh(np.concatenate(vertices), np.concatenate([f + k for f, k in zip(faces, first, strict=False)]))
