"""Own constraints as rows of the problem, and as numbers at a point.

| symbol | meaning | shape |
|---|---|---|
| x | unknowns in the order of `nlp.problem.Variables` | (N,) |
| g | own expressions over their scales | (m,) |

The platform that a constraint gets consists of symbols or of numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from nlp.evaluation import Violation, correct, violations
from nlp.joints import LimitRows
from nlp.numbers.point import Point
from nlp.symbols.platform import Pose, poses, tip_and_com
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.protocols import OwnConstraint, SymbolicPlatform


def scale_of(constraint: OwnConstraint, task: ResolvedTask) -> float:
    """Return what counts as much of an own constraint, in its unit."""
    scales = {
        "m": task.module.arm_length,
        "N": task.force_unit(task.n),
        "N m": task.torque_unit(task.n),
        "rad^2/s^2": task.module.max_input(task.gravity),
    }
    return constraint.scale or scales.get(constraint.unit, 1.0)


def rows(constraint: OwnConstraint, platform: SymbolicPlatform) -> ca.SX:
    """Return the values of a constraint's expression as a column.

    Raises:
        ValueError: it is no expression, or none of the platform alone.
    """
    value = constraint.expression(platform)
    try:
        column = ca.vertcat(*map(ca.vec, map(ca.SX, value if isinstance(value, list | tuple) else [value])))
    except (NotImplementedError, TypeError) as error:
        got = type(value).__name__
        raise ValueError(f"{constraint.name}: must return a casadi.SX, or a list of them, but got {got}") from error
    if not column.numel():
        raise ValueError(f"{constraint.name}: must return one value or more, but got none")
    return column


def symbolic_platform(task: ResolvedTask, topology: Topology, x: ca.SX) -> SymbolicPlatform:
    """Return the platform that the unknowns describe."""
    n, K, unit, module = topology.n, len(task.load_cases), Units.of(task), task.module
    modules: list[Pose] = poses(topology, x[:3], x[3 : n + 2], module.connector_distance / unit.length)
    p_E, p_COM = tip_and_com(module, task.end_effector, topology, modules, x[n + 2 : n + 5])
    first = x.numel() - 4 * n * K
    return SymbolicPlatform(
        task=task.declared,
        topology=topology,
        centres=tuple((pose.p - p_COM) * unit.length for pose in modules),
        orientations=tuple(pose.R for pose in modules),
        end_effector=(p_E - p_COM) * unit.length,
        hinge_angles=x[3 : n + 2],
        inputs=tuple(
            x[first + 4 * n * k : first + 4 * n * (k + 1)] * unit.input
            for k in range(len(task.declared.load_cases))
        ),
    )


def platform_of(
    task: ResolvedTask,
    topology: Topology,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
    hinge_angles: Sequence[float],
    inputs: Sequence[Any],
) -> SymbolicPlatform:
    """Return a platform of numbers in the form that an own constraint takes; shapes as of `check_stated`."""
    return SymbolicPlatform(
        task=task,
        topology=topology,
        centres=tuple(ca.SX(ca.DM(o)) for o in centres),
        orientations=tuple(ca.SX(ca.DM(R)) for R in orientations),
        end_effector=ca.SX(ca.DM(end_effector)),
        hinge_angles=ca.SX(ca.DM(list(hinge_angles)).reshape((topology.n - 1, 1))),
        inputs=tuple(ca.SX(ca.DM(list(u_k))) for u_k in inputs),
    )


TOLERANCE = 1e-6
"""Tolerance of a user constraint, as a share of its scale: the audit's own tolerance for residuals."""
IMPOSED = 0.1
"""Share of that which Ipopt leaves of a bound, so that what it reaches to its tolerance is within it."""
UserConstraints = tuple[OwnConstraint, ...]
"""Constraints that a user states; usually none."""


def violations_of(point: Point, constraints: UserConstraints) -> list[Violation]:
    """Return how far a point is from meeting everything: the printed problem, and own constraints."""
    return [*violations(point), *rows_of(constraints, point.task, point.topology).violations(point)]


def correct_point(point: Point, constraints: UserConstraints) -> Point:
    """Return a point as a file can hold it; own constraints may bound inputs that cost nothing."""
    return correct(point, settled=len(point.task.declared.load_cases) if constraints else 0)


def rows_of(constraints: UserConstraints, task: ResolvedTask, topology: Topology) -> UserRows:
    """Return own constraints as rows; those of the last few programs are kept."""
    return _kept_rows(constraints, task, topology) if constraints else UserRows((), task, topology)


class Assembled(Protocol):
    """A program in numbers, as Ipopt is handed it (`nlp.assembled`)."""

    size: int
    rows: int
    lower: Array
    upper: Array
    jacobian_pattern: ca.Sparsity
    hessian_pattern: ca.Sparsity

    def objective(self, variables: Array) -> float:
        """Return the objective."""

    def gradient(self, variables: Array) -> Array:
        """Return its gradient."""

    def constraints(self, variables: Array) -> Array:
        """Return the rows."""

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the Lagrangian."""


class FurtherRows(Protocol):
    """Rows below those of a program."""

    lower: Array
    upper: Array
    jacobian_pattern: ca.Sparsity
    hessian_pattern: ca.Sparsity

    def values(self, variables: Array) -> Array:
        """Return the rows."""

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of their sum, times multipliers."""


class UserRows:
    """The own constraints of one task and topology; there may be none."""

    def __init__(self, constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
        """Take them; symbols are built when they are first asked for."""
        self.constraints, self.task, self.topology = tuple(constraints), task, topology
        self._scales = [scale_of(constraint, task) for constraint in self.constraints]

    def __bool__(self) -> bool:
        """True if there are any."""
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
        g = [rows(one, platform) / scale for one, scale in zip(self.constraints, self._scales, strict=True)]
        return ca.cse(ca.vertcat(*g))

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
            limits = [getattr(one, name) / scale for one, scale in zip(self.constraints, self._scales, strict=True)]
            room = [
                one.upper - one.lower > 4 * TOLERANCE * s
                for one, s in zip(self.constraints, self._scales, strict=True)
            ]
            closer = [bound + sign * IMPOSED * TOLERANCE * wide for bound, wide in zip(limits, room, strict=True)]
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
        return JoinedProgram(program, DerivedRows(self)) if self else program


def _violation(constraint: OwnConstraint, scale: float, values: Array) -> Violation:
    """Return how far values over their scale are from meeting a constraint; what is no number is farthest."""
    if not np.all(np.isfinite(values)):
        return Violation(f"{constraint.name} (no finite value)", scale, constraint.unit, math.nan, TOLERANCE)
    off = float(max(np.max(constraint.lower / scale - values), np.max(values - constraint.upper / scale)))
    return Violation(constraint.name, off * scale, constraint.unit, off, TOLERANCE)


@lru_cache(maxsize=32)
def _kept_rows(constraints: UserConstraints, task: ResolvedTask, topology: Topology) -> UserRows:
    return UserRows(constraints, task, topology)


@lru_cache(maxsize=8)  # those of the user's constraints, and here of the pseudo-inverse, come again every round
def _derive(rows: UserRows | LimitRows) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return rows, their Jacobian, and the upper triangle of the Hessian of their sum times multipliers."""
    x, multipliers = rows.x, ca.SX.sym("multipliers", rows.g.numel())
    hessian = ca.triu(ca.hessian(ca.dot(multipliers, rows.g), x)[0])
    return (
        ca.Function("g", [x], [rows.g]),
        ca.Function("jacobian", [x], [ca.jacobian(rows.g, x)]),
        ca.Function("hessian", [x, multipliers], [hessian]),
    )


class DerivedRows:
    """Expressions as rows whose derivatives are CasADi's."""

    def __init__(self, rows: UserRows | LimitRows) -> None:
        """Derive them."""
        self._g, self._jacobian, self._hessian = _derive(rows)
        self.lower, self.upper = rows.bounds
        self.jacobian_pattern = self._jacobian.sparsity_out(0)
        self.hessian_pattern = self._hessian.sparsity_out(0)

    def values(self, variables: Array) -> Array:
        """Return the rows."""
        return np.asarray(self._g(variables), dtype=float).ravel()

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""
        return np.array(self._jacobian(variables).nonzeros())

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of their sum, times multipliers."""
        return np.array(self._hessian(variables, multipliers).nonzeros())


class JoinedProgram:
    """A program in numbers with other rows below its own."""

    def __init__(self, program: Assembled, rows: FurtherRows) -> None:
        """Find where entries go."""
        self._program, self._further = program, rows
        self.size, self.rows = program.size, program.rows + len(rows.lower)
        self.lower = np.concatenate([program.lower, rows.lower])
        self.upper = np.concatenate([program.upper, rows.upper])
        above, below = program.jacobian_pattern, rows.jacobian_pattern
        self.jacobian_pattern = ca.vertcat(above, below)
        counted = [
            ca.DM(part, list(range(first, first + part.nnz())))
            for part, first in ((above, 0), (below, above.nnz()))
        ]
        self._order = np.array(ca.vertcat(*counted).nonzeros(), dtype=np.intp)
        self.hessian_pattern = program.hessian_pattern.unite(rows.hessian_pattern)
        self._places = [
            _places(self.hessian_pattern, part) for part in (program.hessian_pattern, rows.hessian_pattern)
        ]

    def objective(self, variables: Array) -> float:
        """Return that of the program."""
        return self._program.objective(variables)

    def gradient(self, variables: Array) -> Array:
        """Return that of the program."""
        return self._program.gradient(variables)

    def constraints(self, variables: Array) -> Array:
        """Return all rows."""
        return np.concatenate([self._program.constraints(variables), self._further.values(variables)])

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""
        both = self._program.jacobian(variables), self._further.jacobian(variables)
        return np.asarray(np.concatenate(both)[self._order])

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the Lagrangian."""
        m = self._program.rows
        entries = np.zeros(self.hessian_pattern.nnz())
        entries[self._places[0]] = self._program.hessian(variables, of_objective, multipliers[:m])
        entries[self._places[1]] += self._further.hessian(variables, multipliers[m:])
        return entries


def _places(whole: ca.Sparsity, part: ca.Sparsity) -> Any:
    """Return where the entries of a pattern are among those of one that holds it."""
    return np.array(whole.get_nz(part.find()), dtype=np.intp)
