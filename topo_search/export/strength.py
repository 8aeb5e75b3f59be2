r"""Strength of printed brackets under the loads of their joints in the load cases, as the audit computes them.

| symbol | meaning | unit |
|---|---|---|
| F, M_h, M_c | force of a joint; its moment about the hinge axis, and across it | N, N m |
| r, t, w | half width and thickness of a flange; thickness of a web | m |
| phi | turn of the bracket | rad |
| h | height of a web in the plane between the flanges, 2 r cos(phi/2) + t sin(phi/2) | m |
| s, l | distance of a bolt from the flange's middle lines; from the web beside it, r - w - s | m |
| P | largest force of a bolt | N |

Both webs are one section that bends about the hinge, and across it; a bolt bends the strip of the flange beside it:

.. math::

    \sigma_{web} = \frac{3 M_h}{w h^2} + \frac{3 M_c r}{2 h (r^3 - (r - w)^3)} + \frac{F}{2 w h}, \qquad
    P = \frac{M_h + M_c}{4 s} + \frac F 4, \qquad \sigma_{flange} = \frac{6 P l}{r t^2}

A bracket is printed lying on a web, so layers run along the webs, and the flanges bend across layers. Holes,
notches and fatigue are not in this estimate.
"""

import math
from typing import NamedTuple

from topo_search.export.brackets import bracket_turns
from topo_search.model.bracket import Bracket
from topo_search.model.design import Design
from verify.flight.joints import joint_loads
from verify.kinematics import platform

ALONG, ACROSS = 50e6, 25e6
"""Strength of printed PLA along its layers and across them [Pa]: low values of data sheets."""
ENOUGH = 2.0
"""Safety factor below which a kit warns."""


class Strength(NamedTuple):
    """Largest load of a joint, and the safety factor of its bracket."""

    force_N: float
    moment_Nm: float
    factor: float
    """Smallest strength over stress of all load cases; infinite without load."""


def strengths(design: Design) -> list[Strength]:
    """Return the strength of each joint's bracket, in the order of the joints."""
    at, sizes = platform(design), design.task.module.bracket_sizes
    holder = None if design.mount is None else design.mount.module
    cases = zip(design.task.load_cases, design.inputs, strict=True)
    loads = [[*joint_loads(design, at, case, u, "", holder)] for case, u in cases]
    return [
        Strength(
            max(load.force_N for load in joint),
            max(load.moment_Nm for load in joint),
            min(factor(sizes, phi, load.force_N, load.about_hinge_Nm, load.across_hinge_Nm) for load in joint),
        )
        for phi, *joint in zip(map(math.radians, bracket_turns(design)), *loads, strict=True)
    ]


def factor(sizes: Bracket, phi: float, F: float, M_h: float, M_c: float) -> float:
    """Return the safety factor of a bracket under a load; the symbols are those of the module's docstring."""
    r, t, w = sizes.half_width, sizes.thickness, sizes.wall
    h = 2 * r * math.cos(phi / 2) + t * math.sin(abs(phi) / 2)
    web = 3 * M_h / (w * h**2) + 3 * M_c * r / (2 * h * (r**3 - (r - w) ** 3)) + F / (2 * w * h)
    s = sizes.bolt_circle / 2 / math.sqrt(2)
    flange = 6 * ((M_h + M_c) / (4 * s) + F / 4) * (r - w - s) / (r * t**2)
    share = max(web / ALONG, flange / ACROSS)
    return 1 / share if share else math.inf
