"""The rotors of a module as a table: where they are, where they blow, and how they turn.

Solver, audit and exports read it; nothing else says how many rotors a module has. Vectors are in its frame.

| symbol | meaning | shape | unit |
|---|---|---|---|
| q | number of a rotor, 0 to r - 1 | | |
| delta_q | its position | (3,) | l_arm |
| a_q | direction of its thrust | (3,) | |
| k_f, k_tau | thrust and drag torque of a rotor over its input | | N s^2, N m s^2 |
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topo_search.model.arrays import PORT_DIRECTIONS, Array, read_only

UP = read_only([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RotorTable:
    """The rotors of a module, one per row."""

    directions: Array
    """Unit vectors from the module's centre towards the rotors, shape (r, 3)."""
    distances: Array
    """Distances of the rotors from the centre, shape (r,) [l_arm]."""
    axes: Array
    """a_q, shape (r, 3)."""
    drags: Array
    """Torque of each rotor along its axis over k_tau times its input: -1 if it turns counter-clockwise seen against
    its thrust, shape (r,)."""

    @property
    def count(self) -> int:
        """r."""
        return len(self.drags)

    @property
    def positions(self) -> Array:
        """delta_q, shape (r, 3) [l_arm]."""
        return np.asarray(self.distances[:, None] * self.directions)

    @property
    def spacing(self) -> float:
        """Smallest distance of two rotors' centres; infinite for a single one [l_arm]."""
        apart = np.linalg.norm(self.positions[:, None] - self.positions, axis=2)
        return float(apart[~np.eye(self.count, dtype=bool)].min(initial=math.inf))

    @property
    def along_ports(self) -> Array:
        """Distances of the rotors from the module's centre towards each port, shape (r, 4) [l_arm]."""
        return np.asarray(self.positions @ PORT_DIRECTIONS.T)

    @property
    def across_ports(self) -> Array:
        """Horizontal distances of the rotors from each port's line, shape (r, 4) [l_arm]."""
        return np.abs(np.roll(self.along_ports, 1, axis=1))

    @property
    def heights(self) -> Array:
        """Distances of the discs from the module's centre along their axes, shape (r,) [l_arm]."""
        return np.asarray(np.sum(self.positions * self.axes, axis=1))

    @property
    def bearings(self) -> list[tuple[float, float]]:
        """Angle of each rotor from the module's x axis about z, and its elevation [rad]."""
        return [(math.atan2(y, x), math.atan2(z, math.hypot(x, y))) for x, y, z in self.directions.tolist()]

    def torques(self, drag: float) -> Array:
        """Return the torques about the module's centre at unit thrust, shape (r, 3) [l_arm].

        Args:
            drag: k_tau / k_f [l_arm].
        """
        return np.asarray(np.cross(self.positions, self.axes) + (drag * self.drags)[:, None] * self.axes)

    def images(self, Q: Array) -> NDArray[np.intp]:
        """Return the rotor that each one falls on if the module is turned or mirrored by Q, shape (r,)."""
        moved = self.positions @ Q.T
        return np.asarray(np.linalg.norm(moved[:, None] - self.positions, axis=2).argmin(axis=1))

    def orientations(self) -> list[Array]:
        """Return the smallest rotation from z to each axis, shape (3, 3) each."""
        return [_tilt(axis) for axis in self.axes]

    def arm_axes(self) -> list[Array]:
        """Return the axes of every arm as rows: along it, sideways, and upwards; shape (3, 3) each."""
        return [np.stack([along, np.cross(UP, along), UP]) for along in self.directions]


def _tilt(axis: Array) -> Array:
    x, y, z = axis
    if z < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    V = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with UP x axis
    return np.asarray(np.eye(3) + V + V @ V / (1 + z))


@functools.cache
def x_quadrotor() -> RotorTable:
    """Return four rotors in an X, one arm length from the centre, which turn in alternate senses."""
    corners = np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    tables = corners / math.sqrt(2), np.ones(len(corners)), np.tile(UP, (len(corners), 1)), [-1.0, 1.0, -1.0, 1.0]
    return RotorTable(*map(read_only, tables))
