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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.airspeed import AIMED_AT, region_of
from nlp.numbers.geometry import torque_map
from nlp.numbers.jets import Jet, Region, jet_of
from nlp.numbers.kinematics import Tree, tree_of
from nlp.numbers.masses import RodMass, masses
from nlp.requirements import clearances, variable_bounds
from nlp.requirements.balances import turns
from nlp.requirements.statement import COLUMNS, Kernel
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.corners import CorneredTask
from topo_search.model.shape import Capsule

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Rotors(NamedTuple):
    """Weight and rotor output of the modules."""

    l_c: float
    m_E: float
    bodies: float
    """Mass of modules and joints."""
    modules: Array
    """Mass of each module with its joints, shape (n,)."""
    centres: Array
    """Centre of that from the module's own, x and y in its frame, shape (n, 2)."""
    inertias: Array
    """Inertia about that centre in the module's frame, shape (n, 3, 3) [m l_arm^2]."""
    rod: RodMass
    torques: Array
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
    turn: Array
    """Angular acceleration of the platform, shape (K, 3) [g / l_arm]."""
    dead: Indices
    """The rotor that does not run, -1 where all do."""
    group: Indices
    """Group of each corner; -1 for what always counts. Others count from when they are found missed."""


class Rows(NamedTuple):
    """The clearances; each is to be `least` at least."""

    kind: Indices
    i: Indices
    j: Indices
    """The other module; unused where there is none."""
    data: Array
    """Numbers of each row in the columns `COLUMNS`, shape (m, width)."""
    least: Array
    """Smallest allowed value of every row, shape (m,)."""
    rods: int
    """Number of rods with rows; only those of one count: the shortest that lacks nothing, else what lacks least."""


class Hulls(NamedTuple):
    """The faces and edges of all regions that are hulls; a row has its first and past its last of both."""

    planes: Array
    """Outward unit normal and offset, shape (p, 4)."""
    edges: Array
    """Start, and from there to the end, shape (e, 6)."""


class Speeds(NamedTuple):
    """The rows of air speeds, for each load case of the task, region and module; they come after the clearances.

    Each region is a `nlp.numbers.jets.Region`, with its axis along p_E where it turns with that.
    """

    jet: Jet
    case: Indices
    module: Indices
    region: Indices
    start: Array
    """Shape (r, 3)."""
    axis: Array
    """Shape (r, 3)."""
    along: Array
    """Length of a path along p_E, -1 of a cone's axis to the COM, else 0; shape (r,)."""
    radius: Array
    half_angle: Array
    within: Array
    over: Array
    """1 over the limit, shape (r,) [s/m]."""
    planes: Array
    """Those of all regions, shape (f, 3)."""
    first: Indices
    """First plane of each region, and one past the last, shape (r + 1,)."""


class ReducedProblem(NamedTuple):
    """Everything that the search needs to know of a task and a topology."""

    tree: Tree
    rotors: Rotors
    cases: Cases
    rows: Rows
    hulls: Hulls
    speeds: Speeds
    air: tuple[float, float, float]
    """Length of an envelope's axis, its start radius and growth."""
    parts: Array
    """Balls around the parts of a module (`Task.part_cover`): x, y, z, radius; shape (b, 4)."""
    lower: Array
    """Bounds on the unknowns, shape (N,)."""
    upper: Array
    fixed: Array
    """p'_E from the centre of mass of the modules and joints where the task fixes it, else empty."""


class Row(NamedTuple):
    """One clearance with its constraint's name."""

    name: str
    i: int
    j: int
    least: float
    kernel: Kernel


def to_arrays(task: ResolvedTask, topology: Topology) -> ReducedProblem:
    """Return the numbers of a task and a topology."""
    n, unit, module = topology.n, Units.of(task), task.module
    carried, fixed = masses(module, task.end_effector, topology), task.end_effector.fixed_position
    rotors = Rotors(
        module.connector_distance / unit.length,
        carried.tip,
        carried.bodies,
        carried.modules.copy(),
        carried.centres.copy(),
        carried.inertias.copy(),
        carried.rod,
        torque_map(module).T.copy(),
        task.min_thrust_to_weight,
        task.max_thrust_to_weight,
    )
    air, speeds = module.envelope, _speeds(task)
    geometric = n + 2 + (3 if fixed is None else 0)
    lower, upper = (np.array(side[:geometric]) for side in variable_bounds(task, topology))
    return ReducedProblem(
        tree_of(topology),
        rotors,
        _cases(task, n, unit),
        *_columns(list(rows(task, topology)), len(speeds.case)),
        speeds,
        (air.length / unit.length, air.start_radius / unit.length, air.growth / unit.length),
        np.column_stack(task.part_cover) / unit.length,
        lower,
        upper,
        np.empty(0) if fixed is None else carried.lever * np.array(fixed) / unit.length,
    )


def _cases(task: ResolvedTask, n: int, unit: Units) -> Cases:
    cases = task.load_cases
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, tau_E = (np.array([getattr(w, name) for w in tip]) for name in ("force", "torque"))
    f_C, tau_C = (np.array([getattr(w, name) for w in com]) for name in ("force", "torque"))
    weights = np.array([case.weight for case in cases])
    weights = weights / weights.max()
    # load cases that weigh less count with a share of the largest weight together, so that inputs are unique; of
    # them at most 20 are taken to be active at a time
    share = 1e-4
    least = share / min(20, max(1, int(np.count_nonzero(weights < share))))
    effort = 2 * np.maximum(weights, least) / (4 * n * weights.sum())
    dead = np.array([-1 if rotor is None else rotor for rotor in task.dead_rotors], dtype=np.int64)
    group = np.full(len(cases), -1, dtype=np.int64)
    if isinstance(task, CorneredTask):
        group[len(cases) - len(task.groups) :] = task.groups
    f, tau = (f_E + f_C) / unit.force, (tau_E + tau_C) / unit.torque
    return Cases(effort, f, tau, f_E / unit.force, turns(task), dead, group)


def rows(task: ResolvedTask, topology: Topology) -> Iterator[Row]:
    """Yield (4) to (9) of the printed problem, in its order."""
    for requirement in clearances(task, topology):
        for name, subject, formula in requirement.rows():
            for kernel in formula.kernels():
                yield Row(name, subject[kernel.of], subject[1], requirement.margin, kernel)


def _columns(listed: list[Row], speeds: int) -> tuple[Rows, Hulls]:
    kind = np.array([row.kernel.kind for row in listed], dtype=np.int64)
    i, j = (np.array([row[k] for row in listed], dtype=np.int64) for k in (1, 2))
    data = np.array([row.kernel.numbers() for row in listed]).reshape(-1, COLUMNS.width)
    planes, edges, places = [np.empty((0, 4))], [np.empty((0, 6))], dict[int, list[int]]()
    faced = edged = 0
    for row, numbers in zip(listed, data, strict=True):
        hull = row.kernel.hull
        if hull is None:
            continue
        if id(hull) not in places:  # the modules share it
            a, b = hull.corners[hull.edges].transpose(1, 0, 2)
            planes.append(hull.planes)
            edges.append(np.column_stack([a, b - a]))
            places[id(hull)] = [faced, faced + len(planes[-1]), edged, edged + len(edges[-1])]
            _, faced, _, edged = places[id(hull)]
        numbers[COLUMNS.planes : COLUMNS.planes + 4] = places[id(hull)]
    tables = Hulls(np.concatenate(planes), np.concatenate(edges))
    rods = max((row.kernel.rod.number for row in listed), default=-1) + 1
    least = np.array([row.least for row in listed] + [-math.log(AIMED_AT)] * speeds)
    return Rows(kind, i, j, data, least, rods), tables


def _speeds(task: ResolvedTask) -> Speeds:
    l_arm, regions, along, over = task.module.arm_length, list[Region](), list[float](), list[float]()
    for exposure in task.exposure:
        if exposure.speed is None:
            continue
        for shape in exposure.shapes:
            length = shape.length / l_arm if isinstance(shape, Capsule) and shape.length else -1.0
            along.append(length if shape.takes_direction_from_com else 0.0)  # the axis is found with the platform
            regions.append(region_of(shape.at(np.zeros(3)), l_arm, exposure.speed_reach))
            over.append(1 / exposure.speed)
    case, region, module = (
        index.ravel() for index in np.indices((len(task.declared.load_cases), len(regions), task.n))
    )
    axes = np.array([each.axis for each in regions]).reshape(-1, 3) * (np.array(along) == 0.0)[:, None]
    return Speeds(
        jet_of(task.module, task.air_density, task.gravity),
        case,
        module,
        region,
        np.array([each.start for each in regions]).reshape(-1, 3),
        axes,
        np.array(along),
        np.array([each.radius for each in regions]),
        np.array([each.half_angle for each in regions]),
        np.array([each.within for each in regions]),
        np.array(over),
        np.concatenate([np.empty((0, 3)), *(each.planes for each in regions)]),
        np.cumsum([0, *(len(each.planes) for each in regions)]),
    )
