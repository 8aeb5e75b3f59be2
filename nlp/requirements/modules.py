"""Clearances between modules: airflow, bodies, parts out of airflow; (4) to (6) of the printed problem."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements.bodies import Air, PartBalls
from nlp.requirements.statement import (
    AIR,
    APART,
    FROM_J,
    PARTS,
    Z_J,
    Distance,
    Kernel,
    LocalVector,
    Requirement,
    Subjects,
)
from nlp.symbols.clearance import clearance, clearance_of_all
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

BETWEEN_MODULES = (4, 5, 6)
"""Their numbers: clearances that hinges alone decide."""
NEAR_ENVELOPE = 6.0
"""Pairs of envelopes closer than this are kept apart in a round [l_arm]."""
BESIDE = 0.3
"""Parts nearer than this to the airflow of a module that is not bolted to theirs are kept out in a round [l_arm].

Where envelopes keep apart, few designs that meet all else have any in there, so that most rounds do well without
the others; where they may merge, it is NEAR_ENVELOPE.
"""


@dataclass(frozen=True)
class BesideAirflow:
    """The airflow envelope, or the balls around parts, of module i keep out of the airflow of module j."""

    body: Air | PartBalls
    air: Air
    segment = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Those of the body, seen from module j, and the axis of that."""
        return (FROM_J, *self.body.local_vectors[1:], Z_J)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates (Sec. III-A); of balls over those of all."""
        *seen, z_j = y
        solids, (airflow,) = self.body.solids(seen), self.air.solids([ca.SX.zeros(3), z_j])
        both = isinstance(self.body, Air)
        return clearance(solids[0], airflow, beta) if both else clearance_of_all(airflow, solids, beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the least gap, where f_air is least."""
        *seen, z_j = y
        (airflow,) = self.air.solids([np.zeros(3), z_j])
        return np.asarray(np.min([exact_clearance(solid, airflow) for solid in self.body.solids(seen)], axis=0))

    def kernels(self) -> tuple[Kernel, ...]:
        """Return one row."""
        return (Kernel(AIR if isinstance(self.body, Air) else PARTS),)


def module_clearances(task: ResolvedTask, topology: Topology) -> Iterator[Requirement]:
    """Yield (4), (5) and (6): without (4) where envelopes may merge; in the ablation (5) alone, of all pairs."""
    unit, air = Units.of(task).length, Air.of(task)
    margin, pairs = task.search.margin / unit, list(combinations(range(topology.n), 2))
    airflow, ablation = (task.search.interference == one for one in ("airflow", "separation"))
    if airflow:
        formulas = (BesideAirflow(air, air),)
        yield Requirement(
            4,
            lambda i, j, _: f"airflow of modules {i} and {j}",
            _pairs(pairs),
            formulas,
            margin,
            near=NEAR_ENVELOPE,
        )
    distance = task.separation if ablation else task.centre_distance
    if distance is not None:
        apart = [pair for pair in pairs if ablation or pair not in topology.bolted]
        formula = Distance(FROM_J, distance / unit, APART)
        yield Requirement(
            5, lambda i, j, _: f"separation of modules {i} and {j}", _pairs(apart), (formula,), margin
        )
    if task.parts_off_airflow:
        yield Requirement(
            6,
            lambda i, j, _: names.rotor_airflow(i, j),
            _pairs(list(topology.unbolted)),
            (BesideAirflow(PartBalls.of(task), air),),
            margin,
            near=BESIDE if airflow else NEAR_ENVELOPE,
        )


def _pairs(listed: list[tuple[int, int]]) -> Subjects:
    return np.array(listed, dtype=np.intp).reshape(-1, 2)
