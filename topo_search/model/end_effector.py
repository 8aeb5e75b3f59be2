r"""The end-effector: its mass, where it is, and the rod that carries it.

| symbol | meaning | unit |
|---|---|---|
| m_E | mass | kg |
| p_E | position from the platform COM | m |
| L | length of the rod, a tube clamped at its connector | m |
| E | its elastic modulus | Pa |
| r, A, I | its radius; area and second moment of area of its section | m, m^2, m^4 |
| F, M | largest force and torque at its tip, both across it | N, N m |
| w | its own weight | N/m |

The tip of such a cantilever is deflected by

.. math:: \delta(L) = \frac{F L^3}{3 E I} + \frac{M L^2}{2 E I} + \frac{w L^4}{8 E I}, \qquad
   I = \tfrac{\pi}{4} (r^4 - r_i^4) = \tfrac{A}{4} (2 r^2 - A / \pi)

(Gere and Timoshenko, *Mechanics of Materials*, table of deflections of cantilever beams).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, Tag

from topo_search.model.value import Flag, NonNegative, Positive, Value, Vector, one_of

TIP = 2.0
"""Length of a rod that counts as its tip, in radii of the rod."""

Position = Annotated[
    Annotated[Literal["free"], Tag("<free>")]
    | Annotated[Literal["com"], Tag("<com>")]
    | Annotated[Vector, Tag("<list>")],
    one_of('must be "free", "com" or [x, y, z]'),
]
Reach = Annotated[
    Annotated[Positive, Tag("<number>")] | Annotated[Literal[False], Tag("<false>")],
    one_of("must be a length in metres or false"),
]

BISECTIONS = 50
"""Of an interval of lengths, down to rounding."""
LAMINATE = 1600.0
"""Density of a carbon-fibre tube [kg/m^3]: with it a rod's wall follows from its mass per metre."""


class EndEffector(Value):
    """The rigid end-effector."""

    mass: NonNegative = 0.048
    """m_E [kg]."""
    position: Position = "free"
    """`free`: optimised; `com`: at the centre of mass; [x, y, z]: fixed, from the COM [m]."""
    exclusion: Flag = True
    """Whether p_E stays at least connector_distance away from every module's centre."""
    stand_off: Annotated[NonNegative, Field(exclude_if=lambda given: given == 0.0)] = 0.0
    """Least distance of p_E from every module's centre, if larger than the exclusion [m]."""
    rod: Literal["none", "straight"] = "straight"
    """`straight`: requires a straight rod, clear of all parts and airflow; `none`: a missing rod is only noted."""
    largest_reach: Reach | None = None
    """Largest distance of p_E from its rod's connector [m]; false: any. Default: the length at which the rod bends
    by rod_deflection, at most four times the width of the modules in a square; of a fixed position that alone."""
    rod_radius: Positive = 0.005
    """Radius of the rod that carries the end-effector [m]."""
    rod_linear_density: NonNegative = 0.045
    """Mass of the rod per metre [kg/m]; default: a carbon-fibre tube (1,600 kg/m^3) with a 1 mm wall."""
    rod_modulus: Annotated[Positive, Field(exclude_if=lambda given: given == 70e9)] = 70e9
    """Elastic modulus of the rod along it [Pa]; default: a carbon-fibre tube."""
    rod_deflection: Annotated[Positive, Field(exclude_if=lambda given: given == 0.005)] = 0.005
    """Deflection of the rod's tip under the task's largest load and the rod's weight [m] that limits the default of
    largest_reach."""

    def stiff_length(self, force: float, torque: float, gravity: float) -> float:
        """Return the length at which the rod bends by `rod_deflection` [m]; infinite for a rod without mass.

        Args:
            force: largest one at its tip besides the end-effector's weight [N].
            torque: largest one there [N m].
            gravity: g [m/s^2].
        """
        area = min(self.rod_linear_density / LAMINATE, math.pi * self.rod_radius**2)
        stiffness = self.rod_modulus * area / 4 * (2 * self.rod_radius**2 - area / math.pi)
        if stiffness == 0.0:
            return math.inf
        # force, torque and own weight each allow a length alone; together they allow a shorter one
        loads = (torque / 2, 2), ((force + self.mass * gravity) / 3, 3), (self.rod_linear_density * gravity / 8, 4)
        least, length = 0.0, math.inf
        for amount, power in loads:
            if amount > 0.0:
                length = min(length, (self.rod_deflection * stiffness / amount) ** (1 / power))
        for _ in range(BISECTIONS):
            middle = (least + length) / 2
            bent = sum(amount * middle**power for amount, power in loads) / stiffness
            least, length = (middle, length) if bent <= self.rod_deflection else (least, middle)
        return length

    @property
    def fixed_position(self) -> Vector | None:
        """p_E [m] if the task fixes it."""
        if self.position == "free":
            return None
        return (0.0, 0.0, 0.0) if self.position == "com" else self.position


class ResolvedEndEffector(EndEffector):
    """The end-effector of a design: what an older file does not state was not asked for."""

    rod: Literal["none", "straight"] = "none"
    """`straight`: a design needs a straight rod, clear of all parts and airflow; `none`: it is told where there is
    none."""
    largest_reach: Reach = False
    """Largest distance of p_E from the connector that holds its rod [m]; or false."""
