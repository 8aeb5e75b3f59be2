"""Mass of a joint by its parts, as in kits: a bracket, two struts to the hubs, and their bolts.

Printed parts are solid PLA, bolts and nuts steel. Struts are taken as printed, whatever their length: kits have
lighter tubes for long ones, which about makes up for the rod's mount and its strut, which belong to no joint.
"""

import math

from topo_search.model.bracket import Bracket
from topo_search.model.module import Module

PLASTIC, STEEL = 1240.0, 7850.0
"""Densities of printed PLA and of bolts [kg/m^3]."""
DISC_CLEARANCE = 0.002
"""Distance of a strut from the adjacent rotor discs [m]."""


def joint_mass(module: Module) -> float:
    """Return the mass of a joint that is not folded, whose bracket is the largest [kg].

    >>> round(joint_mass(Module()), 4)
    0.0864
    """
    sizes = module.bracket_sizes
    r, t, w = sizes.half_width, sizes.thickness, sizes.wall
    flanges = 2 * (4 * r**2 - math.pi * sizes.bolt_diameter**2) * t
    printed, interfaces = flanges + 2 * (2 * sizes.set_back - 2 * t) * w * 2 * r, 2
    width = strut_width(module)
    for hub in module.body.hub[:2] if width else ():
        length = module.connector_distance - sizes.set_back - hub / 2
        if length > 2 * t:
            printed += flanges + (4 * width - w) * w * (length - 2 * t)
            interfaces += 1
    return PLASTIC * printed + 4 * interfaces * bolt_mass(*bolt_of(sizes.bolt_diameter, 2 * t))


def strut_width(module: Module) -> float:
    """Return half the width of a strut's cross [m]; 0 where rotors, or a custom frame, leave no room for struts."""
    radius, l_arm, rotors = module.body.rotor_radius, module.arm_length, module.rotor_table
    ahead = l_arm * rotors.along_ports > -radius
    room = float((l_arm * rotors.across_ports)[ahead].min(initial=math.inf)) - radius - DISC_CLEARANCE
    half_width = module.bracket_sizes.half_width
    if module.body.frame is not None or room <= half_width:
        return 0.0
    return min(module.body.arm_width / 2, half_width)


def tube_room(sizes: Bracket) -> float:
    """Return the largest radius of a tube whose socket on a flange leaves room for the nuts of its bolts [m]."""
    return sizes.bolt_circle / 2 - sizes.bolt_diameter - sizes.wall


def bolt_of(hole: float, grip: float) -> tuple[float, float]:
    """Return diameter and length of a metric bolt [mm], for a hole diameter and a clamped thickness [m]."""
    threads = (1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
    lengths = (4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100)
    d = max((thread for thread in threads if thread <= 1000 * hole), default=1000 * hole)
    shortest = 1000 * grip + 0.8 * d + 1  # a nut is 0.8 d high, and the bolt protrudes by 1 mm
    return d, next((length for length in lengths if length >= shortest), math.ceil(shortest))


def bolt_mass(d: float, length: float) -> float:
    """Return the mass of a bolt with its nut [kg], given diameter and length [mm]."""
    volume = math.pi / 4 * (d**2 * length + (1.8 * d) ** 2 * d + ((1.7 * d) ** 2 - d**2) * 0.8 * d)
    return STEEL * volume / 1000.0**3
