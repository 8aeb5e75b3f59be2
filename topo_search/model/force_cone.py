r"""A cone of forces that a platform must be able to exert, and the corners that cover it.

| symbol | meaning | shape |
|---|---|---|
| a, theta | the cone's axis, a unit vector, and its half-angle | (3,), rad |
| F | the largest force | |
| m | sides of the polygon that is put around the cone | |

Forces f with a . f <= F within a pyramid of m sides around the cone hold all of the cone's forces up to the size F:
their corners are zero and F (a + tan(theta) / cos(pi / m) e_j), with e_j at even angles across the axis. If all
corners can be produced, so can all between them: the wrenches of fixed angles are a convex set. So the cone is
covered with something to spare, a corner being sqrt(1 + tan(theta)^2 / cos(pi / m)^2) times F.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from topo_search.model.exposure import Direction
from topo_search.model.value import Positive, Value, Vector

SIDES = 8
"""m: with eight the pyramid is 8 % wider than the cone at its edges."""
WIDEST = 60.0
"""Beyond, corners would be more than twice as far out as the cone's own forces [deg]."""


class ForceCone(Value):
    """All forces up to a size within an angle of an axis."""

    axis: Direction
    """Of the cone, in the task frame."""
    half_angle_deg: Annotated[float, Field(strict=True, gt=0, le=WIDEST)]
    """theta [deg]."""
    force: Positive
    """F, the largest force, in the units of the load case."""

    @property
    def corners(self) -> tuple[Vector, ...]:
        """The corners that cover the cone, zero first, in the units of F."""
        a = np.array(self.axis) / math.hypot(*self.axis)
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        across /= np.linalg.norm(across)
        angles = 2 * np.pi / SIDES * np.arange(SIDES)
        e = np.multiply.outer(np.cos(angles), across) + np.multiply.outer(np.sin(angles), np.cross(a, across))
        out = math.tan(math.radians(self.half_angle_deg)) / math.cos(math.pi / SIDES)
        rim = self.force * (a + out * e)
        return ((0.0, 0.0, 0.0), *((float(x), float(y), float(z)) for x, y, z in rim))

    def scale(self, force_unit: float) -> ForceCone:
        """Return the cone with its force in another unit."""
        return self.model_copy(update={"force": self.force * force_unit})
