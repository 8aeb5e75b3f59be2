r"""Joint loads in the load cases of a task, and their limits as rows of a program.

| symbol | meaning | shape | unit |
|---|---|---|---|
| j, o_j | module outward of the joint; its centre from the COM | (3,) | l_arm |
| c | connector at which the joint is cut, from the COM | (3,) | l_arm |
| mu_j, m_J, M | mass of module j; of a joint; of the platform | | m |
| a, w' | acceleration of the platform and its angular acceleration | (3,) | g, g / l_arm |
| F_c, tau_c | force and torque of the joint on everything outward of it | (3,) | m g, l_arm m g |
| L | limit of a load | | m g, l_arm m g |

A load case is the total wrench of the rotors, so its wrench at the COM less the weight accelerates the platform:
a = f_C / M - e_z, w' = I^-1 tau_C. Newton's and Euler's equations for everything outward of the joint:

.. math::

    F_c = \sum_j \mu_j (a + w' \times o_j + e_z) - s_j z_j, \qquad
    \tau_c = \sum_j (I_j w' - m_j) + (o_j - c) \times (\mu_j (a + w' \times o_j + e_z) - s_j z_j)

plus the outward joints, which are point masses but do not include the cut one, and plus the end-effector with its
reaction f_E, tau_E and the mass of its rod, if it is mounted outward. Both loads are linear in the inputs. A limit
is the row (L^2 - |.|^2) / (2 L) >= 0, which near the limit is the distance to it. If no straight rod reaches,
either side of a joint may carry the end-effector: each load is then the larger of both, and each limit has two
rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from nlp.derived_rows import DerivedRows
from nlp.numbers.geometry import Swept, clearance, rotor_maps
from nlp.numbers.masses import masses
from nlp.numbers.point import Point, rod_path
from nlp.problem import Variables
from nlp.requirements.rod import rod_of
from nlp.rows import Violation
from nlp.symbols.platform import module_inertia, platform_inertia, rod_inertia, rod_vector, scale
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, ResolvedTask, Topology
from topo_search.model.room import part_cover

if TYPE_CHECKING:
    from nlp.assembled.problem import AssembledProblem

FITTING = 2.0
"""Length of the fitting of a rod at its mount, in radii of the rod."""
NEAR_SHARE = 0.6
"""Share of its limit above which a load gets a row."""
LOAD_TOLERANCE = 1e-7
"""Tolerance of a load above its limit [m_t g, l_arm m_t g]; the audit allows TOLERANCE."""


@dataclass(frozen=True)
class Load:
    """Size of a force or moment in one joint and load case."""

    case: int
    child: int
    """Module outward of the joint."""
    moment: bool
    """False: a force."""
    limit: float
    """L [N] or [N m]."""
    name: str
    """Name of its limit in the failure report."""


def limited_loads(task: ResolvedTask, topology: Topology) -> tuple[Load, ...]:
    """Return the loads that a task limits: in every joint and every load case, corners aside."""
    return tuple(
        Load(k, i, kind == "moment", limit, f"{label}, {kind} in the joint of module {i} and its parent")
        for kind, limit in zip(("force", "moment"), task.declared.joint_limits, strict=True)
        if limit is not None
        for k, label in enumerate(task.declared.case_labels)
        for i in range(1, topology.n)
    )


def holder(point: Point) -> int | None:
    """Return the module that carries the end-effector; None if unknown.

    It is the module of the nearest free connector whose rod meets its limits (`nlp.requirements.rod`), if that rod
    is clear of all airflow and of balls around the parts outside it: then the audit bolts the rod there, too.
    """
    rod, modules = rod_of(point), point.task.modules_of_nodes
    if rod is None:
        return None
    (R, p), radius, path, i = point.poses, point.task.end_effector.rod_radius, rod_path(point, rod), rod[0]
    start = point.tip - path
    fitting, length = np.zeros((point.topology.n, 1, 1)), float(np.linalg.norm(path))
    fitting[i] = min(1.0, FITTING * radius / max(length, radius))  # the fitting may touch its module
    clear = True
    for module, R_j, p_j, share in zip(modules, R, p, fitting, strict=True):
        balls = part_cover(module)
        free_part = Swept(start + share * path, (1 - share) * path, radius)
        centres = Swept(p_j + balls.centres @ R_j.T, np.zeros(3), 0.0)
        clear &= bool(np.all(clearance(free_part, centres) > balls.radii))
    return i if clear and np.all(clearance(Swept(start, path, radius), point.envelopes) > 0) else None


def loads(point: Point) -> Array:
    """Return the size of every limited load, in the order of `limited_loads` [N], [N m]."""
    task, limited = point.task, limited_loads(point.task, point.topology)
    if not limited:
        return np.zeros(0)
    unit, cases = Units.of(task), len(task.declared.load_cases)
    plain = Point(task.declared, point.topology, point.root, point.alpha, point.tip, point.u[:cases])
    sizes = _sizes(task.declared, point.topology, holder(point), limited)
    units = np.array([unit.torque if load.moment else unit.force for load in limited])
    return np.asarray(np.asarray(sizes(plain.pack())).ravel() * units)


@lru_cache(maxsize=8)
def _sizes(
    task: ResolvedTask, topology: Topology, tip_module: int | None, limited: tuple[Load, ...]
) -> ca.Function:
    x, vectors = _vectors(task, topology, tip_module, limited)
    sizes = [ca.mmax(ca.vertcat(*map(ca.norm_2, sides))) for sides in vectors]
    return ca.Function("sizes", [x], [ca.vertcat(*sizes)])


class LimitedLoads(NamedTuple):
    """Loads that have rows in a program."""

    tip_module: int | None
    """Module that carries the end-effector; None: unknown."""
    loads: tuple[Load, ...]


class JointLoads:
    """Rows of joint loads."""

    one_round = False

    def functions(self, task: ResolvedTask) -> tuple[()]:
        """Return nothing: CasADi evaluates the rows."""
        return ()

    def violations(self, point: Point) -> Iterator[Violation]:
        """Yield the violation of every limit."""
        task, n = point.task, point.topology.n
        for load, size in zip(limited_loads(task, point.topology), loads(point).tolist(), strict=True):
            excess, unit = size - load.limit, task.torque_unit(n) if load.moment else task.force_unit(n)
            yield Violation(load.name, excess, "N m" if load.moment else "N", excess / unit, LOAD_TOLERANCE)

    def select(self, origin: Point, *, everything: bool = False) -> LimitedLoads | None:
        """Return None: loads get rows after a solve that violates one."""
        return None

    def extend(
        self, point: Point, violated: Sequence[Violation], selection: LimitedLoads | None
    ) -> tuple[LimitedLoads | None, set[str]]:
        """Return all loads near their limits, if no load has rows yet or another module holds the end-effector.

        With another one there are rows for the end-effector on either side of each joint.
        """
        limited = limited_loads(point.task, point.topology)
        overloaded = {violation.name for violation in violated} & {load.name for load in limited}
        held_by = holder(point) if overloaded else None
        if not overloaded or (selection is not None and selection.tip_module in (None, held_by)):
            return selection, set()
        near_limits = tuple(
            load
            for load, size in zip(limited, loads(point).tolist(), strict=True)
            if size > NEAR_SHARE * load.limit
        )
        return LimitedLoads(held_by if selection is None else None, near_limits), overloaded

    def rows(
        self, program: AssembledProblem, task: ResolvedTask, topology: Topology, selection: LimitedLoads
    ) -> DerivedRows:
        """Return the rows of the limits."""
        return limit_rows(task, topology, selection)


def limit_rows(task: ResolvedTask, topology: Topology, limits: LimitedLoads) -> DerivedRows:
    """Return the rows of limits on the loads of a program with its corners, each at least zero."""
    unit, rows = Units.of(task), list[ca.SX]()
    x, vectors = _vectors(task, topology, limits.tip_module, limits.loads)
    for load, sides in zip(limits.loads, vectors, strict=True):
        L = load.limit / (unit.torque if load.moment else unit.force)
        rows += [(L * L - ca.dot(v, v)) / (2 * L) for v in sides]
    return DerivedRows(x, ca.vertcat(*rows), np.zeros(len(rows)), np.full(len(rows), np.inf))


def _vectors(
    task: ResolvedTask, topology: Topology, tip_module: int | None, limited: tuple[Load, ...]
) -> tuple[ca.SX, list[list[ca.SX]]]:
    """Return the unknowns of `nlp.problem.Variables` as one column, and the forces or moments of each load.

    A load is one vector, or if `tip_module` is None two, with the end-effector outward and inward of the joint.
    """
    unit, module, carried = Units.of(task), task.module, masses(task, topology)
    l_c, m_E = task.connector_distances / unit.length, task.end_effector.mass / module.mass
    variables = Variables.of(task, topology)
    modules, tip, p_COM = variables.platform(task, topology)
    o, q, up = [pose.p - p_COM for pose in modules], tip - p_COM, ca.DM([0, 0, 1])
    joints = {i: o[h] + l_c[h] * modules[h].R @ ca.DM(PORT_DIRECTIONS[a]) for h, i, a, _ in topology.edges()}
    inertias = [
        module_inertia(pose.R, own, module) for pose, own in zip(modules, task.modules_of_nodes, strict=True)
    ]
    weights = [own.mass / module.mass for own in task.modules_of_nodes]
    m_J, m_R = module.joint_mass / module.mass, carried.rod.mass
    inertia = platform_inertia(o, [pose.R for pose in modules], q, carried)
    d = rod_vector(o, [pose.R for pose in modules], q, carried.rod)
    r_R, spin_R = q - d / 2, rod_inertia(d, carried.rod)
    (forces, torques), outward, rotors = rotor_maps(task), _outward_modules(topology), task.rotors_per_module
    vectors = []
    for load in limited:
        case, c = task.load_cases[load.case], joints[load.child]
        at_com, at_tip = case.at_com, case.at_end_effector
        f_C, tau_C = scale(at_com.force, unit.force), scale(at_com.torque, unit.torque)
        f_E, tau_E = scale(at_tip.force, unit.force), scale(at_tip.torque, unit.torque)
        a, spin = f_C / carried.total - up, ca.SX.zeros(3)
        if any(at_com.torque):
            spin = ca.solve(inertia, tau_C)
        force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
        for j in outward[load.child]:
            u_j = variables.u[load.case][rotors * j : rotors * (j + 1)]
            pull = weights[j] * (a + ca.cross(spin, o[j]) + up) - modules[j].R @ (ca.DM(forces[j]) @ u_j)
            force += pull
            moment += inertias[j] @ spin - modules[j].R @ (ca.DM(torques[j]) @ u_j) + ca.cross(o[j] - c, pull)
            if j != load.child:  # the cut joint belongs to the parent
                pull = m_J * (a + ca.cross(spin, joints[j]) + up)
                force += pull
                moment += ca.cross(joints[j] - c, pull)
        pull = m_E * (a + ca.cross(spin, q) + up) + f_E
        without_tip = moment if load.moment else force
        on_rod = m_R * (a + ca.cross(spin, r_R) + up)
        tip_moment = ca.cross(q - c, pull) + tau_E + ca.cross(r_R - c, on_rod) + spin_R @ spin
        with_tip = moment + tip_moment if load.moment else force + pull + on_rod
        sides = (True, False) if tip_module is None else (tip_module in outward[load.child],)
        vectors.append([with_tip if tip else without_tip for tip in sides])
    return variables.vector(), vectors


def _outward_modules(topology: Topology) -> list[set[int]]:
    """Return the modules outward of each one, itself included."""
    outward = [{i} for i in range(topology.n)]
    for h, i, _, _ in reversed(list(topology.edges())):
        outward[h] |= outward[i]
    return outward
