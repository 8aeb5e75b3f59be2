"""The bracket that holds two modules at a hinge angle, as the lab kit prints it; the search knows nothing of it.

| symbol | meaning | unit |
|---|---|---|
| c | the connector, l_c from both modules' centres: the middle of the bracket | |
| r | half width of a flange: bolt_circle / 2 + bolt_diameter / 2 + wall | m |
| d | set-back of the flanges' outer faces from c: r + thickness + wall | m |

A flange at d behind c and one at d beyond it, turned by any angle up to 90 deg about c, keep apart by more than a
wall. So the modules' mating faces are all alike, at l_c - d from their centres.
"""

from __future__ import annotations

import math
from typing import Self

from pydantic import model_validator

from topo_search.model.value import Positive, Value, refuse


class Bracket(Value):
    """Two square flanges with four bolts each, held by two webs."""

    bolt_circle: Positive = 0.024
    """Diameter of the bolt circle of a flange: four bolts, at 45 deg to the hinge's axis [m]."""
    bolt_diameter: Positive = 0.0032
    """Diameter of the bolt holes; default: for M3 [m]."""
    thickness: Positive = 0.004
    """Thickness of a flange [m]."""
    wall: Positive = 0.003
    """Wall thickness of the webs, and around bolts and rod [m]."""

    @model_validator(mode="after")
    def _bolts_apart(self) -> Self:
        if self.bolt_circle / math.sqrt(2) <= 2 * self.bolt_diameter:
            text = (
                "`bolt_circle > 2 sqrt(2) bolt_diameter` must hold, so that bolts leave room for each other, "
                "but got "
                f"bolt_circle = {self.bolt_circle}, bolt_diameter = {self.bolt_diameter}"
            )
            refuse("Bracket", (("bolt_circle",), text))
        return self

    @property
    def half_width(self) -> float:
        """r [m]."""
        return (self.bolt_circle + self.bolt_diameter) / 2 + self.wall

    @property
    def set_back(self) -> float:
        """d [m]."""
        return self.half_width + self.thickness + self.wall
