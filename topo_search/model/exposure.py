"""Exposure requirements: regions at the target that the airflow must not reach (paper, Sec. III).

Points are in metres from the end-effector p_E, in the axes of the task frame.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, Tag, model_validator

from topo_search.model.value import NonEmpty, Positive, Value, Vector, is_zero, one_of, refuse


def _has_direction(vector: Vector) -> Vector:
    if is_zero(vector):
        raise ValueError("must have a direction")
    return vector


Direction = Annotated[Vector, AfterValidator(_has_direction)]
Axis = Annotated[
    Annotated[Literal["com"], Tag("<com>")] | Annotated[Direction, Tag("<list>")],
    one_of('must be "com" or [x, y, z]'),
]


class Local(Value):
    """A ball around the end-effector that no envelope may enter."""

    kind: Literal["local"] = "local"
    radius: Positive = 0.15
    """r_sph [m]."""


class Directional(Value):
    """Capsules along motion paths that start at the end-effector; no envelope may enter any of them."""

    kind: Literal["directional"] = "directional"
    radius: Positive = 0.15
    """r_sph [m]."""
    segments: Annotated[tuple[Direction, ...], NonEmpty] | None = None
    """The end of each path, from p_E [m]."""
    along: Literal["end_effector"] | None = None
    """In place of segments: one path along p_E, away from the COM."""
    length: Positive | None = None
    """Length of the path along p_E [m]."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        given = [name for name in ("segments", "along", "length") if getattr(self, name) is not None]
        if given not in (["segments"], ["along", "length"]):
            but = " and ".join(given) or "neither"
            refuse("Directional", ((), f"must have either `segments` or `along` with `length`, but got {but}"))
        return self


class Exterior(Value):
    """Everything outside an infinite cone with its apex at p_E; all envelopes stay inside the cone."""

    kind: Literal["exterior"] = "exterior"
    half_angle_deg: Annotated[float, Field(strict=True, gt=0, le=90)] = 60.0
    """theta_con [deg]; at 90 the cone is a half-space."""
    axis: Axis = "com"
    """d_con: from p_E into the allowed cone; `com` points from p_E to the centre of mass."""


Exposure = Annotated[Local | Directional | Exterior, Field(discriminator="kind")]
"""One exposure requirement."""


LEAST_OFFSET = 0.1
"""Least ||p_E|| where a requirement takes its direction from p_E [l_arm]."""


def needs_offset(requirement: Local | Directional | Exterior) -> bool:
    """Whether a requirement's direction is p_E itself, so that it is undefined at p_E = 0."""
    if isinstance(requirement, Directional):
        return requirement.along is not None
    return isinstance(requirement, Exterior) and requirement.axis == "com"
