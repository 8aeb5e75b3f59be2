"""Placement of a design at its target: load cases in which the rod pulls, and rotors near solid half-spaces.

| symbol | meaning | shape | unit |
|---|---|---|---|
| f | force at the end-effector in a load case | (3,) | N |
| rod | from its connector to the end-effector | (3,) | l_arm |
"""

import math
from collections.abc import Iterator

import numpy as np

from topo_search.model import Mount
from topo_search.model.exposure import solid_name
from topo_search.model.placement import NEAR_RADII, NearSolid, Placement, Pulling, must_pull
from verify.bodies import AllowedCone
from verify.kinematics import has_rotor, per_rotor
from verify.requirements import Scene
from verify.sections import Findings
from verify.solid_regions import solid_regions


def placement(found: Findings) -> Placement | None:
    """Return the remarks on a design's place at its target; None if there are none."""
    place = Placement(pulling=tuple(_pulling(found.scene, found.sheet.mount)), near=tuple(_near_solid(found.scene)))
    return None if place == Placement() else place


def _pulling(scene: Scene, mount: Mount | None) -> Iterator[Pulling]:
    """Yield load cases with more than 90 deg between rod and force, unless an object behind makes them pulls."""
    task = scene.design.task
    if mount is None or task.end_effector.rod == "none":
        return
    rod = scene.straight_rod(mount).path
    for name, case in zip(task.case_labels, task.load_cases, strict=True):
        f = np.array(case.at_end_effector.force)
        sizes = np.linalg.norm(rod) * np.linalg.norm(f)
        angle = math.degrees(math.acos(max(-1.0, rod @ f / sizes))) if sizes else 0.0
        if round(angle, 1) > 90 and not must_pull(task.exposure, f):
            yield Pulling(name=name, angle_deg=angle)


def _near_solid(scene: Scene) -> Iterator[NearSolid]:
    """Yield the solid half-spaces that are near rotors."""
    platform, task = scene.platform, scene.design.task
    radii = per_rotor(task.modules_of_nodes, lambda module: module.rotor_radii)
    rotors = scene.centres[:, None] + (platform.rotors - platform.o[:, None]) / scene.l_arm
    for number, contact, segment, region in solid_regions(scene):
        if not isinstance(region, AllowedCone) or region.half_angle_deg != 90:
            continue
        distances = scene.l_arm * np.abs(region.s(rotors))
        distances[~has_rotor(task)] = np.inf
        module, rotor = np.unravel_index(np.argmin(distances / np.where(radii, radii, 1.0)), distances.shape)
        nearest, radius = float(distances[module, rotor]), float(radii[module, rotor])
        if nearest <= NEAR_RADII * radius:
            yield NearSolid(
                name=solid_name(number, segment, contact),
                rotors=int((distances <= NEAR_RADII * radii).sum()),
                module=int(module),
                rotor=int(rotor),
                distance_m=nearest,
                radii=nearest / radius,
            )
