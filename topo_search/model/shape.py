"""The shapes that exposure requirements are made of: what airflow keeps out of, or stays inside.

Points are in metres from the end-effector p_E, in the axes of the task frame. Solver, symmetries and pictures look
at these shapes alone; the audit does not: it reads the requirements themselves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.value import Vector

NOWHERE: Vector = (0.0, 0.0, 0.0)


class Capsule(NamedTuple):
    """Balls along a segment, to be kept out of; a ball where the segment has no length."""

    radius: float
    start: Vector = NOWHERE
    end: Vector = NOWHERE
    length: float | None = None
    """In place of the end: the segment leads so far along p_E, away from the COM."""

    @property
    def takes_direction_from_com(self) -> bool:
        """Whether its direction is that of p_E from the COM."""
        return self.length is not None

    def at(self, p_E: Array) -> Capsule:
        """Return it with its end, where p_E is the end-effector from the COM, (3,)."""
        if self.length is None:
            return self
        return self._replace(end=_vector(self.length * _unit(p_E)), length=None)

    @property
    def farthest(self) -> float:
        """Distance of its farthest point from p_E [m]."""
        along = self.length or 0.0
        return self.radius + max(math.hypot(*self.start), math.hypot(*self.end), along)


class Polytope(NamedTuple):
    """The convex hull of points, to be kept out of."""

    corners: tuple[Vector, ...]

    @property
    def takes_direction_from_com(self) -> bool:
        """It has none."""
        return False

    def at(self, p_E: Array) -> Polytope:
        """Return it as it is."""
        return self

    @property
    def farthest(self) -> float:
        """Distance of its farthest point from p_E [m]."""
        return max(math.hypot(*corner) for corner in self.corners)


class Cone(NamedTuple):
    """An infinite cone, to be stayed inside; a half-space at 90 degrees."""

    half_angle_deg: float
    axis: Vector | None
    """Unit vector from the apex into the cone; None: to the COM."""
    apex: Vector = NOWHERE

    @property
    def takes_direction_from_com(self) -> bool:
        """Whether its axis points to the COM."""
        return self.axis is None

    def at(self, p_E: Array) -> Cone:
        """Return it with its axis, where p_E is the end-effector from the COM, (3,)."""
        return self if self.axis is not None else self._replace(axis=_vector(-_unit(p_E)))


Shape = Capsule | Polytope | Cone


def unit(direction: Vector) -> Vector:
    """Return a direction as a unit vector."""
    return _vector(np.array(direction) / math.hypot(*direction))


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    return vector / length if length else np.array([0.0, 0.0, 1.0])


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
