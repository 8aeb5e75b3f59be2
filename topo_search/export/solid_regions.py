r"""Solid regions of a task as bodies of the world for MuJoCo: walls, panes, objects that platform and tip touch.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p_E | the end-effector in the pose of the keyframes, from which regions are stated | (3,) | m |
| a, theta | axis and half-angle of a cone, beyond which all is solid | (3,), | -, rad |
| n_k | inward normal of a half-space that touches the cone along a generator | (3,) | - |

Balls, capsules and hulls are themselves. What is beyond a plane is a plane of MuJoCo, which is solid all the way
down. What is beyond a cone is the union of SIDES such planes, n_k = sin(theta) a - cos(theta) e_k with e_k across
a: there the cone is wider than the task's by up to 1 / cos(pi / SIDES) - 1 = 0.2 % of its radius. Rod and tip
have no contact with a region that p_E is inside of, but with all others.
"""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from topo_search.export import palette
from topo_search.export.meshes import SIDES
from topo_search.export.physics import COLLISION
from topo_search.export.poses import Poses, rotation_to
from topo_search.export.regions import hull
from topo_search.export.xml_text import numbers, rgba
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.exposure import segment_of
from topo_search.model.shape import Capsule, Cone, Polytope, Shape
from verify.solid_regions import tip_distances

TOUCHES = 1e-7
"""Depth of p_E in a region up to which it touches the region rather than being inside [m]."""
SHOWN = 1.0
"""Half the edge of the square that is drawn of a plane [m]."""


def add_solid_regions(model: Element, asset: Element, world: Element, design: Design, at: Poses) -> bool:
    """Add every solid region as a body `exposure_K`, or `exposure_K_P` where it has several parts.

    Returns:
        Whether the end-effector begins on the surface of one of them, or nearer to it than the rod is thick.
    """
    met, distances = False, tip_distances(design)
    for number, requirement in enumerate(design.task.exposure):
        if not requirement.solid:
            continue
        for part, stated in enumerate(requirement.shapes):
            segment = segment_of(requirement, part)
            name = f"exposure_{number}" if segment is None else f"exposure_{number}_{segment}"
            shape = stated.at(at.p_E)
            body = SubElement(world, "body", name=name, pos=numbers(*at.p_E))
            _add(body, asset, name, shape)
            distance = distances[number, segment]
            if distance < -TOUCHES:
                contact = model.find("contact")
                contact = SubElement(model, "contact") if contact is None else contact
                SubElement(contact, "exclude", body1=name, body2="end_effector")
            elif distance <= design.task.end_effector.rod_radius:
                met = True
    return met


def _add(body: Element, asset: Element, name: str, shape: Shape) -> None:
    """Add the geometry of a shape, in metres from p_E."""
    look = {"rgba": rgba(palette.EXPOSURE, 0.3)}
    match shape:
        case Capsule() if shape.start == shape.end:
            place = {"type": "sphere", "pos": numbers(*shape.start), "size": numbers(shape.radius)}
            SubElement(body, "geom", {"name": name, **place, **look})
        case Capsule():
            place = {"type": "capsule", "fromto": numbers(*shape.start, *shape.end), "size": numbers(shape.radius)}
            SubElement(body, "geom", {"name": name, **place, **look})
        case Polytope():
            SubElement(asset, "mesh", name=name, vertex=numbers(*hull(shape).corners.ravel()))
            SubElement(body, "geom", {"name": name, "type": "mesh", "mesh": name, **look})
        case Cone():
            inward = _inward_normals(shape)
            plane = {"type": "plane", "pos": numbers(*shape.apex), "size": numbers(SHOWN, SHOWN, SHOWN), **look}
            if len(inward) == 1:
                SubElement(body, "geom", {"name": name, "zaxis": numbers(*inward[0]), **plane})
            else:
                for k, n_k in enumerate(inward):
                    side = {"name": f"{name}_side_{k}", "zaxis": numbers(*n_k), "group": COLLISION}
                    SubElement(body, "geom", {**side, **plane})


def _inward_normals(cone: Cone) -> Array:
    """Return the inward normals n_k of planes about a cone, (SIDES, 3); of a half-space its own, (1, 3)."""
    a, theta = np.array(cone.axis), math.radians(cone.half_angle_deg)
    if cone.half_angle_deg == 90.0:
        return a[None]
    angles = 2 * math.pi * np.arange(SIDES) / SIDES
    s, t, _ = rotation_to(a).T
    e = np.outer(np.cos(angles), s) + np.outer(np.sin(angles), t)
    return np.asarray(math.sin(theta) * a - math.cos(theta) * e)
