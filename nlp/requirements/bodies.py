"""Bodies that keep out of regions at the end-effector: an airflow envelope, a rod, balls around rigid parts.

Each is a function of local vectors, as symbols and as numbers, and knows its rows of the compiled search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlp.numbers.geometry import Swept
from nlp.requirements.statement import FROM_TIP, OF_PARTS, X_I, Y_I, Z_I, Kernel, LocalVector, RodRow
from nlp.symbols.clearance import Ball, ConeSphere
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.module import AirflowEnvelope
from topo_search.model.value import Vector

SHORT = 1e-9
"""A rod that is shorter has no direction [l_arm]."""


class Body(Protocol):
    """What a region keeps away, seen from the end-effector; hashable."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Local vectors y that it is a function of."""

    def symbols(self, y: Sequence[ca.SX]) -> ConeSphere | list[Ball]:
        """Return it as symbols: a body that is swept, or all of its balls."""

    def numbers(self, y: Sequence[Array]) -> list[Swept]:
        """Return all that it is made of as numbers, of m modules each."""

    def rows(self, kernels: tuple[Kernel, ...]) -> tuple[Kernel, ...]:
        """Return its rows of the compiled search, from a region's."""


class Air(NamedTuple):
    """The sizes of all envelopes [l_arm]."""

    length: float
    start_radius: float
    growth: float

    @classmethod
    def of(cls, task: ResolvedTask) -> Air:
        """Return those between the modules of a task."""
        return cls._in_units(task, task.module.envelope)

    @classmethod
    def at_regions(cls, task: ResolvedTask) -> Air:
        """Return those against the regions of a task."""
        return cls._in_units(task, task.module.region_envelope)

    @classmethod
    def _in_units(cls, task: ResolvedTask, air: AirflowEnvelope) -> Air:
        unit = Units.of(task).length
        return cls(air.length / unit, air.start_radius / unit, air.growth / unit)

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module's centre and axis."""
        return FROM_TIP, Z_I

    def symbols(self, y: Sequence[ca.SX]) -> ConeSphere:
        """Return the envelope of a module at o with the axis z."""
        o, z = y
        return ConeSphere(o, -self.length * z, self.start_radius, self.growth)

    def numbers(self, y: Sequence[Array]) -> list[Swept]:
        """Return the envelopes of modules at o with the axes z, shape (m, 3) each."""
        o, z = y
        return [Swept(o, -self.length * z, self.start_radius, self.growth)]

    def rows(self, kernels: tuple[Kernel, ...]) -> tuple[Kernel, ...]:
        """Return rows with these sizes."""
        return tuple(row._replace(envelope=(self.length, self.start_radius, self.growth)) for row in kernels)


class Rod(NamedTuple):
    """The sizes of a rod from a connector to the end-effector, which lacks its tip [l_arm]."""

    l_c: float
    radius: float
    tip: float

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module's centre, and the connector's direction in the place of its axis."""
        return FROM_TIP, Z_I

    def symbols(self, y: Sequence[ca.SX]) -> ConeSphere:
        """Return the rod of a module at q from the end-effector, from the connector in a direction."""
        q, outward = y
        start = q + self.l_c * outward
        skipped = self.tip / ca.norm_2(start) if self.tip else 0.0
        return ConeSphere(start, (skipped - 1) * start, self.radius)

    def numbers(self, y: Sequence[Array]) -> list[Swept]:
        """Return the rods of modules at q, shape (m, 3) each; a rod that is all tip has no length."""
        q, outward = y
        start = q + self.l_c * outward
        length = np.maximum(np.linalg.norm(start, axis=-1, keepdims=True), SHORT)
        return [Swept(start, (np.minimum(self.tip / length, 1.0) - 1) * start, self.radius)]

    def rows(self, kernels: tuple[Kernel, ...]) -> tuple[Kernel, ...]:
        """Return rows with these sizes."""
        return tuple(row._replace(rod=RodRow(radius=self.radius, tip=self.tip)) for row in kernels)


@dataclass(frozen=True)
class PartBalls:
    """The balls around a module's parts, seen from the end-effector or another module.

    Solid regions keep out of all airflow besides, so that the balls around what reaches out of a module's own
    airflow (`topo_search.model.room`) are all that is to be asked.
    """

    balls: tuple[tuple[Vector, float], ...]
    """Centres in the module's frame, and radii [l_arm]."""
    local_vectors = (FROM_TIP, X_I, Y_I, Z_I)

    @classmethod
    def of(cls, task: ResolvedTask) -> PartBalls:
        """Return those of a task's module."""
        cover, unit = task.part_cover, Units.of(task).length
        return cls(tuple((divide(o, unit), r / unit) for o, r in zip(cover.centres, cover.radii, strict=True)))

    def symbols(self, y: Sequence[ca.SX]) -> list[Ball]:
        """Return them as symbols."""
        q, *axes = y
        R = ca.horzcat(*axes)
        return [Ball(q + R @ ca.DM(centre), radius) for centre, radius in self.balls]

    def numbers(self, y: Sequence[Array]) -> list[Swept]:
        """Return them as numbers, of m modules each."""
        q, *axes = y
        R = np.stack(axes, axis=-1)
        return [Swept(q + R @ np.array(centre), np.zeros(3), radius) for centre, radius in self.balls]

    def rows(self, kernels: tuple[Kernel, ...]) -> tuple[Kernel, ...]:
        """Return one row of all balls, not one for each end of an envelope."""
        return (kernels[0]._replace(kind=OF_PARTS[kernels[0].kind]),)


def divide(vector: ArrayLike, unit: float) -> Vector:
    """Return a vector in other units, as numbers that hash."""
    x, y, z = (np.array(vector) / unit).tolist()
    return x, y, z
