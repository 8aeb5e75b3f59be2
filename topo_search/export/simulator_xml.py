r"""XML for simulators, and what MuJoCo may have of a platform beyond the model of the search.

The rod's mass moves the centre of mass off the origin of the body `platform`, and no keyframe hovers any more: a
controller has to make up for it. A tip is a ball centred at the end-effector: as thick as the rod, but a point
where the end-effector begins on a solid region, so that it does not begin inside.

Solid regions of a task are bodies of the world: walls, panes, objects that platform and tip touch.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p_E | end-effector in the pose of the keyframes, from which regions are measured | (3,) | m |
| a, theta | axis and half-angle of a cone, beyond which all is solid | (3,), | -, rad |
| n_k | inward normal of a half-space that touches the cone along a generator | (3,) | - |

Balls, capsules and hulls are themselves. What is beyond a plane is a plane of MuJoCo, which is solid all the way
down. What is beyond a cone is the union of SIDES such planes, n_k = sin(theta) a - cos(theta) e_k with e_k across
a: there the cone is wider than the task's by up to 1 / cos(pi / SIDES) - 1 = 0.2 % of its radius. Rod and tip
have no contact with a region that p_E is inside of, but with all others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from topo_search.export import palette
from topo_search.export.poses import Poses, Rod, hull, mass_of, rotation_to
from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.exposure import segment_of
from topo_search.model.module import TIP
from topo_search.model.shape import Capsule, Cone, Polytope, Shape
from verify.solid_regions import tip_distances

COLLISION = "3"
"""Group of geometries that are for contacts alone, which viewers do not show at first."""
POINT = 1e-5
"""Radius of a tip that begins on a solid region [m]."""


@dataclass(frozen=True)
class Physics:
    """Physics asked for; by default the model of the search as it is."""

    motor_lag: float | None = None
    """Time constant of a rotor's thrust [s]; None: it follows at once."""
    rod_mass: bool = False
    """True if the rod has its mass, `end_effector.rod_linear_density` per metre."""
    contacts: bool = False
    """True if the end-effector has a tip that can touch things."""
    solid_regions: bool = False
    """True if the solid regions of the task are in the world and can be touched."""

    @property
    def about(self) -> str:
        """Comments at the head of the file, one line each."""
        lines = []
        if self.motor_lag is not None:
            lines.append(f"Thrusts follow their controls with a time constant of {self.motor_lag:g} s.")
        if self.rod_mass:
            lines.append("The rod has its mass, which the design leaves out: the centre of mass is not the origin.")
        if self.contacts:
            lines.append("The geometry `tip` represents the end of the rod in contacts.")
        if self.solid_regions:
            lines.append("Bodies `exposure_K` are the solid regions of the task, where the keyframes meet them.")
        return "".join(f"{line}\n" for line in lines)


AS_SEARCHED = Physics()
"""Nothing beyond the model of the search."""


def add_lag(motor: dict[str, str], lag: float | None) -> dict[str, str]:
    """Return the attributes of an actuator whose output follows its control with a lag."""
    if lag is None:
        return motor
    return {**motor, "dyntype": "filterexact", "dynprm": numbers(lag), "actearly": "true"}


def add_rod_mass(platform: Element, rod: Rod, design: Design, at: Poses) -> None:
    """Add the rod's mass as a body of its own, the z axis along it."""
    weighs = mass_of(rod, design, at)
    v = (rod.end - rod.start) / rod.length
    along = float(v @ weighs.inertia @ v)
    across = (float(weighs.inertia.trace()) - along) / 2
    body = SubElement(platform, "body", name="rod_mass", pos=numbers(*weighs.middle), zaxis=numbers(*v))
    moments = numbers(across, across, min(along, 2 * across))  # as MuJoCo checks them; a stub is no thin tube
    SubElement(body, "inertial", pos="0 0 0", mass=numbers(weighs.mass), diaginertia=moments)


def add_tip(end_effector: Element, design: Design, rod: Rod | None, *, on_solid: bool) -> None:
    """Add what touches in place of the rod's picture: the rod without its end, and a ball there.

    Args:
        end_effector: the body that has it.
        design: the design.
        rod: its rod.
        on_solid: whether the end-effector begins on a solid region.
    """
    radius = design.task.end_effector.rod_radius
    look = {"rgba": rgba(palette.END_EFFECTOR), "mass": "0"}
    if rod is not None and rod.length > TIP * radius:
        back = (rod.start - rod.end) / rod.length
        endpoints = numbers(*(back * rod.length), *(back * TIP * radius))
        hidden = {"group": COLLISION, "type": "cylinder", "size": numbers(radius), **look}
        SubElement(end_effector, "geom", {"name": "rod_contact", "fromto": endpoints, **hidden})
    size = numbers(POINT if on_solid else radius)
    SubElement(end_effector, "geom", {"name": "tip", "type": "sphere", "size": size, **look})


def numbers(*values: float) -> str:
    """Return numbers with blanks between them; reading them again gives the same float64."""
    return " ".join(repr(float(value)) for value in values)


def rgba(colour: str, alpha: float = 1.0) -> str:
    """Return a colour like #d55e00 as shares of red, green, blue and opacity."""
    return numbers(*(int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)), alpha)


def xml_text(root: ElementTree.Element) -> str:
    """Return the text of an XML file; indents `root` in place."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"


SIDES = 48
"""Planes about a cone."""


def add_solid_regions(model: Element, asset: Element, world: Element, design: Design, at: Poses) -> bool:
    """Add every solid region as a body `exposure_K`, or `exposure_K_P` where it has several parts.

    Returns:
        Whether the end-effector begins on the surface of one of them, or nearer to it than the rod is thick.
    """
    met, distances = False, tip_distances(design)
    touching = 1e-7  # depth of p_E in a region up to which it touches the region rather than being inside [m]
    for number, exposure in enumerate(design.task.exposure):
        if not exposure.solid:
            continue
        for part, task_shape in enumerate(exposure.shapes):
            segment = segment_of(exposure, part)
            name = f"exposure_{number}" if segment is None else f"exposure_{number}_{segment}"
            shape = task_shape.at(at.p_E)
            body = SubElement(world, "body", name=name, pos=numbers(*at.p_E))
            _add(body, asset, name, shape)
            distance = distances[number, segment]
            if distance < -touching:
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
            geom = {"type": "sphere", "pos": numbers(*shape.start), "size": numbers(shape.radius)}
            SubElement(body, "geom", {"name": name, **geom, **look})
        case Capsule():
            geom = {"type": "capsule", "fromto": numbers(*shape.start, *shape.end), "size": numbers(shape.radius)}
            SubElement(body, "geom", {"name": name, **geom, **look})
        case Polytope():
            SubElement(asset, "mesh", name=name, vertex=numbers(*hull(shape).corners.ravel()))
            SubElement(body, "geom", {"name": name, "type": "mesh", "mesh": name, **look})
        case Cone():
            inward = _inward_normals(shape)
            # drawn 2 m wide
            plane = {"type": "plane", "pos": numbers(*shape.apex), "size": numbers(1, 1, 1), **look}
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
