"""What a simulator may have of a platform beyond the model of the search: motor lag, the rod's mass, contacts.

The rod's mass moves the centre of mass off the origin of the body `platform`, and no keyframe hovers any more: a
controller has to make up for it. A tip is a ball centred at the end-effector: as thick as the rod, but a point
where the end-effector begins on a solid region, lest it begin inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from topo_search.export import palette
from topo_search.export.poses import Poses
from topo_search.export.rod import Rod, mass_of
from topo_search.export.xml_text import numbers, rgba
from topo_search.model.design import Design
from topo_search.model.module import TIP

COLLISION = "3"
"""Group of geometries that are for contacts alone, which viewers do not show at first."""
POINT = 1e-5
"""Radius of a tip that begins on a solid region [m]."""


@dataclass(frozen=True)
class Physics:
    """What is asked for; by default the model of the search as it is."""

    motor_lag: float | None = None
    """Time constant of a rotor's thrust [s]; None: it follows at once."""
    rod_mass: bool = False
    """Whether the rod has its mass, `end_effector.rod_linear_density` a metre."""
    contacts: bool = False
    """Whether the end-effector has a tip that touches."""
    solid_regions: bool = False
    """Whether the solid regions of the task are there to be touched, in the world."""

    @property
    def about(self) -> str:
        """What the file says of itself, a line each."""
        lines = []
        if self.motor_lag is not None:
            lines.append(f"Thrusts follow their controls with a time constant of {self.motor_lag:g} s.")
        if self.rod_mass:
            lines.append("The rod has its mass, which the design leaves out: the centre of mass is not the origin.")
        if self.contacts:
            lines.append("The geometry `tip` stands for the end of the rod in contacts.")
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
        ends = numbers(*(back * rod.length), *(back * TIP * radius))
        hidden = {"group": COLLISION, "type": "cylinder", "size": numbers(radius), **look}
        SubElement(end_effector, "geom", {"name": "rod_contact", "fromto": ends, **hidden})
    size = numbers(POINT if on_solid else radius)
    SubElement(end_effector, "geom", {"name": "tip", "type": "sphere", "size": size, **look})
