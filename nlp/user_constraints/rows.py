"""User constraints as rows of the problem, and their values at a point.

| symbol | meaning | shape |
|---|---|---|
| x | unknowns in the order of `nlp.problem.Variables` | (N,) |
| g | the constraints' expressions over their scales | (m,) |

A constraint is called with a symbolic or a numeric platform.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.derived_rows import DerivedRows
from nlp.numbers.point import Point
from nlp.problem import Variables
from nlp.rows import UserConstraints, Violation
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, Mount, ResolvedTask, Topology
from topo_search.own_constraint import OwnConstraint, SymbolicPlatform


def scale_of(constraint: OwnConstraint, task: ResolvedTask) -> float:
    """Return a typical magnitude of a constraint, in its unit."""
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
        ValueError: the return value is not a CasADi expression, or is empty.
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


def symbolic_platform(task: ResolvedTask, topology: Topology, variables: Variables) -> SymbolicPlatform:
    """Return the platform as a function of the unknowns."""
    unit, (modules, tip, p_COM) = Units.of(task), variables.platform(task, topology)
    counted = task.end_effector.counted_rod
    return _platform(
        task.declared,
        topology,
        counted and Mount(module=counted.module, port=counted.port),
        centres=tuple((pose.p - p_COM) * unit.length for pose in modules),
        orientations=tuple(pose.R for pose in modules),
        end_effector=(tip - p_COM) * unit.length,
        hinge_angles=variables.alpha,
        inputs=tuple(u_k * unit.input for u_k in variables.u[: len(task.declared.load_cases)]),
    )


def platform_of(
    tree: tuple[ResolvedTask, Topology, Mount | None], pose: tuple[Array, Array, Array], alpha: Any, inputs: Any
) -> SymbolicPlatform:
    """Return a numerical platform as user constraints take it, of (p_E, o, R); see `check_user_constraints`."""
    end_effector, centres, orientations = pose
    return _platform(
        *tree,
        centres=tuple(ca.SX(ca.DM(o)) for o in centres),
        orientations=tuple(ca.SX(ca.DM(R)) for R in orientations),
        end_effector=ca.SX(ca.DM(end_effector)),
        hinge_angles=ca.SX(ca.DM(list(alpha)).reshape((tree[1].n - 1, 1))),
        inputs=tuple(ca.SX(ca.DM(list(u_k))) for u_k in inputs),
    )


def _platform(task: ResolvedTask, topology: Topology, mount: Mount | None, **parts: Any) -> SymbolicPlatform:
    """Return a platform with its rod from the mount, or without one from the nearest free connector."""
    connectors = topology.free_connectors if mount is None else [(mount.module, mount.port)]
    rods = [
        parts["end_effector"]
        - parts["centres"][i]
        - task.connector_distances[i] * (parts["orientations"][i] @ ca.DM(PORT_DIRECTIONS[port]))
        for i, port in connectors
    ]
    nearest = rods[0]
    for rod in rods[1:]:
        nearest = ca.if_else(ca.sumsqr(rod) < ca.sumsqr(nearest), rod, nearest)
    return SymbolicPlatform(task=task, topology=topology, mount=mount, rod=nearest, **parts)


TOLERANCE = 1e-6
"""Tolerance of a user constraint, as a share of its scale: the audit's own tolerance for residuals."""
IMPOSED = 0.1
"""Distance that Ipopt keeps from a bound, in TOLERANCE, so that its result is within the bound."""


@lru_cache(maxsize=32)
def rows_of(constraints: UserConstraints, task: ResolvedTask, topology: Topology) -> UserRows:
    """Return user constraints as rows; cached for the last few programs."""
    return UserRows(constraints, task, topology)


class UserRows:
    """User constraints for one task and topology."""

    def __init__(self, constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
        """Build the expressions."""
        self.constraints, self.task, self.topology = constraints, task, topology
        self._scales = [scale_of(constraint, task) for constraint in constraints]
        variables = Variables.of(task, topology)
        platform, self.x = symbolic_platform(task, topology, variables), variables.vector()
        columns = [rows(item, platform) / scale for item, scale in zip(constraints, self._scales, strict=True)]
        self.counts = [column.numel() for column in columns]
        """Number of rows of each constraint."""
        self.g = ca.cse(ca.vertcat(*columns))
        """Rows of all constraints over their scales, as expressions of the unknowns x."""

    def draw(self, rng: np.random.Generator) -> Array:
        """Return random unknowns of any magnitude: angles, p'_E within the reach of all modules, and inputs."""
        n, unit = self.topology.n, Units.of(self.task)
        first = self.x.numel() - self.task.rotor_count * len(self.task.load_cases)
        largest = np.full(self.x.numel(), 2.0)  # inputs: twice the hover input
        largest[: n + 2] = math.pi / 2
        largest[n + 2 : first] = 2 * n * self.task.longest_connector / unit.length
        kinds = [n + 2, first - n - 2, len(largest) - first]
        x = largest * np.repeat(10.0 ** rng.uniform(-2.0, 0.0, 3), kinds) * rng.uniform(-1.0, 1.0, len(largest))
        x[first:] = np.abs(x[first:])
        return np.asarray(x)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds on g; slightly tighter for inequalities, so that Ipopt's result is within the user's bounds."""
        sides = np.array([(item.lower, item.upper) for item in self.constraints], dtype=float).T / self._scales
        inset = IMPOSED * TOLERANCE * (sides[1] - sides[0] > 4 * TOLERANCE)
        lower, upper = np.repeat([sides[0] + inset, sides[1] - inset], self.counts, axis=1)
        return lower, upper

    @cached_property
    def values(self) -> ca.Function:
        """The rows as a function of the unknowns."""
        return ca.Function("own", [self.x], [self.g])

    @cached_property
    def derived(self) -> DerivedRows:
        """The rows with their derivatives, for a program."""
        return DerivedRows(self.x, self.g, *self.bounds)

    def violations(self, point: Point) -> list[Violation]:
        """Return the violation of each constraint at a point."""
        values = np.asarray(self.values(point.pack()), dtype=float).ravel()
        parts = np.split(values, np.cumsum(self.counts)[:-1])
        return [
            _violation(constraint, scale, part)
            for constraint, scale, part in zip(self.constraints, self._scales, parts, strict=True)
        ]


def _violation(constraint: OwnConstraint, scale: float, values: Array) -> Violation:
    """Return the largest violation of scaled values; infinite or NaN values are the worst."""
    if not np.all(np.isfinite(values)):
        return Violation(f"{constraint.name} (no finite value)", scale, constraint.unit, math.nan, TOLERANCE)
    excess = float(max(np.max(constraint.lower / scale - values), np.max(values - constraint.upper / scale)))
    return Violation(constraint.name, excess * scale, constraint.unit, excess, TOLERANCE)
