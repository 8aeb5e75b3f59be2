"""Clearances between modules: airflow, bodies, parts out of airflow; (4) to (6) of the printed problem."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import Swept
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements.air import Air
from nlp.requirements.distance import Distance
from nlp.requirements.kinds import AIR, PARTS, Kernel
from nlp.requirements.kinds import APART as TWO_CENTRES
from nlp.requirements.statement import APART, X_I, Y_I, Z_I, Z_J, Requirement, Subjects
from nlp.symbols.envelope import Ball, clearance, clearance_of_all
from nlp.units import Units
from topo_search.model import Module, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.room import part_cover

BETWEEN_MODULES = (4, 5, 6)
"""Their numbers: clearances that hinges alone decide."""
NEAR = 6.0
"""Pairs of envelopes closer than this are kept apart in a round [l_arm]."""
BESIDE = 0.3
"""Parts nearer than this to the airflow of a module that is not bolted to theirs are kept out in a round [l_arm].

Few designs that meet all else have any in there, so that most rounds do well without the others.
"""


@dataclass(frozen=True)
class EnvelopePair:
    """Two airflow envelopes keep apart (paper, Sec. III-A)."""

    air: Air
    local_vectors = (APART, Z_I, Z_J)
    segment = None

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates."""
        w, z_i, z_j = y
        return clearance(self.air.symbol(w, z_i), self.air.symbol(ca.SX.zeros(3), z_j), beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the gap where f_air is least."""
        w, z_i, z_j = y
        return exact_clearance(self.air.number(w, z_i), self.air.number(np.zeros(3), z_j))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(AIR),)


@dataclass(frozen=True)
class PartsBeside:
    """Balls around the parts of module i keep out of the airflow of module j."""

    air: Air
    module: Module
    local_vectors = (APART, X_I, Y_I, Z_I, Z_J)
    segment = None

    @cached_property
    def _balls(self) -> tuple[Array, list[float]]:
        """Their centres in the module's frame, shape (b, 3), and radii [l_arm]."""
        cover, unit = part_cover(self.module), self.module.arm_length
        return cover.centres / unit, (cover.radii / unit).tolist()

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the log-sum-exp over all balls and KKT candidates."""
        w, *axes, z_j = y
        R = ca.horzcat(*axes)
        parts = [Ball(w + R @ ca.DM(place), radius) for place, radius in zip(*self._balls, strict=True)]
        return clearance_of_all(self.air.symbol(ca.SX.zeros(3), z_j), parts, beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least gap of all balls."""
        w, *axes, z_j = y
        R, still = np.stack(axes, axis=-1), np.zeros(3)
        envelopes, least = self.air.number(still, z_j), np.full(len(w), np.inf)
        for place, radius in zip(*self._balls, strict=True):
            least = np.minimum(least, exact_clearance(envelopes, Swept(w + R @ place, still, radius)))
        return least

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(PARTS),)


def module_clearances(task: ResolvedTask, topology: Topology) -> Iterator[Requirement]:
    """Yield (4), (5) and (6); in the ablation (5) alone, of all pairs."""
    unit, air = Units.of(task).length, Air.of(task)
    margin, pairs = task.search.margin / unit, list(combinations(range(topology.n), 2))
    airflow = task.search.interference == "airflow"
    if airflow:
        formulas = (EnvelopePair(air),)
        yield Requirement(4, lambda i, j, _: names.airflow(i, j), _pairs(pairs), formulas, margin, near=NEAR)
    distance = task.centre_distance if airflow else task.separation
    if distance is not None:
        apart = [pair for pair in pairs if not airflow or pair not in topology.bolted]
        formula = Distance(APART, distance / unit, TWO_CENTRES)
        yield Requirement(5, lambda i, j, _: names.separation(i, j), _pairs(apart), (formula,), margin)
    if task.body_clearance is not None:
        yield Requirement(
            6,
            lambda i, j, _: names.rotor_airflow(i, j),
            _pairs(list(topology.unbolted)),
            (PartsBeside(air, task.module),),
            margin,
            near=BESIDE,
        )


def _pairs(listed: list[tuple[int, int]]) -> Subjects:
    return np.array(listed, dtype=np.intp).reshape(-1, 2)
