"""Airflow of a module: the envelope that rigid parts and other modules keep out of, and its jet far below.

| symbol | field | unit |
|---|---|---|
| r_air | start_radius | m |
| theta_air | spread_angle_deg | deg |
| l_air, dr_air | length of the envelope's axis, growth of its radius | m |
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

from pydantic import BeforeValidator, Field

from topo_search.model.kinds import Number, Omitted, OneOf, Positive, Vector, omit_if
from topo_search.model.value import Broken, Value


class Jet(Value):
    """Constants of the jet far below a module, in units of the distance of opposite rotors.

    At the depth s the speed on the axis is `decay` U_H / (s + `origin`), and half of that at the distance
    `half_width` (s + `origin`) from the axis; U_H is the induced speed of the discs. Defaults: arXiv 2403.13321.
    """

    decay: Positive = 10.11
    """Speed on the axis times the distance from the virtual origin, over U_H."""
    origin: Positive = 5.817
    """Height of the virtual origin above the rotors."""
    half_width: Positive = 0.0767
    """Growth rate of the radius at which the speed is half of that on the axis."""


class RegionAirflow(Value):
    """Airflow envelope of a module for target regions; default lengths scale with the module."""

    start_radius: Positive | None = None
    """Radius at the module's centre [m]; default: that between modules and rotor_radius, which encloses all
    slipstreams."""
    spread_angle_deg: Annotated[float, Field(strict=True, ge=0, le=90)] = 10.0
    """Full spreading angle [deg]."""
    reach: Positive | None = None
    """Distance from the module's centre to the far end [m]; default: same as between modules."""


Thrust = Annotated[
    Literal["hover", "full"] | Positive, OneOf('must be "hover", "full" or a thrust over the weight')
]


class Airflow(Value):
    """Airflow envelope of a module in a task file; default lengths scale with the arm."""

    start_radius: Positive | None = None
    """r_air: radius at the module's centre [m]; default: it holds all centres of rotors, arm_length in an X."""
    spread_angle_deg: Annotated[float, Field(strict=True, ge=0, le=90)] = 10.0
    """theta_air: full spreading angle of the jet; the tilt of `rotors` adds to it on each side [deg]."""
    reach: Positive | None = None
    """Distance from the module's centre to the far end of the envelope [m]; default: 20 arm_length / sqrt(2)."""
    jet: Annotated[Jet, omit_if(Jet())] = Jet()
    """Jet model for the air speeds of the audit; omitted from files where it has its defaults."""
    regions: Annotated[Omitted[RegionAirflow], BeforeValidator(lambda x: None if x is False else x)] = None
    """Envelope for target regions; without this table, or if false: same as between modules."""
    speed: Omitted[Positive] = None
    """Instead of `regions`: their envelope is the smallest cone-sphere around all air of a module at this speed or
    more [m/s]."""
    at: Annotated[Thrust, omit_if("hover")] = "hover"
    """Thrust of the module for `speed`: `hover`, `full`, or a thrust over the module's weight."""

    def _broken_rules(self) -> Broken:
        if self.speed is not None and self.regions is not None:
            yield "speed", "must be left out if `regions` is given"


class AirflowEnvelope(Value):
    """Cone-sphere of a module: union of balls centred on a segment, with linearly growing radius."""

    length: Number
    """l_air: length of the axis, along -z from the module's centre if nothing else is said [m]."""
    start_radius: Positive
    """r_air: radius at the module's centre [m]."""
    growth: Number
    """dr_air: growth of the radius along the axis [m]."""
    origin: Vector = (0.0, 0.0, 0.0)
    """Start of the axis, from the module's centre [m]."""
    upstream: Vector = (0.0, 0.0, 1.0)
    """Unit vector along the axis, against the flow."""

    @classmethod
    def of(cls, start_radius: float, spread_angle_deg: float, reach: float, **place: Vector) -> AirflowEnvelope:
        """Return the cone-sphere that ends at the distance `reach` from its origin; lengths in m."""
        growth_rate = math.tan(math.radians(spread_angle_deg) / 2)
        length = (reach - start_radius) / (1 + growth_rate)
        return cls(length=length, start_radius=start_radius, growth=length * growth_rate, **place)

    @property
    def end_radius(self) -> float:
        """Radius of the far ball [m]."""
        return self.start_radius + self.growth


class FilledAirflow(NamedTuple):
    """Envelope in terms of the fields of files, with all lengths filled in [m]."""

    start_radius: float
    spread_angle_deg: float
    reach: float
