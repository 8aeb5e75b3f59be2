"""Own constraints as rows of the problem, and as numbers at a point.

| symbol | meaning | shape |
|---|---|---|
| x | unknowns in the order of `nlp.problem.Variables` | (N,) |
| g | own expressions over their scales | (m,) |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from nlp.numbers.correction import correct
from nlp.numbers.evaluate import Violation, violations
from nlp.numbers.point import Point
from nlp.own.expressions import rows, scale_of, symbolic_platform
from nlp.own.joined import Assembled, JoinedProgram
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.protocols import OwnConstraint

TOLERANCE = 1e-6
"""By how much of its scale an own constraint may be missed: the audit's own tolerance for residuals."""
IMPOSED = 0.1
"""Share of that which Ipopt leaves of a bound, so that what it reaches to its tolerance is within it."""
OwnConstraints = tuple[OwnConstraint, ...]
"""What a user states; mostly nothing."""


def violations_of(point: Point, own: OwnConstraints) -> list[Violation]:
    """Return how far a point is from meeting everything: the printed problem, and own constraints."""
    return [*violations(point), *rows_of(own, point.task, point.topology).violations(point)]


def correct_point(point: Point, own: OwnConstraints) -> Point:
    """Return a point as a file can hold it; own constraints may bound inputs that cost nothing."""
    return correct(point, settled=len(point.task.declared.load_cases) if own else 0)


def rows_of(own: OwnConstraints, task: ResolvedTask, topology: Topology) -> OwnRows:
    """Return own constraints as rows; those of the last few programs are kept."""
    return _kept_rows(own, task, topology) if own else OwnRows((), task, topology)


class OwnRows:
    """The own constraints of one task and topology; there may be none."""

    def __init__(self, constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
        """Take them; symbols are built when they are first asked for."""
        self.constraints, self.task, self.topology = tuple(constraints), task, topology
        self._scales = [scale_of(constraint, task) for constraint in self.constraints]

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self.constraints)

    @cached_property
    def x(self) -> ca.SX:
        """The unknowns."""
        n, K = self.topology.n, len(self.task.load_cases)
        free = 3 if self.task.end_effector.fixed_position is None else 0
        return ca.SX.sym("x", n + 2 + free + 4 * n * K)

    @cached_property
    def g(self) -> ca.SX:
        """The rows of all constraints over their scales, as expressions of x."""
        platform = symbolic_platform(self.task, self.topology, self.x)
        return ca.vertcat(
            *(rows(one, platform) / scale for one, scale in zip(self.constraints, self._scales, strict=True))
        )

    @cached_property
    def counts(self) -> list[int]:
        """The number of rows of each constraint."""
        platform = symbolic_platform(self.task, self.topology, self.x)
        return [rows(one, platform).numel() for one in self.constraints]

    def draw(self, rng: np.random.Generator) -> Array:
        """Return random unknowns, small or large: angles to a right angle, p'_E as far as modules reach, inputs."""
        n, unit = self.topology.n, Units.of(self.task)
        first = self.x.numel() - 4 * n * len(self.task.load_cases)
        largest = np.full(self.x.numel(), 2.0)  # inputs: twice what hovers
        largest[: n + 2] = math.pi / 2
        largest[n + 2 : first] = 2 * n * self.task.module.connector_distance / unit.length
        kinds = [n + 2, first - n - 2, len(largest) - first]
        x = largest * np.repeat(10.0 ** rng.uniform(-2.0, 0.0, 3), kinds) * rng.uniform(-1.0, 1.0, len(largest))
        x[first:] = np.abs(x[first:])
        return np.asarray(x)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds on g; those of inequalities a little closer, so that they are met where Ipopt ends."""
        sides = []
        for sign, name in ((1.0, "lower"), (-1.0, "upper")):
            own = [getattr(one, name) / scale for one, scale in zip(self.constraints, self._scales, strict=True)]
            room = [
                one.upper - one.lower > 4 * TOLERANCE * s
                for one, s in zip(self.constraints, self._scales, strict=True)
            ]
            closer = [bound + sign * IMPOSED * TOLERANCE * wide for bound, wide in zip(own, room, strict=True)]
            sides.append(np.repeat(np.array(closer, dtype=float), self.counts))
        return sides[0], sides[1]

    @cached_property
    def values(self) -> ca.Function:
        """The rows as a function of the unknowns."""
        return ca.Function("own", [self.x], [self.g])

    def violations(self, point: Point) -> list[Violation]:
        """Return how far a point is from meeting each constraint."""
        if not self:
            return []
        values = np.asarray(self.values(point.pack()), dtype=float).ravel()
        parts = np.split(values, np.cumsum(self.counts)[:-1])
        return [
            _violation(one, scale, part)
            for one, scale, part in zip(self.constraints, self._scales, parts, strict=True)
        ]

    def append_to(self, program: Assembled) -> Assembled:
        """Return a program with these rows after its own."""
        return JoinedProgram(program, self) if self else program


def _violation(constraint: OwnConstraint, scale: float, values: Array) -> Violation:
    """Return how far values over their scale are from meeting a constraint; what is no number is farthest."""
    if not np.all(np.isfinite(values)):
        return Violation(f"{constraint.name} (no finite value)", scale, constraint.unit, math.nan, TOLERANCE)
    off = float(max(np.max(constraint.lower / scale - values), np.max(values - constraint.upper / scale)))
    return Violation(constraint.name, off * scale, constraint.unit, off, TOLERANCE)


@lru_cache(maxsize=32)
def _kept_rows(own: OwnConstraints, task: ResolvedTask, topology: Topology) -> OwnRows:
    return OwnRows(own, task, topology)
