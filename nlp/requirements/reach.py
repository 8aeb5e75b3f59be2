"""How far the end-effector is from the connector that may hold its rod.

The nearest free connector is asked about: one is enough. Which of them a clear rod leads from is for the audit to
say, which measures that rod.

| symbol | meaning | unit |
|---|---|---|
| w | p_i + l_c e - p'_E: the connector of module i in direction e, from the end-effector | l_arm |
| L | largest reach | l_arm |
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import PORTS
from nlp.reduced.kinds import REACH, Kernel
from nlp.requirements.statement import TIP, LocalVector, PlatformVector, Requirement, VectorsByName
from nlp.symbols.smooth import log_sum_exp
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array


@dataclass(frozen=True)
class WithinReach:
    """A connector is no farther from the end-effector than the largest reach."""

    port: int
    l_c: float
    """[l_arm]"""
    largest: float
    """L."""
    of: int = 0
    """The module's place in the subject."""
    segment = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """The module from the end-effector, and the axis that the port lies on."""
        place, axis = PlatformVector("p", self.of), PlatformVector("xy"[self.port % 2], self.of)
        return LocalVector(place, TIP), LocalVector(axis)

    @property
    def _along(self) -> float:
        """Where the connector is on that axis."""
        return self.l_c if self.port < 2 else -self.l_c

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return (L^2 - ||w||^2) / (2 L), smooth everywhere and exact to first order at contact."""
        w = y[0] + self._along * y[1]
        return (self.largest**2 - ca.dot(w, w)) / (2 * self.largest)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return L - ||w||."""
        gap: Array = self.largest - np.linalg.norm(y[0] + self._along * y[1], axis=-1)
        return gap

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        x, y, z = (self.l_c * PORTS[self.port]).tolist()
        return (Kernel(REACH, (x, y, z), self.largest, of=self.of),)


@dataclass(frozen=True)
class AnyWithinReach:
    """Some free connector is; the subject has all modules."""

    connectors: tuple[WithinReach, ...]
    segment = None

    @cached_property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Those of each, in order."""
        return tuple(vector for one in self.connectors for vector in one.local_vectors)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp of all, which is at most the largest."""
        gaps = [one.smooth(of_one, beta) for one, of_one in zip(self.connectors, _pairs(y), strict=True)]
        return -log_sum_exp([-gap for gap in gaps], beta) - math.log(len(gaps)) / beta

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the largest."""
        gaps = [one.exact(of_one) for one, of_one in zip(self.connectors, _pairs(y), strict=True)]
        return np.asarray(np.max(gaps, axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return a row for each, of which that of the nearest counts."""
        return tuple(kernel for one in self.connectors for kernel in one.kernels())


@dataclass(frozen=True, eq=False)
class NearestConnector(Requirement):
    """A reach that any free connector may meet: a round of Ipopt holds the nearest one to it.

    It is never left out: where the effort is flat in the rod's length, nothing else keeps the end-effector near.
    """

    def restrict(self, vectors: VectorsByName) -> Requirement:
        """Return the nearest connector's alone."""
        (asked,) = self.formulas
        assert isinstance(asked, AnyWithinReach)
        columns = self.subjects.T
        y = [[vector.at(vectors, columns) for vector in one.local_vectors] for one in asked.connectors]
        gaps = [one.exact(of_one)[0] for one, of_one in zip(asked.connectors, y, strict=True)]
        nearest = asked.connectors[int(np.argmax(gaps))]
        return Requirement(self.equation, self.name, self.subjects, (nearest,), self.margin)


def reach_clearances(task: ResolvedTask, topology: Topology) -> Iterator[Requirement]:
    """Yield the reach of the rod where it is limited."""
    largest, unit = task.largest_reach(topology.n), Units.of(task).length
    if largest is None:
        return
    l_c, n = task.module.connector_distance / unit, topology.n
    formula = AnyWithinReach(
        tuple(WithinReach(port, l_c, largest / unit, i) for i, port in topology.free_connectors)
    )
    subjects = np.arange(max(n, 2))[None]  # never fewer than i and j
    yield NearestConnector(7, lambda *_: names.ROD, subjects, (formula,), task.search.margin / unit)


def _pairs(y: Sequence[Any]) -> list[Sequence[Any]]:
    """Return the local vectors of each connector, of those of all."""
    return [y[k : k + 2] for k in range(0, len(y), 2)]
