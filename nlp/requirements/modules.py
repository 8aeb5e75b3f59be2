"""Clearances between modules: airflow, bodies, parts out of airflow; (4) to (6) of the printed problem."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby
from typing import TypeVar

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.geometry import Swept
from nlp.numbers.geometry import clearance as exact_clearance
from nlp.requirements.bodies import Air, PartBalls
from nlp.requirements.row_kinds import AirflowObstacle, ModuleObstacle, SearchRow
from nlp.requirements.statement import FROM_J, Z_J, Distance, LocalVector, Requirement, Subjects
from nlp.symbols.clearance import clearance, clearance_of_all
from nlp.units import Units
from topo_search.model import Array, Module, ResolvedTask, Topology

BETWEEN_MODULES = (4, 5, 6)
"""Equation numbers of the clearances between modules, which depend on hinges only."""
NEAR_ENVELOPE = 6.0
"""Clearance of envelopes below which a round of Ipopt has a row for them [l_arm]."""
NEAR_PARTS = 0.3
"""Clearance of parts and the airflow of an unbolted module below which a round has a row for them [l_arm].

If envelopes must not merge, few parts of an otherwise feasible design come that close, so most rounds need no more
rows than these. If they may merge, or a module has none, NEAR_ENVELOPE is used instead.
"""


@dataclass(frozen=True)
class AirflowClearance:
    """The airflow envelope of module i, or the balls around its parts, keeps out of the airflow of module j."""

    body: Air | PartBalls
    air: Air
    segment = None

    @property
    def local_vectors(self) -> tuple[LocalVector, ...]:
        """Local vectors of the body from module j, and the axis of module j."""
        return (FROM_J, *self.body.local_vectors[1:], Z_J)

    def smooth(self, y: Sequence[ca.SX], beta: ca.SX) -> ca.SX:
        """Return the paper's log-sum-exp over nine KKT candidates (Sec. III-A), or over those of all balls."""
        *vectors, z_j = y
        solids, (airflow,) = self.body.solids(vectors), self.air.solids([ca.SX.zeros(3), z_j])
        is_pair = isinstance(self.body, Air)
        return clearance(solids[0], airflow, beta) if is_pair else clearance_of_all(airflow, solids, beta)

    def exact(self, y: Sequence[Array]) -> Array:
        """Return the smallest gap, where f_air is smallest."""
        *vectors, z_j = y
        (airflow,), solids = self.air.solids([np.zeros(3), z_j]), self.body.solids(vectors)
        o, d = (np.array([getattr(solid, name) for solid in solids]) for name in "od")
        radii = np.array([(solid.r_0, solid.dr) for solid in solids]).T[:, :, None]
        return np.asarray(exact_clearance(Swept(o, d, *radii), airflow).min(axis=0))

    def search_rows(self) -> tuple[SearchRow, ...]:
        """Return one row."""
        return (SearchRow(self.body.search_body, AirflowObstacle(*self.air)),)


def module_clearances(task: ResolvedTask, topology: Topology) -> Iterator[Requirement]:
    """Yield (4), (5) and (6): without (4) if envelopes may merge; in the ablation only (5), for all pairs."""
    unit, airs = Units.of(task).length, _at_nodes(task, Air.of)
    margin, pairs = task.search.margin / unit, list(combinations(range(topology.n), 2))
    airflow, ablation = (task.search.interference == rule for rule in ("airflow", "separation"))
    if airflow:
        for group, formula in _clearances(pairs, airs, airs):
            yield Requirement(4, names.airflow, group, (formula,), margin, NEAR_ENVELOPE)
    distance = task.separation if ablation else task.centre_distance
    if distance is not None:
        separated = [pair for pair in pairs if ablation or pair not in topology.bolted]
        centres = Distance(FROM_J, distance / unit, ModuleObstacle)
        for enough, alike in groupby(separated, lambda pair: _centre_margin(task, int(topology.distances[pair]))):
            yield Requirement(5, names.separation, _pairs(list(alike)), (centres,), enough / unit)
    if task.parts_off_airflow:
        parts = _at_nodes(task, PartBalls.of)
        for group, formula in _clearances(topology.unbolted, parts, airs):
            near = NEAR_PARTS if airflow and airs[group[0, 0]] is not None else NEAR_ENVELOPE
            yield Requirement(6, names.rotor_airflow, group, (formula,), margin, near)


Body = TypeVar("Body")


def _at_nodes(task: ResolvedTask, body_of: Callable[[ResolvedTask, Module], Body]) -> list[Body]:
    """Return the body of each module, one object for all of a type."""
    at = {i: body for module, nodes in task.placed_types for body in [body_of(task, module)] for i in nodes}
    return [at[i] for i in range(task.n)]


def _clearances(
    pairs: Iterable[tuple[int, int]], bodies: Sequence[Air | PartBalls | None], airs: Sequence[Air | None]
) -> Iterator[tuple[Subjects, AirflowClearance]]:
    """Yield the pairs of modules with one clearance, and that clearance of a body from an envelope, if both are."""
    groups = dict[AirflowClearance, list[tuple[int, int]]]()
    for i, j in pairs:
        if (body := bodies[i]) is not None and (air := airs[j]) is not None:
            groups.setdefault(AirflowClearance(body, air), []).append((i, j))
    yield from ((_pairs(group), formula) for formula, group in groups.items())


def _centre_margin(task: ResolvedTask, hinges: int) -> float:
    """Return the margin of the centres of two modules with some hinges between them [m].

    To first order, a hinge's error moves two bodies closer by at most that angle times the arm of the line through
    their nearest points. The line passes both centres within half of their distance, and the nearer centre is at
    most l_c, 3 l_c, 5 l_c, ... from the hinge: k arms are at most ceil(k^2 / 2) l_c + k distance / 2 in total.
    """
    search, errors, distance = task.search, task.tolerances, task.centre_distance
    if search.centre_margin is None or distance is None:
        return search.margin
    arms = (hinges**2 + 1) // 2 * task.longest_connector + hinges * distance / 2
    taken = 2 * errors.position + math.radians(errors.hinge_angle_deg) * arms
    return min(search.margin, search.centre_margin + taken)


def _pairs(pairs: list[tuple[int, int]]) -> Subjects:
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)
