"""An airflow envelope as symbols and as numbers."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from nlp.numbers.geometry import Swept
from nlp.symbols.envelope import ConeSphere
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array


class Air(NamedTuple):
    """The sizes of all envelopes [l_arm]."""

    length: float
    start_radius: float
    growth: float

    @classmethod
    def of(cls, task: ResolvedTask) -> Air:
        """Return those of a task."""
        unit, air = Units.of(task).length, task.module.envelope
        return cls(air.length / unit, air.start_radius / unit, air.growth / unit)

    def symbol(self, o: ca.SX, z: ca.SX) -> ConeSphere:
        """Return the envelope of a module at o with the axis z."""
        return ConeSphere(o, -self.length * z, self.start_radius, self.growth)

    def number(self, o: Array, z: Array) -> Swept:
        """Return the envelopes of modules at o with the axes z, shape (m, 3) each."""
        return Swept(o, -self.length * z, self.start_radius, self.growth)
