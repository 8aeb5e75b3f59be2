r"""The end-effector: its mass, its position and the rod that carries it.

| symbol | meaning | unit |
|---|---|---|
| m_E | mass | kg |
| p_E | position from the platform COM | m |
| L | length of the rod, a tube clamped at its connector | m |
| E | elastic modulus of the rod | Pa |
| r, A, I | radius, area and second moment of area of its section | m, m^2, m^4 |
| F, M | largest force and torque at its tip, both across it | N, N m |
| w | weight per length | N/m |

The deflection of the tip of such a cantilever is

.. math:: \delta(L) = \frac{F L^3}{3 E I} + \frac{M L^2}{2 E I} + \frac{w L^4}{8 E I}, \qquad
   I = \tfrac{\pi}{4} (r^4 - r_i^4) = \tfrac{A}{4} (2 r^2 - A / \pi)

(Gere and Timoshenko, *Mechanics of Materials*, table of deflections of cantilever beams).
"""

import math
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.exposure import Direction
from topo_search.model.kinds import Flag, Index, NonNegative, Omitted, OneOf, Positive, Vector, omit_if
from topo_search.model.value import Broken, Value, show

TIP = 2.0
"""Length of a rod's tip [rod radii]."""

Position = Annotated[Literal["free"] | Literal["com"] | Vector, OneOf('must be "free", "com" or [x, y, z]')]
RodAxis = Annotated[Literal["force"] | Direction, OneOf('must be "force" or [x, y, z]')]
Reach = Annotated[Positive | Literal[False], OneOf("must be a length in metres or false")]


class Mount(Value):
    """Connector from which a straight rod carries the end-effector."""

    module: Index
    port: Annotated[int, Field(strict=True, ge=0, le=3)]
    """0..3 for +x, +y, -x, -y."""

    @property
    def words(self) -> str:
        """Name of the connector."""
        return f"port {self.port} of module {self.module}"


class CountedRod(Mount):
    """Rod of a design whose weight counts in the load cases, and its connector."""

    mass: NonNegative
    """Mass of the rod [kg]."""


class EndEffector(Value):
    """Rigid end-effector."""

    mass: NonNegative = 0.048
    """m_E [kg]."""
    position: Position = "free"
    """`free`: optimised; `com`: at the centre of mass; [x, y, z]: fixed, from the COM [m]."""
    exclusion: Flag = True
    """True if p_E must be at least connector_distance from every module's centre."""
    stand_off: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Minimum distance of p_E from every module's centre, if larger than the exclusion [m]."""
    rod: Literal["none", "straight"] = "straight"
    """`straight`: requires a straight rod, clear of all parts and airflow; `none`: a missing rod is reported."""
    largest_reach: Reach | None = None
    """Largest distance of p_E from its rod's connector [m]; false: any. Default: the length at which the rod bends
    by rod_deflection, or four times the width of the modules packed in a square if that is less; only the latter
    for a fixed position."""
    rod_radius: Positive = 0.005
    """Radius of the rod that carries the end-effector [m]; default with small modules: thinner, so that brackets of
    their size hold it."""
    rod_linear_density: NonNegative = 0.045
    """Mass of the rod per metre [kg/m]; default: a carbon-fibre tube (1,600 kg/m^3) with a wall of a
    fifth of the radius."""
    rod_mass: Annotated[Literal["included", "ignored"], omit_if("ignored")] = "ignored"
    """`included`: the rod's mass counts in weight, centre of mass and inertia; `ignored`: it is massless."""
    counted_rod: Omitted[CountedRod] = None
    """Rod whose mass counts. Set in designs, not in tasks."""
    rod_modulus: Annotated[Positive, omit_if(70e9)] = 70e9
    """Elastic modulus of the rod in its axial direction [Pa]; default: a carbon-fibre tube."""
    rod_deflection: Annotated[Positive, omit_if(0.005)] = 0.005
    """Deflection of the rod's tip under the task's largest load and the rod's weight [m], which limits the
    default of largest_reach."""
    axis: Omitted[RodAxis] = None
    """Direction of the rod from its connector to p_E, in the task's axes; `force`: of the force at the end-effector
    in a load case; default: any."""
    axis_case: Omitted[str] = None
    """Name of the load case for `force`; default: the first with a force at the end-effector."""
    within_deg: Omitted[Annotated[float, Field(strict=True, gt=0, le=90)]] = None
    """Largest angle between the rod and its axis [deg]; default: 20."""

    def _broken_rules(self) -> Broken:
        if self.rod_mass == "included" and (self.rod == "none" or self.largest_reach is False):
            actual = 'rod = "none"' if self.rod == "none" else "largest_reach = false"
            yield "rod_mass", f'must be "ignored" with {actual}, but got "included"'
        if self.rod_mass == "ignored" and self.counted_rod is not None:
            yield "counted_rod", 'must be left out with rod_mass = "ignored"'
        if self.axis is not None and self.rod == "none":
            yield "axis", f'must be left out with rod = "none", but got {show(self.axis)}'
        if self.axis is None and self.within_deg is not None:
            yield "within_deg", f"must be left out without `axis`, but got {self.within_deg:g}"
        if self.axis != "force" and self.axis_case is not None:
            yield "axis_case", f'must be left out unless axis = "force", but got {show(self.axis_case)}'

    def stiff_length(self, force: float, torque: float, gravity: float) -> float:
        """Return the length at which the rod bends by `rod_deflection` [m]; infinite for a rod without stiffness.

        Args:
            force: largest force at the tip besides the end-effector's weight [N].
            torque: largest torque at the tip [N m].
            gravity: g [m/s^2].
        """
        laminate = 1600.0  # density of a carbon-fibre tube [kg/m^3]; with the mass per metre it gives the wall
        area = min(self.rod_linear_density / laminate, math.pi * self.rod_radius**2)
        stiffness = self.rod_modulus * area / 4 * (2 * self.rod_radius**2 - area / math.pi)
        if stiffness == 0.0:
            return math.inf
        # the length is less than those for force, torque and own weight alone
        loads = (torque / 2, 2), ((force + self.mass * gravity) / 3, 3), (self.rod_linear_density * gravity / 8, 4)
        shortest, length = 0.0, math.inf
        for amount, power in loads:
            if amount > 0.0:
                length = min(length, (self.rod_deflection * stiffness / amount) ** (1 / power))
        for _ in range(50):  # bisections, to machine precision
            middle = (shortest + length) / 2
            deflection = sum(amount * middle**power for amount, power in loads) / stiffness
            shortest, length = (middle, length) if deflection <= self.rod_deflection else (shortest, middle)
        return length

    @property
    def largest_angle_deg(self) -> float:
        """Largest angle between the rod and its axis, if it has one [deg]."""
        return self.within_deg or 20.0

    @property
    def fixed_position(self) -> Vector | None:
        """p_E [m] if the task fixes it."""
        if self.position == "free":
            return None
        return (0.0, 0.0, 0.0) if self.position == "com" else self.position


class ResolvedEndEffector(EndEffector):
    """End-effector of a design: fields that an older file lacks are not required."""

    rod: Literal["none", "straight"] = "none"
    """`straight`: a design needs a straight rod, clear of all parts and airflow; `none`: a missing
    rod is reported, not required."""
    largest_reach: Reach = False
    """Largest distance of p_E from the connector of its rod [m]; or false."""
