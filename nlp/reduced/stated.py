"""A task and a topology as the numbers that the compiled search works on.

Dimensionless as `nlp.problem`: lengths in l_arm, forces in m g, inputs in u_hover. The rows' names stay outside.

| symbol | meaning | shape |
|---|---|---|
| N | unknowns: psi, alpha_0, alpha_1, hinges 1..n-1, then p'_E unless the task fixes it from the COM | |
| c_k | what the squared inputs of load case k weigh in the objective, twice lambda_k / (4 n sum lambda) | (K,) |
| f_k, t_k, f_E | force f_E + f_C, torque tau_E + tau_C, force at the end-effector | (K, 3) each |
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp import names
from nlp.problem import variable_bounds
from nlp.units import Units
from topo_search.model import (
    LEAST_OFFSET,
    Directional,
    Exterior,
    Local,
    ResolvedTask,
    Topology,
    needs_offset,
)
from topo_search.model.airflow_room import part_cover
from topo_search.model.arrays import Array

Indices = NDArray[np.int64]

AIR, APART, EXCLUSION, BALL, CAPSULE, ALONG, CONE, CONE_COM, OFFSET, PARTS = range(10)
"""Kinds of rows: two envelopes; two centres; p'_E and a centre; an envelope and a ball about p'_E, a capsule from
there, one along p_E; an end ball of an envelope in a cone, its axis fixed or to the COM; the length of p_E;
the parts of one module and the envelope of another."""

LEAST_WEIGHT = 1e-4
"""Share of the largest weight that load cases which weigh less count with together, so that inputs are unique."""


class Tree(NamedTuple):
    """Who hangs on whom, and how."""

    parent: Indices
    """-1 for the root; parents come first."""
    port: Indices
    """The parent's port a."""
    kappa: Indices
    """Quarter turns of the child."""
    moves: NDArray[np.bool_]
    """[l, i]: angle l moves module i; angles are psi, alpha_0, alpha_1, then the hinges: shape (n+2, n)."""


class Rotors(NamedTuple):
    """What the modules weigh and produce."""

    l_c: float
    m_E: float
    own: Array
    """Torque of each rotor about its module's centre at unit input, shape (4, 3)."""
    u_min: float
    u_max: float


class Cases(NamedTuple):
    """The load cases."""

    effort: Array
    """c_k."""
    f: Array
    """f_k."""
    t: Array
    """t_k."""
    f_E: Array
    """f_E."""


class Rows(NamedTuple):
    """The clearances; each is to be `least` at least."""

    kind: Indices
    i: Indices
    j: Indices
    """The other module; unused where there is none."""
    data: Array
    """A path or axis (x, y, z), a radius or distance or length, sine and cosine of a half-angle: shape (m, 6)."""
    least: Array


class Stated(NamedTuple):
    """Everything that the search needs to know of a task and a topology."""

    tree: Tree
    rotors: Rotors
    cases: Cases
    rows: Rows
    air: tuple[float, float, float]
    """Length of an envelope's axis, its start radius and growth."""
    parts: Array
    """Balls around the parts of a module that reach out of its own airflow: x, y, z, radius; shape (b, 4)."""
    lower: Array
    """Bounds on the unknowns, shape (N,)."""
    upper: Array
    fixed: Array
    """p'_E from the centroid where the task fixes it, else empty."""


class Row(NamedTuple):
    """One clearance with its constraint's name."""

    name: str
    kind: int
    i: int
    j: int
    data: tuple[float, float, float, float, float, float]
    least: float


def state(task: ResolvedTask, topology: Topology) -> Stated:
    """Return the numbers of a task and a topology."""
    n, unit, module = topology.n, Units.of(task), task.module
    arm = 1 / math.sqrt(2)
    drag = module.torque_coefficient / (module.thrust_coefficient * module.arm_length)
    corners = ((1, -1), (-1, -1), (-1, 1), (1, 1))
    own = np.array([[arm * y, -arm * x, (-1) ** (q + 1) * drag] for q, (x, y) in enumerate(corners)]) / 4
    m_E, fixed = task.end_effector.mass / module.mass, task.end_effector.fixed_position
    limits = task.min_thrust_to_weight, task.max_thrust_to_weight
    rotors = Rotors(module.connector_distance / unit.length, m_E, own, *limits)
    air = module.envelope
    geometric = n + 2 + (3 if fixed is None else 0)
    lower, upper = (np.array(side[:geometric]) for side in variable_bounds(task, topology))
    return Stated(
        _tree(topology),
        rotors,
        _cases(task, n, unit),
        _columns(list(rows(task, topology))),
        (air.length / unit.length, air.start_radius / unit.length, air.growth / unit.length),
        np.column_stack(part_cover(module)) / unit.length,
        lower,
        upper,
        np.empty(0) if fixed is None else (n + m_E) / n * np.array(fixed) / unit.length,
    )


def _tree(topology: Topology) -> Tree:
    n, edges = topology.n, list(topology.edges())
    parent, port = np.full(n, -1), np.zeros(n, dtype=np.int64)
    moves = np.zeros((n + 2, n), dtype=bool)
    moves[:3] = True
    for h, i, a, _ in edges:
        parent[i], port[i] = h, a
        moves[3:, i] = moves[3:, h]
        moves[i + 2, i] = True
    return Tree(parent.astype(np.int64), port, np.array(topology.kappas, dtype=np.int64), moves)


def _cases(task: ResolvedTask, n: int, unit: Units) -> Cases:
    cases = task.load_cases
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, tau_E = (np.array([getattr(w, name) for w in tip]) for name in ("force", "torque"))
    f_C, tau_C = (np.array([getattr(w, name) for w in com]) for name in ("force", "torque"))
    weights = np.array([case.weight for case in cases])
    weights = weights / weights.max()
    least = LEAST_WEIGHT / max(1, int(np.count_nonzero(weights < LEAST_WEIGHT)))
    effort = 2 * np.maximum(weights, least) / (4 * n * weights.sum())
    return Cases(effort, (f_E + f_C) / unit.force, (tau_E + tau_C) / unit.torque, f_E / unit.force)


def rows(task: ResolvedTask, topology: Topology) -> Iterator[Row]:
    """Yield (4) to (9) of the page, in its order."""
    n, unit = topology.n, task.module.arm_length
    margin = task.search.margin / unit
    pairs = list(combinations(range(n), 2))

    def row(name: str, kind: int, i: int, j: int, *, path: Array | None = None, size: float = 0.0) -> Row:
        x, y, z = (0.0, 0.0, 0.0) if path is None else (path / unit).tolist()
        return Row(name, kind, i, j, (x, y, z, size / unit, 0.0, 0.0), margin)

    if task.search.interference == "airflow":
        yield from (row(names.airflow(i, j), AIR, i, j) for i, j in pairs)
        distance, separated = task.centre_distance, [pair for pair in pairs if pair not in topology.bolted]
    else:
        distance, separated = task.separation, pairs
    if distance is not None:
        yield from (row(names.separation(i, j), APART, i, j, size=distance) for i, j in separated)
    if task.body_clearance is not None:
        yield from (row(names.rotor_airflow(i, j), PARTS, i, j) for i, j in topology.unbolted)
    if task.exclusion_radius is not None:
        yield from (row(names.exclusion(i), EXCLUSION, i, 0, size=task.exclusion_radius) for i in range(n))
    if task.tip_radius is not None:
        yield from (row(names.tip_airflow(i), BALL, i, 0, size=task.tip_radius) for i in range(n))
    for number, requirement in enumerate(task.exposure):
        for i in range(n):
            match requirement:
                case Local(radius=float(radius)):
                    yield row(names.exposure(number, requirement, i), BALL, i, 0, size=radius)
                case Local():
                    raise NotImplementedError("`reason_against` must be asked before")
                case Directional(segments=None, length=float(length), radius=radius):
                    name = names.exposure(number, requirement, i, 0)
                    yield row(name, ALONG, i, 0, path=np.array([length, 0.0, 0.0]), size=radius)
                case Directional():
                    for segment, path in enumerate(requirement.segments or ()):
                        name = names.exposure(number, requirement, i, segment)
                        yield row(name, CAPSULE, i, 0, path=np.array(path), size=requirement.radius)
                case Exterior():
                    theta, com = math.radians(requirement.half_angle_deg), requirement.axis == "com"
                    axis = np.zeros(3) if com else np.array(requirement.axis) / math.hypot(*requirement.axis)
                    name = names.exposure(number, requirement, i)
                    for end in (0, 1):
                        data = (*axis.tolist(), 0.0, math.sin(theta), math.cos(theta))
                        yield Row(name, CONE_COM if com else CONE, i, end, data, margin)
    if any(needs_offset(requirement) for requirement in task.exposure):
        yield Row(names.OFFSET, OFFSET, 0, 0, (0.0, 0.0, 0.0, LEAST_OFFSET, 0.0, 0.0), 0.0)


def _columns(listed: list[Row]) -> Rows:
    kind, i, j = (np.array([row[k] for row in listed], dtype=np.int64) for k in (1, 2, 3))
    data = np.array([row.data for row in listed]).reshape(-1, 6)
    return Rows(kind, i, j, data, np.array([row.least for row in listed]))
