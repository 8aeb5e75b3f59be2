"""Bodies that keep out of regions at the end-effector: an airflow envelope, a rod, balls around rigid parts.

Each is a function of local vectors, symbolic or numeric, and provides its rows of the compiled search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlp.numbers.geometry import Ball, Swept
from nlp.requirements.row_kinds import EnvelopeBody, JetBody, PartsBody, RodBody
from nlp.requirements.statement import FROM_TIP, X_I, Y_I, Z_I, LocalVector
from nlp.units import Units
from topo_search.model import AirflowEnvelope, Module, ResolvedTask, Vector

MIN_ROD_LENGTH = 1e-9
"""Length of a rod below which it has no direction [l_arm]."""


class Air(NamedTuple):
    """Airflow envelope of a module [l_arm]."""

    length: float
    start_radius: float
    growth: float

    @classmethod
    def of(cls, task: ResolvedTask, module: Module) -> Air | None:
        """Return the envelope that other modules keep out of; None without rotors."""
        return cls._in_units(task, module.envelope) if module.rotor_table.count else None

    @classmethod
    def at_regions(cls, task: ResolvedTask, module: Module) -> dict[int | None, Air | RotorJet]:
        """Return the envelopes of a module that keep out of regions, by rotor; by None if one is for all."""
        airs, unit = module.region_envelopes, Units.of(task).length
        sizes = [cls._in_units(task, air) for air in airs]
        if not module.rotor_table.has_own_jets:
            return dict.fromkeys([None] if sizes else [], *sizes)
        jets = (
            RotorJet(*size, divide(air.origin, unit), air.upstream) for size, air in zip(sizes, airs, strict=True)
        )
        return dict(enumerate(jets))

    @classmethod
    def _in_units(cls, task: ResolvedTask, air: AirflowEnvelope) -> Air:
        unit = Units.of(task).length
        return cls(air.length / unit, air.start_radius / unit, air.growth / unit)

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module's centre and axis."""
        return FROM_TIP, Z_I

    def solids(self, y: Sequence[Any]) -> list[Swept]:
        """Return the envelopes of modules at o with axes z, symbols or arrays of shape (m, 3)."""
        o, z = y
        return [Swept(o, -self.length * z, self.start_radius, self.growth)]

    @property
    def search_body(self) -> EnvelopeBody:
        """The body of the compiled search."""
        return EnvelopeBody(self.length, self.start_radius, self.growth)


class RotorJet(NamedTuple):
    """Airflow envelope of a rotor [l_arm]."""

    length: float
    start_radius: float
    growth: float
    origin: Vector
    upstream: Vector
    """Unit vector against the flow, in the module's frame as `origin`."""

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module's centre and axes."""
        return FROM_TIP, X_I, Y_I, Z_I

    def solids(self, y: Sequence[Any]) -> list[Swept]:
        """Return the envelopes of modules, as those of `Air`."""
        q, *axes = y
        o, upstream = (sum(a * axis for a, axis in zip(v, axes, strict=True)) for v in (self.origin, self.upstream))
        return [Swept(q + o, -self.length * upstream, self.start_radius, self.growth)]

    @property
    def search_body(self) -> JetBody:
        """The body of the compiled search."""
        return JetBody(*self)


class RodShape(NamedTuple):
    """Rod from a connector to the end-effector, without its tip [l_arm]."""

    l_c: float
    radius: float
    tip: float

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module's centre, and the connector's direction instead of the module's axis."""
        return FROM_TIP, Z_I

    def solids(self, y: Sequence[Any]) -> list[Swept]:
        """Return the rods of modules at q from the end-effector, from connectors in direction `outward`.

        A numeric rod that is nothing but tip has zero length.
        """
        q, outward = y
        start = q + self.l_c * outward
        tip_share: Any = 0.0
        if self.tip and isinstance(start, ca.SX):
            tip_share = self.tip / ca.norm_2(start)
        elif self.tip:
            length = np.maximum(np.linalg.norm(start, axis=-1, keepdims=True), MIN_ROD_LENGTH)
            tip_share = np.minimum(self.tip / length, 1.0)
        return [Swept(start, (tip_share - 1) * start, self.radius)]

    @property
    def search_body(self) -> RodBody:
        """The body of the compiled search, without its connector."""
        return RodBody(radius=self.radius, tip=self.tip)


@dataclass(frozen=True)
class PartBalls:
    """Balls around a module's parts, from the end-effector or from another module.

    If airflow stays out of solid regions as well, balls around the parts that reach out of a module's own airflow
    are enough (`ResolvedTask.part_cover`).
    """

    balls: tuple[tuple[Vector, float], ...]
    """Centres in the module's frame, and radii [l_arm]."""
    first: int
    """Number of the first of them, among those of all types of module."""
    local_vectors = (FROM_TIP, X_I, Y_I, Z_I)

    @classmethod
    def of(cls, task: ResolvedTask, module: Module) -> PartBalls:
        """Return the balls of a module."""
        covers, unit = {kind: task.part_cover(kind) for kind in task.types}, Units.of(task).length
        first = sum(len(covers[kind].radii) for kind in task.types[: task.types.index(module)])
        balls = zip(*covers[module], strict=True)
        return cls(tuple((divide(o, unit), r / unit) for o, r in balls), first)

    @property
    def search_body(self) -> PartsBody:
        """The body of the compiled search."""
        reach = max(math.sqrt(x * x + y * y + z * z) + radius for (x, y, z), radius in self.balls)
        return PartsBody(self.first, self.first + len(self.balls), reach)

    def solids(self, y: Sequence[Any]) -> list[Swept]:
        """Return the balls, symbolic or for m modules each."""
        q, X, Y, Z = y
        return [Ball(q + (a * X + b * Y + c * Z), radius) for (a, b, c), radius in self.balls]


AnyBody = Air | RotorJet | RodShape | PartBalls
"""Body that keeps out of a region at the end-effector; hashable."""


def divide(vector: ArrayLike, unit: float) -> Vector:
    """Return a vector divided by a unit, as a hashable tuple."""
    x, y, z = (np.array(vector) / unit).tolist()
    return x, y, z
