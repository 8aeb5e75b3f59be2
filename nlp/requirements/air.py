"""Counterparts of regions at the end-effector, as symbols and as numbers: an airflow envelope, a rod."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp.numbers.geometry import Swept
from nlp.requirements.kinds import Kernel
from nlp.symbols.envelope import ConeSphere
from nlp.units import Units
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.module import AirflowEnvelope

SHORT = 1e-9
"""A rod that is shorter has no direction [l_arm]."""


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

    def symbol(self, o: ca.SX, z: ca.SX) -> ConeSphere:
        """Return the envelope of a module at o with the axis z."""
        return ConeSphere(o, -self.length * z, self.start_radius, self.growth)

    def number(self, o: Array, z: Array) -> Swept:
        """Return the envelopes of modules at o with the axes z, shape (m, 3) each."""
        return Swept(o, -self.length * z, self.start_radius, self.growth)

    def add_sizes(self, row: Kernel) -> Kernel:
        """Return a row of the compiled search with these sizes."""
        return row._replace(connector=(self.length, self.start_radius, self.growth))


class Rod(NamedTuple):
    """The sizes of a rod from a connector to the end-effector, which lacks its tip [l_arm]."""

    l_c: float
    radius: float
    tip: float

    def symbol(self, q: ca.SX, outward: ca.SX) -> ConeSphere:
        """Return the rod of a module at q from the end-effector, from the connector in a direction."""
        start = q + self.l_c * outward
        skipped = self.tip / ca.norm_2(start) if self.tip else 0.0
        return ConeSphere(start, (skipped - 1) * start, self.radius)

    def number(self, q: Array, outward: Array) -> Swept:
        """Return the rods of modules at q, shape (m, 3) each; a rod that is all tip has no length."""
        start = q + self.l_c * outward
        length = np.maximum(np.linalg.norm(start, axis=-1, keepdims=True), SHORT)
        return Swept(start, (np.minimum(self.tip / length, 1.0) - 1) * start, self.radius)

    def add_sizes(self, row: Kernel) -> Kernel:
        """Return a row of the compiled search with these sizes."""
        return row._replace(radius=self.radius, tip=self.tip)
