"""A task and a topology as arrays for the compiled search.

Dimensionless as in `nlp.problem`: lengths in l_arm, forces in m g, inputs in u_hover.

| symbol | meaning | shape |
|---|---|---|
| N | number of unknowns: psi, alpha_0, alpha_1, hinges 1..n-1, p'_E unless the task fixes it from the COM | |
| c_k | weight of the squared inputs of load case k in the objective, twice lambda_k / (r n sum lambda) | (K,) |
| f_k, t_k, f_E | force f_E + f_C, torque tau_E + tau_C, force at the end-effector | (K, 3) each |
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from nlp.air.search_rows import Speeds, speeds_of
from nlp.numbers.geometry import rotor_maps
from nlp.numbers.kinematics import Tree, tree_of
from nlp.numbers.masses import RodMass, masses
from nlp.requirements import clearances, row_kinds, variable_bounds
from nlp.requirements.balances import angular_accelerations
from nlp.units import Units
from topo_search.model import Array, CorneredTask, Indices, ResolvedTask, Topology
from topo_search.model.shape import Hull


class Rotors(NamedTuple):
    """Weight and rotor output of the modules."""

    l_c: Array
    """Distance of each module's connectors, shape (n,)."""
    m_E: float
    bodies: float
    """Mass of modules and joints."""
    modules: Array
    """Mass of each module with its joints, shape (n,)."""
    centres: Array
    """Centre of that mass from the module's centre, x and y in the module's frame, shape (n, 2)."""
    inertias: Array
    """Inertia about that centre in the module's frame, shape (n, 3, 3) [m l_arm^2]."""
    rod: RodMass
    forces: Array
    """Force of each rotor at unit input in its module's frame, shape (r n, 3); 0 if its module lacks it."""
    torques: Array
    """Torque of each rotor about its module's centre at unit input, shape (r n, 3)."""
    u_min: float | Array
    """Smallest input of every rotor, or of each, shape (r n,)."""
    u_max: float | Array
    """Largest input."""


class Cases(NamedTuple):
    """The load cases."""

    weight: Array
    """c_k."""
    f: Array
    """f_k."""
    t: Array
    """t_k."""
    f_E: Array
    """f_E."""
    turn: Array
    """Angular acceleration of the platform, shape (K, 3) [g / l_arm]."""
    dead: Indices
    """Index of the dead rotor, -1 if all run."""
    group: Indices
    """Set of each corner; -1 for load cases that are always active. A corner becomes active once it is violated."""


class Kinds(NamedTuple):
    """The bodies or obstacles of all rows."""

    kind: Indices
    """Kind of each."""
    first: Indices
    """Index of its first number."""
    numbers: Array
    """Numbers of all, of each in the order of its fields, shape (count,)."""


class Rows(NamedTuple):
    """The clearances, each with a lower bound."""

    i: Indices
    j: Indices
    """Index of the other module, or -1."""
    bodies: Kinds
    obstacles: Kinds
    lower: Array
    """Smallest allowed value of every row, shape (m,)."""
    rods: int
    """Number of rods with rows. Only the rows of the best rod apply: the shortest feasible one, else the one with
    the smallest violation."""


class Hulls(NamedTuple):
    """The faces and edges of all hulls; each row has the index of its first one and one past its last."""

    planes: Array
    """Outward unit normal and offset, shape (p, 4)."""
    edges: Array
    """Start point and vector to the end point, shape (e, 6)."""


class ReducedProblem(NamedTuple):
    """A task and a topology for the compiled search."""

    tree: Tree
    rotors: Rotors
    cases: Cases
    rows: Rows
    hulls: Hulls
    speeds: Speeds | None
    """None without limits on air speed: the code of their rows is then not compiled."""
    parts: Array
    """Balls around the parts of each type of module (`Task.part_cover`): x, y, z, radius; shape (b, 4)."""
    lower: Array
    """Bounds on the unknowns, shape (N,)."""
    upper: Array
    fixed: Array
    """p'_E from the centre of mass of the modules and joints if the task fixes it, else empty."""


class NamedRow(NamedTuple):
    """One clearance with the name of its constraint."""

    name: str
    i: int
    j: int
    lower: float
    search_row: row_kinds.SearchRow


def to_arrays(task: ResolvedTask, topology: Topology) -> ReducedProblem:
    """Return a task and a topology as arrays."""
    n, unit = topology.n, Units.of(task)
    carried, fixed = masses(task, topology), task.end_effector.fixed_position
    own = task.input_shares.ravel()
    shares: float | Array = 1.0 if np.all(own == 1) else own  # a number is faster
    forces, torques = (maps.transpose(0, 2, 1).reshape(-1, 3) for maps in rotor_maps(task))
    rotors = Rotors(
        task.connector_distances / unit.length,
        carried.tip,
        carried.bodies,
        carried.modules.copy(),
        carried.centres.copy(),
        carried.inertias.copy(),
        carried.rod,
        forces,
        torques,
        task.min_thrust_to_weight * shares,
        task.max_thrust_to_weight * shares,
    )
    speeds = speeds_of(task)
    geometric = n + 2 + (3 if fixed is None else 0)
    lower, upper = (np.array(side[:geometric]) for side in variable_bounds(task, topology))
    return ReducedProblem(
        tree_of(topology),
        rotors,
        _cases(task, unit),
        *_tabulate(list(rows(task, topology)), [] if speeds is None else speeds.lower),
        speeds,
        np.concatenate([np.column_stack(task.part_cover(kind)) for kind in task.types]) / unit.length,
        lower,
        upper,
        np.empty(0) if fixed is None else carried.lever * np.array(fixed) / unit.length,
    )


def _cases(task: ResolvedTask, unit: Units) -> Cases:
    cases = task.load_cases
    at_tip, at_com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, tau_E = (np.array([getattr(w, name) for w in at_tip]) for name in ("force", "torque"))
    f_C, tau_C = (np.array([getattr(w, name) for w in at_com]) for name in ("force", "torque"))
    weights = np.array([case.weight for case in cases])
    weights = weights / weights.max()
    # cases of smaller weight get a share of the largest weight together, so that their inputs are unique; at most
    # 20 of them are assumed to be active at a time
    share = 1e-4
    min_weight = share / min(20, max(1, int(np.count_nonzero(weights < share))))
    effort = 2 * np.maximum(weights, min_weight) / (task.rotor_count * weights.sum())
    dead = np.array([-1 if rotor is None else rotor for rotor in task.dead_rotors], dtype=np.int64)
    group = np.full(len(cases), -1, dtype=np.int64)
    if isinstance(task, CorneredTask):
        group[len(cases) - len(task.groups) :] = task.groups
    f, tau = (f_E + f_C) / unit.force, (tau_E + tau_C) / unit.torque
    return Cases(effort, f, tau, f_E / unit.force, angular_accelerations(task), dead, group)


def rows(task: ResolvedTask, topology: Topology) -> Iterator[NamedRow]:
    """Yield (4) to (9) of the printed problem, in its order."""
    for requirement in clearances(task, topology):
        search_rows = {id(formula): formula.search_rows() for formula in requirement.formulas}
        for name, subject, formula in requirement.rows():
            for search_row in search_rows[id(formula)]:
                yield NamedRow(name, subject[search_row.subject], subject[1], requirement.margin, search_row)


def _tabulate(named_rows: list[NamedRow], lower_speeds: Sequence[float]) -> tuple[Rows, Hulls]:
    search_rows = [row.search_row for row in named_rows]
    planes, edges, ranges = [np.empty((0, 4))], [np.empty((0, 6))], dict[int, list[int]]()
    face_count = edge_count = 0
    for obstacle in (row.obstacle for row in search_rows):
        if (
            isinstance(obstacle, row_kinds.HullObstacle | row_kinds.FacesObstacle)
            and id(hull := obstacle.hull) not in ranges
        ):
            a, b = hull.corners[hull.edges].transpose(1, 0, 2)
            planes.append(hull.planes)
            edges.append(np.column_stack([a, b - a]))
            ranges[id(hull)] = [face_count, face_count + len(planes[-1]), edge_count, edge_count + len(edges[-1])]
            _, face_count, _, edge_count = ranges[id(hull)]
    i, j = (np.array([row[k] for row in named_rows], dtype=np.int64) for k in (1, 2))
    obstacles = _kinds([row.obstacle for row in search_rows], row_kinds.OBSTACLES, ranges)
    bodies = _kinds([row.body for row in search_rows], row_kinds.BODIES, ranges)
    j[(obstacles.kind != row_kinds.MODULE) & (obstacles.kind != row_kinds.AIRFLOW)] = -1
    rods = len({row.body.number for row in search_rows if isinstance(row.body, row_kinds.RodBody)})
    lower = np.array([row.lower for row in named_rows] + [*lower_speeds])
    return Rows(i, j, bodies, obstacles, lower, rods), Hulls(np.concatenate(planes), np.concatenate(edges))


def _kinds(things: Sequence[tuple[Any, ...]], kinds: Sequence[type], ranges: Mapping[int, Sequence[int]]) -> Kinds:
    """Return bodies or obstacles, of which many are one object, as arrays; a hull has its ranges of both."""
    kind = np.array([kinds.index(type(thing)) for thing in things], dtype=np.int64)
    numbers_of = {
        key: np.hstack([[], *(ranges[id(value)] if isinstance(value, Hull) else value for value in thing)])
        for key, thing in {id(thing): thing for thing in things}.items()
    }
    numbers = [numbers_of[id(thing)] for thing in things]
    first = np.cumsum([0, *map(len, numbers)])[: len(things)]
    return Kinds(kind, first, np.concatenate([np.empty(0), *numbers]))
