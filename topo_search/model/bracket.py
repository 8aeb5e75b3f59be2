"""The bracket that holds two modules at a hinge angle, as printed by the lab kit; the search ignores it.

| symbol | meaning | unit |
|---|---|---|
| c | connector, l_c from both modules' centres: centre of the bracket | |
| r | half width of a flange: bolt_circle / 2 + bolt_diameter / 2 + wall | m |
| d | distance of the flanges' outer faces from c: r + thickness + wall | m |

Two flanges at the distance d from c, one on either side and turned about c by up to 90 deg, stay farther apart than
a wall thickness. So all mating faces of the modules are the same, at l_c - d from their centres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from topo_search.model.kinds import Positive
from topo_search.model.value import Broken, Value

HOLES = (0.0017, 0.0022, 0.0027, 0.0032, 0.0043, 0.0053, 0.0064, 0.0084)
"""Holes for bolts M1.6 to M8, fine series of ISO 273 [m]."""
USUAL_DISTANCE, USUAL_MASS = 0.15, 0.24
"""Connector distance [m] and mass [kg] of a module for which the defaults are made."""


class Bracket(Value):
    """Bracket: two square flanges with four bolts each, connected by two webs.

    The defaults of fields are for the default module; without a bracket of its own, a module has one of its size.
    """

    bolt_circle: Positive = 0.024
    """Diameter of the bolt circle of a flange [m]; four bolts, at 45 deg to the hinge axis."""
    bolt_diameter: Positive = 0.0032
    """Diameter of the bolt holes [m]; default: for M3."""
    thickness: Positive = 0.004
    """Thickness of a flange [m]."""
    wall: Positive = 0.003
    """Wall thickness of the webs, and around bolts and rod [m]."""

    @classmethod
    def of_module(cls, connector_distance: float, mass: float) -> Bracket:
        """Return the bracket for modules of a size and mass: scaled lengths, bolts of the next metric size up.

        The scale is that of the distance, or of the cube root of the mass if that is less.

        >>> Bracket.of_module(0.15, 0.24) == Bracket(), Bracket.of_module(0.065, 0.035).bolt_diameter
        (True, 0.0017)
        """
        default = cls()
        scale = min(connector_distance / USUAL_DISTANCE, (mass / USUAL_MASS) ** (1 / 3))
        smallest = default.bolt_diameter * scale
        hole = next((hole for hole in HOLES if hole >= smallest * (1 - 1e-9)), smallest)
        return cls(
            bolt_circle=max(default.bolt_circle * scale, 3 * hole),  # room between bolts
            bolt_diameter=hole,
            thickness=default.thickness * scale,
            wall=default.wall * scale,
        )

    @property
    def smaller(self) -> Iterator[Bracket]:
        """Brackets for each smaller metric bolt, largest first, all lengths scaled with its hole, to 0.1 mm."""
        for hole in reversed(HOLES):
            if hole < self.bolt_diameter:
                lengths = (self.bolt_circle, self.thickness, self.wall)
                circle, thickness, wall = (round(length * hole / self.bolt_diameter, 4) for length in lengths)
                yield Bracket(bolt_circle=circle, bolt_diameter=hole, thickness=thickness, wall=wall)

    def _broken_rules(self) -> Broken:
        if self.bolt_circle / math.sqrt(2) <= 2 * self.bolt_diameter:
            actual = f"bolt_circle = {self.bolt_circle}, bolt_diameter = {self.bolt_diameter}"
            rule = "`bolt_circle > 2 sqrt(2) bolt_diameter` must hold, so that bolts leave room for each other"
            yield "bolt_circle", f"{rule}, but got {actual}"

    @property
    def half_width(self) -> float:
        """r: half-width of a flange [m]."""
        return (self.bolt_circle + self.bolt_diameter) / 2 + self.wall

    @property
    def set_back(self) -> float:
        """d: distance of the flanges' outer faces from the connector [m]."""
        return self.half_width + self.thickness + self.wall
