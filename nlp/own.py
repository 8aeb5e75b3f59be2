"""Constraints of a user's own, as rows of the problem and as numbers at a point.

They are no part of the paper's page: the reduced search, lower bounds and proofs do not know them. Ipopt does, and
so does the evaluation that decides whether a point is a design.

| symbol | meaning | shape |
|---|---|---|
| x | unknowns in the order of `nlp.problem.Variables` | (N,) |
| g | own expressions over their scales | (m,) |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from nlp.numbers.evaluate import Violation, violations
from nlp.numbers.finish import finish
from nlp.numbers.point import Point
from nlp.symbols.kinematics import Pose, poses
from nlp.symbols.wrench import scale
from nlp.units import Units
from topo_search.model import BadInput, Design, Fault, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.stated import StatedCheck
from topo_search.protocols import OwnConstraint, SymbolicPlatform

TOLERANCE = 1e-6
"""By how much of its scale an own constraint may be missed: the audit's own tolerance for residuals."""
DRAWS = 64
"""Random platforms on one of which an own constraint must have a value."""
IMPOSED = 0.1
"""Share of that which Ipopt leaves of a bound, so that what it reaches to its tolerance is within it."""


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


OwnConstraints = tuple[OwnConstraint, ...]
"""What a user states; mostly nothing."""


def violations_of(point: Point, own: OwnConstraints) -> list[Violation]:
    """Return how far a point is from meeting everything: the printed problem, and own constraints."""
    return [*violations(point), *rows_of(own, point.task, point.topology).violations(point)]


def finish_point(point: Point, own: OwnConstraints) -> Point:
    """Return a point as a file can hold it; own constraints may bound inputs that cost nothing."""
    return finish(point, settled=len(point.task.declared.load_cases) if own else 0)


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
        platform = _platform(self.task, self.topology, self.x)
        return ca.vertcat(
            *(rows(one, platform) / scale for one, scale in zip(self.constraints, self._scales, strict=True))
        )

    @cached_property
    def counts(self) -> list[int]:
        """The number of rows of each constraint."""
        platform = _platform(self.task, self.topology, self.x)
        return [rows(one, platform).numel() for one in self.constraints]

    def draw(self, rng: np.random.Generator) -> Array:
        """Return random unknowns: angles [rad], lengths [l_arm] and inputs [u_hover] of the order of one."""
        x = rng.uniform(-1.5, 1.5, self.x.numel())
        first = len(x) - 4 * self.topology.n * len(self.task.load_cases)
        x[first:] = np.abs(x[first:])
        return x

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

    def beside(self, program: Assembled) -> Assembled:
        """Return a program with these rows after its own."""
        return Beside(program, self) if self else program


def _violation(constraint: OwnConstraint, scale: float, values: Array) -> Violation:
    """Return how far values over their scale are from meeting a constraint; what is no number is farthest."""
    if not np.all(np.isfinite(values)):
        return Violation(f"{constraint.name} (no finite value)", scale, constraint.unit, math.nan, TOLERANCE)
    off = float(max(np.max(constraint.lower / scale - values), np.max(values - constraint.upper / scale)))
    return Violation(constraint.name, off * scale, constraint.unit, off, TOLERANCE)


@lru_cache(maxsize=32)
def _kept_rows(own: OwnConstraints, task: ResolvedTask, topology: Topology) -> OwnRows:
    return OwnRows(own, task, topology)


class Rows(Protocol):
    """Rows of a program as expressions of all its unknowns."""

    @property
    def x(self) -> ca.SX:
        """The unknowns."""

    @property
    def g(self) -> ca.SX:
        """The rows."""

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest value of each."""


class Beside:
    """A program in numbers with other rows below its own; their derivatives are CasADi's."""

    def __init__(self, program: Assembled, own: Rows) -> None:
        """Derive the rows, and find where entries go."""
        self._program = program
        x, multipliers = own.x, ca.SX.sym("multipliers", own.g.numel())
        jacobian = ca.jacobian(own.g, x)
        hessian = ca.triu(ca.hessian(ca.dot(multipliers, own.g), x)[0])
        self._g = ca.Function("g", [x], [own.g])
        self._jacobian = ca.Function("jacobian", [x], [jacobian])
        self._hessian = ca.Function("hessian", [x, multipliers], [hessian])
        lower, upper = own.bounds
        self.size, self.rows = program.size, program.rows + len(lower)
        self.lower = np.concatenate([program.lower, lower])
        self.upper = np.concatenate([program.upper, upper])
        above, below = program.jacobian_pattern, jacobian.sparsity()
        self.jacobian_pattern = ca.vertcat(above, below)
        counted = [
            ca.DM(part, list(range(first, first + part.nnz())))
            for part, first in ((above, 0), (below, above.nnz()))
        ]
        self._order = np.array(ca.vertcat(*counted).nonzeros(), dtype=np.intp)
        self.hessian_pattern = program.hessian_pattern.unite(hessian.sparsity())
        self._places = [
            _places(self.hessian_pattern, part) for part in (program.hessian_pattern, hessian.sparsity())
        ]

    def objective(self, variables: Array) -> float:
        """Return that of the program."""
        return self._program.objective(variables)

    def gradient(self, variables: Array) -> Array:
        """Return that of the program."""
        return self._program.gradient(variables)

    def constraints(self, variables: Array) -> Array:
        """Return all rows."""
        own = np.asarray(self._g(variables), dtype=float).ravel()
        return np.concatenate([self._program.constraints(variables), own])

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""
        own = np.array(self._jacobian(variables).nonzeros())
        result: Array = np.concatenate([self._program.jacobian(variables), own])[self._order]
        return result

    def hessian(self, variables: Array, of_objective: float, multipliers: Array) -> Array:
        """Return the entries of the Hessian of the Lagrangian."""
        m = self._program.rows
        entries = np.zeros(self.hessian_pattern.nnz())
        entries[self._places[0]] = self._program.hessian(variables, of_objective, multipliers[:m])
        entries[self._places[1]] += np.array(self._hessian(variables, multipliers[m:]).nonzeros())
        return entries


def _places(whole: ca.Sparsity, part: ca.Sparsity) -> Any:
    """Return where the entries of a pattern are among those of one that holds it."""
    return np.array(whole.get_nz(part.find()), dtype=np.intp)


def _platform(task: ResolvedTask, topology: Topology, x: ca.SX) -> SymbolicPlatform:
    """Return the platform that the unknowns describe."""
    n, K, unit, module = topology.n, len(task.load_cases), Units.of(task), task.module
    modules: list[Pose] = poses(topology, x[:3], x[3 : n + 2], module.connector_distance / unit.length)
    m_E, position = task.end_effector.mass / module.mass, task.end_effector.fixed_position
    centroid = ca.sum2(ca.horzcat(*(pose.p for pose in modules))) / n
    p_E = x[n + 2 : n + 5] if position is None else centroid + (n + m_E) / n * scale(position, unit.length)
    p_COM = (m_E * p_E + n * centroid) / (n + m_E)
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


def check_stated(
    constraints: Sequence[OwnConstraint],
    design: Design,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
) -> tuple[StatedCheck, ...]:
    """Return what own constraints come to on a design, by their own expressions at poses that others computed.

    Args:
        constraints: what is checked.
        design: its angles and inputs.
        orientations: R_i, shape (n, 3, 3).
        centres: o_i from the centre of mass, shape (n, 3) [m].
        end_effector: p_E from the centre of mass, shape (3,) [m].
    """
    platform = platform_of(
        design.task,
        design.topology,
        orientations=orientations,
        centres=centres,
        end_effector=end_effector,
        hinge_angles=design.hinge_angles_rad,
        inputs=design.rotor_speeds_squared,
    )
    return tuple(_check(one, platform) for one in constraints)


def _check(constraint: OwnConstraint, platform: SymbolicPlatform) -> StatedCheck:
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    if not np.all(np.isfinite(values)):  # a constraint that has no value is not met
        return StatedCheck(**constraint.stated.model_dump(), status="missed")
    beyond = np.maximum(constraint.lower - values, values - constraint.upper)
    place = int(np.argmax(beyond))
    met = beyond[place] <= TOLERANCE * scale_of(constraint, platform.task)
    return StatedCheck(
        **constraint.stated.model_dump(),
        status="met" if met else "missed",
        value=float(values[place]),
        off_by=float(beyond[place]),
    )


def refuse_unusable(constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
    """Try own constraints on the symbols of one topology, and on random values of them, before workers do.

    Raises:
        BadInput: names the constraint, and what its expression raises or returns in place of expressions.
    """
    rng = np.random.default_rng(0)
    for constraint in constraints:
        try:
            own = OwnRows([constraint], task, topology)
            foreign = [symbol.name() for symbol in ca.symvar(own.g) if not ca.depends_on(own.x, symbol)]
            if foreign:
                raise ValueError(f"must be made of the platform's symbols alone, but has {', '.join(foreign)}")
            _ = own.bounds
            drawn = (np.asarray(own.values(own.draw(rng))) for _ in range(DRAWS))
            if not any(np.all(np.isfinite(values)) for values in drawn):
                raise ValueError(f"must have a finite value, but has none on {DRAWS} random platforms")
        except Exception as error:
            told = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            rule = f"cannot be stated for {topology.key}: {' '.join(told.split())}"
            raise BadInput("constraints", [Fault(constraint.name, rule)]) from error
