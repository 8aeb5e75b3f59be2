"""The rotors of a module as a table: where they are, where they blow, and how they turn.

Solver, audit and exports read it; nothing else says how many rotors a module has. Vectors are in its frame.

| symbol | meaning | shape | unit |
|---|---|---|---|
| q | number of a rotor, 0 to r - 1 | | |
| delta_q | its position | (3,) | l_arm |
| a_q | direction of its thrust | (3,) | |
| z, tilt | axis of the module, along the sum of all a_q; largest angle of an a_q with it | (3,), | , rad |
| k_f, k_tau | thrust and drag torque of a rotor over its input, by default | | N s^2, N m s^2 |
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from topo_search.model.arrays import PORT_DIRECTIONS, Array, Indices, read_only
from topo_search.model.kinds import Omitted, Positive, Vector
from topo_search.model.value import Broken, Value

UP = read_only([0.0, 0.0, 1.0])
SAME = 1e-9
"""Largest difference of two positions that count as one [l_arm], and of two directions."""

MOST_TILT_DEG = 20.0
"""Largest tilt of rotors whose jets one envelope about the module's axis encloses without its neighbours [deg]."""
X_ERROR = 1e-3
"""Largest deviation of rotors from an X [l_arm], [rad]: the precision of a data sheet."""


class ModuleRotor(Value):
    """Rotor of a module, a table of `[[module.rotors]]`."""

    position: Vector
    """From the module's centre, in its axes [m]."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction of its thrust, of any length."""
    spin: Literal[-1, 1]
    """1: counter-clockwise seen from the side that the thrust points to; -1: clockwise."""
    thrust_coefficient: Omitted[Positive] = None
    """Its k_f, if not the module's [N s^2]."""
    torque_coefficient: Omitted[Positive] = None
    """Its k_tau, if not the module's [N m s^2]."""
    max_thrust: Omitted[Positive] = None
    """Its largest thrust, if not the module's [N]."""
    radius: Omitted[Positive] = None
    """Radius of its disc, if not that of the module's body [m]."""

    def _broken_rules(self) -> Broken:
        if not math.hypot(*self.axis) > 1e-12:
            yield "axis", "must have a direction, but got the zero vector"


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
    """Torque of each rotor along its axis over k_tau times its input, shape (r,): negative if it turns
    counter-clockwise seen against its thrust."""
    gains: Array
    """Thrust of each rotor over k_f times its input, shape (r,)."""
    sizes: Array
    """Radii of the discs over the radius of the module's body, shape (r,)."""
    limits: Array
    """Largest thrusts of rotors with one of their own, shape (r,) [N]; 0: the module's."""

    @property
    def count(self) -> int:
        """r."""
        return len(self.drags)

    @property
    def positions(self) -> Array:
        """delta_q, shape (r, 3) [l_arm]."""
        return np.asarray(self.distances[:, None] * self.directions)

    @property
    def along_ports(self) -> Array:
        """Distances of the rotors from the module's centre towards each port, shape (r, 4) [l_arm]."""
        return np.asarray(self.positions @ PORT_DIRECTIONS.T)

    @property
    def across_ports(self) -> Array:
        """Horizontal distances of the rotors from each port's line, shape (r, 4) [l_arm]."""
        return np.abs(np.roll(self.along_ports, 1, axis=1))

    @property
    def span(self) -> float:
        """Largest distance of a rotor's centre from the module's axis, 1 for an X [l_arm]."""
        heights = self.distances * self.directions[:, 2]
        return float(np.sqrt(self.distances**2 - heights**2).max(initial=0.0))

    def torques(self, drag: float) -> Array:
        """Return the torques about the module's centre at unit thrust, shape (r, 3) [l_arm].

        Args:
            drag: k_tau / k_f [l_arm].
        """
        thrusts = self.gains[:, None] * np.cross(self.positions, self.axes)
        return np.asarray(thrusts + (drag * self.drags)[:, None] * self.axes)

    @property
    def spins(self) -> list[int]:
        """1 for rotors that turn counter-clockwise seen against their thrust, else -1, shape (r,)."""
        return [-1 if drag > 0 else 1 for drag in self.drags]

    @property
    def is_uniform(self) -> bool:
        """True if all rotors have the module's coefficients, largest thrust and radius."""
        return bool(np.all(self.kinds == [1.0, 1.0, 1.0, 0.0]))

    @property
    def kinds(self) -> Array:
        """Factors on thrust, drag and radius of each rotor, and largest thrusts [N], shape (r, 4)."""
        return np.column_stack([self.gains, np.abs(self.drags), self.sizes, self.limits])

    @property
    def tilt(self) -> float:
        """Largest angle of a rotor's axis with the module's [rad]."""
        return float(np.arccos(np.clip(self.axes[:, 2], -1.0, 1.0)).max(initial=0.0))

    @property
    def has_own_jets(self) -> bool:
        """True if each rotor has an airflow envelope of its own."""
        return math.degrees(self.tilt) > MOST_TILT_DEG

    @property
    def jet_axes(self) -> tuple[Array, Array]:
        """Where the jet of each rotor starts far below, and the direction against it, shape (r, 3) each [l_arm].

        The rotors of a module have one jet, about its axis, unless each has its own.
        """
        if self.has_own_jets:
            return np.ascontiguousarray(self.positions), np.ascontiguousarray(self.axes)
        return np.zeros((self.count, 3)), np.tile(UP, (self.count, 1))

    def jet_radii(self, radii: Array) -> Array:
        """Return half the distance of opposite rotors, at least a radius, for the jet of each rotor, shape (r,).

        A jet's width far below is in these units. That of a rotor with its own jet is in radii.

        Args:
            radii: of the discs, shape (r,), in the unit of the result, l_arm.
        """
        return radii if self.has_own_jets else np.full(self.count, max(self.span, float(radii.max(initial=0.0))))

    def is_same_as(self, other: RotorTable) -> bool:
        """Return whether both have the same rotors in the same order."""
        tables = (self, other)
        mine, its = (np.column_stack([part.positions, part.axes, part.drags, part.kinds]) for part in tables)
        return mine.shape == its.shape and bool(np.abs(mine - its).max(initial=0.0) <= SAME)

    @property
    def is_parallel(self) -> bool:
        """True if all rotors blow along the module's axis."""
        return self.tilt <= X_ERROR

    @property
    def is_x(self) -> bool:
        """True for four parallel rotors in an X, for which the jet model was measured; whatever their spins."""
        X = x_quadrotor()
        return (
            self.count == X.count
            and self.is_uniform
            and self.is_parallel
            and bool(np.allclose(self.positions, X.positions, rtol=0.0, atol=X_ERROR))
        )

    @property
    def is_flat_quadrotor(self) -> bool:
        """True for four rotors along the module's axis, no farther than l_arm from its centre."""
        flat = self.tilt <= SAME and self.distances.max() <= 1 + SAME
        return self.count == x_quadrotor().count and self.is_uniform and bool(flat)

    def has_symmetry(self, Q: Array) -> bool:
        """Return whether a turn or a mirror maps the rotors onto each other; a mirror reverses spins."""
        if not self.count:
            return True
        images = self.images(Q)
        moved, turned = self.positions @ Q.T - self.positions[images], self.axes @ Q.T - self.axes[images]
        same_spins = np.linalg.det(Q) * self.drags - self.drags[images]
        kinds = self.kinds - self.kinds[images]
        return all(bool(np.abs(part).max() <= SAME) for part in (moved, turned, same_spins, kinds))

    def images(self, Q: Array) -> Indices:
        """Return the rotor that each one falls on if the module is turned or mirrored by Q, shape (r,)."""
        moved = self.positions @ Q.T
        return np.asarray(np.linalg.norm(moved[:, None] - self.positions, axis=2).argmin(axis=1))

    def arms(self, l_arm: float = 1.0) -> list[tuple[Array, float]]:
        """Return the axes of every arm as rows, along it, sideways and upwards, (3, 3), and its length.

        A rotor at the module's centre has no arm.
        """
        lengths = (l_arm * self.distances).tolist()
        return [
            (_arm_axes(along), length) for along, length in zip(self.directions, lengths, strict=True) if length
        ]


def _arm_axes(along: Array) -> Array:
    x, y, z = along
    if z == 0.0:
        return np.stack([along, np.cross(UP, along), UP])
    side = np.array([-y, x, 0.0]) / math.hypot(x, y) if math.hypot(x, y) > SAME else np.array([0.0, 1.0, 0.0])
    return np.stack([along, side, np.cross(along, side)])


@functools.lru_cache(maxsize=64)
def table_of(rotors: Sequence[ModuleRotor], l_arm: float, k_f: float, k_tau: float, R: float) -> RotorTable:
    """Return rotors as a table; a rotor at the module's centre has an arm of no length along x.

    Args:
        rotors: the rotors.
        l_arm: unit of lengths [m].
        k_f: thrust coefficient of rotors that have none of their own [N s^2].
        k_tau: same for the torque coefficient [N m s^2].
        R: same for the radius [m].
    """
    positions = np.array([rotor.position for rotor in rotors]).reshape(-1, 3) / l_arm
    axes = np.array([rotor.axis for rotor in rotors]).reshape(-1, 3)
    distances = np.linalg.norm(positions, axis=1)
    at_centre = distances <= SAME
    directions = (
        np.where(at_centre[:, None], [1.0, 0.0, 0.0], positions) / np.where(at_centre, 1.0, distances)[:, None]
    )
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    drags = [-rotor.spin * ((rotor.torque_coefficient or k_tau) / k_tau) for rotor in rotors]
    gains = [(rotor.thrust_coefficient or k_f) / k_f for rotor in rotors]
    sizes, limits = [(rotor.radius or R) / R for rotor in rotors], [rotor.max_thrust or 0.0 for rotor in rotors]
    distances = np.where(at_centre, 0.0, distances)
    return RotorTable(*map(read_only, (directions, distances, axes, drags, gains, sizes, limits)))


@functools.cache
def x_quadrotor() -> RotorTable:
    """Return four rotors in an X, one arm length from the centre, which turn in alternate senses."""
    corners = np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    ones = np.ones(len(corners))
    tables = corners / math.sqrt(2), ones, np.tile(UP, (len(corners), 1)), [-1.0, 1.0, -1.0, 1.0]
    return RotorTable(*map(read_only, (*tables, ones, ones, 0 * ones)))
