"""A design as solids: GLB for viewers and Blender, STL for CAD and printing.

GLB holds a scene: a node for the frame, the rotors and the airflow envelope of every module, for each region at the
target, for the end-effector and the centre of mass. It is in metres, turned as glTF wants it, with y up. STL is one
surface in millimetres, because programs that read STL take its numbers for that, with z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from trimesh import Scene, Trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from topo_search.export import palette
from topo_search.export.meshes import cone_sphere, frame, join, pose_matrix, rotors
from topo_search.export.poses import Poses, poses, rod_of
from topo_search.export.regions import cone_slant, mesh, shapes
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.shape import Cone
from verify.kinematics import rotation

Parts = Literal["all", "platform", "airflow"]
"""Which solids to write: `all` adds to platform and airflow the regions and marks at the target."""

MARK = 0.2
"""Radius of the balls at the end-effector and the centre of mass [l_arm]."""
MILLIMETRES = 1000.0


@dataclass(frozen=True)
class Solid:
    """A mesh, and wherever it appears."""

    name: str
    mesh: Trimesh
    colour: str
    poses: list[Array]
    """Homogeneous matrices, (4, 4) [m]."""
    opacity: float = 1.0


def glb(design: Design, parts: Parts = "all") -> bytes:
    """Return a design as the content of a binary glTF file."""
    scene = Scene(base_frame="world")
    scene.graph.update("platform", "world", matrix=pose_matrix(rotation(0, -math.pi / 2), np.zeros(3)))
    for solid in _solids(design, parts):
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
    content: bytes = join(copies).apply_scale(MILLIMETRES).export(file_type="stl")
    return content


def _solids(design: Design, parts: Parts) -> Iterator[Solid]:
    """Yield what some parts of a design are made of."""
    module, at = design.task.module, poses(design)
    here = [pose_matrix(R, p) for R, p in zip(at.R, at.p, strict=True)]
    if parts != "airflow":
        yield Solid("frame", frame(module), palette.MODULE, here)
        yield Solid("rotors", rotors(module), palette.ROTOR, here)
        if rod := rod_of(design, at):
            tube = cone_sphere(rod.start, rod.radius, rod.end, rod.radius)
            yield Solid("rod", tube, palette.END_EFFECTOR, [np.eye(4)])
    if parts != "platform":
        envelope, far = module.envelope, np.array([0.0, 0.0, -module.envelope.length])
        volume = cone_sphere(np.zeros(3), envelope.start_radius, far, envelope.end_radius)
        yield Solid("airflow", volume, palette.AIRFLOW, here, opacity=0.2)
    if parts == "all":
        for name, place, colour in (
            ("end_effector", at.end_effector, palette.END_EFFECTOR),
            ("centre_of_mass", at.p_com, palette.CENTRE_OF_MASS),
        ):
            ball = cone_sphere(np.zeros(3), MARK * module.arm_length, np.zeros(3), MARK * module.arm_length)
            yield Solid(name, ball, colour, [pose_matrix(np.eye(3), place)])
        for number in range(len(design.task.exposure)):
            yield _region(design, number, at)


def _region(design: Design, number: int, at: Poses) -> Solid:
    """Return the region that a requirement keeps out of the airflow; of a cone, the surface that encloses it."""
    own = [shape for of, shape in shapes(design.task, at.p_E) if of == number]
    surface = join([mesh(shape, cone_slant(design, at)) for shape in own])
    opacity = 0.15 if isinstance(own[0], Cone) else 0.3
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
    """Return the linear light of a component of an sRGB colour (IEC 61966-2-1)."""
    return float(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4)
