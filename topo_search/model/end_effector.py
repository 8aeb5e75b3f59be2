"""The end-effector: its mass, where it is, and the rod that carries it.

| symbol | meaning | unit |
|---|---|---|
| m_E | mass | kg |
| p_E | position from the platform COM | m |
"""

from __future__ import annotations

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
    """Largest distance of p_E from its rod's connector [m]; default: four times the width of the modules in a
    square; false: none."""
    rod_radius: Positive = 0.005
    """Radius of the rod that carries the end-effector [m]."""
    rod_linear_density: NonNegative = 0.045
    """Mass of the rod per metre [kg/m]; default: a carbon-fibre tube (1,600 kg/m^3) with a 1 mm wall."""

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
